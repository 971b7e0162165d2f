/* The whole state of an instance, in memory and as bytes: header, then the block's state. */
#ifndef SHELL_STATES_H
#define SHELL_STATES_H

#include "shell_common.h"

typedef struct {
    char magic[8];
    uint64_t token, size, checksum, mode;
    double time, start_time, stop_time;
} state_header;

static const char STATE_MAGIC[8] = {'U', 'U', 'V', 'S', 'T', 'A', 'T', '1'};

static const uint64_t HASH_START = 14695981039346656037u;

/* FNV-1a, continued from h. */
static uint64_t hash_bytes(uint64_t h, const void *data, size_t n) {
    const unsigned char *p = data;
    for (size_t i = 0; i < n; i++) h = (h ^ p[i]) * 1099511628211u;
    return h;
}

static uint64_t token_hash(const shell *s) {
    const char *token = s->block->component->token;
    return hash_bytes(HASH_START, token, strlen(token));
}

static size_t state_bytes(const shell *s) { return sizeof(state_header) + uuv_state_size(s->block); }

/* Copies the state into memory that is allocated unless `old` is given. */
static void *save_state(shell *s, void *old) {
    if (!uuv_state_size(s->block)) {
        refuse(s, "the state of this component cannot be saved");
        return NULL;
    }
    state_header *state = old ? old : malloc(state_bytes(s));
    if (!state) {
        refuse(s, "out of memory");
        return NULL;
    }
    memcpy(state->magic, STATE_MAGIC, sizeof STATE_MAGIC);
    state->token = token_hash(s);
    state->size = state_bytes(s);
    state->checksum = 0;
    state->mode = s->mode;
    state->time = s->time;
    state->start_time = s->start_time;
    state->stop_time = s->stop_time;
    uuv_get_state(s->block, state + 1);
    return state;
}

static int is_state(shell *s, const char *function, const state_header *state) {
    if (!state) return refuse(s, "%s: the state is NULL", function);
    if (memcmp(state->magic, STATE_MAGIC, sizeof STATE_MAGIC) != 0)
        return refuse(s, "%s: this is not a state of such a component", function);
    if (state->token != token_hash(s) || state->size != state_bytes(s))
        return refuse(s, "%s: the state is one of another component, or of another version of it",
                      function);
    return 1;
}

static int restore_state(shell *s, const char *function, const state_header *state) {
    if (!is_state(s, function, state)) return 0;
    if (state->mode & (EVENT_MODE | CONTINUOUS_TIME_MODE | STEP_MODE) &&
        s->exchange != (state->mode != STEP_MODE))
        return refuse(s, "%s: the state is one of %s; expected one of an instance for %s", function,
                      mode_name(state->mode), s->exchange ? "Model Exchange" : "Co-Simulation");
    uuv_set_state(s->block, state + 1);
    s->mode = state->mode;
    s->time = state->time;
    s->start_time = state->start_time;
    s->stop_time = state->stop_time;
    return 1;
}

static int serialize_state(shell *s, const char *function, const state_header *state,
                           unsigned char *bytes, size_t size) {
    if (!is_state(s, function, state)) return 0;
    if (size != state->size)
        return refuse(s, "%s: room for %llu bytes; expected %llu", function,
                      (unsigned long long)size, (unsigned long long)state->size);
    state_header header = *state;
    header.checksum = 0;
    memcpy(bytes, &header, sizeof header);
    memcpy(bytes + sizeof header, state + 1, size - sizeof header);
    header.checksum = hash_bytes(HASH_START, bytes, size);
    memcpy(bytes, &header, sizeof header);
    return 1;
}

/* Reads a state into memory that is allocated unless `old` is given; NULL if refused. */
static void *deserialize_state(shell *s, const char *function, const unsigned char *bytes,
                               size_t size, void *old) {
    state_header header;
    if (size != state_bytes(s) || !bytes) {
        refuse(s, "%s: %llu bytes; expected %llu", function, (unsigned long long)size,
               (unsigned long long)state_bytes(s));
        return NULL;
    }
    memcpy(&header, bytes, sizeof header);
    if (!is_state(s, function, &header)) return NULL;
    const uint64_t checksum = header.checksum;
    header.checksum = 0;
    const uint64_t head = hash_bytes(HASH_START, &header, sizeof header);
    const uint64_t found = hash_bytes(head, bytes + sizeof header, size - sizeof header);
    const int one_mode = header.mode && (header.mode & (header.mode - 1)) == 0;
    if (found != checksum || !one_mode || header.mode > ANY_MODE) {
        refuse(s, "%s: the serialized state is damaged: its checksum does not fit", function);
        return NULL;
    }
    state_header *state = old ? old : malloc(size);
    if (!state) {
        refuse(s, "out of memory");
        return NULL;
    }
    memcpy(state, bytes, size);
    state->checksum = 0;
    return state;
}

#endif
