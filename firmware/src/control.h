/* Pressure control of one muscle by a fill and a bleed valve. */
#ifndef BZ_CONTROL_H
#define BZ_CONTROL_H

#include <stdint.h>

typedef struct {
    uint16_t setpoint;        /* [hPa] from the host */
    int16_t pressure;         /* [hPa] measured */
    int16_t reference;        /* [hPa] set-point after the slew limit */
    int16_t feedforward;      /* [counts] from the host */
    uint8_t feedforward_left; /* [ms] for which that still holds */
    int32_t integral;         /* [counts / 4096] */
    uint16_t fill;            /* [counts] duty of the fill valve */
    uint16_t bleed;           /* [counts] duty of the bleed valve */
} bz_muscle;

/* Shut the fill valve, open the bleed valve wholly, forget the controller's past. */
void bz_vent(bz_muscle *muscle);

/* One millisecond of control: from set-point and pressure, and the reservoir's [hPa], to the two
 * duties. */
void bz_control(bz_muscle *muscle, int16_t reservoir);

#endif
