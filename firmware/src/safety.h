/* The state machine and the safety functions.
 *
 *   BOOT -> DISARMED <-> ARMED
 *     \         \          |
 *      `-> FAULT (latched) <'      FAULT -CLEAR-> DISARMED, never to ARMED
 *
 * Muscles are vented and the supply valve is off in every state but ARMED.
 */
#ifndef BZ_SAFETY_H
#define BZ_SAFETY_H

#include "config.h"
#include "control.h"

enum { BZ_STATE_BOOT, BZ_STATE_DISARMED, BZ_STATE_ARMED, BZ_STATE_FAULT };

enum { /* faults */
    BZ_FAULT_HOST = 1,          /* no valid set-point frame for BZ_SILENCE_TICKS while armed */
    BZ_FAULT_OVERPRESSURE = 2,
    BZ_FAULT_SENSOR = 4,        /* open or short circuit */
    BZ_FAULT_SCAN = 8,          /* no complete measurement */
    BZ_FAULT_WATCHDOG = 16,     /* the program stopped and was restarted */
    BZ_FAULT_TRACKING = 32      /* pressure far from its reference for long */
};

enum { /* warnings: shown, no trip */
    BZ_WARN_RESERVOIR_LOW = 1,
    BZ_WARN_RESERVOIR_SENSOR = 2
};

typedef struct {
    uint16_t twice[BZ_MUSCLES]; /* [counts] sum of two readings of a muscle's pressure sensor */
    uint16_t reservoir;         /* [counts] one reading */
    uint16_t stick_x, stick_y;  /* [counts] one reading each */
} bz_scan;

typedef struct {
    bz_muscle muscle[BZ_MUSCLES];
    int16_t reservoir;                      /* [hPa] */
    uint16_t stick_x, stick_y;              /* [counts] */
    uint8_t state;
    uint8_t faults;                         /* all that came since the last CLEAR */
    uint8_t warnings;
    uint8_t supply;                         /* 1: supply valve energised */
    uint8_t scans;                          /* complete measurements, up to BZ_BOOT_TICKS */
    uint8_t scan_age;                       /* [ms] since the last complete measurement */
    uint8_t silence;                        /* [ms] since the last valid set-point frame */
    uint8_t over_ticks[BZ_MUSCLES];         /* [ms] above the pressure limit */
    uint8_t sensor_ticks[BZ_MUSCLES];       /* [ms] outside the sensor's window */
    uint16_t tracking_ticks[BZ_MUSCLES];    /* [ms] of large error */
} bz_safety;

void bz_safety_init(bz_safety *safety, uint8_t was_watchdog);

void bz_safety_tick(bz_safety *safety);                      /* every millisecond */
void bz_safety_scan(bz_safety *safety, const bz_scan *scan); /* after each measurement */

/* Commands.  They return a result of the protocol. */
uint8_t bz_set_setpoints(bz_safety *safety, const uint16_t values[BZ_MUSCLES]);
uint8_t bz_arm(bz_safety *safety);
uint8_t bz_disarm(bz_safety *safety);
uint8_t bz_clear(bz_safety *safety);

#endif
