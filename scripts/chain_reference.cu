// The GPU benchmark's reference: the bare time loop of warpchain's block kernel, by hand in CUDA C++ for one kind of drive, whose
// numbers and precision are fixed when compiled: one block a variant, one roller a thread, one thread a body, neighbors through
// shuffles, the drive in shared memory, what a roller's contacts keep in registers. The physics stands in chain_reference.h.
// float32 is plain here: without low parts, the gap's geometry rounded like all else; bodies are in float64.
//   nvcc -O3 -arch=native -DREAL=float -DROLLERS=118 -DSPROCKETS=2 ... -o chain_reference_gpu chain_reference.cu
//   ./chain_reference_gpu IN OUT STEPS [VARIANTS]
// IN and OUT are those of chain_reference.c, OUT of variant 0; prints the time loop's seconds. benches/reference.py compiles it.
#include <cstdio>
#include <cstdlib>
#include <vector>
#include <cuda_runtime.h>
#include "chain_reference.h"

#define CHECK(call) do { cudaError_t e = (call); if (e != cudaSuccess) { \
    fprintf(stderr, "%s: %s\n", #call, cudaGetErrorString(e)); exit(1); } } while (0)

constexpr int N = ROLLERS, S = SPROCKETS, G = GUIDES, P = PIECES, A = ARMS, T = TENSIONERS;
constexpr bool rubs = RUBS;
constexpr int W = (N + 31) / 32, B = S + A;  // warps, bodies
constexpr unsigned ALL = 0xffffffffu;
static_assert(B <= W, "a warp moves one body at most");

struct Drive {
    Head head;
    Body body[B];
    Sprocket sprocket[S];
    Guide guide[G + 1];
    Piece piece[P + 1];
    Arm arm[A + 1];
    Tensioner tensioner[T + 1];
};

// A roller, and what its contacts keep: that with the sprocket `at`, the only one it is near, and those with guides.
struct State {
    Roller roller;
    int at, seat, piece[G + 1];
    Real joint_hold, first, hold, damper_speed, guide_first[G + 1], guide_hold[G + 1], guide_speed[G + 1];
};

// A thread's place in the ring of rollers. Warps exchange the values at their ends in shared memory, across a barrier.
struct Ring {
    int lane, warp, warp_after, warp_before;
    bool last;
    __device__ Ring(int i)
        : lane(i % 32), warp(i / 32), warp_after(i == N - 1 ? 0 : warp + 1), warp_before(warp ? warp - 1 : W - 1),
          last(i == N - 1 || (i < N && lane == 31)) {}
    __device__ void share_first(Real value, Real *ends) const { if (lane == 0) ends[warp] = value; }
    __device__ void share_last(Real value, Real *ends) const { if (last) ends[warp] = value; }
    __device__ Real next(Real value, const Real *ends) const {
        const Real got = __shfl_down_sync(ALL, value, 1);
        return last ? ends[warp_after] : got;
    }
    __device__ Real previous(Real value, const Real *ends) const {
        const Real got = __shfl_up_sync(ALL, value, 1);
        return lane == 0 ? ends[warp_before] : got;
    }
};

// Force on a roller of the links on either side, with friction of the joints.
__device__ Vector link_force(const Head &head, const Ring &ring, State &q) {
    __shared__ Real ends[9][W];
    const Vector at = q.roller.place, v = q.roller.velocity;
    ring.share_first(at.x, ends[0]), ring.share_first(at.y, ends[1]);
    ring.share_first(v.x, ends[2]), ring.share_first(v.y, ends[3]);
    __syncthreads();
    const Real dx = ring.next(at.x, ends[0]) - at.x, dy = ring.next(at.y, ends[1]) - at.y;
    const Real wx = ring.next(v.x, ends[2]) - v.x, wy = ring.next(v.y, ends[3]) - v.y;
    Real inverse, length = root(dx * dx + dy * dy, &inverse);
    const Real ux = dx * inverse, uy = dy * inverse;
    const Real tension = head.stiffness * (length - head.length) + head.damping * (wx * ux + wy * uy);
    Vector force = {tension * ux, tension * uy};
    if (rubs && head.joint.rubs != 0) {
        const Joint &joint = head.joint;
        const Real size = fabs(tension), turn = (wy * ux - wx * uy) * inverse;
        ring.share_last(size, ends[4]), ring.share_last(turn, ends[5]);
        __syncthreads();
        const Real before = ring.previous(size, ends[4]), slip = turn - ring.previous(turn, ends[5]);
        const Real most = MAX(before, size) * coefficient(fabs(slip) * joint.pin_radius, &joint.law) * joint.arm;
        const Real moment = -held_back(most, slip, &q.joint_hold, joint.spring, joint.damper);
        ring.share_first(moment, ends[6]);
        __syncthreads();
        const Real across = (ring.next(moment, ends[6]) - moment) * inverse;
        force.x -= across * uy, force.y += across * ux;
    }
    ring.share_last(force.x, ends[7]), ring.share_last(force.y, ends[8]);
    __syncthreads();
    force.x -= ring.previous(force.x, ends[7]), force.y -= ring.previous(force.y, ends[8]);
    return force;
}

// Adds a contact's push to the roller's acceleration and to the sums of its body.
__device__ void add(const Push &push, Real inverse_mass, int body, Roller &roller, Real *moment) {
    roller.acceleration.x += inverse_mass * push.x, roller.acceleration.y += inverse_mass * push.y;
    #pragma unroll
    for (int b = 0; b < B; ++b) if (b == body) moment[b] += push.moment;
}

// Contacts of a roller.
__device__ void contacts(const Drive &d, const Motion *motion, const Vector *seats, int most_teeth, Real inverse_mass, State &q,
                         Real *moment) {
    const Vector place = q.roller.place;
    const Sliding smooth = {};
    int now = -1;
    #pragma unroll
    for (int s = 0; s < S; ++s) if (is_near(&d.sprocket[s], &motion[s], place)) now = s;
    if (now != q.at) q.at = now, q.seat = -1, q.first = 0;
    if (now >= 0) {
        const Sprocket &s = d.sprocket[now];
        const Gap gap = tooth_gap(&s, &motion[now], seats + now * most_teeth, place, &q.seat);
        if (gap.penetration > -s.law.ahead) {
            const Push push = contact_push(&s.law, rubs ? &s.sliding : &smooth, &motion[now], &q.roller, gap, &q.first, &q.hold,
                                           &q.damper_speed);
            add(push, inverse_mass, now, q.roller, moment);
        } else q.first = 0;
    }
    #pragma unroll
    for (int k = 0; k < G; ++k) {
        const Guide &g = d.guide[k];
        const int b = A && g.body >= 0 ? (int)g.body : B;  // the last is the ground
        Gap gap;
        if (P && g.pieces > 0)
            gap = profile_gap(&g, d.piece + (int)g.first_piece, &motion[b], place, &q.piece[k], &q.guide_first[k]);
        else {
            Vector start = g.start, direction = g.direction;
            if (b != B) {
                start = turned(start, motion[b].heading), direction = turned(direction, motion[b].heading);
                start.x += motion[b].center.x, start.y += motion[b].center.y;
            }
            gap = bar_gap(&g, start, direction, place, &q.guide_first[k]);
        }
        if (gap.penetration > -g.law.ahead) {
            const Push push = contact_push(&g.law, rubs ? &g.sliding : &smooth, &motion[b], &q.roller, gap, &q.guide_first[k],
                                           &q.guide_hold[k], &q.guide_speed[k]);
            add(push, inverse_mass, b, q.roller, moment);
        }
    }
}

// Puts a warp's sums of values, one a body, in its column.
__device__ void sum_up(const Real *values, Real (*sums)[W], int lane, int warp) {
    #pragma unroll
    for (int b = 0; b < B; ++b) {
        Real sum = values[b];
        if (__any_sync(ALL, sum != 0))
            for (int o = 16; o; o /= 2) sum += __shfl_xor_sync(ALL, sum, o);
        if (lane == 0) sums[b][warp] = sum;
    }
}

__device__ double of_all(const Real *sums) {
    double sum = 0;
    for (int w = 0; w < W; ++w) sum += sums[w];
    return sum;
}

// Moment of a body's load or of its arm, with those of tensioners on it.
__device__ double own_moment(const Drive &d, int b, Point heading, double t) {
    const Body &body = d.body[b];
    if (body.prescribed != 0) return 0;
    double moment = b < S ? load_moment(&body, t) : arm_moment(&d.arm[b - S], &body, heading);
    for (int k = 0; k < T; ++k) if ((int)d.tensioner[k].body == b) moment += push_moment(&d.tensioner[k], &body, heading);
    return moment;
}

// Turns a heading by a small angle, by series, and keeps its length.
__device__ Point turned_on(Point heading, double d) {
    const double d2 = d * d, c = 1.0 - d2 * (0.5 - d2 / 24.0), s = d * (1.0 - d2 * (1.0 / 6.0 - d2 / 120.0));
    const Point to = {heading.x * c - heading.y * s, heading.y * c + heading.x * s};
    const double scale = 1.5 - 0.5 * (to.x * to.x + to.y * to.y);
    return {to.x * scale, to.y * scale};
}

__device__ Motion motion_of(const Body &b, Point heading) {
    return {{Real(b.x), Real(b.y)}, {Real(heading.x), Real(heading.y)}, Real(b.omega), Real(b.angular)};
}

// Registers are for 32 warps a multiprocessor, of 16, 20 .. 32 the fastest on an H200, although some are spilled.
__global__ void __launch_bounds__(32 * W, 32 / W)
march(const Drive *drives, const Vector *seats, int most_teeth, const double *rows, const double *seat0, Real *out, int steps) {
    __shared__ Drive d;
    __shared__ Motion motion[B + 1];
    __shared__ Real moments[B][W];
    const int i = threadIdx.x, j = i < N ? i : N - 1;  // threads beyond the rollers hold the last, without contacts
    const Ring ring(i);
    const int mine = ring.lane == 0 && ring.warp < B ? ring.warp : -1;
    if (i == 0) d = drives[blockIdx.x], motion[B] = {{0, 0}, {1, 0}, 0, 0};
    __syncthreads();
    State q = {{{Real(rows[j]), Real(rows[N + j])}, {Real(rows[2 * N + j]), Real(rows[3 * N + j])}, {0, 0}}, -1, -1};
    for (int s = 0; s < S; ++s) if (seat0[s * N + j] >= 0) q.at = s, q.seat = int(seat0[s * N + j]);
    for (int g = 0; g < G; ++g) q.piece[g] = int(seat0[(S + g) * N + j]);
    const Real h = d.head.step, inverse_mass = 1 / d.head.mass;
    Point heading = {1, 0};
    if (mine >= 0) {
        sincos(d.body[mine].angle, &heading.y, &heading.x);
        motion[mine] = motion_of(d.body[mine], heading);
    }
    for (int it = 0; it < steps; ++it) {
        const Real kick = it ? h : h / 2;
        const Vector force = link_force(d.head, ring, q);
        double t = 0, own = 0;
        if (mine >= 0) t = it * double(h), own = own_moment(d, mine, heading, t);
        Real moment[B] = {};
        q.roller.acceleration.x = inverse_mass * force.x + d.head.gravity.x;
        q.roller.acceleration.y = inverse_mass * force.y + d.head.gravity.y;
        if (i < N) contacts(d, motion, seats, most_teeth, inverse_mass, q, moment);
        sum_up(moment, moments, ring.lane, ring.warp);
        __syncthreads();
        q.roller.velocity.x += kick * q.roller.acceleration.x, q.roller.velocity.y += kick * q.roller.acceleration.y;
        q.roller.place.x += h * q.roller.velocity.x, q.roller.place.y += h * q.roller.velocity.y;
        if (mine >= 0) {
            Body &b = d.body[mine];
            const double before = b.angle;
            move_body(&b, of_all(moments[mine]) + own, t, kick, h);
            heading = turned_on(heading, b.angle - before);
            motion[mine] = motion_of(b, heading);
            for (int k = 0; k < T; ++k) if ((int)d.tensioner[k].body == mine) flow(&d.tensioner[k], &b, heading, h);
        }
    }
    if (i < N && blockIdx.x == 0) {
        out[i] = q.roller.place.x, out[N + i] = q.roller.place.y;
        out[2 * N + i] = q.roller.velocity.x, out[3 * N + i] = q.roller.velocity.y;
    }
}

// Structs of numbers of a type, from the doubles of a file.
template <class Number, class Struct> void read_into(Struct *to, int count, FILE *in) {
    Number *at = (Number *)to;
    for (size_t k = 0; k < count * sizeof(Struct) / sizeof(Number); ++k) {
        double value;
        if (fread(&value, sizeof value, 1, in) != 1) fprintf(stderr, "short input\n"), exit(2);
        at[k] = Number(value);
    }
}

template <class Number> Number *copied(const std::vector<Number> &from) {
    Number *to;
    CHECK(cudaMalloc(&to, from.size() * sizeof(Number)));
    CHECK(cudaMemcpy(to, from.data(), from.size() * sizeof(Number), cudaMemcpyHostToDevice));
    return to;
}

int main(int argc, char **argv) {
    if (argc < 4) return fprintf(stderr, "usage: chain_reference_gpu IN OUT STEPS [VARIANTS]\n"), 2;
    FILE *in = fopen(argv[1], "rb");
    if (!in) return fprintf(stderr, "cannot read %s\n", argv[1]), 2;
    const int steps = atoi(argv[3]), variants = argc > 4 ? atoi(argv[4]) : 1;
    Drive d{};
    read_into<Real>(&d.head, 1, in);
    const Head &head = d.head;
    if (head.rollers != N || head.sprockets != S || head.guides != G || head.pieces != P || head.arms != A || head.tensioners != T)
        return fprintf(stderr, "compiled for drives of another kind\n"), 2;
    read_into<double>(d.body, B, in), read_into<Real>(d.sprocket, S, in), read_into<Real>(d.guide, G, in);
    read_into<Real>(d.piece, P, in), read_into<double>(d.arm, A, in), read_into<double>(d.tensioner, T, in);
    std::vector<double> rows(4 * N), seat0((S + G) * N);
    read_into<double>(rows.data(), rows.size(), in), read_into<double>(seat0.data(), seat0.size(), in);
    if (fgetc(in) != EOF) return fprintf(stderr, "long input\n"), 2;
    int most_teeth = 0;
    for (const Sprocket &s : d.sprocket) most_teeth = MAX(most_teeth, (int)s.teeth);
    std::vector<Vector> seats(S * most_teeth);
    for (int s = 0; s < S; ++s) for (int z = (int)d.sprocket[s].teeth, j = 0; j < z; ++j)
        seats[s * most_teeth + j] = {Real(cos(2 * M_PI * j / z)), Real(sin(2 * M_PI * j / z))};
    std::vector<Real> result(4 * N);
    const Drive *drives = copied(std::vector<Drive>(variants, d));
    const Vector *directions = copied(seats);
    const double *from = copied(rows), *seats_from = copied(seat0);
    Real *out = copied(result);
    cudaEvent_t begin, end;
    CHECK(cudaEventCreate(&begin)); CHECK(cudaEventCreate(&end));
    float best = 1e30f, ms;
    for (int round = 0; round < 4; ++round) {
        CHECK(cudaEventRecord(begin));
        march<<<variants, 32 * W>>>(drives, directions, most_teeth, from, seats_from, out, steps);
        CHECK(cudaEventRecord(end)); CHECK(cudaEventSynchronize(end)); CHECK(cudaEventElapsedTime(&ms, begin, end));
        if (round && ms < best) best = ms;
    }
    printf("%.9f\n", best * 1e-3);
    CHECK(cudaMemcpy(result.data(), out, result.size() * sizeof(Real), cudaMemcpyDeviceToHost));
    const std::vector<double> final(result.begin(), result.end());
    FILE *f = fopen(argv[2], "wb");
    fwrite(final.data(), sizeof(double), final.size(), f);
    return fclose(f);
}
