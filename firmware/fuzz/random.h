/* A small generator of repeatable random numbers: xorshift64* (Vigna, ACM TOMS 42(4), 2016). */
#ifndef BZ_RANDOM_H
#define BZ_RANDOM_H

#include <stdint.h>

static inline uint32_t draw(uint64_t *state) {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (uint32_t)((*state * 2685821657736338717ull) >> 32);
}

#endif
