/* Runge-Kutta steps of the component before it, whose functions and sizes are known when they are
 * compiled. Its generated file includes this at its end. */
#ifndef UUV_STEP_H
#define UUV_STEP_H

#include "uuv_component.h"

static void derivatives(const V *b, V *w, V *dx) {
    held(b, w);
    rhs(b, w, dx);
}

/* n classical Runge-Kutta steps of length h from time t, of m components side by side, so that none
 * waits for results of another. `w` gets the values that are held. */
static inline __attribute__((always_inline)) void stages(V *const *b, V *const *w, uint32_t m, double t,
                                                         double h, uint32_t n) {
    enum { MOST = N_X <= UUV_SMALL ? UUV_TOGETHER : 1 };
    V x0[MOST][N_X + 1], k1[MOST][N_X + 1], k2[MOST][N_X + 1], k3[MOST][N_X + 1], k4[MOST][N_X + 1];
    const V half = uuv_const(0.5 * h), sixth = uuv_const(h / 6.0), whole = uuv_const(h);
    const V two = uuv_const(2.0);
    for (uint32_t j = 0; j < m; j++) held(b[j], w[j]);
    for (uint32_t piece = 0; piece < n; piece++) {
        const double begin = t + (double)piece * h;
        for (uint32_t j = 0; j < m; j++) {
            V *const x = b[j] + OFF_X;
            for (uint32_t i = 0; i < N_X; i++) x0[j][i] = x[i];
            b[j][0] = uuv_const(begin);
            rhs(b[j], w[j], k1[j]);
        }
        for (uint32_t j = 0; j < m; j++) {
            V *const x = b[j] + OFF_X;
            b[j][0] = uuv_const(begin + 0.5 * h);
            for (uint32_t i = 0; i < N_X; i++) x[i] = x0[j][i] + half * k1[j][i];
            rhs(b[j], w[j], k2[j]);
        }
        for (uint32_t j = 0; j < m; j++) {
            V *const x = b[j] + OFF_X;
            for (uint32_t i = 0; i < N_X; i++) x[i] = x0[j][i] + half * k2[j][i];
            rhs(b[j], w[j], k3[j]);
        }
        for (uint32_t j = 0; j < m; j++) {
            V *const x = b[j] + OFF_X;
            b[j][0] = uuv_const(begin + h);
            for (uint32_t i = 0; i < N_X; i++) x[i] = x0[j][i] + whole * k3[j][i];
            rhs(b[j], w[j], k4[j]);
            for (uint32_t i = 0; i < N_X; i++)
                x[i] = uuv_settled(x0[j][i] + sixth * (k1[j][i] + two * k2[j][i] + two * k3[j][i] + k4[j][i]));
        }
    }
}

static void integrate(V *const *b, V *const *w, uint32_t m, double t, double h, uint32_t n) {
    if (N_X > UUV_SMALL || m == 1)
        for (uint32_t j = 0; j < m; j++) stages(b + j, w + j, 1, t, h, n);
    else
        stages(b, w, m, t, h, n);
}

static void block_outputs(V *b) { outputs(b, b + OFF_Y); }
static void block_outputs_of_step(V *b, const V *w) { outputs_of_step(b, w, b + OFF_Y); }

#endif
