/* simavr behind a few functions for ctypes: one ATmega2560 in cycle-exact steps.
 *
 * simavr is GPL-3 and is linked on the user's own machine; nothing of it is in this project.
 */
#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdbool.h>

#include "queue.h"

#define FREQUENCY 16000000u     /* [Hz] */
#define BYTE_CYCLES 320u        /* 10 bit at 500 kbaud */
#define SLICE_CYCLES 1600u      /* longest run between two looks at the serial line */
#define EXTERNAL_INTERRUPTS 8u
#define CHANNELS 6u             /* muscles 1 to 3, reservoir, stick x, stick y */
#define OUTPUTS 7u              /* fill valves 1 to 3, bleed valves 1 to 3, supply valve */

/* simavr takes the reference voltage in a unit of its own choice as 16 bit; 0.1 mV is the finest. */
#define SUPPLY 50000u           /* [0.1 mV] */

typedef struct {
    char port;
    uint8_t pin;
    bool rest;                  /* level when the pin floats: the pull resistor at the driver */
    uint16_t ddr, compare, control; /* data addresses; compare 0: no PWM */
    uint8_t connect;            /* bit of the control register that connects the PWM */
} bz_pin;

/* ATmega640/1280/1281/2560/2561 data sheet, register summary. */
static const bz_pin PINS[OUTPUTS] = {
    {'L', 3, false, 0x10A, 0x128, 0x120, 7}, {'L', 4, false, 0x10A, 0x12A, 0x120, 5},
    {'L', 5, false, 0x10A, 0x12C, 0x120, 3}, {'H', 3, true, 0x101, 0xA8, 0xA0, 7},
    {'H', 4, true, 0x101, 0xAA, 0xA0, 5},    {'H', 5, true, 0x101, 0xAC, 0xA0, 3},
    {'A', 0, false, 0x21, 0, 0, 0},
};
#define TOP_OF_COMPARE(compare) ((compare) - 2u) /* ICR lies before OCRA */

struct bz_emulator;

typedef struct {
    struct bz_emulator *emulator;
    uint8_t index;
} bz_watch;

typedef struct bz_emulator {
    avr_t *avr;
    avr_irq_t *analog[CHANNELS], *serial;
    bz_queue from_host, to_host;
    avr_cycle_count_t target;           /* where the next run ends */
    avr_cycle_count_t next_byte;        /* earliest cycle for the next byte from the host */
    avr_cycle_count_t changed[OUTPUTS]; /* cycle of the last change of a pin */
    avr_cycle_count_t high[OUTPUTS];    /* cycles high in this run */
    bool level[OUTPUTS];
    bz_watch watches[OUTPUTS];
    uint32_t resets;
} bz_emulator;

static void no_sleep(avr_t *avr, avr_cycle_count_t duration) {
    (void)avr;
    (void)duration;
}

static void take_byte(avr_irq_t *irq, uint32_t value, void *param) {
    uint8_t byte = (uint8_t)value;
    (void)irq;
    bz_queue_put(&((bz_emulator *)param)->to_host, &byte, 1);
}

/* Count the time that a pin was high up to now. */
static void settle(bz_emulator *emulator, uint8_t i) {
    avr_cycle_count_t now = emulator->avr->cycle;
    if (emulator->level[i]) emulator->high[i] += now - emulator->changed[i];
    emulator->changed[i] = now;
}

static void take_level(avr_irq_t *irq, uint32_t value, void *param) {
    bz_watch *watch = param;
    (void)irq;
    settle(watch->emulator, watch->index);
    watch->emulator->level[watch->index] = value & 1u;
}

static void watch_hardware(bz_emulator *emulator) {
    avr_t *avr = emulator->avr;
    uint32_t flags = 0;
    for (uint8_t i = 0; i < CHANNELS; i++) {
        emulator->analog[i] = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + i);
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        emulator->watches[i] = (bz_watch){emulator, i};
        emulator->level[i] = PINS[i].rest;
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(PINS[i].port), PINS[i].pin), take_level,
            &emulator->watches[i]);
    }
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    emulator->serial = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), take_byte, emulator);
}

static void be_silent(avr_t *avr, const int level, const char *format, va_list arguments) {
    (void)avr, (void)level, (void)format, (void)arguments;
}

void bz_emulator_free(bz_emulator *emulator) {
    if (emulator->avr) avr_terminate(emulator->avr);
    free(emulator->avr);
    free(emulator->from_host.bytes);
    free(emulator->to_host.bytes);
    free(emulator);
}

/* Returns a null pointer if the file is no program, or without memory. */
bz_emulator *bz_emulator_new(const char *path) {
    bz_emulator *emulator = calloc(1, sizeof *emulator);
    elf_firmware_t program;
    avr_t *avr;
    if (!emulator) return NULL;
    memset(&program, 0, sizeof program);
    avr_global_logger_set(be_silent);
    emulator->avr = avr = avr_make_mcu_by_name("atmega2560");
    if (!avr || elf_read_firmware(path, &program) != 0 || program.flashsize == 0) {
        free(avr);
        free(emulator);
        return NULL;
    }
    avr_init(avr);
    avr_load_firmware(avr, &program);
    avr->frequency = FREQUENCY;
    avr->vcc = avr->avcc = avr->aref = SUPPLY;
    avr->sleep = no_sleep;
    watch_hardware(emulator);
    return emulator;
}

/* Voltages in V.  The chip converts with 1024 counts for the reference and simavr with 1023, so
 * simavr gets the least voltage that it converts to the chip's count. */
void bz_emulator_set_voltages(bz_emulator *emulator, const double voltages[CHANNELS]) {
    for (uint8_t i = 0; i < CHANNELS; i++) {
        double counts = voltages[i] * 1e4 / SUPPLY * 1024.0;
        uint32_t count = counts <= 0 ? 0 : counts >= 1023 ? 1023 : (uint32_t)counts;
        avr_raise_irq(emulator->analog[i], (count * SUPPLY + 1022u) / 1023u);
    }
}

int bz_emulator_write(bz_emulator *emulator, const uint8_t *bytes, size_t count) {
    return bz_queue_put(&emulator->from_host, bytes, count);
}

size_t bz_emulator_read(bz_emulator *emulator, uint8_t *to, size_t room) {
    return bz_queue_take(&emulator->to_host, to, room);
}

static void feed_byte(bz_emulator *emulator) {
    uint8_t byte;
    avr_cycle_count_t now = emulator->avr->cycle;
    if (now < emulator->next_byte || !bz_queue_take(&emulator->from_host, &byte, 1)) return;
    /* Bytes that wait follow each other without a gap. */
    emulator->next_byte = (now - emulator->next_byte < BYTE_CYCLES ? emulator->next_byte : now) + BYTE_CYCLES;
    avr_raise_irq(emulator->serial, byte);
}

/* A reset lets all pins float and forgets what of the emulator is set here. */
static void look_for_reset(bz_emulator *emulator) {
    avr_t *avr = emulator->avr;
    for (uint8_t i = 0; i < EXTERNAL_INTERRUPTS; i++) {
        /* Otherwise simavr looks at every low pin of an external interrupt in every cycle. */
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        bool floats = !(avr->data[PINS[i].ddr] >> PINS[i].pin & 1u);
        if (floats && emulator->level[i] != PINS[i].rest) {
            settle(emulator, i);
            emulator->level[i] = PINS[i].rest;
        }
    }
}

/* Run for `cycles`; `mean` gets the levels of the outputs averaged over them.  Cycles by which the
 * last instruction reached further are taken off the next run.  Returns 0 if the chip has crashed. */
int bz_emulator_run(bz_emulator *emulator, uint64_t cycles, double mean[OUTPUTS]) {
    avr_t *avr = emulator->avr;
    avr_cycle_count_t begin = avr->cycle;
    memset(emulator->high, 0, sizeof emulator->high);
    for (uint8_t i = 0; i < OUTPUTS; i++) emulator->changed[i] = begin;
    emulator->target += cycles;
    look_for_reset(emulator);
    while (avr->cycle < emulator->target) {
        avr_cycle_count_t left = emulator->target - avr->cycle;
        avr_cycle_count_t limit = bz_queue_size(&emulator->from_host) ? BYTE_CYCLES / 4u : SLICE_CYCLES;
        uint16_t was = avr->data[PINS[0].ddr];
        int state;
        feed_byte(emulator);
        avr->run_cycle_limit = left < limit ? left : limit;
        state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return 0;
        if (was && !avr->data[PINS[0].ddr]) {
            emulator->resets++;
            look_for_reset(emulator);
        }
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        settle(emulator, i);
        mean[i] = (double)emulator->high[i] / (double)(avr->cycle - begin);
    }
    return 1;
}

void bz_emulator_reset(bz_emulator *emulator) {
    bz_queue_clear(&emulator->from_host);
    bz_queue_clear(&emulator->to_host);
    avr_reset(emulator->avr);
    look_for_reset(emulator);
}

/* The outputs as the registers have them now, from 0 to 1. */
void bz_emulator_read_registers(const bz_emulator *emulator, double duties[OUTPUTS]) {
    const uint8_t *data = emulator->avr->data;
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        const bz_pin *pin = &PINS[i];
        uint16_t port = pin->ddr + 1u, top = pin->compare ? TOP_OF_COMPARE(pin->compare) : 0;
        if (!(data[pin->ddr] >> pin->pin & 1u)) {
            duties[i] = pin->rest;
        } else if (pin->compare && data[pin->control] >> pin->connect & 1u) {
            duties[i] = (data[pin->compare] + 256 * data[pin->compare + 1u] + 1) /
                        (data[top] + 256 * data[top + 1u] + 1.0);
        } else {
            duties[i] = data[port] >> pin->pin & 1u;
        }
    }
}

uint64_t bz_emulator_count_cycles(const bz_emulator *emulator) { return emulator->avr->cycle; }

uint32_t bz_emulator_count_resets(const bz_emulator *emulator) { return emulator->resets; }
