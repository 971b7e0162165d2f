/* Frames of a film of a run: uuvsim_cosim/view/film/renderer.py.
 *
 * The water is that of uuv_camera.h. The veiling light of a ray is integrated over its depths, which that camera takes
 * as constant: with daylight E0 e^(-K D) and the unit vector d, from the depth D on and up to the distance z,
 *
 *     L = V E0 e^(-K D) B / (B + K d_D) (1 - e^(-(B + K d_D) z)),   B = beta_B.
 *
 * So water is brighter above than below. Half of the daylight on a surface is that of a uniform sky, half comes from a
 * sun beside the vertical, which throws the shadows of vehicles. Ripples and caustics are invented patterns.
 */
#include "uuv_camera.h"

#if defined(_WIN32)
#define FILM_API __declspec(dllexport)
#else
#define FILM_API __attribute__((visibility("default")))
#endif

enum { FILM_NOTHING = 0, FILM_SEABED, FILM_SURFACE, FILM_SOLID, FILM_HULL };

typedef struct {
    const uuv_scene *hull; /* triangles in body axes */
    double at[3];          /* N E D of CO */
    double R[9];           /* from b to n, row by row */
    double rho[3];         /* reflectance */
    double bound;          /* radius around CO that holds the hull */
} film_body;

typedef struct {
    int rows, columns, n_bodies, pad;
    const double *solid;                             /* reflectance of each solid and mesh (3 each) */
    double eye[3], R[9], focal_length, farthest;
    double beta_D[3], beta_B[3], K[3], sun[3], V[3]; /* of the water; V = 0: without a veil */
    double background[3];                            /* radiance where nothing is met and V is 0 */
    double seabed[3];
    double contrast, texture_size, caustics, time;
    double sunward[3];                               /* unit vector to the sun, in the water */
    uint64_t seed;
} film_view;

/* The nearest hit of a ray with a body, in n; whether it is nearer than `hit`. */
static int film_cast_body_(const film_body *b, const double o[3], const double d[3], uuv_hit *hit) {
    const double from[3] = {o[0] - b->at[0], o[1] - b->at[1], o[2] - b->at[2]};
    const double along = -uuv_dot_(from, d), square = uuv_dot_(from, from) - along * along;
    if (square > b->bound * b->bound || along + b->bound < 0.0 || along - b->bound > hit->t) return 0;
    double p[3], a[3];
    for (int k = 0; k < 3; k++) {
        p[k] = b->R[k] * from[0] + b->R[3 + k] * from[1] + b->R[6 + k] * from[2];
        a[k] = b->R[k] * d[0] + b->R[3 + k] * d[1] + b->R[6 + k] * d[2];
    }
    uuv_hit own = {hit->t, {0.0, 0.0, 0.0}, UUV_HIT_NONE};
    uuv_cast_tree_(b->hull, p, a, &own);
    if (own.kind < UUV_HIT_SOLID) return 0;
    hit->t = own.t;
    for (int k = 0; k < 3; k++) hit->n[k] = uuv_dot_(b->R + 3 * k, own.n);
    return 1;
}

static double film_texture_(const film_view *v, const double p[3], double footprint) {
    double sum = 0.0, size = v->texture_size, weight = 0.5;
    for (int n = 0; n < UUV_CAMERA_OCTAVES; n++, size *= 0.5, weight *= 0.5) {
        const double clear = size / footprint - 1.0;
        if (!(clear > 0.0)) break;
        const double per = 1.0 / size;
        sum += weight * (clear < 1.0 ? clear : 1.0) *
               uuv_noise_(v->seed + (uint64_t)n, p[0] * per, p[1] * per, p[2] * per);
    }
    return sum;
}

/* A net of bright lines of mean about 0, which the waves would focus on the ground. */
static double film_caustics_(const film_view *v, const double p[3]) {
    double light = 1.0;
    for (int n = 0; n < 2; n++) {
        const double x = p[0] / 0.7 + 0.37 * n * v->time, y = p[1] / 0.7 - 0.29 * n * v->time;
        double ridge = uuv_noise_(v->seed + 77u + (uint64_t)n, x, y, 0.8 * v->time);
        ridge = 1.0 - 1.6 * (ridge < 0.0 ? -ridge : ridge);
        light *= ridge > 0.0 ? ridge : 0.0;
    }
    return 2.6 * light * light - 0.55;
}

/* Veiling light of a ray from the depth `from` along d, up to the distance z. */
static uuv_colour_ film_veil_(const film_view *v, double from, double down, double z) {
    const uuv_colour_ B = uuv_colour_of_(v->beta_B), K = uuv_colour_of_(v->K);
    uuv_colour_ rate = B + K * down;
    for (int c = 0; c < 4; c++) rate[c] = rate[c] > 1e-9 ? rate[c] : 1e-9;
    return uuv_colour_of_(v->V) * uuv_colour_of_(v->sun) * uuv_decay_(K * (from > 0.0 ? from : 0.0)) * B / rate *
           (1.0 - uuv_decay_(rate * z));
}

static uuv_colour_ film_ray_(const uuv_scene *scene, const film_body *bodies, const film_view *v, const double d[3],
                             float *distance, unsigned char *kind, double *deep) {
    uuv_hit hit = {0.0, {0.0, 0.0, 0.0}, UUV_HIT_NONE};
    const double *o = v->eye;
    uuv_cast(scene, 0, 0, o, d, v->farthest, &hit);
    int met = hit.kind == UUV_HIT_SEABED   ? FILM_SEABED
              : hit.kind == UUV_HIT_SURFACE ? FILM_SURFACE
              : hit.kind >= UUV_HIT_SOLID   ? FILM_SOLID
                                            : FILM_NOTHING;
    const double *rho = met == FILM_SOLID ? v->solid + 3 * (hit.kind - UUV_HIT_SOLID) : v->seabed;
    int owner = -1;
    for (int i = 0; i < v->n_bodies; i++)
        if (film_cast_body_(bodies + i, o, d, &hit)) owner = i;
    if (owner >= 0) rho = bodies[owner].rho, met = FILM_HULL;
    const double z = met ? hit.t : v->farthest;
    const uuv_colour_ direct = uuv_decay_(uuv_colour_of_(v->beta_D) * z), sun = uuv_colour_of_(v->sun);
    double p[3];
    for (int k = 0; k < 3; k++) p[k] = o[k] + z * d[k];
    *distance = met ? (float)z : 0.0f;
    *kind = (unsigned char)met;
    *deep = p[2];
    uuv_colour_ light = uuv_grey_(0.0);
    if (met == FILM_SURFACE) {
        const double ripple = 0.12 * uuv_noise_(v->seed + 99u, 0.6 * p[0] + 0.5 * v->time, 0.6 * p[1], 0.4 * v->time);
        const double up = -d[2] + ripple, outside = (1.0 - up * up) * 1.34 * 1.34;
        light = outside < 1.0 ? sun * 0x1.45f306dc9c883p-2 : film_veil_(v, 0.0, -d[2], v->farthest);
    } else if (met) {
        const double into = -uuv_dot_(hit.n, d), under = p[2] > 0.0 ? p[2] : 0.0;
        double open = uuv_dot_(hit.n, v->sunward);
        if (open > 0.0) {
            uuv_hit shadow = {v->farthest, {0.0, 0.0, 0.0}, UUV_HIT_NONE};
            double above[3];
            for (int k = 0; k < 3; k++) above[k] = p[k] + 1e-3 * hit.n[k];
            for (int i = 0; i < v->n_bodies; i++)
                if (film_cast_body_(bodies + i, above, v->sunward, &shadow)) open = 0.0;
        } else {
            open = 0.0;
        }
        if (v->caustics > 0.0 && open > 0.0)
            open *= 1.0 + v->caustics * film_caustics_(v, p) * uuv_decay_(uuv_grey_(under / 12.0))[0];
        double shade = 1.0;
        if (owner < 0 && v->contrast > 0.0)
            shade += v->contrast * film_texture_(v, p, z / (v->focal_length * (into > 0.1 ? into : 0.1)));
        light = (0x1.45f306dc9c883p-2 * shade * (0.25 * (1.0 - hit.n[2]) + 0.5 * open)) * uuv_colour_of_(rho) * sun *
                uuv_decay_(uuv_colour_of_(v->K) * under);
    }
    light *= direct;
    const uuv_colour_ veil = film_veil_(v, o[2], d[2], z);
    return met ? light + veil : veil + uuv_colour_of_(v->background);
}

/* Rows `first` to `last` of a frame. light: [rows][columns][3] W/(m2 sr); distance [m], 0: nothing; kind; deep: depth
 * of the place that is seen [m]. */
FILM_API void uuv_film_rows(const uuv_scene *scene, const film_body *bodies, const film_view *v, int first, int last,
                            float *light, float *distance, unsigned char *kind, float *deep) {
    for (int i = first; i < last; i++)
        for (int j = 0; j < v->columns; j++) {
            const int64_t pixel = (int64_t)i * v->columns + j;
            double a[3] = {(j + 0.5 - 0.5 * v->columns) / v->focal_length,
                           (i + 0.5 - 0.5 * v->rows) / v->focal_length, 1.0};
            const double per = 1.0 / uuv_root_(uuv_dot_(a, a));
            for (int k = 0; k < 3; k++) a[k] *= per;
            const double d[3] = {uuv_dot_(v->R, a), uuv_dot_(v->R + 3, a), uuv_dot_(v->R + 6, a)};
            double z;
            const uuv_colour_ seen = film_ray_(scene, bodies, v, d, distance + pixel, kind + pixel, &z);
            for (int c = 0; c < 3; c++) light[3 * pixel + c] = (float)seen[c];
            deep[pixel] = (float)z;
        }
}
