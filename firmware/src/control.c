#include "control.h"

#include "config.h"

static int16_t clamp(int16_t value, int16_t limit) {
    return value > limit ? limit : value < -limit ? (int16_t)-limit : value;
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
    size = command ? clamp((int16_t)(BZ_JUMP + size), BZ_PWM_COUNTS) : 0;
    muscle->fill = command > 0 ? (uint16_t)size : 0;
    muscle->bleed = command < 0 ? (uint16_t)size : 0;
}

/* The bleed valve's flow is in proportion to the absolute pressure: the lower that is, the more
 * must the valve open for the same rate of pressure. */
static int16_t scale_bleed(int16_t command, int16_t pressure) {
    uint16_t above = pressure > 0 ? (uint16_t)pressure : 0;
    uint16_t eighths = 8u * BZ_BLEED_HPA / (above + BZ_ATMOSPHERE_HPA);
    int32_t scaled = (int32_t)command * eighths / 8;
    return scaled < -BZ_PWM_COUNTS ? -BZ_PWM_COUNTS : (int16_t)scaled;
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

void bz_control(bz_muscle *muscle) {
    uint8_t is_shaped = muscle->feedforward_left > 0; /* the host plans the way of the pressure */
    int16_t limit = is_shaped ? BZ_SLEW_SHAPED : BZ_SLEW;
    int16_t step = clamp((int16_t)((int16_t)muscle->setpoint - muscle->reference), limit);
    int16_t forward = is_shaped ? muscle->feedforward : (int16_t)(step * BZ_KFF / 16);
    int16_t error, size, command;

    muscle->reference = (int16_t)(muscle->reference + step);
    if (muscle->reference == 0) { /* nothing is asked for: bleed valve open */
        bz_vent(muscle);
        return;
    }
    if (is_shaped) muscle->feedforward_left--;
    if (forward > 0 && muscle->pressure > BZ_SETPOINT_MAX) forward = 0; /* whatever the host wants */
    error = (int16_t)(muscle->reference - muscle->pressure);
    size = error < 0 ? (int16_t)-error : error;
    if (forward == 0 && size <= BZ_ERROR_DEAD) { /* spare the valves: hysteresis would hunt */
        drive(muscle, 0);
        return;
    }
    if (step != 0) {
        muscle->integral = 0;
    } else if (size < BZ_ERROR_INTEGRAL) {
        integrate(muscle, error);
    }
    /* |error| < 20 000 hPa and |forward| <= 800, so the sums stay within 16 bit. */
    command = (int16_t)((int32_t)error * BZ_KP / 256 + muscle->integral / 4096);
    if (!is_shaped) command = (int16_t)(command + forward);
    if (command < 0) command = scale_bleed(command, muscle->pressure);
    drive(muscle, is_shaped ? (int16_t)(command + forward) : command);
}
