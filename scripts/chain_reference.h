// What the benchmarks' references in C and CUDA C++ share: the layout of IN, written by benches/reference.py, and the physics of
// one roller, contact, body or tensioner. What the terms are stands in kernels/physics; the names are those of there.
// Rollers and contacts are of type Real; bodies and oil are always in float64.
#include <math.h>

#ifndef REAL
#define REAL double
#endif
#ifdef __CUDACC__
#define SHARED __host__ __device__ inline
#else
#define SHARED static inline
#endif
#define MAX(a, b) ((a) > (b) ? (a) : (b))
#define MIN(a, b) ((a) < (b) ? (a) : (b))
#define AWAY (-1)  // penetration of a roller that is not near
#define CLAMP(v, low, high) ((v) < (low) ? (low) : (v) > (high) ? (high) : (v))

typedef REAL Real;
typedef struct { Real x, y; } Vector;
typedef struct { double x, y; } Point;
typedef struct { Real form, stiffness, exponent, damping, speed_floor, lag, yielding, answer, ahead; } Law;
typedef struct { Real mu_dynamic, mu_static, stribeck_speed; } Friction;
typedef struct { Real rubs, spring, damper; Friction law; } Sliding;
typedef struct { double order, amplitude, phase; } Harmonic;
typedef struct {
    double prescribed, sign, inverse_inertia, speed, ramp_time, start_angle, torque, viscous, quadratic, load_ramp_time;
    double harmonics;
    Harmonic harmonic[8];
    double x, y, angle, omega, angular;
} Body;
typedef struct { Real teeth, radius, near2, far2, tangent, clearance, cos_half, sin_half, tip; Law law; Sliding sliding; } Sprocket;
typedef struct {
    Vector start, direction;
    Real length, end_radius, roller_radius, deepest_entry, body, pieces, first_piece;
    Vector low, high;
    Law law;
    Sliding sliding;
} Guide;
typedef struct { Vector start, direction; Real curvature; } Piece;
typedef struct { double stiffness, free_angle, damping, low, high, stop_stiffness, stop_damping; Point mass_moment, gravity; } Arm;
typedef struct {
    double body;
    Point point, home, direction;
    double stiffness, preload, damping, hydraulic, area, volume, leak, drag, supply, ambient, floor, oil_share, air_share, hole_area;
    double valve_preload, valve_compliance, lift_max, seat_width, seat_growth, discharge, density, laminar_limit;
    double bottom, stop_stiffness, stop_damping, content, root;
} Tensioner;
typedef struct { Real rubs, pin_radius, arm, spring, damper; Friction law; } Joint;
typedef struct {
    Real rollers, sprockets, guides, pieces, arms, tensioners, step, length, stiffness, damping, mass;
    Vector gravity;
    Joint joint;
} Head;

typedef struct { Vector center, heading; Real omega, angular; } Motion;  // of a body; heading: cosine and sine of its angle
typedef struct { Vector place, velocity, acceleration; } Roller;         // acceleration by all but the contact at hand
typedef struct { Real penetration; Vector normal; } Gap;  // negative before they touch; the normal points to the roller
typedef struct { Real x, y, moment; } Push;                              // force on a roller, and its moment on the body

// Root of a square, and its inverse, as each machine has it at least cost.
#ifdef __CUDACC__
SHARED Real root(Real square, Real *inverse) { return *inverse = rsqrt(square), square * *inverse; }
SHARED Real power(Real base, Real exponent) { return exp(exponent * log(base)); }
#else
SHARED Real root(Real square, Real *inverse) {
    Real length = sqrt(square);
    *inverse = 1 / length;
    return length;
}
SHARED Real power(Real base, Real exponent) { return pow(base, exponent); }
#endif

SHARED Vector turned(Vector v, Vector heading) {
    Vector w = {v.x * heading.x - v.y * heading.y, v.x * heading.y + v.y * heading.x};
    return w;
}

SHARED Real coefficient(Real speed, const Friction *law) {
    if (law->mu_static == law->mu_dynamic) return law->mu_dynamic;
    Real part = speed / law->stribeck_speed;
    return law->mu_dynamic + (law->mu_static - law->mu_dynamic) * exp(-part * part);
}

// Friction against a sliding speed, at most `most`; *held is what its bristle holds.
SHARED Real held_back(Real most, Real speed, Real *held, Real spring, Real damper) {
    Real stick = *held + spring * speed;
    *held = CLAMP(stick, -most, most);
    Real force = *held + damper * speed;
    return CLAMP(force, -most, most);
}

// Push of a contact that is near, in the mean over the step. It keeps *first, its impact speed, 0 while it is open; *hold, what
// its friction's bristle holds; *damper_speed, at which its damper acts.
SHARED Push contact_push(const Law *law, const Sliding *sliding, const Motion *m, const Roller *r, Gap gap, Real *first, Real *hold,
                         Real *damper_speed) {
    Real pen = gap.penetration, nx = gap.normal.x, ny = gap.normal.y, ax = r->place.x - m->center.x, ay = r->place.y - m->center.y;
    Real ux = -m->omega * ay - r->velocity.x, uy = m->omega * ax - r->velocity.y;
    Real gain_x = -m->angular * ay - r->acceleration.x, gain_y = m->angular * ax - r->acceleration.y;
    Real growth = gain_x * nx + gain_y * ny, closing = ux * nx + uy * ny + law->lag * growth, ahead = MIN(fabs(closing) * law->lag, law->ahead);
    Push push = {0, 0, 0};
    if (pen <= -ahead) return *first = 0, push;
    Real mean = pen >= ahead ? pen : (pen + ahead) * (pen + ahead) / (4 * ahead);
    if (*first <= 0) {
        Real met = ahead > 0 ? closing - growth * MIN(pen, ahead) * law->lag / ahead : closing;
        *first = MAX(met, law->speed_floor), *hold = *damper_speed = 0;
    }
    Real elastic = law->stiffness * (law->exponent == 1 ? mean : power(mean, law->exponent));
    Real damper = law->form == 0 ? elastic * law->damping / *first : law->damping, fastest = law->form == 0 ? *first : (Real)1e30;
    Real give = law->yielding * damper, answer = law->answer;
    Real now = (closing - law->yielding * elastic + give * answer * *damper_speed) / (1 + give * (1 + answer));
    *damper_speed = MIN(now, fastest);
    Real force = elastic + damper * *damper_speed, size = MAX(force, 0);
    push.x = size * nx, push.y = size * ny;
    if (sliding->rubs != 0) {
        Real along = uy * nx - ux * ny, most = size > 0 ? coefficient(fabs(along), &sliding->law) * size : 0;
        Real drag = held_back(most, along, hold, sliding->spring, sliding->damper);
        push.x -= drag * ny, push.y += drag * nx;
    }
    push.moment = ay * push.x - ax * push.y;
    return push;
}

SHARED int is_near(const Sprocket *s, const Motion *m, Vector place) {
    Real rx = place.x - m->center.x, ry = place.y - m->center.y, square = rx * rx + ry * ry;
    return square > s->near2 && square < s->far2;
}

// Gap of a roller near a sprocket, in the seat *seat, or the next one where it has gone over the tip between; the nearest
// where that is negative. `seats` has the seats' directions from the center at angle 0.
SHARED Gap tooth_gap(const Sprocket *s, const Motion *m, const Vector *seats, Vector place, int *seat) {
    Real rx = place.x - m->center.x, ry = place.y - m->center.y;
    int z = (int)s->teeth, j = *seat;
    if (j < 0) {
        float across = ry * m->heading.x - rx * m->heading.y, along = rx * m->heading.x + ry * m->heading.y;
        j = (int)rint(atan2f(across, along) * z / 6.2831853f);
        j += j < 0 ? z : j >= z ? -z : 0;
    }
    Vector a = turned(seats[j], m->heading);
    Real radial = rx * a.x + ry * a.y, lateral = ry * a.x - rx * a.y;
    if (fabs(lateral) > s->tangent * radial) {
        j += lateral > 0 ? 1 : -1;
        j += j < 0 ? z : j >= z ? -z : 0;
        a = turned(seats[j], m->heading);
        radial = rx * a.x + ry * a.y, lateral = ry * a.x - rx * a.y;
    }
    *seat = j;
    Real xi = radial - s->radius, eta = fabs(lateral);
    Gap gap;
    if (eta * s->cos_half <= -xi * s->sin_half) {
        Real inverse, square = xi * xi + lateral * lateral, d = root(MAX(square, (Real)1e-24), &inverse);
        gap.penetration = d - s->clearance, gap.normal.x = -xi * inverse, gap.normal.y = -lateral * inverse;
    } else {
        gap.penetration = eta * s->sin_half - xi * s->cos_half - s->clearance;
        gap.normal.x = s->cos_half, gap.normal.y = lateral >= 0 ? -s->sin_half : s->sin_half;
    }
    if (gap.penetration > -s->law.ahead) {
        Real square = radial * radial + lateral * lateral, most = MAX(s->tip - gap.penetration, 0);
        if (square > most * most) {
            Real inverse, d = root(square, &inverse);
            gap.penetration = s->tip - d, gap.normal.x = radial * inverse, gap.normal.y = lateral * inverse;
        }
        gap.normal = turned(gap.normal, a);
    }
    return gap;
}

// A roller that is deep in a guide without having come through its face touches nothing until it has left.
SHARED Real through_face(Real pen, const Guide *g, Real *first) {
    int missed = pen > -g->law.ahead && (*first < 0 || (*first == 0 && pen > g->deepest_entry));
    if (missed || pen <= -g->law.ahead) *first = missed ? -1 : 0;
    return missed ? AWAY : pen;
}

// Gap from a straight guide, given its start and direction as it stands.
SHARED Gap bar_gap(const Guide *g, Vector start, Vector t, Vector place, Real *first) {
    Real reach = g->end_radius + g->roller_radius, qx = place.x - start.x, qy = place.y - start.y;
    Real along = qx * t.x + qy * t.y, across = qy * t.x - qx * t.y;
    Gap gap = {AWAY, {0, 1}};
    if (along > -reach - g->law.ahead && along < g->length + reach + g->law.ahead && across > -g->end_radius
        && across < g->roller_radius + g->law.ahead) {
        Real beyond = (along < 0 ? along : 0) + (along > g->length ? along - g->length : 0);
        gap.penetration = g->roller_radius - across;
        if (beyond != 0) {
            Real up = across + g->end_radius, inverse, d = root(beyond * beyond + up * up, &inverse);
            gap.penetration = reach - d, gap.normal.x = beyond * inverse, gap.normal.y = up * inverse;
        }
        gap.penetration = through_face(gap.penetration, g, first), gap.normal = turned(gap.normal, t);
    } else *first = 0;
    return gap;
}

SHARED int past(const Piece *p, Vector q) {
    return (q.x - p->start.x) * p->direction.x + (q.y - p->start.y) * p->direction.y >= 0;
}

// Height of a place over the line or circle of a piece, and the normal there.
SHARED Real over(const Piece *p, Vector q, Vector *normal) {
    Real dx = q.x - p->start.x, dy = q.y - p->start.y, u = dx * p->direction.x + dy * p->direction.y;
    Real w = dy * p->direction.x - dx * p->direction.y, k = p->curvature, g = 2 * w - k * (u * u + w * w), rest = 1 - k * g;
    Real inverse, length = root(MAX(rest, (Real)1e-12), &inverse);
    Vector inward = {-k * u * inverse, (1 - k * w) * inverse};
    *normal = turned(inward, p->direction);
    return g / (1 + length);
}

SHARED Real from_start(const Piece *p, Vector q) {
    Real dx = q.x - p->start.x, dy = q.y - p->start.y;
    return dx * dx + dy * dy;
}

SHARED int nearest_piece(const Piece *piece, int count, Vector q) {
    int nearest = from_start(&piece[0], q) < from_start(&piece[count], q) ? 0 : count - 1;
    Real least = (Real)1e30;
    Vector normal;
    for (int k = 0; k < count; k++) {
        if (!past(&piece[k], q) || past(&piece[k + 1], q)) continue;
        Real height = fabs(over(&piece[k], q, &normal));
        if (height < least) least = height, nearest = k;
    }
    return nearest;
}

// Gap from a curved guide, given its pieces; *kept is the piece below the roller, or -1 where that is not near.
SHARED Gap profile_gap(const Guide *g, const Piece *piece, const Motion *m, Vector place, int *kept, Real *first) {
    Real ax = place.x - m->center.x, ay = place.y - m->center.y;
    Vector q = {ax * m->heading.x + ay * m->heading.y, ay * m->heading.x - ax * m->heading.y}, normal;
    Real dx = q.x - g->start.x, dy = q.y - g->start.y, along = dx * g->direction.x + dy * g->direction.y;
    Real across = dy * g->direction.x - dx * g->direction.y;
    if (!(along > g->low.x && along < g->high.x && across > g->low.y && across < g->high.y)) {
        Gap none = {AWAY, {0, 1}};
        if (*kept >= 0) *kept = -1, *first = 0;
        return none;
    }
    int last = (int)g->pieces - 1, k = *kept;
    if (k < 0) k = nearest_piece(piece, last + 1, q);
    else k = past(&piece[k + 1], q) ? (k < last ? k + 1 : k) : past(&piece[k], q) || k == 0 ? k : k - 1;
    *kept = k;
    Real height = over(&piece[k], q, &normal), pen = g->roller_radius - height;
    if (height <= -g->end_radius || past(&piece[k + 1], q) || !past(&piece[k], q)) pen = AWAY;
    Gap gap = {through_face(pen, g, first), normal};
    if (gap.penetration > -g->law.ahead) gap.normal = turned(normal, m->heading);
    return gap;
}

SHARED double ramp(double t, double d) {
    if (t >= d) return 1.0;
    double u = t / d;
    return u * u * (3.0 - 2.0 * u);
}

SHARED double ramp_integral(double t, double d) {
    if (t >= d) return t - 0.5 * d;
    double u = t / d;
    return d * u * u * u * (1.0 - 0.5 * u);
}

SHARED double prescribed_angle(const Body *b, double t) {
    double phi = b->speed * ramp_integral(t, b->ramp_time), angle = phi;
    for (int k = 0; k < (int)b->harmonics; k++) {
        const Harmonic *h = &b->harmonic[k];
        angle += h->amplitude / h->order * (sin(h->order * phi + h->phase) - sin(h->phase));
    }
    return b->start_angle + b->sign * angle;
}

SHARED double load_moment(const Body *b, double t) {
    double torque = b->torque, forward = b->sign * (b->angle - b->start_angle);
    for (int k = 0; k < (int)b->harmonics; k++)
        torque += b->harmonic[k].amplitude * cos(b->harmonic[k].order * forward + b->harmonic[k].phase);
    double resisting = b->sign * torque + b->viscous * b->omega + b->quadratic * b->omega * fabs(b->omega);
    return -resisting * ramp(t, b->load_ramp_time);
}

SHARED double arm_moment(const Arm *a, const Body *b, Point heading) {
    double mx = a->mass_moment.x * heading.x - a->mass_moment.y * heading.y;
    double my = a->mass_moment.x * heading.y + a->mass_moment.y * heading.x, stop = 0.0;
    if (b->angle < a->low) stop = MAX(a->stop_stiffness * (a->low - b->angle) - a->stop_damping * b->omega, 0.0);
    else if (b->angle > a->high) stop = -MAX(a->stop_stiffness * (b->angle - a->high) + a->stop_damping * b->omega, 0.0);
    return mx * a->gravity.y - my * a->gravity.x + stop - a->stiffness * (b->angle - a->free_angle) - a->damping * b->omega;
}

// Moves a body over a step `h` from time `t`; speeds take `kick`.
SHARED void move_body(Body *b, double moment, double t, double kick, double h) {
    b->angular = moment * b->inverse_inertia;
    if (b->prescribed != 0.0) {
        double angle = prescribed_angle(b, t + h), speed = (angle - b->angle) / h;
        b->angular = (speed - b->omega) / kick, b->omega = speed, b->angle = angle;
    } else
        b->omega += kick * b->angular, b->angle += h * b->omega;
}

SHARED double pressure_at(double z, const Tensioner *t) { return t->ambient * z * z * z * z * z * z * z; }

SHARED double compression(double z, const Tensioner *t, double *slope) {
    double sixth = z * z * z * z * z * z, stiff = t->oil_share * sixth, soft = t->air_share / sixth;
    *slope = 7.0 * stiff + 5.0 * soft;
    return (stiff - soft) * z;
}

// Flow into the chamber, and its derivative by the pressure.
SHARED double inflow(double pressure, double rate, const Tensioner *t, double *slope) {
    double lift = ((t->supply - pressure) * t->hole_area - t->valve_preload) * t->valve_compliance;
    double flow = -t->leak * (pressure - t->ambient) - t->drag * rate;
    *slope = -t->leak;
    if (lift > 0.0) {
        lift = MIN(lift, t->lift_max);
        double drop = t->supply - pressure, around = t->discharge * M_PI;
        double curtain = around * lift * (t->seat_width + lift * t->seat_growth);
        double part = t->hole_area / sqrt(curtain * curtain + t->hole_area * t->hole_area), limit = MAX(drop, t->laminar_limit);
        double speed = sqrt(2.0 * limit / t->density), quicker = speed / (2.0 * limit);
        if (drop < limit) speed *= drop / limit, quicker = speed / drop;
        flow += part * curtain * speed, *slope -= part * curtain * quicker;
        if (lift < t->lift_max)
            *slope -= around * (t->seat_width + 2.0 * lift * t->seat_growth) * part * part * part * speed * t->hole_area
                      * t->valve_compliance;
    }
    return flow;
}

// z of the oil's pressure, by Newton's method in a bracket; with what flows in a step h, or at h = 0 as the oil is.
SHARED double solved_root(double volume, double h, double rate, const Tensioner *t) {
    double low = 0.0, high = 8.0, z = t->root, change = high;
    for (int rounds = 0; rounds < 60 && fabs(change) > 1e-7 * z; rounds++) {
        double slope, phi = compression(z, t, &slope), room = volume;
        if (h > 0.0) {
            double fall, pressure = pressure_at(z, t), flow = inflow(pressure, rate, t, &fall);
            room = MAX(volume - h * flow, 0.01 * volume), slope -= h * fall * 7.0 * pressure / (z * room);
        }
        double rest = phi + log(room / t->volume) - t->content, after = MAX(z - rest / slope, t->floor);
        if (rest > 0.0) high = z; else low = z;
        if ((after <= low && z > low) || after > high) after = 0.5 * (low + high);
        change = after - z, z = after;
    }
    return z;
}

SHARED double extension(const Tensioner *t, const Body *b, Point heading, Point *lever, double *rate) {
    lever->x = t->point.x * heading.x - t->point.y * heading.y, lever->y = t->point.x * heading.y + t->point.y * heading.x;
    *rate = b->omega * (lever->x * t->direction.y - lever->y * t->direction.x);
    return (b->x + lever->x - t->home.x) * t->direction.x + (b->y + lever->y - t->home.y) * t->direction.y;
}

SHARED double chamber(const Tensioner *t, double x) { return t->volume + t->area * MAX(x, t->bottom); }

SHARED double push_moment(const Tensioner *t, const Body *b, Point heading) {
    Point lever;
    double rate, at = extension(t, b, heading, &lever, &rate), pressure = t->ambient, stop = 0.0;
    if (t->hydraulic == 1.0) pressure = pressure_at(solved_root(chamber(t, at), 0.0, 0.0, t), t);
    double push = t->preload - t->stiffness * at;
    if (t->hydraulic == 0.0) push = MAX(push, 0.0);
    push += (pressure - t->ambient) * t->area - t->damping * rate, push = MAX(push, 0.0);
    if (t->bottom > at) stop = MAX(0.0, t->stop_stiffness * (t->bottom - at) - t->stop_damping * rate);
    return (push + stop) * (lever.x * t->direction.y - lever.y * t->direction.x);
}

// Lets the oil flow over a step h, its body already moved.
SHARED void flow(Tensioner *t, const Body *b, Point heading, double h) {
    if (t->hydraulic == 0.0) return;
    Point lever;
    double rate, slope, at = extension(t, b, heading, &lever, &rate);
    t->root = solved_root(chamber(t, at), h, rate, t);
    double gain = exp(compression(t->root, t, &slope)) * h * inflow(pressure_at(t->root, t), rate, t, &slope) / t->volume;
    t->content = log(exp(t->content) + gain);
}
