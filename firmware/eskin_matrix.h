/* Sends the scans of a row-column matrix as lines of numbers, for `eskin run --source
 * csv:PATH`. Portable C99; nothing of the C library but the fixed-width integers.
 *
 * A matrix of velostat between rows and columns of copper: drive one row at a time high
 * and the others low, and convert the voltage of each column at its resistor to ground.
 */
#ifndef ESKIN_MATRIX_H
#define ESKIN_MATRIX_H

#include <stdint.h>

typedef struct eskin_matrix {
    uint8_t rows;
    uint8_t columns;
    /* Drives a row, lets it settle, and converts a column: 0 to 65,535 counts. */
    uint16_t (*read_cell)(void *context, uint8_t row, uint8_t column);
    /* Microseconds since power-up; it may wrap. */
    uint32_t (*read_time)(void *context);
    /* Writes one character to the serial port; it waits until there is room. */
    void (*write)(void *context, char character);
    void *context;
    /* 1 sends the counts alone, without time and checksum. */
    uint8_t bare;
} eskin_matrix;

/* Scans the matrix row by row and sends one line: `@TIME,COUNT,...,COUNT*CHECKSUM`. */
void eskin_matrix_send_line(const eskin_matrix *matrix);

#endif
