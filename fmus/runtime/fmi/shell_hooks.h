/* What a component does beside its equations if it is a whole system, or stands for a distant one.
 *
 * With -DUUV_WHOLE its runtime (fmus/whole) provides these functions; without, they are nothing.
 */
#ifndef SHELL_HOOKS_H
#define SHELL_HOOKS_H

#include "uuv_component.h"

#ifdef UUV_WHOLE

/* Why the instance failed, in words; NULL while it has not. */
const char *uuv_failure(const uuv_instance *s);
/* Why no step from t by h [s] is made, which changes nothing; NULL if it can be made. */
const char *uuv_step_refused(uuv_instance *s, double t, double h);
void uuv_terminate(uuv_instance *s);
/* Text parameters: their references follow the block's. NULL, and 0: it is unknown. */
const char *uuv_text(const uuv_instance *s, uint32_t vr);
int uuv_set_text(uuv_instance *s, uint32_t vr, const char *value);

/* It steps by itself: there is no Model Exchange. */
#define uuv_update_derivatives(s) ((void)(s))
#define uuv_take_samples(s, t) ((void)(s), (void)(t))
#define uuv_next_sample(s) ((void)(s), __builtin_inf())
enum { UUV_EXCHANGES = 0 };

#else

enum { UUV_EXCHANGES = 1 };

static inline const char *uuv_failure(const uuv_instance *s) { return (void)s, NULL; }
static inline const char *uuv_step_refused(uuv_instance *s, double t, double h) {
    return (void)s, (void)t, (void)h, NULL;
}
static inline void uuv_terminate(uuv_instance *s) { (void)s; }

#endif
#endif
