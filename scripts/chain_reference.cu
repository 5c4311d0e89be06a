// The GPU benchmark's reference: the bare time loop of warpchain's block kernel, by hand in CUDA C++ for one kind of drive at a
// time (numbers of sprockets and guide-bars fixed at compile time): one block a variant, one roller a thread, neighbors
// through shuffles, two barriers a step, teeth in shared memory, a roller's seat and contact memory in registers.
// float32 is plain here: without low parts, the gap's geometry rounded like all else.
//   nvcc -O3 -arch=native -o chain_reference_gpu chain_reference.cu && ./chain_reference_gpu IN OUT STEPS VARIANTS...
// IN is that of chain_reference.c, OUT gets variant 0's final x, y, vx, vy in float64; prints a line a case:
// bytes of a number, variants, seconds.
#include <cstdio>
#include <cstdlib>
#include <vector>
#include <cuda_runtime.h>

#define CHECK(call) do { cudaError_t e = (call); if (e != cudaSuccess) { \
    fprintf(stderr, "%s: %s\n", #call, cudaGetErrorString(e)); exit(1); } } while (0)

struct LawIn { double stiffness, exponent, hysteresis, floor, most; };
struct SprocketIn {
    double x, y, radius, near2, far2, tangent, clearance, cos_half, sin_half, tip;
    LawIn law;
    double prescribed, sign, inverse_inertia, speed, ramp_time, start_angle, torque, viscous, quadratic, load_ramp_time;
    double harmonics, teeth, harmonic[8][3], angle, omega;
};
struct GuideIn { double x, y, tx, ty, length, end_radius, roller_radius; LawIn law; };
struct Head { double n, sprockets, guides, h, pitch, stiffness, damping, mass, gx, gy, unused[2]; };
struct Input { Head head; std::vector<SprocketIn> sprocket; std::vector<GuideIn> guide; std::vector<double> rows, seats; };

template <class R> struct Law { R stiffness, exponent, hysteresis, floor, most; };
template <class R> struct Teeth { R x, y, radius, near2, far2, tangent, clearance, cos_half, sin_half, tip; Law<R> law; int z, first; };
template <class R> struct Bar { R x, y, tx, ty, length, end_radius, roller_radius; Law<R> law; };
template <class R, int S, int G> struct Parameters {
    int n; R h, pitch, stiffness, damping, inverse_mass, gx, gy;
    Teeth<R> teeth[S]; Bar<R> bar[G + 1]; SprocketIn body[S];
};

__device__ inline double root(double a) { return rsqrt(a); }
__device__ inline float root(float a) { return rsqrtf(a); }
__device__ inline double ramp(double t, double d) { if (t >= d) return 1.0; double u = t / d; return u * u * (3.0 - 2.0 * u); }
__device__ inline double ramped(double t, double d) {
    if (t >= d) return t - 0.5 * d; double u = t / d; return d * u * u * u * (1.0 - 0.5 * u);
}
template <class R> __device__ inline R penalty(R pen, R speed, R &inverse_first, const Law<R> &law) {
    if (!(pen > R(0))) { inverse_first = R(0); return R(0); }
    if (inverse_first == R(0)) inverse_first = R(1) / max(speed, law.floor);
    R elastic = law.exponent == R(1) ? law.stiffness * pen : law.stiffness * exp(law.exponent * log(pen));
    const R most = law.most * fabs(speed), force = elastic * (R(1) + law.hysteresis * min(speed * inverse_first, R(1)));
    return max(R(0), min(max(force, elastic - most), elastic + most));
}

template <class R, int S, int G, int B>
__global__ void __launch_bounds__(B) march(const Parameters<R, S, G> *parameters, const double2 *seats, const double *rows, const int *seat0, R *out, int steps) {
    constexpr int W = B / 32;
    constexpr unsigned all = 0xffffffffu;
    __shared__ Parameters<R, S, G> p;
    __shared__ R first[W][4], edge[W][2], part[W][S];
    __shared__ R cs[S], sn[S], om[S];
    const int i = threadIdx.x, lane = i & 31, warp = i >> 5;
    if (i == 0) p = parameters[blockIdx.x];
    __syncthreads();
    const int n = p.n, j0 = i < n ? i : n - 1;
    const bool live = i < n, last = live && (lane == 31 || i == n - 1);
    R x = R(rows[j0]), y = R(rows[n + j0]), vx = R(rows[2 * n + j0]), vy = R(rows[3 * n + j0]);
    int at = -1, seat = 0;
    R memory = R(0), guide_memory[G + 1] = {};
    for (int s = 0; s < S; ++s) if (live && seat0[s * n + i] >= 0) at = s, seat = seat0[s * n + i];
    const int mine = lane == 0 && warp < S ? warp : -1;  // one thread of a warp moves a sprocket (S <= W)
    double angle = 0, omega = 0, c = 0, sine = 0;
    if (mine >= 0) {
        angle = p.body[mine].angle, omega = p.body[mine].omega;
        sincos(angle, &sine, &c);
        cs[mine] = R(c), sn[mine] = R(sine), om[mine] = R(omega);
    }
    for (int it = 0; it < steps; ++it) {
        const R kick = it ? p.h : R(0.5) * p.h;
        if (lane == 0) first[warp][0] = x, first[warp][1] = y, first[warp][2] = vx, first[warp][3] = vy;
        __syncthreads();
        R dx = __shfl_down_sync(all, x, 1), dy = __shfl_down_sync(all, y, 1);
        R wx = __shfl_down_sync(all, vx, 1), wy = __shfl_down_sync(all, vy, 1);
        if (last) { const R *e = first[i + 1 < n ? warp + 1 : 0]; dx = e[0], dy = e[1], wx = e[2], wy = e[3]; }
        dx -= x, dy -= y, wx -= vx, wy -= vy;
        const R square = dx * dx + dy * dy, inverse = root(square), ux = dx * inverse, uy = dy * inverse;
        const R tension = p.stiffness * (square * inverse - p.pitch) + p.damping * (wx * ux + wy * uy);
        const R lx = tension * ux, ly = tension * uy;
        R bx = __shfl_up_sync(all, lx, 1), by = __shfl_up_sync(all, ly, 1);
        if (last) edge[warp][0] = lx, edge[warp][1] = ly;
        R fx = lx, fy = ly, moment[S] = {};
        int now = -1;
        #pragma unroll
        for (int s = 0; s < S; ++s) {
            const R rx = x - p.teeth[s].x, ry = y - p.teeth[s].y, r2 = rx * rx + ry * ry;
            if (live && r2 > p.teeth[s].near2 && r2 < p.teeth[s].far2) now = s;
        }
        if (now < 0) at = -1, memory = R(0);
        else {
            const Teeth<R> &t = p.teeth[now];
            const R rx = x - t.x, ry = y - t.y, co = cs[now], si = sn[now];
            if (now != at) {
                at = now, memory = R(0);
                seat = (int)rint(atan2f(float(ry * co - rx * si), float(rx * co + ry * si)) * t.z * 0.15915494f);
                seat += seat < 0 ? t.z : seat >= t.z ? -t.z : 0;
            }
            double2 e = seats[t.first + seat];
            R ax = R(e.x) * co - R(e.y) * si, ay = R(e.x) * si + R(e.y) * co;
            R radial = rx * ax + ry * ay, lateral = ry * ax - rx * ay;
            if (fabs(lateral) > t.tangent * radial) {
                seat += lateral > R(0) ? 1 : -1;
                seat += seat < 0 ? t.z : seat >= t.z ? -t.z : 0;
                e = seats[t.first + seat];
                ax = R(e.x) * co - R(e.y) * si, ay = R(e.x) * si + R(e.y) * co;
                radial = rx * ax + ry * ay, lateral = ry * ax - rx * ay;
            }
            const R xi = radial - t.radius, eta = fabs(lateral);
            R pen = eta * t.sin_half - xi * t.cos_half - t.clearance, na = t.cos_half, nb = lateral >= R(0) ? -t.sin_half : t.sin_half;
            if (eta * t.cos_half <= -xi * t.sin_half) {
                const R q = max(xi * xi + lateral * lateral, R(1e-24)), k = root(q);
                pen = q * k - t.clearance, na = -xi * k, nb = -lateral * k;
            }
            const R reach = max(t.tip - pen, R(0)), far = radial * radial + lateral * lateral;
            if (pen > R(0) && far > reach * reach) { const R k = root(far); pen = t.tip - far * k, na = radial * k, nb = lateral * k; }
            const R nx = ax * na - ay * nb, ny = ax * nb + ay * na;
            const R speed = (-om[now] * ry - vx) * nx + (om[now] * rx - vy) * ny, f = penalty(pen, speed, memory, t.law);
            fx += f * nx, fy += f * ny;
            #pragma unroll
            for (int s = 0; s < S; ++s) if (s == now) moment[s] = ry * f * nx - rx * f * ny;
        }
        #pragma unroll
        for (int g = 0; g < G; ++g) {
            const Bar<R> &b = p.bar[g];
            const R qx = x - b.x, qy = y - b.y, along = qx * b.tx + qy * b.ty, across = qy * b.tx - qx * b.ty;
            R pen = R(0), na = R(0), nb = R(1);
            if (live && across > -b.end_radius && across < b.roller_radius) {
                const R beyond = min(along, R(0)) + max(along - b.length, R(0)), up = across + b.end_radius;
                if (beyond == R(0)) pen = b.roller_radius - across;
                else { const R q = beyond * beyond + up * up, k = root(q); pen = b.roller_radius + b.end_radius - q * k, na = beyond * k, nb = up * k; }
            }
            const R nx = b.tx * na - b.ty * nb, ny = b.tx * nb + b.ty * na;
            const R f = penalty(pen, -(vx * nx + vy * ny), guide_memory[g], b.law);
            fx += f * nx, fy += f * ny;
        }
        #pragma unroll
        for (int s = 0; s < S; ++s) {
            R t = moment[s];
            if (__any_sync(all, t != R(0)))
                for (int o = 16; o; o >>= 1) t += __shfl_xor_sync(all, t, o);
            if (lane == 0) part[warp][s] = t;
        }
        __syncthreads();
        if (lane == 0) { const R *e = edge[warp ? warp - 1 : (n - 1) >> 5]; bx = e[0], by = e[1]; }
        vx += kick * (p.inverse_mass * (fx - bx) + p.gx), vy += kick * (p.inverse_mass * (fy - by) + p.gy);
        x += p.h * vx, y += p.h * vy;
        if (mine >= 0) {
            const SprocketIn &b = p.body[mine];
            const double h = p.h, time = it * h, before = angle;
            if (b.prescribed != 0.0) {
                const double phi = b.speed * ramped(time + h, b.ramp_time);
                double turned = phi;
                for (int k = 0; k < (int)b.harmonics; ++k)
                    turned += b.harmonic[k][1] / b.harmonic[k][0] * (sin(b.harmonic[k][0] * phi + b.harmonic[k][2]) - sin(b.harmonic[k][2]));
                angle = b.start_angle + b.sign * turned, omega = (angle - before) / h;
            } else {
                double total = 0, torque = b.torque;
                for (int w = 0; w < W; ++w) total += part[w][mine];
                for (int k = 0; k < (int)b.harmonics; ++k)
                    torque += b.harmonic[k][1] * cos(b.harmonic[k][0] * b.sign * (angle - b.start_angle) + b.harmonic[k][2]);
                const double load = -(b.sign * torque + b.viscous * omega + b.quadratic * omega * fabs(omega)) * ramp(time, b.load_ramp_time);
                omega += double(kick) * (total + load) * b.inverse_inertia, angle += h * omega;
            }
            const double d = angle - before, d2 = d * d, cd = 1.0 - d2 * (0.5 - d2 / 24.0), sd = d * (1.0 - d2 * (1.0 / 6.0 - d2 / 120.0));
            const double c1 = c * cd - sine * sd, s1 = sine * cd + c * sd, scale = 1.5 - 0.5 * (c1 * c1 + s1 * s1);
            c = c1 * scale, sine = s1 * scale;
            cs[mine] = R(c), sn[mine] = R(sine), om[mine] = R(omega);
        }
    }
    if (live && blockIdx.x == 0) out[i] = x, out[n + i] = y, out[2 * n + i] = vx, out[3 * n + i] = vy;
}

template <class R> Law<R> law_of(const LawIn &l) { return {R(l.stiffness), R(l.exponent), R(l.hysteresis), R(l.floor), R(l.most)}; }

template <class R, int S, int G, int B> void time_case(const Input &in, int variants, int steps, const char *file) {
    Parameters<R, S, G> p{};
    const Head &d = in.head;
    p.n = (int)d.n, p.h = R(d.h), p.pitch = R(d.pitch), p.stiffness = R(d.stiffness), p.damping = R(d.damping);
    p.inverse_mass = R(1.0 / d.mass), p.gx = R(d.gx), p.gy = R(d.gy);
    std::vector<double2> seats;
    for (int s = 0; s < S; ++s) {
        const SprocketIn &q = in.sprocket[s];
        const int z = (int)q.teeth;
        p.teeth[s] = {R(q.x), R(q.y), R(q.radius), R(q.near2), R(q.far2), R(q.tangent), R(q.clearance), R(q.cos_half), R(q.sin_half), R(q.tip), law_of<R>(q.law), z, (int)seats.size()};
        p.body[s] = q;
        for (int j = 0; j < z; ++j) seats.push_back({cos(2 * M_PI * j / z), sin(2 * M_PI * j / z)});
    }
    for (int g = 0; g < G; ++g) {
        const GuideIn &q = in.guide[g];
        p.bar[g] = {R(q.x), R(q.y), R(q.tx), R(q.ty), R(q.length), R(q.end_radius), R(q.roller_radius), law_of<R>(q.law)};
    }
    std::vector<Parameters<R, S, G>> all(variants, p);
    std::vector<int> held(in.seats.begin(), in.seats.end());
    Parameters<R, S, G> *dp; double2 *ds; double *dr; int *dh; R *out;
    CHECK(cudaMalloc(&dp, all.size() * sizeof p)); CHECK(cudaMalloc(&ds, seats.size() * sizeof(double2)));
    CHECK(cudaMalloc(&dr, in.rows.size() * 8)); CHECK(cudaMalloc(&dh, held.size() * 4)); CHECK(cudaMalloc(&out, 4 * p.n * sizeof(R)));
    CHECK(cudaMemcpy(dp, all.data(), all.size() * sizeof p, cudaMemcpyHostToDevice));
    CHECK(cudaMemcpy(ds, seats.data(), seats.size() * sizeof(double2), cudaMemcpyHostToDevice));
    CHECK(cudaMemcpy(dr, in.rows.data(), in.rows.size() * 8, cudaMemcpyHostToDevice));
    CHECK(cudaMemcpy(dh, held.data(), held.size() * 4, cudaMemcpyHostToDevice));
    cudaEvent_t begin, end;
    CHECK(cudaEventCreate(&begin)); CHECK(cudaEventCreate(&end));
    float best = 1e30f, ms;
    for (int round = 0; round < 4; ++round) {
        CHECK(cudaEventRecord(begin));
        march<R, S, G, B><<<variants, B>>>(dp, ds, dr, dh, out, steps);
        CHECK(cudaEventRecord(end)); CHECK(cudaEventSynchronize(end)); CHECK(cudaEventElapsedTime(&ms, begin, end));
        if (round && ms < best) best = ms;
    }
    printf("%d %d %.9f\n", (int)sizeof(R), variants, best * 1e-3);
    std::vector<R> rows(4 * p.n);
    CHECK(cudaMemcpy(rows.data(), out, rows.size() * sizeof(R), cudaMemcpyDeviceToHost));
    if (sizeof(R) == 8 && file) { FILE *f = fopen(file, "wb"); fwrite(rows.data(), 8, rows.size(), f); fclose(f); }
    cudaFree(dp); cudaFree(ds); cudaFree(dr); cudaFree(dh); cudaFree(out);
}

int main(int argc, char **argv) {
    if (argc < 5) return fprintf(stderr, "usage: chain_reference_gpu IN OUT STEPS VARIANTS...\n"), 2;
    Input in;
    FILE *f = fopen(argv[1], "rb");
    if (!f || fread(&in.head, sizeof in.head, 1, f) != 1) return fprintf(stderr, "cannot read %s\n", argv[1]), 2;
    const int n = (int)in.head.n, S = (int)in.head.sprockets, G = (int)in.head.guides, steps = atoi(argv[3]);
    in.sprocket.resize(S), in.guide.resize(G), in.rows.resize(4 * n), in.seats.resize(S * n);
    size_t got = fread(in.sprocket.data(), sizeof(SprocketIn), S, f) + fread(in.guide.data(), sizeof(GuideIn), G, f);
    got += fread(in.rows.data(), 8, 4 * n, f) + fread(in.seats.data(), 8, S * n, f);
    if (got != (size_t)(S + G + 4 * n + S * n)) return fprintf(stderr, "short input\n"), 2;
    for (int k = 4; k < argc; ++k) {
        const int v = atoi(argv[k]);
        if (S == 2 && G == 0 && n <= 128) { time_case<double, 2, 0, 128>(in, v, steps, k == 4 ? argv[2] : 0); time_case<float, 2, 0, 128>(in, v, steps, 0); }
        else if (S == 3 && G == 1 && n <= 192) { time_case<double, 3, 1, 192>(in, v, steps, k == 4 ? argv[2] : 0); time_case<float, 3, 1, 192>(in, v, steps, 0); }
        else return fprintf(stderr, "no case for %d sprockets, %d guide-bars, %d rollers\n", S, G, n), 2;
    }
    return 0;
}
