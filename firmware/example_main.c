/* Scans a fake matrix and prints what a patch would send, framed for a serial line.

   cc -std=c99 example_main.c eskin_patch.c -o example
   ./example [SCANS] > frames.bin */
#include "eskin_patch.h"

#include <stdio.h>
#include <stdlib.h>

enum { ROWS = 30, COLUMNS = 40, CUT = 3 }; /* Its corners hold no taxels. */

static uint32_t now;
static eskin_buffer buffer;
static uint16_t cells[ROWS * COLUMNS];

static uint16_t read_cell(uint16_t row, uint16_t column) {
    return (uint16_t)((row * 100u + column + now / 20000u) % 4096u);
}

static uint32_t microseconds(void) { return now; }

static void write_out(const uint8_t *bytes, size_t length) {
    if (fwrite(bytes, 1, length, stdout) != length) exit(1);
}

static uint16_t list_cells(void) {
    uint16_t taxels = 0;
    for (uint16_t row = 0; row < ROWS; row++) {
        for (uint16_t column = 0; column < COLUMNS; column++) {
            int edge = row < CUT || row >= ROWS - CUT;
            if (edge && (column < CUT || column >= COLUMNS - CUT)) continue;
            cells[taxels++] = (uint16_t)(row * COLUMNS + column);
        }
    }
    return taxels;
}

int main(int argc, char **argv) {
    int scans = argc > 1 ? atoi(argv[1]) : 100;
    eskin_patch patch = {0};
    patch.address = 4;
    patch.rows = ROWS;
    patch.columns = COLUMNS;
    patch.taxels = list_cells();
    patch.rate = 50;
    patch.serial_number = 0x1122334455667788;
    patch.firmware = "example 1.0";
    patch.cells = cells;
    patch.read_cell = read_cell;
    patch.microseconds = microseconds;
    patch.write = write_out;
    patch.buffer = &buffer;
    patch.temperature = -32768;
    for (int i = 0; i < scans; i++, now += 20000) {
        if (i % patch.rate == 0) eskin_send_hello(&patch);
        eskin_send_scan(&patch);
        if (i % patch.rate == 0) eskin_send_status(&patch);
    }
    return 0;
}
