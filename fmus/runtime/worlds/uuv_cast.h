/* SPDX-License-Identifier: Apache-2.0 */
/* Rays in a scene: its terrain, solids and meshes, what moves, and the water's surface at D = 0.
 *
 * Surfaces are met from both sides. Of two at the same distance the first counts, in the order
 * terrain, surface, solids of the scene, triangles of its meshes, moving solids.
 */
#ifndef UUV_CAST_H
#define UUV_CAST_H

#include "uuv_tree.h"

enum uuv_solid_kind { UUV_BOX = 0, UUV_SPHERE, UUV_CAPSULE, UUV_CYLINDER };

/* Box: half lengths, cosine and sine of its yaw. Sphere: radius. Capsule: from its middle half the
 * way to an end (3), radius. Cylinder, upright: radius, half height. */
typedef struct {
    int kind;
    double centre[3];
    double size[5];
    double bound; /* radius of a ball around the centre that holds it */
} uuv_solid;

typedef struct {
    uuv_terrain terrain;
    const uuv_solid *solid;
    int n_solids;
    uuv_tree tree; /* over the solids and the triangles */
} uuv_scene;

/* The first root of a t² + 2 b t + c = 0 that is 0 or more. */
static inline int uuv_first_root_(double a, double b, double c, double *t) {
    const double inside = b * b - a * c;
    if (!(inside >= 0.0) || a == 0.0) return 0;
    const double root = uuv_root_(inside);
    const double q = b > 0.0 ? -(b + root) : root - b; /* without cancellation */
    const double one = q / a, other = q != 0.0 ? c / q : one;
    const double near = one < other ? one : other, far = one < other ? other : one;
    *t = near >= 0.0 ? near : far;
    return *t >= 0.0;
}

static inline void uuv_keep_hit_(uuv_hit *hit, double t, double nx, double ny, double nz) {
    if (!(t >= 0.0) || !(t < hit->t)) return;
    hit->t = t;
    hit->n[0] = nx;
    hit->n[1] = ny;
    hit->n[2] = nz;
    hit->kind = UUV_HIT_SOLID;
}

static inline void uuv_cast_ball_(const double p[3], const double d[3], double radius,
                                  uuv_hit *hit) {
    double t;
    const double a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const double b = p[0] * d[0] + p[1] * d[1] + p[2] * d[2];
    const double c = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] - radius * radius;
    if (uuv_first_root_(a, b, c, &t))
        uuv_keep_hit_(hit, t, (p[0] + t * d[0]) / radius, (p[1] + t * d[1]) / radius,
                      (p[2] + t * d[2]) / radius);
}

static inline void uuv_cast_box_(const uuv_solid *s, const double p[3], const double d[3],
                                 uuv_hit *hit) {
    const double c = s->size[3], w = s->size[4];
    const double at[3] = {c * p[0] + w * p[1], c * p[1] - w * p[0], p[2]};
    const double to[3] = {c * d[0] + w * d[1], c * d[1] - w * d[0], d[2]};
    double first = -__builtin_inf(), last = __builtin_inf();
    int in = 0, out = 0;
    for (int k = 0; k < 3; k++) {
        if (to[k] == 0.0) {
            if (!(at[k] >= -s->size[k] && at[k] <= s->size[k])) return;
            continue;
        }
        const double a = (-s->size[k] - at[k]) / to[k], b = (s->size[k] - at[k]) / to[k];
        if ((a < b ? a : b) > first) first = a < b ? a : b, in = k;
        if ((a < b ? b : a) < last) last = a < b ? b : a, out = k;
    }
    if (!(first <= last)) return;
    const double t = first >= 0.0 ? first : last;
    const int k = first >= 0.0 ? in : out;
    const double sign = (first >= 0.0) == (to[k] > 0.0) ? -1.0 : 1.0;
    if (k == 2) uuv_keep_hit_(hit, t, 0.0, 0.0, sign);
    if (k == 0) uuv_keep_hit_(hit, t, sign * c, sign * w, 0.0);
    if (k == 1) uuv_keep_hit_(hit, t, -sign * w, sign * c, 0.0);
}

static inline void uuv_cast_capsule_(const uuv_solid *s, const double p[3], const double d[3],
                                     uuv_hit *hit) {
    const double *e = s->size, radius = s->size[3];
    const double ee = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
    const double from[3] = {p[0] + e[0], p[1] + e[1], p[2] + e[2]};
    const double to[3] = {p[0] - e[0], p[1] - e[1], p[2] - e[2]};
    uuv_hit best = *hit;
    if (ee > 0.0) {
        const double pe = (p[0] * e[0] + p[1] * e[1] + p[2] * e[2]) / ee;
        const double de = (d[0] * e[0] + d[1] * e[1] + d[2] * e[2]) / ee;
        double a = 0.0, b = 0.0, c = -radius * radius;
        for (int k = 0; k < 3; k++) {
            const double q = p[k] - pe * e[k], v = d[k] - de * e[k];
            a += v * v;
            b += q * v;
            c += q * q;
        }
        const double inside = b * b - a * c;
        if (a > 0.0 && inside >= 0.0)
            for (int side = -1; side <= 1; side += 2) { /* both, for a ray may begin within */
                const double t = (-b + side * uuv_root_(inside)) / a, along = pe + t * de;
                if (!(along >= -1.0 && along <= 1.0)) continue;
                uuv_keep_hit_(&best, t, (p[0] + t * d[0] - along * e[0]) / radius,
                              (p[1] + t * d[1] - along * e[1]) / radius,
                              (p[2] + t * d[2] - along * e[2]) / radius);
            }
    }
    for (int end = 0; end < 2; end++) { /* the half of a ball beyond its end */
        const double *q = end ? to : from, out = end ? 1.0 : -1.0;
        double a = 0.0, b = 0.0, c = -radius * radius;
        for (int k = 0; k < 3; k++) {
            a += d[k] * d[k];
            b += q[k] * d[k];
            c += q[k] * q[k];
        }
        const double inside = b * b - a * c;
        if (!(a > 0.0 && inside >= 0.0)) continue;
        for (int side = -1; side <= 1; side += 2) {
            const double t = (-b + side * uuv_root_(inside)) / a;
            const double n[3] = {q[0] + t * d[0], q[1] + t * d[1], q[2] + t * d[2]};
            if (out * (n[0] * e[0] + n[1] * e[1] + n[2] * e[2]) < 0.0) continue;
            uuv_keep_hit_(&best, t, n[0] / radius, n[1] / radius, n[2] / radius);
        }
    }
    *hit = best;
}

static inline void uuv_cast_cylinder_(const uuv_solid *s, const double p[3], const double d[3],
                                      uuv_hit *hit) {
    const double radius = s->size[0], half = s->size[1];
    const double a = d[0] * d[0] + d[1] * d[1], b = p[0] * d[0] + p[1] * d[1];
    const double c = p[0] * p[0] + p[1] * p[1] - radius * radius;
    const double inside = b * b - a * c;
    for (int side = -1; side <= 1; side += 2) {
        if (a > 0.0 && inside >= 0.0) {
            const double t = (-b + side * uuv_root_(inside)) / a, z = p[2] + t * d[2];
            if (z >= -half && z <= half)
                uuv_keep_hit_(hit, t, (p[0] + t * d[0]) / radius, (p[1] + t * d[1]) / radius, 0.0);
        }
        if (d[2] != 0.0) {
            const double t = (side * half - p[2]) / d[2];
            const double x = p[0] + t * d[0], y = p[1] + t * d[1];
            if (x * x + y * y <= radius * radius) uuv_keep_hit_(hit, t, 0.0, 0.0, side);
        }
    }
}

/* Whether the line of the ray, from its origin on, comes within the ball around a solid; `far`:
 * and does so before what was hit already. */
static inline int uuv_may_meet_(const uuv_solid *s, const double p[3], const double d[3],
                                const double *far) {
    const double a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const double b = p[0] * d[0] + p[1] * d[1] + p[2] * d[2];
    const double c = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] - s->bound * s->bound;
    if (c <= 0.0) return 1;
    if (b >= 0.0 || !(b * b >= 0.999999 * (a * c))) return 0;
    /* its nearest point to the centre, and the first that could touch */
    return !far || *far * a >= -b || *far * *far * a + 2.0 * *far * b + c <= 0.0;
}

static inline void uuv_cast_shape_(const uuv_solid *s, const double p[3], const double d[3],
                                   uuv_hit *hit) {
    if (s->kind == UUV_BOX) uuv_cast_box_(s, p, d, hit);
    if (s->kind == UUV_SPHERE) uuv_cast_ball_(p, d, s->size[0], hit);
    if (s->kind == UUV_CAPSULE) uuv_cast_capsule_(s, p, d, hit);
    if (s->kind == UUV_CYLINDER) uuv_cast_cylinder_(s, p, d, hit);
}

static inline void uuv_cast_solid_(const uuv_solid *s, const double o[3], const double d[3],
                                   int number, uuv_hit *hit) {
    const double p[3] = {o[0] - s->centre[0], o[1] - s->centre[1], o[2] - s->centre[2]};
    if (!uuv_may_meet_(s, p, d, &hit->t)) return;
    const double before = hit->t;
    uuv_cast_shape_(s, p, d, hit);
    if (hit->t < before) hit->kind = UUV_HIT_SOLID + number;
}

/* The nearest of the scene's solids and triangles, the one of the smaller number where two are
 * equally near. A hit lies within the box of its part: so its place in the tree does not matter. */
static inline void uuv_cast_tree_(const uuv_scene *s, const double o[3], const double d[3],
                                  uuv_hit *hit) {
    const uuv_tree *g = &s->tree;
    struct {
        double enter;
        int32_t at;
    } stack[UUV_TREE_STACK];
    const uuv_tree_ray r = uuv_tree_ray_(g, o, d);
    const double per_z = 1.0 / d[r.z];
    int n = 1, best = -1;
    stack[0].enter = 0.0;
    stack[0].at = 0;
    while (n) {
        const double entered = stack[--n].enter;
        const int32_t at = stack[n].at;
        if (entered > hit->t) continue;
        if (at < 0) {
            const int number = -1 - at;
            uuv_hit own = {__builtin_inf(), {0.0, 0.0, 0.0}, UUV_HIT_NONE};
            if (number < s->n_solids) {
                const uuv_solid *solid = s->solid + number;
                const double p[3] = {o[0] - solid->centre[0], o[1] - solid->centre[1],
                                     o[2] - solid->centre[2]};
                if (!uuv_may_meet_(solid, p, d, 0)) continue;
                uuv_cast_shape_(solid, p, d, &own);
            } else {
                const double t = uuv_cast_triangle_(g, &r, per_z, number - s->n_solids);
                if (!(t >= 0.0)) continue;
                own.t = t;
            }
            if (own.t < entered) own.t = entered;
            if (!(own.t < hit->t || (own.t == hit->t && number < best))) continue;
            best = number;
            own.kind = UUV_HIT_SOLID + number;
            *hit = own;
            continue;
        }
        double enter[4], leave[4];
        const uuv_tree_node *node = g->node + at;
        /* 1e290: a ray along a box's side is 1e300 lengths away from those beside it */
        uuv_tree_enter_(node, &r, hit->t < 1e290 ? hit->t : 1e290, enter, leave);
        const int base = n;
        for (int c = 0; c < 4; c++) {
            if (!(enter[c] <= leave[c]) || node->child[c] == UUV_TREE_NOBODY) continue;
            int k = n++; /* the nearest on top */
            for (; k > base && stack[k - 1].enter < enter[c]; k--) stack[k] = stack[k - 1];
            stack[k].enter = enter[c];
            stack[k].at = node->child[c];
        }
    }
    if (best < s->n_solids) return;
    double corner[3][3];
    const int number = best - s->n_solids;
    uuv_triangle_(g, number, corner, hit->n);
    const double into = hit->n[0] * d[0] + hit->n[1] * d[1] + hit->n[2] * d[2];
    for (int k = 0; k < 3 && into > 0.0; k++) hit->n[k] = -hit->n[k]; /* against the ray */
    hit->kind = UUV_HIT_SOLID + s->n_solids + uuv_mesh_of_(g, number);
}

/* What a ray meets first within [0, far]: its kind. `t` is `far` if that is nothing. A number
 * counts the scene's solids, then its meshes, then what moves. */
static inline int uuv_cast(const uuv_scene *s, const uuv_solid *moving, int n_moving, const double o[3],
                    const double d[3], double far, uuv_hit *hit) {
    hit->t = far;
    hit->kind = UUV_HIT_NONE;
    hit->n[0] = hit->n[1] = hit->n[2] = 0.0;
    uuv_cast_terrain(&s->terrain, o, d, far, hit);
    if (d[2] != 0.0 && -o[2] / d[2] >= 0.0 && -o[2] / d[2] < hit->t) {
        hit->t = -o[2] / d[2];
        hit->n[0] = hit->n[1] = 0.0;
        hit->n[2] = o[2] > 0.0 ? 1.0 : -1.0;
        hit->kind = UUV_HIT_SURFACE;
    }
    if (s->tree.n_nodes) uuv_cast_tree_(s, o, d, hit);
    const int still = s->n_solids + s->tree.n_meshes;
    for (int i = 0; i < n_moving; i++) uuv_cast_solid_(moving + i, o, d, still + i, hit);
    return hit->kind;
}

#endif
