#include "safety.h"

#include <string.h>

#include "protocol.h"

#define SENSOR_LOW (2 * BZ_SENSOR_LOW_MV * BZ_ADC_COUNTS / BZ_SUPPLY_MV)   /* [counts], twice */
#define SENSOR_HIGH (2 * BZ_SENSOR_HIGH_MV * BZ_ADC_COUNTS / BZ_SUPPLY_MV) /* [counts], twice */

static void leave_armed(bz_safety *safety, uint8_t state) {
    safety->state = state;
    safety->supply = 0;
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) bz_vent(&safety->muscle[i]);
}

static void trip(bz_safety *safety, uint8_t fault) {
    safety->faults |= fault;
    leave_armed(safety, BZ_STATE_FAULT);
}

void bz_safety_init(bz_safety *safety, uint8_t was_watchdog) {
    memset(safety, 0, sizeof *safety);
    safety->silence = BZ_SILENCE_TICKS;
    leave_armed(safety, BZ_STATE_BOOT);
    if (was_watchdog) trip(safety, BZ_FAULT_WATCHDOG);
}

/* From the sum of two readings to hPa.  0.5 V is a tenth of the supply, 4.5 V nine tenths; a
 * reading is rounded down, so half a count is added to each. */
static int16_t convert(uint16_t twice) {
    int32_t tenths = 10 * (int32_t)(twice + 1u) - 2 * BZ_ADC_COUNTS; /* 0 to 16 384 in the span */
    return (int16_t)((tenths * BZ_SENSOR_SPAN_HPA + 8192) >> 14);
}

static uint8_t is_outside(uint16_t twice) { return twice < SENSOR_LOW || twice > SENSOR_HIGH; }

/* Count ticks in a row of a condition, up to a limit. */
static uint16_t count(uint16_t ticks, uint8_t holds, uint16_t limit) {
    if (!holds) return 0;
    return ticks < limit ? (uint16_t)(ticks + 1u) : limit;
}

void bz_safety_tick(bz_safety *safety) {
    if (safety->silence < BZ_SILENCE_TICKS) safety->silence++;
    if (safety->scan_age < BZ_SCAN_TICKS) safety->scan_age++;
    if (safety->state == BZ_STATE_ARMED && safety->silence >= BZ_SILENCE_TICKS) {
        trip(safety, BZ_FAULT_HOST);
    }
    if (safety->scan_age >= BZ_SCAN_TICKS) trip(safety, BZ_FAULT_SCAN);
}

static void check_muscle(bz_safety *safety, uint8_t i, uint16_t twice) {
    bz_muscle *muscle = &safety->muscle[i];
    int16_t error;

    muscle->pressure = convert(twice);
    safety->over_ticks[i] = (uint8_t)count(
        safety->over_ticks[i], muscle->pressure > BZ_OVERPRESSURE, BZ_OVERPRESSURE_TICKS);
    safety->sensor_ticks[i] = (uint8_t)count(
        safety->sensor_ticks[i], is_outside(twice), BZ_SENSOR_TICKS);
    error = (int16_t)(muscle->reference - muscle->pressure);
    safety->tracking_ticks[i] = count(
        safety->tracking_ticks[i],
        safety->state == BZ_STATE_ARMED && (error > BZ_TRACKING_ERROR || error < -BZ_TRACKING_ERROR),
        BZ_TRACKING_TICKS);

    if (safety->over_ticks[i] >= BZ_OVERPRESSURE_TICKS) trip(safety, BZ_FAULT_OVERPRESSURE);
    if (safety->sensor_ticks[i] >= BZ_SENSOR_TICKS) trip(safety, BZ_FAULT_SENSOR);
    if (safety->tracking_ticks[i] >= BZ_TRACKING_TICKS) trip(safety, BZ_FAULT_TRACKING);
}

static void check_reservoir(bz_safety *safety, uint16_t reading) {
    uint16_t twice = (uint16_t)(2u * reading);
    safety->reservoir = convert(twice);
    safety->warnings = is_outside(twice)                       ? BZ_WARN_RESERVOIR_SENSOR
                       : safety->reservoir < BZ_RESERVOIR_LOW ? BZ_WARN_RESERVOIR_LOW
                                                               : 0;
}

void bz_safety_scan(bz_safety *safety, const bz_scan *scan) {
    int16_t reservoir;

    safety->scan_age = 0;
    safety->stick_x = scan->stick_x;
    safety->stick_y = scan->stick_y;
    check_reservoir(safety, scan->reservoir);
    reservoir = safety->warnings & BZ_WARN_RESERVOIR_SENSOR ? BZ_RESERVOIR_LOW : safety->reservoir;
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) check_muscle(safety, i, scan->twice[i]);

    if (safety->scans < BZ_BOOT_TICKS) {
        safety->scans++;
    } else if (safety->state == BZ_STATE_BOOT) {
        safety->state = BZ_STATE_DISARMED;
    }
    if (safety->state == BZ_STATE_ARMED) {
        for (uint8_t i = 0; i < BZ_MUSCLES; i++) bz_control(&safety->muscle[i], reservoir);
    }
}

/* Whether a cause of a fault, or pressure in a muscle, is present now. */
static uint8_t is_present(const bz_safety *safety) {
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        if (safety->muscle[i].pressure > BZ_ARM_MAX || safety->over_ticks[i] ||
            safety->sensor_ticks[i]) {
            return 1;
        }
    }
    return safety->scan_age >= BZ_SCAN_TICKS ||
           ((safety->faults & BZ_FAULT_HOST) && safety->silence >= BZ_SILENCE_TICKS);
}

uint8_t bz_set_setpoints(bz_safety *safety, const uint16_t values[BZ_MUSCLES]) {
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        if (values[i] > BZ_SETPOINT_MAX) return BZ_BAD_VALUE;
    }
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        safety->muscle[i].setpoint = values[i];
        safety->muscle[i].feedforward_left = 0;
    }
    safety->silence = 0;
    return BZ_OK;
}

uint8_t bz_arm(bz_safety *safety) {
    if (safety->state != BZ_STATE_DISARMED) return BZ_WRONG_STATE;
    if (safety->silence >= BZ_SILENCE_TICKS) return BZ_NO_SETPOINT;
    if (is_present(safety)) return BZ_CAUSE_PRESENT;
    safety->state = BZ_STATE_ARMED;
    safety->supply = 1;
    return BZ_OK;
}

uint8_t bz_disarm(bz_safety *safety) {
    if (safety->state != BZ_STATE_ARMED && safety->state != BZ_STATE_DISARMED) return BZ_WRONG_STATE;
    leave_armed(safety, BZ_STATE_DISARMED);
    return BZ_OK;
}

uint8_t bz_clear(bz_safety *safety) {
    if (safety->state != BZ_STATE_FAULT) return BZ_WRONG_STATE;
    if (safety->scans < BZ_BOOT_TICKS || is_present(safety)) return BZ_CAUSE_PRESENT;
    safety->faults = 0;
    safety->state = BZ_STATE_DISARMED;
    return BZ_OK;
}
