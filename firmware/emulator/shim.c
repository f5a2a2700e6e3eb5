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
#define SLICE_CYCLES 1600u      /* longest run between two looks for a reset */
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
#define TOP_OF_CONTROL(control) ((control) + 6u) /* ICR lies six behind TCCRA */

/* A signal between 0 and 1, and its integral over a run. */
typedef struct {
    double value;
    double area;                /* [cycles] up to the end of the run */
    double late;                /* [cycles] after it, which belong to the next run */
    avr_cycle_count_t changed;  /* cycle up to which the above is right */
} bz_signal;

struct bz_emulator;

typedef struct {
    struct bz_emulator *emulator;
    uint8_t index;
} bz_watch;

/* Both what the registers ask for and the levels of the pins are followed.  The first is what the
 * chip does: it takes a new duty over at the end of a PWM period.  simavr restarts the period
 * instead and loses a pulse, so that the pins are right only while a duty is constant. */
typedef struct bz_emulator {
    avr_t *avr;
    avr_irq_t *analog[CHANNELS];
    avr_irq_t *serial;           /* the first of the line's; UART_IRQ_INPUT is 0 */
    bz_queue from_host, to_host;
    bool is_full;                /* simavr's input, which takes 44 of the 50 bytes in a ms */
    avr_cycle_count_t target;    /* where the run ends */
    bz_signal duties[OUTPUTS], levels[OUTPUTS];
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

static void take_flow(avr_irq_t *irq, uint32_t value, void *param) {
    (void)value;
    ((bz_emulator *)param)->is_full = irq->irq == UART_IRQ_OUT_XOFF;
}

/* Bring the integral of a signal up to now, then give it a new value. */
static void set_signal(const bz_emulator *emulator, bz_signal *signal, double value) {
    avr_cycle_count_t now = emulator->avr->cycle, end = emulator->target, from = signal->changed;
    avr_cycle_count_t within = from >= end ? 0 : now < end ? now - from : end - from;
    signal->area += signal->value * (double)within;
    signal->late += signal->value * (double)(now - from - within);
    signal->changed = now;
    signal->value = value;
}

static double finish_signal(const bz_emulator *emulator, bz_signal *signal, uint64_t cycles) {
    double mean;
    set_signal(emulator, signal, signal->value);
    mean = signal->area / (double)cycles;
    signal->area = signal->late;
    signal->late = 0;
    return mean;
}

/* The duty of an output as the registers have it. */
static double read_duty(const bz_emulator *emulator, uint8_t i) {
    const uint8_t *data = emulator->avr->data;
    const bz_pin *pin = &PINS[i];
    uint16_t top = TOP_OF_CONTROL(pin->control);
    if (!(data[pin->ddr] >> pin->pin & 1u)) return pin->rest;
    if (!pin->compare || !(data[pin->control] >> pin->connect & 1u)) {
        return data[pin->ddr + 1u] >> pin->pin & 1u; /* PORT lies behind DDR */
    }
    return (data[pin->compare] + 256 * data[pin->compare + 1u] + 1) /
           (data[top] + 256 * data[top + 1u] + 1.0);
}

static void take_level(avr_irq_t *irq, uint32_t value, void *param) {
    bz_watch *watch = param;
    (void)irq;
    set_signal(watch->emulator, &watch->emulator->levels[watch->index], value & 1u);
}

static void take_registers(avr_irq_t *irq, uint32_t value, void *param) {
    bz_watch *watch = param;
    (void)irq, (void)value;
    set_signal(watch->emulator, &watch->emulator->duties[watch->index],
               read_duty(watch->emulator, watch->index));
}

static void watch_register(bz_watch *watch, uint16_t address) {
    avr_irq_register_notify(avr_iomem_getirq(watch->emulator->avr, address, NULL, AVR_IOMEM_IRQ_ALL),
                            take_registers, watch);
}

static void watch_output(bz_emulator *emulator, uint8_t i) {
    const bz_pin *pin = &PINS[i];
    bz_watch *watch = &emulator->watches[i];
    *watch = (bz_watch){emulator, i};
    emulator->levels[i].value = emulator->duties[i].value = pin->rest;
    avr_irq_register_notify(
        avr_io_getirq(emulator->avr, AVR_IOCTL_IOPORT_GETIRQ(pin->port), pin->pin), take_level, watch);
    watch_register(watch, pin->ddr);
    watch_register(watch, pin->ddr + 1u);
    if (pin->compare) {
        watch_register(watch, pin->control);
        watch_register(watch, pin->compare);
        watch_register(watch, pin->compare + 1u);
    }
}

static void watch_hardware(bz_emulator *emulator) {
    avr_t *avr = emulator->avr;
    uint32_t flags = 0;
    for (uint8_t i = 0; i < CHANNELS; i++) {
        emulator->analog[i] = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + i);
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) watch_output(emulator, i);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    emulator->serial = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(emulator->serial + UART_IRQ_OUTPUT, take_byte, emulator);
    avr_irq_register_notify(emulator->serial + UART_IRQ_OUT_XON, take_flow, emulator);
    avr_irq_register_notify(emulator->serial + UART_IRQ_OUT_XOFF, take_flow, emulator);
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

static avr_cycle_count_t feed_byte(avr_t *avr, avr_cycle_count_t when, void *param) {
    bz_emulator *emulator = param;
    uint8_t byte;
    (void)avr;
    if (emulator->is_full) return when + BYTE_CYCLES;
    if (!bz_queue_take(&emulator->from_host, &byte, 1)) return 0;
    avr_raise_irq(emulator->serial, byte);
    return when + BYTE_CYCLES;
}

static avr_cycle_count_t end_run(avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)avr, (void)when, (void)param;
    return 0; /* it is enough that the chip does not sleep past it */
}

static void set_timers(bz_emulator *emulator) {
    avr_t *avr = emulator->avr;
    if (emulator->target > avr->cycle) {
        avr_cycle_timer_register(avr, emulator->target - avr->cycle, end_run, emulator);
    }
    if (bz_queue_size(&emulator->from_host) && !avr_cycle_timer_status(avr, feed_byte, emulator)) {
        avr_cycle_timer_register(avr, BYTE_CYCLES, feed_byte, emulator);
    }
}

/* Do again what a reset undoes, and let the pins float that are no outputs. */
static void prepare(bz_emulator *emulator) {
    avr_t *avr = emulator->avr;
    for (uint8_t i = 0; i < EXTERNAL_INTERRUPTS; i++) {
        /* Otherwise simavr looks at every low pin of an external interrupt in every cycle. */
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        if (avr->data[PINS[i].ddr] >> PINS[i].pin & 1u) continue;
        set_signal(emulator, &emulator->duties[i], PINS[i].rest);
        set_signal(emulator, &emulator->levels[i], PINS[i].rest);
    }
    set_timers(emulator);
}

/* Run for `cycles`.  Cycles by which the last instruction reaches further belong to the next run.
 * `duties` and `levels` get what the registers asked for and what the pins did, averaged over the
 * run.  Returns 0 if the chip has crashed. */
int bz_emulator_run(bz_emulator *emulator, uint64_t cycles, double duties[OUTPUTS],
                    double levels[OUTPUTS]) {
    avr_t *avr = emulator->avr;
    emulator->target += cycles;
    prepare(emulator);
    while (avr->cycle < emulator->target) {
        uint8_t was_driven = avr->data[PINS[0].ddr];
        int state;
        avr->run_cycle_limit = SLICE_CYCLES;
        state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return 0;
        if (was_driven && !avr->data[PINS[0].ddr]) {
            emulator->resets++;
            emulator->is_full = false;
            prepare(emulator);
        }
    }
    for (uint8_t i = 0; i < OUTPUTS; i++) {
        duties[i] = finish_signal(emulator, &emulator->duties[i], cycles);
        levels[i] = finish_signal(emulator, &emulator->levels[i], cycles);
    }
    return 1;
}

void bz_emulator_reset(bz_emulator *emulator) {
    bz_queue_clear(&emulator->from_host);
    bz_queue_clear(&emulator->to_host);
    emulator->is_full = false;
    avr_reset(emulator->avr);
    prepare(emulator);
}

uint64_t bz_emulator_count_cycles(const bz_emulator *emulator) { return emulator->avr->cycle; }

uint32_t bz_emulator_count_resets(const bz_emulator *emulator) { return emulator->resets; }
