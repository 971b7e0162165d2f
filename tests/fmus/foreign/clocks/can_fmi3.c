/* A CAN node and a CAN bus for two nodes, after the text of FMI-LS-BUS 1.0.0 (network abstraction, CAN):
 * operations are bytes in binary variables, and count while their Rx or Tx clock ticks.
 * Node: sends its frame at first + n * period, where it returns early, and counts what it receives.
 * Bus: of the frames that wait, the one with the lowest ID is sent first. It takes 47 + 8 DLC bits (CAN 2.0
 * with its interframe space, without stuff bits), and then the other node gets it, its sender a Confirm.
 * Frame number error_at gives a Bus Error to both. The instantiation token chooses the role. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)

enum { TRANSMIT = 0x10, CONFIRM = 0x20, ARBITRATION_LOST = 0x30, BUS_ERROR = 0x31, CONFIGURATION = 0x40 };
enum { BAUD_RATE = 1, LOST_BEHAVIOR = 4, DISCARD = 2, MOST = 512, WAITING = 8 };
enum { RX = 0, TX, RX_CLOCK, TX_CLOCK, SENT = 10, RECEIVED, CONFIRMED, LOST, ERRORS, LAST_ID, LAST_AT,
       ID = 20, LENGTH, DISCARDS, ERROR_AT, FIRST = 30, PERIOD, BAUD };
enum mode { STARTING, INITIALIZING, EVENT, STEP };

typedef struct {
    uint8_t bytes[MOST];
    size_t n;
} buffer;

typedef struct {
    buffer rx, tx;
    int rx_clock, tx_clock, known; /* `known`: the interval of a countdown clock is new */
    uint32_t waiting[WAITING][2], n_waiting, baud, discards; /* of the bus: IDs and lengths */
} port;

typedef struct {
    int is_bus, frames, is_sending;
    enum mode mode;
    double t, next, wait, value[3], last_at;
    int32_t setting[4], count[6];
    port ports[2];
} can;

/* ---- operations: code, length, and then what belongs to it, in little-endian order ---------- */

static void put(buffer *b, uint32_t x, int size) {
    for (int i = 0; i < size && b->n < MOST; i++) b->bytes[b->n++] = (uint8_t)(x >> (8 * i));
}
static uint32_t take(const uint8_t *at, int size) {
    uint32_t x = 0;
    for (int i = 0; i < size; i++) x |= (uint32_t)at[i] << (8 * i);
    return x;
}
static void put_transmit(buffer *b, uint32_t id, uint32_t length) {
    put(b, TRANSMIT, 4), put(b, 16 + length, 4), put(b, id, 4), put(b, 0, 2), put(b, length, 2);
    for (uint32_t i = 0; i < length; i++) put(b, i, 1);
}
static void put_short(buffer *b, uint32_t code, uint32_t id) { put(b, code, 4), put(b, 12, 4), put(b, id, 4); }
static void put_error(buffer *b, uint32_t id, int is_sender) {
    put(b, BUS_ERROR, 4), put(b, 15, 4), put(b, id, 4);
    put(b, 4, 1), put(b, is_sender ? 1 : 2, 1), put(b, (uint32_t)is_sender, 1);
}

/* ---- node --------------------------------------------------------------------------------- */

static void configure(can *c) {
    buffer *tx = &c->ports[0].tx;
    put(tx, CONFIGURATION, 4), put(tx, 13, 4), put(tx, BAUD_RATE, 1), put(tx, (uint32_t)c->value[BAUD - FIRST], 4);
    put(tx, CONFIGURATION, 4), put(tx, 10, 4), put(tx, LOST_BEHAVIOR, 1), put(tx, c->setting[2] ? DISCARD : 1, 1);
    c->ports[0].tx_clock = 1;
}
static void receive(can *c) {
    const buffer *rx = &c->ports[0].rx;
    for (size_t at = 0; at + 8 <= rx->n; at += take(rx->bytes + at + 4, 4)) {
        const uint32_t code = take(rx->bytes + at, 4);
        const int counts = code == TRANSMIT ? RECEIVED : code == CONFIRM ? CONFIRMED : code == ARBITRATION_LOST ? LOST : ERRORS;
        c->count[counts - SENT]++;
        if (code == TRANSMIT) c->count[LAST_ID - SENT] = (int32_t)take(rx->bytes + at + 8, 4), c->last_at = c->t;
    }
}

/* ---- bus ---------------------------------------------------------------------------------- */

static void accept(port *p) {
    for (size_t at = 0; at + 8 <= p->rx.n; at += take(p->rx.bytes + at + 4, 4)) {
        const uint8_t *op = p->rx.bytes + at;
        if (take(op, 4) == CONFIGURATION && op[8] == BAUD_RATE) p->baud = take(op + 9, 4);
        if (take(op, 4) == CONFIGURATION && op[8] == LOST_BEHAVIOR) p->discards = op[9] == DISCARD;
        if (take(op, 4) != TRANSMIT || p->n_waiting == WAITING) continue;
        p->waiting[p->n_waiting][0] = take(op + 8, 4);
        p->waiting[p->n_waiting++][1] = take(op + 14, 2);
    }
}
/* The port whose frame wins: that with the lowest ID; -1: none waits. */
static int winner(const can *c) {
    const port *p = c->ports;
    if (!p[0].n_waiting || !p[1].n_waiting) return p[0].n_waiting ? 0 : p[1].n_waiting ? 1 : -1;
    return p[1].waiting[0][0] < p[0].waiting[0][0];
}
static void pop(port *p) { memmove(p->waiting, p->waiting + 1, sizeof p->waiting[0] * --p->n_waiting); }
/* The frame on the bus ends: it is computed once, when the first of the outputs is read. */
static void deliver(can *c) {
    const int from = winner(c);
    if (!c->is_sending || from < 0) return;
    const uint32_t id = c->ports[from].waiting[0][0], length = c->ports[from].waiting[0][1];
    c->is_sending = 0;
    c->frames++;
    pop(c->ports + from);
    for (int i = 0; i < 2; i++) {
        port *p = c->ports + i;
        if (c->frames == c->setting[ERROR_AT - ID]) put_error(&p->tx, id, i == from);
        else if (i == from) put_short(&p->tx, CONFIRM, id);
        else put_transmit(&p->tx, id, length);
        for (; p->discards && p->n_waiting; pop(p)) put_short(&p->tx, ARBITRATION_LOST, p->waiting[0][0]);
    }
}
static void schedule(can *c) {
    const int from = winner(c);
    const port *p = c->ports;
    if (c->is_sending || from < 0 || !p[0].baud || p[0].baud != p[1].baud) return;
    c->is_sending = c->ports[0].known = c->ports[1].known = 1;
    c->wait = (double)(47 + 8 * p[from].waiting[0][1]) / (double)p[0].baud;
}

/* ---- FMI ---------------------------------------------------------------------------------- */

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean log_on, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference r[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log_on), UNUSED(r), UNUSED(n);
    UNUSED(environment), UNUSED(log), UNUSED(update);
    if (!events || !early) return NULL;
    can *c = calloc(1, sizeof *c);
    c->is_bus = strcmp(token, "{can bus}") == 0;
    c->setting[0] = 1, c->setting[LENGTH - ID] = 4;
    c->value[0] = c->value[PERIOD - FIRST] = 0.01, c->value[BAUD - FIRST] = 100000.0;
    return c;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean a, fmi3Float64 d, fmi3Float64 t, fmi3Boolean e,
                                       fmi3Float64 f) {
    can *c = i;
    UNUSED(a), UNUSED(d), UNUSED(e), UNUSED(f);
    c->t = t;
    c->next = c->value[0];
    c->mode = INITIALIZING;
    if (!c->is_bus) configure(c);
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ((can *)c)->mode = EVENT;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = r[i] >= ID ? ((can *)c)->setting[r[i] - ID] : ((can *)c)->count[r[i] - SENT];
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) ((can *)c)->setting[r[i] - ID] = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = r[i] >= FIRST ? ((can *)c)->value[r[i] - FIRST] : ((can *)c)->last_at;
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) ((can *)c)->value[r[i] - FIRST] = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary x[],
                         size_t n_x) {
    can *c = i;
    UNUSED(n_x);
    for (size_t k = 0; k < n; k++) {
        port *p = c->ports + r[k] / 4;
        if (r[k] % 4 != TX || c->mode != EVENT) return fmi3Error;
        if (c->is_bus && p->tx_clock) deliver(c);
        x[k] = p->tx.bytes;
        sizes[k] = p->tx.n;
    }
    return fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n, const size_t sizes[],
                         const fmi3Binary x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t k = 0; k < n; k++) {
        port *p = ((can *)i)->ports + r[k] / 4;
        if (r[k] % 4 != RX || !p->rx_clock || sizes[k] > MOST) return fmi3Error;
        memcpy(p->rx.bytes, x[k], p->rx.n = sizes[k]);
    }
    return fmi3OK;
}
fmi3Status fmi3GetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Clock x[]) {
    can *c = i;
    if (c->is_bus || c->mode != EVENT || n != 1 || r[0] != TX_CLOCK) return fmi3Error;
    x[0] = c->ports[0].tx_clock;
    c->ports[0].tx_clock = 0; /* an activation is reported once */
    return fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Clock x[]) {
    for (size_t k = 0; k < n; k++) {
        port *p = ((can *)i)->ports + r[k] / 4;
        if (((can *)i)->mode != EVENT) return fmi3Error;
        *(r[k] % 4 == RX_CLOCK ? &p->rx_clock : &p->tx_clock) = x[k];
    }
    return fmi3OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                                  fmi3IntervalQualifier q[]) {
    can *c = i;
    for (size_t k = 0; k < n; k++) {
        port *p = c->ports + r[k] / 4;
        q[k] = p->known ? fmi3IntervalChanged : c->is_sending ? fmi3IntervalUnchanged : fmi3IntervalNotYetKnown;
        x[k] = c->wait;
        p->known = 0;
    }
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s) {
    if (!*s) *s = malloc(sizeof(can));
    memcpy(*s, c, sizeof(can));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    memcpy(c, s, sizeof(can));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s) {
    UNUSED(c);
    free(*s);
    *s = NULL;
    return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    ((can *)c)->mode = EVENT;
    return fmi3OK;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    ((can *)c)->mode = STEP;
    return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next) {
    can *c = i;
    for (int k = 0; k < 1 + c->is_bus; k++) {
        port *p = c->ports + k;
        if (p->rx_clock && c->is_bus) accept(p);
        if (p->rx_clock && !c->is_bus) receive(c);
        p->rx_clock = p->tx_clock = 0;
        p->rx.n = p->tx.n = 0;
    }
    if (c->is_bus) schedule(c);
    *again = *end = *nominals = *values = *defined = fmi3False;
    *next = 0.0;
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean never_goes_back,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    can *c = i;
    UNUSED(never_goes_back);
    if (c->mode != STEP || fabs(t - c->t) > 1e-9) return fmi3Error;
    *reached = t + h;
    *event = *end = *early = fmi3False;
    if (!c->is_bus && c->value[PERIOD - FIRST] > 0.0 && c->next <= t + h + 1e-12) { /* within rounding, at the step's end */
        *early = c->next < t + h - 1e-12;
        if (*early) *reached = c->next;
        *event = fmi3True;
        put_transmit(&c->ports[0].tx, (uint32_t)c->setting[0], (uint32_t)c->setting[1]);
        c->ports[0].tx_clock = 1;
        c->next = c->value[0] + ++c->count[0] * c->value[PERIOD - FIRST];
    }
    c->t = *reached;
    return fmi3OK;
}
