/* Which component a thread is calling: a frame for each call of foreign code, innermost first. */
#ifndef UUV_GUARD_H
#define UUV_GUARD_H

/* The texts must live as long as the frame is entered; `verb` and `noun` make the function's name,
 * such as "fmi3Set" and "Float64". */
typedef struct uuv_frame {
    const char *component, *verb, *noun;
    struct uuv_frame *outer;
} uuv_frame;

typedef void uuv_frame_function(uuv_frame *frame);

static inline void uuv_calling(uuv_frame *frame, const char *component, const char *verb, const char *noun) {
    frame->component = component;
    frame->verb = verb;
    frame->noun = noun;
}

#endif
