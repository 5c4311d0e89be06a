// The CPU benchmark's reference: the same work as warpchain's CPU kernel, by hand in plain C (IEEE float64, leapfrog,
// seat kept while engaged, seat directions from a table turned by one cosine and sine a sprocket a step).
//   cc -O3 -march=native -o chain_reference chain_reference.c -lm && ./chain_reference IN OUT STEPS
// IN holds doubles as written by benches/reference.py; OUT gets the final x, y, vx, vy. Prints the time loop's seconds of CPU time.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct { double stiffness, exponent, hysteresis, speed_floor, most_damping; } Law;
typedef struct { double order, amplitude, phase; } Harmonic;
typedef struct {
    double x, y, radius, near2, far2, tangent, clearance, cos_half, sin_half, tip;
    Law law;
    double prescribed, sign, inverse_inertia, speed, ramp_time, start_angle, torque, viscous, quadratic, load_ramp_time;
    double harmonics, teeth;
    Harmonic harmonic[8];
    double angle, omega;
} Sprocket;
typedef struct { double x, y, tx, ty, length, end_radius, roller_radius; Law law; } Guide;

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

static double prescribed_angle(const Sprocket *s, double t) {
    double phi = s->speed * ramp_integral(t, s->ramp_time), angle = phi;
    for (int k = 0; k < (int)s->harmonics; k++) {
        const Harmonic *h = &s->harmonic[k];
        angle += h->amplitude / h->order * (sin(h->order * phi + h->phase) - sin(h->phase));
    }
    return s->start_angle + s->sign * angle;
}

static double load_moment(const Sprocket *s, double t) {
    double torque = s->torque, forward = s->sign * (s->angle - s->start_angle);
    for (int k = 0; k < (int)s->harmonics; k++)
        torque += s->harmonic[k].amplitude * cos(s->harmonic[k].order * forward + s->harmonic[k].phase);
    double resisting = s->sign * torque + s->viscous * s->omega + s->quadratic * s->omega * fabs(s->omega);
    return -resisting * ramp(t, s->load_ramp_time);
}

// Force of a penalty contact; keeps the approach speed of its first instant in *first (0: open).
static double penalty(double pen, double speed, double *first, const Law *law) {
    if (pen <= 0.0) { *first = 0.0; return 0.0; }
    if (*first == 0.0) *first = speed > law->speed_floor ? speed : law->speed_floor;
    double elastic = law->stiffness * (law->exponent == 1.0 ? pen : pow(pen, law->exponent));
    double share = speed / *first, most = law->most_damping * fabs(speed);
    double force = elastic * (1.0 + law->hysteresis * (share < 1.0 ? share : 1.0));
    if (force > elastic + most) force = elastic + most;
    if (force < elastic - most) force = elastic - most;
    return force > 0.0 ? force : 0.0;
}

static double sprocket_pass(int n, const Sprocket *s, const double *ex, const double *ey, const double *restrict x,
                            const double *restrict y, const double *restrict vx, const double *restrict vy,
                            double *restrict fx, double *restrict fy, int *restrict seat, double *restrict first) {
    double c = cos(s->angle), sn = sin(s->angle), moment = 0.0;
    int z = (int)s->teeth;
    for (int i = 0; i < n; i++) {
        double rx = x[i] - s->x, ry = y[i] - s->y, r2 = rx * rx + ry * ry;
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
        }
        double nx = ax * na - ay * nb, ny = ax * nb + ay * na;
        double speed = (-s->omega * ry - vx[i]) * nx + (s->omega * rx - vy[i]) * ny;
        double f = penalty(pen, speed, &first[i], &s->law);
        if (first[i] != 0.0) {
            fx[i] += f * nx, fy[i] += f * ny;
            moment += ry * (f * nx) - rx * (f * ny);
        }
    }
    return moment;
}

static void guide_pass(int n, const Guide *g, const double *restrict x, const double *restrict y, const double *restrict vx,
                       const double *restrict vy, double *restrict fx, double *restrict fy, double *restrict first) {
    double reach = g->end_radius + g->roller_radius;
    for (int i = 0; i < n; i++) {
        double qx = x[i] - g->x, qy = y[i] - g->y, along = qx * g->tx + qy * g->ty;
        if (!(along > -reach && along < g->length + reach)) { first[i] = 0.0; continue; }
        double across = qy * g->tx - qx * g->ty, pen = 0.0, na = 0.0, nb = 1.0;
        if (across > -g->end_radius && across < g->roller_radius) {
            double beyond = (along < 0.0 ? along : 0.0) + (along > g->length ? along - g->length : 0.0);
            if (beyond == 0.0) pen = g->roller_radius - across;
            else {
                double h = across + g->end_radius, d = sqrt(beyond * beyond + h * h);
                pen = g->roller_radius + g->end_radius - d, na = beyond / d, nb = h / d;
            }
        }
        double nx = g->tx * na - g->ty * nb, ny = g->tx * nb + g->ty * na;
        double f = penalty(pen, -(vx[i] * nx + vy[i] * ny), &first[i], &g->law);
        fx[i] += f * nx, fy[i] += f * ny;
    }
}

static void link_pass(int n, double k, double c, double p, const double *restrict x, const double *restrict y,
                      const double *restrict vx, const double *restrict vy, double *restrict tension, double *restrict lx,
                      double *restrict ly, double *restrict fx, double *restrict fy) {
    for (int i = 0; i < n; i++) {
        double dx = x[i + 1] - x[i], dy = y[i + 1] - y[i], wx = vx[i + 1] - vx[i], wy = vy[i + 1] - vy[i];
        double square = dx * dx + dy * dy, inverse = 1.0 / sqrt(square), ux = dx * inverse, uy = dy * inverse;
        tension[i] = k * (square * inverse - p) + c * (wx * ux + wy * uy);
        lx[i + 1] = tension[i] * ux, ly[i + 1] = tension[i] * uy;
        fx[i] = fy[i] = 0.0;
    }
}

static void kick_drift(int n, double im, double gx, double gy, double kick, double h, const double *restrict lx,
                       const double *restrict ly, const double *restrict fx, const double *restrict fy, double *restrict x,
                       double *restrict y, double *restrict vx, double *restrict vy) {
    for (int i = 0; i < n; i++) {
        vx[i] += kick * (im * (lx[i + 1] - lx[i] + fx[i]) + gx);
        vy[i] += kick * (im * (ly[i + 1] - ly[i] + fy[i]) + gy);
        x[i] += h * vx[i], y[i] += h * vy[i];
    }
}

int main(int argc, char **argv) {
    if (argc != 4) return fprintf(stderr, "usage: chain_reference IN OUT STEPS\n"), 2;
    FILE *in = fopen(argv[1], "rb");
    double head[12];
    if (!in || fread(head, sizeof head, 1, in) != 1) return fprintf(stderr, "cannot read %s\n", argv[1]), 2;
    int n = (int)head[0], S = (int)head[1], G = (int)head[2], steps = atoi(argv[3]);
    double h = head[3], p = head[4], k = head[5], c = head[6], im = 1.0 / head[7], gx = head[8], gy = head[9];
    Sprocket *sprocket = calloc(S, sizeof *sprocket);
    Guide *guide = calloc(G + 1, sizeof *guide);
    size_t row = n + 64;
    double *work = calloc((size_t)(11 + S + G) * row, sizeof(double)), *table[64][2];
    double *x = work, *y = x + row, *vx = y + row, *vy = vx + row, *tension = vy + row, *lx = tension + row, *ly = lx + row;
    double *fx = ly + row, *fy = fx + row, *first = fy + row;
    int *seat = malloc((size_t)S * row * sizeof(int));
    size_t got = fread(sprocket, sizeof *sprocket, S, in) + (G ? fread(guide, sizeof *guide, G, in) : 0);
    for (int r = 0; r < 4; r++) got += fread(work + r * row, sizeof(double), n, in);
    double held;
    for (int q = 0; q < S * n; q++) got += fread(&held, sizeof held, 1, in), seat[q / n * row + q % n] = (int)held;
    if (got != (size_t)(S + G + 4 * n + S * n)) return fprintf(stderr, "short input\n"), 2;
    for (int s = 0; s < S; s++) {
        int z = (int)sprocket[s].teeth;
        for (int a = 0; a < 2; a++) table[s][a] = malloc(z * sizeof(double));
        for (int j = 0; j < z; j++) table[s][0][j] = cos(2 * M_PI * j / z), table[s][1][j] = sin(2 * M_PI * j / z);
    }
    struct timespec begin, end;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &begin);
    for (int it = 0; it < steps; it++) {
        double t = it * h, moment[64], kick = it ? h : 0.5 * h;
        x[n] = x[0], y[n] = y[0], vx[n] = vx[0], vy[n] = vy[0];
        link_pass(n, k, c, p, x, y, vx, vy, tension, lx, ly, fx, fy);
        lx[0] = lx[n], ly[0] = ly[n];
        for (int s = 0; s < S; s++)
            moment[s] = sprocket_pass(n, &sprocket[s], table[s][0], table[s][1], x, y, vx, vy, fx, fy, seat + s * row,
                                      first + s * row);
        for (int g = 0; g < G; g++) guide_pass(n, &guide[g], x, y, vx, vy, fx, fy, first + (S + g) * row);
        for (int s = 0; s < S; s++) {
            Sprocket *q = &sprocket[s];
            if (q->prescribed != 0.0) {
                double angle = prescribed_angle(q, t + h);
                q->omega = (angle - q->angle) / h, q->angle = angle;
            } else {
                q->omega += kick * (moment[s] + load_moment(q, t)) * q->inverse_inertia;
                q->angle += h * q->omega;
            }
        }
        kick_drift(n, im, gx, gy, kick, h, lx, ly, fx, fy, x, y, vx, vy);
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &end);
    printf("%.9f\n", (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec));
    FILE *out = fopen(argv[2], "wb");
    for (int r = 0; r < 4; r++) fwrite(work + r * row, sizeof(double), n, out);
    return fclose(out);
}
