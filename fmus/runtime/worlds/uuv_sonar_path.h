/* SPDX-License-Identifier: Apache-2.0 */
/* Path of a sonar's ray: straight or bent by a profile of the speed of sound, with up to one bounce.
 *
 * In a layer of the constant gradient g, a ray at the angle b below the horizontal follows an arc of
 * the radius c / (g cos b) (Snell: cos b / c is constant). Vertices of the path lie on the arc, and on
 * the borders of layers; the caster is used along the chords between them. Over a chord of length L
 *
 *     t = L / sqrt(c0 c1) asinh(q) / q,   q = g L / (2 sqrt(c0 c1)).
 *
 * A tube of rays is `tall` within the vertical plane and `wide` across it, per unit of angle, so that
 * levels fall by 1 / (tall wide). Both grow by c ds / c_0 within a layer (the dynamic ray equations
 * of Jensen et al. (2011), chapter 3); where the gradient changes by dg, the growth of `tall` changes by
 * -dg cos² b / (c² sin b) tall.
 *
 * + - * / sqrt alone, so that bits are equal for every compiler and processor.
 */
#ifndef UUV_SONAR_PATH_H
#define UUV_SONAR_PATH_H

#include "uuv_rays.h"

#define UUV_PATH_OVERLAP 1e-6 /* m, by which a chord is prolonged: nothing passes between two chords */
#define UUV_PATH_FLAT 1e-3    /* least sine at which a ray crosses the border of layers, in its tube */
#define UUV_PATH_CAUSTIC 0.1  /* least share of `tall` in `wide` */

typedef struct {
    int levels;          /* 0: rays are straight */
    double chord;        /* longest chord in a layer with a gradient [m] */
    const double *level; /* [levels]: depth [m], speed [m/s], gradient below [1/s], 0 below the last */
} uuv_profile;

/* A ray on its way: place, direction, derivative of the direction by its elevation. */
typedef struct {
    double at[3], d[3], across[3];
    double length, range; /* along the path; time times the speed that the instrument assumes [m] */
    double wide, tall;    /* of the ray tube [m] */
    double growth;        /* of `tall`, over that of `wide` */
    double c, c_0;        /* speed of sound here, and at the instrument; 1 without a profile */
    int bent, curved;     /* it is no straight line from the instrument; nor one with a bounce */
} uuv_way;

/* asinh(q) / q by its series; below q = 0.1 it is exact to 1e-14. */
static inline double uuv_asinh_over_(double q) {
    const double s = q * q;
    return 1.0 + s * (-1.0 / 6.0 + s * (3.0 / 40.0 + s * (-15.0 / 336.0 + s * (105.0 / 3456.0))));
}

/* Moves a way by t along the unit vector u: c is the speed there, ref the one that is assumed. */
static inline void uuv_way_move_(uuv_way *w, const double u[3], double t, double c, double g, double ref) {
    const double mean = w->c == c ? c : uuv_root_(w->c * c);
    const double q = 0.5 * g * t / mean, grown = t * (0.5 * (w->c + c) / w->c_0);
    for (int k = 0; k < 3; k++) w->at[k] += t * u[k];
    w->length += t;
    w->range += t * (ref / mean) * uuv_asinh_over_(q);
    w->wide += grown;
    w->tall += grown * w->growth;
    w->c = c;
}

/* The speed at a depth, and the layer: -1 above the first level. */
static inline double uuv_speed_(const uuv_profile *p, double depth, int *layer) {
    int i = -1;
    while (i + 1 < p->levels && depth >= p->level[3 * (i + 1)]) i++;
    *layer = i;
    return i < 0 ? p->level[1] : p->level[3 * i + 1] + p->level[3 * i + 2] * (depth - p->level[3 * i]);
}

/* Turns the way's direction and its derivative from its own to (cosine, sine) below the horizontal. */
static inline void uuv_way_turn_(uuv_way *w, double north, double east, double cosine, double sine) {
    const double was = w->d[0] * north + w->d[1] * east;
    const double c = was * cosine + w->d[2] * sine, s = was * sine - w->d[2] * cosine;
    const double flat = w->across[0] * north + w->across[1] * east, side = w->across[1] * north - w->across[0] * east;
    const double along = flat * c - w->across[2] * s;
    w->across[2] = flat * s + w->across[2] * c;
    w->across[0] = along * north - side * east;
    w->across[1] = along * east + side * north;
    w->d[0] = cosine * north;
    w->d[1] = cosine * east;
    w->d[2] = sine;
}

/* Follows a way until it meets something, or until its range is `far`: hit->kind is UUV_HIT_NONE then. */
static inline void uuv_way_follow_(const uuv_scene *scene, const uuv_solid *moving, int there, const uuv_profile *p,
                                   double far, double ref, uuv_way *w, uuv_hit *hit) {
    if (!p->levels) {
        uuv_cast(scene, moving, there, w->at, w->d, far - w->range, hit);
        uuv_way_move_(w, w->d, hit->t, 1.0, 0.0, 1.0);
        return;
    }
    int i;
    w->c = uuv_speed_(p, w->at[2], &i);
    if (w->c_0 == 0.0) w->c_0 = w->c;
    const double flat = uuv_root_(w->d[0] * w->d[0] + w->d[1] * w->d[1]);
    const double north = flat > 1e-12 ? w->d[0] / flat : 1.0, east = flat > 1e-12 ? w->d[1] / flat : 0.0;
    double cosine = flat, sine = w->d[2];
    hit->kind = UUV_HIT_NONE;
    /* A chord at a time; the bound holds for a ray that is caught at the border of two layers. */
    for (int n = 0; n < 4096 && w->range < far; n++) {
        const double g = i < 0 ? 0.0 : p->level[3 * i + 2], bend = g * cosine / w->c;
        double length = (far - w->range) * (w->c / ref);
        if (g != 0.0 && length > p->chord) length = p->chord;
        if (bend * bend * length * length > 0.25) length = 0.5 / (bend < 0.0 ? -bend : bend);
        double half = 0.5 * bend * length, level = uuv_root_(1.0 - half * half); /* of half the turn */
        double dive = sine * level - cosine * half, ahead = cosine * level + sine * half;
        double end_sine = dive * level - ahead * half, end_cosine = ahead * level + dive * half;
        double end = w->at[2] + length * dive;
        const int to = i + 1 < p->levels && end > p->level[3 * (i + 1)] ? 1 : i >= 0 && end < p->level[3 * i] ? -1 : 0;
        double u[3] = {w->d[0], w->d[1], w->d[2]}; /* a chord without a bend keeps the direction's bits */
        const double *border = p->level + 3 * (to > 0 ? i + 1 : i);
        if (to) {
            end = border[0];
            end_cosine = cosine * border[1] / w->c;
            if (end_cosine > 1.0) end_cosine = 1.0;
            const double down = end - w->at[2];
            end_sine = to * uuv_root_(1.0 - end_cosine * end_cosine);
            const double run = sine * to > 0.0 ? down * (cosine + end_cosine) / (sine + end_sine)
                               : bend != 0.0  ? (sine - end_sine) / bend
                                              : 0.0;
            length = uuv_root_(run * run + down * down);
            dive = length > 0.0 ? down / length : sine;
            ahead = length > 0.0 ? run / length : cosine;
        }
        if (to || bend != 0.0) {
            u[0] = ahead * north;
            u[1] = ahead * east;
            u[2] = dive;
            w->bent = w->curved = 1;
        }
        uuv_cast(scene, moving, there, w->at, u, length + (w->curved ? UUV_PATH_OVERLAP : 0.0), hit);
        if (hit->kind != UUV_HIT_NONE) {
            const double lean = bend * (0.5 * length - hit->t), even = uuv_root_(1.0 - lean * lean);
            uuv_way_move_(w, u, hit->t, w->c + g * (hit->t * u[2]), g, ref);
            if (w->curved) uuv_way_turn_(w, north, east, ahead * even - dive * lean, dive * even + ahead * lean);
            return;
        }
        uuv_way_move_(w, u, length, to ? border[1] : w->c + g * (length * u[2]), g, ref);
        if (w->curved) uuv_way_turn_(w, north, east, end_cosine, end_sine);
        cosine = end_cosine;
        sine = end_sine;
        if (!to) continue;
        w->at[2] = end;
        const int above = to > 0 ? i : i - 1;
        const double jump = border[2] - (above < 0 ? 0.0 : p->level[3 * above + 2]);
        const double steep = sine < 0.0 ? -sine : sine;
        w->growth -= jump * cosine * cosine * w->c_0 / (w->c * w->c * (steep > UUV_PATH_FLAT ? steep : UUV_PATH_FLAT)) *
                     w->tall;
        i += to;
    }
}

/* The distance at which a straight ray has the level of this one. */
static inline double uuv_way_spread_(const uuv_way *w) {
    const double tall = w->tall < 0.0 ? -w->tall : w->tall, least = UUV_PATH_CAUSTIC * w->wide;
    if (tall == w->wide) return w->wide;
    return uuv_root_(w->wide * (tall > least ? tall : least));
}

/* Reflects a way at a plane of the normal n, and lifts it off the plane. */
static inline void uuv_way_bounce_(uuv_way *w, const double n[3]) {
    const double into = uuv_dot_(w->d, n), turn = uuv_dot_(w->across, n);
    for (int k = 0; k < 3; k++) {
        w->d[k] -= 2.0 * into * n[k];
        w->across[k] -= 2.0 * turn * n[k];
        w->at[k] += UUV_PATH_OVERLAP * n[k];
    }
    w->bent = 1;
}

#endif
