/* SPDX-License-Identifier: Apache-2.0 */
/* A decision transformer in float32 on W lanes: the last action of a history of returns to go,
 * observations and actions, oldest first.
 *
 * Three tokens a place: its return, its observation, its action, each embedded and with the place's
 * time added, then normed. A block adds attention(norm(x)), each token over itself and those before
 * that are there, then layers(norm(x)). The action is the head of the normed token of the last
 * observation. All sums are in one order for every W (uuv_network.h). No heap: the caller gives
 * room for uuv_transformer_room neurons.
 */
#ifndef UUV_TRANSFORMER_H
#define UUV_TRANSFORMER_H

#include "uuv_network.h"

enum { UUV_GELU = 3 };

typedef struct {
    const float *scale, *shift;
} uuv_norm;

typedef struct {
    uuv_norm norm_1, norm_2;
    uuv_layer qkv, out, wide, narrow; /* qkv: queries, then keys, then values */
} uuv_block;

typedef struct {
    int places, observed, acted, hidden, heads, blocks, times;
    uuv_layer of_return, of_observation, of_action, head;
    const float *of_time; /* [times][hidden] */
    uuv_norm tokens, last;
    const uuv_block *block;
} uuv_transformer;

#define UUV_TRANSFORMER_ROOM(places, hidden, widest) \
    (3 * (3 * (places) - 1) * (hidden) + 2 * (hidden) + 2 * (widest) + 3 * (places))

#if defined(UUV_FLOAT32) || UUV_W > 1
#define uuv_neuron_(c) uuv_neuron_const_(c)
#else
#define uuv_neuron_(c) (c)
#endif

static inline void uuv_norm_(uuv_norm l, const uuv_neuron *x, uuv_neuron *y, int n) {
    uuv_neuron sum = uuv_neuron_(0.0f), square = sum;
    for (int i = 0; i < n; i++) sum += x[i];
    const uuv_neuron mean = sum / (float)n;
    for (int i = 0; i < n; i++) square += (x[i] - mean) * (x[i] - mean);
    const V size = uuv_sqrt(uuv_of_neuron_(square / (float)n + 1e-5f));
    const uuv_neuron inverse = uuv_neuron_of_(uuv_const(1.0) / size);
    for (int i = 0; i < n; i++) y[i] = (x[i] - mean) * inverse * l.scale[i] + l.shift[i];
}

/* x (1 + erf(x / sqrt 2)) / 2 with erf of Abramowitz and Stegun, 7.1.26, within 2e-7. */
static inline V uuv_gelu_(V x) {
    const V one = uuv_const(1.0), z = uuv_fabs(x) * uuv_const(0.7071067811865476);
    const V t = one / (one + uuv_const(0.3275911) * z);
    V p = uuv_const(1.061405429) * t - uuv_const(1.453152027);
    p = p * t + uuv_const(1.421413741);
    p = p * t - uuv_const(0.284496736);
    p = (p * t + uuv_const(0.254829592)) * t;
    const V erf = uuv_copysign(one - p * uuv_exp(uuv_neg(z * z)), x);
    return uuv_const(0.5) * x * (one + erf);
}

static inline void uuv_wide_activate_(int activation, uuv_neuron *y, int n) {
    if (activation != UUV_GELU) {
        uuv_activate_(activation, y, 0, n);
        return;
    }
    for (int i = 0; i < n; i++) y[i] = uuv_neuron_of_(uuv_gelu_(uuv_of_neuron_(y[i])));
}

/* The places that are there are the last ones: as many as there have been actions, and this one. */
static inline uuv_neuron uuv_there_(V past, int place, int places) {
    return uuv_neuron_of_(uuv_truth(uuv_mask_le(uuv_const((uuv_real)(places - 1 - place)), past)));
}

/* y = attention of token t, whose query is q, over tokens 0 ... t; `weights` holds t + 1. */
static inline void uuv_attend_(const uuv_transformer *m, const uuv_neuron *q, const uuv_neuron *k,
                               const uuv_neuron *v, int t, V past, uuv_neuron *y,
                               uuv_neuron *weights) {
    const int h = m->hidden, width = h / m->heads;
    const uuv_neuron scale = uuv_neuron_of_(uuv_const(1.0) / uuv_sqrt(uuv_const((uuv_real)width)));
    for (int first = 0; first < h; first += width) {
        V most = uuv_const(-1e30), total = uuv_const(0.0);
        for (int s = 0; s <= t; s++) {
            uuv_neuron dot = uuv_neuron_(0.0f);
            for (int i = first; i < first + width; i++) dot += q[i] * k[s * h + i];
            weights[s] = dot * scale;
            const uuv_mask here = uuv_mask_true(uuv_of_neuron_(uuv_there_(past, s / 3, m->places)));
            const V score = uuv_select(here, uuv_of_neuron_(weights[s]), uuv_const(-1e30));
            most = uuv_select(uuv_mask_lt(most, score), score, most);
        }
        for (int s = 0; s <= t; s++) {
            const V there = uuv_of_neuron_(uuv_there_(past, s / 3, m->places));
            const V score = uuv_select(uuv_mask_true(there), uuv_of_neuron_(weights[s]), most);
            const V weight = there * uuv_exp(score - most);
            weights[s] = uuv_neuron_of_(weight);
            total += weight;
        }
        /* A token of a place that is not there attends to nothing. */
        total = uuv_select(uuv_mask_eq(total, uuv_const(0.0)), uuv_const(1.0), total);
        const uuv_neuron inverse = uuv_neuron_of_(uuv_const(1.0) / total);
        for (int i = first; i < first + width; i++) {
            uuv_neuron sum = uuv_neuron_(0.0f);
            for (int s = 0; s <= t; s++) sum += weights[s] * v[s * h + i];
            y[i] = sum * inverse;
        }
    }
}

/* in: how many actions there have been; then each place's return, observation and action. */
static inline void uuv_transform(const uuv_transformer *m, const V *in, V *out, uuv_neuron *room,
                                 int widest) {
    const int h = m->hidden, n = 3 * m->places - 1, each = 1 + m->observed + m->acted;
    uuv_neuron *x = room, *k = x + n * h, *v = k + n * h, *a = v + n * h, *y = a + h;
    uuv_neuron *p = y + h, *q = p + widest, *weights = q + widest;
    const V past = in[0];
    for (int t = 0; t < n; t++) {
        const int place = t / 3, kind = t % 3;
        const uuv_layer *l = kind == 0   ? &m->of_return
                             : kind == 1 ? &m->of_observation
                                         : &m->of_action;
        const int skip = kind == 0 ? 0 : kind == 1 ? 1 : 1 + m->observed;
        for (int i = 0; i < l->n_in; i++)
            p[i] = uuv_neuron_of_(in[1 + place * each + skip + i]);
        uuv_layer_sums_(l, p, a, 1);
        const V at = past - uuv_const((uuv_real)(m->places - 1 - place));
        for (int i = 0; i < h; i++) {
            V time = uuv_const(0.0);
            for (int lane = 0; lane < UUV_W; lane++) {
                const uuv_real wanted = uuv_lane(at, lane);
                const int row = !(wanted > 0) ? 0 : wanted > m->times - 1 ? m->times - 1 : (int)wanted;
                const uuv_real value = (uuv_real)m->of_time[row * h + i];
#if UUV_W == 1
                time = value;
#else
                time[lane] = value;
#endif
            }
            a[i] += uuv_neuron_of_(time);
        }
        uuv_norm_(m->tokens, a, x + t * h, h);
    }
    for (const uuv_block *b = m->block; b < m->block + m->blocks; b++) {
        const int last = b == m->block + m->blocks - 1; /* only the last token is asked for then */
        for (int t = 0; t < n; t++) {
            uuv_neuron *token = x + t * h;
            uuv_norm_(b->norm_1, token, a, h);
            uuv_layer_sums_(&b->qkv, a, p, 1);
            for (int i = 0; i < h; i++) {
                k[t * h + i] = p[h + i];
                v[t * h + i] = p[2 * h + i];
            }
            if (last && t < n - 1) continue;
            uuv_attend_(m, p, k, v, t, past, y, weights);
            uuv_layer_sums_(&b->out, y, a, 1);
            for (int i = 0; i < h; i++) token[i] += a[i];
            uuv_norm_(b->norm_2, token, a, h);
            uuv_layer_sums_(&b->wide, a, q, 1);
            uuv_wide_activate_(b->wide.activation, q, b->wide.n_out);
            uuv_layer_sums_(&b->narrow, q, a, 1);
            for (int i = 0; i < h; i++) token[i] += a[i];
        }
    }
    uuv_norm_(m->last, x + (n - 1) * h, a, h);
    uuv_layer_sums_(&m->head, a, p, 1);
    for (int i = 0; i < m->acted; i++) out[i] = uuv_of_neuron_(p[i]);
}

#endif
