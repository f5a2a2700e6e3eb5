/* The device on the host, for software in the loop: converter, serial line, clock and watchdog of the
 * ATmega2560 in steps of one millisecond.  Called through ctypes. */
#include "device.h"
#include "queue.h"

#define CHANNELS 6u             /* muscles 1 to 3, reservoir, stick x, stick y */
#define OUTPUTS 7u              /* fill valves 1 to 3, bleed valves 1 to 3, supply valve */
#define EXTERNAL_RESET 2u       /* bits of MCUSR */
#define WATCHDOG_RESET 8u
#define OUTPUT_DELAY 0.84       /* [ms] from the tick to the new outputs, as emulated */

typedef struct {
    bz_device device;
    bz_queue from_host, to_host;
    uint16_t readings[CHANNELS]; /* [counts] */
    double outputs[OUTPUTS];     /* 0 to 1 */
    uint32_t resets;
    uint8_t unfed;               /* [ms] since the watchdog was fed */
    uint8_t slow_channel;
    uint8_t is_hung, has_stopped_tick, has_stopped_adc;
} bz_native;

static void read_outputs(const bz_safety *safety, double outputs[OUTPUTS]) {
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) {
        outputs[i] = safety->muscle[i].fill / (double)BZ_PWM_COUNTS;
        outputs[BZ_MUSCLES + i] = safety->muscle[i].bleed / (double)BZ_PWM_COUNTS;
    }
    outputs[2u * BZ_MUSCLES] = safety->supply;
}

static void restart(bz_native *board, uint8_t cause) {
    bz_device_init(&board->device, cause, cause & WATCHDOG_RESET);
    board->unfed = board->is_hung = board->has_stopped_tick = board->has_stopped_adc = 0;
    read_outputs(&board->device.safety, board->outputs);
}

void bz_native_reset(bz_native *board) {
    bz_queue_clear(&board->from_host);
    bz_queue_clear(&board->to_host);
    restart(board, EXTERNAL_RESET);
}

bz_native *bz_native_new(void) {
    bz_native *board = calloc(1, sizeof *board);
    if (board) restart(board, EXTERNAL_RESET);
    return board;
}

void bz_native_free(bz_native *board) {
    free(board->from_host.bytes);
    free(board->to_host.bytes);
    free(board);
}

/* Voltages in V against a supply of 5 V; the converter rounds down. */
void bz_native_set_voltages(bz_native *board, const double voltages[CHANNELS]) {
    for (uint8_t i = 0; i < CHANNELS; i++) {
        double counts = voltages[i] * 1000.0 / BZ_SUPPLY_MV * BZ_ADC_COUNTS;
        board->readings[i] = counts <= 0 ? 0
                             : counts >= BZ_ADC_COUNTS - 1 ? BZ_ADC_COUNTS - 1
                                                           : (uint16_t)counts;
    }
}

int bz_native_write(bz_native *board, const uint8_t *bytes, size_t count) {
    return bz_queue_put(&board->from_host, bytes, count);
}

size_t bz_native_read(bz_native *board, uint8_t *to, size_t room) {
    return bz_queue_take(&board->to_host, to, room);
}

uint32_t bz_native_count_resets(const bz_native *board) { return board->resets; }

static void measure_and_control(bz_native *board) {
    bz_scan scan;
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) scan.twice[i] = (uint16_t)(2u * board->readings[i]);
    scan.reservoir = board->readings[BZ_MUSCLES];
    scan.stick_x = board->readings[BZ_MUSCLES + 1u];
    scan.stick_y = board->readings[BZ_MUSCLES + 2u];
    bz_device_scan(&board->device, &scan);
    board->unfed = 0;
    bz_device_report(&board->device);
}

static void take_test(bz_native *board) {
    uint8_t test = board->device.test;
    if (test == BZ_TEST_HANG) board->is_hung = 1;
    if (test == BZ_TEST_STOP_TICK) board->has_stopped_tick = 1;
    if (test == BZ_TEST_STOP_ADC) board->has_stopped_adc = 1;
}

static void exchange_bytes(bz_native *board) {
    uint8_t bytes[BZ_BYTES_PER_TICK];
    size_t count = bz_queue_take(&board->from_host, bytes, sizeof bytes);
    for (size_t i = 0; i < count && !board->is_hung; i++) {
        bz_device_byte(&board->device, bytes[i]);
        take_test(board);
    }
    for (count = 0; count < sizeof bytes && !bz_ring_is_empty(&board->device.sent); count++) {
        bytes[count] = bz_ring_pop(&board->device.sent);
    }
    bz_queue_put(&board->to_host, bytes, count);
}

static void step(bz_native *board) {
    if (++board->unfed > BZ_WATCHDOG_MS) {
        board->resets++;
        restart(board, WATCHDOG_RESET);
    }
    exchange_bytes(board);
    if (board->is_hung || board->has_stopped_tick) return;
    bz_device_tick(&board->device);
    if (!board->has_stopped_adc) measure_and_control(board);
}

/* Run for `ms` milliseconds; `mean` gets the outputs averaged over them. */
void bz_native_run(bz_native *board, uint32_t ms, double mean[OUTPUTS]) {
    double before[OUTPUTS];
    memset(mean, 0, sizeof before);
    for (uint32_t k = 0; k < ms; k++) {
        memcpy(before, board->outputs, sizeof before);
        step(board);
        read_outputs(&board->device.safety, board->outputs);
        for (uint8_t i = 0; i < OUTPUTS; i++) {
            mean[i] += (OUTPUT_DELAY * before[i] + (1.0 - OUTPUT_DELAY) * board->outputs[i]) / ms;
        }
    }
}

/* Code `length` bytes of a body; `body` has room for the CRC.  Returns the bytes on the wire. */
uint8_t bz_native_encode(uint8_t *body, uint8_t length, uint8_t *wire) {
    return bz_encode(body, length, wire);
}

/* Parse a stream.  Each body accepted is written to `to`, its length before it; returns the bytes
 * written, and the number of bad frames in `bad`. */
size_t bz_native_parse(const uint8_t *stream, size_t count, uint8_t *to, uint32_t *bad) {
    bz_reader reader = {.length = 0};
    size_t written = 0;
    *bad = 0;
    for (size_t i = 0; i < count; i++) {
        uint8_t length = bz_receive(&reader, stream[i]);
        if (length) {
            to[written++] = length;
            memcpy(to + written, reader.bytes, length);
            written += length;
        }
        *bad += reader.bad;
        reader.bad = 0;
    }
    return written;
}
