/* Frames on the serial line.
 *
 *   wire:  COBS( type | seq | payload | CRC-16 little endian ) 0x00
 *
 * COBS (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) removes every zero from the
 * frame, so a zero always ends one: a receiver is in step again after the next zero.  The CRC is
 * CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF; "123456789" gives 0x29B1).
 *
 * One in 65 536 of the damaged frames that still look like one gets past this CRC.  What moves a
 * valve therefore carries more: ARM and CLEAR a key, set-points the complement of the sum of their
 * bytes, which is no linear function of the bits as the CRC is.
 */
#ifndef BZ_PROTOCOL_H
#define BZ_PROTOCOL_H

#include <stdint.h>

#define BZ_BODY_MAX 64u                 /* [B] type to CRC */
#define BZ_CODED_MAX (BZ_BODY_MAX + 1u) /* [B] after COBS, without the closing zero */

enum { /* host to board */
    BZ_SETPOINT = 0x01,            /* 3 x u16 [hPa], u8 check */
    BZ_ARM = 0x02,                 /* u16 BZ_ARM_KEY */
    BZ_DISARM = 0x03,              /* - */
    BZ_CLEAR = 0x04,               /* u16 BZ_CLEAR_KEY */
    BZ_ECHO = 0x05,                /* up to BZ_ECHO_MAX bytes */
    BZ_TELEMETRY_DIVIDER = 0x06,   /* u8 [ms], 1 to 255 */
    BZ_GET_CONFIGURATION = 0x07,   /* - */
    BZ_SETPOINT_FF = 0x08,         /* 3 x u16 [hPa], 3 x i16 feed-forward [counts], u8 check */
    BZ_TEST_STOP_ADC = 0x7D,       /* - ; these three in the test build only */
    BZ_TEST_STOP_TICK = 0x7E,      /* - */
    BZ_TEST_HANG = 0x7F            /* - */
};

enum { /* board to host */
    BZ_TELEMETRY = 0x81,
    BZ_RESULT = 0x82,              /* u8 type that it answers, u8 result */
    BZ_CONFIGURATION = 0x83,
    BZ_ECHO_REPLY = 0x85
};

enum { /* results */
    BZ_OK = 0,
    BZ_WRONG_STATE = 1,            /* not possible in this state */
    BZ_NO_SETPOINT = 2,            /* no fresh set-point frame */
    BZ_CAUSE_PRESENT = 3,          /* a cause of the fault, or pressure, is still present */
    BZ_BAD_VALUE = 4,              /* out of range, or a wrong key */
    BZ_UNKNOWN_TYPE = 5,
    BZ_BAD_LENGTH = 6
};

#define BZ_ARM_KEY 0xA53Cu
#define BZ_CLEAR_KEY 0x5AC3u
#define BZ_ECHO_MAX 32u /* [B] */

uint16_t bz_crc16(const uint8_t *bytes, uint8_t length);

/* Code a body of `length` bytes, which has room for the CRC behind it, for the wire.
 * Returns the number of bytes written to `wire`, the closing zero included. */
uint8_t bz_encode(uint8_t *body, uint8_t length, uint8_t wire[BZ_CODED_MAX + 1u]);

typedef struct {
    uint8_t bytes[BZ_CODED_MAX]; /* since the last zero; decoded in place when the frame is whole */
    uint8_t length;              /* [B]; BZ_CODED_MAX + 1 when the frame is too long */
    uint16_t bad;                /* frames that were too long, not COBS, or of a wrong CRC */
} bz_reader;

/* The complement of the sum of `length` bytes: the check of set-points. */
uint8_t bz_complement(const uint8_t *bytes, uint8_t length);

/* Take one byte from the line.  Returns 0, or the length of the body (type, seq, payload, without
 * the CRC) that lies in `reader->bytes` until the next call. */
uint8_t bz_receive(bz_reader *reader, uint8_t byte);

uint16_t bz_get_u16(const uint8_t *from);
uint8_t *bz_put_u8(uint8_t *to, uint8_t value); /* these return the place behind what they wrote */
uint8_t *bz_put_u16(uint8_t *to, uint16_t value);
uint8_t *bz_put_u32(uint8_t *to, uint32_t value);

#endif
