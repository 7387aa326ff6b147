/* Makes packets of what stands on stdin, one a line, and prints each in hex, alone and
   framed, for tests/test_firmware.py. A line "v VERSION COUNTER KEY CHALLENGE", the last
   two in hex or "-", holds for the next packet; a line "b KEY BYTES" prints the BLAKE2s
   of some bytes. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "eskin_patch.h"

static uint16_t counts[65536 + ESKIN_MOST_COUNTS];
static eskin_buffer buffer;

static uint16_t read_cell(uint16_t row, uint16_t column) {
    return counts[row + column];
}

static void need(int ok) {
    if (!ok) exit(3);
}

static void print_hex(const uint8_t *bytes, size_t length, char end) {
    for (size_t i = 0; i < length; i++) printf("%02x", bytes[i]);
    putchar(end);
}

static size_t read_hex(uint8_t *bytes, size_t most) {
    char text[1201];
    size_t length = 0;
    need(scanf("%1200s", text) == 1);
    for (const char *at = text; *at != '-' && *at; at += 2) {
        unsigned value;
        need(length < most && sscanf(at, "%2x", &value) == 1);
        bytes[length++] = (uint8_t)value;
    }
    return length;
}

static void print_digest(void) {
    uint8_t key[32], bytes[600], digest[32];
    size_t keyed = read_hex(key, sizeof key), length = read_hex(bytes, sizeof bytes);
    eskin_blake2s(key, keyed, bytes, length, digest, sizeof digest);
    print_hex(digest, sizeof digest, '\n');
}

static void read_session(eskin_patch *patch) {
    static uint8_t key[32];
    need(scanf("%" SCNu8 " %" SCNu64, &patch->version, &patch->session.counter) == 2);
    patch->key = read_hex(key, sizeof key) ? key : NULL;
    patch->session.open = read_hex(patch->session.challenge, 16) > 0;
}

int main(void) {
    char kind, text[600];
    unsigned address, scan, a, b, c, d;
    uint32_t time;
    while (scanf(" %c", &kind) == 1) {
        eskin_patch patch = {0};
        size_t length;
        if (kind == 'b') {
            print_digest();
            continue;
        }
        if (kind == 'v') {
            read_session(&patch);
            need(scanf(" %c", &kind) == 1);
        }
        need(scanf("%u %u %" SCNu32, &address, &scan, &time) == 3);
        patch.address = (uint16_t)address;
        patch.scan = (uint16_t)scan;
        if (kind == 'h') {
            need(scanf("%u %u %u %u", &a, &b, &c, &d) == 4);
            need(scanf("%" SCNx64, &patch.serial_number) == 1);
            text[0] = 0;
            patch.rows = (uint16_t)a;
            patch.columns = (uint16_t)b;
            patch.taxels = (uint16_t)c;
            patch.rate = (uint16_t)d;
            need(scanf(" [%599[^]]", text) >= 0);
            patch.firmware = text;
            need(getchar() == ']');
            length = eskin_hello(&patch, time, buffer.packet);
        } else if (kind == 's') {
            int temperature;
            need(scanf("%" SCNu32 " %" SCNu32 " %d", &patch.skipped, &patch.errors,
                       &temperature) == 3);
            patch.temperature = (int16_t)temperature;
            length = eskin_status(&patch, time, buffer.packet);
        } else if (kind == 'e') {
            uint32_t held;
            need(scanf("%" SCNu32, &patch.session.number) == 1);
            need(read_hex(patch.session.challenge, 16) == 16);
            need(scanf("%" SCNu32, &held) == 1);
            length = eskin_echo(&patch, time, held, buffer.packet);
        } else {
            need(scanf("%u %u", &a, &b) == 2);
            for (unsigned i = 0; i < b; i++) {
                need(scanf("%" SCNu16, &counts[a + i]) == 1);
            }
            patch.columns = 1; /* Every row is one cell, so the row is the taxel. */
            patch.read_cell = read_cell;
            length = eskin_data(&patch, time, (uint16_t)a, (uint16_t)b, buffer.packet);
        }
        if (patch.key) length = eskin_seal(&patch, buffer.packet, length);
        print_hex(buffer.packet, length, ' ');
        length = eskin_frame(buffer.packet, length, buffer.frame);
        print_hex(buffer.frame, length, '\n');
    }
    return 0;
}
