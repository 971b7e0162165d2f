/* A ball that bounces, for Model Exchange: dh/dt = v, dv/dt = u - g, and v <- -e v at the ground;
 * a kick dv = kick at t = t_kick (a time event). y = h + u. It watches its mode: what Event Mode
 * only allows is refused elsewhere, and it ends the simulation at t >= t_end. */
#ifndef BALL_H
#define BALL_H

#include <math.h>
#include <string.h>

enum { H, SPEED, U, G, E, KICK, T_KICK, T_END, Y, BOUNCES, N_VALUES };
enum mode { INSTANTIATED, INITIALIZING, EVENT, CONTINUOUS };

typedef struct {
    double x[N_VALUES], t;
    int kicked, rests;
    int again; /* FMI 1.0: the last round of event iteration wants another */
    enum mode mode;
} ball;

static void ball_start(ball *b) {
    memset(b, 0, sizeof *b);
    b->x[H] = 1.0;
    b->x[G] = 9.81;
    b->x[E] = 0.7;
    b->x[T_KICK] = b->x[T_END] = 1e9;
}

static int ball_may_set(const ball *b, unsigned r) {
    return r < Y && (b->mode != CONTINUOUS || r == U);
}

static double ball_get(const ball *b, unsigned r) { return r == Y ? b->x[H] + b->x[U] : b->x[r]; }

static void ball_derivatives(const ball *b, double dx[]) {
    dx[0] = b->rests ? 0.0 : b->x[SPEED];
    dx[1] = b->rests ? 0.0 : b->x[U] - b->x[G];
}

static double ball_indicator(const ball *b) { return b->rests ? 1.0 : b->x[H] + 1e-12 * (b->x[SPEED] > 0); }

/* One round of event iteration; gives whether another is needed. */
static int ball_event(ball *b) {
    if (!b->kicked && b->t >= b->x[T_KICK]) {
        b->kicked = 1;
        b->x[SPEED] += b->x[KICK];
        return 1;
    }
    if (!b->rests && b->x[H] <= 0.0 && b->x[SPEED] < 0.0) {
        b->x[H] = 0.0;
        b->x[SPEED] *= -b->x[E];
        b->x[BOUNCES] += 1.0;
        b->rests = b->x[SPEED] < 1e-3;
        if (b->rests) b->x[SPEED] = 0.0;
        return 1;
    }
    return 0;
}

static double ball_next(const ball *b) { return b->kicked ? 1e9 : b->x[T_KICK]; }
static int ball_ends(const ball *b) { return b->t >= b->x[T_END]; }

#endif
