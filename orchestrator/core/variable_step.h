/* A variable communication step: its length follows an estimate of what the coupling of the
 * components costs. Members whose communication step is one tick follow it; the others keep
 * theirs, and no step goes beyond the point where one of these is due.
 *
 * The estimate is the larger of two. Of each judged connection it is the difference between the
 * input that was used over the step and the value that follows from the output at its end, divided
 * by absolute + relative * |value|. Of the power bonds it is their energy residual (Sadjina et al.
 * 2017, ECCO), in the form of libcosim: the root mean square over the bonds of
 * |P_a - P_b| h / (absolute + relative * max |P_a - P_b| h). A step is judged from the second on. */
#ifndef UUV_CORE_VARIABLE_STEP_H
#define UUV_CORE_VARIABLE_STEP_H

#include "tables.h"

enum { UUV_PAST = 4 }; /* communication points that an extrapolation of order 3 needs */

typedef struct {
    uint32_t target, source, ahead; /* slots, and the place of its source in `ahead`, or UINT32_MAX */
    double factor, offset, absolute, relative;
} judged;

typedef struct {
    uint32_t input_a, output_a, input_b, output_b; /* slots; input times output is a power */
} power_bond;

/* What a snapshot keeps of it, beside the past values. */
typedef struct {
    uint64_t next;              /* ticks of the next step, unless something is due before its end */
    uint64_t known;             /* communication points in the past */
    double before;              /* estimate of the last step, 1 before the first; 0: of none */
    double times[UUV_PAST];     /* s, of the communication points, the latest first */
    uuv_step_counts counts;
} step_state;

struct variable_step {
    uuv_step_control set;
    step_state now;
    uint64_t horizon; /* no step goes beyond it */
    judged *judged;
    power_bond *bonds;
    uint32_t *sources; /* slots of outputs that are extrapolated */
    uint32_t n_judged, n_bonds, n_sources;
    double *past;      /* of each source UUV_PAST values, the latest first */
    double *ahead;     /* of each source the extrapolated value at the step's end */
    /* Before a step that may be repeated: */
    uuv_slot *slots;   /* slots, then fresh */
    uint64_t *due;     /* by member */
    step_state then;
    double *past_then;
};

/* Makes one step of its own length; gives the member that failed, or NULL. `collect` waits for the
 * members that step elsewhere. */
member *vary(uuv_core *core, member *(*step_due)(uuv_core *core, double t), void (*collect)(uuv_core *core));
/* Before the first step. 0: no memory. */
int begin_variable_step(uuv_core *core);
void free_variable_step(uuv_core *core);
size_t step_state_size(const uuv_core *core);
void put_step_state(const uuv_core *core, char *out);
void take_step_state(uuv_core *core, const char *in);

#endif
