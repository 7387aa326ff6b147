/* A patch of 2 x 3 taxels on a line whose clock is set from stdin, for
   tests/test_firmware.py. "t MICROSECONDS" sets its clock, "h" and "s" send a hello and
   a scan, "r HEX" are bytes from the host. After each line the packets that it wrote
   stand on one line of stdout. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "eskin_patch.h"

static uint32_t now;
static eskin_buffer buffer;

static uint16_t read_cell(uint16_t row, uint16_t column) {
    return (uint16_t)(3 * row + column);
}

static uint32_t microseconds(void) { return now; }

static void write_out(const uint8_t *bytes, size_t length) {
    for (size_t i = 0; i < length; i++) printf("%02x", bytes[i]);
}

int main(int argc, char **argv) {
    char kind;
    uint8_t key[32];
    eskin_patch patch = {0};
    for (int i = 0; i < 32; i++) key[i] = (uint8_t)i;
    patch.rows = 2;
    patch.columns = 3;
    patch.taxels = 6;
    patch.rate = 50;
    patch.serial_number = 77;
    patch.firmware = "test";
    patch.read_cell = read_cell;
    patch.microseconds = microseconds;
    patch.write = write_out;
    patch.buffer = &buffer;
    patch.version = 2;
    patch.key = argc > 1 && argv ? key : NULL;
    while (scanf(" %c", &kind) == 1) {
        unsigned value;
        if (kind == 't' && scanf("%" SCNu32, &now) != 1) return 3;
        if (kind == 'h') eskin_send_hello(&patch);
        if (kind == 's') eskin_send_scan(&patch);
        while (kind == 'r' && scanf("%2x", &value) == 1) {
            eskin_receive_byte(&patch, (uint8_t)value);
            int next = getchar();
            if (next == '\n') break;
            ungetc(next, stdin);
        }
        putchar('\n');
        fflush(stdout);
    }
    return 0;
}
