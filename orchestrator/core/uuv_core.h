/* The stepping loop's public face: build the tables of a plan, then run communication steps.
 *
 * Every value lives in a slot of 8 bytes. The caller numbers the slots, fills in the members
 * (the plan's components, in stepping order), their grouped reads and writes, and the transfers
 * between slots; `uuv_core_run` does the rest without Python.
 */
#ifndef UUV_CORE_H
#define UUV_CORE_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define UUV_CORE_API __declspec(dllexport)
#else
#define UUV_CORE_API __attribute__((visibility("default")))
#endif

/* Text or bytes in memory that the core owns; `data` always ends with a zero byte. */
typedef struct {
    char *data;
    size_t size, capacity;
} uuv_blob;

/* By class of its type: double, int64, uint64, Boolean as 0 or 1 in `u`, pointer to a blob. */
typedef union {
    double f;
    int64_t i;
    uint64_t u;
    uuv_blob *blob;
} uuv_slot;

enum uuv_core_kind { UUV_CORE_NATIVE = 1, UUV_CORE_FMI2, UUV_CORE_FMI3, UUV_CORE_CALLBACK,
                     UUV_CORE_SHARED /* its instance is a `uuv_exchange` (exchange.h) */,
                     UUV_CORE_FMI1 };

enum uuv_core_type {
    UUV_CORE_FLOAT64 = 0, UUV_CORE_FLOAT32,
    UUV_CORE_INT8, UUV_CORE_INT16, UUV_CORE_INT32, UUV_CORE_INT64,
    UUV_CORE_UINT8, UUV_CORE_UINT16, UUV_CORE_UINT32, UUV_CORE_UINT64,
    UUV_CORE_BOOLEAN, UUV_CORE_STRING, UUV_CORE_BINARY
};

enum uuv_core_outcome {
    UUV_CORE_GOOD = 0,
    UUV_CORE_BAD_STATUS,       /* `status` is what the component returned; `slot` the first of a
                                  failed read or write */
    UUV_CORE_NOT_FINITE,       /* output in `slot` */
    UUV_CORE_STATE_NOT_FINITE, /* native value at offset `status` */
    UUV_CORE_OUT_OF_RANGE,     /* value in `slot` does not fit the input's integer type */
    UUV_CORE_ENDED,            /* the component asks to end the simulation; status 1: at the step's end */
    UUV_CORE_EARLY_RETURN,     /* the component ended its step before the step's end */
    UUV_CORE_NO_MEMORY,
    UUV_CORE_NOT_CONVERGED,    /* an iterated group: `status` iterations leave `residual` at the
                                  input in `slot`; 0: it is no number, and changes each time */
    UUV_CORE_NOT_RESTORED,     /* after its state was restored, the output in `slot` has another value */
    UUV_CORE_EVENTS_DO_NOT_END, /* the event iteration at the time `residual` [s]; `status` 1: the member
                                  wants another round, 0: the input in `slot` changes each time, 2: its
                                  clock number `slot` ticks each time */
    UUV_CORE_NO_PROGRESS,      /* it returned early at the time `residual` [s] where it began; `status` 1:
                                  there are too many events in one step */
    UUV_CORE_NOT_REPEATED,     /* it returned early at the time `residual` [s], and the member `slot` cannot
                                  repeat its step */
    UUV_CORE_BAD_INTERVAL      /* the clock number `slot` gave the interval `value` [s] at the time `residual` [s] */
};

enum uuv_core_action { UUV_CORE_SET = 1, UUV_CORE_DO_STEP, UUV_CORE_GET, UUV_CORE_GET_STATE,
                       UUV_CORE_SET_STATE, UUV_CORE_ENTER_EVENT_MODE,
                       UUV_CORE_UPDATE_DISCRETE_STATES, UUV_CORE_ENTER_STEP_MODE, UUV_CORE_GET_CLOCK,
                       UUV_CORE_SET_CLOCK, UUV_CORE_GET_INTERVAL_DECIMAL, UUV_CORE_GET_INTERVAL_FRACTION };

/* Why the loop stopped: which member, doing what, at which communication point. */
typedef struct {
    int32_t outcome, status, action;
    uint32_t member, slot;
    uint64_t tick;
    double residual, value;
} uuv_failure;

/* Functions of a callback member, whose instance is its status. The loop sets the status to
 * UUV_CORE_INCOMPLETE before each call, because a Python function that a signal interrupts cannot
 * report it; a call that is complete sets it to 0, and any other value stops the loop. `in` and
 * `out` are the member's input and output slots, ordered by type (as above), then as described. */
enum { UUV_CORE_INCOMPLETE = 3 };
typedef void uuv_callback_do_step(int32_t *status, double t, double h, const uuv_slot *in);
typedef void uuv_callback_get(int32_t *status, uuv_slot *out);
typedef void uuv_callback_state(int32_t *status);

typedef struct uuv_core uuv_core;
struct uuv_frame;

/* One tick is num / den seconds. NULL: no memory. */
UUV_CORE_API uuv_core *uuv_core_new(uint32_t n_members, uint32_t n_slots, uint64_t num, uint64_t den);
UUV_CORE_API void uuv_core_free(uuv_core *core);

/* Building: 1 is success, 0 no memory. `get`: UpdateOutputs of a native member, the callback's
 * get, else NULL. `kept`: of an FMU, becomes 1 once a state of the run is kept, by the caller or
 * by an iterated group; until then its steps say that the FMU will not be set back. `sequential`:
 * outputs are read right after the step (Gauss-Seidel). */
UUV_CORE_API int uuv_core_member(uuv_core *core, uint32_t member, int kind, void *instance,
                                 void *do_step, void *get, int32_t *kept, uint64_t step_ticks,
                                 int sequential);
/* The path of a component, which must live as long as the core: for `uuv_core_guard`. */
UUV_CORE_API void uuv_core_name(uuv_core *core, uint32_t member, const char *name);
/* Where it is noted which function of which component is being called (uuv_guard.h); NULL: nowhere. */
UUV_CORE_API void uuv_core_guard(uuv_core *core, void (*enter)(struct uuv_frame *),
                                 void (*leave)(struct uuv_frame *));
/* One grouped call: `n_values` slots from `slot` on, of one type. `function` is the FMI getter
 * or setter; native members take one offset in their block for each value instead. */
UUV_CORE_API int uuv_core_access(uuv_core *core, uint32_t member, int action, int type,
                                 uint32_t slot, uint32_t n_values, uint32_t n_references,
                                 const uint32_t *references, void *function);
/* Slot `slot` of an FMU of FMI 1.0 is a negated alias: the FMU has its value with the opposite sign.
 * After the accesses of the member. */
UUV_CORE_API int uuv_core_negate(uuv_core *core, uint32_t member, uint32_t slot);
/* The component was compiled by this package, so that its values are read and written in its block
 * (uuv_component.h): `find` finds it (NULL: of a native member), `steps` makes a step of several equal
 * members, `offsets` are those of the inputs and
 * then the outputs in the order of their slots, `low` and `high` the bounds of the inputs. A value
 * outside is left to the component's own setter, which refuses it. */
struct uuv_values;
UUV_CORE_API int uuv_core_in_place(uuv_core *core, uint32_t member,
                                   void (*find)(const void *instance, struct uuv_values *values),
                                   uint32_t (*steps)(void *const *instances, uint32_t n, double t, double h,
                                                     int32_t *status),
                                   const uint32_t *offsets, const double *low, const double *high);
/* `early` 1: the source's new value is seen if it stepped in the same tick (Gauss-Seidel);
 * 2: both are in one iterated group. With `pairs`, the source's value and the target's, each of
 * `n_pairs` times, a value becomes what they say, and no other value may come. */
UUV_CORE_API int uuv_core_transfer(uuv_core *core, uint32_t target, uint32_t source,
                                   uint32_t target_slot, uint32_t source_slot, int early,
                                   double factor, double offset, uint32_t n_pairs,
                                   const int64_t *pairs);
/* How the state of a member is copied, if it is native or of an iterated group: FMI's functions,
 * or `uuv_get_state` and `uuv_set_state` with the size, or `uuv_callback_state`. */
UUV_CORE_API int uuv_core_state(uuv_core *core, uint32_t member, void *get, void *set, void *free,
                                size_t size);
enum uuv_core_solver { UUV_CORE_NEWTON = 0, UUV_CORE_ANDERSON, UUV_CORE_FIXED_POINT };
/* Makes an iterated group of members that follow each other, after their transfers. */
UUV_CORE_API int uuv_core_iterate(uuv_core *core, uint32_t first, uint32_t n_members, int solver,
                                  double tolerance, uint32_t limit);
/* Frees copies of states; to be called while the members' instances live. */
UUV_CORE_API void uuv_core_forget(uuv_core *core);
/* What others see of a number in an output slot, from the member's next output on: `value` instead
 * of it, added to it, times it; the present value for good; `n` samples late; or, with probability
 * `value` at each sample, the last that came through. `seed` decides which are dropped. */
enum uuv_core_fault_kind { UUV_CORE_OVERRIDE = 1, UUV_CORE_BIAS, UUV_CORE_SCALE, UUV_CORE_FREEZE,
                           UUV_CORE_DELAY, UUV_CORE_DROP };
UUV_CORE_API int uuv_core_fault(uuv_core *core, uint32_t id, uint32_t member, uint32_t slot, int kind,
                                double value, uint32_t n, uint64_t seed);
UUV_CORE_API void uuv_core_clear_fault(uuv_core *core, uint32_t id);
/* For snapshots: what a fault keeps, and which of it comes next. */
UUV_CORE_API uuv_slot *uuv_core_fault_past(uuv_core *core, uint32_t id, uint32_t *n, uint32_t **head);
/* Slots that a row of the recording holds, in order. */
UUV_CORE_API int uuv_core_record(uuv_core *core, uint32_t n, const uint32_t *slots, uint64_t every);

/* Where rows go, until the next call: `n_rows` rows of the recorded slots, and their ticks.
 * A text in a row is the index of a text in `uuv_core_text`. */
UUV_CORE_API void uuv_core_rows(uuv_core *core, uint64_t *rows, int64_t *ticks, uint32_t n_rows,
                                size_t column_stride, size_t row_stride);
UUV_CORE_API uint64_t uuv_core_next_row(const uuv_core *core);
UUV_CORE_API void uuv_core_set_next_row(uuv_core *core, uint64_t tick);
UUV_CORE_API uint32_t uuv_core_rows_used(const uuv_core *core);
UUV_CORE_API uint64_t uuv_core_texts(const uuv_core *core);
UUV_CORE_API const char *uuv_core_text(const uuv_core *core, uint64_t index, size_t *size);

/* Coupling residuals. A connection of floating-point numbers that delays feeds its input, over a
 * step, with what the output was at the step's start. Its residual is the difference between that
 * input and the value that follows from the output at the step's end. Of each such connection the
 * largest since `uuv_core_begin` is kept. It is measured from the second exchange on: an output that
 * no step has produced yet may be a mere start value. */
typedef struct {
    uint32_t source_slot, target_slot; /* of the element with the largest residual */
    double relative, residual;         /* relative to 1 + |input| of then */
    uint64_t tick; /* the step's end */
} uuv_coupling;
/* Slot `slot` holds an angle, and `turn` is a full turn in its unit: values that differ by it are the
 * same direction, so that an angle that passes +-pi has no residual of 2 pi. */
UUV_CORE_API void uuv_core_angle(uuv_core *core, uint32_t slot, double turn);
/* Measures none of them, which a run that nobody asks for residuals is faster by. */
UUV_CORE_API void uuv_core_measure_nothing(uuv_core *core);
UUV_CORE_API uint32_t uuv_core_couplings(const uuv_core *core);
UUV_CORE_API void uuv_core_coupling(const uuv_core *core, uint32_t i, uuv_coupling *coupling);

/* A variable communication step, after the members: those with a step of one tick follow it. Lengths
 * are in ticks. The next step is the last one times
 * safety * e^-(integral + proportional) * e'^proportional, within [slowest, fastest] and the lengths,
 * where e is the estimate and e' that of the step before (see variable_step.h). With `rollback`, a
 * step with e > 1 is repeated with a shorter one. */
typedef struct {
    uint64_t smallest, largest, first;
    double absolute, relative, safety, slowest, fastest, proportional, integral;
    uint32_t order, rollback;
} uuv_step_control;
/* `unsatisfied` steps had an estimate above 1 and could not be shorter; `least` does not count steps
 * that were cut short by what is due. */
typedef struct {
    uint64_t steps, rejected, unsatisfied, least, most;
    double worst;
    uint64_t worst_tick;
} uuv_step_counts;
UUV_CORE_API int uuv_core_vary(uuv_core *core, const uuv_step_control *control);
/* An output that shows, over a step, the mean of its extrapolation; before the connections that are
 * judged. */
UUV_CORE_API int uuv_core_extrapolate(uuv_core *core, uint32_t slot);
UUV_CORE_API int uuv_core_judge(uuv_core *core, uint32_t target, uint32_t source, double factor,
                                double offset, double absolute, double relative);
/* Two pairs of an input and an output whose products are the power at the bond's two sides. */
UUV_CORE_API int uuv_core_bond(uuv_core *core, uint32_t input_a, uint32_t output_a, uint32_t input_b,
                               uint32_t output_b);
/* Events across FMUs of FMI 3.0 (see events.h), after a member's accesses: its event group, from 0 on,
 * the addresses of fmi3EnterEventMode, fmi3UpdateDiscreteStates and fmi3EnterStepMode, and whether its
 * state can be restored (`uuv_core_state`). An access with a discrete slot is set in Event Mode only.
 * `inside` is 1 while the member is in Event Mode: the caller may leave it there, and the next step
 * begins with an event iteration. */
UUV_CORE_API int uuv_core_event_mode(uuv_core *core, uint32_t member, uint32_t group, void *enter,
                                     void *update, void *leave, int repeats);
UUV_CORE_API void uuv_core_inside(uuv_core *core, uint32_t member, int32_t *inside);
UUV_CORE_API void uuv_core_discrete(uuv_core *core, uint32_t member, uint32_t slot);
/* Clocks of a member with Event Mode (see clocks.h): the addresses of fmi3GetClock, fmi3SetClock,
 * fmi3GetIntervalDecimal and fmi3GetIntervalFraction, or NULL. Then its clocks, by priority and numbered
 * from 0 on, with the gates: clocks of the same member, one of which must be active to read this one. */
enum uuv_core_clock { UUV_CORE_PERIODIC = 0, UUV_CORE_CHANGING, UUV_CORE_COUNTDOWN, UUV_CORE_TRIGGERED_INPUT,
                      UUV_CORE_TRIGGERED_OUTPUT };
enum uuv_core_interval { UUV_CORE_ASK_NOTHING = 0, UUV_CORE_ASK_DECIMAL, UUV_CORE_ASK_FRACTION };
enum uuv_core_qualifier { UUV_CORE_INTERVAL_UNKNOWN = 0, UUV_CORE_INTERVAL_UNCHANGED, UUV_CORE_INTERVAL_CHANGED };
UUV_CORE_API int uuv_core_clocks(uuv_core *core, uint32_t member, void *get, void *set, void *decimal,
                                 void *fraction);
UUV_CORE_API int uuv_core_clock(uuv_core *core, uint32_t member, uint32_t reference, int kind, int asks,
                                uint32_t n_gates, const uint32_t *gates);
/* Ticks of one clock activate another, a triggered input clock. */
UUV_CORE_API int uuv_core_clock_wire(uuv_core *core, uint32_t from, uint32_t from_clock, uint32_t to,
                                     uint32_t to_clock);
/* The access with a slot is made only while one of these clocks of the member is active; before the
 * transfers. */
UUV_CORE_API int uuv_core_clocked(uuv_core *core, uint32_t member, uint32_t slot, uint32_t n_clocks,
                                  const uint32_t *clocks);
/* Before `uuv_core_begin`: a tick has that many parts; the instants of a periodic clock, in ticks and
 * parts; the first interval of another clock, if it is `known`, from a communication point. */
UUV_CORE_API void uuv_core_clock_parts(uuv_core *core, uint64_t parts);
UUV_CORE_API void uuv_core_clock_starts(uuv_core *core, uint32_t member, uint32_t clock, uint64_t first_tick,
                                        uint64_t first_part, uint64_t whole, uint64_t part, double interval);
UUV_CORE_API void uuv_core_clock_waits(uuv_core *core, uint32_t member, uint32_t clock, uint64_t tick,
                                       int known, double interval);
/* An event of a member: at a communication point plus an offset [s], and its cause. From UUV_CORE_CLOCK
 * on: its clock of number `cause` - UUV_CORE_CLOCK ticked. */
enum { UUV_CORE_REPORTED = 0, UUV_CORE_INPUT = 1, UUV_CORE_CLOCK = 2 };
typedef struct {
    uint64_t tick;
    double offset;
    uint32_t member;
    int32_t cause;
} uuv_event;
UUV_CORE_API uint32_t uuv_core_n_events(const uuv_core *core);
/* Copies the events since the last call, and forgets them. */
UUV_CORE_API void uuv_core_take_events(uuv_core *core, uuv_event *events);

/* No step goes beyond this communication point, until it is reached or set anew. */
UUV_CORE_API void uuv_core_horizon(uuv_core *core, uint64_t tick);
UUV_CORE_API void uuv_core_step_counts(const uuv_core *core, uuv_step_counts *counts);

/* Running. `uuv_core_begin` reads every output at communication point `tick`, and writes the
 * first row; `run` makes at most
 * `n_ticks` steps, fewer when the rows are full or about `seconds` of wall time have passed. */
UUV_CORE_API int32_t uuv_core_begin(uuv_core *core, uint64_t tick);
UUV_CORE_API int32_t uuv_core_run(uuv_core *core, uint64_t n_ticks, double seconds);
/* Lets the step of a member count that `run` stopped at because the member asks to end the
 * simulation: the next `run` goes on with the members behind it. 0: not in an iterated group. */
UUV_CORE_API int32_t uuv_core_accept_step(uuv_core *core, uint32_t member);
UUV_CORE_API void uuv_core_why(const uuv_core *core, uuv_failure *failure);

/* In Initialization Mode, sets the inputs of the members in `order` from their sources, no
 * callbacks among them; a member comes again where more of its inputs have become known. */
UUV_CORE_API int32_t uuv_core_propagate(uuv_core *core, uint64_t tick, uint32_t n, const uint32_t *order);
/* Puts another instance of the same FMU in a member's place. */
UUV_CORE_API void uuv_core_instance(uuv_core *core, uint32_t member, void *instance,
                                    int32_t *kept);

/* Says whether one of n counts, such as those of components' messages, is not 0. */
UUV_CORE_API int uuv_core_any(const uint32_t *const *counts, uint32_t n);

/* State of the loop, for snapshots: its clock, all slots but texts, and the states of the native
 * members that `uuv_core_state` knows, as one run of bytes. `fresh` holds values that exist but
 * are not visible yet. */
UUV_CORE_API size_t uuv_core_image_size(const uuv_core *core);
UUV_CORE_API void uuv_core_get_image(const uuv_core *core, void *image);
UUV_CORE_API void uuv_core_set_image(uuv_core *core, const void *image);
UUV_CORE_API uint64_t uuv_core_tick(const uuv_core *core);
UUV_CORE_API void uuv_core_set_tick(uuv_core *core, uint64_t tick);
UUV_CORE_API uuv_slot *uuv_core_slots(uuv_core *core);
UUV_CORE_API uuv_slot *uuv_core_fresh(uuv_core *core);
UUV_CORE_API const char *uuv_core_read_blob(const uuv_slot *slot, size_t *size);
UUV_CORE_API int uuv_core_write_blob(uuv_slot *slot, const char *data, size_t size);

#endif
