/* SPDX-License-Identifier: Apache-2.0 */
/* A running co-simulation as one component: a client of its TCP server (bridge/tcp/framing.py).
 *
 * Included at the end of a generated file that has the requests of this system (LAYOUT, STEPS, …)
 * and the places of the block: inputs, tunable parameters, settings, outputs, in this order. It
 * connects when initialization ends, or when an output is read in Initialization Mode; it then
 * holds the barrier of lockstep, so that nobody else moves the time.
 */
#ifndef UUV_CLIENT_H
#define UUV_CLIENT_H

#include <stdarg.h>
#include <stdlib.h>

#include "uuv_json.h"
#include "uuv_socket.h"
#include "uuv_token.h"
#include "uuv_whole_steps.h"

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the client sends its numbers as they lie: little-endian processors only"
#endif

enum { HOST, USER, PASSWORD, N_TEXTS, LONGEST_TEXT = 256, LONGEST_WORDS = 480 };
#define CONNECT_SECONDS 5.0

typedef struct {
    uuv_instance head; /* what the shells know */
    uuv_socket socket;
    char *buffer; /* of the last answer: header, 0, payload */
    size_t room, head_size, payload_size;
    char text[N_TEXTS][LONGEST_TEXT];
    double start_time;
    int64_t first, made; /* the server's communication point at the start, steps since */
    int initializing, sockets_started, connected_port;
    char failure[LONGEST_WORDS], refused[256];
} client;

/* Keeps the first reason; gives 0. */
static int fail(client *x, const char *format, ...) {
    va_list arguments;
    if (x->failure[0]) return 0;
    va_start(arguments, format);
    vsnprintf(x->failure, sizeof x->failure, format, arguments);
    va_end(arguments);
    return 0;
}

static int port_of(const client *x) { return (int)x->head.b[PORT]; }

static void hang_up(client *x) {
    if (x->socket != UUV_NO_SOCKET) socket_close(x->socket);
    x->socket = UUV_NO_SOCKET;
}

/* ---- frames ---------------------------------------------------------------------------- */

static int send_frame(client *x, const char *header, const double *numbers, size_t n) {
    const size_t head = strlen(header), payload = n * sizeof *numbers;
    const uint32_t prefix[2] = {(uint32_t)head, (uint32_t)payload};
    const size_t size = sizeof prefix + head + payload;
    const double end = socket_clock() + x->head.b[TIMEOUT];
    char *frame = malloc(size);
    if (!frame) return fail(x, "out of memory");
    memcpy(frame, prefix, sizeof prefix);
    memcpy(frame + sizeof prefix, header, head);
    if (payload) memcpy(frame + sizeof prefix + head, numbers, payload);
    const int sent = socket_send(x->socket, frame, size, end);
    free(frame);
    return sent || fail(x, "the co-simulation %s at %s, port %d, has gone", SYSTEM_NAME, x->text[HOST],
                        port_of(x));
}

/* Takes the next frame into the buffer; 0, and words, if none comes. */
static int take_frame(client *x, double seconds) {
    uint32_t prefix[2] = {0, 0};
    const double end = socket_clock() + seconds;
    int came = socket_receive(x->socket, (char *)prefix, sizeof prefix, end);
    if (came > 0 && (prefix[0] > 1u << 24 || prefix[1] > 1u << 28 || prefix[1] % 8))
        return fail(x, "what answers at %s, port %d, is no co-simulation's TCP server, or one behind "
                       "TLS, which this FMU does not speak; expected a port that `uuvsim serve` "
                       "names", x->text[HOST], port_of(x));
    const size_t size = (size_t)prefix[0] + prefix[1] + 1;
    if (came > 0 && size > x->room) {
        char *more = realloc(x->buffer, size);
        if (!more) return fail(x, "out of memory");
        x->buffer = more;
        x->room = size;
    }
    if (came > 0) came = socket_receive(x->socket, x->buffer, prefix[0], end);
    if (came > 0) came = socket_receive(x->socket, x->buffer + prefix[0] + 1, prefix[1], end);
    if (came == 0)
        return fail(x, "the co-simulation %s at %s, port %d, did not answer within %g s", SYSTEM_NAME,
                    x->text[HOST], port_of(x), seconds);
    if (came < 0)
        return fail(x, "the co-simulation %s at %s, port %d, has gone; expected `uuvsim serve` to "
                       "go on", SYSTEM_NAME, x->text[HOST], port_of(x));
    x->buffer[prefix[0]] = '\0';
    x->head_size = prefix[0];
    x->payload_size = prefix[1];
    return 1;
}

static const char *payload(const client *x) { return x->buffer + x->head_size + 1; }

/* Says in the server's words what it refused; 1 if it did not. */
static int agreed(client *x) {
    char words[400];
    if (!x->head_size || json_is_true(json_value(x->buffer, "ok"))) return 1;
    json_text(json_value(x->buffer, "error"), words, sizeof words);
    return fail(x, "%s", words[0] ? words : "an answer that is none");
}

static int ask(client *x, const char *header, const double *numbers, size_t n) {
    return send_frame(x, header, numbers, n) && take_frame(x, x->head.b[TIMEOUT]) && agreed(x);
}

/* ---- entering -------------------------------------------------------------------------- */

static int say_hello(client *x, int lockstep) {
    char user[2 * LONGEST_TEXT], password[2 * LONGEST_TEXT], hello[7 * LONGEST_TEXT];
    char found[LONGEST_TEXT], token[2 * LONGEST_TEXT];
    const char *known = x->text[PASSWORD][0] ? x->text[PASSWORD] : getenv("UUVSIM_PASSWORD");
    const long ms = (long)(x->head.b[LAG] * 1e3);
    hang_up(x);
    x->connected_port = port_of(x);
    x->socket = socket_connect(x->text[HOST], port_of(x), CONNECT_SECONDS, x->failure,
                               sizeof x->failure);
    if (x->socket == UUV_NO_SOCKET) return 0;
    if (!take_frame(x, CONNECT_SECONDS) || !agreed(x)) return 0;
    const int protocol = (int)json_number(json_value(x->buffer, "protocol"));
    if (protocol != PROTOCOL)
        return fail(x, "the server speaks protocol %d, this FMU protocol %d; expected an FMU of "
                       "the server's version: `uuvsim fmu client`", protocol, PROTOCOL);
    if (!json_quote(x->text[USER], user, sizeof user) ||
        !json_quote(known ? known : "", password, sizeof password))
        return fail(x, "user or password is too long; expected at most 250 characters");
    token_for(x->text[HOST], port_of(x), found, sizeof found);
    if (!json_quote(found, token, sizeof token)) token[0] = '\0';
    snprintf(hello, sizeof hello,
             "{\"call\": \"hello\", \"protocol\": %d, \"name\": \"fmu\", \"user\": %s, "
             "\"password\": %s, \"token\": %s, \"lockstep\": %s, \"lag\": %ld.%03ld}",
             PROTOCOL, user, password, token[0] ? token : "null", lockstep ? "true" : "false",
             ms / 1000, ms % 1000);
    return ask(x, hello, NULL, 0);
}

/* Enters, and holds the barrier; a co-simulation that streams is paused before. */
static int enter(client *x) {
    if (!say_hello(x, 0) || !ask(x, "{\"call\": \"describe\"}", NULL, 0)) return 0;
    const int streams = json_is_true(json_value(x->buffer, "running"));
    if (streams && !ask(x, "{\"call\": \"pause\"}", NULL, 0)) return 0;
    return ask(x, "{\"call\": \"bye\"}", NULL, 0) && say_hello(x, 1);
}

/* Compares the interface that this FMU was made of with the server's. */
static int same_interface(client *x) {
    const double tick = (double)tick_num / (double)tick_den;
    const double read = json_number(json_value(x->buffer, "step_size"));
    char found[40];
    if (!(read > 0.999999999 * tick && read < 1.000000001 * tick))
        return fail(x, "the system that is served has communication steps of %.9g s; expected "
                       "%.9g s, as %s had when this FMU was made", read, tick, SYSTEM_NAME);
    if (!ask(x, LAYOUT, NULL, 0)) return 0;
    json_text(json_value(x->buffer, "interface"), found, sizeof found);
    if (strcmp(found, INTERFACE_HASH) == 0) return 1;
    for (uint32_t i = 0; i < N_SIGNALS; i++)
        if (!strstr(x->buffer, signals[i].entry))
            return fail(x, "%s has another type or shape at the server than when this FMU was "
                           "made: expected %s; make it anew with `uuvsim fmu client`",
                        signals[i].name, signals[i].entry);
    return fail(x, "units of signals differ between the server's system and %s when this FMU was "
                   "made: interface %s was read; expected %s; make it anew with `uuvsim fmu "
                   "client`", SYSTEM_NAME, found[0] ? found : "none", INTERFACE_HASH);
}

/* Start values go to the server: with a reset, or what was changed of the tunable parameters. */
static int start(client *x) {
    const double *b = x->head.b, *fresh = x->head.component->start;
    char seed[40] = "";
    x->made = 0;
    if (b[RESTART] != 0.0) {
        static const char begin[] = "{\"call\": \"reset\"";
        char *header = malloc(sizeof begin + sizeof seed + sizeof START_COLUMNS);
        if (!header) return fail(x, "out of memory");
        if (b[SEED] >= 0.0) snprintf(seed, sizeof seed, ", \"seed\": %ld", (long)b[SEED]);
        strcat(strcat(strcpy(header, begin), seed), START_COLUMNS);
        const int done = ask(x, header, b + 1, N_INPUTS + N_TUNABLES);
        free(header);
        return done;
    }
    if (!memcmp(b + TUNABLES, fresh + TUNABLES, N_TUNABLES * sizeof *b)) return 1;
    return ask(x, SET_TUNABLES, b + TUNABLES, N_TUNABLES);
}

static int take_outputs(client *x, size_t first) {
    if (x->payload_size != (first + N_OUTPUTS) * sizeof(double))
        return fail(x, "the server sent %llu numbers; expected %llu",
                    (unsigned long long)(x->payload_size / sizeof(double)),
                    (unsigned long long)(first + N_OUTPUTS));
    memcpy(x->head.b + OUTPUTS, payload(x) + first * sizeof(double), N_OUTPUTS * sizeof(double));
    return 1;
}

static void goodbye(client *x) {
    const char before = x->failure[0]; /* who leaves does not mind that nobody is there */
    if (x->socket != UUV_NO_SOCKET) send_frame(x, "{\"call\": \"bye\"}", NULL, 0);
    x->failure[0] = before;
    hang_up(x);
}

static void begin(client *x) {
    if (x->failure[0]) return;
    if (x->connected_port != port_of(x)) goodbye(x);
    const int known = x->socket != UUV_NO_SOCKET;
    if ((known || (enter(x) && same_interface(x))) && start(x) && ask(x, STEPS, NULL, 0) &&
        ask(x, GET_OUTPUTS, NULL, 0) && take_outputs(x, 0)) {
        x->first = (int64_t)json_number(json_value(x->buffer, "tick"));
        x->head.outputs_stale = x->head.dirty = 0;
    } else {
        hang_up(x);
    }
}

/* ---- life ------------------------------------------------------------------------------ */

UUV_EXPORT const uuv_component *uuv_get_component(void) { return &uuv_the_component; }

UUV_EXPORT void uuv_reset(uuv_instance *s) {
    client *x = (client *)s;
    goodbye(x);
    memcpy(s->b, s->component->start, s->component->n_block * sizeof(V));
    for (uint32_t i = 0; i < N_TEXTS; i++) strcpy(x->text[i], text_start[i]);
    x->start_time = 0.0;
    x->made = 0;
    x->failure[0] = '\0';
    x->initializing = s->initialized = 0;
    s->dirty = s->outputs_stale = 1;
}

UUV_EXPORT void uuv_free(uuv_instance *s) {
    client *x = (client *)s;
    if (!s) return;
    if (s->b) goodbye(x);
    if (x->sockets_started) socket_end();
    free(s->b);
    free(x->buffer);
    free(s);
}

UUV_EXPORT uuv_instance *uuv_instantiate(const uuv_component *c) {
    client *x = calloc(1, sizeof *x);
    if (!x) return NULL;
    x->socket = UUV_NO_SOCKET;
    x->head.component = c;
    x->head.b = calloc(c->n_block, sizeof(V));
    x->sockets_started = socket_start();
    if (!x->head.b || !x->sockets_started) {
        uuv_free(&x->head);
        return NULL;
    }
    uuv_reset(&x->head);
    return &x->head;
}

UUV_EXPORT void uuv_refresh(uuv_instance *s) { (void)s; } /* it shows no locals */

UUV_EXPORT void uuv_update_outputs(uuv_instance *s) {
    client *x = (client *)s;
    if (x->initializing && s->outputs_stale) begin(x);
}

UUV_EXPORT void uuv_enter_initialization(uuv_instance *s, double start_time) {
    client *x = (client *)s;
    s->b[0] = x->start_time = start_time;
    x->initializing = 1;
}

UUV_EXPORT void uuv_exit_initialization(uuv_instance *s) {
    uuv_update_outputs(s);
    ((client *)s)->initializing = 0;
    s->initialized = 1;
}

void uuv_terminate(uuv_instance *s) { goodbye((client *)s); }

const char *uuv_failure(const uuv_instance *s) {
    const client *x = (const client *)s;
    return x->failure[0] ? x->failure : NULL;
}

/* ---- steps ----------------------------------------------------------------------------- */

static int64_t steps_to(const client *x, double time) {
    return whole_point(time - x->start_time, (double)tick_num, (double)tick_den);
}

const char *uuv_step_refused(uuv_instance *s, double t, double h) {
    client *x = (client *)s;
    return whole_refused(x->refused, sizeof x->refused, x->made,
                         steps_to(x, t + h), t, h, (double)tick_num / (double)tick_den);
}

/* The time may not have been moved by others, who reset it, say. */
static int is_at(client *x, int64_t end) {
    double point;
    memcpy(&point, payload(x), sizeof point);
    return point == (double)(x->first + end) ||
           fail(x, "another client has moved the time: the co-simulation is at its communication "
                   "point %.0f; expected %.0f", point, (double)(x->first + end));
}

UUV_EXPORT int32_t uuv_do_step(uuv_instance *s, double t, double h) {
    client *x = (client *)s;
    const int64_t end = steps_to(x, t + h);
    if (end > x->made) {
        double numbers[1 + N_INPUTS];
        if (s->dirty && N_TUNABLES && !ask(x, SET_TUNABLES, s->b + TUNABLES, N_TUNABLES)) {
            hang_up(x);
            return 0;
        }
        s->dirty = 0;
        numbers[0] = (double)(end - x->made);
        memcpy(numbers + 1, s->b + 1, N_INPUTS * sizeof *numbers);
        if (!ask(x, "", numbers, 1 + N_INPUTS) || !take_outputs(x, 2) || !is_at(x, end)) {
            hang_up(x);
            return 0;
        }
        x->made = end;
    }
    s->b[0] = t + h;
    return 0;
}

/* ---- states: they are the server's; texts ------------------------------------------------ */

UUV_EXPORT size_t uuv_state_size(const uuv_instance *s) { return (void)s, 0; }

UUV_EXPORT void uuv_get_state(const uuv_instance *s, void *out) { (void)s, (void)out; }

UUV_EXPORT void uuv_set_state(uuv_instance *s, const void *in) { (void)s, (void)in; }

const char *uuv_text(const uuv_instance *s, uint32_t vr) {
    const uint32_t i = vr - s->component->n_block;
    return i < N_TEXTS ? ((const client *)s)->text[i] : NULL;
}

int uuv_set_text(uuv_instance *s, uint32_t vr, const char *value) {
    const uint32_t i = vr - s->component->n_block;
    if (i >= N_TEXTS || strlen(value) >= LONGEST_TEXT) return 0;
    goodbye((client *)s); /* it may have been another server's, or user's */
    strcpy(((client *)s)->text[i], value);
    s->outputs_stale = 1;
    return 1;
}

#endif
