/* SPDX-License-Identifier: Apache-2.0 */
/* A whole hull against a scene: what touches, how it is pushed out, and the friction.
 *
 * Hull and solids are zones: a centre, up to three half axes g_k, a ball and an upright disc, all
 * added (Minkowski). Along a unit vector u from hull A to solid B, with c from A's centre to B's,
 *
 *     D(u) = sum |g_k u| + ball + disc |u_h| - c u
 *
 * is the depth; the least over u is the distance to push, or less the distance apart. Candidates
 * for u are the faces and crossed edges of the difference of both, and the direction between the
 * nearest points. A pair that is apart is swept along its relative velocity to where it meets.
 *
 * The least depth does not tell the side from which a hull came: behind the middle of a wall it
 * leads through. Contact therefore remembers a place of the hull's middle that is free and that
 * was reached without passing through a solid (uuv_place). From there the hull is swept to its
 * pose. If that meets a solid, and the direction of the least depth did not separate the two at
 * the remembered place, then the direction in which they met holds. Along a straight way the
 * least depth is concave, for D is linear for each u: Newton's steps from its begin never pass
 * the first place at which two bodies meet.
 *
 * Contact points are the corners of the patch in which both touch, and the deepest point. With
 * depth d, approach speed w, the step h and the diagonal mass M, each asks for the displacement
 * e = min(d, cap) + 8 h w along its normal. The least displacement delta in the metric of M that
 * serves all, softened by UUV_SOFT, gives the force  tau = kappa / h² M delta. Friction likewise:
 * the least change of velocity that stops every slip, of which a step makes the share UUV_GRIP,
 * by forces of at most mu times those along the normals.
 */
#ifndef UUV_CONTACT_H
#define UUV_CONTACT_H

#include "uuv_rays.h"

#define UUV_CONTACTS 32      /* points at most; the most pressing are kept */
#define UUV_LEAD 10.0         /* steps ahead that an approach is seen */
#define UUV_LATE 2.5         /* steps until the middle of that in which the force acts */
#define UUV_OUT 1.0          /* m/s, the fastest that a hull is pushed out of what it is in */
#define UUV_SOFT 0.05        /* compliance of a point, as a share of that of the mass alone */
#define UUV_GRIP 0.14        /* greatest friction: this share of the momentum of slip a step */
#define UUV_TURNED 1.0       /* rad a step, from which on a force in b misses its direction in n */
#define UUV_SWEEPS_NEAREST 16
#define UUV_STEPS_PUSH 16
#define UUV_APART 1e-3       /* m, of a sweep to where two bodies meet */
#define UUV_HOLD 40.0        /* steps at 1 m/s: the depth to which a remembered side is held */
#define UUV_FORGET 100.0     /* steps at 1 m/s: how far off a remembered place still counts */
#define UUV_SWEEPS 16
#define UUV_SLIDES 6
#ifndef UUV_CANDIDATES
#define UUV_CANDIDATES 64 /* of the tree; where there are more, every solid is looked at */
#endif

typedef struct {
    double c[3], g[3][3];
    int n; /* half axes */
    double ball, disc;
} uuv_zone;

/* What does not change: scene, friction of its seabed, shape of the hull from CO in b. */
typedef struct {
    const uuv_scene *scene;
    const unsigned char *material; /* of each node of the terrain, or 0 */
    const double *friction;        /* of each material, beside that of the parameter mu */
    const double *rub;             /* of each solid, likewise; 0: all as mu */
    double middle[3], half[3];
    int n_half; /* 3: a box, 1: a capsule along x, 0: a ball */
    double radius;
} uuv_hull;

typedef struct {
    double r[3], n[3], v[3]; /* place, push and slip, all in b */
    double e, mu;
} uuv_contact_point_;

typedef struct {
    const uuv_hull *hull;
    uuv_zone zone;
    double co[3], R[9], nu[6], horizon, late, cap, mu;
    double present[3], before[3]; /* the hull's middle now, and where it is known to be free */
    double bound, arm; /* the farthest point from the middle, and from CO at most */
    double ahead;      /* what a point moves within the horizon at most */
    double deepest;
    int touched, n;
    uuv_contact_point_ point[UUV_CONTACTS];
} uuv_contact_state_;

static inline void uuv_cross_(const double a[3], const double b[3], double c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void uuv_to_body_(const double R[9], const double a[3], double b[3]) {
    for (int k = 0; k < 3; k++) b[k] = R[k] * a[0] + R[3 + k] * a[1] + R[6 + k] * a[2];
}

static inline double uuv_size_(double x) { return x < 0.0 ? -x : x; }

/* Adds the point x of the hull, d deep, pushed along m; `still` leaves out a translation's
 * approach: that of a hull which passes without touching. */
static inline void uuv_add_point_(uuv_contact_state_ *s, const double x[3], const double m[3],
                                  double d, const double v_solid[3], double mu, int number,
                                  int still) {
    const double from[3] = {x[0] - s->co[0], x[1] - s->co[1], x[2] - s->co[2]};
    uuv_contact_point_ p;
    double other[3], turn[3];
    uuv_to_body_(s->R, from, p.r);
    uuv_to_body_(s->R, m, p.n);
    uuv_to_body_(s->R, v_solid, other);
    uuv_cross_(s->nu + 3, p.r, turn);
    double along = 0.0, turned = 0.0;
    for (int k = 0; k < 3; k++) {
        p.v[k] = s->nu[k] + turn[k] - other[k];
        along -= p.n[k] * (s->nu[k] - other[k]);
        turned -= p.n[k] * turn[k];
    }
    const double now = d - s->late * (along + turned);
    if (now > s->deepest) s->deepest = now, s->touched = number;
    if (still && along > 0.0) along = 0.0;
    p.e = (d < s->cap ? d : s->cap) + s->horizon * (along + turned);
    p.mu = mu;
    if (!(p.e > 0.0)) return;
    int at = s->n;
    if (at == UUV_CONTACTS) {
        at = 0;
        for (int i = 1; i < UUV_CONTACTS; i++)
            if (s->point[i].e < s->point[at].e) at = i;
        if (!(p.e > s->point[at].e)) return;
    } else {
        s->n++;
    }
    s->point[at] = p;
}

/* ---- two convex bodies ---- */

typedef struct {
    double c[3], g[6][3];
    int n, n_hull;
    double ball, disc;
    double axis[16][3];
    int n_axes;
} uuv_bodies_;

static inline void uuv_add_axis_(uuv_bodies_ *q, const double a[3]) {
    const double size = uuv_root_(uuv_dot_(a, a));
    if (!(size > 1e-12)) return;
    for (int k = 0; k < 3; k++) q->axis[q->n_axes][k] = a[k] / size;
    q->n_axes++;
}

static inline uuv_bodies_ uuv_bodies_of_(const uuv_zone *a, const uuv_zone *b) {
    uuv_bodies_ q;
    q.n = a->n + b->n;
    q.n_hull = a->n;
    q.ball = a->ball + b->ball;
    q.disc = b->disc;
    q.n_axes = 0;
    for (int k = 0; k < 3; k++) q.c[k] = b->c[k] - a->c[k];
    for (int i = 0; i < q.n; i++)
        for (int k = 0; k < 3; k++) q.g[i][k] = i < a->n ? a->g[i][k] : b->g[i - a->n][k];
    double normal[3];
    for (int i = 0; i < q.n; i++)
        for (int j = i + 1; j < q.n; j++) {
            const double limit = 1e-12 * uuv_dot_(q.g[i], q.g[i]) * uuv_dot_(q.g[j], q.g[j]);
            uuv_cross_(q.g[i], q.g[j], normal);
            if (uuv_dot_(normal, normal) > limit) uuv_add_axis_(&q, normal);
        }
    if (q.disc > 0.0) {
        const double down[3] = {0.0, 0.0, 1.0};
        uuv_add_axis_(&q, down);
        for (int i = 0; i < q.n_hull; i++) {
            uuv_cross_(down, q.g[i], normal);
            uuv_add_axis_(&q, normal);
        }
    }
    return q;
}

/* D(u), with the centres c apart. */
static inline double uuv_depth_along_(const uuv_bodies_ *q, const double c[3], const double u[3]) {
    double d = q->ball - uuv_dot_(c, u);
    for (int i = 0; i < q->n; i++) d += uuv_size_(uuv_dot_(q->g[i], u));
    if (q->disc > 0.0) d += q->disc * uuv_root_(u[0] * u[0] + u[1] * u[1]);
    return d;
}

/* From c less the nearest point of the difference without its balls: r. t: where on each axis.
 * `flat`: seen from above, without the disc. */
static inline void uuv_nearest_(const uuv_bodies_ *q, const double c[3], double t[6], int flat,
                                double r[3]) {
    double w[2] = {0.0, 0.0};
    for (int k = 0; k < 3; k++) {
        r[k] = k == 2 && flat ? 0.0 : c[k];
        for (int i = 0; i < q->n && !(k == 2 && flat); i++) r[k] -= t[i] * q->g[i][k];
    }
    for (int sweep = 0; sweep < UUV_SWEEPS_NEAREST; sweep++) {
        double moved = 0.0;
        for (int i = 0; i < q->n; i++) {
            const double *g = q->g[i];
            const double gz = flat ? 0.0 : g[2], gg = g[0] * g[0] + g[1] * g[1] + gz * gz;
            if (!(gg > 1e-18)) continue;
            double to = t[i] + (g[0] * r[0] + g[1] * r[1] + gz * r[2]) / gg;
            to = to > 1.0 ? 1.0 : to < -1.0 ? -1.0 : to;
            const double by = to - t[i];
            moved += uuv_size_(by);
            t[i] = to;
            r[0] -= by * g[0];
            r[1] -= by * g[1];
            r[2] -= by * gz;
        }
        if (q->disc > 0.0 && !flat) {
            const double x = r[0] + w[0], y = r[1] + w[1], off = uuv_root_(x * x + y * y);
            const double share = off > q->disc ? q->disc / off : 1.0;
            w[0] = x * share;
            w[1] = y * share;
            r[0] = x - w[0];
            r[1] = y - w[1];
        }
        if (moved < 1e-13 && sweep) break;
    }
}

static inline void uuv_try_(const uuv_bodies_ *q, const double c[3], const double a[3], double *best,
                            double u[3]) {
    const double size = uuv_root_(uuv_dot_(a, a));
    if (!(size > 1e-9)) return;
    const double side = uuv_dot_(a, c) < 0.0 ? -1.0 / size : 1.0 / size;
    const double v[3] = {a[0] * side, a[1] * side, a[2] * side};
    const double d = uuv_depth_along_(q, c, v);
    if (!(d < *best)) return;
    *best = d;
    for (int k = 0; k < 3; k++) u[k] = v[k];
}

/* The least D(u) and its u. */
static inline double uuv_least_(const uuv_bodies_ *q, const double c[3], double u[3]) {
    double best = __builtin_inf(), r[3], t[6] = {0.0};
    u[0] = u[1] = 0.0;
    u[2] = 1.0;
    uuv_nearest_(q, c, t, 0, r);
    uuv_try_(q, c, r, &best, u);
    for (int i = 0; i < q->n_axes; i++) uuv_try_(q, c, q->axis[i], &best, u);
    if (q->disc > 0.0) {
        for (int i = 0; i < 6; i++) t[i] = 0.0;
        uuv_nearest_(q, c, t, 1, r);
        uuv_try_(q, c, r, &best, u);
    }
    return best < __builtin_inf() ? best : uuv_depth_along_(q, c, u);
}

/* The part of a surface that faces along w: p + s a + t b, |s|, |t| <= 1; sides: how many of a, b. */
typedef struct {
    double p[3], a[3], b[3];
    int sides;
} uuv_patch_;

static inline uuv_patch_ uuv_face_(const uuv_zone *box, const double w[3], int face) {
    const double side = uuv_dot_(box->g[face], w) < 0.0 ? -1.0 : 1.0;
    uuv_patch_ f;
    f.sides = 2;
    for (int k = 0; k < 3; k++) {
        f.p[k] = box->c[k] + side * box->g[face][k];
        f.a[k] = box->g[(face + 1) % 3][k];
        f.b[k] = box->g[(face + 2) % 3][k];
    }
    return f;
}

/* The depth of a ridge, d behind the point x of a box's surface along -u: it falls off again from
 * the middle of the box on, to 0 where the ridge leaves it. */
static inline double uuv_under_(const uuv_zone *box, const double x[3], const double u[3], double d) {
    double chord = __builtin_inf();
    for (int i = 0; i < 3; i++) {
        const double *g = box->g[i], size = uuv_dot_(g, g), along = uuv_dot_(g, u);
        const double at = (x[0] - box->c[0]) * g[0] + (x[1] - box->c[1]) * g[1] + (x[2] - box->c[2]) * g[2];
        const double left = along > 0.0 ? size + at : size - at;
        if (left < chord * uuv_size_(along)) chord = left / uuv_size_(along);
    }
    if (d <= 0.5 * chord) return d;
    return d < chord ? 2.0 * d * (chord - d) / chord : -chord;
}

static inline uuv_patch_ uuv_patch_of_(const uuv_zone *z, const double w[3]) {
    uuv_patch_ f = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, z->n == 3 ? 2 : z->n};
    for (int k = 0; k < 3; k++) f.p[k] = z->c[k] + z->ball * w[k];
    if (z->n == 3) {
        int face = 0;
        double best = -1.0;
        for (int i = 0; i < 3; i++) {
            const double along = uuv_dot_(z->g[i], w);
            const double share = along * along / uuv_dot_(z->g[i], z->g[i]);
            if (share > best) best = share, face = i;
        }
        return uuv_face_(z, w, face);
    } else if (z->disc > 0.0 && w[2] * w[2] > 0.5) { /* the square within an end of a cylinder */
        f.p[2] += w[2] < 0.0 ? -z->g[0][2] : z->g[0][2];
        f.a[0] = f.b[1] = 0.70710678118654752 * z->disc;
        f.sides = 2;
    } else if (z->n == 1) {
        const double flat = uuv_root_(w[0] * w[0] + w[1] * w[1]);
        for (int k = 0; k < 3; k++) f.a[k] = z->g[0][k];
        for (int k = 0; k < 2 && z->disc > 0.0; k++) f.p[k] += z->disc * w[k] / flat;
    }
    return f;
}

typedef struct {
    double x[3], st[2];
} uuv_corner_;

/* Cuts a polygon at side * st[axis] <= 1. */
static inline int uuv_cut_(uuv_corner_ *v, int n, int axis, double side) {
    uuv_corner_ kept[16];
    int m = 0;
    for (int i = 0; i < n && m < 15; i++) {
        const uuv_corner_ *now = v + i, *before = v + (i + n - 1) % n;
        const double a = 1.0 - side * before->st[axis], b = 1.0 - side * now->st[axis];
        if ((a < 0.0) != (b < 0.0)) {
            const double share = a / (a - b);
            uuv_corner_ *at = kept + m++;
            for (int k = 0; k < 3; k++) at->x[k] = before->x[k] + share * (now->x[k] - before->x[k]);
            for (int k = 0; k < 2; k++)
                at->st[k] = before->st[k] + share * (now->st[k] - before->st[k]);
        }
        if (b >= 0.0) kept[m++] = *now;
    }
    for (int i = 0; i < m; i++) v[i] = kept[i];
    return m;
}

/* Adds the corners of the common part, seen along u, of a patch of the hull and one of a solid or,
 * of a box and with `ridge`, of the seabed. */
static inline void uuv_add_patch_(uuv_contact_state_ *s, const uuv_patch_ *hull,
                                  const uuv_patch_ *solid, const double u[3], const double v_solid[3],
                                  double mu, int number, int still, int ridge) {
    const int swapped = hull->sides == 2 && solid->sides == 1;
    const uuv_patch_ *cut = swapped ? solid : hull, *by = swapped ? hull : solid;
    if (!cut->sides || !by->sides) return;
    int least = 0;
    for (int k = 1; k < 3; k++)
        if (uuv_size_(u[k]) < uuv_size_(u[least])) least = k;
    const double unit[3] = {least == 0, least == 1, least == 2};
    double e1[3], e2[3];
    uuv_cross_(u, unit, e1);
    uuv_cross_(u, e1, e2); /* as long as e1 */
    const double a1 = uuv_dot_(by->a, e1), a2 = uuv_dot_(by->a, e2);
    double b1 = uuv_dot_(by->b, e1), b2 = uuv_dot_(by->b, e2);
    if (by->sides == 1) { /* two segments: as far as they run side by side */
        const double c1 = uuv_dot_(cut->a, e1), c2 = uuv_dot_(cut->a, e2);
        const double across = a1 * c2 - a2 * c1;
        if (cut->sides != 1) return;
        if (across * across > 0.04 * (a1 * a1 + a2 * a2) * (c1 * c1 + c2 * c2)) return;
        b1 = -a2;
        b2 = a1;
    }
    const double whole = a1 * b2 - a2 * b1;
    if (!(whole * whole > 1e-8 * (a1 * a1 + a2 * a2) * (b1 * b1 + b2 * b2))) return;
    uuv_corner_ v[16];
    int n = cut->sides == 2 ? 4 : 2;
    for (int i = 0; i < n; i++) {
        const double fa = i == 1 || i == 2 ? 1.0 : -1.0, fb = i >= 2 ? 1.0 : -1.0;
        double from[3];
        for (int k = 0; k < 3; k++) {
            v[i].x[k] = cut->p[k] + fa * cut->a[k] + (cut->sides == 2 ? fb * cut->b[k] : 0.0);
            from[k] = v[i].x[k] - by->p[k];
        }
        const double x = uuv_dot_(from, e1), y = uuv_dot_(from, e2);
        v[i].st[0] = (x * b2 - y * b1) / whole;
        v[i].st[1] = (a1 * y - a2 * x) / whole;
    }
    for (int axis = 0; axis < by->sides; axis++) {
        n = uuv_cut_(v, n, axis, 1.0);
        n = uuv_cut_(v, n, axis, -1.0);
    }
    const double push[3] = {-u[0], -u[1], -u[2]};
    for (int i = 0; i < n; i++) {
        double other[3];
        for (int k = 0; k < 3; k++)
            other[k] = by->p[k] + v[i].st[0] * by->a[k] + (by->sides == 2 ? v[i].st[1] * by->b[k] : 0.0);
        const double above = uuv_dot_(v[i].x, u) - uuv_dot_(other, u), d = swapped ? -above : above;
        const double *x = swapped ? other : v[i].x;
        uuv_add_point_(s, x, push, ridge ? uuv_under_(&s->zone, x, u, d) : d, v_solid, mu, number, still);
    }
}

/* Adds the deepest point along u of a pair. */
static inline void uuv_add_deepest_(uuv_contact_state_ *s, const uuv_bodies_ *q, const double u[3],
                                    const double v_solid[3], double mu, int number, int still) {
    const double d = uuv_depth_along_(q, q->c, u), push[3] = {-u[0], -u[1], -u[2]};
    double t[6] = {0.0}, x[3], r[3], c[3];
    for (int k = 0; k < 3; k++) c[k] = q->c[k] + (d + 0.1) * u[k]; /* 0.1 m apart */
    for (int i = 0; i < q->n; i++) {
        const double along = uuv_dot_(q->g[i], u);
        t[i] = along * along > 1e-12 * uuv_dot_(q->g[i], q->g[i]) ? (along < 0.0 ? -1.0 : 1.0) : 0.0;
    }
    uuv_nearest_(q, c, t, 0, r);
    for (int k = 0; k < 3; k++) {
        x[k] = s->zone.c[k] + s->zone.ball * u[k];
        for (int i = 0; i < q->n_hull; i++) x[k] += t[i] * q->g[i][k];
    }
    uuv_add_point_(s, x, push, d, v_solid, mu, number, still);
}

/* The direction in which a pair meets, or is deepest; 0 if it passes and does not turn so fast. */
static inline int uuv_meets_(const uuv_contact_state_ *s, const uuv_bodies_ *q, const double v[3],
                             double u[3], int *still) {
    double d = uuv_least_(q, q->c, u), t = 0.0, c[3], next[3];
    *still = 0;
    if (d >= 0.0) return 1;
    const double first = d, own[3] = {u[0], u[1], u[2]};
    for (int i = 0; i < 8; i++) {
        const double closing = -uuv_dot_(v, u);
        if (!(closing > 0.0)) t = __builtin_inf();
        else t -= d / closing;
        if (t > s->horizon) break;
        for (int k = 0; k < 3; k++) c[k] = q->c[k] + t * v[k];
        d = uuv_least_(q, c, next);
        if (d >= -UUV_APART) return 1;
        for (int k = 0; k < 3; k++) u[k] = next[k];
    }
    if (!(t > s->horizon)) return 1;
    const double spin = uuv_root_(uuv_dot_(s->nu + 3, s->nu + 3));
    *still = 1;
    for (int k = 0; k < 3; k++) u[k] = own[k];
    return first + s->horizon * spin * s->arm > 0.0;
}

/* The share of the straight way from c0 to c1, of the centres' distance, after which two bodies
 * overlap by more than UUV_APART, and the direction there; above 1: they do not. `left`: the
 * share at which they touch. */
static inline double uuv_swept_(const uuv_bodies_ *q, const double c0[3], const double c1[3], double u[3],
                                double *left) {
    double share = 0.0, way[3], c[3], next[3];
    for (int k = 0; k < 3; k++) way[k] = c1[k] - c0[k];
    double d = uuv_least_(q, c0, u);
    *left = 0.0;
    for (int i = 0; i < UUV_SWEEPS && d < UUV_APART - 1e-9; i++) {
        const double closing = -uuv_dot_(way, u);
        if (!(d + (1.0 - share) * closing > UUV_APART)) return 2.0;
        *left = share - d / closing;
        share += (UUV_APART - d) / closing;
        for (int k = 0; k < 3; k++) c[k] = c0[k] + share * way[k];
        d = uuv_least_(q, c, next);
        for (int k = 0; k < 3; k++) u[k] = next[k];
    }
    if (*left < 0.0) *left = 0.0;
    return uuv_depth_along_(q, c1, u) > UUV_APART ? share : 2.0;
}

/* The direction from which a pair has met since the remembered place, c0 apart; 0 if it has not,
 * or if u, the direction of the least depth, already leads back there. */
static inline int uuv_met_(const uuv_bodies_ *q, const double c0[3], double u[3]) {
    double least[3], first[3], left;
    uuv_least_(q, q->c, least);
    if (uuv_depth_along_(q, c0, least) <= UUV_APART) return 0;
    if (uuv_swept_(q, c0, q->c, first, &left) > 1.0 || uuv_dot_(first, least) > 0.5) return 0;
    for (int k = 0; k < 3; k++) u[k] = first[k];
    return 1;
}

static inline uuv_zone uuv_zone_of_(const uuv_solid *o) {
    uuv_zone z = {{o->centre[0], o->centre[1], o->centre[2]}, {{0.0}}, 0, 0.0, 0.0};
    if (o->kind == UUV_BOX) {
        const double along[3] = {o->size[3], o->size[4], 0.0}, across[3] = {-o->size[4], o->size[3], 0.0};
        z.n = 3;
        for (int k = 0; k < 3; k++) {
            z.g[0][k] = o->size[0] * along[k];
            z.g[1][k] = o->size[1] * across[k];
        }
        z.g[2][2] = o->size[2];
    } else if (o->kind == UUV_CYLINDER) {
        z.n = 1;
        z.disc = o->size[0];
        z.g[0][2] = o->size[1];
    } else if (o->kind == UUV_CAPSULE) {
        z.n = uuv_dot_(o->size, o->size) > 0.0;
        z.ball = o->size[3];
        for (int k = 0; k < 3; k++) z.g[0][k] = o->size[k];
    } else {
        z.ball = o->size[0];
    }
    return z;
}

static inline void uuv_press_solid_(uuv_contact_state_ *s, const uuv_solid *o, const double v_solid[3],
                                    const double before[3], double mu, int number) {
    const double x = o->centre[0] - s->zone.c[0], y = o->centre[1] - s->zone.c[1];
    const double down = o->centre[2] - s->zone.c[2];
    double v[3], u[3], c0[3], way[3];
    for (int k = 0; k < 3; k++) {
        c0[k] = o->centre[k] - s->late * v_solid[k] - before[k];
        way[k] = o->centre[k] - s->zone.c[k] - c0[k];
    }
    const double reach = o->bound + s->bound + s->ahead + uuv_root_(uuv_dot_(way, way)) +
                         s->horizon * uuv_root_(uuv_dot_(v_solid, v_solid));
    if (x * x + y * y + down * down > reach * reach) return;
    for (int k = 0; k < 3; k++) v[k] = v_solid[k] - uuv_dot_(s->R + 3 * k, s->nu);
    const uuv_zone z = uuv_zone_of_(o);
    const uuv_bodies_ q = uuv_bodies_of_(&s->zone, &z);
    int still = 0;
    /* the middle of the hull is not CO: its own velocity */
    const double from[3] = {s->hull->middle[0], s->hull->middle[1], s->hull->middle[2]};
    double turn[3];
    uuv_cross_(s->nu + 3, from, turn);
    for (int k = 0; k < 3; k++)
        v[k] -= s->R[3 * k] * turn[0] + s->R[3 * k + 1] * turn[1] + s->R[3 * k + 2] * turn[2];
    if (!uuv_met_(&q, c0, u) && !uuv_meets_(s, &q, v, u, &still)) return;
    uuv_add_deepest_(s, &q, u, v_solid, mu, number, still);
    const double back[3] = {-u[0], -u[1], -u[2]};
    const uuv_patch_ own = uuv_patch_of_(&s->zone, u), other = uuv_patch_of_(&z, back);
    uuv_add_patch_(s, &own, &other, u, v_solid, mu, number, still, 0);
}

/* The solids whose boxes come within r of c, in rising order; their number, or -1: all may. */
static inline int uuv_near_(const uuv_scene *scene, const double c[3], double r,
                            int32_t part[UUV_CANDIDATES]) {
    double low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = c[k] - r;
        high[k] = c[k] + r;
    }
    const int found = uuv_parts_in_box(&scene->tree, low, high, part, UUV_CANDIDATES);
    int n = found < UUV_CANDIDATES ? found : UUV_CANDIDATES;
    if (found > n && part[n - 1] < scene->n_solids) return -1;
    while (n && part[n - 1] >= scene->n_solids) n--; /* triangles */
    return n;
}

/* ---- the seabed ---- */

static inline double uuv_bed_mu_(const uuv_contact_state_ *s, double north, double east) {
    const uuv_terrain *g = &s->hull->scene->terrain;
    if (!s->hull->material) return s->mu;
    const int i = uuv_within_((north - g->north) / g->spacing + 0.5, 0, g->rows - 1);
    const int j = uuv_within_((east - g->east) / g->spacing + 0.5, 0, g->columns - 1);
    return s->mu * s->hull->friction[s->hull->material[(int64_t)i * g->columns + j]];
}

static inline void uuv_node_(const uuv_terrain *g, int i, int j, double p[3]) {
    p[0] = g->north + i * g->spacing;
    p[1] = g->east + j * g->spacing;
    p[2] = g->z[(int64_t)i * g->columns + j];
}

/* Presses the edge from a to b with the third nodes of its triangles: a ridge only. */
static inline void uuv_press_ridge_(uuv_contact_state_ *s, const double a[3], const double b[3],
                                    const double left[3], const double right[3]) {
    static const double still_water[3] = {0.0, 0.0, 0.0};
    double e[3], l[3], r[3], nl[3], nr[3], n[3];
    for (int k = 0; k < 3; k++) {
        e[k] = b[k] - a[k];
        l[k] = left[k] - a[k];
        r[k] = right[k] - a[k];
    }
    uuv_cross_(e, l, nl);
    uuv_cross_(r, e, nr);
    if (nl[2] != nl[2] || nr[2] != nr[2]) return; /* beside a hole */
    if (nl[2] > 0.0)
        for (int k = 0; k < 3; k++) nl[k] = -nl[k], nr[k] = -nr[k];
    const double sl = uuv_root_(uuv_dot_(nl, nl)), sr = uuv_root_(uuv_dot_(nr, nr));
    if (!(uuv_dot_(nl, r) < -1e-6 * sl * uuv_root_(uuv_dot_(r, r)))) return; /* flat, or a valley */
    for (int k = 0; k < 3; k++) n[k] = nl[k] / sl + nr[k] / sr;
    const double size = uuv_root_(uuv_dot_(n, n));
    double u[3] = {-n[0] / size, -n[1] / size, -n[2] / size};
    uuv_zone z = {{0.0}, {{0.0}}, 1, 0.0, 0.0};
    for (int k = 0; k < 3; k++) {
        z.c[k] = 0.5 * (a[k] + b[k]);
        z.g[0][k] = 0.5 * e[k];
    }
    const double mu = uuv_bed_mu_(s, z.c[0], z.c[1]);
    if (s->zone.n == 3) {
        const uuv_patch_ other = {
            {z.c[0], z.c[1], z.c[2]}, {z.g[0][0], z.g[0][1], z.g[0][2]}, {0.0, 0.0, 0.0}, 1};
        for (int face = 0; face < 3; face++) {
            const uuv_patch_ own = uuv_face_(&s->zone, u, face);
            uuv_add_patch_(s, &own, &other, u, still_water, mu, 0, 0, 1);
        }
        return;
    }
    const uuv_bodies_ q = uuv_bodies_of_(&s->zone, &z);
    double to[3];
    uuv_least_(&q, q.c, to);
    if (uuv_dot_(to, u) > 0.5) uuv_add_deepest_(s, &q, to, still_water, mu, 0, 0);
}

static inline void uuv_press_terrain_(uuv_contact_state_ *s) {
    static const double still_water[3] = {0.0, 0.0, 0.0};
    const uuv_terrain *g = &s->hull->scene->terrain;
    if (g->rows < 2) return;
    const double ahead = s->ahead, low = s->zone.c[2] + s->bound + ahead;
    if (g->low > low) return;
    const double x = (s->zone.c[0] - g->north) / g->spacing, y = (s->zone.c[1] - g->east) / g->spacing;
    const double r = (s->bound + ahead) / g->spacing;
    if (x + r < 0.0 || y + r < 0.0 || x - r > g->rows - 1 || y - r > g->columns - 1) return;
    const int i0 = uuv_within_(x - r, 0, g->rows - 2), i1 = uuv_within_(x + r, 0, g->rows - 2);
    const int j0 = uuv_within_(y - r, 0, g->columns - 2), j1 = uuv_within_(y + r, 0, g->columns - 2);
    int near = 0;
    for (int i = i0; i <= i1 + 1 && !near; i++)
        for (int j = j0; j <= j1 + 1 && !near; j++) near = g->z[(int64_t)i * g->columns + j] < low;
    if (!near) return;
    const uuv_zone *z = &s->zone;
    for (int corner = 0; corner < 1 << z->n; corner++) {
        double p[3], d, n[3];
        for (int k = 0; k < 3; k++) {
            p[k] = z->c[k];
            for (int i = 0; i < z->n; i++) p[k] += corner >> i & 1 ? z->g[i][k] : -z->g[i][k];
        }
        if (!uuv_depth_in_terrain_(g, p, z->ball + ahead, &d, n)) continue;
        const double mu = uuv_bed_mu_(s, p[0], p[1]);
        for (int k = 0; k < 3; k++) p[k] -= z->ball * n[k];
        uuv_add_point_(s, p, n, d + z->ball, still_water, mu, 0, 0);
    }
    for (int i = i0; i <= i1; i++)
        for (int j = j0; j <= j1; j++) {
            double a[3], b[3], c[3], d[3], side[3];
            uuv_node_(g, i, j, a);
            uuv_node_(g, i + 1, j, b);
            uuv_node_(g, i + 1, j + 1, c);
            uuv_node_(g, i, j + 1, d);
            if (a[2] > low && b[2] > low && c[2] > low && d[2] > low) continue;
            uuv_press_ridge_(s, a, c, b, d);
            if (j > 0) { /* between a and b: this cell's triangle a c b, and that of the one before */
                uuv_node_(g, i, j - 1, side);
                uuv_press_ridge_(s, a, b, c, side);
            }
            if (i > 0) {
                uuv_node_(g, i - 1, j, side);
                uuv_press_ridge_(s, a, d, c, side);
            }
        }
}

/* ---- the forces ---- */

/* Numbers before the moving: place of CO, rotation from b to n, nu, diagonal mass, step, kappa, mu,
 * the remembered place of the hull's middle, and whether there is one. */
enum { UUV_CONTACT_HEAD = 31 };

/* What is to be least:  1/2 delta' M delta, and what each row still lacks beside a compliance; and
 * the pushes there. `state`: of each row, 0 where it pushes nothing, 2 where the most. */
static inline double uuv_cost_(int n, double (*J)[6], const double *e, const double *most,
                               const double *soft, const double *M, const double *delta,
                               double *push, char *state) {
    double cost = 0.0;
    for (int k = 0; k < 6; k++) cost += 0.5 * M[k] * delta[k] * delta[k];
    for (int i = 0; i < n; i++) {
        double lacks = e[i];
        for (int k = 0; k < 6; k++) lacks -= J[i][k] * delta[k];
        const double p = lacks / soft[i];
        state[i] = (char)(p > 0.0 ? (p < most[i] ? 1 : 2) : 0);
        push[i] = p > 0.0 ? (p < most[i] ? p : most[i]) : 0.0;
        cost += push[i] * (lacks - 0.5 * soft[i] * push[i]);
    }
    return cost;
}

/* Solves H x = g of a symmetric positive H (6 x 6), which is lost. */
static inline void uuv_solve_six_(double H[6][6], const double *g, double *x) {
    for (int j = 0; j < 6; j++) { /* H = L L' below the diagonal */
        for (int k = 0; k < j; k++) H[j][j] -= H[j][k] * H[j][k];
        H[j][j] = uuv_root_(H[j][j]);
        for (int i = j + 1; i < 6; i++) {
            for (int k = 0; k < j; k++) H[i][j] -= H[i][k] * H[j][k];
            H[i][j] /= H[j][j];
        }
    }
    for (int i = 0; i < 6; i++) {
        x[i] = g[i];
        for (int k = 0; k < i; k++) x[i] -= H[i][k] * x[k];
        x[i] /= H[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) x[i] -= H[k][i] * x[k];
        x[i] /= H[i][i];
    }
}

/* The least delta, in the metric of M, with J_i delta >= e_i, by pushes from 0 to most_i; a row
 * gives way by itself as its compliance says. Newton's steps: convex, and quadratic in pieces. */
static inline void uuv_solve_(int n, double (*J)[6], const double *e, const double *most,
                              const double *soft, const double *M, double *push, double *delta) {
    char state[UUV_CONTACTS], next_state[UUV_CONTACTS];
    double next_push[UUV_CONTACTS], next[6];
    for (int k = 0; k < 6; k++) delta[k] = 0.0;
    double cost = uuv_cost_(n, J, e, most, soft, M, delta, push, state);
    for (int step = 0; step < UUV_STEPS_PUSH; step++) {
        double H[6][6], g[6], by[6];
        for (int k = 0; k < 6; k++) {
            g[k] = -M[k] * delta[k];
            for (int l = 0; l <= k; l++) H[k][l] = k == l ? M[k] : 0.0;
        }
        for (int i = 0; i < n; i++) {
            if (!state[i]) continue;
            const double weight = state[i] == 1 ? 1.0 / soft[i] : 0.0;
            for (int k = 0; k < 6; k++) {
                g[k] += J[i][k] * push[i];
                for (int l = 0; l <= k; l++) H[k][l] += weight * J[i][k] * J[i][l];
            }
        }
        uuv_solve_six_(H, g, by);
        double share = 1.0, found = cost;
        int halved = 0, same = 1;
        for (; halved < 6; halved++, share *= 0.5) {
            for (int k = 0; k < 6; k++) next[k] = delta[k] + share * by[k];
            found = uuv_cost_(n, J, e, most, soft, M, next, next_push, next_state);
            if (found < cost) break;
        }
        if (!(found < cost)) return;
        for (int k = 0; k < 6; k++) delta[k] = next[k];
        for (int i = 0; i < n; i++) {
            same = same && state[i] == next_state[i];
            state[i] = next_state[i];
            push[i] = next_push[i];
        }
        cost = found;
        if (same && !halved) return;
    }
}

/* First what pushes out, then the friction, of at most mu times that. */
static inline void uuv_push_(const uuv_contact_state_ *s, const double *x, double *tau) {
    const double *M = x + 18, h = x[24], kappa = x[25];
    double J[UUV_CONTACTS][6], e[UUV_CONTACTS], most[UUV_CONTACTS], soft[UUV_CONTACTS];
    double push[UUV_CONTACTS], delta[6];
    for (int i = 0; i < s->n; i++) {
        const uuv_contact_point_ *p = s->point + i;
        soft[i] = 0.0;
        for (int k = 0; k < 3; k++) {
            J[i][k] = p->n[k];
            soft[i] += UUV_SOFT * p->n[k] * p->n[k] / M[k];
        }
        uuv_cross_(p->r, p->n, J[i] + 3);
        e[i] = p->e;
        most[i] = __builtin_inf();
    }
    uuv_solve_(s->n, J, e, most, soft, M, push, delta);
    for (int k = 0; k < 6; k++) tau[k] = kappa / (h * h) * M[k] * delta[k];
    for (int i = 0; i < s->n; i++) {
        const uuv_contact_point_ *p = s->point + i;
        double slip[3];
        const double along = uuv_dot_(p->n, p->v);
        for (int k = 0; k < 3; k++) slip[k] = p->v[k] - along * p->n[k];
        e[i] = uuv_root_(uuv_dot_(slip, slip));
        soft[i] = 0.0;
        for (int k = 0; k < 3; k++) {
            J[i][k] = e[i] > 1e-12 ? -slip[k] / e[i] : 0.0;
            soft[i] += UUV_SOFT / M[k];
        }
        uuv_cross_(p->r, J[i], J[i] + 3);
        most[i] = p->mu * kappa / (h * UUV_GRIP) * push[i];
    }
    uuv_solve_(s->n, J, e, most, soft, M, push, delta);
    for (int k = 0; k < 6; k++) tau[k] += UUV_GRIP / h * M[k] * delta[k];
    /* A force is held in b. Where the hull turns far within a step, it points anywhere in n. */
    const double turn = uuv_root_(uuv_dot_(x + 15, x + 15)) * h / UUV_TURNED;
    for (int k = 0; k < 6 && turn > 1.0; k++) tau[k] *= turn < 2.0 ? 2.0 - turn : 0.0;
}

/* The pose and the velocity in the middle of the step in which the force acts, nothing pushing. */
static inline void uuv_when_it_acts_(uuv_contact_state_ *s, const double *x) {
    double half[3], v[3];
    for (int k = 0; k < 3; k++) {
        v[k] = uuv_dot_(x + 3 + 3 * k, x + 12);
        s->co[k] = x[k] + s->late * v[k];
        half[k] = 0.5 * s->late * x[15 + k];
        s->nu[3 + k] = x[15 + k];
    }
    /* R (I - S)^-1 (I + S) of S = S(half): a rotation about omega */
    const double share = 2.0 / (1.0 + uuv_dot_(half, half));
    for (int row = 0; row < 3; row++) {
        double once[3], twice[3];
        uuv_cross_(x + 3 + 3 * row, half, once);
        uuv_cross_(once, half, twice);
        for (int k = 0; k < 3; k++) s->R[3 * row + k] = x[3 + 3 * row + k] + share * (once[k] + twice[k]);
    }
    uuv_to_body_(s->R, v, s->nu);
}

/* The shape of a hull at a pose of CO, and the radius of the ball around it. */
static inline void uuv_hull_at_(const uuv_hull *hull, const double co[3], const double R[9], uuv_zone *z,
                                double *bound) {
    double square = 0.0;
    z->n = hull->n_half;
    z->ball = hull->radius;
    z->disc = 0.0;
    for (int k = 0; k < 3; k++) {
        z->c[k] = co[k] + uuv_dot_(R + 3 * k, hull->middle);
        for (int i = 0; i < z->n; i++) z->g[i][k] = R[3 * k + i] * hull->half[i];
        if (k < z->n) square += hull->half[k] * hull->half[k];
    }
    *bound = uuv_root_(square) + hull->radius;
}

/* Whether a place is remembered (3, and 1 if so), and near enough: a hull that was set elsewhere, or
 * forced through, begins anew. */
static inline int uuv_remembers_(const double now[3], const double *memory, double h, double bound) {
    double square = 0.0;
    for (int k = 0; k < 3; k++) square += (now[k] - memory[k]) * (now[k] - memory[k]);
    const double far = UUV_FORGET * h + 2.0 * bound;
    return memory[3] > 0.5 && square <= far * far;
}

/* y: tau (6), the greatest depth or 0, what is touched there (-1: nothing, 0: the seabed, i: solid
 * number i from 1, then the moving). */
static inline void uuv_contact(const uuv_hull *hull, int n_moving, const double *x, double *y) {
    uuv_contact_state_ s;
    const uuv_scene *scene = hull->scene;
    static const double nothing[3] = {0.0, 0.0, 0.0};
    for (int k = 0; k < 8; k++) y[k] = 0.0;
    s.hull = hull;
    s.late = UUV_LATE * x[24];
    s.horizon = (UUV_LEAD - UUV_LATE) * x[24];
    s.cap = UUV_OUT * s.horizon;
    uuv_when_it_acts_(&s, x);
    s.mu = x[26];
    s.deepest = 0.0;
    s.touched = -1;
    s.n = 0;
    uuv_hull_at_(hull, s.co, s.R, &s.zone, &s.bound);
    for (int k = 0; k < 3; k++) s.present[k] = x[k] + uuv_dot_(x + 3 + 3 * k, hull->middle);
    const int known = uuv_remembers_(s.present, x + 27, x[24], s.bound);
    double way[3];
    for (int k = 0; k < 3; k++) {
        s.before[k] = known ? x[27 + k] : s.present[k];
        way[k] = s.zone.c[k] - s.before[k];
    }
    s.arm = s.bound + uuv_root_(uuv_dot_(hull->middle, hull->middle));
    s.ahead = s.horizon * (uuv_root_(uuv_dot_(s.nu, s.nu)) + uuv_root_(uuv_dot_(s.nu + 3, s.nu + 3)) * s.arm);
    uuv_press_terrain_(&s);
    const double bed_cap = s.cap;
    if (known) s.cap = UUV_HOLD * x[24];
    int32_t part[UUV_CANDIDATES];
    const int near = uuv_near_(scene, s.zone.c, s.bound + s.ahead + uuv_root_(uuv_dot_(way, way)), part);
    for (int j = 0; j < (near < 0 ? scene->n_solids : near); j++) {
        const int i = near < 0 ? j : part[j];
        const double mu = hull->rub ? s.mu * hull->rub[i] : s.mu;
        uuv_press_solid_(&s, scene->solid + i, nothing, s.before, mu, i + 1);
    }
    s.cap = bed_cap;
    for (int i = 0; i < n_moving; i++) {
        const double *m = x + UUV_CONTACT_HEAD + UUV_MOVING * i;
        uuv_solid other = uuv_moving_(m);
        for (int k = 0; k < 3; k++) other.centre[k] += s.late * m[7 + k];
        if (m[6] > 0.0) uuv_press_solid_(&s, &other, m + 7, s.present, s.mu, scene->n_solids + i + 1);
    }
    if (s.n) uuv_push_(&s, x, y);
    y[6] = s.deepest;
    y[7] = s.touched;
}

/* x: place of CO, rotation from b to n, step, what is remembered (4). y: what to remember: a free
 * place of the hull's middle that is reached from the one before without passing through a solid,
 * as near to its present one as sliding goes; and 1. It is 0 as long as a hull that began in a solid
 * or in the seabed is deeper in it than contact holds. */
enum { UUV_PLACE_HEAD = 17 };

static inline void uuv_place(const uuv_hull *hull, const double *x, double *y) {
    const uuv_scene *scene = hull->scene;
    uuv_zone zone, z;
    uuv_bodies_ q;
    double bound, now[3], at[3], u[3], normal[UUV_SLIDES][3], left;
    uuv_hull_at_(hull, x, x + 3, &zone, &bound);
    const int known = uuv_remembers_(zone.c, x + 13, x[12], bound);
    double way = 0.0;
    for (int k = 0; k < 3; k++) {
        now[k] = zone.c[k];
        at[k] = known ? x[13 + k] : now[k];
        way += (now[k] - at[k]) * (now[k] - at[k]);
    }
    const double most = bound + 2.0 * uuv_root_(way); /* from now on: within it are the candidates */
    int32_t part[UUV_CANDIDATES];
    const int near = uuv_near_(scene, now, bound + most, part);
    const int n = near < 0 ? scene->n_solids : near;
    const double cap = UUV_OUT * (UUV_LEAD - UUV_LATE) * x[12];
    y[3] = 1.0;
    if (!known && scene->terrain.rows > 1)
        for (int corner = 0; corner < 1 << zone.n; corner++) {
            double p[3], d, m[3];
            for (int k = 0; k < 3; k++) {
                p[k] = now[k];
                for (int i = 0; i < zone.n; i++) p[k] += corner >> i & 1 ? zone.g[i][k] : -zone.g[i][k];
            }
            if (uuv_depth_in_terrain_(&scene->terrain, p, zone.ball, &d, m) && d + zone.ball > cap) y[3] = 0.0;
        }
    for (int round = 0; round < 4; round++) { /* a turn brings the hull into what it touched */
        int out = 1;
        for (int j = 0; j < n; j++) {
            const uuv_solid *o = scene->solid + (near < 0 ? j : part[j]);
            double square = 0.0, off = 0.0;
            for (int k = 0; k < 3; k++) {
                square += (o->centre[k] - at[k]) * (o->centre[k] - at[k]);
                off += (now[k] - at[k]) * (now[k] - at[k]);
            }
            if (off > most * most || square > (o->bound + bound) * (o->bound + bound)) continue;
            z = uuv_zone_of_(o);
            for (int k = 0; k < 3; k++) zone.c[k] = at[k];
            q = uuv_bodies_of_(&zone, &z);
            const double d = uuv_least_(&q, q.c, u);
            if (!(d > 0.0)) continue;
            if (!known && d > cap) y[3] = 0.0;
            for (int k = 0; k < 3; k++) at[k] -= d * u[k];
            out = 0;
        }
        if (out) break;
    }
    double off = 0.0;
    for (int k = 0; k < 3; k++) off += (now[k] - at[k]) * (now[k] - at[k]);
    if (off > most * most) y[3] = 0.0; /* crammed among solids: no free place is near */
    for (int slide = 0; slide < UUV_SLIDES; slide++) {
        double to[3], first = 2.0, stop = 0.0;
        for (int k = 0; k < 3; k++) to[k] = now[k] - at[k];
        for (int round = 0; round < 8; round++)
            for (int i = 0; i < slide; i++) {
                const double into = uuv_dot_(to, normal[i]);
                for (int k = 0; k < 3 && into > 0.0; k++) to[k] -= into * normal[i][k];
            }
        const double length = uuv_root_(uuv_dot_(to, to));
        if (length < 1e-9 || y[3] < 0.5) break;
        for (int j = 0; j < n; j++) {
            const uuv_solid *o = scene->solid + (near < 0 ? j : part[j]);
            double square = 0.0, c1[3];
            for (int k = 0; k < 3; k++) square += (o->centre[k] - at[k]) * (o->centre[k] - at[k]);
            const double reach = o->bound + bound + length;
            if (square > reach * reach) continue;
            z = uuv_zone_of_(o);
            for (int k = 0; k < 3; k++) zone.c[k] = at[k];
            q = uuv_bodies_of_(&zone, &z);
            for (int k = 0; k < 3; k++) c1[k] = q.c[k] - to[k];
            const double share = uuv_swept_(&q, q.c, c1, u, &left);
            if (!(share < first)) continue;
            first = share;
            stop = left;
            for (int k = 0; k < 3; k++) normal[slide][k] = u[k];
        }
        for (int k = 0; k < 3; k++) at[k] += (first > 1.0 ? 1.0 : stop) * to[k];
        if (first > 1.0) break;
    }
    for (int k = 0; k < 3; k++) y[k] = y[3] > 0.5 ? at[k] : now[k];
}

/* The derivative along a seed, by a central difference: finite also where the surface bends. Of
 * uuv_contact, or of uuv_place where n_moving is UUV_NO_FORCE; the last value has none. */
#define UUV_NO_FORCE (-1)

static inline void uuv_contact_forward(const uuv_hull *hull, int n_moving, int n, double *x,
                                       const double *seed, double *y) {
    const int n_out = n_moving == UUV_NO_FORCE ? 4 : 8;
    double value[2][8], most = 0.0;
    for (int i = 0; i < n; i++)
        if (uuv_size_(seed[i]) > most) most = uuv_size_(seed[i]);
    const double step = most > 0.0 ? 1e-6 / most : 0.0;
    for (int side = 0; side < 2; side++) {
        for (int i = 0; i < n; i++) x[i] += (side ? -2.0 : 1.0) * step * seed[i];
        if (n_moving == UUV_NO_FORCE) uuv_place(hull, x, value[side]);
        else uuv_contact(hull, n_moving, x, value[side]);
    }
    for (int i = 0; i < n; i++) x[i] += step * seed[i];
    for (int k = 0; k < n_out - 1; k++)
        y[k] = step > 0.0 ? (value[0][k] - value[1][k]) / (2.0 * step) : 0.0;
    y[n_out - 1] = 0.0;
}

/* The derivatives along each argument, times a seed of the values. */
static inline void uuv_contact_adjoint(const uuv_hull *hull, int n_moving, int n, double *x,
                                       const double *seed, double *y) {
    const int n_out = n_moving == UUV_NO_FORCE ? 4 : 8;
    double along[UUV_CONTACT_HEAD + UUV_MOVING * UUV_MOVERS] = {0.0}, column[8];
    for (int i = 0; i < n; i++) {
        along[i] = 1.0;
        uuv_contact_forward(hull, n_moving, n, x, along, column);
        along[i] = y[i] = 0.0;
        for (int k = 0; k < n_out - 1; k++) y[i] += column[k] * seed[k];
    }
}

#endif
