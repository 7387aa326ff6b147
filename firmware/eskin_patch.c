#include "eskin_patch.h"

#include <string.h>

enum { VERSION = 1, HELLO = 1, DATA = 2, STATUS = 3, MOST_TEXT = 255, RUN = 254 };

static uint8_t *put(uint8_t *at, uint32_t value, int bytes) {
    while (bytes-- > 0) {
        *at++ = (uint8_t)(value & 0xFF);
        value >>= 8;
    }
    return at;
}

static uint8_t *header(const eskin_patch *patch, uint8_t kind, uint32_t time,
                       uint8_t *at) {
    at = put(at, VERSION, 1);
    at = put(at, kind, 1);
    at = put(at, patch->address, 2);
    at = put(at, patch->scan, 2);
    return put(at, time, 4);
}

static size_t seal(uint8_t *packet, uint8_t *end) {
    end = put(end, eskin_crc32(packet, (size_t)(end - packet)), 4);
    return (size_t)(end - packet);
}

uint32_t eskin_crc32(const uint8_t *bytes, size_t length) {
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
        0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C};
    uint32_t crc = 0xFFFFFFFF;
    while (length-- > 0) {
        crc ^= *bytes++;
        crc = (crc >> 4) ^ table[crc & 15];
        crc = (crc >> 4) ^ table[crc & 15];
    }
    return crc ^ 0xFFFFFFFF;
}

size_t eskin_hello(const eskin_patch *patch, uint32_t time, uint8_t *packet) {
    uint8_t *at = header(patch, HELLO, time, packet);
    size_t length = patch->firmware ? strlen(patch->firmware) : 0;
    if (length > MOST_TEXT) { /* Cut before a character, not inside it. */
        length = MOST_TEXT;
        while ((patch->firmware[length] & 0xC0) == 0x80) length--;
    }
    at = put(at, patch->rows, 2);
    at = put(at, patch->columns, 2);
    at = put(at, patch->taxels, 2);
    at = put(at, patch->rate, 2);
    at = put(at, (uint32_t)patch->serial_number, 4);
    at = put(at, (uint32_t)(patch->serial_number >> 32), 4);
    at = put(at, (uint32_t)length, 1);
    if (length > 0) memcpy(at, patch->firmware, length);
    return seal(packet, at + length);
}

size_t eskin_status(const eskin_patch *patch, uint32_t time, uint8_t *packet) {
    uint8_t *at = header(patch, STATUS, time, packet);
    at = put(at, patch->skipped, 4);
    at = put(at, patch->errors, 4);
    at = put(at, (uint16_t)patch->temperature, 2);
    return seal(packet, at);
}

size_t eskin_data(const eskin_patch *patch, uint32_t time, uint16_t first,
                  uint16_t count, uint8_t *packet) {
    uint8_t *at = header(patch, DATA, time, packet);
    at = put(at, first, 2);
    at = put(at, count, 2);
    for (uint32_t taxel = first; taxel < (uint32_t)first + count; taxel++) {
        uint32_t cell = patch->cells ? patch->cells[taxel] : taxel;
        uint16_t row = (uint16_t)(cell / patch->columns);
        at = put(at, patch->read_cell(row, (uint16_t)(cell % patch->columns)), 2);
    }
    return seal(packet, at);
}

size_t eskin_frame(const uint8_t *packet, size_t length, uint8_t *frame) {
    uint8_t *code = frame, *at = frame + 1; /* Where the run's length will stand. */
    for (size_t i = 0; i < length; i++) {
        if (packet[i] != 0) *at++ = packet[i];
        if (packet[i] == 0 || (at - code == RUN + 1 && i + 1 < length)) {
            *code = (uint8_t)(at - code);
            code = at++;
        }
    }
    *code = (uint8_t)(at - code);
    *at++ = 0;
    return (size_t)(at - frame);
}

static void send(eskin_patch *patch, size_t length) {
    eskin_buffer *buffer = patch->buffer;
    if (patch->datagrams) {
        patch->write(buffer->packet, length);
    } else {
        patch->write(buffer->frame, eskin_frame(buffer->packet, length, buffer->frame));
    }
}

void eskin_send_hello(eskin_patch *patch) {
    send(patch, eskin_hello(patch, patch->microseconds(), patch->buffer->packet));
}

void eskin_send_status(eskin_patch *patch) {
    send(patch, eskin_status(patch, patch->microseconds(), patch->buffer->packet));
}

void eskin_send_scan(eskin_patch *patch) {
    uint8_t *packet = patch->buffer->packet;
    uint32_t time = patch->microseconds(), taxels = patch->taxels;
    patch->scan++;
    for (uint32_t first = 0; first < taxels; first += ESKIN_MOST_COUNTS) {
        uint32_t count = taxels - first;
        if (count > ESKIN_MOST_COUNTS) count = ESKIN_MOST_COUNTS;
        send(patch, eskin_data(patch, time, (uint16_t)first, (uint16_t)count, packet));
    }
}
