/* Images of a sonar for arrays that the caller owns: uuvsim_cosim/scene/shared/sonar.py. */
#include "uuv_sonar.h"

#if defined(_WIN32)
#define SONAR_API __declspec(dllexport)
#else
#define SONAR_API __attribute__((visibility("default")))
#endif

/* Floats that an image works in. */
SONAR_API int64_t uuv_sonar_room(const uuv_sonar *s, int labels) {
    return UUV_SONAR_ROOM((int64_t)s->beams, s->bins, s->fine, s->pad, labels);
}

/* n images of arguments x, n_x each. Of each: magnitudes [beams][bins], ranges and echoes [beams], mean and peak in
 * `seen`; unless they are 0, both parts of the pressure [2][beams][bins], and labels. */
SONAR_API void uuv_sonar_batch(const uuv_scene *scene, const uuv_sonar *s, const double *x, int64_t n_x, int64_t n,
                               float *room, float *seen, float *parts, uint16_t *labels) {
    const int64_t pixels = (int64_t)s->beams * s->bins, row = uuv_sonar_row_(s->bins);
    uuv_sonar_work w = uuv_sonar_work_(s, room, labels != 0);
    for (int64_t k = 0; k < n; k++) {
        uuv_sonar_echoes(scene, s, x + k * n_x, &w);
        uuv_sonar_receive(s, x + k * n_x, &w, seen + k * (pixels + 2 * s->beams + 2));
        for (int64_t b = 0; b < s->beams; b++)
            for (int64_t i = 0; i < s->bins; i++) {
                const int64_t from = b * row + i, to = b * s->bins + i;
                if (parts) {
                    parts[2 * k * pixels + to] = w.re[from];
                    parts[(2 * k + 1) * pixels + to] = w.im[from];
                }
                if (labels) labels[k * pixels + to] = w.label[from];
            }
    }
}

/* Where n ways end. x: place (3) and direction (3) of each; y: of each place (3), direction (3), length, range, spread,
 * and the kind of what was met. */
SONAR_API void uuv_sonar_ways(const uuv_scene *scene, const uuv_sonar *s, double ref, int legs, const double *x,
                              int64_t n, double *y) {
    for (int64_t i = 0; i < n; i++, x += 6, y += 10) {
        uuv_way way = {.growth = 1.0, .c = 1.0, .c_0 = s->profile.levels ? 0.0 : 1.0};
        uuv_hit hit = {0};
        float turned[2];
        for (int k = 0; k < 3; k++) way.at[k] = x[k], way.d[k] = x[3 + k];
        for (int leg = 0; leg < legs; leg++) {
            if (leg && !uuv_sonar_bounce_(s, scene, &way, &hit, turned)) break;
            if (leg) uuv_way_bounce_(&way, hit.n);
            uuv_way_follow_(scene, 0, 0, &s->profile, s->farthest, ref, &way, &hit);
        }
        for (int k = 0; k < 3; k++) y[k] = way.at[k], y[3 + k] = way.d[k];
        y[6] = way.length;
        y[7] = way.range;
        y[8] = uuv_way_spread_(&way);
        y[9] = hit.kind;
    }
}
