/* Random measurements and commands into the state machine:  fuzz-control [ticks] [seed].
 *
 * After every tick it must hold: not armed means vented and supply off; fill and bleed valve are
 * never both open; the reference lies in its range and moves no faster than its slew limit, which is
 * another one under a feed-forward; nothing fills at a reference of 0; a latched fault never becomes
 * ARMED; a fault has a reason.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "random.h"
#include "device.h"

static uint64_t state;

static void check(int holds, const char *what, uint64_t tick) {
    if (holds) return;
    printf("tick %" PRIu64 ": %s\n", tick, what);
    exit(1);
}

static void command(bz_device *device) {
    static const uint8_t types[] = {BZ_SETPOINT, BZ_SETPOINT, BZ_SETPOINT, BZ_SETPOINT_FF,
                                    BZ_ARM,      BZ_ARM,      BZ_DISARM,   BZ_CLEAR};
    uint8_t body[BZ_BODY_MAX] = {types[draw(&state) % sizeof types], (uint8_t)draw(&state)};
    uint8_t wire[BZ_CODED_MAX + 1u], *end = body + 2;
    uint8_t is_setpoint = body[0] == BZ_SETPOINT || body[0] == BZ_SETPOINT_FF;
    if (is_setpoint) {
        for (int i = 0; i < 3; i++) end = bz_put_u16(end, (uint16_t)(draw(&state) % 8300u));
        for (int i = 0; body[0] == BZ_SETPOINT_FF && i < 3; i++) {
            end = bz_put_u16(end, (uint16_t)(draw(&state) % 1640u - 820u));
        }
        end = bz_put_u8(end, bz_complement(body + 2, (uint8_t)(end - body - 2)));
    } else if (body[0] != BZ_DISARM) {
        end = bz_put_u16(end, body[0] == BZ_ARM ? BZ_ARM_KEY : BZ_CLEAR_KEY);
    }
    uint8_t count = bz_encode(body, (uint8_t)(end - body), wire);
    for (uint8_t i = 0; i < count; i++) bz_device_byte(device, wire[i]);
}

static void measure(bz_scan *scan, const bz_device *device, uint32_t mood) {
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        int32_t pressure = device->safety.muscle[i].reference + (int32_t)(draw(&state) % 200u) - 100;
        scan->twice[i] = (uint16_t)(205 + pressure * 1638 / BZ_SENSOR_SPAN_HPA);
        if (mood == 0) scan->twice[i] = (uint16_t)(draw(&state) % 2047u); /* anything at all */
    }
    scan->reservoir = (uint16_t)(draw(&state) % 1024u);
}

int main(int argc, char **argv) {
    uint64_t total = argc > 1 ? strtoull(argv[1], NULL, 10) : 20000000ull;
    uint64_t armed = 0, faults = 0;
    uint32_t mood = 1;
    bz_device device;
    bz_scan scan = {.reservoir = 900};
    state = argc > 2 ? strtoull(argv[2], NULL, 10) : 1u;
    bz_device_init(&device, 0, 0);
    for (uint64_t tick = 0; tick < total; tick++) {
        const bz_safety *safety = &device.safety;
        int16_t before[BZ_MUSCLES], limit[BZ_MUSCLES];
        uint8_t was = safety->state;
        for (uint8_t i = 0; i < BZ_MUSCLES; i++) before[i] = safety->muscle[i].reference;
        if (tick % 1024u == 0) mood = draw(&state) % 16u;
        if (draw(&state) % (mood == 1 ? 400u : 16u) == 0) command(&device);
        check(!(was == BZ_STATE_FAULT && safety->state == BZ_STATE_ARMED), "FAULT to ARMED", tick);
        bz_device_tick(&device);
        check(!(was == BZ_STATE_FAULT && safety->state == BZ_STATE_ARMED), "FAULT to ARMED", tick);
        measure(&scan, &device, mood);
        for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
            limit[i] = safety->muscle[i].feedforward_left ? BZ_SLEW_SHAPED : BZ_SLEW;
        }
        if (mood != 2 || draw(&state) % 8u == 0) bz_device_scan(&device, &scan);
        bz_device_report(&device);
        while (!bz_ring_is_empty(&device.sent)) bz_ring_pop(&device.sent);

        armed += safety->state == BZ_STATE_ARMED;
        faults += safety->state == BZ_STATE_FAULT && was != BZ_STATE_FAULT;
        check(safety->supply == (safety->state == BZ_STATE_ARMED), "supply valve", tick);
        check(!safety->faults == (safety->state != BZ_STATE_FAULT), "fault without reason", tick);
        for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
            const bz_muscle *muscle = &safety->muscle[i];
            int16_t step = (int16_t)(muscle->reference - before[i]);
            check(!(muscle->fill && muscle->bleed), "fill and bleed both open", tick);
            check(muscle->fill <= BZ_PWM_COUNTS && muscle->bleed <= BZ_PWM_COUNTS, "duty", tick);
            check(muscle->reference >= 0 && muscle->reference <= BZ_SETPOINT_MAX, "reference", tick);
            if (safety->state == BZ_STATE_ARMED) {
                check(step <= limit[i] && step >= -limit[i], "slew limit", tick);
                check(!(muscle->fill && muscle->reference == 0), "fill without a reference", tick);
            } else {
                check(!muscle->fill && muscle->bleed == BZ_PWM_COUNTS, "not vented", tick);
            }
        }
    }
    printf("ticks %" PRIu64 " armed %" PRIu64 " faults %" PRIu64 "\n", total, armed, faults);
    return 0;
}
