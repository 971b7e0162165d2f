/* SPDX-License-Identifier: Apache-2.0 */
/* Image of a sonar: coherent echoes of the surfaces that its rays meet, by beam and range.
 *
 * Rays lie in columns. All rays of a column make the same angle with the array, whose axis is y of
 * the sensor: u is the sine of that angle. In a column they fan out over the elevation theta, from
 * x to z, so that a ray stands for the solid angle du dtheta. A ray that meets a surface at r, with
 * the cosine c of its incidence, scatters back the mean intensity
 *
 *     I = s(c) / c  du dtheta  B(theta)  10^(-0.2 alpha r) / r^2,
 *
 * which is s(c) dA / r^4 of the area dA = r^2 du dtheta / c. s is the material's backscattering
 * strength; mu c^2 by Lambert. The ray's area may be longer than a range cell: it is then cut into
 * scatterers along the tangent plane. Each scatterer's pressure is a complex Gaussian number, drawn
 * from its place in the world, times exp(i 2 k r). A column's scatterers are added up in range
 * cells and passed through the matched filter; the columns are added up with the array's pattern.
 *
 * Rays may bend and be reflected once (uuv_sonar_path.h). r of the level is then that of a straight ray
 * whose tube is as wide, 1/r² = 1 / (tall wide): scattered sound returns along the same tube, by
 * reciprocity. r of the image is the time times the speed that the instrument assumes. A path with a
 * bounce is used both ways: its pressure has the square of the reflection coefficient.
 *
 * Phases are float64, sums float32 in an order that depends on nothing else, and random numbers
 * come from tables: + - * / sqrt alone, so that bits are equal for every W, compiler and processor.
 */
#ifndef UUV_SONAR_H
#define UUV_SONAR_H

#include "uuv_sonar_path.h"

#define UUV_SONAR_TABLE 4096 /* entries of the tables of turns and of amplitudes */
#define UUV_SONAR_ANGLES 256 /* steps of a material's strength, over the cosine of incidence */
#define UUV_SONAR_BLOCK 16   /* columns that are added to the beams together */
#define UUV_SONAR_WIDE 16    /* bins side by side */
enum { UUV_SONAR_HEAD = 22 };

typedef struct {
    int beams, bins, columns, rays; /* rays: of a column */
    int fine, pad;                  /* range cells of a bin; bins that the pulse reaches to either side */
    int n_moving;
    double first, step;             /* near edge of bin 0, length of a bin [m] */
    double farthest;                /* of a ray [m] */
    double d_theta;
    int tvg;                        /* gain r^(tvg / 2): 10 tvg log r in dB */
    const double *column;           /* [columns]: u, sqrt(1 - u^2), du */
    const double *ray;              /* [rays]: cos and sin of theta, B(theta) dtheta */
    const float *weight;            /* [columns][even number of beams]: pattern of the array */
    const int16_t *window;          /* [beams]: first column, and the one after the last */
    const int16_t *nearest;         /* [columns]: first beam whose labels it gives, one after the last */
    const float *pulse;             /* [2 pad + 1][fine]: response of the matched filter */
    const float *strength;          /* [materials][UUV_SONAR_ANGLES + 1]: s / c */
    const unsigned char *seabed;    /* material of each node of the terrain; 0: material 0 everywhere */
    const unsigned char *solid;     /* material of each solid, mesh and mover */
    const float *surface; /* [UUV_SONAR_ANGLES + 1]: parts of the coefficient of the surface, squared; 0: no bounce */
    const float *bottom;  /* [materials][UUV_SONAR_ANGLES + 1]: those of the seabed */
    const float *turns, *amplitudes; /* [UUV_SONAR_TABLE]: cos and sin; square root of -ln(u) */
    uuv_profile profile;
} uuv_sonar;

/* Arrays of one image: floats by [beam][bin], with rows of uuv_sonar_row_ bins. */
typedef struct {
    float *re, *im;       /* pressure, and then its parts with noise */
    float *cells;         /* range cells of a column: 2 fine (bins + 2 pad + 16) */
    float *loss;          /* pressure at 1 m, and what the water leaves of it: fine (bins + 2 pad + 16) */
    float *block;         /* UUV_SONAR_BLOCK * 2 rows */
    float *strongest;     /* of the labels; 0: there are none */
    uint16_t *label;      /* 0: no echo; 1: seabed; 2 + i: solid, mesh or mover i */
} uuv_sonar_work;

typedef float uuv_bins_ __attribute__((vector_size(4 * UUV_SONAR_WIDE)));
typedef float uuv_bins_read_ __attribute__((vector_size(4 * UUV_SONAR_WIDE), aligned(4), may_alias));

static inline int uuv_sonar_row_(int bins) { return (bins + UUV_SONAR_WIDE - 1) / UUV_SONAR_WIDE * UUV_SONAR_WIDE; }

/* Floats of a work space. */
#define UUV_SONAR_ROW(bins) (((bins) + 15) / 16 * 16)
#define UUV_SONAR_ROOM(beams, bins, fine, pad, labels)                                             \
    (2 * (beams) * UUV_SONAR_ROW(bins) + 3 * (fine) * ((bins) + 2 * (pad) + 16) +                  \
     2 * UUV_SONAR_BLOCK * UUV_SONAR_ROW(bins) + ((labels) ? 2 * (beams) * UUV_SONAR_ROW(bins) : 0))

static inline uuv_sonar_work uuv_sonar_work_(const uuv_sonar *s, float *room, int labels) {
    const int64_t image = (int64_t)s->beams * uuv_sonar_row_(s->bins);
    uuv_sonar_work w = {room, room + image, 0, 0, 0, 0, 0};
    w.cells = w.im + image;
    w.loss = w.cells + 2 * (int64_t)s->fine * (s->bins + 2 * s->pad + 16);
    w.block = w.loss + (int64_t)s->fine * (s->bins + 2 * s->pad + 16);
    if (labels) {
        w.strongest = w.block + 2 * UUV_SONAR_BLOCK * (int64_t)uuv_sonar_row_(s->bins);
        w.label = (uint16_t *)(void *)(w.strongest + image);
    }
    return w;
}

/* Mixes 64 bits (the finalizer of MurmurHash3, A. Appleby). */
static inline uint64_t uuv_mix_(uint64_t h) {
    h = (h ^ (h >> 33)) * 0xff51afd7ed558ccdu;
    h = (h ^ (h >> 33)) * 0xc4ceb9fe1a85ec53u;
    return h ^ (h >> 33);
}

static inline int64_t uuv_floor_(double x) {
    const int64_t i = (int64_t)x;
    return i - (x < (double)i);
}

/* The bits of the cell at p of a cubic grid, whose size is the power of 2 at or below `size`. The grid
 * is shifted by uneven parts of a cell: a flat bottom at a round depth would lie on the border of two
 * cells, where the rounding of each ray chooses one. */
static inline uint64_t uuv_scatterer_(const double p[3], double size) {
    union {
        double x;
        uint64_t bits;
    } u = {size};
    const uint64_t e = u.bits >> 52; /* 1 / size: exponent 2046 - e */
    u.bits = (uint64_t)(2046 - e) << 52;
    uint64_t h = e * 0x9e3779b97f4a7c15u;
    h += (uint64_t)uuv_floor_(p[0] * u.x + 0.3819660112501052) * 0xd1342543de82ef95u;
    h = (h ^ (h >> 29)) + (uint64_t)uuv_floor_(p[1] * u.x + 0.2360679774997897) * 0xaf251af3b0f025b5u;
    h = (h ^ (h >> 31)) + (uint64_t)uuv_floor_(p[2] * u.x + 0.4142135623730951) * 0x9fb21c651e98df25u;
    return uuv_mix_(h);
}

/* Material of what a ray met at p. */
static inline int uuv_sonar_material_(const uuv_sonar *s, const uuv_scene *scene, const uuv_hit *hit,
                                      const double p[3]) {
    if (hit->kind >= UUV_HIT_SOLID) return s->solid[hit->kind - UUV_HIT_SOLID];
    if (!s->seabed) return 0;
    const uuv_terrain *g = &scene->terrain;
    const int i = uuv_within_((p[0] - g->north) / g->spacing + 0.5, 0, g->rows - 1);
    const int j = uuv_within_((p[1] - g->east) / g->spacing + 0.5, 0, g->columns - 1);
    return s->seabed[(int64_t)i * g->columns + j];
}

/* The place of the columns' work in the world, and numbers of the image. */
typedef struct {
    const uuv_scene *scene;
    const uuv_solid *moving;
    int there;
    const double *x;     /* the head of the arguments */
    double per_fine, nearest_edge; /* 1 / m, m */
    double size;         /* length in range of a scatterer, at most [m] */
    int stride, cells;   /* bins of a row of cells, range cells */
    int low, high;       /* bins of the column that have an echo: from low to before high */
} uuv_sounding_;

/* Adds the scatterers of what a way met. Pressures have the coefficient `turned`, unless it is 0. */
static inline void uuv_sonar_echo_(const uuv_sonar *s, uuv_sounding_ *q, int j, const uuv_way *way, const uuv_hit *hit,
                                   double solid, double du, const float *turned, uuv_sonar_work *w) {
    const double turns = q->x[12] * UUV_SONAR_TABLE, c = -uuv_dot_(hit->n, way->d);
    if (!(c > 0.0)) return;
    float *const re = w->cells, *const im = w->cells + (int64_t)s->fine * q->stride;
    /* As if the ray were straight, from a place `from` at the distance `straight`. */
    const double straight = uuv_way_spread_(way), per = s->profile.levels ? q->x[21] / way->c : 1.0;
    const double shift = way->range - per * straight;
    double from[3];
    for (int k = 0; k < 3; k++) from[k] = way->bent ? way->at[k] - straight * way->d[k] : q->x[k];
    /* c along the elevation: over the plane, r c is constant */
    const double slope = -uuv_dot_(hit->n, way->across), half = 0.5 * s->d_theta * (slope < 0.0 ? -slope : slope);
    const double down = c - half > 0.25 * c ? half : 0.75 * c, plane = straight * c;
    const double near = plane / (c + half), far = plane / (c - down);
    const int pieces = 1 + uuv_within_((far - near) / q->size, 0, 1 << 20);
    const double part = (far - near) / pieces;
    const double wide = straight * du, tall = pieces > 1 ? 0.5 * part : straight * s->d_theta;
    const double fold = wide < tall ? wide : tall;
    const double size = fold > 0x1p-14 ? fold : 0x1p-14;
    const double share = pieces > 1 ? solid / (half + down) : 0.0;
    const float *strength = s->strength + uuv_sonar_material_(s, q->scene, hit, way->at) * (UUV_SONAR_ANGLES + 1);
    const double turn = slope != 0.0 ? 1.0 / slope : 0.0;
    double edge = c + half; /* cosine at the near edge of a piece */
    for (int n = 0; n < pieces; n++) {
        const double r = pieces > 1 ? near + (n + 0.5) * part : straight;
        const double ahead = n + 1 < pieces ? plane / (near + (n + 1) * part) : c - down;
        const double mine = pieces > 1 ? (edge - ahead) * share : solid;
        edge = ahead;
        const double shown = shift + per * r;
        const int k = uuv_within_((shown - q->nearest_edge) * q->per_fine, -1, q->cells);
        if (shown < q->nearest_edge || k >= q->cells) continue;
        const double cosine = pieces > 1 ? plane / r : c, angle = (cosine - c) * turn;
        const double at = (cosine < 1.0 ? cosine : 1.0) * UUV_SONAR_ANGLES;
        const int row = at < UUV_SONAR_ANGLES ? (int)at : UUV_SONAR_ANGLES - 1;
        const double mean = strength[row] + (at - row) * (strength[row + 1] - strength[row]);
        double p[3];
        for (int m = 0; m < 3; m++) p[m] = from[m] + r * (way->d[m] + angle * way->across[m]);
        const uint64_t h = uuv_scatterer_(p, size);
        const double a = uuv_root_(mine * mean) / r;
        float amplitude = (float)a * s->amplitudes[h & (UUV_SONAR_TABLE - 1)];
        const int64_t phase = (int64_t)(turns * shown) + (int64_t)(h >> 12 & (UUV_SONAR_TABLE - 1));
        const float *unit = s->turns + 2 * (phase & (UUV_SONAR_TABLE - 1));
        const int bin = k / s->fine, place = (k - bin * s->fine) * q->stride + bin;
        const double path = way->length + (r - straight); /* the water absorbs along the path */
        const int cell = s->profile.levels ? uuv_within_((path - q->nearest_edge) * q->per_fine, 0, q->cells - 1) : k;
        if (cell != k) {
            const int own = cell / s->fine;
            const float here = w->loss[place];
            amplitude = here > 0.0f ? amplitude * (w->loss[(cell - own * s->fine) * q->stride + own] / here) : 0.0f;
        }
        if (turned) {
            re[place] += amplitude * (unit[0] * turned[0] - unit[1] * turned[1]);
            im[place] += amplitude * (unit[0] * turned[1] + unit[1] * turned[0]);
        } else {
            re[place] += amplitude * unit[0];
            im[place] += amplitude * unit[1];
        }
        if (bin < q->low) q->low = bin;
        if (bin >= q->high) q->high = bin + 1;
        if (!w->label || bin < s->pad || bin >= s->pad + s->bins) continue;
        const float size_2 = turned ? turned[0] * turned[0] + turned[1] * turned[1] : 1.0f;
        const float loud = (float)(a * a) * size_2;
        for (int b = s->nearest[2 * j]; b < s->nearest[2 * j + 1]; b++) {
            const int64_t pixel = (int64_t)b * uuv_sonar_row_(s->bins) + bin - s->pad;
            if (!(loud > w->strongest[pixel])) continue;
            w->strongest[pixel] = loud;
            w->label[pixel] = (uint16_t)(hit->kind == UUV_HIT_SEABED ? 1 : hit->kind - UUV_HIT_SOLID + 2);
        }
    }
}

/* The coefficient of what a way met, for both directions of the path; 0 if nothing is reflected. */
static inline int uuv_sonar_bounce_(const uuv_sonar *s, const uuv_scene *scene, const uuv_way *way, const uuv_hit *hit,
                                    float turned[2]) {
    const float *row = hit->kind == UUV_HIT_SURFACE ? s->surface : 0;
    if (hit->kind == UUV_HIT_SEABED && s->bottom)
        row = s->bottom + 2 * uuv_sonar_material_(s, scene, hit, way->at) * (UUV_SONAR_ANGLES + 1);
    const double c = -uuv_dot_(hit->n, way->d);
    if (!row || !(c > 0.0)) return 0;
    const double at = (c < 1.0 ? c : 1.0) * UUV_SONAR_ANGLES;
    const int k = at < UUV_SONAR_ANGLES ? (int)at : UUV_SONAR_ANGLES - 1;
    for (int m = 0; m < 2; m++)
        turned[m] = (float)(row[2 * k + m] + (at - k) * (row[2 * k + 2 + m] - row[2 * k + m]));
    return turned[0] != 0.0f || turned[1] != 0.0f;
}

/* Adds the scatterers of column j to the range cells. */
static inline void uuv_sonar_column_(const uuv_sonar *s, uuv_sounding_ *q, int j, uuv_sonar_work *w) {
    const double *R = q->x + 3, *col = s->column + 3 * j;
    double px[3], pz[3], py[3];
    for (int k = 0; k < 3; k++) {
        px[k] = R[3 * k] * col[1];
        py[k] = R[3 * k + 1] * col[0];
        pz[k] = R[3 * k + 2] * col[1];
    }
    for (int i = 0; i < s->rays; i++) {
        const double ct = s->ray[3 * i], st = s->ray[3 * i + 1], solid = s->ray[3 * i + 2] * col[2];
        uuv_way way = {.growth = 1.0, .c = 1.0, .c_0 = s->profile.levels ? 0.0 : 1.0};
        for (int k = 0; k < 3; k++) {
            way.at[k] = q->x[k];
            way.d[k] = py[k] + ct * px[k] + st * pz[k];
            way.across[k] = ct * pz[k] - st * px[k];
        }
        float turned[2];
        uuv_hit hit;
        for (int leg = 0; leg < 2; leg++) {
            uuv_way_follow_(q->scene, q->moving, q->there, &s->profile, s->farthest, q->x[21], &way, &hit);
            if (hit.kind == UUV_HIT_SEABED || hit.kind >= UUV_HIT_SOLID)
                uuv_sonar_echo_(s, q, j, &way, &hit, solid, col[2], leg ? turned : 0, w);
            if (leg || !uuv_sonar_bounce_(s, q->scene, &way, &hit, turned)) break;
            uuv_way_bounce_(&way, hit.n);
        }
    }
}

/* Passes the range cells through the matched filter to a column of the block, and clears them. */
static inline void uuv_sonar_filter_(const uuv_sonar *s, const uuv_sounding_ *q, float *cells, const float *loss,
                                     float *out) {
    const int row = uuv_sonar_row_(s->bins), taps = 2 * s->pad + 1;
    const int ahead = q->low - 2 * s->pad, first = ahead < 0 ? 0 : ahead < row ? ahead : row;
    for (int part = 0; part < 2; part++, cells += (int64_t)s->fine * q->stride, out += row) {
        for (int k = 0; k < s->fine; k++)
            for (int i = q->low; i < q->high; i++) cells[k * q->stride + i] *= loss[k * q->stride + i];
        for (int i = 0; i < first; i++) out[i] = 0.0f;
        for (int base = first / UUV_SONAR_WIDE * UUV_SONAR_WIDE; base < row; base += UUV_SONAR_WIDE) {
            uuv_bins_ sum = {0};
            if (base < q->high)
                for (int k = 0; k < s->fine; k++)
                    for (int t = 0; t < taps; t++)
                        sum += s->pulse[t * s->fine + k] * *(const uuv_bins_read_ *)(cells + k * q->stride + base + t);
            *(uuv_bins_read_ *)(out + base) = sum;
        }
        for (int k = 0; k < s->fine; k++)
            for (int i = q->low; i < q->high; i++) cells[k * q->stride + i] = 0.0f;
    }
}

/* Adds a block of columns from `from` on to the beams, in the order of the columns. */
static inline void uuv_sonar_beams_(const uuv_sonar *s, int from, int n, int low, int high, const float *block,
                                    uuv_sonar_work *w) {
    const int row = uuv_sonar_row_(s->bins), even = (s->beams + 1) / 2 * 2;
    low = low / UUV_SONAR_WIDE * UUV_SONAR_WIDE;
    for (int b = 0; b < s->beams; b += 2) {
        const int two = b + 1 < s->beams;
        int begin = s->window[2 * b], end = s->window[2 * b + 1];
        if (two && s->window[2 * b + 2] < begin) begin = s->window[2 * b + 2];
        if (two && s->window[2 * b + 3] > end) end = s->window[2 * b + 3];
        begin = begin > from ? begin - from : 0;
        end = end < from + n ? end - from : n;
        if (begin >= end) continue;
        for (int part = 0; part < 2; part++) {
            float *const one = (part ? w->im : w->re) + (int64_t)b * row, *const other = one + (two ? row : 0);
            for (int i = low; i < high; i += UUV_SONAR_WIDE) {
                uuv_bins_ p = *(const uuv_bins_read_ *)(one + i), r = *(const uuv_bins_read_ *)(other + i);
                for (int j = begin; j < end; j++) {
                    const uuv_bins_ echo = *(const uuv_bins_read_ *)(block + (int64_t)(2 * j + part) * row + i);
                    const float *weight = s->weight + (int64_t)(from + j) * even + b;
                    p += weight[0] * echo;
                    r += weight[1] * echo;
                }
                *(uuv_bins_read_ *)(one + i) = p;
                if (two) *(uuv_bins_read_ *)(other + i) = r;
            }
        }
    }
}

/* Pressures of all beams and bins.
 * x: origin (3), rotation from sensor axes row by row (9), turns of phase a metre of range (2 f / c),
 * pressure that is left at the first range cell [Pa m] and its factor a cell, noise [Pa], gain at
 * bin 0 and its factor a bin, least ratio of an echo to the noise, two draws, the speed of sound that the
 * instrument assumes; the moving. */
static inline void uuv_sonar_echoes(const uuv_scene *scene, const uuv_sonar *s, const double *x, uuv_sonar_work *w) {
    uuv_solid moving[UUV_MOVERS];
    const int row = uuv_sonar_row_(s->bins);
    uuv_sounding_ q = {scene, moving, uuv_movers_(x + UUV_SONAR_HEAD, s->n_moving, moving), x, 0.0, 0.0, 0.0, 0, 0, 0, 0};
    q.stride = s->bins + 2 * s->pad + 16;
    q.cells = s->fine * (s->bins + 2 * s->pad);
    q.per_fine = s->fine / s->step;
    q.nearest_edge = s->first - s->pad * s->step;
    q.size = 2.0 / q.per_fine;
    for (int64_t i = 0; i < (int64_t)s->beams * row; i++) w->re[i] = w->im[i] = 0.0f;
    if (w->label)
        for (int64_t i = 0; i < (int64_t)s->beams * row; i++) w->strongest[i] = 0.0f, w->label[i] = 0;
    for (int64_t i = 0; i < 2 * (int64_t)s->fine * q.stride; i++) w->cells[i] = 0.0f;
    double left = x[13];
    for (int i = 0; i < q.stride; i++)
        for (int k = 0; k < s->fine; k++, left *= x[14]) w->loss[k * q.stride + i] = (float)left;
    if (x[2] < 0.0) return; /* above the water */
    for (int from = 0; from < s->columns; from += UUV_SONAR_BLOCK) {
        const int n = from + UUV_SONAR_BLOCK < s->columns ? UUV_SONAR_BLOCK : s->columns - from;
        int low = row, high = 0;
        for (int j = 0; j < n; j++) {
            q.low = q.stride;
            q.high = 0;
            uuv_sonar_column_(s, &q, from + j, w);
            uuv_sonar_filter_(s, &q, w->cells, w->loss, w->block + (int64_t)2 * j * row);
            if (q.low >= q.high) continue;
            if (q.low - 2 * s->pad < low) low = q.low - 2 * s->pad > 0 ? q.low - 2 * s->pad : 0;
            if (q.high > high) high = q.high < row ? q.high : row;
        }
        if (low < high) uuv_sonar_beams_(s, from, n, low, high, w->block, w);
    }
}

/* Adds the receiver's noise and applies the gain. `seen`: magnitudes [beams][bins]; the range of each
 * beam's strongest echo, 0 where it has none above the noise, and its magnitude [beams] each; mean and
 * greatest of the magnitudes. */
static inline void uuv_sonar_receive(const uuv_sonar *s, const double *x, uuv_sonar_work *w, float *seen) {
    const int row = uuv_sonar_row_(s->bins);
    union {
        float x[2];
        uint64_t bits;
    } key = {{(float)x[19], (float)x[20]}};
    const uint64_t draw = uuv_mix_(key.bits);
    float *const range = seen + (int64_t)s->beams * s->bins, *const echo = range + s->beams;
    float peak = 0.0f;
    double total = 0.0;
    const float noise = (float)x[15], least = (float)(x[15] * x[18]);
    for (int b = 0; b < s->beams; b++) {
        float *re = w->re + (int64_t)b * row, *im = w->im + (int64_t)b * row, loudest = 0.0f;
        double gain = x[16];
        range[b] = echo[b] = 0.0f;
        for (int i = 0; i < s->bins; i++, gain *= x[17]) {
            const uint64_t h = uuv_mix_(draw + (uint64_t)((int64_t)b * s->bins + i) * 0x9e3779b97f4a7c15u);
            const float a = noise * s->amplitudes[h & (UUV_SONAR_TABLE - 1)];
            const float *unit = s->turns + 2 * (h >> 12 & (UUV_SONAR_TABLE - 1));
            const double r = s->first + (i + 0.5) * s->step;
            double spread = s->tvg & 1 ? uuv_root_(r) : 1.0;
            for (int n = 0; n < s->tvg / 2; n++) spread *= r;
            const float up = (float)(gain * spread);
            re[i] = re[i] + a * unit[0];
            im[i] = im[i] + a * unit[1];
            const double power = (double)re[i] * re[i] + (double)im[i] * im[i];
            const float p = (float)uuv_root_(power);
            re[i] *= up;
            im[i] *= up;
            const float shown = p * up;
            seen[(int64_t)b * s->bins + i] = shown;
            total += shown;
            if (shown > peak) peak = shown;
            if (p > least && shown > loudest) {
                loudest = echo[b] = shown;
                range[b] = (float)r;
            }
        }
    }
    echo[s->beams] = (float)(total / ((int64_t)s->beams * s->bins));
    echo[s->beams + 1] = peak;
}

#endif
