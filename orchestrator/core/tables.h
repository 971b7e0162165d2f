/* The tables that the loop reads, as build.c makes them. */
#ifndef UUV_CORE_TABLES_H
#define UUV_CORE_TABLES_H

#include "uuv_component.h"
#include "uuv_core.h"
#include "uuv_guard.h"

typedef enum { CLASS_FLOAT, CLASS_SIGNED, CLASS_UNSIGNED, CLASS_BOOLEAN, CLASS_BLOB } slot_class;

slot_class class_of(int type);

/* One grouped call of a member. */
typedef struct {
    uint8_t type, class;
    uint8_t consecutive; /* native: the offsets follow each other */
    uint8_t discrete;    /* inputs that are set in Event Mode only (events.h) */
    uint32_t slot, n_values, n_references;
    uint32_t *references;
    void *function;
    void *scratch; /* n_values of the component's own type, where that is not the slot's */
    size_t *sizes; /* of binaries */
    uint8_t *negated; /* FMI 1.0: of each value, whether it is a negated alias; NULL: none is */
    uuv_slot *turned; /* what is set where some are */
    uint32_t *clocks; /* clocked variables: those of the member's clocks that they belong to (clocks.h) */
    uint32_t n_clocks;
    int was_set; /* since a clock became active */
} access;

/* `early` of a transfer inside an event group: in Event Mode it takes the new value (events.h). */
enum { IN_EVENTS = 3 };

/* `count` slots from a member's outputs to another's inputs. */
typedef struct {
    uint32_t from, source, target, count;
    uint8_t early, copy, in_place, source_class, target_class;
    uint32_t access; /* of an event group's member: which of its accesses sets the target */
    double factor, offset;
    int64_t *pairs; /* a table instead: the source's value, the target's, and so on */
    uint32_t n_pairs;
} transfer;

/* A point of time inside a step: `part` of the `parts` of a tick if it is `exact`, and always the
 * offset from the tick [s] (clocks.h). */
typedef struct {
    uint64_t tick, part;
    double offset;
    uint64_t exact;
} instant;

/* Ticks go from a clock of a member to a triggered input clock of another. */
typedef struct {
    uint32_t from, from_clock, to, to_clock;
} clock_wire;

/* A delayed connection of floating-point numbers (coupling.h): its values from `first` on. */
typedef struct {
    uint32_t source, target, count, first; /* slots, and the place of its first value in `most` */
} coupling;

/* Values of delayed connections that are measured together: their slots follow each other. */
typedef struct {
    uint32_t source, target, count, first;
    uint32_t to; /* the member that they feed, if it does not step at each tick; else UINT32_MAX */
    uint64_t delay, since; /* ticks of a step of both ends; from when on it is measured */
    double factor, offset;
} span;

/* One value of a short span whose ends step at each tick, or two that follow each other, and its
 * place in `most`. */
typedef struct {
    uint32_t source, target, value;
} single;

/* Two floating-point numbers that follow each other, moved and compared at once. */
typedef double pair __attribute__((vector_size(16), aligned(8), may_alias));
typedef int64_t pair_mask __attribute__((vector_size(16)));

typedef struct member member;
typedef struct fault fault;

/* How a kind of component is written, stepped and read; each gives 1, or 0 and fills `why`. One
 * that steps elsewhere can be left to it: `post` begins what `collect` ends. */
typedef struct {
    int (*set)(member *m, const uuv_slot *slots, uuv_failure *why);
    int (*do_step)(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why);
    int (*get)(member *m, uuv_slot *slots, uuv_failure *why);
    int (*post)(member *m, double t, double h, uuv_failure *why);
    int (*collect)(member *m, uuv_failure *why);
} kind;

extern const kind kind_native, kind_fmi1, kind_fmi2, kind_fmi3, kind_callback, kind_shared;

/* A floating-point number, or two that follow each other, that goes from one slot to another, and
 * from there to a component's block. */
typedef struct {
    uint32_t source, slot, offset;
} copied;

/* A slot of a copy with bounds that the component's own setter checks. */
typedef struct {
    double low, high;
    uint32_t slot;
} bounded;

/* Values of one type that follow each other, in slots and in a component's block. */
typedef struct {
    uint32_t slot, offset, count;
    uint8_t class;
} part;

/* The values of a component that this package compiled: the loop reads and writes them in place,
 * where offsets are those of its block (uuv_component.h). */
typedef struct {
    uuv_values_function *find; /* of an FMU; NULL: the instance is a `uuv_instance` */
    uuv_steps_function *steps;
    uint32_t together; /* members from this one on that are stepped in one call */
    uuv_values at;
    uint32_t *offsets; /* of the inputs that are set, then of the outputs that are read */
    uint32_t first_in, n_in, first_out, n_out;
    copied *pairs, *copies; /* inputs from outputs; a source that is seen early is in `fresh` */
    part *writes, *reads; /* inputs from their slots only, and outputs */
    bounded *bounds;
    uint32_t n_pairs, n_copies, n_writes, n_reads, n_bounds;
} in_place;

/* How a member is called in a segment: by its kind, in place, or by two FMI functions. */
enum { GENERAL = 0, IN_PLACE = 1, FMI2 = 2, FMI3 = 3, FMI1 = 4 };

/* Members that follow each other and are called in the same way. */
typedef struct {
    member *first, *end;
    uint32_t how, is_fmi1; /* a segment of FMI 1.0 is one of FMI2 that is marked */
} segment;

/* The fast path of a member (fast_path.h): its one setter and its one getter. */
typedef struct {
    uint32_t how;
    uint32_t alone, alone_source; /* the setter's one value comes from that slot */
    uint32_t set_slot, n_set, n_set_references, get_slot, n_get, n_get_references;
    void *set, *get;
    const uint32_t *set_references, *get_references;
} fast_path;

struct member { /* what every step reads comes first */
    fast_path fast;
    void *instance, *do_step;
    int32_t *kept; /* of an FMU: 1 once a state of it is kept (see uuv_core_member) */
    uint64_t due; /* the communication point that its last step reached; its next step's start */
    uint64_t step_ticks;
    double h; /* its communication step [s] */
    transfer *transfers;
    uint32_t n_transfers, n_sets, n_gets, n_faults;
    const kind *kind;
    void *get;
    uuv_slot *fresh; /* where its outputs are read to: the visible slots, or those of `early` */
    int sequential;
    int follows;  /* its step has the variable length of the system's */
    int stepping; /* its step has been posted, and not been collected */
    struct iteration *group; /* the iterated group that it belongs to, or NULL */
    struct event_mode *events; /* of a member that uses Event Mode (events.h), or NULL */
    access *sets, *gets;
    fault *faults; /* of its outputs, in the order in which they came */
    void *get_state, *set_state, *free_state; /* see uuv_core_state */
    size_t state_size;
    void *state;
    in_place values;
    const char *name; /* the component's path; the caller's */
    uuv_frame *at;    /* of the core: what is being called */
};

/* Notes which function of a member is called next, for one that does not return. */
static inline void calling(const member *m, const char *verb, const char *noun) {
    uuv_calling(m->at, m->name, verb, noun);
}

/* A run of recorded slots. */
typedef struct {
    uint32_t slot, column, count;
} run;

/* The recording: rows that the caller provides, and the texts that they name. */
typedef struct {
    run *runs;
    uint32_t n_runs, n_columns;
    uint32_t *text_columns, *text_slots, n_texts;
    uint64_t *last_text; /* of each text column: index of its last text, or UINT64_MAX */
    uint64_t every, next;
    uint64_t *rows; /* strides are distances of two columns and of two rows, in values */
    int64_t *ticks;
    size_t column_stride, row_stride;
    uint32_t n_rows, used;
    uuv_blob *texts;
    uint64_t n_stored, capacity;
} recording;

struct uuv_core {
    member *members;
    uint32_t n_members, n_slots;
    uint64_t num, den, tick;
    uint64_t stride; /* ticks of the step that is being made: 1, or the variable length */
    struct variable_step *varied; /* NULL: every step is one tick */
    uuv_slot *slots, *fresh; /* one array: fresh begins where slots end */
    uint8_t *classes;
    double *turns; /* of a slot that holds an angle: a full turn in its unit; else 0 */
    struct iteration *groups; /* the iterated ones */
    uint32_t n_groups;
    coupling *couplings; /* by the member that they feed; NULL until the tables are complete */
    uuv_coupling *largest; /* of each, what was measured */
    double *most;          /* of each value, the largest residual of its connection */
    uint32_t *coupling_of; /* of each value, its connection */
    span *spans;
    single *twins, *singles; /* two values, and one value each */
    int unmeasured;
    /* The first spans have factor 1 and offset 0; of these, the last are measured by twins and singles. */
    uint32_t n_couplings, n_spans, n_plain, n_long, n_twins, n_singles;
    uint32_t n_stepping; /* members whose steps have been posted */
    void **instances; /* of the members */
    double *low, *high; /* of an input slot of a component that is written in place: its bounds */
    segment *segments;
    uint32_t n_segments, n_faulty; /* members with faults */
    int iterating; /* inputs inside an iterated group come from the trial's outputs */
    struct event_group *event_groups; /* (events.h) */
    uint32_t n_event_groups;
    int in_event;     /* an event group is in Event Mode */
    uuv_slot *before; /* its inputs before the exchange, by slot */
    uuv_event *noted; /* events that the caller has not taken */
    uint32_t n_noted, noted_room;
    clock_wire *wires; /* (clocks.h) */
    uint32_t n_wires;
    uint64_t parts;  /* of a tick: the instants of periodic clocks are whole parts */
    uint8_t *is_new; /* of the clocks of one member */
    recording record;
    uuv_failure why;
    uuv_frame frame; /* what is being called, while the core runs */
    uuv_frame_function *enter, *leave;
};

static inline void enter(uuv_core *core) {
    if (core->enter) core->enter(&core->frame);
}

static inline void leave(uuv_core *core) {
    if (core->leave) core->leave(&core->frame);
}

const char *type_name(int type, int version); /* as FMI spells it in its functions */

void apply_faults(const uuv_core *core, member *m, uuv_slot *slots);
void free_faults(member *m);
int blob_assign(uuv_blob *blob, const char *data, size_t size);
void find_block(member *m); /* of a component that is read and written in place */
int read_outputs(uuv_core *core, member *m);
int carry(uuv_core *core, const transfer *t);
int transfer_inputs(uuv_core *core, member *target);
int failed(uuv_failure *why, int outcome, int status, int action);
/* FMI's noSetFMUStatePriorToCurrentPoint. */
static inline int never_goes_back(const member *m) { return !m->kept || !*m->kept; }
/* Makes room for one more item at the end of an array; gives it zeroed, or NULL. */
void *append(void **items, uint32_t *n, size_t size);
int all_finite(const uuv_slot *slots, uint32_t n, uint32_t *which);

#endif
