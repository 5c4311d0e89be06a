"""Friction of the joints against closed forms: a plucked strand, conservation, the energy balance."""

import numpy as np
import pytest
import warp as wp
from raw import chain, polygon, run, state

from warpchain.engine.struct_rows import JOINT_INERTIA
from warpchain.kernels.cpu.joints import joint_functions
from warpchain.kernels.cpu.rollers import ROWS, roller_functions
from warpchain.kernels.physics.friction import DAMPER, SPRING
from warpchain.kernels.structs import types

PITCH, MASS, STIFFNESS, WORN_IN = 0.1, 2.0, 5e6, 4 / np.pi
N = 24


def plucked(n, tension, mu, radius, amplitude, cycles):
    """Amplitude of the fundamental [m] of a strand of n masses at the end of each cycle; the ends' joints rub not."""
    real = wp.float64
    rollers, joints, kinds = roller_functions(real, 264), joint_functions(real, 264), types(real)
    MOMENT = wp.constant(ROWS.index("moment") * 264)

    @wp.kernel(enable_backward=False, module="unique")
    def vibrate(w: wp.array[wp.float64], chain: kinds.Chain, h: real, spacing: real, shape:
                wp.array[wp.float64], out: wp.array[wp.float64]):  # fmt: skip
        count = shape.shape[0]
        memory = kinds.Memory()
        memory.stretch_part = real(1.0)
        for step in range(out.shape[0]):
            joints.find_link_forces(w, count, chain)
            joints.find_joint_moments(w, count, chain, memory)
            w[MOMENT] = real(0.0)
            w[MOMENT + count - 1] = real(0.0)
            w[MOMENT + count] = real(0.0)
            joints.add_couple_forces(w, count)
            rollers.kick_and_drift(w, count, chain, h, h)
            for end in range(2):
                i = end * (count - 1)
                w[i] = real(i) * spacing
                w[264 + i] = real(0.0)
                w[2 * 264 + i] = real(0.0)
                w[3 * 264 + i] = real(0.0)
            value = real(0.0)
            for i in range(count):
                value += w[264 + i] * shape[i]
            out[step] = value

    spacing = PITCH * (1 + tension / (STIFFNESS * PITCH))
    mode = np.sin(np.pi * np.arange(n + 2) / (n + 1))
    rows = np.zeros((len(ROWS), 264))
    rows[ROWS.index("length")] = PITCH
    rows[ROWS.index("mobility")] = 1.0
    rows[0, : n + 2], rows[1, : n + 2] = spacing * np.arange(n + 2), amplitude * mode
    law = kinds.Chain()
    law.stiffness, law.mass, law.inverse_mass = STIFFNESS, MASS, 1.0 / MASS
    law.outer_stiffness = STIFFNESS
    frequency = np.sqrt(tension / spacing / MASS) / np.pi * np.sin(np.pi / (2 * (n + 1)))
    per_cycle = round(10 / (frequency * np.sqrt(MASS / STIFFNESS)))
    h = 1 / (frequency * per_cycle)
    law.pin_radius, law.joint_arm = radius, WORN_IN * radius
    inertia = JOINT_INERTIA * MASS * PITCH**2 / (6 * h)
    law.joint.inertia, law.joint.spring, law.joint.damper = inertia, SPRING * inertia, DAMPER * inertia
    law.joint.mu_dynamic = law.joint.mu_static = mu
    out = wp.zeros(round((cycles + 0.3) * per_cycle), dtype=real, device="cpu")
    scratch = wp.array(rows.ravel(), dtype=real, device="cpu")
    shape = wp.array(mode * 2 / (n + 1), dtype=real, device="cpu")
    wp.launch(vibrate, dim=1, inputs=[scratch, law, h, spacing, shape, out], device="cpu")
    found, window = out.numpy(), per_cycle // 4
    return np.array([amplitude] + [found[k * per_cycle - window : k * per_cycle + window].max()
                                   for k in range(1, cycles + 1)])  # fmt: skip


@pytest.mark.parametrize(("n", "tension"), [(9, 2000.0), (9, 500.0), (20, 2000.0)])
def test_a_plucked_strand_falls_linearly(n, tension):
    # moments mu kappa r T against g take 4 moment times the sum over the joints of the kinks' amplitude a cycle, which
    # is the energy's fall: 8 kappa mu r cot(pi/(2(n+1)))/(n+1) of the amplitude, whatever tension, pitch and mass
    radius, amplitude = 0.01, 1e-4
    fall = 8 * WORN_IN * radius / np.tan(np.pi / (2 * (n + 1))) / (n + 1)  # a cycle and mu
    mu = 5e-4 * amplitude / fall
    found = plucked(n, tension, mu, radius, amplitude, 8)
    # the moments' step excites the odd modes by about dA/A of the first, hence 1 % for one cycle, less in the mean
    assert np.diff(found) == pytest.approx(-mu * fall, rel=2e-2)
    assert (found[0] - found[-1]) / 8 == pytest.approx(mu * fall, rel=3e-3)


def tossed(mu, step, duration=0.02, integrator="leapfrog", damping=0.0, seed=7):
    """A closed chain in free flight, tossed at random, its velocities (n, 2), its final state and its sums."""
    vertices, _ = polygon(N, PITCH)
    velocity = np.random.default_rng(seed).normal(scale=0.3, size=(N, 2))
    joint = {"friction": mu, "pin_radius": 0.02} if mu else None
    packed = chain(vertices, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, damping=damping, step=step,
                   steps=round(duration / step), integrator=integrator, joint=joint)  # fmt: skip
    engine, _ = run(packed)
    return vertices, velocity, state(engine), engine.sums()["chain"][0]


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_joints_conserve_linear_and_angular_momentum(integrator):
    step = 8e-6
    vertices, velocity, (x, y, vx, vy), sums = tossed(0.3, step, integrator=integrator)
    assert sums["friction"] > 1e-2 * sums["energy_start"]
    # forces between two rollers are opposite to the last bit: what is left is the rounding of 2500 sums
    np.testing.assert_allclose([vx.sum(), vy.sum()], velocity.sum(axis=0), atol=1e-11)
    before = (vertices[:, 0] * velocity[:, 1] - vertices[:, 1] * velocity[:, 0]).sum()
    if integrator == "leapfrog":  # its velocities are half a step behind, across which free flight turns nothing
        x, y = x - 0.5 * step * vx, y - 0.5 * step * vy
    after = (x * vy - y * vx).sum()
    # couples have no moment but their own, exactly; leapfrog keeps x(n) x v(n - 1/2) to rounding, rk4 to (omega h)^4
    assert after == pytest.approx(before, abs=1e-11 if integrator == "leapfrog" else 1e-6)


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
@pytest.mark.parametrize("mu", [0.02, 0.3, 100.0])
def test_the_energy_balance_holds_with_friction(mu, integrator):
    # leapfrog keeps the energy of a mode but for (omega h)^2 / 4 <= 1.6e-4 of it; friction's part is worked out with
    # the mean of the velocities before and after each kick, which leaves the same order. mu = 100 holds all joints.
    _, _, _, sums = tossed(mu, 4e-6, integrator=integrator)
    lost = sums["energy_start"] - sums["energy_end"]
    assert sums["friction"] > 0.0
    assert lost - sums["friction"] == pytest.approx(0.0, abs=2e-4 * sums["energy_start"])


def test_friction_never_gains_energy_even_where_the_bound_takes_all_joints():
    # 0.375 of what stops one link's turning, at all joints at once, is below what reverses the stiffest of their modes
    *_, sums = tossed(1e6, 2e-5, duration=0.2)
    assert sums["energy_end"] < sums["energy_start"] * 0.6
    assert sums["friction"] == pytest.approx(sums["energy_start"] - sums["energy_end"], rel=1e-2)
