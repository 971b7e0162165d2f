/* Zenoh for MATLAB and Octave: sessions, queries, liveliness and streams over zenoh-pico.
 *
 *   h = uuvsim_zenoh('open', 'tcp/127.0.0.1:7470')
 *   keys = uuvsim_zenoh('alive', h, 'uuvsim/ * /live/master', timeout)           (without spaces)
 *   uuvsim_zenoh('token', h, key)
 *   [payload, attachment, ok] = uuvsim_zenoh('get', h, key, payload, attachment, timeout)
 *   w = uuvsim_zenoh('watch', h, key, keep)
 *   block = uuvsim_zenoh('take', h, w)                            [] if none has arrived
 *   uuvsim_zenoh('close', h)
 *
 * Payloads are uint8, keys are text, timeouts are in seconds. +uuvsim/Zenoh.m calls it. */
#include <stdint.h>
#include <string.h>
#include <zenoh-pico.h>

#include "mex.h"

#if Z_FEATURE_MULTI_THREAD != 1 || Z_FEATURE_QUERY != 1 || Z_FEATURE_LIVELINESS != 1
#error "zenoh-pico was built without threads, queries or liveliness; build it with them"
#endif

#define SESSIONS 16
#define WATCHES 64
#define TOKENS 16

typedef struct {
    z_owned_subscriber_t subscriber;
    z_owned_ring_handler_sample_t ring;
} watch_t;

typedef struct {
    int is_open;
    z_owned_session_t zenoh;
    int watches;
    watch_t watch[WATCHES];
    int tokens;
    z_owned_liveliness_token_t token[TOKENS];
} client_t;

static client_t clients[SESSIONS];
static int at_exit;

static void close_client(client_t *client) {
    if (!client->is_open) {
        return;
    }
    for (int k = 0; k < client->tokens; k++) {
        z_drop(z_move(client->token[k]));
    }
    for (int k = 0; k < client->watches; k++) {
        z_drop(z_move(client->watch[k].subscriber));
        z_drop(z_move(client->watch[k].ring));
    }
    z_drop(z_move(client->zenoh));
    memset(client, 0, sizeof *client);
}

static void close_all(void) {
    for (int k = 0; k < SESSIONS; k++) {
        close_client(&clients[k]);
    }
}

static void wrong(const char *words) { mexErrMsgIdAndTxt("uuvsim:zenoh", "uuvsim: %s", words); }

static double number(int n, const mxArray *in[], int k, const char *what) {
    if (k >= n || !mxIsDouble(in[k]) || mxGetNumberOfElements(in[k]) != 1) {
        mexErrMsgIdAndTxt("uuvsim:zenoh", "uuvsim: argument %d: expected %s, a number", k + 1, what);
    }
    return mxGetScalar(in[k]);
}

static char *text(int n, const mxArray *in[], int k, const char *what) {
    char *found = k < n && mxIsChar(in[k]) ? mxArrayToString(in[k]) : NULL;
    if (found == NULL) {
        mexErrMsgIdAndTxt("uuvsim:zenoh", "uuvsim: argument %d: expected %s, a text", k + 1, what);
    }
    return found;
}

static client_t *client_of(int n, const mxArray *in[]) {
    double handle = number(n, in, 1, "what 'open' gave");
    if (!(handle >= 1 && handle <= SESSIONS) || !clients[(int)handle - 1].is_open) {
        wrong("this connection is closed; expected one that 'open' gave");
    }
    return &clients[(int)handle - 1];
}

static uint64_t milliseconds(int n, const mxArray *in[], int k) {
    double seconds = number(n, in, k, "a timeout in seconds");
    if (!(seconds > 0 && seconds < 1e9)) {
        wrong("the timeout: expected more than 0 seconds");
    }
    return (uint64_t)(1000 * seconds) + 1;
}

static z_view_keyexpr_t key_of(const char *name) {
    z_view_keyexpr_t key;
    if (z_view_keyexpr_from_str(&key, name) < 0) {
        mexErrMsgIdAndTxt("uuvsim:zenoh", "uuvsim: '%.200s' is no key of Zenoh", name);
    }
    return key;
}

static mxArray *bytes_of(const z_loaned_bytes_t *bytes) {
    size_t size = bytes == NULL ? 0 : z_bytes_len(bytes);
    mxArray *out = mxCreateNumericMatrix(size > 0, size, mxUINT8_CLASS, mxREAL);
    if (size > 0) {
        z_bytes_reader_t reader = z_bytes_get_reader(bytes);
        z_bytes_reader_read(&reader, (uint8_t *)mxGetData(out), size);
    }
    return out;
}

/* Copy a uint8 array that is not empty; return whether there is one. */
static int copied(int n, const mxArray *in[], int k, z_owned_bytes_t *bytes) {
    if (k >= n || mxIsEmpty(in[k])) {
        return 0;
    }
    if (!mxIsUint8(in[k])) {
        mexErrMsgIdAndTxt("uuvsim:zenoh", "uuvsim: argument %d: expected uint8", k + 1);
    }
    return z_bytes_copy_from_buf(bytes, mxGetData(in[k]), mxGetNumberOfElements(in[k])) == 0;
}

static void open_session(int nout, mxArray *out[], int n, const mxArray *in[]) {
    char *endpoint = text(n, in, 1, "an address such as tcp/127.0.0.1:7470");
    int k = 0;
    while (k < SESSIONS && clients[k].is_open) {
        k++;
    }
    if (k == SESSIONS) {
        wrong("16 connections are open; close one first");
    }
    client_t *client = &clients[k];
    memset(client, 0, sizeof *client);
    z_owned_config_t config;
    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, endpoint);
    if (z_open(&client->zenoh, z_move(config), NULL) < 0) {
        mexErrMsgIdAndTxt("uuvsim:unreachable",
                          "uuvsim: nothing that speaks Zenoh answers at %.200s; start a "
                          "co-simulation there: uuvsim serve bluerov2_hold --paused --anyone; "
                          "or it asks for a token or a password, which this client cannot show: "
                          "then uuvsim.connect()",
                          endpoint);
    }
    client->is_open = 1;
    if (!at_exit) {
        mexLock(); /* its threads continue: the code must never be unloaded */
        mexAtExit(close_all);
        at_exit = 1;
    }
    out[0] = mxCreateDoubleScalar(k + 1);
}

static void alive(int nout, mxArray *out[], int n, const mxArray *in[]) {
    client_t *client = client_of(n, in);
    z_view_keyexpr_t key = key_of(text(n, in, 2, "a key"));
    z_liveliness_get_options_t options;
    z_liveliness_get_options_default(&options);
    options.timeout_ms = milliseconds(n, in, 3);
    z_owned_closure_reply_t closure;
    z_owned_fifo_handler_reply_t fifo;
    z_fifo_channel_reply_new(&closure, &fifo, 256);
    if (z_liveliness_get(z_loan(client->zenoh), z_loan(key), z_move(closure), &options) < 0) {
        z_drop(z_move(fifo));
        wrong("the query could not be sent; the co-simulation is gone");
    }
    char names[256][128];
    int count = 0;
    z_owned_reply_t reply;
    while (z_recv(z_loan(fifo), &reply) == Z_OK) {
        if (z_reply_is_ok(z_loan(reply)) && count < 256) {
            z_view_string_t view;
            z_keyexpr_as_view_string(z_sample_keyexpr(z_reply_ok(z_loan(reply))), &view);
            size_t size = z_string_len(z_loan(view));
            size = size < sizeof names[0] ? size : sizeof names[0] - 1;
            memcpy(names[count], z_string_data(z_loan(view)), size);
            names[count++][size] = '\0';
        }
        z_drop(z_move(reply));
    }
    z_drop(z_move(fifo));
    out[0] = mxCreateCellMatrix(1, count);
    for (int k = 0; k < count; k++) {
        mxSetCell(out[0], k, mxCreateString(names[k]));
    }
}

static void token(int nout, mxArray *out[], int n, const mxArray *in[]) {
    client_t *client = client_of(n, in);
    z_view_keyexpr_t key = key_of(text(n, in, 2, "a key"));
    if (client->tokens == TOKENS) {
        wrong("16 tokens are declared; open another connection for more");
    }
    z_owned_liveliness_token_t *slot = &client->token[client->tokens];
    if (z_liveliness_declare_token(z_loan(client->zenoh), slot, z_loan(key), NULL) < 0) {
        wrong("the token could not be declared; the co-simulation is gone");
    }
    client->tokens++;
}

static void get(int nout, mxArray *out[], int n, const mxArray *in[]) {
    client_t *client = client_of(n, in);
    z_view_keyexpr_t key = key_of(text(n, in, 2, "a key"));
    z_get_options_t options;
    z_get_options_default(&options);
    options.timeout_ms = milliseconds(n, in, 5);
    options.is_express = true;
    z_owned_bytes_t payload, attachment;
    if (copied(n, in, 3, &payload)) {
        options.payload = z_move(payload);
    }
    if (copied(n, in, 4, &attachment)) {
        options.attachment = z_move(attachment);
    }
    z_owned_closure_reply_t closure;
    z_owned_fifo_handler_reply_t fifo;
    z_fifo_channel_reply_new(&closure, &fifo, 4);
    if (z_get(z_loan(client->zenoh), z_loan(key), "", z_move(closure), &options) < 0) {
        z_drop(z_move(fifo));
        mexErrMsgIdAndTxt("uuvsim:disconnected", "uuvsim: the co-simulation is gone; look at the "
                                                 "window where `uuvsim serve` runs");
    }
    z_owned_reply_t reply;
    z_result_t found = z_recv(z_loan(fifo), &reply);
    if (found != Z_OK) {
        z_drop(z_move(fifo));
        mexErrMsgIdAndTxt("uuvsim:disconnected",
                          "uuvsim: no answer within the timeout: the co-simulation is gone, or "
                          "busy for longer, or the answer is larger than FRAG_MAX_SIZE of this "
                          "zenoh-pico");
    }
    int ok = z_reply_is_ok(z_loan(reply));
    mxArray *attached = NULL;
    if (ok) {
        const z_loaned_sample_t *sample = z_reply_ok(z_loan(reply));
        out[0] = bytes_of(z_sample_payload(sample));
        attached = bytes_of(z_sample_attachment(sample));
    } else {
        out[0] = bytes_of(z_reply_err_payload(z_reply_err(z_loan(reply))));
        attached = bytes_of(NULL);
    }
    z_drop(z_move(reply));
    z_drop(z_move(fifo));
    if (nout > 1) {
        out[1] = attached;
    }
    if (nout > 2) {
        out[2] = mxCreateLogicalScalar(ok);
    }
}

static void watch(int nout, mxArray *out[], int n, const mxArray *in[]) {
    client_t *client = client_of(n, in);
    z_view_keyexpr_t key = key_of(text(n, in, 2, "a key"));
    double keep = number(n, in, 3, "how many blocks may wait");
    if (!(keep >= 1 && keep <= 1e6)) {
        wrong("how many blocks may wait: expected 1 to 1e6");
    }
    if (client->watches == WATCHES) {
        wrong("64 streams are watched; open another connection for more");
    }
    watch_t *slot = &client->watch[client->watches];
    z_owned_closure_sample_t closure;
    z_ring_channel_sample_new(&closure, &slot->ring, (size_t)keep);
    if (z_declare_subscriber(z_loan(client->zenoh), &slot->subscriber, z_loan(key), z_move(closure),
                             NULL) < 0) {
        z_drop(z_move(slot->ring));
        wrong("the stream could not be watched; the co-simulation is gone");
    }
    out[0] = mxCreateDoubleScalar(++client->watches);
}

static void take(int nout, mxArray *out[], int n, const mxArray *in[]) {
    client_t *client = client_of(n, in);
    double which = number(n, in, 2, "what 'watch' gave");
    if (!(which >= 1 && which <= client->watches)) {
        wrong("this stream is not watched; expected what 'watch' gave");
    }
    z_owned_sample_t sample;
    if (z_try_recv(z_loan(client->watch[(int)which - 1].ring), &sample) == Z_OK) {
        out[0] = bytes_of(z_sample_payload(z_loan(sample)));
        z_drop(z_move(sample));
    } else {
        out[0] = bytes_of(NULL);
    }
}

static void close_one(int nout, mxArray *out[], int n, const mxArray *in[]) {
    close_client(client_of(n, in));
}

void mexFunction(int nout, mxArray *out[], int n, const mxArray *in[]) {
    static const struct {
        const char *name;
        void (*act)(int, mxArray *[], int, const mxArray *[]);
    } acts[] = {{"open", open_session}, {"alive", alive}, {"token", token}, {"get", get},
                {"watch", watch},    {"take", take},   {"close", close_one}};
    char *name = text(n, in, 0, "open, alive, token, get, watch, take or close");
    for (size_t k = 0; k < sizeof acts / sizeof acts[0]; k++) {
        if (strcmp(name, acts[k].name) == 0) {
            acts[k].act(nout, out, n, in);
            return;
        }
    }
    wrong("expected open, alive, token, get, watch, take or close");
}
