/* What compilers call without being asked, so that the host's library links against nothing else. Built without
 * optimisation: a loop that copies would be turned into a call of itself. */
#include <stddef.h>

void *memcpy(void *to, const void *from, size_t count) {
    for (size_t i = 0; i < count; i++) ((char *)to)[i] = ((const char *)from)[i];
    return to;
}

void *memset(void *to, int value, size_t count) {
    for (size_t i = 0; i < count; i++) ((char *)to)[i] = (char)value;
    return to;
}
