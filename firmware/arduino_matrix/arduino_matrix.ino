// Sends an 8 x 6 matrix as lines, with eskin_matrix.h and .c beside this sketch.
extern "C" {
#include "eskin_matrix.h"
}
static uint16_t read_cell(void *, uint8_t row, uint8_t column) {
    for (uint8_t r = 0; r < 8; r++) digitalWrite(2 + r, r == row);
    delayMicroseconds(20);
    return analogRead(A0 + column);
}
static uint32_t read_time(void *) { return micros(); }
static void put(void *, char c) { Serial.write(c); }
static const eskin_matrix matrix = {8, 6, read_cell, read_time, put, nullptr, 0};
void setup() {
    Serial.begin(115200);
    for (uint8_t r = 0; r < 8; r++) pinMode(2 + r, OUTPUT);
}
void loop() { eskin_matrix_send_line(&matrix); }
