// The CPU benchmark's reference: the same work as warpchain's CPU kernel, by hand in plain C (IEEE float64, leapfrog):
// links, friction of joints, teeth and guides, straight and curved guides on the ground and on arms, tensioners on oil.
// A roller keeps its seat, or its piece of a guide, while it is near; directions of seats come from a table turned by
// one cosine and sine a sprocket a step. What the terms are stands in kernels/physics; the names are those of there.
//   cc -O3 -march=native -o chain_reference chain_reference.c -lm && ./chain_reference IN OUT STEPS
// IN holds doubles as written by benches/reference.py; OUT gets the final x, y, vx, vy. Prints the time loop's seconds of CPU time.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct { double x, y; } Vector;
typedef struct { double form, stiffness, exponent, damping, speed_floor, lag, yielding; } Law;
typedef struct { double mu_dynamic, mu_static, stribeck_speed; } Friction;
typedef struct { double rubs, inertia; Friction law; } Sliding;
typedef struct { double order, amplitude, phase; } Harmonic;
typedef struct {
    double prescribed, sign, inverse_inertia, following, speed, ramp_time, start_angle, torque, viscous, quadratic, load_ramp_time;
    double harmonics;
    Harmonic harmonic[8];
    double x, y, angle, omega, angular;
} Body;
typedef struct { double teeth, radius, near2, far2, tangent, clearance, cos_half, sin_half, tip; Law law; Sliding sliding; } Sprocket;
typedef struct {
    Vector start, direction;
    double length, end_radius, roller_radius, deepest_entry, body, pieces, first_piece;
    Vector low, high;
    Law law;
    Sliding sliding;
} Guide;
typedef struct { Vector start, direction; double curvature; } Piece;
typedef struct { double stiffness, free_angle, damping, low, high, stop_stiffness, stop_damping; Vector mass_moment, gravity; } Arm;
typedef struct {
    double body;
    Vector point, home, direction;
    double stiffness, preload, damping, hydraulic, area, volume, leak, drag, supply, ambient, floor, bulk_modulus, air, hole_area;
    double valve_preload, valve_stiffness, lift_max, seat_width, seat_growth, discharge, density, laminar_limit;
    double bottom, stop_stiffness, stop_damping, content, pressure;
} Tensioner;
typedef struct { double rubs, pin_radius, arm, inertia; Friction law; } Joint;
typedef struct {
    double rollers, sprockets, guides, pieces, arms, tensioners, light, step, length, stiffness, damping, mass;
    Vector gravity;
    Joint joint;
} Head;
typedef struct { double c, s, yielding, moment; } Pose;

typedef struct { int roller; double penetration, nx, ny, ux, uy; } Touch;

static int n;
static double *x, *y, *vx, *vy, *fx, *fy, *lx, *ly, *tension, *turn, *bend_x, *bend_y, *moment, *joint_hold;
static Touch *touches;  // of the partner at hand: normal, and velocity of its material point less the roller's
static int touching;
static double inverse_mass;
static Vector gravity;

static double clamp(double v, double low, double high) { return v < low ? low : v > high ? high : v; }
static double larger(double a, double b) { return a > b ? a : b; }

static double ramp(double t, double d) {
    if (t >= d) return 1.0;
    double u = t / d;
    return u * u * (3.0 - 2.0 * u);
}

static double ramp_integral(double t, double d) {
    if (t >= d) return t - 0.5 * d;
    double u = t / d;
    return d * u * u * u * (1.0 - 0.5 * u);
}

static double prescribed_angle(const Body *b, double t) {
    double phi = b->speed * ramp_integral(t, b->ramp_time), angle = phi;
    for (int k = 0; k < (int)b->harmonics; k++) {
        const Harmonic *h = &b->harmonic[k];
        angle += h->amplitude / h->order * (sin(h->order * phi + h->phase) - sin(h->phase));
    }
    return b->start_angle + b->sign * angle;
}

static double load_moment(const Body *b, double t) {
    double torque = b->torque, forward = b->sign * (b->angle - b->start_angle);
    for (int k = 0; k < (int)b->harmonics; k++)
        torque += b->harmonic[k].amplitude * cos(b->harmonic[k].order * forward + b->harmonic[k].phase);
    double resisting = b->sign * torque + b->viscous * b->omega + b->quadratic * b->omega * fabs(b->omega);
    return -resisting * ramp(t, b->load_ramp_time);
}

static double arm_moment(const Arm *a, const Body *b, const Pose *p) {
    double mx = a->mass_moment.x * p->c - a->mass_moment.y * p->s, my = a->mass_moment.x * p->s + a->mass_moment.y * p->c, stop = 0.0;
    if (b->angle < a->low) stop = larger(a->stop_stiffness * (a->low - b->angle) - a->stop_damping * b->omega, 0.0);
    else if (b->angle > a->high) stop = -larger(a->stop_stiffness * (b->angle - a->high) + a->stop_damping * b->omega, 0.0);
    return mx * a->gravity.y - my * a->gravity.x + stop - a->stiffness * (b->angle - a->free_angle) - a->damping * b->omega;
}

static double coefficient(double speed, const Friction *law) {
    if (law->mu_static == law->mu_dynamic) return law->mu_dynamic;
    double part = speed / law->stribeck_speed;
    return law->mu_dynamic + (law->mu_static - law->mu_dynamic) * exp(-part * part);
}

// Friction against a sliding speed, at most `most`; *held is what its bristle holds.
static double held_back(double most, double speed, double *held, double inertia) {
    *held = clamp(*held + 0.2 * inertia * speed, -most, most);
    return clamp(*held + 0.5 * inertia * speed, -most, most);
}

// Forces of all that touch the partner at hand; their moment about its body's center, and by how much it answers an
// acceleration. What contacts keep changes where `final`.
static double press(Vector center, double angular, const Law *law, const Sliding *sliding, int final,
                    double *restrict first, double *restrict hold, double *yielding) {
    double total = 0.0;
    for (const Touch *q = touches; q < touches + touching; q++) {
        int i = q->roller;
        double pen = q->penetration, nx = q->nx, ny = q->ny, before = first[i], ax = x[i] - center.x, ay = y[i] - center.y;
        double gain_x = -angular * ay - (inverse_mass * (lx[i + 1] - lx[i] + fx[i]) + gravity.x);
        double gain_y = angular * ax - (inverse_mass * (ly[i + 1] - ly[i] + fy[i]) + gravity.y);
        double speed = q->ux * nx + q->uy * ny, growth = gain_x * nx + gain_y * ny;
        double kept = before > 0.0 ? before : larger(speed, law->speed_floor);
        double elastic = law->stiffness * (law->exponent == 1.0 ? pen : pow(pen, law->exponent));
        double damper = law->form == 0.0 ? elastic * law->damping / kept : law->damping, fastest = law->form == 0.0 ? kept : 1e30;
        double now = (speed + law->lag * growth - law->yielding * elastic) / (1.0 + law->yielding * damper);
        double size = larger(elastic + damper * (now < fastest ? now : fastest), 0.0), px = size * nx, py = size * ny;
        if (sliding->rubs != 0.0) {
            double along = q->uy * nx - q->ux * ny, held = before > 0.0 ? hold[i] : 0.0;
            double most = size > 0.0 ? coefficient(fabs(along), &sliding->law) * size : 0.0;
            double drag = held_back(most, along, &held, sliding->inertia);
            if (final) hold[i] = held;
            px -= drag * ny, py += drag * nx;
        }
        if (final) first[i] = kept;
        else if (size > 0.0 && size - elastic < 0.999 * damper * fastest) {
            double lever = ay * nx - ax * ny;
            *yielding += lever * lever * law->lag * damper / (1.0 + law->yielding * damper);
        }
        fx[i] += px, fy[i] += py;
        total += ay * px - ax * py;
    }
    return total;
}

static void touch(int i, double pen, double nx, double ny, Vector center, double omega) {
    Touch q = {i, pen, nx, ny, -omega * (y[i] - center.y) - vx[i], omega * (x[i] - center.x) - vy[i]};
    touches[touching++] = q;
}

static void touch_teeth(const Sprocket *s, const Body *b, const Pose *p, const double *restrict ex, const double *restrict ey,
                        int final, int *restrict seat, double *restrict first) {
    double c = p->c, sn = p->s;
    Vector center = {b->x, b->y};
    int z = (int)s->teeth;
    for (int i = 0; i < n; i++) {
        double rx = x[i] - center.x, ry = y[i] - center.y, r2 = rx * rx + ry * ry;
        if (!(r2 > s->near2 && r2 < s->far2)) {
            if (seat[i] >= 0) { seat[i] = -1; first[i] = 0.0; }
            continue;
        }
        int j = seat[i];
        if (j < 0) {
            j = (int)rint(atan2(ry * c - rx * sn, rx * c + ry * sn) * z / 6.283185307179586);
            j += j < 0 ? z : j >= z ? -z : 0;
        }
        double ax = ex[j] * c - ey[j] * sn, ay = ex[j] * sn + ey[j] * c;
        double radial = rx * ax + ry * ay, lateral = ry * ax - rx * ay, limit = s->tangent * radial;
        if (fabs(lateral) > limit) {
            j += lateral > 0 ? 1 : -1;
            j += j < 0 ? z : j >= z ? -z : 0;
            ax = ex[j] * c - ey[j] * sn, ay = ex[j] * sn + ey[j] * c;
            radial = rx * ax + ry * ay, lateral = ry * ax - rx * ay;
        }
        seat[i] = j;
        double xi = radial - s->radius, eta = fabs(lateral), side = lateral >= 0 ? 1.0 : -1.0, pen, na, nb;
        if (eta * s->cos_half <= -xi * s->sin_half) {
            double d = sqrt(xi * xi + lateral * lateral), inverse = 1.0 / (d > 1e-12 ? d : 1e-12);
            pen = d - s->clearance, na = -xi * inverse, nb = -lateral * inverse;
        } else
            pen = eta * s->sin_half - xi * s->cos_half - s->clearance, na = s->cos_half, nb = -side * s->sin_half;
        if (pen > 0.0) {
            double d = sqrt(radial * radial + lateral * lateral), tip = s->tip - d;
            if (tip < pen) pen = tip, na = radial / d, nb = lateral / d;
            touch(i, pen, ax * na - ay * nb, ax * nb + ay * na, center, b->omega);
        } else if (final) first[i] = 0.0;
    }
}

// A roller that is deep in a guide without having come through its face touches nothing until it has left.
static double through_face(double pen, const Guide *g, double *first, int final) {
    int missed = pen > 0.0 && (*first < 0.0 || (*first == 0.0 && pen > g->deepest_entry));
    if (final && (missed || pen <= 0.0)) *first = missed ? -1.0 : 0.0;
    return missed ? 0.0 : pen;
}

static void touch_bar(const Guide *g, Vector start, Vector t, Vector center, double omega, int final, double *restrict first) {
    double reach = g->end_radius + g->roller_radius;
    for (int i = 0; i < n; i++) {
        double qx = x[i] - start.x, qy = y[i] - start.y, along = qx * t.x + qy * t.y, across = qy * t.x - qx * t.y;
        double pen = 0.0, na = 0.0, nb = 1.0;
        if (along > -reach && along < g->length + reach && across > -g->end_radius && across < g->roller_radius) {
            double beyond = (along < 0.0 ? along : 0.0) + (along > g->length ? along - g->length : 0.0);
            pen = g->roller_radius - across;
            if (beyond != 0.0) {
                double h = across + g->end_radius, d = sqrt(beyond * beyond + h * h);
                pen = g->roller_radius + g->end_radius - d, na = beyond / d, nb = h / d;
            }
        }
        if (through_face(pen, g, &first[i], final) > 0.0) touch(i, pen, t.x * na - t.y * nb, t.x * nb + t.y * na, center, omega);
    }
}

static int past(const Piece *p, double qx, double qy) {
    return (qx - p->start.x) * p->direction.x + (qy - p->start.y) * p->direction.y >= 0.0;
}

static double over(const Piece *p, double qx, double qy, Vector *normal) {
    double dx = qx - p->start.x, dy = qy - p->start.y, u = dx * p->direction.x + dy * p->direction.y;
    double w = dy * p->direction.x - dx * p->direction.y, k = p->curvature, g = 2.0 * w - k * (u * u + w * w);
    double root = sqrt(larger(1.0 - k * g, 1e-12)), along = -k * u / root, across = (1.0 - k * w) / root;
    normal->x = along * p->direction.x - across * p->direction.y, normal->y = along * p->direction.y + across * p->direction.x;
    return g / (1.0 + root);
}

static int nearest_piece(const Piece *piece, int count, double qx, double qy) {
    double begun = hypot(qx - piece[0].start.x, qy - piece[0].start.y), least = 1e38;
    int nearest = begun < hypot(qx - piece[count].start.x, qy - piece[count].start.y) ? 0 : count - 1;
    Vector normal;
    for (int k = 0; k < count; k++)
        if (past(&piece[k], qx, qy) && !past(&piece[k + 1], qx, qy) && fabs(over(&piece[k], qx, qy, &normal)) < least)
            least = fabs(over(&piece[k], qx, qy, &normal)), nearest = k;
    return nearest;
}

static void touch_profile(const Guide *g, const Piece *piece, Vector center, const Pose *p, double omega, int final,
                          int *restrict kept, double *restrict first) {
    int last = (int)g->pieces - 1;
    for (int i = 0; i < n; i++) {
        double ax = x[i] - center.x, ay = y[i] - center.y, qx = ax * p->c + ay * p->s, qy = ay * p->c - ax * p->s;
        double dx = qx - g->start.x, dy = qy - g->start.y, along = dx * g->direction.x + dy * g->direction.y;
        double across = dy * g->direction.x - dx * g->direction.y;
        if (!(along > g->low.x && along < g->high.x && across > g->low.y && across < g->high.y)) {
            if (kept[i] >= 0) kept[i] = -1, first[i] = 0.0;
            continue;
        }
        int k = kept[i];
        if (k < 0) k = nearest_piece(piece, last + 1, qx, qy);
        else k = past(&piece[k + 1], qx, qy) ? (k < last ? k + 1 : k) : past(&piece[k], qx, qy) || k == 0 ? k : k - 1;
        kept[i] = k;
        Vector normal;
        double height = over(&piece[k], qx, qy, &normal), pen = g->roller_radius - height;
        if (height <= -g->end_radius || past(&piece[k + 1], qx, qy) || !past(&piece[k], qx, qy)) pen = 0.0;
        if (through_face(pen, g, &first[i], final) > 0.0)
            touch(i, pen, normal.x * p->c - normal.y * p->s, normal.x * p->s + normal.y * p->c, center, omega);
    }
}

static double pressure_at(double z, const Tensioner *t) { return t->ambient * z * z * z * z * z * z * z; }
static double root_of(double pressure, const Tensioner *t) { return pow(pressure / t->ambient, 1.0 / 7.0); }

static double compression(double z, const Tensioner *t, double *slope) {
    double sixth = z * z * z * z * z * z, stiff = t->ambient / t->bulk_modulus * sixth / (1.0 + t->air);
    double soft = t->air / sixth / (1.0 + t->air);
    *slope = 7.0 * stiff + 5.0 * soft;
    return (stiff - soft) * z;
}

// Flow into the chamber, and its derivative by the pressure.
static double inflow(double pressure, double rate, const Tensioner *t, double *slope) {
    double lift = clamp(((t->supply - pressure) * t->hole_area - t->valve_preload) / t->valve_stiffness, 0.0, t->lift_max);
    double flow = -t->leak * (pressure - t->ambient) - t->drag * rate;
    *slope = -t->leak;
    if (lift > 0.0) {
        double drop = t->supply - pressure, around = t->discharge * M_PI, curtain = around * lift * (t->seat_width + lift * t->seat_growth);
        double part = t->hole_area / sqrt(curtain * curtain + t->hole_area * t->hole_area), limit = larger(drop, t->laminar_limit);
        double speed = sqrt(2.0 * limit / t->density), quicker = speed / (2.0 * limit);
        if (drop < limit) speed *= drop / limit, quicker = speed / drop;
        flow += part * curtain * speed, *slope -= part * curtain * quicker;
        if (lift < t->lift_max)
            *slope -= around * (t->seat_width + 2.0 * lift * t->seat_growth) * part * part * part * speed * t->hole_area / t->valve_stiffness;
    }
    return flow;
}

// z of the oil's pressure, by Newton's method in a bracket; with what flows in a step h, or at h = 0 as the oil is.
static double solved_root(double volume, double h, double rate, const Tensioner *t) {
    double low = 0.0, high = 8.0, z = root_of(t->pressure, t), change = high;
    for (int rounds = 0; rounds < 60 && fabs(change) > 1e-7 * z; rounds++) {
        double slope, phi = compression(z, t, &slope), room = volume;
        if (h > 0.0) {
            double fall, pressure = pressure_at(z, t), flow = inflow(pressure, rate, t, &fall);
            room = larger(volume - h * flow, 0.01 * volume), slope -= h * fall * 7.0 * pressure / (z * room);
        }
        double rest = phi + log(room / t->volume) - t->content, after = larger(z - rest / slope, t->floor);
        if (rest > 0.0) high = z; else low = z;
        if ((after <= low && z > low) || after > high) after = 0.5 * (low + high);
        change = after - z, z = after;
    }
    return z;
}

static double extension(const Tensioner *t, const Body *b, const Pose *p, Vector *lever, double *rate) {
    lever->x = t->point.x * p->c - t->point.y * p->s, lever->y = t->point.x * p->s + t->point.y * p->c;
    *rate = b->omega * (lever->x * t->direction.y - lever->y * t->direction.x);
    return (b->x + lever->x - t->home.x) * t->direction.x + (b->y + lever->y - t->home.y) * t->direction.y;
}

static double chamber(const Tensioner *t, double x) { return t->volume + t->area * larger(x, t->bottom); }

static double push_moment(const Tensioner *t, const Body *b, const Pose *p) {
    Vector lever;
    double rate, at = extension(t, b, p, &lever, &rate), pressure = t->ambient, stop = 0.0;
    if (t->hydraulic == 1.0) pressure = pressure_at(solved_root(chamber(t, at), 0.0, 0.0, t), t);
    double push = t->preload - t->stiffness * at;
    if (t->hydraulic == 0.0) push = larger(push, 0.0);
    push = larger(push + (pressure - t->ambient) * t->area - t->damping * rate, 0.0);
    if (t->bottom > at) stop = larger(0.0, t->stop_stiffness * (t->bottom - at) - t->stop_damping * rate);
    return (push + stop) * (lever.x * t->direction.y - lever.y * t->direction.x);
}

static void flow(Tensioner *t, const Body *b, double h) {
    if (t->hydraulic == 0.0) return;
    Pose p = {cos(b->angle), sin(b->angle), 0.0, 0.0};
    Vector lever;
    double rate, slope, at = extension(t, b, &p, &lever, &rate), z = solved_root(chamber(t, at), h, rate, t);
    t->pressure = pressure_at(z, t);
    double gain = exp(compression(z, t, &slope)) * h * inflow(t->pressure, rate, t, &slope) / t->volume;
    t->content = log(exp(t->content) + gain);
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
        double slip = turn[i + 1] - turn[i], most = larger(fabs(tension[i]), fabs(tension[i + 1]));
        most *= coefficient(fabs(slip) * j->pin_radius, &j->law) * j->arm;
        moment[i + 1] = -held_back(most, slip, &hold[i + 1], j->inertia);
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
static double *table[64][2], *first, *hold;
static int *seat;
static size_t row;

// Forces of all contacts, and their moments on bodies with those of tensioners.
static void contact_pass(Pose *pose, int final) {
    int S = (int)head.sprockets, A = (int)head.arms;
    for (int b = 0; b < S + A; b++) pose[b].moment = pose[b].yielding = 0.0;
    for (int s = 0; s < S; s++) {
        touching = 0;
        touch_teeth(&sprocket[s], &body[s], &pose[s], table[s][0], table[s][1], final, seat + s * row, first + s * row);
        Vector center = {body[s].x, body[s].y};
        pose[s].moment += press(center, body[s].angular, &sprocket[s].law, &sprocket[s].sliding, final,
                                first + s * row, hold + s * row, &pose[s].yielding);
    }
    for (int g = 0; g < (int)head.guides; g++) {
        const Guide *q = &guide[g];
        touching = 0;
        static Pose ground;
        ground.c = 1.0;
        int b = (int)q->body;
        Pose *p = b < 0 ? &ground : &pose[b];
        Vector center = {b < 0 ? 0.0 : body[b].x, b < 0 ? 0.0 : body[b].y}, start = q->start, t = q->direction;
        double omega = b < 0 ? 0.0 : body[b].omega, *kept = first + (S + g) * row;
        if (q->pieces > 0.0)
            touch_profile(q, piece + (int)q->first_piece, center, p, omega, final, seat + (S + g) * row, kept);
        else {
            start.x = center.x + q->start.x * p->c - q->start.y * p->s, start.y = center.y + q->start.x * p->s + q->start.y * p->c;
            t.x = q->direction.x * p->c - q->direction.y * p->s, t.y = q->direction.x * p->s + q->direction.y * p->c;
            touch_bar(q, start, t, center, omega, final, kept);
        }
        p->moment += press(center, b < 0 ? 0.0 : body[b].angular, &q->law, &q->sliding, final, kept,
                           hold + (S + g) * row, &p->yielding);
    }
    for (int k = 0; k < (int)head.tensioners; k++) {
        int b = (int)tensioner[k].body;
        pose[b].moment += push_moment(&tensioner[k], &body[b], &pose[b]);
    }
}

static void step(int it) {
    int S = (int)head.sprockets, B = S + (int)head.arms;
    double h = head.step, t = it * h, kick = it ? h : 0.5 * h, load[64];
    Pose pose[64];
    for (int b = 0; b < B; b++) {
        pose[b].c = cos(body[b].angle), pose[b].s = sin(body[b].angle);
        load[b] = body[b].prescribed ? 0.0 : b < S ? load_moment(&body[b], t) : arm_moment(&arm[b - S], &body[b], &pose[b]);
    }
    x[n] = x[0], y[n] = y[0], vx[n] = vx[0], vy[n] = vy[0];
    link_pass(head.stiffness, head.damping, head.length, x, y, vx, vy, tension, lx, ly, fx, fy);
    if (head.joint.rubs != 0.0) {
        turn_pass(x, y, vx, vy, turn, bend_x, bend_y);
        joint_pass(&head.joint, tension, turn, bend_x, bend_y, moment, joint_hold, lx, ly);
    }
    lx[0] = lx[n], ly[0] = ly[n];
    if (head.light != 0.0) {  // the accelerations of bodies with which their contacts agree
        contact_pass(pose, 0);
        for (int b = 0; b < B; b++) {
            if (body[b].prescribed) continue;
            double share = pose[b].yielding * body[b].inverse_inertia, rate = (pose[b].moment + load[b]) * body[b].inverse_inertia;
            body[b].angular = (rate + share * body[b].angular) / (1.0 + share);
        }
        for (int i = 0; i < n; i++) fx[i] = fy[i] = 0.0;
    }
    contact_pass(pose, 1);
    for (int b = 0; b < B; b++) {
        Body *q = &body[b];
        double rate = (pose[b].moment + load[b]) * q->inverse_inertia;
        if (q->prescribed != 0.0) {
            double angle = prescribed_angle(q, t + h), speed = (angle - q->angle) / h;
            rate = (speed - q->omega) / kick, q->omega = speed, q->angle = angle;
        } else
            q->omega += kick * rate, q->angle += h * q->omega;
        q->angular += q->following * (rate - q->angular);
    }
    for (int k = 0; k < (int)head.tensioners; k++) flow(&tensioner[k], &body[(int)tensioner[k].body], h);
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
    double *work = calloc((size_t)(14 + 2 * P) * row, sizeof(double)), **rows[] = {&x, &y, &vx, &vy, &fx, &fy, &lx, &ly, &tension,
        &turn, &bend_x, &bend_y, &moment, &joint_hold};
    for (int r = 0; r < 14; r++) *rows[r] = work + r * row;
    touches = malloc(n * sizeof *touches), first = work + 14 * row, hold = first + P * row, seat = malloc(P * row * sizeof(int));
    inverse_mass = 1.0 / head.mass, gravity = head.gravity;
    double *held = read_all(in, sizeof(double), (4 + P) * n);
    for (int r = 0; r < 4; r++) memcpy(work + r * row, held + r * n, n * sizeof(double));
    for (int q = 0; q < P * n; q++) seat[q / n * row + q % n] = (int)held[4 * n + q];
    for (int s = 0; s < (int)head.sprockets; s++) {
        int z = (int)sprocket[s].teeth;
        for (int a = 0; a < 2; a++) table[s][a] = malloc(z * sizeof(double));
        for (int j = 0; j < z; j++) table[s][0][j] = cos(2 * M_PI * j / z), table[s][1][j] = sin(2 * M_PI * j / z);
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
