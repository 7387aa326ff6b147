/* A patch of electronic skin that speaks the eskin device protocol, versions 1 and 2.
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
#define ESKIN_SEAL_BYTES 24 /* Session, counter and tag, before the CRC. */
#define ESKIN_KEY_BYTES 32
/* A packet as a COBS frame with its closing zero. */
#define ESKIN_FRAME_BYTES (ESKIN_PACKET_BYTES + ESKIN_PACKET_BYTES / 254 + 2)

typedef struct {
    uint8_t packet[ESKIN_PACKET_BYTES];
    uint8_t frame[ESKIN_FRAME_BYTES];
} eskin_buffer;

/* What version 2 keeps of its host; power-up sets all of it to zero. */
typedef struct {
    uint8_t challenge[16];
    uint8_t line[64];       /* of a frame that arrives byte by byte */
    uint8_t used;           /* bytes in it; 255: too long */
    uint8_t open;           /* whether a host sends requests */
    uint32_t number, heard; /* of the latest request, and when it arrived */
    uint64_t counter;       /* sealed packets since power-up */
} eskin_session;

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
    uint8_t version;          /* 2; 0 and 1 are version 1, without what follows */
    const uint8_t *key;       /* 32 bytes that seal packets, or NULL for no seals */
    eskin_session session;    /* not yours */
} eskin_patch;

/* Send: hello at power-up and once a second, every scan, status once a second. */
void eskin_send_hello(eskin_patch *patch);
void eskin_send_scan(eskin_patch *patch);
void eskin_send_status(eskin_patch *patch);

/* Version 2: give it what arrives, as soon as it does: a datagram, or every byte of a
   line. A request is answered by `write`. Do not call it while another call sends. */
void eskin_receive(eskin_patch *patch, const uint8_t *packet, size_t length);
void eskin_receive_byte(eskin_patch *patch, uint8_t byte);

/* What these are made of. A packet's length is returned, `frame` without the packet. */
size_t eskin_hello(const eskin_patch *patch, uint32_t time, uint8_t *packet);
size_t eskin_status(const eskin_patch *patch, uint32_t time, uint8_t *packet);
size_t eskin_data(const eskin_patch *patch, uint32_t time, uint16_t first,
                  uint16_t count, uint8_t *packet); /* reads these cells */
size_t eskin_frame(const uint8_t *packet, size_t length, uint8_t *frame);
size_t eskin_echo(const eskin_patch *patch, uint32_t time, uint32_t held,
                  uint8_t *packet); /* answers the latest request */
size_t eskin_seal(eskin_patch *patch, uint8_t *packet, size_t length); /* in place */
uint32_t eskin_crc32(const uint8_t *bytes, size_t length);
/* RFC 7693, with a key of up to 32 bytes and a digest of 1 to 32. */
void eskin_blake2s(const uint8_t *key, size_t key_length, const uint8_t *bytes,
                   size_t length, uint8_t *digest, size_t digest_length);

#endif
