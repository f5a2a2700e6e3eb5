/* A growing queue of bytes, for the programs that run on the host. */
#ifndef BZ_QUEUE_H
#define BZ_QUEUE_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    uint8_t *bytes;
    size_t begin, end, room;
} bz_queue;

static inline size_t bz_queue_size(const bz_queue *queue) { return queue->end - queue->begin; }

/* Returns 0 if there is no memory. */
static inline int bz_queue_put(bz_queue *queue, const uint8_t *bytes, size_t count) {
    if (queue->begin == queue->end) queue->begin = queue->end = 0;
    if (queue->end + count > queue->room) {
        size_t room = 2u * (queue->end + count) + 256u;
        uint8_t *grown = realloc(queue->bytes, room);
        if (!grown) return 0;
        queue->bytes = grown;
        queue->room = room;
    }
    memcpy(queue->bytes + queue->end, bytes, count);
    queue->end += count;
    return 1;
}

/* Returns how many bytes were taken, `room` at most. */
static inline size_t bz_queue_take(bz_queue *queue, uint8_t *to, size_t room) {
    size_t count = bz_queue_size(queue) < room ? bz_queue_size(queue) : room;
    if (count) memcpy(to, queue->bytes + queue->begin, count);
    queue->begin += count;
    return count;
}

static inline void bz_queue_clear(bz_queue *queue) { queue->begin = queue->end = 0; }

#endif
