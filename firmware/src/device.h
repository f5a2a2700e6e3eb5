/* The board without its hardware: bytes and measurements in, bytes and duties out. */
#ifndef BZ_DEVICE_H
#define BZ_DEVICE_H

#include "protocol.h"
#include "safety.h"

typedef struct {
    uint8_t bytes[256];
    volatile uint8_t head; /* next place to write; the indices wrap by themselves */
    volatile uint8_t tail; /* next place to read */
} bz_ring;

typedef struct {
    bz_safety safety;
    bz_reader reader;
    bz_ring sent;              /* bytes for the host */
    uint32_t ms;               /* [ms] since the reset */
    uint16_t accepted;         /* frames obeyed */
    uint16_t refused;          /* frames of a right CRC, but of unknown type, length or value */
    uint16_t gaps;             /* frames missing by their sequence numbers */
    uint16_t loop_us;          /* [us] longest control pass since the last telemetry */
    uint8_t last_seq;          /* of the last frame of a right CRC */
    uint8_t seen;              /* whether there was one */
    uint8_t acknowledged;      /* sequence number of the last set-point frame obeyed */
    uint8_t seq;               /* of the next frame to the host */
    uint8_t reset_cause;       /* MCUSR */
    uint8_t missed;            /* ticks without a complete measurement before the next */
    uint8_t lost;              /* frames to the host dropped because the line was full */
    uint8_t telemetry_ticks;   /* [ms] between telemetry frames */
    uint8_t telemetry_left;    /* [ms] until the next */
    volatile uint8_t test;     /* a request of the test build, 0 otherwise */
} bz_device;

void bz_device_init(bz_device *device, uint8_t reset_cause, uint8_t was_watchdog);
void bz_device_byte(bz_device *device, uint8_t byte);           /* a byte from the host */
void bz_device_tick(bz_device *device);                         /* every millisecond */
void bz_device_scan(bz_device *device, const bz_scan *scan);    /* a complete measurement */
void bz_device_report(bz_device *device);                       /* telemetry, when it is due */

/* Rings have one writer and one reader, which may be an interrupt. */
void bz_ring_push(bz_ring *ring, uint8_t byte);
uint8_t bz_ring_is_empty(const bz_ring *ring);
uint8_t bz_ring_pop(bz_ring *ring);

#endif
