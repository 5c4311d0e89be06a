"""A guide's profile: heights over its pieces, a straight bar as a profile, a chain at rest over an arc."""

import numpy as np
import pytest
import raw
import warp as wp
from own_kernels import kernel

from warpchain.kernels.physics.guide import piece_height
from warpchain.results.channels import DEFAULT_FRAME

ROLLER_RADIUS = 0.004


@kernel
def heights(u: wp.array[wp.float64], w: wp.array[wp.float64], curvature: wp.float64, found: wp.array2d[wp.float64]):
    i = wp.tid()
    height, along, across = piece_height(u[i], w[i], curvature)
    found[i, 0] = height
    found[i, 1] = along
    found[i, 2] = across


@pytest.mark.parametrize("curvature", [0.0, 4.0, -4.0, 1e-9])
def test_height_over_a_piece_is_the_distance_from_its_circle(curvature):
    # against the distance from the center as written; the difference of large lengths there costs 1e-16 / curvature
    rng = np.random.default_rng(1)
    u, w = rng.uniform(-0.05, 0.05, 50), rng.uniform(-0.02, 0.02, 50)
    found = wp.zeros((50, 3), dtype=wp.float64, device="cpu")
    arrays = [wp.array(values, dtype=wp.float64, device="cpu") for values in (u, w)]
    wp.launch(heights, dim=50, inputs=[*arrays, curvature], outputs=[found], device="cpu")
    found = found.numpy()
    if curvature == 0.0:
        height, normal = w, np.stack([0 * u, 1 + 0 * w], axis=1)
    else:
        center = np.array([0.0, 1.0 / curvature])
        to_center = center - np.stack([u, w], axis=1)
        distance = np.hypot(*to_center.T)
        height = 1.0 / curvature - np.sign(curvature) * distance
        normal = np.sign(curvature) * to_center / distance[:, None]
    tolerance = 1e-14 + 4e-16 / max(abs(curvature), 1e-3 if curvature == 0.0 else 0.0)
    np.testing.assert_allclose(found[:, 0], height, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found[:, 1:3], normal, rtol=0, atol=1e-9 if curvature == 1e-9 else 1e-14)


def bar_pieces(start, end, radius):
    """A straight bar as a profile: a quarter of a circle, the face, a quarter of a circle."""
    chord = np.subtract(end, start)
    length, heading = np.hypot(*chord), np.arctan2(chord[1], chord[0])
    t = chord / length
    n = np.array([-t[1], t[0]])
    corner = np.asarray(start) - radius * t - radius * n
    quarter = 0.5 * np.pi * radius
    return [
        (corner, heading + 0.5 * np.pi, -1.0 / radius, quarter),
        (start, heading, 0.0, length),
        (end, heading, -1.0 / radius, quarter),
    ]


def falling(guide, precision="float64", integrator="leapfrog"):
    """A chain that falls onto a bar that it overhangs on both sides."""
    n, pitch = 24, 0.01
    x = pitch * np.arange(n)
    position = np.stack([x, np.full(n, 0.0045)], axis=1)
    packed = raw.chain(
        position, np.tile((0.3, -0.2), (n, 1)), mass=0.01, pitch=pitch, stiffness=1e5, damping=0.5,
        gravity=(0.0, -9.81),
        guides=[{"roller_radius": ROLLER_RADIUS, "stiffness": 1e6, "damping": 0.5, "end_radius": 0.02, "friction": 0.1}
                | guide],
        step=1e-5, steps=2000, integrator=integrator, frame_interval=2000, precision=precision,
    )  # fmt: skip
    packed.lengths[-1] = (n - 1) * pitch
    return packed


@pytest.mark.parametrize("precision, tolerance", [("float64", 1e-11), ("float32", 3e-6)])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_straight_bar_as_a_profile(precision, tolerance, integrator):
    # one law in two forms: they differ by round-off, which 2,000 steps of impacts make larger
    ends = {"start": (0.035, 0.0), "end": (0.19, 0.001)}
    straight, _ = raw.run(falling(ends, precision, integrator))
    curved, _ = raw.run(falling({"pieces": bar_pieces(**ends, radius=0.02)}, precision, integrator))
    difference = np.abs(raw.state(straight)[:2] - raw.state(curved)[:2]).max()
    assert difference < tolerance
    assert straight.sums()["contact"]["impulse"][0] > 0.0
    assert curved.sums()["contact"]["friction"][0] == pytest.approx(straight.sums()["contact"]["friction"][0], rel=1e-3)
    assert np.ptp(raw.state(straight)[1]) > 0.0


@pytest.mark.parametrize("precision, tolerance", [("float64", 1e-11), ("float32", 3e-6)])
def test_a_face_in_many_pieces_is_the_face_in_one(precision, tolerance):
    """Five pieces of 31 mm, between which rollers slide by 20 mm, pressed on, give the forces of one: they differ by
    round-off, which 2,000 steps of impacts make larger. With pieces kept as they were, 1.2 mm are found."""
    first, (start, heading, _, length), last = bar_pieces((0.035, 0.0), (0.19, 0.001), 0.02)
    along = np.array([np.cos(heading), np.sin(heading)])
    parts = [(start + k * 0.2 * length * along, heading, 0.0, 0.2 * length) for k in range(5)]
    states = []
    for face in ([(start, heading, 0.0, length)], parts):
        packed = falling({"pieces": [first, *face, last]}, precision)
        packed.roller_rows(0)[2], packed.chains["gravity"][:] = 1.0, (0.0, -200.0)
        states.append(raw.state(raw.run(packed)[0])[:2])
    assert np.abs(states[0] - states[1]).max() < tolerance


def round_guide(face, **values):
    """A guide whose profile is a circle about the origin, in quarters."""
    angles = np.pi * np.array([0.9, 0.4, -0.1, -0.6])
    quarters = [
        (face * np.array([np.cos(a), np.sin(a)]), a - 0.5 * np.pi, -1.0 / face, 0.5 * np.pi * face) for a in angles
    ]
    return {"roller_radius": ROLLER_RADIUS, "end_radius": 0.5 * face, "pieces": quarters} | values


def test_rollers_at_rest_over_an_arc():
    # model: N = T p / R' each, R' = R_g + R_r, with rollers on a circle of R' and tension T in links of length p as
    # drawn between them: exactly 2 T sin(asin(p / 2 R')) = T p / R'. The chain is a ring about a round guide, its links
    # too short by a strain, seen in the forces of its first frame.
    n, pitch, strain = 40, 0.01, 1e-3
    position, radius = raw.polygon(n, pitch)
    face = radius - ROLLER_RADIUS
    depth = 1e-6
    packed = raw.chain(
        position * (1.0 - depth / radius), np.zeros((n, 2)), mass=0.01, pitch=pitch * (1.0 - strain), stiffness=1e6,
        guides=[round_guide(face, stiffness=1e7)],
        step=1e-6, steps=1, frame_interval=1,
    )  # fmt: skip
    engine, frames = raw.run(packed)
    force = frames[0][DEFAULT_FRAME.place("guide_force") * n :][:n]
    np.testing.assert_allclose(force, 1e7 * depth, rtol=1e-8)
    # and the balance: give the contact the stiffness at which depth carries N, and nothing moves
    length = pitch * (1.0 - depth / radius)
    tension = 1e6 * (length - pitch * (1.0 - strain))
    packed.guides["law"]["stiffness"] = tension * length / (radius - depth) / depth
    packed.drives["steps"], packed.drives["window_end"] = 2000, 2000
    engine, frames = raw.run(packed)
    moved = np.hypot(*(raw.state(engine)[:2] - packed.roller_rows(0)[:2]))
    assert moved.max() < 1e-13


def test_capstan_of_a_chain_that_slides_over_an_arc():
    # model, section 11: T_i / T_{i-1} = (cos(b/2) + mu sin(b/2)) / (cos(b/2) - mu sin(b/2)), b = 2 asin(p / 2R'), as
    # (T_i - T_{i-1}) cos(b/2) = mu N and (T_i + T_{i-1}) sin(b/2) = N: rollers with these tensions, pulled towards the
    # tight end, keep their speed. Contacts of 1e9 N/m give in by 1e-8 m a newton, which bends the arc by 1e-4 of N.
    n, pitch, mu, speed, step = 40, 0.01, 0.3, 0.02, 1e-6
    position, radius = raw.polygon(n, pitch)
    face, half = radius - ROLLER_RADIUS, np.pi / n
    ratio = (np.cos(half) + mu * np.sin(half)) / (np.cos(half) - mu * np.sin(half))
    tension = 5.0 * ratio ** np.arange(n)
    normal = (tension + np.roll(tension, 1)) * np.sin(half)
    tangent = np.stack([-position[:, 1], position[:, 0]], axis=1) / radius
    packed = raw.chain(
        position * (1.0 - normal / 1e9 / radius)[:, None], speed * tangent, mass=0.01, pitch=pitch, stiffness=1e6,
        guides=[round_guide(face, stiffness=1e9, friction=mu)],
        step=step, steps=1,
    )  # fmt: skip
    placed = packed.roller_rows(0)[:2].T
    packed.lengths[:] = np.hypot(*(np.roll(placed, -1, axis=0) - placed).T) - tension / 1e6
    engine, _ = raw.run(packed)
    gained = 2.0 * (raw.state(engine)[2:].T - speed * tangent) / step * 0.01  # of half a kick, as a force [N]
    along = np.einsum("ij,ij->i", gained, tangent)[2:-2]
    assert np.abs(along / (mu * normal[2:-2])).max() < 1e-3
