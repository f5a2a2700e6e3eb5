#include "control.h"

#include "config.h"

static int16_t clamp(int32_t value, int16_t limit) {
    return value > limit ? limit : value < -limit ? (int16_t)-limit : (int16_t)value;
}

void bz_vent(bz_muscle *muscle) {
    muscle->reference = 0;
    muscle->integral = 0;
    muscle->feedforward_left = 0;
    muscle->fill = 0;
    muscle->bleed = BZ_PWM_COUNTS;
}

/* A positive command opens the fill valve, a negative one the bleed valve: never both. */
static void drive(bz_muscle *muscle, int16_t command) {
    int16_t size = command < 0 ? (int16_t)-command : command;
    size = command ? clamp(BZ_JUMP + size, BZ_PWM_COUNTS) : 0;
    muscle->fill = command > 0 ? (uint16_t)size : 0;
    muscle->bleed = command < 0 ? (uint16_t)size : 0;
}

/* Integrate a small error about a reference at rest.  While the reference moves, an integral would
 * only store the lag and give it back as overshoot. */
static void integrate(bz_muscle *muscle, int16_t error) {
    if ((error > 0 && muscle->integral < 0) || (error < 0 && muscle->integral > 0)) {
        muscle->integral = 0;
    }
    muscle->integral += (int32_t)error * BZ_KI;
    if (muscle->integral > BZ_INTEGRAL_MAX * 4096) muscle->integral = BZ_INTEGRAL_MAX * 4096;
    if (muscle->integral < -BZ_INTEGRAL_MAX * 4096) muscle->integral = -BZ_INTEGRAL_MAX * 4096;
}

/* The square root of a value below 2^26, to within 16: nine bits are enough here. */
static uint16_t find_root(uint32_t value) {
    uint16_t root = 0;
    value >>= 8;
    for (uint16_t bit = 0x100u; bit; bit >>= 1) {
        uint16_t larger = root | bit;
        if ((uint32_t)larger * larger <= value) root = larger;
    }
    return (uint16_t)(root << 4);
}

/* What drives the flow of the open fill or bleed valve [hPa], p1 phi.  It changes the pressure at the
 * rate p1 phi / BZ_FILL_TIME, or BZ_BLEED_TIME.  With p1 and p2 the absolute pressures before and
 * behind the valve, p1 phi is p1 where the flow is choked (p2 < p1 / 2) and 2 sqrt(p2 (p1 - p2))
 * otherwise: ISO 6358 with a critical ratio of 0.5. */
static uint16_t find_drive(uint8_t fills, int16_t pressure, int16_t reservoir) {
    uint16_t inside = (uint16_t)(pressure > -BZ_ATMOSPHERE ? pressure + BZ_ATMOSPHERE : 0);
    uint16_t before = fills ? (uint16_t)(reservoir + BZ_ATMOSPHERE) : inside;
    uint16_t behind = fills ? inside : BZ_ATMOSPHERE;
    uint16_t drop = before > behind ? (uint16_t)(before - behind) : 0, drive = before;
    if (behind > drop) drive = (uint16_t)(2u * find_root((uint32_t)behind * drop));
    return drive < BZ_DRIVE_MIN ? BZ_DRIVE_MIN : drive;
}

/* The command, beyond the dead zone, for a feed-forward [counts] and a rate of the pressure, in
 * hPa/ms / 256, together.  A rate against the feed-forward shuts the valve that this opens, and opens
 * the other one with what is left. */
static int16_t find_command(int16_t forward, int32_t rate, int16_t pressure, int16_t reservoir) {
    uint8_t fills = forward ? forward > 0 : rate > 0;
    uint16_t drive = find_drive(fills, pressure, reservoir);
    int32_t time = fills ? BZ_FILL_TIME : BZ_BLEED_TIME;
    int32_t flow = rate * (time * (BZ_PWM_COUNTS - BZ_JUMP) / 256) + (int32_t)forward * drive;
    int32_t command;
    if (fills ? flow >= 0 : flow <= 0) {
        command = flow / drive;
    } else {
        flow *= fills ? BZ_BLEED_TIME : BZ_FILL_TIME;
        command = flow / (time * find_drive(!fills, pressure, reservoir));
    }
    return clamp(command, BZ_PWM_COUNTS);
}

void bz_control(bz_muscle *muscle, int16_t reservoir) {
    uint8_t is_shaped = muscle->feedforward_left > 0; /* the host plans the way of the pressure */
    int16_t limit = is_shaped ? BZ_SLEW_SHAPED : BZ_SLEW;
    int16_t step = clamp((int32_t)muscle->setpoint - muscle->reference, limit);
    int16_t forward = is_shaped ? muscle->feedforward : 0;
    int16_t error, size, command;
    int32_t rate;

    muscle->reference = (int16_t)(muscle->reference + step);
    if (muscle->reference == 0) { /* nothing is asked for: bleed valve open */
        bz_vent(muscle);
        return;
    }
    if (is_shaped) muscle->feedforward_left--;
    if (forward > 0 && muscle->pressure > BZ_SETPOINT_MAX) forward = 0; /* whatever the host wants */
    error = (int16_t)(muscle->reference - muscle->pressure);
    size = error < 0 ? (int16_t)-error : error;
    if (step == 0 && forward == 0 && size <= BZ_ERROR_DEAD) {
        drive(muscle, 0); /* spare the valves: hysteresis would hunt */
        return;
    }
    if (step != 0) {
        muscle->integral = 0;
    } else if (size < BZ_ERROR_INTEGRAL) {
        integrate(muscle, error);
    }
    rate = (int32_t)error * (256 / BZ_LOOP_TIME);
    if (!is_shaped) rate += (int32_t)step * 256;
    if (rate > BZ_RATE_MAX * 256) rate = BZ_RATE_MAX * 256;
    if (rate < -BZ_RATE_MAX * 256) rate = -BZ_RATE_MAX * 256;
    command = find_command(forward, rate, muscle->pressure, reservoir);
    drive(muscle, (int16_t)(command + muscle->integral / 4096));
}
