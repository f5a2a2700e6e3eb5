/* ATmega2560 at 16 MHz (Arduino Mega 2560): clocks, pins and interrupts round the device.
 *
 *   muscle           1           2           3
 *   fill valve       D46 PL3     D45 PL4     D44 PL5    PWM of timer 5; pull-down at the driver
 *   bleed valve      D6  PH3     D7  PH4     D8  PH5    PWM of timer 4; pull-up at the driver
 *   pressure         A0          A1          A2         reservoir A3, stick x A4, stick y A5
 *   supply valve     D22 PA0                            normally closed; pull-down at the driver
 *   host             UART 0 (USB)
 *
 * Every millisecond timer 0 starts a chain of seven conversions, 104 us each: muscles 1, 2, 3, 1,
 * 2, 3 and one of reservoir and stick in turn.  The main program then controls and sets the valves.
 * The watchdog is fed there and nowhere else: only a complete measurement and control pass does it.
 *
 * While the chip is in reset its pins float: the pull resistors above hold the valves in the safe
 * position.  A boot loader that clears MCUSR or that does not stop the watchdog defeats the latched
 * watchdog fault: program the board without one, over ISP.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "device.h"

#define SUPPLY _BV(PA0)
#define FILL (_BV(PL3) | _BV(PL4) | _BV(PL5))
#define BLEED (_BV(PH3) | _BV(PH4) | _BV(PH5))

#define CHAIN 7u        /* conversions of one measurement */
#define CHANNELS 6u     /* muscles 1 to 3, reservoir, stick x, stick y */

static bz_device device;
static bz_ring received;
static volatile uint8_t ticks;            /* [ms], wraps */
static volatile uint8_t chain = CHAIN;    /* conversions done of this measurement */
static volatile uint8_t is_measured;
static volatile uint8_t missed;           /* ticks that found the measurement before incomplete */
static volatile uint16_t readings[CHANNELS]; /* [counts]; of the muscles the sum of two */
static uint8_t slow_channel = BZ_MUSCLES; /* reservoir and stick take turns */

static uint8_t reset_cause __attribute__((section(".noinit")));

void start(void) __attribute__((naked, used, section(".init3")));

/* Runs before any variable is set: valves in the safe position, watchdog on. */
void start(void) {
    PORTL = 0;
    PORTH = BLEED;
    PORTA = 0;
    DDRL = FILL;
    DDRH = BLEED;
    DDRA = SUPPLY;
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
    wdt_enable(WDTO_15MS);
}

static uint8_t find_channel(uint8_t place) {
    if (place >= 2u * BZ_MUSCLES) return slow_channel;
    return place >= BZ_MUSCLES ? (uint8_t)(place - BZ_MUSCLES) : place;
}

static void convert_next(void) {
    ADMUX = (uint8_t)(_BV(REFS0) | find_channel(chain)); /* reference: the supply, AVCC */
    ADCSRA |= _BV(ADSC);
}

ISR(TIMER0_COMPA_vect) {
    ticks++;
    if (chain < CHAIN || is_measured) { /* not before the readings are taken: they stay whole */
        missed++;
        return;
    }
    chain = 0;
    convert_next();
}

ISR(ADC_vect) {
    uint8_t place = chain;
    uint8_t channel = find_channel(place);
    uint16_t reading = ADC;
    if (place >= BZ_MUSCLES && place < 2u * BZ_MUSCLES) reading += readings[channel];
    readings[channel] = reading;
    chain = ++place;
    if (place < CHAIN) {
        convert_next();
    } else {
        slow_channel = slow_channel + 1u < CHANNELS ? (uint8_t)(slow_channel + 1u) : BZ_MUSCLES;
        is_measured = 1;
    }
}

ISR(USART0_RX_vect) { bz_ring_push(&received, UDR0); }

ISR(USART0_UDRE_vect) {
    if (bz_ring_is_empty(&device.sent)) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    } else {
        UDR0 = bz_ring_pop(&device.sent);
    }
}

static void set_up(void) {
    /* PWM: fast, top in ICR, 20 kHz; the outputs stay disconnected until a duty needs them. */
    ICR4 = ICR5 = BZ_PWM_COUNTS - 1;
    TCCR4A = TCCR5A = _BV(WGM41);
    TCCR4B = TCCR5B = _BV(WGM43) | _BV(WGM42) | _BV(CS40);
    /* Ticks: 16 MHz / 64 / 250. */
    OCR0A = 249;
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    TIMSK0 = _BV(OCIE0A);
    /* Clock of the loop time: 0.5 us. */
    TCCR1B = _BV(CS11);
    /* ADC clock: 16 MHz / 128. */
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
    /* UART: 8N1; simavr takes the double rate into account only if it is set before the divider. */
    UCSR0A = _BV(U2X0);
    UBRR0 = F_CPU / 8ul / BZ_BAUD - 1ul;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

/* 0 and 100 % are levels of the pin, without PWM: a compare register of 0 would give a spike. */
static void set_valve(volatile uint8_t *control, uint8_t connect, volatile uint8_t *port, uint8_t pin,
                      volatile uint16_t *compare, uint16_t duty) {
    uint8_t is_pwm = duty > 0 && duty < BZ_PWM_COUNTS;
    if (is_pwm) {
        *compare = duty - 1u; /* taken over at the end of the period */
        if (!(*control & connect)) *control |= connect;
    } else {
        if (*control & connect) *control &= (uint8_t)~connect;
        if (duty) {
            *port |= pin;
        } else {
            *port &= (uint8_t)~pin;
        }
    }
}

/* The valve that shuts is set before the one that opens. */
static void set_pair(uint8_t i, volatile uint16_t *fill, volatile uint16_t *bleed) {
    const bz_muscle *muscle = &device.safety.muscle[i];
    uint8_t connect = (uint8_t)(_BV(COM4A1) >> (2u * i));
    uint8_t pin = (uint8_t)(_BV(PH3) << i); /* PL3 and PH3 are the same bit */
    if (muscle->fill == 0) set_valve(&TCCR5A, connect, &PORTL, pin, fill, 0);
    set_valve(&TCCR4A, connect, &PORTH, pin, bleed, muscle->bleed);
    if (muscle->fill != 0) set_valve(&TCCR5A, connect, &PORTL, pin, fill, muscle->fill);
}

static void set_outputs(void) {
    if (!device.safety.supply) PORTA &= (uint8_t)~SUPPLY;
    set_pair(0, &OCR5A, &OCR4A);
    set_pair(1, &OCR5B, &OCR4B);
    set_pair(2, &OCR5C, &OCR4C);
    if (device.safety.supply) PORTA |= SUPPLY;
}

static void take_measurement(bz_scan *scan) {
    for (uint8_t i = 0; i < BZ_MUSCLES; i++) scan->twice[i] = readings[i];
    scan->reservoir = readings[BZ_MUSCLES];
    scan->stick_x = readings[BZ_MUSCLES + 1u];
    scan->stick_y = readings[BZ_MUSCLES + 2u];
    is_measured = 0; /* now the next chain may start */
}

static void sleep_until_interrupt(uint8_t handled) {
    cli();
    if (handled == ticks && !is_measured && bz_ring_is_empty(&received)) {
        sleep_enable();
        sei();
        sleep_cpu(); /* the instruction after sei is executed before any interrupt */
        sleep_disable();
    }
    sei();
}

#ifdef BZ_TEST
static void run_test(void) {
    if (device.test == BZ_TEST_STOP_ADC) ADCSRA = 0;
    if (device.test == BZ_TEST_STOP_TICK) TIMSK0 = 0;
    while (device.test == BZ_TEST_HANG) {
    }
}
#endif

int main(void) {
    uint8_t handled = 0; /* ticks */

    set_up();
    bz_device_init(&device, reset_cause, reset_cause & _BV(WDRF));
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;) {
        sleep_until_interrupt(handled);
        while (!bz_ring_is_empty(&received)) bz_device_byte(&device, bz_ring_pop(&received));
        if (handled != ticks) {
            handled++;
            bz_device_tick(&device);
            set_outputs();
        }
        if (is_measured) {
            uint16_t begin = TCNT1, duration;
            bz_scan scan;
            take_measurement(&scan);
            bz_device_scan(&device, &scan);
            set_outputs();
            device.missed = missed;
            wdt_reset();
            bz_device_report(&device);
            duration = (uint16_t)(TCNT1 - begin) / 2u;
            if (duration > device.loop_us) device.loop_us = duration;
        }
        if (!bz_ring_is_empty(&device.sent)) UCSR0B |= _BV(UDRIE0);
#ifdef BZ_TEST
        run_test();
#endif
    }
}
