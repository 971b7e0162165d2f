/* What a generated component offers, and an instance of it.
 *
 * All variables of an instance lie in one block of W-lane values V (W = 1 in FMUs and native
 * components): time, inputs, parameters, derived values, continuous states, discrete states,
 * outputs, in this order. Derivatives of the states follow it. A variable's value reference is its offset in the block; element i
 * of an array has the value reference of the array plus i. Int32 and Boolean variables are
 * stored as doubles.
 */
#ifndef UUV_COMPONENT_H
#define UUV_COMPONENT_H

#include <stddef.h>
#include <stdint.h>

#include "uuv_math.h"

/* As many instances with at most so many states are stepped side by side. */
enum { UUV_TOGETHER = 8, UUV_SMALL = 4 };

enum uuv_type { UUV_FLOAT64 = 0, UUV_INT32 = 1, UUV_BOOLEAN = 2 };
enum uuv_kind { UUV_TIME = 0, UUV_INPUT, UUV_FIXED, UUV_TUNABLE, UUV_LOCAL, UUV_OUTPUT, UUV_DERIVATIVE };

typedef struct {
    const char *name;
    uint32_t offset; /* in the block: the value reference of its first element */
    uint32_t size;   /* number of elements; 1 also for a scalar */
    uint8_t type;    /* enum uuv_type */
    uint8_t kind;    /* enum uuv_kind */
    uint8_t array;   /* 0: a scalar */
    uint8_t soft_min; /* a value below min is reported, not refused: FMI shells alone read it */
    double min, max; /* -inf, inf where there is none */
} uuv_variable;

typedef struct {
    uint64_t period_num, period_den; /* period in seconds, a fraction in lowest terms */
    uint32_t n_draws;                /* standard normals that one tick consumes */
    uint32_t index;                  /* the "variable number" in the key of its draws */
    void (*update)(V *b, const V *draws, uuv_mask due); /* writes discrete states */
} uuv_clock;

typedef struct {
    const char *name;
    const char *token; /* FMI's instantiationToken / guid */
    uint32_t n_block;
    uint32_t off_x, n_x, off_z, n_z, off_y, n_y, off_u, n_u;
    int32_t off_seed; /* offset of the parameter seed[2], or -1 */
    uint32_t n_clocks;
    const uuv_clock *clocks;
    double h_max;        /* longest RK4 sub-step [s] */
    const double *start; /* n_block start values; states and outputs: 0 */
    uint32_t n_variables;
    const uuv_variable *variables; /* sorted by offset */
    void (*derived)(V *b);          /* parameters -> derived values */
    void (*initial)(V *b);          /* parameters -> states */
    uint32_t n_held; /* values of the derivatives that do not change within a step: their space is `w` */
    void (*derivatives)(const V *b, V *w, V *dx); /* n_x of them */
    /* n Runge-Kutta steps of length h [s] from time t, of m <= UUV_TOGETHER instances; then each `w`
     * has what is held */
    void (*integrate)(V *const *b, V *const *w, uint32_t m, double t, double h, uint32_t n);
    void (*outputs)(V *b); /* -> outputs */
    void (*outputs_of_step)(V *b, const V *w); /* the same, after `integrate` */
    /* forward derivative at b: seeds [u, x] (n_u + n_x) -> sensitivities [y, dx] */
    void (*forward)(const V *b, const V *seed, V *sensitivity);
} uuv_component;

/* The instant of tick k of a clock [s]. */
typedef struct {
    uint64_t k;
    double t;
} uuv_instant;

typedef struct {
    const uuv_component *component;
    V *b;          /* the block, n_block values, and n_x derivatives */
    uint64_t *k;   /* next sample index of each clock */
    V *scratch;    /* work space of do_step */
    int dirty;     /* parameters changed: derived values are stale */
    int outputs_stale;
    int initialized; /* initialization mode has been left */
    uuv_instant *next; /* of each clock: an instant, which holds if its tick is the next sample */
} uuv_instance;

/* Where the stepping loop of this package reads and writes the values of a component of its own. An
 * FMU finds them by `uuv_values_1`, whose number changes with the meaning of these fields. */
typedef struct uuv_values {
    double *block;    /* by value reference */
    const int *dirty; /* as in uuv_instance */
    int *outputs_stale;
} uuv_values;
typedef void uuv_values_function(const void *component, uuv_values *values);
/* A step of n instances of one component: `uuv_do_steps`, or an FMU's `uuv_fmi2_steps_1`, `uuv_fmi3_steps_1`. */
typedef uint32_t uuv_steps_function(void *const *components, uint32_t n, double t, double h, int32_t *status);

/* What a generated file provides. */
#if defined(_WIN32)
#define UUV_EXPORT __declspec(dllexport)
#else
#define UUV_EXPORT __attribute__((visibility("default")))
#endif
extern const uuv_component uuv_the_component;

/* uuv_runtime.c */
UUV_EXPORT const uuv_component *uuv_get_component(void);
UUV_EXPORT uuv_instance *uuv_instantiate(const uuv_component *c);
UUV_EXPORT void uuv_free(uuv_instance *s);
UUV_EXPORT void uuv_reset(uuv_instance *s);
/* Computes derived values, and states where initialization has not been left. */
UUV_EXPORT void uuv_refresh(uuv_instance *s);
/* Time begins at start_time [s]. */
UUV_EXPORT void uuv_enter_initialization(uuv_instance *s, double start_time);
UUV_EXPORT void uuv_exit_initialization(uuv_instance *s);
/* Computes outputs if inputs, parameters or states changed since. */
UUV_EXPORT void uuv_update_outputs(uuv_instance *s);
/* Computes the derivatives of the states at the present values. */
UUV_EXPORT void uuv_update_derivatives(uuv_instance *s);
/* Model Exchange: takes the samples due at t [s], and says when the next is due (inf: never). */
UUV_EXPORT void uuv_take_samples(uuv_instance *s, double t);
UUV_EXPORT double uuv_next_sample(const uuv_instance *s);
/* Forward derivative at the present values: seeds [u, x] -> sensitivities [y, dx]. */
UUV_EXPORT void uuv_forward(const uuv_instance *s, const V *seed, V *sensitivity);
/* Advances from t by h [s]; returns 0, or 1 + offset of the first value that is not finite. */
UUV_EXPORT int32_t uuv_do_step(uuv_instance *s, double t, double h);
/* The same for n instances of one component, with the same bits. Returns the number of those before
 * the first that fails, whose result becomes `*bad`. */
UUV_EXPORT uint32_t uuv_do_steps(uuv_instance *const *s, uint32_t n, double t, double h, int32_t *bad);
/* Size in bytes of a state of the instance, and copies out and in. */
UUV_EXPORT size_t uuv_state_size(const uuv_instance *s);
UUV_EXPORT void uuv_get_state(const uuv_instance *s, void *out);
UUV_EXPORT void uuv_set_state(uuv_instance *s, const void *in);
/* Start value of the variables of the instance: finds one by offset, NULL if none starts there. */
UUV_EXPORT const uuv_variable *uuv_find(const uuv_component *c, uint32_t offset);

#endif
