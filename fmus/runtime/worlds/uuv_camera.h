/* SPDX-License-Identifier: Apache-2.0 */
/* Colour image of a scene in water, in linear light.
 *
 * A pixel's ray meets a surface at the distance z. The radiance that arrives in channel c is, by D. Akkaynak and
 * T. Treibitz, A revised underwater image formation model, CVPR 2018,
 *
 *     L = rho / pi (E_sun + E_lamps) e^(-beta_D z) + V E0 e^(-K D_camera) (1 - e^(-beta_B z)) + L_lamps,
 *
 * where E_sun = E0 e^(-K D) (1 + up) / 2 is the light of a uniform sky on a surface whose normal has the
 * upward part `up`. A lamp of the intensity I gives I cone cos / d^2 e^(-beta_D d) on the surface. Along
 * the ray, its light is scattered once, with the phase function p of Henyey and Greenstein (1941):
 *
 *     L_lamps = b integral of p(theta) I cone / d^2 e^(-beta_D (d + s)) ds,  s from 0 to z.
 *
 * The integral has the variable t = tan(phi / 2) of the angle phi at the lamp, in which 1 / d^2 is smooth. A pixel
 * collects N = L * sensitivity electrons on average: Poisson noise, then read noise, gain, rounding to 0 ... 255.
 *
 * The surface is flat and seen from below: Fresnel's and Snell's laws for the sky, which is uniform, and one mirror image.
 *
 * Arithmetic by + - * / sqrt and tables alone: bits are equal for every W, compiler and processor.
 */
#ifndef UUV_CAMERA_H
#define UUV_CAMERA_H

#include "uuv_sonar.h"

#define UUV_CAMERA_POINTS 8   /* of the integral along a ray */
#define UUV_CAMERA_LAMP 11    /* numbers of a lamp */
#define UUV_CAMERA_OCTAVES 4  /* of the texture */
#define UUV_CAMERA_LAMPS 16   /* most of them */
#define UUV_CAMERA_WATER 1.34 /* refractive index over that of air */
#define UUV_CAMERA_ENTERS 0.93248938778672 /* share of the light of a uniform sky that enters water of this index */
#define UUV_CAMERA_NEAR 1e-9  /* m below the surface: a ray does not start on it */
enum { UUV_CAMERA_HEAD = 50 };

typedef struct {
    int rows, columns, lamps, n_moving;
    double farthest;
    double texture_size;          /* longest wave of the texture [m] */
    uint64_t texture_seed;
    const double *seabed;         /* reflectance by channel (3) */
    const double *solid;          /* reflectance of each solid, mesh and mover (3 each) */
    const double *points;         /* [UUV_CAMERA_POINTS]: place from -1 to 1, and weight */
    const float *normal;          /* [UUV_SONAR_TABLE]: quantiles of the normal distribution */
} uuv_camera;

typedef double uuv_colour_ __attribute__((vector_size(32))); /* three channels, and one that is not used */
typedef uint64_t uuv_colour_bits_ __attribute__((vector_size(32)));
typedef float uuv_points_ __attribute__((vector_size(4 * UUV_CAMERA_POINTS)));
typedef uint32_t uuv_points_bits_ __attribute__((vector_size(4 * UUV_CAMERA_POINTS)));

/* exp(-x) for 0 <= x; 0 beyond 700. Relative error below 1e-11. */
static inline uuv_colour_ uuv_decay_(uuv_colour_ x) {
    union {
        uuv_colour_ x;
        uuv_colour_bits_ bits;
    } u;
    const uuv_colour_bits_ kept = (uuv_colour_bits_)(x < 700.0);
    u.x = x;
    u.bits &= kept;
    const uuv_colour_ k = (u.x * -0x1.71547652b82fep0 + 0x1.8p52) - 0x1.8p52;
    const uuv_colour_ r = (-u.x - k * 0x1.62e42fefa38p-1) - k * 0x1.ef35793c7673p-45;
    const uuv_colour_ r2 = r * r, r4 = r2 * r2;
    const uuv_colour_ low = (r + 1.0) + r2 * (r * (1.0 / 6.0) + 0.5);
    const uuv_colour_ high = (r * (1.0 / 120.0) + 1.0 / 24.0) + r2 * (r * (1.0 / 5040.0) + 1.0 / 720.0);
    const uuv_colour_ p = low + r4 * (high + r4 * (r * (1.0 / 362880.0) + 1.0 / 40320.0));
    u.x = k + (0x1.8p52 + 1023.0);
    u.bits = (u.bits << 52) & kept;
    return p * u.x;
}

static inline uuv_colour_ uuv_colour_of_(const double *x) { return (uuv_colour_){x[0], x[1], x[2], 0.0}; }
static inline uuv_colour_ uuv_grey_(double x) { return (uuv_colour_){x, x, x, 0.0}; }

/* Radius in the plane at distance 1 of what the lens shows at the radius r: r = u (1 + k1 u^2 + k2 u^4). */
static inline double uuv_undistorted_(double r, double k1, double k2) {
    double u = r;
    for (int i = 0; i < 12; i++) {
        const double q = u * u, off = u * (1.0 + q * (k1 + q * k2)) - r;
        u -= off / (1.0 + q * (3.0 * k1 + q * 5.0 * k2));
        if (off * off <= 1e-24 * r * r) break;
    }
    return u;
}

/* Value of a corner of the noise's grid, from -1 to 1. */
static inline double uuv_corner_value_(uint64_t h) {
    h = (h ^ (h >> 32)) * 0xff51afd7ed558ccdu;
    return (double)(int64_t)((h ^ (h >> 32)) & 0xffffffffu) * 0x1p-31 - 1.0;
}

/* Value noise from -1 to 1 at p, in units of its cells. */
static inline double uuv_noise_(uint64_t seed, double x, double y, double z) {
    const int64_t i = uuv_floor_(x), j = uuv_floor_(y), k = uuv_floor_(z);
    const double u = x - (double)i, v = y - (double)j, w = z - (double)k;
    const double a = u * u * (3.0 - 2.0 * u), b = v * v * (3.0 - 2.0 * v), c = w * w * (3.0 - 2.0 * w);
    const uint64_t h = seed + (uint64_t)i * 0xd1342543de82ef95u + (uint64_t)j * 0xaf251af3b0f025b5u +
                       (uint64_t)k * 0x9fb21c651e98df25u;
    double along[4];
    for (int n = 0; n < 4; n++) {
        const uint64_t g = h + (n & 1 ? 0xaf251af3b0f025b5u : 0u) + (n >> 1 ? 0x9fb21c651e98df25u : 0u);
        const double first = uuv_corner_value_(g);
        along[n] = first + a * (uuv_corner_value_(g + 0xd1342543de82ef95u) - first);
    }
    const double low = along[0] + b * (along[1] - along[0]), high = along[2] + b * (along[3] - along[2]);
    return low + c * (high - low);
}

/* Texture at p, from -1 to 1: octaves whose cells are shorter than `footprint` fade out. */
static inline double uuv_texture_(const uuv_camera *cam, const double p[3], double footprint) {
    double sum = 0.0, size = cam->texture_size, weight = 0.5;
    for (int n = 0; n < UUV_CAMERA_OCTAVES; n++, size *= 0.5, weight *= 0.5) {
        const double clear = size / footprint - 1.0;
        if (!(clear > 0.0)) break;
        const double share = clear < 1.0 ? clear : 1.0, per = 1.0 / size;
        sum += weight * share * uuv_noise_(cam->texture_seed + (uint64_t)n, p[0] * per, p[1] * per, p[2] * per);
    }
    return sum;
}

/* Share of a lamp's intensity in a direction: 1 within its inner cone, 0 outside its outer one. */
static inline double uuv_cone_(const double *lamp, double cosine) {
    const double share = (cosine - lamp[10]) / (lamp[9] - lamp[10]);
    return share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
}

/* exp(-x) of each point for 0 <= x; 0 beyond 80. Relative error below 3e-7, and 6e-8 x from the rounding of x. */
static inline uuv_points_ uuv_decays_(uuv_points_ x) {
    const uuv_points_bits_ kept = (uuv_points_bits_)(x < 80.0f);
    x = (uuv_points_)((uuv_points_bits_)x & kept);
    const uuv_points_ k = (x * -0x1.715476p0f + 0x1.8p23f) - 0x1.8p23f;
    const uuv_points_ r = (-x - k * 0x1.63p-1f) + k * 0x1.bd0106p-13f;
    uuv_points_ p = r * (1.0f / 720.0f) + 1.0f / 120.0f;
    p = p * r + 1.0f / 24.0f;
    p = p * r + 1.0f / 6.0f;
    p = p * r + 0.5f;
    p = p * r + 1.0f;
    p = p * r + 1.0f;
    return p * (uuv_points_)(((uuv_points_bits_)(k + (0x1.8p23f + 127.0f)) << 23) & kept);
}

static inline uuv_points_ uuv_roots_(uuv_points_ x) {
#if defined(__clang__)
    return __builtin_elementwise_sqrt(x);
#else
    for (int n = 0; n < UUV_CAMERA_POINTS; n++) x[n] = __builtin_sqrtf(x[n]);
    return x;
#endif
}

/* Light of a lamp that water scatters into the ray from o along the unit vector d, up to the distance z.
 *
 * With h the distance of the ray from the lamp, s0 that of the nearest point along the ray, A = 1 + t^2 and
 * P = (1 - g)^2 A + 2 g (1 + t)^2, the place on the ray is s = s0 + 2 h t / (1 - t^2), the way of the light
 * d + s = s0 + h (1 + t) / (1 - t), and p(theta) ds / d^2 = (1 - g^2) / (2 pi h) A^(1/2) P^(-3/2) dt.
 * All points at once, in single precision: the relative error of the sum is below 1e-5. */
static inline uuv_colour_ uuv_lamp_veil_(const uuv_camera *cam, const double *lamp, const double o[3],
                                         const double d[3], double z, uuv_colour_ beta, double g) {
    double to[3];
    for (int k = 0; k < 3; k++) to[k] = lamp[k] - o[k];
    const double s0 = uuv_dot_(to, d), square = uuv_dot_(to, to) - s0 * s0;
    const double h = uuv_root_(square > 1e-4 ? square : 1e-4), per = 1.0 / h; /* a lamp has a radius of 1 cm */
    const double low = -s0 * per, high = (z - s0) * per;
    const double t0 = low / (1.0 + uuv_root_(1.0 + low * low)), t1 = high / (1.0 + uuv_root_(1.0 + high * high));
    const double on_ray = uuv_dot_(lamp + 3, d), at_nearest = (s0 * on_ray - uuv_dot_(to, lamp + 3)) * per;
    const double narrow = 1.0 / (lamp[9] - lamp[10]), shorter = (1.0 - g) * (1.0 - g);
    uuv_points_ place, weight;
    for (int n = 0; n < UUV_CAMERA_POINTS; n++) {
        place[n] = (float)cam->points[2 * n];
        weight[n] = (float)cam->points[2 * n + 1];
    }
    const uuv_points_ t = (float)(0.5 * (t0 + t1)) + (float)(0.5 * (t1 - t0)) * place;
    const uuv_points_ more = 1.0f + t, less = 1.0f - t, A = 1.0f + t * t;
    const uuv_points_ P = (float)shorter * A + (float)(2.0 * g) * (more * more);
    const uuv_points_ one = 1.0f / (A * less * P), per_P = one * A * less;
    uuv_points_ share = ((float)at_nearest * (more * less) + (float)(2.0 * on_ray) * t) * (one * less * P);
    share = (share - (float)lamp[10]) * (float)narrow;
    const uuv_points_bits_ lit = (uuv_points_bits_)(share > 0.0f), whole = (uuv_points_bits_)(share > 1.0f);
    share = (uuv_points_)((uuv_points_bits_)share & lit & ~whole) +
            (uuv_points_)((uuv_points_bits_)(0.0f * t + 1.0f) & whole);
    weight *= share * uuv_roots_(A * per_P) * per_P;
    const uuv_points_ way = (float)s0 + (float)h * more * (one * A * P);
    const double scale = (1.0 - g * g) * (t1 - t0) * 0.5 / 0x1.921fb54442d18p2 * per;
    uuv_colour_ sum = uuv_grey_(0.0);
    for (int c = 0; c < 3; c++) {
        const uuv_points_ x = (float)beta[c] * way;
        const uuv_points_ e = weight * uuv_decays_((uuv_points_)((uuv_points_bits_)x & (uuv_points_bits_)(x > 0.0f)));
        sum[c] = (double)(((e[0] + e[4]) + (e[1] + e[5])) + ((e[2] + e[6]) + (e[3] + e[7])));
    }
    return scale * sum * uuv_colour_of_(lamp + 6);
}

/* Electrons of a pixel's channels, with noise; `draw` is that of the pixel's first channel. */
static inline uuv_colour_ uuv_electrons_(const uuv_camera *cam, uuv_colour_ mean, double read, uint64_t draw) {
    uuv_colour_ u = uuv_grey_(0.0), w = uuv_grey_(0.0);
    for (int c = 0; c < 3; c++) {
        const uint64_t h = uuv_mix_(draw + (uint64_t)c * 0x9e3779b97f4a7c15u);
        u[c] = (double)(int64_t)(h >> 12) * 0x1p-52;
        w[c] = cam->normal[uuv_mix_(h) & (UUV_SONAR_TABLE - 1)];
    }
    /* Below a mean of 32, Poisson by its cumulative distribution; from there on, a normal distribution. */
    const uuv_colour_bits_ few = (uuv_colour_bits_)(mean < 32.0);
    const uuv_colour_ m = (uuv_colour_)((uuv_colour_bits_)mean & few);
    uuv_colour_ p = uuv_decay_(m), sum = p, n = mean - m;
    for (int k = 1; k <= 200; k += 4) { /* a channel that has its number stays there: its sum only rises */
        uuv_colour_bits_ more = (uuv_colour_bits_)(u >= sum) & few;
        if (!(more[0] | more[1] | more[2])) break;
        for (int i = 0; i < 4; i++) {
            n += (uuv_colour_)(more & (uuv_colour_bits_)(uuv_colour_){1.0, 1.0, 1.0, 1.0});
            p *= m * (1.0 / (k + i));
            sum += p;
            more = (uuv_colour_bits_)(u >= sum) & few;
        }
    }
    const uuv_colour_ variance = read * read + (mean - m);
    for (int c = 0; c < 3; c++) n[c] += uuv_root_(variance[c]) * w[c];
    return n;
}

/* Share of the light that a flat surface of water reflects, for a ray from below at the cosine c. */
static inline double uuv_reflected_(double c) {
    const double n = UUV_CAMERA_WATER, sine = n * n * (1.0 - c * c);
    if (!(sine < 1.0)) return 1.0;
    const double out = uuv_root_(1.0 - sine);
    const double across = (n * c - out) / (n * c + out), within = (c - n * out) / (c + n * out);
    return 0.5 * (across * across + within * within);
}

/* What all rays of a row share. */
typedef struct {
    const uuv_scene *scene;
    const uuv_camera *cam;
    const uuv_solid *moving;
    int there;
    double focal, g, contrast;
    uuv_colour_ direct, back, down, sun, veil, scatter;
    double lamps[UUV_CAMERA_LAMP * UUV_CAMERA_LAMPS];
} uuv_view_;

/* Radiance that arrives at o against the unit vector d, and what the ray meets: z is the way in water. */
static inline uuv_colour_ uuv_seen_(const uuv_view_ *v, const double o[3], const double d[3], uuv_hit *hit, double *z) {
    const uuv_camera *cam = v->cam;
    uuv_cast(v->scene, v->moving, v->there, o, d, cam->farthest, hit);
    const double into = -uuv_dot_(hit->n, d);
    const int met = (hit->kind == UUV_HIT_SEABED || hit->kind >= UUV_HIT_SOLID) && into > 0.0;
    if (!met && (hit->kind == UUV_HIT_SEABED || hit->kind >= UUV_HIT_SOLID)) hit->kind = UUV_HIT_NONE; /* from behind */
    *z = hit->kind == UUV_HIT_BELOW ? 0.0 : hit->kind == UUV_HIT_NONE ? cam->farthest : hit->t;
    uuv_colour_ light = uuv_grey_(0.0);
    if (met) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = o[k] + *z * d[k];
        const double under = p[2] > 0.0 ? p[2] : 0.0;
        const uuv_colour_ way = v->direct * *z; /* of the light from here to the camera */
        uuv_colour_ on = v->sun * (0.5 * (1.0 - hit->n[2])) * uuv_decay_(v->down * under + way);
        for (int n = 0; n < cam->lamps; n++) {
            const double *lamp = v->lamps + UUV_CAMERA_LAMP * n;
            const double from[3] = {p[0] - lamp[0], p[1] - lamp[1], p[2] - lamp[2]};
            const double square = uuv_dot_(from, from), distance = uuv_root_(square > 1e-4 ? square : 1e-4);
            const double facing = -uuv_dot_(from, hit->n) / distance;
            if (!(facing > 0.0)) continue;
            const double share = uuv_cone_(lamp, uuv_dot_(from, lamp + 3) / distance);
            if (!(share > 0.0)) continue;
            on += facing * share / (distance * distance) * uuv_colour_of_(lamp + 6) *
                  uuv_decay_(v->direct * distance + way);
        }
        const double *rho = hit->kind == UUV_HIT_SEABED ? cam->seabed : cam->solid + 3 * (hit->kind - UUV_HIT_SOLID);
        double shade = 1.0;
        if (v->contrast > 0.0)
            shade += v->contrast * uuv_texture_(cam, p, *z / (v->focal * (into > 0.1 ? into : 0.1)));
        light = (0x1.45f306dc9c883p-2 * shade) * uuv_colour_of_(rho) * on;
    }
    if (*z > 0.0) {
        light += v->veil * (1.0 - uuv_decay_(v->back * *z));
        for (int n = 0; n < cam->lamps; n++)
            light += v->scatter * uuv_lamp_veil_(cam, v->lamps + UUV_CAMERA_LAMP * n, o, d, *z, v->direct, v->g);
    }
    return light;
}

/* The same, with the sky and the mirror image that the flat surface of the water shows from below. The radiance
 * of a uniform sky whose light in water is E0 rises by n^2 there: n^2 (1 - F) E0 / (pi T). */
static inline uuv_colour_ uuv_seen_up_(const uuv_view_ *v, const double o[3], const double d[3], uuv_hit *hit,
                                       double *z) {
    uuv_colour_ light = uuv_seen_(v, o, d, hit, z);
    if (hit->kind != UUV_HIT_SURFACE || !(d[2] < 0.0)) return light;
    const double mirror = uuv_reflected_(-d[2]);
    const double sky = UUV_CAMERA_WATER * UUV_CAMERA_WATER * (1.0 - mirror) / (0x1.921fb54442d18p1 * UUV_CAMERA_ENTERS);
    const double from[3] = {o[0] + *z * d[0], o[1] + *z * d[1], UUV_CAMERA_NEAR}, back[3] = {d[0], d[1], -d[2]};
    uuv_hit other;
    double far;
    return light + uuv_decay_(v->direct * *z) * (sky * v->sun + mirror * uuv_seen_(v, from, back, &other, &far));
}

/* b = the vector a, turned by the vector w of a small angle: exact to its fourth power, and a rotation. */
static inline void uuv_turned_(const double w[3], const double a[3], double b[3]) {
    const double half = 0.5 + uuv_dot_(w, w) / 24.0, u[3] = {half * w[0], half * w[1], half * w[2]};
    const double per = 2.0 / (1.0 + uuv_dot_(u, u));
    const double c[3] = {u[1] * a[2] - u[2] * a[1], u[2] * a[0] - u[0] * a[2], u[0] * a[1] - u[1] * a[0]};
    b[0] = a[0] + per * (c[0] + (u[1] * c[2] - u[2] * c[1]));
    b[1] = a[1] + per * (c[1] + (u[2] * c[0] - u[0] * c[2]));
    b[2] = a[2] + per * (c[2] + (u[0] * c[1] - u[1] * c[0]));
}

/* x: origin (3), rotation from camera axes row by row (9), focal length, k1, k2 [pixels, 1, 1], beta_D (3),
 * beta_B (3), K (3), light of the sun at the surface (3), V (3), b of lamps (3), g, contrast of the texture,
 * sensitivity, read noise, gain (grey levels an electron), noise on, two draws; refractive index of the water
 * over that in front of the lens (1: no port), distance of the port, time of a row (0: all at once), velocity
 * (3) and angular velocity (3) of the camera in `n`; the lamps: place (3), axis (3), intensity (3), cosines of
 * the inner and the outer half angle; the moving.
 * The last row is exposed at the pose of x, the others before it. seen: [rows][columns][3] grey levels 0 ... 255;
 * radiance, normal (in camera axes), depth, label: the same, or [rows][columns], unless 0. */
static inline void uuv_camera_image(const uuv_scene *scene, const uuv_camera *cam, const double *x, float *seen,
                                    double *radiance, float *depth, uint16_t *label, float *normal, double *summary) {
    uuv_solid moving[UUV_MOVERS];
    const double *lamps = x + UUV_CAMERA_HEAD;
    const int there = uuv_movers_(lamps + UUV_CAMERA_LAMP * cam->lamps, cam->n_moving, moving);
    const double f = x[12], k1 = x[13], k2 = x[14], per_index = 1.0 / x[41], port = x[42];
    uuv_view_ v = {scene, cam, moving, there, f, x[33], x[34], uuv_colour_of_(x + 15), uuv_colour_of_(x + 18),
                   uuv_colour_of_(x + 21), uuv_colour_of_(x + 24), {0.0}, uuv_colour_of_(x + 30), {0.0}};
    const double sensitivity = x[35], read = x[36], gain = x[37];
    union {
        float x[2];
        uint64_t bits;
    } key = {{(float)x[39], (float)x[40]}};
    const uint64_t draw = uuv_mix_(key.bits);
    double total = 0.0, full = 0.0, met = 0.0, R[9], from[3];
    for (int i = 0; i < cam->rows; i++) {
        if (i == 0 || x[43] != 0.0) {
            const double dt = (i - (cam->rows - 1)) * x[43], w[3] = {x[47] * dt, x[48] * dt, x[49] * dt};
            for (int k = 0; k < 3; k++) from[k] = x[k] + x[44 + k] * dt;
            for (int k = 0; k < 3; k++) { /* columns of the rotation */
                const double a[3] = {x[3 + k], x[6 + k], x[9 + k]};
                double b[3];
                uuv_turned_(w, a, b);
                for (int r = 0; r < 3; r++) R[3 * r + k] = b[r];
            }
            for (int n = 0; n < cam->lamps; n++) {
                const double *lamp = lamps + UUV_CAMERA_LAMP * n;
                double *own = v.lamps + UUV_CAMERA_LAMP * n;
                const double a[3] = {lamp[0] - x[0], lamp[1] - x[1], lamp[2] - x[2]};
                uuv_turned_(w, a, own);
                for (int k = 0; k < 3; k++) own[k] += from[k];
                uuv_turned_(w, lamp + 3, own + 3);
                for (int k = 6; k < UUV_CAMERA_LAMP; k++) own[k] = lamp[k];
            }
            v.veil = uuv_colour_of_(x + 27) * v.sun * uuv_decay_(v.down * (from[2] > 0.0 ? from[2] : 0.0));
        }
        for (int j = 0; j < cam->columns; j++) {
            const int64_t pixel = (int64_t)i * cam->columns + j;
            double a[3] = {(j + 0.5 - 0.5 * cam->columns) / f, (i + 0.5 - 0.5 * cam->rows) / f, 1.0};
            if (k1 != 0.0 || k2 != 0.0) {
                const double r = uuv_root_(a[0] * a[0] + a[1] * a[1]);
                const double scale = r > 0.0 ? uuv_undistorted_(r, k1, k2) / r : 1.0;
                a[0] *= scale;
                a[1] *= scale;
            }
            double o[3] = {from[0], from[1], from[2]};
            for (int k = 0; k < 3 && port > 0.0; k++) o[k] += port * uuv_dot_(R + 3 * k, a);
            const double per = 1.0 / uuv_root_(uuv_dot_(a, a));
            double axial = per;
            a[0] *= per * per_index;
            a[1] *= per * per_index;
            if (per_index != 1.0) axial = uuv_root_(1.0 - (a[0] * a[0] + a[1] * a[1])); /* Snell's law */
            a[2] = axial;
            const double d[3] = {uuv_dot_(R, a), uuv_dot_(R + 3, a), uuv_dot_(R + 6, a)};
            uuv_hit hit = {0.0, {0.0, 0.0, 0.0}, UUV_HIT_NONE};
            double z = 0.0;
            uuv_colour_ light = uuv_grey_(0.0);
            if (o[2] >= 0.0) {
                if (o[2] < UUV_CAMERA_NEAR) o[2] = UUV_CAMERA_NEAR;
                light = uuv_seen_up_(&v, o, d, &hit, &z);
            }
            const int surface = hit.kind == UUV_HIT_SEABED || hit.kind >= UUV_HIT_SOLID;
            met += surface;
            uuv_colour_ electrons = light * sensitivity;
            if (x[38] > 0.0)
                electrons = uuv_electrons_(cam, electrons, read, draw + (uint64_t)(3 * pixel) * 0x9e3779b97f4a7c15u);
            for (int c = 0; c < 3; c++) {
                const double grey = electrons[c] * gain;
                const double level = grey < 255.0 ? (grey > 0.0 ? (double)(int)(grey + 0.5) : 0.0) : 255.0;
                seen[3 * pixel + c] = (float)level;
                if (radiance) radiance[3 * pixel + c] = light[c];
                if (normal)
                    normal[3 * pixel + c] =
                        surface ? (float)(R[c] * hit.n[0] + R[3 + c] * hit.n[1] + R[6 + c] * hit.n[2]) : 0.0f;
                total += level;
                full += level >= 255.0;
            }
            if (depth) depth[pixel] = surface ? (float)(port + z * axial) : 0.0f;
            if (label)
                label[pixel] = (uint16_t)(!surface ? 0 : hit.kind == UUV_HIT_SEABED ? 1 : hit.kind - UUV_HIT_SOLID + 2);
        }
    }
    summary[0] = total / (3.0 * cam->rows * cam->columns);
    summary[1] = full / (3.0 * cam->rows * cam->columns);
    summary[2] = met;
}

#endif
