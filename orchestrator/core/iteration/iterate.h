/* An iterated group: its members repeat a communication step until inputs and outputs agree. */
#ifndef UUV_CORE_ITERATE_H
#define UUV_CORE_ITERATE_H

#include "tables.h"

typedef struct iteration iteration;

/* From x and r = T(y(x)) - x, which the loop begins with, to an x where they agree: the last call
 * of `evaluate` is at that x. Gives 1, or 0 and fills core->why. */
typedef int solver(uuv_core *core, iteration *it);

solver solve_fixed_point, solve_anderson, solve_newton;

struct iteration {
    solver *solve;
    uint32_t first, n_members; /* the group, in stepping order */
    uint32_t n;                /* of x: the numbers that are connected inside the group */
    uint32_t *slots;           /* of x */
    uint32_t *others, n_others; /* slots of inputs inside the group that are no numbers */
    uuv_slot *before;           /* their values before a trial */
    uint32_t restless;          /* slot of one that the last trial has changed */
    double tolerance;          /* of |r| relative to 1 + |x| */
    uint32_t limit, count;     /* iterations allowed, and made in this step */
    double *x, *r, *work;
    double *largest;           /* |x| beyond it has run away: there rounding alone makes r 0 */
    double t;
    int begun, unsettled;
    uint32_t culprit;          /* member that failed */
};

/* build.c, build_groups.c */
void free_groups(uuv_core *core);

size_t work_size(uint32_t n); /* doubles that the solvers need */
/* Repeats the step with the inputs x. Gives 1, or 0 and fills core->why. */
int evaluate(uuv_core *core, iteration *it, const double *x, double *r);
int agreed(const iteration *it, const double *x, const double *r);
/* After a trial that failed: one that ran away to infinity is a loop that did not converge. */
int ran_away(uuv_core *core, const iteration *it, const double *r);
int not_converged(uuv_core *core, const iteration *it, const double *r);
/* One communication step of the group. */
int step_group(uuv_core *core, iteration *it, double t);
/* Solves a x = b in place of b, by Gauss with partial pivoting; a is lost. 0: singular. */
int solve_dense(double *a, double *b, uint32_t n);
double norm_of(const double *v, uint32_t n);

/* How a member's state is kept and restored (restore.c). */
int save_state(member *m, uuv_failure *why);
int restore_state(member *m, uuv_failure *why);
void forget_state(member *m);

#endif
