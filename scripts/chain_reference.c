// The CPU benchmark's reference: the same work as warpchain's CPU kernel, by hand in plain C (IEEE float64, leapfrog):
// links, friction of joints, teeth and guides, straight and curved guides on the ground and on arms, tensioners on oil.
// A roller keeps its seat, or its piece of a guide, while it is near; directions of seats come from a table turned by
// one cosine and sine a sprocket a step. The physics of one roller stands in chain_reference.h.
//   cc -O3 -march=native -o chain_reference chain_reference.c -lm && ./chain_reference IN OUT STEPS
// IN holds doubles as written by benches/reference.py; OUT gets the final x, y, vx, vy. Prints the time loop's seconds of CPU time.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "chain_reference.h"

typedef struct { int roller; Gap gap; } Touch;

static int n;
static double *x, *y, *vx, *vy, *fx, *fy, *lx, *ly, *tension, *turn, *bend_x, *bend_y, *moment, *joint_hold;
static Touch *touches;  // of the partner at hand
static int touching;
static double inverse_mass;
static Vector gravity;

// Forces of all that touch the partner at hand; the moment of all on its body.
static double press(const Motion *at, const Law *law, const Sliding *sliding, double *restrict first, double *restrict hold,
                    double *restrict damper_speed) {
    const Motion m = *at;
    double sum = 0.0;
    for (const Touch *q = touches; q < touches + touching; q++) {
        int i = q->roller;
        Roller r = {{x[i], y[i]}, {vx[i], vy[i]}, {inverse_mass * (lx[i + 1] - lx[i] + fx[i]) + gravity.x,
                                                   inverse_mass * (ly[i + 1] - ly[i] + fy[i]) + gravity.y}};
        Push push = contact_push(law, sliding, &m, &r, q->gap, &first[i], &hold[i], &damper_speed[i]);
        fx[i] += push.x, fy[i] += push.y;
        sum += push.moment;
    }
    return sum;
}

static void touch(int i, Gap gap) {
    Touch q = {i, gap};
    touches[touching++] = q;
}

static void touch_teeth(const Sprocket *s, const Motion *at, const Vector *restrict seats, int *restrict seat,
                        double *restrict first) {
    const Motion m = *at;
    for (int i = 0; i < n; i++) {
        Vector place = {x[i], y[i]};
        if (!is_near(s, &m, place)) {
            if (seat[i] >= 0) seat[i] = -1, first[i] = 0.0;
            continue;
        }
        Gap gap = tooth_gap(s, &m, seats, place, &seat[i]);
        if (gap.penetration > -s->law.ahead) touch(i, gap);
        else first[i] = 0.0;
    }
}

static void touch_bar(const Guide *g, const Motion *at, double *restrict first) {
    const Motion m = *at;
    Vector start = turned(g->start, m.heading), direction = turned(g->direction, m.heading);
    start.x += m.center.x, start.y += m.center.y;
    for (int i = 0; i < n; i++) {
        Vector place = {x[i], y[i]};
        Gap gap = bar_gap(g, start, direction, place, &first[i]);
        if (gap.penetration > -g->law.ahead) touch(i, gap);
    }
}

static void touch_profile(const Guide *g, const Piece *piece, const Motion *at, int *restrict kept,
                          double *restrict first) {
    const Motion m = *at;
    for (int i = 0; i < n; i++) {
        Vector place = {x[i], y[i]};
        Gap gap = profile_gap(g, piece, &m, place, &kept[i], &first[i]);
        if (gap.penetration > -g->law.ahead) touch(i, gap);
    }
}

static void link_pass(double k, double c, double p, const double *restrict x, const double *restrict y, const double *restrict vx,
                      const double *restrict vy, double *restrict tension, double *restrict lx, double *restrict ly,
                      double *restrict fx, double *restrict fy) {
    for (int i = 0; i < n; i++) {
        double dx = x[i + 1] - x[i], dy = y[i + 1] - y[i], wx = vx[i + 1] - vx[i], wy = vy[i + 1] - vy[i];
        double square = dx * dx + dy * dy, inverse = 1.0 / sqrt(square), ux = dx * inverse, uy = dy * inverse;
        tension[i] = k * (square * inverse - p) + c * (wx * ux + wy * uy);
        lx[i + 1] = tension[i] * ux, ly[i + 1] = tension[i] * uy;
        fx[i] = fy[i] = 0.0;
    }
}

static void turn_pass(const double *restrict x, const double *restrict y, const double *restrict vx, const double *restrict vy,
                      double *restrict turn, double *restrict bend_x, double *restrict bend_y) {
    for (int i = 0; i < n; i++) {
        double dx = x[i + 1] - x[i], dy = y[i + 1] - y[i], inverse = 1.0 / (dx * dx + dy * dy);
        bend_x[i] = -dy * inverse, bend_y[i] = dx * inverse;
        turn[i] = bend_x[i] * (vx[i + 1] - vx[i]) + bend_y[i] * (vy[i + 1] - vy[i]);
    }
}

static void joint_pass(const Joint *j, double *restrict tension, double *restrict turn, const double *restrict bend_x,
                       const double *restrict bend_y, double *restrict moment, double *restrict hold, double *restrict lx,
                       double *restrict ly) {
    tension[n] = tension[0], turn[n] = turn[0];
    for (int i = 0; i < n; i++) {
        double slip = turn[i + 1] - turn[i], before = fabs(tension[i]), after = fabs(tension[i + 1]);
        double most = MAX(before, after) * coefficient(fabs(slip) * j->pin_radius, &j->law) * j->arm;
        moment[i + 1] = -held_back(most, slip, &hold[i + 1], j->spring, j->damper);
    }
    moment[0] = moment[n];
    for (int i = 0; i < n; i++) {
        lx[i + 1] += (moment[i + 1] - moment[i]) * bend_x[i];
        ly[i + 1] += (moment[i + 1] - moment[i]) * bend_y[i];
    }
}

static void kick_drift(double kick, double h, const double *restrict lx, const double *restrict ly, const double *restrict fx,
                       const double *restrict fy, double *restrict x, double *restrict y, double *restrict vx, double *restrict vy) {
    for (int i = 0; i < n; i++) {
        vx[i] += kick * (inverse_mass * (lx[i + 1] - lx[i] + fx[i]) + gravity.x);
        vy[i] += kick * (inverse_mass * (ly[i + 1] - ly[i] + fy[i]) + gravity.y);
        x[i] += h * vx[i], y[i] += h * vy[i];
    }
}

static Head head;
static Body *body;
static Sprocket *sprocket;
static Guide *guide;
static Piece *piece;
static Arm *arm;
static Tensioner *tensioner;
static Vector *seats[64];
static double *first, *hold, *damper_speed;
static int *seat;
static size_t row;

static Point heading_of(const Body *b) {
    Point heading = {cos(b->angle), sin(b->angle)};
    return heading;
}

// Forces of all contacts; adds their moments to those on bodies.
static void contact_pass(const Motion *motion, double *on) {
    int S = (int)head.sprockets, B = S + (int)head.arms;
    for (int s = 0; s < S; s++) {
        size_t r = s * row;
        touching = 0;
        touch_teeth(&sprocket[s], &motion[s], seats[s], seat + r, first + r);
        on[s] += press(&motion[s], &sprocket[s].law, &sprocket[s].sliding, first + r, hold + r, damper_speed + r);
    }
    for (int g = 0; g < (int)head.guides; g++) {
        const Guide *q = &guide[g];
        int b = q->body < 0.0 ? B : (int)q->body;  // the last is the ground
        size_t r = (S + g) * row;
        touching = 0;
        if (q->pieces > 0.0) touch_profile(q, piece + (int)q->first_piece, &motion[b], seat + r, first + r);
        else touch_bar(q, &motion[b], first + r);
        on[b] += press(&motion[b], &q->law, &q->sliding, first + r, hold + r, damper_speed + r);
    }
}

static void step(int it) {
    int S = (int)head.sprockets, B = S + (int)head.arms, T = (int)head.tensioners;
    double h = head.step, t = it * h, kick = it ? h : 0.5 * h, on[64];  // moments
    Motion motion[64];
    for (int b = 0; b < B; b++) {
        const Body *q = &body[b];
        Point heading = heading_of(q);
        motion[b] = (Motion){{q->x, q->y}, {heading.x, heading.y}, q->omega, q->angular};
        on[b] = q->prescribed ? 0.0 : b < S ? load_moment(q, t) : arm_moment(&arm[b - S], q, heading);
        for (int k = 0; k < T; k++)
            if ((int)tensioner[k].body == b) on[b] += push_moment(&tensioner[k], q, heading);
    }
    motion[B] = (Motion){{0.0, 0.0}, {1.0, 0.0}, 0.0, 0.0}, on[B] = 0.0;
    x[n] = x[0], y[n] = y[0], vx[n] = vx[0], vy[n] = vy[0];
    link_pass(head.stiffness, head.damping, head.length, x, y, vx, vy, tension, lx, ly, fx, fy);
    if (head.joint.rubs != 0.0) {
        turn_pass(x, y, vx, vy, turn, bend_x, bend_y);
        joint_pass(&head.joint, tension, turn, bend_x, bend_y, moment, joint_hold, lx, ly);
    }
    lx[0] = lx[n], ly[0] = ly[n];
    contact_pass(motion, on);
    for (int b = 0; b < B; b++) move_body(&body[b], on[b], t, kick, h);
    for (int k = 0; k < T; k++) {
        const Body *q = &body[(int)tensioner[k].body];
        flow(&tensioner[k], q, heading_of(q), h);
    }
    kick_drift(kick, h, lx, ly, fx, fy, x, y, vx, vy);
}

static void *read_all(FILE *in, size_t size, double count) {
    void *to = calloc((size_t)count + 1, size);
    if (fread(to, size, (size_t)count, in) != (size_t)count) fprintf(stderr, "short input\n"), exit(2);
    return to;
}

int main(int argc, char **argv) {
    if (argc != 4) return fprintf(stderr, "usage: chain_reference IN OUT STEPS\n"), 2;
    FILE *in = fopen(argv[1], "rb");
    if (!in || fread(&head, sizeof head, 1, in) != 1) return fprintf(stderr, "cannot read %s\n", argv[1]), 2;
    n = (int)head.rollers, row = n + 64;
    int P = (int)(head.sprockets + head.guides), steps = atoi(argv[3]);
    body = read_all(in, sizeof *body, head.sprockets + head.arms), sprocket = read_all(in, sizeof *sprocket, head.sprockets);
    guide = read_all(in, sizeof *guide, head.guides), piece = read_all(in, sizeof *piece, head.pieces);
    arm = read_all(in, sizeof *arm, head.arms), tensioner = read_all(in, sizeof *tensioner, head.tensioners);
    double *work = calloc((size_t)(14 + 3 * P) * row, sizeof(double)), **rows[] = {&x, &y, &vx, &vy, &fx, &fy, &lx, &ly, &tension,
        &turn, &bend_x, &bend_y, &moment, &joint_hold};
    for (int r = 0; r < 14; r++) *rows[r] = work + r * row;
    touches = malloc(n * sizeof *touches), first = work + 14 * row, hold = first + P * row, damper_speed = hold + P * row;
    seat = malloc(P * row * sizeof(int));
    inverse_mass = 1.0 / head.mass, gravity = head.gravity;
    double *held = read_all(in, sizeof(double), (4 + P) * n);
    if (fgetc(in) != EOF) return fprintf(stderr, "long input\n"), 2;
    for (int r = 0; r < 4; r++) memcpy(work + r * row, held + r * n, n * sizeof(double));
    for (int q = 0; q < P * n; q++) seat[q / n * row + q % n] = (int)held[4 * n + q];
    for (int s = 0; s < (int)head.sprockets; s++) {
        int z = (int)sprocket[s].teeth;
        seats[s] = malloc(z * sizeof(Vector));
        for (int j = 0; j < z; j++) seats[s][j].x = cos(2 * M_PI * j / z), seats[s][j].y = sin(2 * M_PI * j / z);
    }
    struct timespec begin, end;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &begin);
    for (int it = 0; it < steps; it++) step(it);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &end);
    printf("%.9f\n", (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec));
    FILE *out = fopen(argv[2], "wb");
    for (int r = 0; r < 4; r++) fwrite(work + r * row, sizeof(double), n, out);
    return fclose(out);
}
