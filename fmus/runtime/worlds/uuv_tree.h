/* SPDX-License-Identifier: Apache-2.0 */
/* A tree of boxes over a scene's solids and triangles, and the triangles that it leads to.
 *
 * A part of the scene has a number: solids come first, in the order of the scene, then triangles.
 * A node holds the boxes of four children; a child is a node or one part. Boxes are wider than
 * their part by a margin (models/shapes/tree.py), and a node's box holds those of its children to the
 * bit. Because rounding is monotone, a ray that passes the box of a part also passes those of all
 * nodes above it, and enters them no later. The nearest part, with the smaller number where two
 * are equally near, is therefore found by every tree over the same boxes.
 */
#ifndef UUV_TREE_H
#define UUV_TREE_H

#include "uuv_terrain.h"

#define UUV_TREE_STACK 79 /* 3 for each of 26 levels, and one: models/shapes/tree.py, DEPTH */
#define UUV_TREE_NOBODY (-2147483647 - 1) /* a child that is not there */

typedef struct {
    float low[3][4], high[3][4]; /* m; axis, then child */
    int32_t child[4];            /* a node, or -1 - the number of a part */
} uuv_tree_node;

typedef struct {
    const uuv_tree_node *node; /* the first is the root */
    int n_nodes;               /* 0: there is no part */
    double middle[3];          /* m; vertices are relative to it */
    const float *vertex;       /* [][3] */
    const int32_t *corner;     /* [triangles][3]: vertices, anticlockwise seen from outside */
    const int32_t *first;      /* [n_meshes + 1]: first triangle of each mesh, and their number */
    int n_meshes;
} uuv_tree;

/* A ray as the tree reads it. */
typedef struct {
    double o[3], per[3];     /* origin; 1 / direction, 1e300 where that is 0 */
    double from[3];          /* origin, relative to the middle of the meshes */
    int x, y, z;             /* z: the axis along which the direction is longest */
    double shear_x, shear_y; /* direction along x and y, by that along z */
} uuv_tree_ray;

static inline uuv_tree_ray uuv_tree_ray_(const uuv_tree *g, const double o[3], const double d[3]) {
    uuv_tree_ray r;
    double most = -1.0;
    r.z = 0;
    for (int k = 0; k < 3; k++) {
        const double size = d[k] < 0.0 ? -d[k] : d[k];
        r.o[k] = o[k];
        r.from[k] = o[k] - g->middle[k];
        r.per[k] = d[k] != 0.0 ? 1.0 / d[k] : 1e300;
        if (r.per[k] > 1e300) r.per[k] = 1e300;
        if (r.per[k] < -1e300) r.per[k] = -1e300;
        if (size > most) most = size, r.z = k;
    }
    r.x = r.z == 2 ? 0 : r.z + 1;
    r.y = r.x == 2 ? 0 : r.x + 1;
    r.shear_x = d[r.x] / d[r.z];
    r.shear_y = d[r.y] / d[r.z];
    return r;
}

/* Where the ray enters each child's box before `far`; above it, or NaN, where it does not. */
static inline void uuv_tree_enter_(const uuv_tree_node *n, const uuv_tree_ray *r, double far,
                                   double enter[4], double leave[4]) {
    for (int c = 0; c < 4; c++) enter[c] = 0.0, leave[c] = far;
    for (int k = 0; k < 3; k++) {
        const double o = r->o[k], per = r->per[k];
        for (int c = 0; c < 4; c++) {
            const double a = ((double)n->low[k][c] - o) * per, b = ((double)n->high[k][c] - o) * per;
            const double first = a < b ? a : b, last = a < b ? b : a;
            enter[c] = first > enter[c] ? first : enter[c];
            leave[c] = last < leave[c] ? last : leave[c];
        }
    }
}

/* Where the ray meets a triangle, 0 or more; -1 where it does not.
 *
 * Watertight (Woop, Benthin and Wald 2013, Journal of Computer Graphics Techniques 2 (1)): the
 * vertices are seen along the ray, and each edge is judged by two products of the coordinates of
 * its ends. Two triangles judge the edge between them by the same products. Rounding is monotone,
 * so that a judgement is right or 0, and 0 counts as a hit for both. This needs products that are
 * not contracted with the difference that follows.
 */
static inline double uuv_cast_triangle_(const uuv_tree *g, const uuv_tree_ray *r, double per_z,
                                        int number) {
    double x[3], y[3], z[3];
    for (int k = 0; k < 3; k++) {
        const float *v = g->vertex + 3 * (int64_t)g->corner[3 * (int64_t)number + k];
        z[k] = v[r->z] - r->from[r->z];
        x[k] = (v[r->x] - r->from[r->x]) - r->shear_x * z[k];
        y[k] = (v[r->y] - r->from[r->y]) - r->shear_y * z[k];
    }
    const double u = x[2] * y[1] - y[2] * x[1];
    const double v = x[0] * y[2] - y[0] * x[2];
    const double w = x[1] * y[0] - y[1] * x[0];
    if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0)) return -1.0;
    const double whole = u + v + w;
    if (whole == 0.0) return -1.0; /* seen along its plane: its neighbours are met */
    const double t = (u * z[0] + v * z[1] + w * z[2]) / whole * per_z;
    return t >= 0.0 ? t : -1.0;
}

/* The corners of a triangle [m], and its outward unit normal, 0 where it has no area. */
static inline void uuv_triangle_(const uuv_tree *g, int number, double corner[3][3], double n[3]) {
    for (int k = 0; k < 3; k++) {
        const float *v = g->vertex + 3 * (int64_t)g->corner[3 * (int64_t)number + k];
        for (int m = 0; m < 3; m++) corner[k][m] = g->middle[m] + v[m];
    }
    double a[3], b[3];
    for (int m = 0; m < 3; m++) {
        const float *v = g->vertex + m;
        const int32_t *c = g->corner + 3 * (int64_t)number;
        a[m] = (double)v[3 * (int64_t)c[1]] - v[3 * (int64_t)c[0]];
        b[m] = (double)v[3 * (int64_t)c[2]] - v[3 * (int64_t)c[0]];
    }
    n[0] = a[1] * b[2] - a[2] * b[1];
    n[1] = a[2] * b[0] - a[0] * b[2];
    n[2] = a[0] * b[1] - a[1] * b[0];
    const double size = uuv_root_(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int m = 0; m < 3 && size > 0.0; m++) n[m] /= size;
}

/* The mesh of a triangle, from 0. */
static inline int uuv_mesh_of_(const uuv_tree *g, int number) {
    int low = 0, high = g->n_meshes - 1;
    while (low < high) {
        const int middle = (low + high + 1) / 2;
        if (g->first[middle] <= number) low = middle;
        else high = middle - 1;
    }
    return low;
}

/* The parts whose boxes meet the box from `low` to `high` [m], in rising order: solids, then
 * n_solids + triangle. At most `most` are written, the first ones; returned is how many there are. */
static inline int uuv_parts_in_box(const uuv_tree *g, const double low[3], const double high[3],
                                   int32_t *part, int most) {
    int32_t stack[UUV_TREE_STACK];
    int n = 0, found = 0;
    if (g->n_nodes) stack[n++] = 0;
    while (n) {
        const uuv_tree_node *node = g->node + stack[--n];
        for (int c = 0; c < 4; c++) {
            int meets = node->child[c] != UUV_TREE_NOBODY;
            for (int k = 0; k < 3; k++)
                meets &= node->low[k][c] <= high[k] && node->high[k][c] >= low[k];
            if (!meets) continue;
            if (node->child[c] >= 0) {
                stack[n++] = node->child[c];
                continue;
            }
            const int32_t number = -1 - node->child[c];
            int at = found < most ? found : most;
            found++;
            while (at > 0 && part[at - 1] > number) {
                if (at < most) part[at] = part[at - 1];
                at--;
            }
            if (at < most) part[at] = number;
        }
    }
    return found;
}

#endif
