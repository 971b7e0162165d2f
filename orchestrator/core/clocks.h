/* Clocks of FMI 3.0, for event groups (events.h).
 *
 * The master activates time-based clocks at their instants: whole parts of a tick if the instant is
 * one, else a tick and an offset in seconds. Triggered output clocks are read in each round of an
 * event iteration, and activate the triggered input clocks that they are connected to. A clocked
 * variable is read and set only while one of its clocks is active. A round ends when discrete states
 * are updated, which deactivates all clocks. */
#ifndef UUV_CORE_CLOCKS_H
#define UUV_CORE_CLOCKS_H

#include "events.h"

struct clock {
    uint32_t reference;
    uint8_t kind;       /* enum uuv_core_clock */
    uint8_t asks;       /* enum uuv_core_interval: the function for its interval */
    uint8_t active;     /* in this round */
    uint8_t ticked;     /* since its interval was asked for */
    uint8_t scheduled;  /* `next` counts */
    uint32_t n_gates;   /* clocks of the member, one of which must be active to read this one */
    uint32_t *gates;
    double interval;    /* of a periodic clock [s]; exactly `whole` ticks and `part` parts if `exact` */
    uint64_t whole, part;
    int exact;
    instant next, last;
};

/* Of a member: its clocks by priority, and FMI's functions. */
struct clocks {
    struct clock *all;
    uint32_t n;
    void *get, *set, *decimal, *fraction;
    uint32_t *references; /* of those that are set together */
};

/* Activates, at an instant, the time-based clocks of a group that are due; `any` becomes 1 if there is one. */
int activate_due_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now, int *any);
/* Carries ticks and clocked values through a group until nothing changes in this round; `any` becomes 1
 * if a clock is active. */
int carry_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now, int *any);
/* After discrete states were updated: no clock is active, and intervals are asked for. */
int end_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now);
/* The next instant of a group's time-based clocks; 0: none. */
int next_clock(const uuv_core *core, const struct event_group *g, instant *next);
int is_clock_due(const uuv_core *core, const struct event_group *g, const instant *now);
/* The instant a number of seconds after another. */
instant later(const uuv_core *core, instant from, double seconds);
/* Seconds from a communication point to an instant that is not before it. */
double seconds_from(const uuv_core *core, uint64_t tick, const instant *to);
size_t clock_state_size(const uuv_core *core);
void put_clock_state(const uuv_core *core, char *out);
void take_clock_state(uuv_core *core, const char *in);
void free_clocks(uuv_core *core);

#endif
