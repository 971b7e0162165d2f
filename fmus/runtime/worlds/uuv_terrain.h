/* SPDX-License-Identifier: Apache-2.0 */
/* Rays on a height field: the first of its triangles that a ray meets, exactly, lane by lane.
 *
 * Nodes z[i][j], positive down, stand at N = north + i spacing, E = east + j spacing. The cell
 * (i, j) is cut from node (i, j) to node (i + 1, j + 1); a triangle with a NaN node is a hole. A
 * pyramid of least and greatest z over squares of 2^level cells lets a ray pass over what it
 * cannot meet. Along a ray, its height over the surface is linear between the lines of the grid;
 * on a line it follows from the two nodes of that edge alone, so that neighbours agree to the bit
 * and no ray slips between them. Double arithmetic, + - * / and sqrt only, for every W.
 */
#ifndef UUV_TERRAIN_H
#define UUV_TERRAIN_H

#if defined(UUV_FLOAT32)
#include "uuv_float_math.h"
#else
#include "uuv_math.h"
#endif

#define UUV_TERRAIN_BASE 3 /* the pyramid's finest level: squares of 8 x 8 cells */
#define UUV_TERRAIN_LEVELS 24

typedef struct {
    int rows, columns; /* nodes along N and E; 0: there is no terrain */
    double north, east, spacing;
    double low, high;   /* least and greatest z */
    const float *z;     /* [rows][columns] */
    const float *range; /* level by level {least, greatest}, from UUV_TERRAIN_BASE on */
    int top;            /* the pyramid's last level */
    int at[UUV_TERRAIN_LEVELS], wide[UUV_TERRAIN_LEVELS]; /* first square, squares a row */
} uuv_terrain;

typedef struct {
    double t;    /* in lengths of the direction */
    double n[3]; /* outward unit normal */
    int kind;    /* enum uuv_hit_kind, or UUV_HIT_SOLID + number */
} uuv_hit;

enum uuv_hit_kind { UUV_HIT_NONE = 0, UUV_HIT_SEABED, UUV_HIT_BELOW, UUV_HIT_SURFACE, UUV_HIT_SOLID };

/* The processor's own square root, without a call for negative arguments. */
static inline double uuv_root_(double x) {
#if defined(__clang__)
    return __builtin_elementwise_sqrt(x);
#elif defined(UUV_FLOAT32)
    return __builtin_sqrt(x);
#else
    return uuv_sqrt1_(x);
#endif
}

/* Keeps of [*t, *end] what lies between two lines; 0 if nothing does. */
static inline int uuv_clip_(double x, double dx, double low, double high, double *t, double *end) {
    if (dx == 0.0) return x >= low && x <= high;
    const double a = (low - x) / dx, b = (high - x) / dx;
    const double first = a < b ? a : b, last = a < b ? b : a;
    if (first > *t) *t = first;
    if (last < *end) *end = last;
    return *t <= *end;
}

static inline int uuv_within_(double x, int low, int high) {
    const int i = x > 0.0 ? (x < 2147483000.0 ? (int)x : high) : 0;
    return i < low ? low : i > high ? high : i;
}

/* A ray in units of the grid, and its height over the surface at a point of it. */
typedef struct {
    double x, y, z, dx, dy, dz;
} uuv_grid_ray_;

enum { UUV_INSIDE_ = 0, UUV_ON_X_, UUV_ON_Y_ };

/* Corners of the cell: z00 at (i, j), z10 at (i + 1, j). */
typedef struct {
    double z00, z01, z10, z11;
} uuv_corners_;

static inline double uuv_gap_(const uuv_grid_ray_ *r, const uuv_corners_ *c, int i, int j,
                              double t, int on, int far_side) {
    const double u = r->x + t * r->dx - i, v = r->y + t * r->dy - j;
    double z;
    if (on == UUV_ON_X_)
        z = far_side ? c->z10 + v * (c->z11 - c->z10) : c->z00 + v * (c->z01 - c->z00);
    else if (on == UUV_ON_Y_)
        z = far_side ? c->z01 + u * (c->z11 - c->z01) : c->z00 + u * (c->z10 - c->z00);
    else if (u >= v)
        z = c->z00 + u * (c->z10 - c->z00) + v * (c->z11 - c->z10);
    else
        z = c->z00 + v * (c->z01 - c->z00) + u * (c->z11 - c->z01);
    return r->z + t * r->dz - z;
}

/* The slopes of a triangle along N and E, per cell. */
static inline void uuv_slopes_(const uuv_corners_ *c, int upper, double *a, double *b) {
    *a = upper ? c->z10 - c->z00 : c->z11 - c->z01;
    *b = upper ? c->z11 - c->z10 : c->z01 - c->z00;
}

static inline int uuv_crossed_(const uuv_terrain *g, const uuv_corners_ *c, int upper, double t0,
                               double f0, double t1, double f1, uuv_hit *hit) {
    const double third = upper ? c->z10 : c->z01;
    if (c->z00 != c->z00 || c->z11 != c->z11 || third != third) return 0;
    if ((f0 < 0.0) == (f1 < 0.0)) return 0;
    double a, b;
    uuv_slopes_(c, upper, &a, &b);
    a /= g->spacing;
    b /= g->spacing;
    const double up = 1.0 / uuv_root_(a * a + b * b + 1.0);
    hit->t = t0 + (t1 - t0) * (f0 / (f0 - f1));
    hit->n[0] = a * up;
    hit->n[1] = b * up;
    hit->n[2] = -up;
    hit->kind = f0 < 0.0 ? UUV_HIT_SEABED : UUV_HIT_BELOW;
    return 1;
}

static inline uuv_corners_ uuv_corners_of_(const uuv_terrain *g, int i, int j) {
    const float *p = g->z + (int64_t)i * g->columns + j;
    const uuv_corners_ c = {p[0], p[1], p[g->columns], p[g->columns + 1]};
    return c;
}

/* Where the ray meets the cell (i, j) between t0, on line `on_0`, and t1, on line `on_1`. */
static inline int uuv_cast_cell_(const uuv_terrain *g, const uuv_grid_ray_ *r, int i, int j,
                                 double t0, int on_0, double t1, int on_1, uuv_hit *hit) {
    const uuv_corners_ c = uuv_corners_of_(g, i, j);
    const int back_0 = on_0 == UUV_ON_X_ ? r->dx < 0.0 : r->dy < 0.0;
    const int back_1 = on_1 == UUV_ON_X_ ? r->dx > 0.0 : r->dy > 0.0;
    const double f0 = uuv_gap_(r, &c, i, j, t0, on_0, back_0);
    const double f1 = uuv_gap_(r, &c, i, j, t1, on_1, back_1);
    const double across = (r->x - i) - (r->y - j), turn = r->dx - r->dy;
    const double w0 = across + t0 * turn, w1 = across + t1 * turn;
    if ((w0 > 0.0) == (w1 > 0.0) || w0 == 0.0)
        return uuv_crossed_(g, &c, w0 == 0.0 ? w1 > 0.0 : w0 > 0.0, t0, f0, t1, f1, hit);
    const double td = t0 + (t1 - t0) * (w0 / (w0 - w1));
    const double u = r->x + td * r->dx - i;
    const double fd = r->z + td * r->dz - (c.z00 + u * (c.z11 - c.z00));
    return uuv_crossed_(g, &c, w0 > 0.0, t0, f0, td, fd, hit) ||
           uuv_crossed_(g, &c, w0 <= 0.0, td, fd, t1, f1, hit);
}

/* The first triangle within [0, far]; 0 if there is none. The direction may have any length. */
static inline int uuv_cast_terrain(const uuv_terrain *g, const double o[3], const double d[3], double far,
                            uuv_hit *hit) {
    if (g->rows < 2) return 0;
    const uuv_grid_ray_ r = {(o[0] - g->north) / g->spacing, (o[1] - g->east) / g->spacing, o[2],
                             d[0] / g->spacing, d[1] / g->spacing, d[2]};
    const int last_i = g->rows - 2, last_j = g->columns - 2;
    double t = 0.0, end = far;
    if (!uuv_clip_(r.x, r.dx, 0.0, last_i + 1, &t, &end)) return 0;
    if (!uuv_clip_(r.y, r.dy, 0.0, last_j + 1, &t, &end)) return 0;
    if (!uuv_clip_(r.z, r.dz, g->low - 1.0, g->high + 1.0, &t, &end)) return 0;
    if (!(end < __builtin_inf())) return 0; /* a direction of no length */
    const double per_x = 1.0 / r.dx, per_y = 1.0 / r.dy;
    const int to_x = r.dx > 0.0, to_y = r.dy > 0.0;
    int i = uuv_within_(r.x + t * r.dx, 0, last_i), j = uuv_within_(r.y + t * r.dy, 0, last_j);
    const double long_x = (to_x ? r.dx : -r.dx) * (end - t), long_y = (to_y ? r.dy : -r.dy) * (end - t);
    const int span = uuv_within_(long_x > long_y ? long_x : long_y, 0, 1 << 30) >> UUV_TERRAIN_BASE;
    int level = UUV_TERRAIN_BASE, on = UUV_INSIDE_; /* from a square as long as the ray */
    while (level < g->top && span >> (level - UUV_TERRAIN_BASE)) level++;
    for (;;) {
        const int ni = i >> level, nj = j >> level;
        int line_x = (ni + to_x) << level, line_y = (nj + to_y) << level;
        if (line_x > last_i + 1) line_x = last_i + 1;
        if (line_y > last_j + 1) line_y = last_j + 1;
        const double tx = r.dx != 0.0 ? (line_x - r.x) * per_x : __builtin_inf();
        const double ty = r.dy != 0.0 ? (line_y - r.y) * per_y : __builtin_inf();
        const int by_x = tx <= ty;
        double out = by_x ? tx : ty;
        int on_out = by_x ? UUV_ON_X_ : UUV_ON_Y_;
        if (out >= end) {
            out = end;
            on_out = UUV_INSIDE_;
        }
        if (out < t) out = t;
        if (level) {
            const float *range = g->range + 2 * (g->at[level] + (int64_t)ni * g->wide[level] + nj);
            const double z0 = r.z + t * r.dz, z1 = r.z + out * r.dz;
            if ((z0 >= range[0] || z1 >= range[0]) && (z0 <= range[1] || z1 <= range[1])) {
                level = level > UUV_TERRAIN_BASE ? level - 1 : 0;
                continue;
            }
        } else if (uuv_cast_cell_(g, &r, i, j, t, on, out, on_out, hit)) {
            return 1;
        }
        if (on_out == UUV_INSIDE_) return 0;
        const int was_i = i, was_j = j;
        t = out;
        on = on_out;
        if (by_x) {
            const int high = ((nj + 1) << level) - 1;
            i = to_x ? line_x : line_x - 1;
            if (i < 0 || i > last_i) return 0;
            j = uuv_within_(r.y + t * r.dy, nj << level, high < last_j ? high : last_j);
        } else {
            const int high = ((ni + 1) << level) - 1;
            j = to_y ? line_y : line_y - 1;
            if (j < 0 || j > last_j) return 0;
            i = uuv_within_(r.x + t * r.dx, ni << level, high < last_i ? high : last_i);
        }
        const int moved = (i ^ was_i) | (j ^ was_j);
        if (level == 0)
            level = moved >> UUV_TERRAIN_BASE ? UUV_TERRAIN_BASE : 0;
        else if (level < g->top && moved >> (level + 1))
            level++;
    }
}

/* z below (north, east); NaN outside of the terrain and in its holes. */
static inline double uuv_height(const uuv_terrain *g, double north, double east) {
    const double x = (north - g->north) / g->spacing, y = (east - g->east) / g->spacing;
    if (g->rows < 2 || !(x >= 0.0 && y >= 0.0 && x <= g->rows - 1 && y <= g->columns - 1))
        return __builtin_nan("");
    const int i = uuv_within_(x, 0, g->rows - 2), j = uuv_within_(y, 0, g->columns - 2);
    const uuv_corners_ c = uuv_corners_of_(g, i, j);
    const double u = x - i, v = y - j;
    return u >= v ? c.z00 + u * (c.z10 - c.z00) + v * (c.z11 - c.z10)
                  : c.z00 + v * (c.z01 - c.z00) + u * (c.z11 - c.z01);
}

#endif
