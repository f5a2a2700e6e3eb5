#include "device.h"

#include <string.h>

#ifdef BZ_TEST
#define TEST_BUILD 1u
#else
#define TEST_BUILD 0u
#endif

void bz_ring_push(bz_ring *ring, uint8_t byte) {
    uint8_t head = ring->head;
    if ((uint8_t)(head + 1u) == ring->tail) return; /* full: the CRC will find the gap */
    ring->bytes[head] = byte;
    ring->head = (uint8_t)(head + 1u);
}

uint8_t bz_ring_is_empty(const bz_ring *ring) { return ring->head == ring->tail; }

uint8_t bz_ring_pop(bz_ring *ring) {
    uint8_t byte = ring->bytes[ring->tail];
    ring->tail = (uint8_t)(ring->tail + 1u);
    return byte;
}

void bz_device_init(bz_device *device, uint8_t reset_cause, uint8_t was_watchdog) {
    memset(device, 0, sizeof *device);
    device->reset_cause = reset_cause;
    device->telemetry_ticks = device->telemetry_left = BZ_TELEMETRY_TICKS;
    bz_safety_init(&device->safety, was_watchdog);
}

/* Send a body of `length` bytes (its sequence number is filled in here), whole or not at all. */
static void send(bz_device *device, uint8_t *body, uint8_t length) {
    uint8_t wire[BZ_CODED_MAX + 1u];
    uint8_t count, head;
    uint8_t room = (uint8_t)(device->sent.tail - device->sent.head - 1u);

    if (room < length + 4u) { /* COBS, CRC and the zero add four */
        device->lost++;
        return;
    }
    body[1] = device->seq++;
    count = bz_encode(body, length, wire);
    head = device->sent.head;
    for (uint8_t i = 0; i < count; i++) device->sent.bytes[head++] = wire[i];
    device->sent.head = head; /* the interrupt that sends sees the frame once it is whole */
}

static void send_result(bz_device *device, uint8_t type, uint8_t result) {
    uint8_t body[4 + 2] = {BZ_RESULT, 0, type, result};
    send(device, body, 4);
}

static void send_echo(bz_device *device, const uint8_t *payload, uint8_t length) {
    uint8_t body[2 + BZ_ECHO_MAX + 2] = {BZ_ECHO_REPLY, 0};
    memcpy(body + 2, payload, length);
    send(device, body, (uint8_t)(2u + length));
}

static void send_configuration(bz_device *device) {
    static const uint16_t values[] = {
        BZ_TICK_HZ,         BZ_SETPOINT_MAX, BZ_ARM_MAX,        BZ_OVERPRESSURE,    BZ_SLEW,
        BZ_SILENCE_TICKS,   BZ_SENSOR_LOW_MV, BZ_SENSOR_HIGH_MV, BZ_SENSOR_SPAN_HPA, BZ_TRACKING_ERROR,
        BZ_TRACKING_TICKS,  BZ_PWM_COUNTS,   BZ_JUMP,           BZ_FILL_TIME,       BZ_BLEED_TIME,
        BZ_LOOP_TIME,       BZ_KI,           BZ_ERROR_DEAD,     BZ_SLEW_SHAPED,
    };
    uint8_t body[BZ_BODY_MAX] = {BZ_CONFIGURATION, 0};
    uint8_t *end = body + 2;
    end = bz_put_u8(end, BZ_PROTOCOL_VERSION);
    end = bz_put_u8(end, TEST_BUILD);
    end = bz_put_u32(end, BZ_BUILD_ID);
    for (uint8_t i = 0; i < sizeof values / sizeof *values; i++) end = bz_put_u16(end, values[i]);
    send(device, body, (uint8_t)(end - body));
}

static uint8_t take_setpoints(bz_device *device, const uint8_t *payload, uint8_t has_feedforward) {
    uint16_t values[BZ_MUSCLES];
    int16_t forward[BZ_MUSCLES];
    uint8_t result, length = has_feedforward ? 4u * BZ_MUSCLES : 2u * BZ_MUSCLES;

    if (payload[length] != bz_complement(payload, length)) return BZ_BAD_VALUE;
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        values[i] = bz_get_u16(payload + 2u * i);
        forward[i] = has_feedforward ? (int16_t)bz_get_u16(payload + 2u * (BZ_MUSCLES + i)) : 0;
        if (forward[i] > BZ_PWM_COUNTS || forward[i] < -BZ_PWM_COUNTS) return BZ_BAD_VALUE;
    }
    result = bz_set_setpoints(&device->safety, values);
    for (uint8_t i = 0; has_feedforward && result == BZ_OK && i < BZ_MUSCLES; i++) {
        device->safety.muscle[i].feedforward = forward[i];
        device->safety.muscle[i].feedforward_left = BZ_FEEDFORWARD_TICKS;
    }
    return result;
}

/* The length of payload that a type must have, 255 for an unknown type. */
static uint8_t find_length(uint8_t type) {
    switch (type) {
        case BZ_SETPOINT: return 2u * BZ_MUSCLES + 1u;
        case BZ_SETPOINT_FF: return 4u * BZ_MUSCLES + 1u;
        case BZ_ARM:
        case BZ_CLEAR: return 2;
        case BZ_TELEMETRY_DIVIDER: return 1;
#ifdef BZ_TEST
        case BZ_TEST_STOP_ADC:
        case BZ_TEST_STOP_TICK:
        case BZ_TEST_HANG:
#endif
        case BZ_DISARM:
        case BZ_GET_CONFIGURATION: return 0;
        default: return 255;
    }
}

static uint8_t obey(bz_device *device, uint8_t type, const uint8_t *payload) {
    switch (type) {
        case BZ_SETPOINT: return take_setpoints(device, payload, 0);
        case BZ_SETPOINT_FF: return take_setpoints(device, payload, 1);
        case BZ_ARM:
            return bz_get_u16(payload) == BZ_ARM_KEY ? bz_arm(&device->safety) : BZ_BAD_VALUE;
        case BZ_CLEAR:
            return bz_get_u16(payload) == BZ_CLEAR_KEY ? bz_clear(&device->safety) : BZ_BAD_VALUE;
        case BZ_DISARM: return bz_disarm(&device->safety);
        case BZ_TELEMETRY_DIVIDER:
            if (payload[0] == 0) return BZ_BAD_VALUE;
            device->telemetry_ticks = device->telemetry_left = payload[0];
            return BZ_OK;
        case BZ_GET_CONFIGURATION: send_configuration(device); return BZ_OK;
        default: device->test = type; return BZ_OK;
    }
}

/* A frame of a right CRC: `length` bytes of type, sequence number and payload. */
static void take_frame(bz_device *device, const uint8_t *body, uint8_t length) {
    uint8_t type = body[0], seq = body[1], payload = (uint8_t)(length - 2u);
    uint8_t is_setpoint = type == BZ_SETPOINT || type == BZ_SETPOINT_FF;
    uint8_t result;

    if (device->seen) device->gaps = (uint16_t)(device->gaps + (uint8_t)(seq - device->last_seq - 1u));
    device->seen = 1;
    device->last_seq = seq;

    if (type == BZ_ECHO && payload <= BZ_ECHO_MAX) {
        device->accepted++;
        send_echo(device, body + 2, payload);
        return;
    }
    if (type == BZ_ECHO) {
        result = BZ_BAD_LENGTH;
    } else if (find_length(type) == 255) {
        result = BZ_UNKNOWN_TYPE;
    } else if (find_length(type) != payload) {
        result = BZ_BAD_LENGTH;
    } else {
        result = obey(device, type, body + 2);
    }
    if (result < BZ_BAD_VALUE) {
        device->accepted++;
    } else {
        device->refused++;
    }
    if (is_setpoint && result == BZ_OK) {
        device->acknowledged = seq; /* the telemetry brings this: no frame of its own */
    } else {
        send_result(device, type, result);
    }
}

void bz_device_byte(bz_device *device, uint8_t byte) {
    uint8_t length = bz_receive(&device->reader, byte);
    if (length) take_frame(device, device->reader.bytes, length);
}

void bz_device_tick(bz_device *device) {
    device->ms++;
    if (device->telemetry_left) device->telemetry_left--;
    bz_safety_tick(&device->safety);
}

void bz_device_scan(bz_device *device, const bz_scan *scan) { bz_safety_scan(&device->safety, scan); }

void bz_device_report(bz_device *device) {
    const bz_safety *safety = &device->safety;
    uint8_t body[BZ_BODY_MAX] = {BZ_TELEMETRY, 0};
    uint8_t *end = body + 2;

    if (device->telemetry_left) return;
    device->telemetry_left = device->telemetry_ticks;
    end = bz_put_u8(end, safety->state);
    end = bz_put_u8(end, safety->faults);
    end = bz_put_u8(end, safety->warnings);
    end = bz_put_u8(end, safety->supply);
    end = bz_put_u8(end, device->acknowledged);
    end = bz_put_u8(end, device->reset_cause);
    end = bz_put_u32(end, device->ms);
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        end = bz_put_u16(end, (uint16_t)safety->muscle[i].pressure);
    }
    end = bz_put_u16(end, (uint16_t)safety->reservoir);
    end = bz_put_u16(end, safety->stick_x);
    end = bz_put_u16(end, safety->stick_y);
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) end = bz_put_u8(end, (uint8_t)(safety->muscle[i].fill / 4u));
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) end = bz_put_u8(end, (uint8_t)(safety->muscle[i].bleed / 4u));
    end = bz_put_u16(end, device->accepted);
    end = bz_put_u16(end, (uint16_t)(device->reader.bad + device->refused));
    end = bz_put_u16(end, device->gaps);
    end = bz_put_u16(end, device->loop_us);
    end = bz_put_u8(end, device->missed);
    end = bz_put_u8(end, device->lost);
    device->loop_us = 0;
    send(device, body, (uint8_t)(end - body));
}
