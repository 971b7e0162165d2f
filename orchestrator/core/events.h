/* Events across FMUs of FMI 3.0: Event Mode, and steps that end early.
 *
 * Members that use Event Mode, that are connected to each other, and that have equal communication
 * steps are an event group. Its step begins with their inputs, as every step does. If a member
 * returns early at t*, each member that went further gets its state at the step's start, or the last
 * event, and repeats its step to t*. If a member reports an event there, all of the group enter Event
 * Mode: outputs go to inputs, and discrete states are updated, until nothing changes. Then they go on
 * to the step's end. All others see values at communication points only. */
#ifndef UUV_CORE_EVENTS_H
#define UUV_CORE_EVENTS_H

#include "tables.h"

enum { UUV_MOST_ROUNDS = 100 };     /* of an event iteration */
enum { UUV_MOST_EVENTS = 100000 };  /* parts of one communication step */

/* Of a member that uses Event Mode. */
struct event_mode {
    void *enter, *update, *leave; /* fmi3EnterEventMode, fmi3UpdateDiscreteStates, fmi3EnterStepMode */
    uint32_t group;
    int repeats; /* it restores its state, so that a step can be repeated */
    int32_t *inside; /* 1: it is in Event Mode, in which discrete inputs are set; the caller's, who sets it too */
    struct clocks *clocks; /* (clocks.h), or NULL */
    /* Of the last step: */
    int needed, early;
    double reached; /* where it ended if it ended early */
};

struct event_group {
    member **members;
    uint32_t n;
};

/* Finds the event groups, once the tables are complete. 0: no memory. */
int find_event_groups(uuv_core *core);
/* The first event iteration, at the start; `at` is the member that failed. */
int begin_events(uuv_core *core, member **at);
/* Steps the event group of a member; `at` becomes the one that failed. */
int step_event_group(uuv_core *core, member **at, double t);
void free_events(uuv_core *core);
int note_event(uuv_core *core, const member *m, uint64_t tick, double offset, int cause);
/* Carries a value to an input; if it `counts`, `changed` becomes 1 when the input had another one. */
int carry_value(uuv_core *core, const transfer *t, int counts, int *changed);

/* In components/fmi3.c. */
extern const kind kind_fmi3_events;
int fmi3_update_discrete_states(member *m, int *again, uuv_failure *why);
int fmi3_change_mode(member *m, int inside, uuv_failure *why);
int fmi3_set_access(member *m, const access *a, const uuv_slot *slots, uuv_failure *why);
int fmi3_get_access(member *m, const access *a, uuv_slot *slots, uuv_failure *why);
int fmi3_get_clock(member *m, uint32_t reference, int *active, uuv_failure *why);
int fmi3_set_clocks(member *m, const uint32_t *references, uint32_t n, uuv_failure *why); /* active */
int fmi3_get_interval(member *m, uint32_t reference, int fraction, double *interval, int *qualifier,
                      uuv_failure *why);

#endif
