/* Wall time that a call may take; looks at the clock seldom where steps are short. */
#ifndef UUV_CORE_BUDGET_H
#define UUV_CORE_BUDGET_H

#include <time.h>

typedef struct {
    double end, last; /* [s] */
    unsigned stride, left;
} budget;

static inline double wall_seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static inline budget budget_of(double seconds) {
    const double now = wall_seconds();
    return (budget){now + seconds, now, 1, 1};
}

/* Strides double while a stride takes less than 2 ms, and halve above 20 ms. */
static inline int budget_is_spent(budget *b) {
    if (b->left--) return 0;
    const double now = wall_seconds();
    if (now - b->last < 2e-3)
        b->stride *= 2;
    else if (now - b->last > 2e-2 && b->stride > 1)
        b->stride /= 2;
    b->last = now;
    b->left = b->stride;
    return now >= b->end;
}

#endif
