/* Rigid hulls of a diagonal mass in free water, thrown at a scene: for tests/kernels/throws.py. */
#include "uuv_contact.h"

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

typedef struct {
    double M[6], h, kappa, mu;
    double push[3]; /* a steady acceleration in n, of a thrust */
    int late, steps, pushed; /* how many steps the thrust lasts */
} throw_;

typedef struct {
    double at[13];              /* place, attitude, nu at the end */
    double energy, first, deep; /* the greatest of a step, that of the start, the greatest depth */
    double ahead;               /* the farthest place along N */
} thrown_;

static void rotation(const double *q, double *R) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double all[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                           2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                           2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int k = 0; k < 9; k++) R[k] = all[k];
}

/* Kirchhoff's equations of a body with M alone: place, attitude, nu. */
static void rates(const throw_ *t, const double *s, const double *tau, double *d) {
    const double *q = s + 3, *v = s + 7, *w = s + 10;
    double R[9], p[3], L[3], pw[3], Lw[3], pv[3];
    rotation(q, R);
    for (int k = 0; k < 3; k++) {
        d[k] = uuv_dot_(R + 3 * k, v);
        p[k] = t->M[k] * v[k];
        L[k] = t->M[3 + k] * w[k];
    }
    d[3] = -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2]);
    d[4] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
    d[5] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]);
    d[6] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
    uuv_cross_(p, w, pw);
    uuv_cross_(L, w, Lw);
    uuv_cross_(p, v, pv);
    for (int k = 0; k < 3; k++) {
        d[7 + k] = (pw[k] + tau[k]) / t->M[k];
        for (int i = 0; i < 3; i++) d[7 + k] += R[3 * i + k] * t->push[i];
        d[10 + k] = (Lw[k] + pv[k] + tau[3 + k]) / t->M[3 + k];
    }
}

static void advance(const throw_ *t, double *s, const double *tau) {
    const int n = 1 + (int)(t->h / 0.005);
    const double h = t->h / n;
    for (int i = 0; i < n; i++) {
        double k[4][13], at[13];
        for (int stage = 0; stage < 4; stage++) {
            const double part = stage == 0 ? 0.0 : stage == 3 ? h : 0.5 * h;
            for (int j = 0; j < 13; j++) at[j] = s[j] + (stage ? part * k[stage - 1][j] : 0.0);
            rates(t, at, tau, k[stage]);
        }
        double size = 0.0;
        for (int j = 0; j < 13; j++) s[j] += h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
        for (int j = 3; j < 7; j++) size += s[j] * s[j];
        for (int j = 3; j < 7; j++) s[j] /= uuv_root_(size);
    }
}

static double energy(const throw_ *t, const double *s) {
    double e = 0.0;
    for (int k = 0; k < 6; k++) e += 0.5 * t->M[k] * s[7 + k] * s[7 + k];
    return e;
}

/* s: place, attitude (scalar first), nu. A force arrives `late` steps after the pose it is of. */
API void contact_throw(const uuv_hull *hull, const throw_ *given, const double *start, thrown_ *out) {
    throw_ of = *given, *t = &of;
    double s[13], tau[3][6] = {{0.0}};
    double x[UUV_CONTACT_HEAD], y[8], seen[UUV_PLACE_HEAD], memory[4] = {0.0};
    for (int j = 0; j < 13; j++) s[j] = start[j];
    out->first = energy(t, s);
    out->energy = -__builtin_inf();
    out->deep = 0.0;
    out->ahead = s[0];
    for (int step = 0; step < t->steps; step++) {
        if (step == t->pushed) t->push[0] = t->push[1] = t->push[2] = 0.0;
        for (int k = 0; k < 3; k++) x[k] = s[k];
        rotation(s + 3, x + 3);
        for (int k = 0; k < 6; k++) x[12 + k] = s[7 + k], x[18 + k] = t->M[k];
        x[24] = t->h;
        x[25] = t->kappa;
        x[26] = t->mu;
        for (int k = 0; k < 4; k++) x[27 + k] = memory[k];
        for (int k = 0; k < 12; k++) seen[k] = x[k];
        seen[12] = t->h;
        for (int k = 0; k < 4; k++) seen[13 + k] = memory[k];
        uuv_contact(hull, 0, x, y);
        uuv_place(hull, seen, memory);
        for (int k = 0; k < 6; k++) {
            tau[2][k] = tau[1][k];
            tau[1][k] = tau[0][k];
            tau[0][k] = y[k];
        }
        if (y[6] > out->deep) out->deep = y[6];
        advance(t, s, tau[t->late]);
        const double e = energy(t, s);
        if (e > out->energy) out->energy = e;
        if (s[0] > out->ahead) out->ahead = s[0];
    }
    for (int j = 0; j < 13; j++) out->at[j] = s[j];
}

/* The force and the remembered place of n poses, as components call for them. */
API void contact_values(const uuv_hull *hull, int n, const double *x, double *y) {
    for (int i = 0; i < n; i++) uuv_contact(hull, 0, x + UUV_CONTACT_HEAD * i, y + 8 * i);
}

API void contact_places(const uuv_hull *hull, int n, const double *x, double *y) {
    for (int i = 0; i < n; i++) uuv_place(hull, x + UUV_PLACE_HEAD * i, y + 4 * i);
}
