/* SPDX-License-Identifier: Apache-2.0 */
/* Multilayer perceptrons in float32 on W lanes, and their forward and reverse derivatives.
 *
 * A layer gives  y_j = f(b_j + sum_i w_ij x_i). The sum is one of parts of UUV_CHUNK products,
 * each added from the first on, so that it has the same bits for every W and is as exact as sums
 * by pairs. Weights lie in blocks of UUV_WIDE outputs: w[block][i][UUV_WIDE], the last one filled
 * up with zeros. No heap; the caller gives room for two vectors of the widest layer.
 */
#ifndef UUV_NETWORK_H
#define UUV_NETWORK_H

#if defined(UUV_FLOAT32)
#include "uuv_float_math.h"
#else
#include "uuv_math.h"
#endif

#define UUV_CHUNK 16
#define UUV_WIDE 16

enum uuv_activation { UUV_LINEAR = 0, UUV_RELU = 1, UUV_TANH = 2 };

typedef struct {
    int n_in, n_out, activation;
    const float *weight, *bias; /* both filled up to whole blocks */
} uuv_layer;

/* The number of a neuron: a float32 in each lane. */
#if defined(UUV_FLOAT32)
typedef V uuv_neuron;
static inline uuv_neuron uuv_neuron_of_(V x) { return x; }
static inline V uuv_of_neuron_(uuv_neuron x) { return x; }
static inline uuv_neuron uuv_neuron_const_(float c) { return uuv_const(c); }
#elif UUV_W == 1
typedef float uuv_neuron;
static inline uuv_neuron uuv_neuron_of_(V x) { return (float)x; }
static inline V uuv_of_neuron_(uuv_neuron x) { return (double)x; }
#else
typedef float uuv_neuron __attribute__((vector_size(4 * UUV_W)));
static inline uuv_neuron uuv_neuron_of_(V x) { return __builtin_convertvector(x, uuv_neuron); }
static inline V uuv_of_neuron_(uuv_neuron x) { return __builtin_convertvector(x, V); }
static inline uuv_neuron uuv_neuron_const_(float c) { return c - (uuv_neuron){0}; }
#endif

#if !defined(UUV_FLOAT32) && UUV_W == 1

/* One lane: the outputs of a block side by side. */
typedef float uuv_wide_ __attribute__((vector_size(4 * UUV_WIDE)));
typedef float uuv_wide_read_ __attribute__((vector_size(4 * UUV_WIDE), aligned(4), may_alias));

static void uuv_layer_sums_(const uuv_layer *l, const uuv_neuron *x, uuv_neuron *y, int biased) {
    for (int first = 0; first < l->n_out; first += UUV_WIDE) {
        const float *w = l->weight + (int64_t)first * (int64_t)l->n_in;
        uuv_wide_ total = {0};
        if (biased) total = *(const uuv_wide_read_ *)(l->bias + first);
        for (int i = 0; i < l->n_in;) {
            const int end = i + UUV_CHUNK < l->n_in ? i + UUV_CHUNK : l->n_in;
            uuv_wide_ part = {0};
            for (; i < end; i++)
                part += x[i] * *(const uuv_wide_read_ *)(w + (int64_t)i * UUV_WIDE);
            total += part;
        }
        const int count = l->n_out - first < UUV_WIDE ? l->n_out - first : UUV_WIDE;
        for (int j = 0; j < count; j++) y[first + j] = total[j];
    }
}

#else

/* Many lanes: some outputs at a time, each over all lanes. */
#define UUV_ABREAST_ 8

static void uuv_layer_sums_(const uuv_layer *l, const uuv_neuron *x, uuv_neuron *y, int biased) {
    for (int first = 0; first < l->n_out; first += UUV_ABREAST_) {
        const int block = first / UUV_WIDE * UUV_WIDE;
        const float *w = l->weight + (int64_t)block * (int64_t)l->n_in + (first - block);
        uuv_neuron total[UUV_ABREAST_];
        for (int j = 0; j < UUV_ABREAST_; j++)
            total[j] = uuv_neuron_const_(biased ? l->bias[first + j] : 0.0f);
        for (int i = 0; i < l->n_in;) {
            const int end = i + UUV_CHUNK < l->n_in ? i + UUV_CHUNK : l->n_in;
            uuv_neuron part[UUV_ABREAST_];
            for (int j = 0; j < UUV_ABREAST_; j++) part[j] = uuv_neuron_const_(0.0f);
            for (; i < end; i++)
                for (int j = 0; j < UUV_ABREAST_; j++) part[j] += x[i] * w[i * UUV_WIDE + j];
            for (int j = 0; j < UUV_ABREAST_; j++) total[j] += part[j];
        }
        const int count = l->n_out - first < UUV_ABREAST_ ? l->n_out - first : UUV_ABREAST_;
        for (int j = 0; j < count; j++) y[first + j] = total[j];
    }
}

#endif

/* f(y), and what it does to a derivative dy where one is given; NaN stays NaN. */
static inline void uuv_activate_(int activation, uuv_neuron *y, uuv_neuron *dy, int n) {
    if (activation == UUV_LINEAR) return;
    for (int j = 0; j < n; j++) {
        const V a = uuv_of_neuron_(y[j]), zero = uuv_const(0.0);
        V f, slope;
        if (activation == UUV_RELU) {
            f = uuv_select(uuv_mask_lt(a, zero), zero, a);
            slope = uuv_truth(uuv_mask_gt(a, zero));
        } else {
            f = uuv_of_neuron_(uuv_neuron_of_(uuv_tanh(a)));
            slope = uuv_const(1.0) - f * f;
        }
        y[j] = uuv_neuron_of_(f);
        if (dy) dy[j] = uuv_neuron_of_(slope * uuv_of_neuron_(dy[j]));
    }
}

/* out = network(in); `room` holds 2 vectors of the widest layer, inputs included. */
static inline void uuv_network(const uuv_layer *layers, int n, const V *in, V *out,
                               uuv_neuron *room, int widest) {
    uuv_neuron *x = room, *y = room + widest;
    for (int i = 0; i < layers[0].n_in; i++) x[i] = uuv_neuron_of_(in[i]);
    for (const uuv_layer *l = layers; l < layers + n; l++) {
        uuv_layer_sums_(l, x, y, 1);
        uuv_activate_(l->activation, y, 0, l->n_out);
        uuv_neuron *swap = x;
        x = y;
        y = swap;
    }
    for (int j = 0; j < layers[n - 1].n_out; j++) out[j] = uuv_of_neuron_(x[j]);
}

/* out = d network(in) / d in  seed; `room` holds 4 vectors of the widest layer. */
static inline void uuv_network_forward(const uuv_layer *layers, int n, const V *in, const V *seed,
                                       V *out, uuv_neuron *room, int widest) {
    uuv_neuron *x = room, *y = x + widest, *dx = y + widest, *dy = dx + widest;
    for (int i = 0; i < layers[0].n_in; i++) {
        x[i] = uuv_neuron_of_(in[i]);
        dx[i] = uuv_neuron_of_(seed[i]);
    }
    for (const uuv_layer *l = layers; l < layers + n; l++) {
        uuv_layer_sums_(l, x, y, 1);
        uuv_layer_sums_(l, dx, dy, 0);
        uuv_activate_(l->activation, y, dy, l->n_out);
        uuv_neuron *swap = x;
        x = y;
        y = swap;
        swap = dx;
        dx = dy;
        dy = swap;
    }
    for (int j = 0; j < layers[n - 1].n_out; j++) out[j] = uuv_of_neuron_(dx[j]);
}

/* out = (d network(in) / d in) transposed  seed; `room` holds what every layer gives, `all` in
 * number with the inputs, and 2 vectors of the widest layer. */
static inline void uuv_network_adjoint(const uuv_layer *layers, int n, const V *in, const V *seed,
                                       V *out, uuv_neuron *room, int all, int widest) {
    uuv_neuron *x = room, *dy = room + all, *dx = dy + widest;
    for (int i = 0; i < layers[0].n_in; i++) x[i] = uuv_neuron_of_(in[i]);
    for (const uuv_layer *l = layers; l < layers + n; l++) {
        uuv_layer_sums_(l, x, x + l->n_in, 1);
        x += l->n_in;
        uuv_activate_(l->activation, x, 0, l->n_out);
    }
    for (int j = 0; j < layers[n - 1].n_out; j++) dy[j] = uuv_neuron_of_(seed[j]);
    for (const uuv_layer *l = layers + n - 1; l >= layers; l--) {
        for (int j = 0; j < l->n_out && l->activation != UUV_LINEAR; j++) {
            const V y = uuv_of_neuron_(x[j]), one = uuv_const(1.0);
            const V slope = l->activation == UUV_RELU
                                ? uuv_truth(uuv_mask_gt(y, uuv_const(0.0)))
                                : one - y * y;
            dy[j] = uuv_neuron_of_(slope * uuv_of_neuron_(dy[j]));
        }
        for (int i = 0; i < l->n_in; i++) {
            uuv_neuron total = uuv_neuron_of_(uuv_const(0.0));
            for (int j = 0; j < l->n_out; j++) {
                const int64_t block = j / UUV_WIDE * (int64_t)l->n_in + i;
                total += dy[j] * l->weight[block * UUV_WIDE + j % UUV_WIDE];
            }
            dx[i] = total;
        }
        uuv_neuron *swap = dx;
        dx = dy;
        dy = swap;
        x -= l->n_in;
    }
    for (int i = 0; i < layers[0].n_in; i++) out[i] = uuv_of_neuron_(dy[i]);
}

#endif
