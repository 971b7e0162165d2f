/* SPDX-License-Identifier: Apache-2.0 */
/* How deep a place is in the seabed, and capsules that move.
 *
 * The depth is the distance to the nearest point of the surface, sought among the triangles of the
 * cells that lie within reach; n is the outward normal there.
 */
#ifndef UUV_TOUCH_H
#define UUV_TOUCH_H

#include "uuv_cast.h"

static inline double uuv_dot_(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double uuv_unit_interval_(double x) { return x > 0.0 ? (x < 1.0 ? x : 1.0) : 0.0; }

/* The square of the distance from p to its nearest point q of a segment from a to b. */
static inline double uuv_near_edge_(const double p[3], const double a[3], const double b[3], double q[3]) {
    const double e[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double w[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double s = uuv_unit_interval_(uuv_dot_(w, e) / uuv_dot_(e, e));
    double r[3];
    for (int k = 0; k < 3; k++) {
        q[k] = a[k] + s * e[k];
        r[k] = p[k] - q[k];
    }
    return uuv_dot_(r, r);
}

/* The same of a triangle. */
static inline double uuv_near_triangle_(const double p[3], const double a[3], const double b[3],
                                 const double c[3], double q[3]) {
    const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double w[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double uu = uuv_dot_(u, u), uv = uuv_dot_(u, v), vv = uuv_dot_(v, v);
    const double wu = uuv_dot_(w, u), wv = uuv_dot_(w, v), whole = uu * vv - uv * uv;
    const double s = (vv * wu - uv * wv) / whole, t = (uu * wv - uv * wu) / whole;
    if (s >= 0.0 && t >= 0.0 && s + t <= 1.0) {
        double r[3];
        for (int k = 0; k < 3; k++) {
            q[k] = a[k] + s * u[k] + t * v[k];
            r[k] = p[k] - q[k];
        }
        return uuv_dot_(r, r);
    }
    double other[3], best = uuv_near_edge_(p, a, b, q);
    const double *ends[2][2] = {{b, c}, {c, a}};
    for (int e = 0; e < 2; e++) {
        const double square = uuv_near_edge_(p, ends[e][0], ends[e][1], other);
        if (!(square < best)) continue;
        best = square;
        for (int k = 0; k < 3; k++) q[k] = other[k];
    }
    return best;
}

/* The depth of p in the seabed, negative above it; 0 where it is farther off than `reach`. */
static inline int uuv_depth_in_terrain_(const uuv_terrain *g, const double p[3], double reach, double *d,
                                 double n[3]) {
    const double gap = p[2] - uuv_height(g, p[0], p[1]);
    if (gap != gap) return 0; /* outside of the terrain, or over a hole */
    const double most = gap > 0.0 ? (gap < 2.0 * g->spacing ? gap : 2.0 * g->spacing) : reach;
    const double x = (p[0] - g->north) / g->spacing, y = (p[1] - g->east) / g->spacing;
    const double r = most / g->spacing;
    const int i0 = uuv_within_(x - r, 0, g->rows - 2), i1 = uuv_within_(x + r, 0, g->rows - 2);
    const int j0 = uuv_within_(y - r, 0, g->columns - 2), j1 = uuv_within_(y + r, 0, g->columns - 2);
    int near = gap > 0.0;
    for (int i = i0; i <= i1 + 1 && !near; i++)
        for (int j = j0; j <= j1 + 1 && !near; j++)
            near = g->z[(int64_t)i * g->columns + j] < p[2] + reach;
    if (!near) return 0;
    double best = gap * gap, nearest[3] = {p[0], p[1], p[2] - gap};
    for (int i = i0; i <= i1; i++)
        for (int j = j0; j <= j1; j++) {
            const uuv_corners_ c = uuv_corners_of_(g, i, j);
            const double n0 = g->north + i * g->spacing, n1 = g->north + (i + 1) * g->spacing;
            const double e0 = g->east + j * g->spacing, e1 = g->east + (j + 1) * g->spacing;
            const double a[3] = {n0, e0, c.z00}, b[3] = {n1, e1, c.z11};
            const double third[2][3] = {{n1, e0, c.z10}, {n0, e1, c.z01}};
            for (int k = 0; k < 2; k++) {
                double q[3];
                if (a[2] != a[2] || b[2] != b[2] || third[k][2] != third[k][2]) continue;
                const double square = uuv_near_triangle_(p, a, b, third[k], q);
                if (!(square < best)) continue;
                best = square;
                for (int m = 0; m < 3; m++) nearest[m] = q[m];
            }
        }
    const double distance = uuv_root_(best);
    *d = gap > 0.0 ? distance : -distance;
    if (distance > 1e-9) {
        for (int k = 0; k < 3; k++) n[k] = (nearest[k] - p[k]) / *d;
    } else { /* on the surface: the normal of its triangle */
        const int i = uuv_within_(x, 0, g->rows - 2), j = uuv_within_(y, 0, g->columns - 2);
        const uuv_corners_ c = uuv_corners_of_(g, i, j);
        double a, b;
        uuv_slopes_(&c, x - i >= y - j, &a, &b);
        const double up = g->spacing / uuv_root_(a * a + b * b + g->spacing * g->spacing);
        n[0] = a / g->spacing * up;
        n[1] = b / g->spacing * up;
        n[2] = -up;
    }
    return 1;
}

/* Capsules that move: centre, middle half the way to an end, radius, velocity; radius 0: none. */
#define UUV_MOVING 10

static inline uuv_solid uuv_moving_(const double *m) {
    uuv_solid s = {UUV_CAPSULE, {m[0], m[1], m[2]}, {m[3], m[4], m[5], m[6], 0.0}, 0.0};
    s.bound = uuv_root_(uuv_dot_(m + 3, m + 3)) + m[6];
    return s;
}

#endif
