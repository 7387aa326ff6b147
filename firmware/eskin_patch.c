#include "eskin_patch.h"

#include <string.h>

enum { HELLO = 1, DATA = 2, STATUS = 3, REQUEST = 4, ECHO = 5, SEALED = 0x80 };
enum { MOST_TEXT = 255, RUN = 254, CHALLENGE = 16, TAG = 16, CRC = 4, BLOCK = 64 };
enum { FIXED_HELLO = 31, REQUEST_BYTES = 34, TOO_LONG = 255 };
#define SESSION_TIMEOUT 2000000u /* [us] without requests until a session is over */

static const uint8_t no_challenge[CHALLENGE];

static uint8_t *put(uint8_t *at, uint32_t value, int bytes) {
    while (bytes-- > 0) {
        *at++ = (uint8_t)(value & 0xFF);
        value >>= 8;
    }
    return at;
}

static uint32_t get(const uint8_t *at, int bytes) {
    uint32_t value = 0;
    while (bytes-- > 0) value = value << 8 | at[bytes];
    return value;
}

static uint8_t *header(const eskin_patch *patch, uint8_t kind, uint32_t time,
                       uint8_t *at) {
    at = put(at, patch->version == 2 ? 2 : 1, 1);
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
    size_t room = ESKIN_PACKET_BYTES - FIXED_HELLO - (patch->key ? ESKIN_SEAL_BYTES : 0);
    size_t most = room < MOST_TEXT ? room : MOST_TEXT;
    if (length > most) { /* Cut before a character, not inside it. */
        length = most;
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

/* Keyed BLAKE2s, RFC 7693: the state, and bytes that wait for a full block. */
typedef struct {
    uint32_t h[8], count;
    uint8_t block[BLOCK];
    size_t used;
} blake;

static const uint32_t blake_iv[8] = {0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A,
                                     0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19};

static uint32_t turn(uint32_t word, int bits) {
    return word >> bits | word << (32 - bits);
}

static void mix(uint32_t *v, const uint8_t *place, uint32_t x, uint32_t y) {
    uint32_t *a = v + place[0], *b = v + place[1], *c = v + place[2], *d = v + place[3];
    *a += *b + x;
    *d = turn(*d ^ *a, 16);
    *c += *d;
    *b = turn(*b ^ *c, 12);
    *a += *b + y;
    *d = turn(*d ^ *a, 8);
    *c += *d;
    *b = turn(*b ^ *c, 7);
}

static void compress(blake *state, uint32_t last) {
    static const uint8_t order[10][16] = {
        {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
        {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
        {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
        {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
        {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
        {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
        {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
        {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
        {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
        {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};
    static const uint8_t places[8][4] = {{0, 4, 8, 12}, {1, 5, 9, 13}, {2, 6, 10, 14},
                                         {3, 7, 11, 15}, {0, 5, 10, 15}, {1, 6, 11, 12},
                                         {2, 7, 8, 13}, {3, 4, 9, 14}};
    uint32_t v[16], m[16];
    for (int i = 0; i < 16; i++) m[i] = get(state->block + 4 * i, 4);
    for (int i = 0; i < 8; i++) v[i] = state->h[i], v[i + 8] = blake_iv[i];
    v[12] ^= state->count; /* Less than 4 GB, so its upper half is zero. */
    v[14] ^= last;
    for (int round = 0; round < 10; round++) {
        for (int i = 0; i < 8; i++) {
            mix(v, places[i], m[order[round][2 * i]], m[order[round][2 * i + 1]]);
        }
    }
    for (int i = 0; i < 8; i++) state->h[i] ^= v[i] ^ v[i + 8];
}

static void blake_add(blake *state, const uint8_t *bytes, size_t length) {
    while (length > 0) {
        if (state->used == BLOCK) { /* The last block must wait for the end. */
            state->count += BLOCK;
            compress(state, 0);
            state->used = 0;
        }
        size_t part = BLOCK - state->used < length ? BLOCK - state->used : length;
        memcpy(state->block + state->used, bytes, part);
        state->used += part;
        bytes += part;
        length -= part;
    }
}

static void blake_start(blake *state, const uint8_t *key, size_t key_length,
                        size_t digest_length) {
    memset(state, 0, sizeof *state);
    memcpy(state->h, blake_iv, sizeof blake_iv);
    state->h[0] ^= 0x01010000 ^ (uint32_t)key_length << 8 ^ (uint32_t)digest_length;
    if (key_length > 0) {
        blake_add(state, key, key_length);
        state->used = BLOCK;
    }
}

static void blake_end(blake *state, uint8_t *digest, size_t digest_length) {
    state->count += (uint32_t)state->used;
    memset(state->block + state->used, 0, BLOCK - state->used);
    compress(state, 0xFFFFFFFF);
    for (size_t i = 0; i < digest_length; i++) {
        digest[i] = (uint8_t)(state->h[i / 4] >> 8 * (i % 4));
    }
}

void eskin_blake2s(const uint8_t *key, size_t key_length, const uint8_t *bytes,
                   size_t length, uint8_t *digest, size_t digest_length) {
    blake state;
    blake_start(&state, key, key_length, digest_length);
    blake_add(&state, bytes, length);
    blake_end(&state, digest, digest_length);
}

static void make_tag(const eskin_patch *patch, const uint8_t *challenge,
                     const uint8_t *packet, size_t length, uint8_t *tag) {
    blake state;
    blake_start(&state, patch->key, ESKIN_KEY_BYTES, TAG);
    blake_add(&state, challenge, CHALLENGE);
    blake_add(&state, packet, length);
    blake_end(&state, tag, TAG);
}

size_t eskin_seal(eskin_patch *patch, uint8_t *packet, size_t length) {
    eskin_session *session = &patch->session;
    const uint8_t *challenge = session->open ? session->challenge : no_challenge;
    uint8_t *at = packet + length - CRC;
    packet[1] |= SEALED;
    at = put(at, get(challenge, 2), 2);
    at = put(at, (uint32_t)session->counter, 4);
    at = put(at, (uint32_t)(session->counter >> 32), 2);
    session->counter++;
    make_tag(patch, challenge, packet, (size_t)(at - packet), at);
    return seal(packet, at + TAG);
}

static int is_keyed(const eskin_patch *patch) {
    return patch->version == 2 && patch->key;
}

/* Whether it may send more than hellos: with a key only while a host sends requests. */
static int may_send(eskin_patch *patch, uint32_t time) {
    eskin_session *session = &patch->session;
    if (time - session->heard > SESSION_TIMEOUT) session->open = 0;
    return session->open || !is_keyed(patch);
}

static void send(eskin_patch *patch, size_t length) {
    eskin_buffer *buffer = patch->buffer;
    if (is_keyed(patch)) length = eskin_seal(patch, buffer->packet, length);
    if (patch->datagrams) {
        patch->write(buffer->packet, length);
    } else {
        patch->write(buffer->frame, eskin_frame(buffer->packet, length, buffer->frame));
    }
}

void eskin_send_hello(eskin_patch *patch) {
    uint32_t time = patch->microseconds();
    may_send(patch, time);
    send(patch, eskin_hello(patch, time, patch->buffer->packet));
}

void eskin_send_status(eskin_patch *patch) {
    uint32_t time = patch->microseconds();
    if (!may_send(patch, time)) return;
    send(patch, eskin_status(patch, time, patch->buffer->packet));
}

void eskin_send_scan(eskin_patch *patch) {
    uint8_t *packet = patch->buffer->packet;
    uint32_t time = patch->microseconds(), taxels = patch->taxels;
    uint32_t most = ESKIN_MOST_COUNTS - (is_keyed(patch) ? ESKIN_SEAL_BYTES / 2 : 0);
    patch->scan++;
    if (!may_send(patch, time)) return;
    for (uint32_t first = 0; first < taxels; first += most) {
        uint32_t count = taxels - first < most ? taxels - first : most;
        send(patch, eskin_data(patch, time, (uint16_t)first, (uint16_t)count, packet));
    }
}

size_t eskin_echo(const eskin_patch *patch, uint32_t time, uint32_t held,
                  uint8_t *packet) {
    uint8_t *at = header(patch, ECHO, time, packet);
    at = put(at, patch->session.number, 4);
    memcpy(at, patch->session.challenge, CHALLENGE);
    return seal(packet, put(at + CHALLENGE, held, 4));
}

/* Whether a request with a seal is authentic and new. Only one with the number 0 opens
   a session, and none while the present one goes on: it may be a recorded one. */
static int admit(const eskin_patch *patch, const uint8_t *packet) {
    const eskin_session *session = &patch->session;
    const uint8_t *challenge = packet + 14, *at = packet + 30;
    uint32_t number = get(packet + 10, 4);
    uint8_t tag[TAG], differs = 0;
    int same = session->open && memcmp(challenge, session->challenge, CHALLENGE) == 0;
    if (!same && (session->open || number != 0)) return 0;
    if (same && session->number > 0 && number <= session->number) return 0;
    if (get(at, 2) != get(challenge, 2) || get(at, 2) == 0) return 0;
    make_tag(patch, challenge, packet, (size_t)(at + 8 - packet), tag);
    for (int i = 0; i < TAG; i++) differs |= (uint8_t)(tag[i] ^ at[8 + i]);
    return differs == 0;
}

void eskin_receive(eskin_patch *patch, const uint8_t *packet, size_t length) {
    eskin_session *session = &patch->session;
    uint32_t time = patch->microseconds();
    size_t wanted = REQUEST_BYTES + (patch->key ? ESKIN_SEAL_BYTES : 0);
    if (patch->version != 2 || length != wanted || packet[0] != 2) return;
    if (packet[1] != (patch->key ? REQUEST | SEALED : REQUEST)) return;
    if (get(packet + 2, 2) != patch->address) return;
    if (get(packet + length - CRC, 4) != eskin_crc32(packet, length - CRC)) return;
    int opens = !may_send(patch, time);
    if (patch->key && !admit(patch, packet)) return;
    session->number = get(packet + 10, 4);
    memcpy(session->challenge, packet + 14, CHALLENGE);
    session->open = 1;
    session->heard = time;
    if (opens) eskin_send_hello(patch);
    uint32_t held = patch->microseconds() - time;
    send(patch, eskin_echo(patch, time, held, patch->buffer->packet));
}

/* Decode a frame in place, and return the packet's length; 0 where it is broken. */
static size_t unframe(uint8_t *line, size_t length) {
    size_t from = 0, to = 0;
    while (from < length) {
        size_t code = line[from++];
        if (from + code - 1 > length) return 0;
        for (size_t i = 1; i < code; i++) line[to++] = line[from++];
        if (code <= RUN && from < length) line[to++] = 0;
    }
    return to;
}

void eskin_receive_byte(eskin_patch *patch, uint8_t byte) {
    eskin_session *session = &patch->session;
    if (byte == 0) {
        size_t length = session->used == TOO_LONG ? 0 : session->used;
        session->used = 0;
        length = unframe(session->line, length);
        if (length > 0) eskin_receive(patch, session->line, length);
    } else if (session->used < sizeof session->line) {
        session->line[session->used++] = byte;
    } else {
        session->used = TOO_LONG;
    }
}
