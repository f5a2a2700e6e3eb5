/* Every limit, gain and conversion of the board, each with its unit.
 *
 * Pressures are gauge pressures in hPa (1 hPa = 0.1 kPa = 1e-4 MPa).  One tick is 1 ms.  Valve
 * commands are counts of the PWM period.  Values marked "assumed" are not fixed by any data sheet
 * yet: set them for the valves and sensors in hand, and identify them on the bench.
 */
#ifndef BZ_CONFIG_H
#define BZ_CONFIG_H

#define BZ_PROTOCOL_VERSION 1u
#ifndef BZ_BUILD_ID
#define BZ_BUILD_ID 0u /* first 32 bits of the SHA-256 of these sources, set by the Makefile */
#endif

#define BZ_MUSCLES 3u
#define BZ_TICK_HZ 1000u /* [Hz] */

/* ---- Serial line ------------------------------------------------------------------------- */
#define BZ_BAUD 500000ul        /* [bit/s], 8N1: exact at 16 MHz */
#define BZ_BYTES_PER_TICK 50u   /* [B/ms] that the line carries, 10 bit per byte */
#define BZ_TELEMETRY_TICKS 2u   /* [ms] between telemetry frames after a reset */

/* ---- Pressure sensors: ratiometric, read with 10 bit against the supply ------------------ */
#define BZ_ADC_COUNTS 1024      /* [counts] for the supply voltage */
#define BZ_SENSOR_SPAN_HPA 10340l /* [hPa] between 0.5 V and 4.5 V of 5 V (1034 kPa) */
#define BZ_SENSOR_LOW_MV 250l   /* [mV] below: open or short circuit */
#define BZ_SENSOR_HIGH_MV 4750l /* [mV] above: open or short circuit */
#define BZ_ATMOSPHERE 1013      /* [hPa] */
#define BZ_DRIVE_MIN 500u       /* [hPa] least pressure that is taken to drive a flow */
#define BZ_SUPPLY_MV 5000l      /* [mV] */

/* ---- Valves ------------------------------------------------------------------------------ */
#define BZ_PWM_COUNTS 800 /* [counts] of one PWM period: 16 MHz / 800 = 20 kHz */
#define BZ_JUMP 248       /* [counts] to cross the dead zone of a valve, 31 % (assumed) */

/* ---- Pressure controller ------------------------------------------------------------------ */
#define BZ_SETPOINT_MAX 8270    /* [hPa] 827 kPa, largest legal set-point */
#define BZ_SLEW 30              /* [hPa/ms] largest rate of the reference, 3 kPa/ms */
#define BZ_SLEW_SHAPED 100      /* [hPa/ms] the same while a feed-forward from the host holds */
/* Time constants V / (A v) of an open valve [ms]: volume of a line and its muscle, 460 mm3, over the
 * valve's effective area, 0.0304 and 0.0779 mm2, and 199 m/s (assumed).  The controller takes two
 * thirds and a half of them: a time that is too short makes pressures lag, one that is too long
 * overshoot, the more so the wider the valve, whose play then lets more air through. */
#define BZ_FILL_CONSTANT 76l
#define BZ_BLEED_CONSTANT 30l
#define BZ_FILL_TIME (2l * BZ_FILL_CONSTANT / 3l)
#define BZ_BLEED_TIME (BZ_BLEED_CONSTANT / 2l)
#define BZ_LOOP_TIME 16l        /* [ms] in which an error is to decay; a divisor of 256 */
#define BZ_RATE_MAX 250l        /* [hPa/ms] largest rate that the controller asks for */
#define BZ_KI 4                 /* [counts/(hPa ms) / 4096] integral */
#define BZ_ERROR_DEAD 20        /* [hPa] error below which both valves stay shut */
#define BZ_ERROR_INTEGRAL 200   /* [hPa] error above which nothing is integrated */
#define BZ_INTEGRAL_MAX 60l     /* [counts] */
#define BZ_FEEDFORWARD_TICKS 20 /* [ms] for which a feed-forward value from the host holds */

/* ---- Safety functions --------------------------------------------------------------------- */
#define BZ_ARM_MAX 500            /* [hPa] above: neither ARM nor CLEAR */
#define BZ_OVERPRESSURE 8700      /* [hPa] above: trip */
#define BZ_OVERPRESSURE_TICKS 3   /* [ms] in a row */
#define BZ_SENSOR_TICKS 5         /* [ms] in a row outside the sensor's window: trip */
#define BZ_SCAN_TICKS 5           /* [ms] without a complete measurement: trip */
#define BZ_SILENCE_TICKS 100u     /* [ms] without a valid set-point frame: trip */
#define BZ_TRACKING_ERROR 1000    /* [hPa] error that must not last (leak, burst, blocked line) */
#define BZ_TRACKING_TICKS 300u    /* [ms] in a row: trip */
#define BZ_BOOT_TICKS 10          /* [ms] of measurements before the board leaves BOOT */
#define BZ_RESERVOIR_LOW 8270     /* [hPa] below: warning, the largest set-point is out of reach */
#define BZ_WATCHDOG_MS 17u        /* [ms] WDTO_15MS, as long as the watchdog takes at most */

#endif
