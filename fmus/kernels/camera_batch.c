/* Images of a camera for arrays that the caller owns: uuvsim_cosim/scene/shared/camera.py. */
#include "uuv_camera.h"

#if defined(_WIN32)
#define CAMERA_API __declspec(dllexport)
#else
#define CAMERA_API __attribute__((visibility("default")))
#endif

/* n images of arguments x, n_x each. Of each: grey levels [rows][columns][3]; unless they are 0, radiance
 * and normals [rows][columns][3], depths and labels [rows][columns]. `room`: floats of one image. */
CAMERA_API void uuv_camera_batch(const uuv_scene *scene, const uuv_camera *cam, const double *x, int64_t n_x, int64_t n,
                                 float *room, unsigned char *seen, double *radiance, float *depth, uint16_t *label,
                                 float *normal) {
    const int64_t pixels = (int64_t)cam->rows * cam->columns;
    double summary[3];
    for (int64_t k = 0; k < n; k++) {
        uuv_camera_image(scene, cam, x + k * n_x, room, radiance ? radiance + 3 * k * pixels : 0,
                         depth ? depth + k * pixels : 0, label ? label + k * pixels : 0, normal ? normal + 3 * k * pixels : 0,
                         summary);
        for (int64_t i = 0; i < 3 * pixels; i++) seen[3 * k * pixels + i] = (unsigned char)room[i];
    }
}
