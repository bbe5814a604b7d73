/* A Cortex-M4F or M7 in QEMU for a C program that reads by getchar, writes by putchar and returns a status from main.
 *
 * Standard input is the file that `-semihosting-config arg=FILE` names. On a board your own start-up replaces this. */

enum { OPEN = 0x01, WRITE_LETTER = 0x03, READ = 0x06, COMMAND_LINE = 0x15, EXIT = 0x20 };

extern int stack_top;
int main(void);
int getchar(void);
int putchar(int letter);
void reset(void);

/* Asks the debugger, here QEMU. */
static int semihost(int operation, const void *argument) {
    register int answer __asm__("r0") = operation;
    register const void *given __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(answer) : "r"(given) : "memory");
    return answer;
}

__attribute__((noreturn)) static void end(int status) {
    const int why[2] = {0x20026, status};
    semihost(EXIT, why);
    for (;;) {}
}

static void fault(void) { end(127); }

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &stack_top, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
    (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
};

/* The floating-point unit, coprocessors 10 and 11, before any function that uses it. */
__attribute__((naked)) void reset(void) {
    __asm__("ldr r0, =0xE000ED88\n ldr r1, [r0]\n orr r1, r1, #0xF00000\n str r1, [r0]\n dsb\n isb\n b begin\n");
}

__attribute__((section(".noinit"))) static struct {
    int file;
    unsigned left;
    const unsigned char *next;
    unsigned char block[512];
} input;

__attribute__((used)) static void begin(void) {
    char name[128];
    const struct { char *text; int size; } line = {name, sizeof name};
    input.left = 0;
    input.file = -1;
    if (semihost(COMMAND_LINE, &line) == 0) {
        const char *last = name; /* the program's own name may come first */
        for (const char *at = name; *at; at++) {
            if (*at == ' ' && at[1]) last = at + 1;
        }
        int length = 0;
        while (last[length]) length++;
        const struct { const char *text; int mode, length; } named = {last, 0, length};
        input.file = semihost(OPEN, &named);
    }
    end(main());
}

int getchar(void) {
    if (input.left == 0) {
        const struct { int file; void *to; int size; } wanted = {input.file, input.block, sizeof input.block};
        const int missing = input.file < 0 ? (int)sizeof input.block : semihost(READ, &wanted);
        if (missing < 0 || missing >= (int)sizeof input.block) return -1;
        input.left = sizeof input.block - (unsigned)missing;
        input.next = input.block;
    }
    input.left--;
    return *input.next++;
}

int putchar(int letter) {
    const char byte = (char)letter;
    semihost(WRITE_LETTER, &byte);
    return letter;
}
