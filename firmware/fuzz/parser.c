/* Random bytes from the host into the whole device:  fuzz-parser [bytes] [seed].
 *
 * Most bytes are random, some are real frames of random content with a right CRC, so that what lies
 * behind the CRC is reached too.  Prints what was accepted; the sanitizers stop at the first error.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "random.h"
#include "device.h"

static uint64_t state, written;
static bz_device device;

static void feed(uint8_t byte) {
    bz_device_byte(&device, byte);
    written++;
    while (!bz_ring_is_empty(&device.sent)) bz_ring_pop(&device.sent);
}

static void feed_frame(void) {
    /* Lengths of payload by type, and now and then a wrong one. */
    static const uint8_t lengths[12] = {0, 7, 2, 0, 2, 32, 1, 0, 13, 33, 60, 3};
    uint8_t body[BZ_BODY_MAX], wire[BZ_CODED_MAX + 1u];
    uint8_t type = (uint8_t)(draw(&state) % sizeof lengths); /* all types, and some unknown */
    uint8_t payload = lengths[draw(&state) % 8u ? type : draw(&state) % sizeof lengths];
    for (uint8_t i = 0; i < 2u + payload; i++) body[i] = (uint8_t)draw(&state);
    body[0] = type;
    if (type == BZ_SETPOINT) {
        body[3] %= 33u, body[5] %= 33u, body[7] %= 33u; /* mostly legal */
        body[8] = bz_complement(body + 2, 6);
    }
    uint8_t count = bz_encode(body, (uint8_t)(2u + payload), wire);
    for (uint8_t i = 0; i < count; i++) feed(wire[i]);
}

int main(int argc, char **argv) {
    uint64_t total = argc > 1 ? strtoull(argv[1], NULL, 10) : 100000000ull;
    uint64_t random_frames = 0, frames = 0;
    state = argc > 2 ? strtoull(argv[2], NULL, 10) : 1u;
    bz_device_init(&device, 0, 0);
    while (written < total) {
        uint16_t before = device.accepted;
        for (uint32_t i = draw(&state) % 2048u; i; i--) {
            uint32_t value = draw(&state);
            feed(value & 0x300u ? (uint8_t)value : (uint8_t)(value & 0x1Fu)); /* more zeros and codes */
        }
        random_frames += (uint16_t)(device.accepted - before);
        feed(0);
        before = device.accepted;
        for (uint32_t i = draw(&state) % 16u; i; i--) feed_frame();
        frames += (uint16_t)(device.accepted - before);
    }
    printf("bytes %" PRIu64 " accepted_random %" PRIu64 " accepted_frames %" PRIu64 "\n", written,
           random_frames, frames);
    return 0;
}
