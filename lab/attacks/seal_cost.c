/* Times the sender of firmware/: a framed data packet without and with a seal. */
#include <stdio.h>
#include <time.h>

#include "eskin_patch.h"

enum { REPEATS = 20000, ROUNDS = 7 };

static eskin_buffer buffer;
static volatile uint8_t sink;

static uint16_t read_cell(uint16_t row, uint16_t column) {
    return (uint16_t)(row * 7 + column);
}

static double measure(eskin_patch *patch, uint16_t counts, size_t *bytes) {
    double best = 1e9;
    for (int round = 0; round < ROUNDS; round++) {
        clock_t start = clock();
        for (int i = 0; i < REPEATS; i++) {
            *bytes = eskin_data(patch, (uint32_t)i, 0, counts, buffer.packet);
            if (patch->key) *bytes = eskin_seal(patch, buffer.packet, *bytes);
            eskin_frame(buffer.packet, *bytes, buffer.frame);
            sink = buffer.frame[*bytes / 2];
        }
        double us = 1e6 * (double)(clock() - start) / CLOCKS_PER_SEC / REPEATS;
        if (us < best) best = us;
    }
    return best;
}

int main(void) {
    static const uint16_t sizes[] = {32, 128, 679};
    static const uint8_t key[ESKIN_KEY_BYTES] = {1};
    for (int i = 0; i < 3; i++) {
        eskin_patch patch = {0};
        size_t plain_bytes, sealed_bytes;
        patch.columns = 40;
        patch.version = 2;
        patch.read_cell = read_cell;
        patch.buffer = &buffer;
        double plain = measure(&patch, sizes[i], &plain_bytes);
        patch.key = key;
        patch.session.open = 1;
        double sealed = measure(&patch, sizes[i], &sealed_bytes);
        printf("{\"counts\": %u, \"bytes\": %u, \"plain_us\": %.3f, "
               "\"sealed_us\": %.3f}\n",
               sizes[i], (unsigned)plain_bytes, plain, sealed);
    }
    return 0;
}
