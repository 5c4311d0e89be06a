"""The chain alone against closed forms: modes of a strand, centrifugal tension, conservation, order of convergence."""

import numpy as np
import pytest
import warp as wp
from raw import chain, polygon, run, state
from scipy.integrate import solve_ivp

from warpchain.kernels.cpu.rollers import ROWS, roller_functions
from warpchain.kernels.structs import types

M, PITCH, MASS, STIFFNESS = 9, 0.1, 2.0, 5e6


def strand_frequency(direction, k, tension=2000.0):
    """Frequency [Hz] of a strand of M masses between fixed ends, started in mode k with a small amplitude."""
    real = wp.float64
    rollers, kinds = roller_functions(real, 264), types(real)

    @wp.kernel(enable_backward=False, module="unique")
    def vibrate(w: wp.array[wp.float64], chain: kinds.Chain, h: real, steps: int, out: wp.array[wp.float64],
                row: int, watched: int, base: real):  # fmt: skip
        # rollers 0 and n - 1 are held; the link that would close the loop acts between held ends only
        n = int(M + 2)
        for step in range(steps):
            rollers.find_link_forces(w, n, chain)
            rollers.kick_and_drift(w, n, chain, h, h)
            for end in range(2):
                i = end * (n - 1)
                w[i] = wp.float64(i) * base
                w[264 + i] = wp.float64(0.0)
                w[2 * 264 + i] = wp.float64(0.0)
                w[3 * 264 + i] = wp.float64(0.0)
            out[step] = w[row * 264 + watched] - wp.where(row == 0, wp.float64(watched) * base, wp.float64(0.0))

    spacing = PITCH * (1 + tension / (STIFFNESS * PITCH))
    rows = np.zeros((len(ROWS), 264))
    rows[ROWS.index("length")] = PITCH
    rows[ROWS.index("mobility")] = 1.0
    rows[0, : M + 2] = spacing * np.arange(M + 2)
    shape = 1e-7 * np.sin(k * np.pi * np.arange(M + 2) / (M + 1))
    rows[direction, : M + 2] += shape
    law = kinds.Chain()
    law.stiffness, law.damping, law.mass, law.inverse_mass = STIFFNESS, 0.0, MASS, 1.0 / MASS
    h = 0.002 * np.pi * np.sqrt(MASS / STIFFNESS)
    expected = closed_form(direction, k, tension)
    steps = int(20 / (expected * h))
    out = wp.zeros(steps, dtype=wp.float64, device="cpu")
    scratch = wp.array(rows.ravel(), dtype=wp.float64, device="cpu")
    wp.launch(vibrate, dim=1, inputs=[scratch, law, h, steps, out, direction, 1 + M // (2 * k), spacing], device="cpu")
    signal = out.numpy()
    rising = np.flatnonzero((signal[:-1] < 0) & (signal[1:] >= 0))
    crossings = rising + signal[rising] / (signal[rising] - signal[rising + 1])
    return (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * h), expected


def closed_form(direction, k, tension):
    """f_k = (1/pi) sqrt(T / (m l)) sin(k pi / (2 (M + 1))) across, with k instead of T / l along; l the stretched
    pitch.
    """
    stretched = PITCH * (1 + tension / (STIFFNESS * PITCH))
    rate = STIFFNESS if direction == 0 else tension / stretched
    return np.sqrt(rate / MASS) / np.pi * np.sin(k * np.pi / (2 * (M + 1)))


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("direction", [0, 1], ids=["axial", "transverse"])
def test_strand_vibrates_at_its_closed_form(direction, k):
    # leapfrog shortens periods by (omega h)^2 / 24 < 2e-6; crossings are interpolated; small amplitude: 1e-7 m on 0.1 m
    found, expected = strand_frequency(direction, k)
    assert found == pytest.approx(expected, rel=2e-6)


def test_spinning_ring_carries_centrifugal_tension():
    # T = (m / p) v^2 exactly, on the polygon that the ring has stretched to
    n, omega = 40, 30.0
    vertices, radius = polygon(n, PITCH)
    # radius at which k (L - p) holds m omega^2 r: 2 T sin(pi / n) = m omega^2 r and L = 2 r sin(pi / n)
    s = 2 * np.sin(np.pi / n)
    r = STIFFNESS * PITCH * s / (STIFFNESS * s * s - MASS * omega**2)
    position = vertices * r / radius
    velocity = omega * np.stack([-position[:, 1], position[:, 0]], axis=1)
    steps = 20000
    packed = chain(position, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=1e-6, steps=steps,
                   window=(0, steps))  # fmt: skip
    engine, _ = run(packed)
    sums = engine.sums()["chain"][0]
    expected = MASS * omega**2 * r / s  # = (m / l) v^2 with v = omega r and l = r s, the stretched pitch
    # leapfrog's own circle is off by (omega h)^2 / 12 < 1e-10 of its radius, which links of k p = 68 T turn into 5e-9
    assert sums["tension"] / sums["samples"] / n == pytest.approx(expected, rel=1e-8)
    assert sums["tension_max"] - sums["tension_min"] < 1e-8 * expected


def test_chain_conserves_energy_and_momentum():
    # leapfrog keeps the energy of a mode omega but for (omega h)^2 / 4 of it; no mode is faster than 2 sqrt(k / m)
    n = 24
    vertices, _ = polygon(n, PITCH)
    rng = np.random.default_rng(7)
    velocity = rng.normal(scale=0.3, size=(n, 2))
    errors, sizes = [], (16e-6, 8e-6, 4e-6, 2e-6)
    for step in sizes:
        packed = chain(vertices, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, gravity=(0.0, -9.81),
                       step=step, steps=round(0.04 / step))  # fmt: skip
        sums = run(packed)[0].sums()["chain"][0]
        errors.append(sums["energy_end"] - sums["energy_start"])
    largest = (2.0 * np.sqrt(STIFFNESS / MASS) * np.array(sizes)) ** 2
    energy = 0.5 * MASS * (velocity**2).sum()
    assert (np.abs(errors) < 0.25 * largest * energy).all()
    # second order: a quarter with half the step, but for a part of the order of the next term, (omega h)^2 < 3e-3
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=4e-3)
    packed = chain(vertices, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=8e-6, steps=5000)
    x, y, vx, vy = state(run(packed)[0])
    # forces between two rollers are opposite to the last bit; what is left is the rounding of 5000 sums
    np.testing.assert_allclose([vx.sum(), vy.sum()], velocity.sum(axis=0), atol=1e-11)


def test_energy_does_not_drift_over_a_million_steps():
    n = 12
    vertices, _ = polygon(n, PITCH)
    velocity = np.random.default_rng(3).normal(scale=0.3, size=(n, 2))
    extremes = []
    for window in ((0, 200_000), (800_000, 1_000_000)):
        packed = chain(vertices, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=2e-5, steps=1_000_000,
                       window=window)  # fmt: skip
        sums = run(packed)[0].sums()["chain"][0]
        extremes += [sums["energy_start"], sums["energy_end"]]
    # the error oscillates by at most (omega h)^2 / 4 of the energy, omega = 2 sqrt(k / m): 1e-3; drift would add up
    assert np.ptp(extremes) < STIFFNESS / MASS * 2e-5**2 * extremes[0]


def reference(position, velocity, duration, damping):
    """The same chain by scipy's DOP853 at tight tolerance."""

    def slope(_, flat):
        x, v = flat.reshape(2, -1, 2)
        d = np.roll(x, -1, axis=0) - x
        length = np.hypot(*d.T)[:, None]
        u = d / length
        rate = ((np.roll(v, -1, axis=0) - v) * u).sum(axis=1, keepdims=True)
        force = (STIFFNESS * (length - PITCH) + damping * rate) * u
        return np.stack([v, (force - np.roll(force, 1, axis=0)) / MASS + [0.0, -9.81]]).ravel()

    start = np.stack([position, velocity]).ravel()
    end = solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return end.reshape(2, -1, 2)[0]


@pytest.mark.parametrize(
    ("integrator", "damping", "order"), [("leapfrog", 0.0, 2), ("leapfrog", 200.0, 1), ("rk4", 200.0, 4)]
)
def test_order_of_convergence_against_dop853(integrator, damping, order):
    # smooth motion; leapfrog's damping reads the speed half a step late, which costs one order
    position, _ = polygon(16, PITCH)
    velocity = np.random.default_rng(5).normal(scale=0.2, size=position.shape)
    exact = reference(position, velocity, 0.004, damping)
    errors = []
    for steps in (200, 400, 800):
        packed = chain(position, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, damping=damping,
                       gravity=(0.0, -9.81), step=0.004 / steps, steps=steps, integrator=integrator)  # fmt: skip
        found = state(run(packed)[0])[:2].T
        errors.append(np.abs(found - exact).max())
    # the next term of the error is at most omega h = 0.06 of the first, with omega = 2 sqrt(k / m): 0.1 in the order
    observed = np.log2(errors[0] / errors[1]), np.log2(errors[1] / errors[2])
    assert np.allclose(observed, order, atol=0.1), (errors, observed)


def seated_reference(position, velocity, duration, inertia, torque, stiffness, speed):
    """A ring pressed into the seats of a free sprocket, by DOP853: seats without clearance are springs to seat j."""
    n = len(position)
    radius = PITCH / (2 * np.sin(np.pi / n))
    seat = 2 * np.pi * np.arange(n) / n

    def slope(_, state):
        x, v = state[: 4 * n].reshape(2, n, 2)
        theta, omega = state[4 * n :]
        d = np.roll(x, -1, axis=0) - x
        length = np.hypot(*d.T)[:, None]
        link = STIFFNESS * (length - 0.999 * PITCH) * d / length
        hold = stiffness * (radius * np.stack([np.cos(theta + seat), np.sin(theta + seat)], axis=1) - x)
        moment = -(x[:, 0] * hold[:, 1] - x[:, 1] * hold[:, 0]).sum()
        force = (link - np.roll(link, 1, axis=0) + hold) / MASS
        return np.concatenate([v.ravel(), force.ravel(), [omega, (moment - torque) / inertia]])

    start = np.concatenate([position.ravel(), velocity.ravel(), [0.0, speed]])
    return solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


@pytest.mark.parametrize(("integrator", "order"), [("leapfrog", 2), ("rk4", 4)])
def test_a_small_drive_against_dop853(integrator, order):
    # links 0.1 % short press every roller into its seat's arc, where the force is smooth; e = 1, no damping
    n, inertia, torque, stiffness, speed, duration = 20, 3.0, 500.0, 2e7, 4.0, 0.004
    vertices, radius = polygon(n, PITCH)
    inward = 2 * STIFFNESS * 0.001 * PITCH * np.sin(np.pi / n) / stiffness
    position = vertices * (1 - inward / radius)
    velocity = speed * np.stack([-position[:, 1], position[:, 0]], axis=1)
    velocity += np.random.default_rng(2).normal(scale=1e-3, size=velocity.shape)
    exact = seated_reference(position, velocity, duration, inertia, torque, stiffness, speed)
    errors = []
    for steps in (200, 400, 800):
        sprocket = {"teeth": n, "stiffness": stiffness, "inertia": inertia, "speed": speed, "load": (torque, 0.0, 0.0)}
        packed = chain(position, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, sprockets=[sprocket],
                       step=duration / steps, steps=steps, integrator=integrator)  # fmt: skip
        packed.lengths[:] = 0.999 * PITCH
        engine, _ = run(packed)
        apart = np.abs(state(engine)[:2].T.ravel() - exact[: 2 * n]).max()
        turned = abs(engine.state.bodies.numpy()[0]["angle"] - exact[4 * n])
        errors.append(max(apart, turned))
    observed = np.log2(errors[0] / errors[1]), np.log2(errors[1] / errors[2])
    # as above; rk4's last error, 1.3e-13 m, is half rounding: 0.2 in the order
    assert np.allclose(observed, order, atol=0.2), (errors, observed)


@pytest.mark.parametrize(
    ("damping", "restitution", "order", "tolerance"),
    [(500.0, 0.5, 1, 0.15), (0.0, 0.5, 1.2, 0.15), (0.0, 1.0, 2, 0.01)],
    ids=["damped", "impacts", "elastic"],
)
def test_order_of_leapfrog_with_impacts(damping, restitution, order, tolerance):
    # A contact opens and closes within a step, of whose force it has the mean: that costs the step's square. Links'
    # dampers read the speed half a step late: first order. Impacts with damping are of an order between, 1.23 here.
    # Where in a step contacts close is chance, which scatters the errors about the power of the step: the slope is
    # that of nine steps over a factor of 16, in which that comes to 0.15.
    n, duration = 20, 0.006
    position, radius = polygon(n, PITCH)
    velocity = np.random.default_rng(4).normal(scale=0.05, size=position.shape) - 0.2 * position / radius
    sprocket = {"teeth": n, "stiffness": 2e7, "inertia": 3.0, "clearance": 2e-4, "restitution": restitution}

    def end(steps, integrator="leapfrog"):
        packed = chain(position, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, damping=damping,
                       sprockets=[sprocket], step=duration / steps, steps=steps, integrator=integrator)  # fmt: skip
        engine, _ = run(packed)
        assert engine.sums()["contact"][0]["impacts"] >= n  # every roller flies into its seat
        return state(engine)[:2]

    exact = end(100_000, "rk4")
    counts = np.geomspace(200, 3200, 9).round().astype(int).tolist()
    errors = [np.abs(end(steps) - exact).max() for steps in counts]
    observed = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert observed == pytest.approx(order, abs=tolerance), errors


def test_damped_contacts_that_stay_closed_are_of_second_order():
    # a ring that is stretched around its sprocket, all rollers in their seats, damped by c = d K pen / v_min
    n, duration = 20, 0.006
    position, radius = polygon(n, PITCH)
    velocity = np.random.default_rng(4).normal(scale=0.01, size=position.shape)
    sprocket = {"teeth": n, "stiffness": 2e7, "inertia": 3.0, "clearance": 2e-4, "restitution": 0.5}

    def end(steps, integrator="leapfrog"):
        packed = chain(position * (1.0 - 6e-4 / radius), velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS,
                       sprockets=[sprocket | {"speed_floor": 0.02}], step=duration / steps, steps=steps,
                       integrator=integrator)  # fmt: skip
        packed.lengths[:] = PITCH * (1.0 - 6e-3)
        engine, _ = run(packed)
        sums = engine.sums()["contact"][0]
        assert sums["impacts"] == n and sums["dissipated"] > 20.0
        return state(engine)[:2]

    exact = end(50_000, "rk4")
    errors = [np.abs(end(steps) - exact).max() for steps in (200, 400, 800)]
    # errors of 1.7e-8 m and less; rk4's own are below 1e-13
    assert np.diff(np.log2(errors)) == pytest.approx(-2.0, abs=0.02)
