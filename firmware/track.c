/* A recording through a filter that `accelcal export --filter c -o tracker` wrote: on a computer, and on a board in QEMU
 * with board.c beside it. Standard input is a CSV with a header: time, output, position; of the last two either may be
 * empty. It prints the estimates after the last row, and a digest of their bits after every row, and ends with 1 where
 * there was no row, an argument was refused, or the filter is lost to numbers that no sensor gives. */
#include <stdint.h>

#include "tracker.h"

int getchar(void);
int putchar(int letter);

/* The number up to the next comma or the end of the line, with the same bits on every machine; 0 where there is none. */
static int number(double *value, int *end) {
    uint64_t digits = 0;
    int scale = 0, negative = 0, point = 0, found = 0;
    int letter = getchar();
    for (; letter == '-' || letter == '.' || (letter >= '0' && letter <= '9'); letter = getchar()) {
        if (letter == '-') {
            negative = 1;
        } else if (letter == '.') {
            point = 1;
        } else if (digits < 1000000000000000000u) {
            digits = 10 * digits + (uint64_t)(letter - '0');
            scale -= point;
            found = 1;
        } else {
            scale += !point;
        }
    }
    if (letter == 'e' || letter == 'E') {
        int power = 0;
        const int less = (letter = getchar()) == '-';
        if (less || letter == '+') letter = getchar();
        for (; letter >= '0' && letter <= '9'; letter = getchar()) power = 10 * power + letter - '0';
        scale += less ? -power : power;
    }
    *value = (double)digits;
    for (; scale < 0; scale++) *value /= 10.0;
    for (; scale > 0; scale--) *value *= 10.0;
    if (negative) *value = -*value;
    while (letter != ',' && letter != '\n' && letter >= 0) letter = getchar();
    *end = letter;
    return found;
}

static void text(const char *letters) {
    while (*letters) putchar(*letters++);
}

/* Seven digits and a power of ten. */
static void scientific(double value) {
    int power = 0;
    text(value < 0.0 ? "-" : " ");
    if (value < 0.0) value = -value;
    if (!(value <= 1e300)) {
        text("not finite");
        return;
    }
    for (; value >= 10.0; power++) value /= 10.0;
    for (; value > 0.0 && value < 1.0; power--) value *= 10.0;
    value += value > 0.0 ? 5e-7 : 0.0;
    if (value >= 10.0) {
        value = 1.0;
        power++;
    }
    for (int place = 0; place < 7; place++) {
        const int digit = (int)value;
        putchar('0' + digit);
        if (place == 0) putchar('.');
        value = 10.0 * (value - digit);
    }
    text(power < 0 ? "e-" : "e+");
    if (power < 0) power = -power;
    putchar('0' + power / 10 % 10);
    putchar('0' + power % 10);
}

/* FNV-1a over the bits of an estimate. */
static uint32_t digested(uint32_t digest, float estimate) {
    union { float number; uint32_t bits; } x;
    x.number = estimate;
    for (int shift = 0; shift < 32; shift += 8) digest = (digest ^ (x.bits >> shift & 255u)) * 16777619u;
    return digest;
}

/* Outputs in a row for which the one before them stands; behind more the motion begins anew, with both readings. */
enum { HELD = 8 };

int main(void) {
    tracker_filter filter;
    uint32_t digest = 2166136261u, missed = 0;
    float held = 0.0f;
    int rows = 0, refused = 0, end;
    while ((end = getchar()) != '\n' && end >= 0) {
    }
    while (end >= 0) {
        double t, output, position;
        const int row = number(&t, &end);
        const int given = end == ',' && number(&output, &end);
        const int read = end == ',' && number(&position, &end);
        while (end == ',') number(&t, &end); /* further columns */
        if (!row) continue; /* an empty line */
        missed += !given;
        if ((rows == 0 || missed > HELD) && !(given && read)) {
            missed += given; /* an output in the gap */
            continue;
        }
        if (rows++ == 0) {
            tracker_init(&filter, (float)position);
        } else if (missed > HELD && tracker_resume(&filter, (float)position, missed - HELD) != 0) {
            refused++; /* beyond the numbers of the filter: the gap goes on */
            missed++;
            continue;
        }
        missed = given ? 0 : missed;
        held = given ? (float)output : held;
        refused += tracker_step(&filter, held, read ? (float)position : __builtin_nanf(""));
        for (unsigned i = 0; i < TRACKER_PARAMETERS; i++) digest = digested(digest, tracker_estimate(&filter, i));
    }
    if (rows == 0) return 1;
    text("parameter estimate      variance\n");
    for (unsigned i = 0; i < TRACKER_PARAMETERS; i++) {
        putchar('0' + (int)(i / 10));
        putchar('0' + (int)(i % 10));
        text("       ");
        scientific((double)tracker_estimate(&filter, i));
        text("  ");
        scientific((double)tracker_variance(&filter, i));
        putchar('\n');
    }
    text("bits after every row: ");
    for (int shift = 28; shift >= 0; shift -= 4) putchar("0123456789abcdef"[digest >> shift & 15u]);
    putchar('\n');
    return refused != 0 || !tracker_finite(&filter);
}
