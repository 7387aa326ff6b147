#include "eskin_matrix.h"

#define DIGITS 10 /* of the largest number of 32 bits */

typedef struct line {
    const eskin_matrix *matrix;
    uint8_t checksum;
} line;

static void put(line *line, char character)
{
    line->checksum ^= (uint8_t)character;
    line->matrix->write(line->matrix->context, character);
}

static void put_number(line *line, uint32_t number)
{
    char digits[DIGITS];
    uint8_t count = 0;
    do {
        digits[count++] = (char)('0' + number % 10);
        number /= 10;
    } while (number);
    while (count)
        put(line, digits[--count]);
}

void eskin_matrix_send_line(const eskin_matrix *matrix)
{
    static const char hexadecimal[] = "0123456789ABCDEF";
    line line = {matrix, 0};
    uint8_t row, column, checksum;
    if (!matrix->bare) {
        put(&line, '@');
        put_number(&line, matrix->read_time(matrix->context));
    }
    for (row = 0; row < matrix->rows; row++) {
        for (column = 0; column < matrix->columns; column++) {
            if (row || column || !matrix->bare)
                put(&line, ',');
            put_number(&line, matrix->read_cell(matrix->context, row, column));
        }
    }
    if (!matrix->bare) {
        checksum = line.checksum;
        put(&line, '*');
        put(&line, hexadecimal[checksum >> 4]);
        put(&line, hexadecimal[checksum & 15]);
    }
    put(&line, '\n');
}
