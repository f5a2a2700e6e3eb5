#include "protocol.h"

/* A byte of the polynomial division at once, without a table, in operations of 8 bit. */
uint16_t bz_crc16(const uint8_t *bytes, uint8_t length) {
    uint8_t high = 0xFFu, low = 0xFFu;
    while (length--) {
        uint8_t x = high ^ *bytes++;
        x ^= x >> 4;
        high = (uint8_t)(low ^ (uint8_t)(x << 4) ^ x >> 3);
        low = (uint8_t)(x ^ (uint8_t)(x << 5));
    }
    return (uint16_t)((uint16_t)high << 8 | low);
}

uint8_t bz_complement(const uint8_t *bytes, uint8_t length) {
    uint8_t sum = 0;
    while (length--) sum = (uint8_t)(sum + *bytes++);
    return (uint8_t)~sum;
}

uint8_t bz_encode(uint8_t *body, uint8_t length, uint8_t wire[BZ_CODED_MAX + 1u]) {
    uint16_t crc = bz_crc16(body, length);
    uint8_t code = 0, next = 1; /* where the distance to the next zero goes; where the next byte goes */
    body[length++] = (uint8_t)crc;
    body[length++] = (uint8_t)(crc >> 8);
    for (uint8_t i = 0; i < length; i++) {
        if (body[i]) {
            wire[next++] = body[i];
        } else {
            wire[code] = (uint8_t)(next - code);
            code = next++;
        }
    }
    wire[code] = (uint8_t)(next - code);
    wire[next++] = 0;
    return next;
}

/* Undo COBS in place.  Returns the length of the body, 0 if the bytes are not COBS. */
static uint8_t decode(uint8_t *bytes, uint8_t length) {
    uint8_t from = 0, to = 0;
    while (from < length) {
        uint8_t end = (uint8_t)(from + bytes[from]); /* the code is not 0 and at most 255 */
        if (end < from || end > length) return 0;
        while (++from < end) bytes[to++] = bytes[from];
        if (from < length) bytes[to++] = 0;
    }
    return to;
}

uint8_t bz_receive(bz_reader *reader, uint8_t byte) {
    uint8_t length = reader->length;
    if (byte) {
        if (length < BZ_CODED_MAX) reader->bytes[length] = byte;
        if (length <= BZ_CODED_MAX) reader->length++;
        return 0;
    }
    reader->length = 0;
    if (length == 0) return 0; /* zeros in a row are idle line, no frame */
    if (length <= BZ_CODED_MAX) {
        length = decode(reader->bytes, length);
        if (length >= 4u) {
            length -= 2u;
            if (bz_crc16(reader->bytes, length) == bz_get_u16(reader->bytes + length)) return length;
        }
    }
    reader->bad++;
    return 0;
}

uint16_t bz_get_u16(const uint8_t *from) { return (uint16_t)(from[0] | (uint16_t)(from[1] << 8)); }

uint8_t *bz_put_u8(uint8_t *to, uint8_t value) {
    *to = value;
    return to + 1;
}

uint8_t *bz_put_u16(uint8_t *to, uint16_t value) {
    return bz_put_u8(bz_put_u8(to, (uint8_t)value), (uint8_t)(value >> 8));
}

uint8_t *bz_put_u32(uint8_t *to, uint32_t value) {
    return bz_put_u16(bz_put_u16(to, (uint16_t)value), (uint16_t)(value >> 16));
}
