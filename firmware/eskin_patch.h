/* A patch of electronic skin that speaks the eskin device protocol, version 1.
   See docs/protocol.md. Portable C99: no heap, no operating system, no endianness. */
#ifndef ESKIN_PATCH_H
#define ESKIN_PATCH_H

#include <stddef.h>
#include <stdint.h>

#ifndef ESKIN_PACKET_BYTES
#define ESKIN_PACKET_BYTES 1400 /* Less where memory is short: 286 hold every hello. */
#endif
#if ESKIN_PACKET_BYTES < 286 || ESKIN_PACKET_BYTES > 1400
#error "ESKIN_PACKET_BYTES is allowed from 286 to 1400"
#endif
#define ESKIN_MOST_COUNTS ((ESKIN_PACKET_BYTES - 18) / 2)
/* A packet as a COBS frame with its closing zero. */
#define ESKIN_FRAME_BYTES (ESKIN_PACKET_BYTES + ESKIN_PACKET_BYTES / 254 + 2)

typedef struct {
    uint8_t packet[ESKIN_PACKET_BYTES];
    uint8_t frame[ESKIN_FRAME_BYTES];
} eskin_buffer;

/* One patch. Set all of it to zero first, then what differs. */
typedef struct {
    uint16_t address, rows, columns, taxels;
    uint16_t rate;          /* scans a second that are meant, or 0 */
    uint64_t serial_number; /* of this module; no other has it */
    const char *firmware;   /* name and version, UTF-8; 255 bytes are sent at most */
    const uint16_t *cells;  /* row * columns + column of each taxel; NULL: every cell */
    uint16_t (*read_cell)(uint16_t row, uint16_t column);
    uint32_t (*microseconds)(void); /* runs freely, may wrap */
    void (*write)(const uint8_t *bytes, size_t length); /* a frame or datagram a call */
    int datagrams;            /* 0: COBS and a zero, for serial; 1: as it is, for UDP */
    eskin_buffer *buffer;     /* patches that send in turn may share one */
    uint16_t scan;            /* number of the latest */
    uint32_t skipped, errors; /* since power-up; yours to count */
    int16_t temperature;      /* [0.01 degrees Celsius]; -32768 where not measured */
} eskin_patch;

/* Send: hello at power-up and once a second, every scan, status once a second. */
void eskin_send_hello(eskin_patch *patch);
void eskin_send_scan(eskin_patch *patch);
void eskin_send_status(eskin_patch *patch);

/* What these are made of. A packet's length is returned, `frame` without the packet. */
size_t eskin_hello(const eskin_patch *patch, uint32_t time, uint8_t *packet);
size_t eskin_status(const eskin_patch *patch, uint32_t time, uint8_t *packet);
size_t eskin_data(const eskin_patch *patch, uint32_t time, uint16_t first,
                  uint16_t count, uint8_t *packet); /* reads these cells */
size_t eskin_frame(const uint8_t *packet, size_t length, uint8_t *frame);
uint32_t eskin_crc32(const uint8_t *bytes, size_t length);

#endif
