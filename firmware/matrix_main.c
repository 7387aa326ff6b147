/* Sends the scans of a matrix that is simulated elsewhere: `matrix_main ROWS COLUMNS
 * [bare]` reads, for each scan, the time and the counts from its input, row by row.
 */
#include "eskin_matrix.h"

#include <stdio.h>
#include <stdlib.h>

#define MAX_CELLS 4096

typedef struct simulated {
    unsigned time;
    unsigned columns;
    unsigned counts[MAX_CELLS];
} simulated;

static uint16_t read_cell(void *context, uint8_t row, uint8_t column)
{
    const simulated *matrix = context;
    return (uint16_t)matrix->counts[row * matrix->columns + column];
}

static uint32_t read_time(void *context)
{
    return ((const simulated *)context)->time;
}

static void write_character(void *context, char character)
{
    (void)context;
    putchar(character);
}

int main(int argc, char **argv)
{
    static simulated state;
    eskin_matrix matrix = {0, 0, read_cell, read_time, write_character, &state, 0};
    unsigned cell, cells;
    if (argc < 3)
        return 2;
    matrix.rows = (uint8_t)atoi(argv[1]);
    matrix.columns = (uint8_t)atoi(argv[2]);
    matrix.bare = argc > 3;
    state.columns = matrix.columns;
    cells = (unsigned)matrix.rows * matrix.columns;
    if (cells > MAX_CELLS)
        return 2;
    while (scanf("%u", &state.time) == 1) {
        for (cell = 0; cell < cells; cell++)
            if (scanf("%u", &state.counts[cell]) != 1)
                return 1;
        eskin_matrix_send_line(&matrix);
        fflush(stdout);
    }
    return 0;
}
