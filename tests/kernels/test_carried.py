"""A body that is not a sprocket: a guide-bar on a body with springs, made as the recipe in CONTRIBUTING.md says.

Nothing of integrators, settling or packing knows what a body is: it is a row of motions, mounts and bodies.
"""

from typing import Any

import numpy as np
import pytest
import raw
from drives import example
from grown import grown, recipe, recipe_code, run_in

from warpchain import dumps_drive, simulate
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.engine.settling import settling_ensemble
from warpchain.engine.struct_rows import FORCE_NUMBERS
from warpchain.kernels import structs
from warpchain.kernels.physics.mount import FREE
from warpchain.results.channels import DEFAULT_FRAME, PartCounts

LINKS, PITCH, MASS, WEIGHT = 10, 0.05, 0.5, 9.81
ROLLER_RADIUS = 0.015
CONTACT = 1e6
BAR_MASS, SPRING = 2.0, 1e5

fill_carrier_row = recipe_code("A new kind of body", "fill_carrier_row", np=np, Any=Any, FREE=FREE)

HELD = """
import sys
import numpy as np
import warpchain.engine.pack as packing
from warpchain import Record, load_drive, simulate

drives = [load_drive(path) for path in sys.argv[1:]]
filled = packing.fill_carrier_row
run = simulate(drives, device="cpu")
values = run.metrics.to_pylist()
assert all(abs(row["energy_residual_relative"]) < 1e-3 for row in values)

def held(motion, mount, body, *springs):
    filled(motion, mount, body, *springs)
    mount["inverse_mass"] = 0.0

packing.fill_carrier_row = held
still = simulate(drives, device="cpu")
for v in range(len(drives)):
    assert np.abs(run[v].guide_force - still[v].guide_force).max() > 10.0, v
numbers = [[value for value in row.values() if not isinstance(value, str)] for row in still.metrics.to_pylist()]
np.savez("held.npz", *(np.array(row, dtype=float) for row in numbers),
         **{f"{name}{v}": part for v in range(len(drives)) for name, part in still[v].channels().items()})
"""


def straight(*, center=(0.225, 0.0), above=0.0, velocity=(0.0, 0.0), gravity=0.0, damped=False, carriers=1, **options):
    """A straight chain, its last link as long as all others, `above` a bar that is fixed to a body's center."""
    x = PITCH * np.arange(LINKS)
    position = np.stack([x, np.full(LINKS, ROLLER_RADIUS + above)], axis=1)
    viscous = {"form": FORCE_NUMBERS["kelvin_voigt_damper"], "damping": np.sqrt(CONTACT * MASS)} if damped else {}
    bar = {"start": np.subtract((-PITCH, 0.0), center), "end": np.subtract((LINKS * PITCH, 0.0), center)}
    bar |= {"roller_radius": ROLLER_RADIUS, "stiffness": CONTACT, "body": 0} | viscous
    packed = raw.chain(
        position, np.tile(velocity, (LINKS, 1)), mass=MASS, pitch=PITCH, stiffness=1e6, damping=100.0,
        gravity=(0.0, -gravity), guides=[bar], carriers=carriers, step=5e-5, **options,
    )  # fmt: skip
    packed.lengths[-1] = (LINKS - 1) * PITCH
    # critically damped with the chain's mass on it, or not at all
    damping = 2.0 * np.sqrt(SPRING * (BAR_MASS + LINKS * MASS)) if damped else 0.0
    fill_carrier_row(packed.motions[0], packed.mounts[0], packed.bodies[0], BAR_MASS, SPRING, damping)
    packed.mounts["home"][0] = packed.bodies["center"][0] = center
    return packed


def free(packed, inertia):
    """Takes the springs away and lets the body turn."""
    packed.mounts["stiffness"] = 0.0
    packed.motions["prescribed"], packed.motions["inverse_inertia"] = 0, 1.0 / inertia
    packed.mounts["inertia"] = inertia
    return packed


@pytest.mark.long
def test_the_recipe_of_a_body(tmp_path):
    # the bar is pressed 3 cm into the chain. A body that is held at the origin leaves every bit as it is with the bar
    # on the ground; one on springs does not, and the energy balance closes as well as on the ground (some 5e-4)
    changes = recipe("A new kind of body")
    assert {path for path, _, _ in changes} == {"warpchain/engine/struct_rows.py", "warpchain/engine/pack.py"}
    marine = example("marine")
    bar = {f"guides.0.{end}": np.add(getattr(marine.guides[0], end), (0.03, 0.0)).tolist() for end in ("start", "end")}
    short = {"run.duration": 0.02, "run.sample_rate": 5000.0} | bar
    drives = [
        marine.with_values(short | {"run.integrator": kind, "sprockets.camshaft.load.torque": torque})
        for kind, torque in (("leapfrog", 9e3), ("leapfrog", 6e3), ("rk4", 9e3))
    ]
    for v, drive in enumerate(drives):
        (tmp_path / f"{v}.toml").write_text(dumps_drive(drive))
    run_in(grown(tmp_path, changes), HELD, *(tmp_path / f"{v}.toml" for v in range(len(drives))))
    mine = simulate(drives, device="cpu")
    with np.load(tmp_path / "held.npz") as theirs:
        for v, row in enumerate(mine.metrics.to_pylist()):
            numbers = [value for value in row.values() if not isinstance(value, str)]
            np.testing.assert_array_equal(theirs[f"arr_{v}"], np.array(numbers, dtype=float))
            for name, values in mine[v].channels().items():
                np.testing.assert_array_equal(theirs[f"{name}{v}"], values)


def momentum(engine, inertia):
    """Momentum of chain and body (2,) and angular momentum about the origin, of positions and velocities as held."""
    x, y, vx, vy = raw.state(engine)
    body = engine.state.bodies.numpy()[0]
    moved = MASS * np.array([vx.sum(), vy.sum()]) + BAR_MASS * body["velocity"]
    turned = MASS * (x * vy - y * vx).sum() + BAR_MASS * np.linalg.det([body["center"], body["velocity"]])
    return moved, turned + inertia * body["speed"]


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_springs_carry_what_lies_on_the_bar(integrator):
    # 0.4 s are 48 time constants of the carrier: what is left is rounding, some 1e-12 N of 49 N
    packed = straight(gravity=WEIGHT, damped=True, integrator=integrator, steps=8000, frame_interval=8000)
    engine, frames = raw.run(packed)
    pressed = engine.state.wrenches.numpy()[0]["force"]
    sinks = engine.state.bodies.numpy()[0]["center"] - packed.mounts[0]["home"]
    weight = LINKS * MASS * WEIGHT
    np.testing.assert_allclose(pressed, [0.0, -weight], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(SPRING * sinks, pressed, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(sinks, [0.0, -weight / SPRING], rtol=1e-9, atol=1e-15)
    forces = DEFAULT_FRAME.split_frames(frames, PartCounts(LINKS, 0))["guide_force"][-1]
    np.testing.assert_allclose(forces, MASS * WEIGHT, rtol=1e-9)
    _, y, _, _ = raw.state(engine)
    np.testing.assert_allclose(y, ROLLER_RADIUS + sinks[1] - MASS * WEIGHT / CONTACT, rtol=1e-9)


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_chain_and_body_keep_their_momentum(integrator, mu):
    # the chain strikes a bar that is free to move and to turn, off its center. Leapfrog keeps both momenta to rounding.
    # rk4 misses the angular one only as contact normals turn, Omega h = 1.3e-5 a step, and of that the fourth order of
    # a contact's h omega = 0.13: 4e-9
    inertia = 0.02
    options = {"center": (0.15, 0.02), "above": 1e-4, "velocity": (0.3, -0.5), "integrator": integrator}
    start = free(straight(steps=0, **options), inertia)
    packed = free(straight(steps=400, **options), inertia)
    raw.put_friction(packed.guide_friction[0], mu, 0.1 * MASS, 5e-5)
    (engine, _), (before, _) = raw.run(packed), raw.run(start)
    (moved, turned), (first, first_turned) = momentum(engine, inertia), momentum(before, inertia)
    body = engine.state.bodies.numpy()[0]
    assert abs(body["velocity"][1]) > 0.1 and abs(body["speed"]) > 0.1
    np.testing.assert_allclose(moved, first, rtol=1e-12)
    assert turned == pytest.approx(first_turned, rel=1e-12 if integrator == "leapfrog" else 4e-9)


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_energy_has_the_body_in_it(integrator):
    # nothing dissipates. The body starts 1.3 times as deep as it would stand, so that the chain stays on the bar, and
    # oscillates with k (0.3 x)^2 / 2. The contacts begin 0.3 m g off the force that they then have, which is 1e-2 of
    # that energy, at omega^2 = K (1 / m + 10 / M), h omega = 0.13. Leapfrog's energy moves by (h omega)^2 / 4 = 4e-3 of
    # theirs, rk4 loses (h omega)^6 / 72 = 7e-8 of it a step
    packed = straight(gravity=WEIGHT, integrator=integrator, window=(0, 2000), steps=2000)
    stands = LINKS * MASS * WEIGHT / SPRING
    packed.bodies["center"][0, 1] = -1.3 * stands
    packed.roller_rows(0)[1] = ROLLER_RADIUS - 1.3 * stands - MASS * WEIGHT / CONTACT
    engine, _ = raw.run(packed)
    sums, oscillation = engine.sums()["chain"][0], 0.5 * SPRING * (0.3 * stands) ** 2
    assert abs(engine.state.bodies.numpy()[0]["velocity"][1]) > 1e-3
    change = sums["energy_end"] - sums["energy_start"]
    assert abs(change) < (6e-5 if integrator == "leapfrog" else 2e-6) * oscillation


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_carried_bar_is_one_on_the_ground_seen_from_elsewhere(integrator):
    # the body is turned a quarter and moves on at a velocity that nothing changes, as does the chain: the same as a bar
    # on the ground, to rounding (some 1e-17 m a step of positions, and 1 / h times that of velocities, over 400 steps)
    angle, going, time = 0.5 * np.pi, np.array([0.7, -0.2]), 400 * 5e-5
    options = {"above": 1.1e-4, "damped": True, "integrator": integrator, "steps": 400}
    ground = straight(velocity=(0.3, -0.5), **options)
    bar = ground.guides[0]
    bar["body"], bar["start"] = structs.GROUND, (-PITCH, 0.0)
    moving = straight(velocity=np.add((0.3, -0.5), going), **options)
    bar, back = moving.guides[0], np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    bar["start"], bar["direction"] = back @ bar["start"], back @ bar["direction"]
    moving.motions["start_angle"] = moving.bodies["angle"] = angle
    moving.mounts["stiffness"], moving.mounts["inverse_mass"], moving.mounts["damping"] = 0.0, 0.0, 0.0
    moving.bodies["velocity"] = going
    still, gone = raw.state(raw.run(ground)[0]), raw.state(raw.run(moving)[0])
    assert still[3].max() > 0.01  # the chain has come back
    np.testing.assert_allclose(gone[:2] - going[:, None] * time, still[:2], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(gone[2:] - going[:, None], still[2:], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_what_contacts_dissipate_is_what_chain_and_turning_body_lose(integrator):
    # the rate of the penetration has the body's turning in it, some 0.07 of 0.5 m/s. At this step a contact's h omega
    # is 0.03: sums over steps are exact to (h omega)^2 / 6 = 2e-4; leapfrog's damping reads velocities half a step
    # late, h omega / 2 = 0.016 of it, less as they change sign
    steps, step = 1600, 1.25e-5
    options = {"center": (0.15, 0.02), "above": 1e-4, "velocity": (0.3, -0.5), "integrator": integrator}
    packed = free(straight(steps=steps, window=(0, steps), **options), 0.02)
    packed.drives["step"], packed.guides["law"]["damping"] = step, 0.5
    packed.chains["damping"] = packed.chains["outer_damping"] = 0.0
    engine, _ = raw.run(packed)
    sums = engine.sums()
    lost = sums["chain"]["energy_start"][0] - sums["chain"]["energy_end"][0]
    assert lost > 0.05 and sums["contact"]["impacts"][0] == LINKS
    assert sums["contact"]["dissipated"][0] == pytest.approx(lost, rel=1e-2 if integrator == "leapfrog" else 4e-4)


def test_settling_holds_the_body():
    # relaxed until no net force is above 1e-10 of a weight
    packed = settling_ensemble(straight(gravity=WEIGHT, above=-1e-5, steps=1))
    engine, _ = raw.settling(packed, 2e-4, 1e-10, 100_000)
    assert engine.settling_states()["settled"][0] == 1
    assert engine.state.bodies.numpy()[0] == packed.bodies[0]
    _, y, _, _ = raw.state(engine)
    np.testing.assert_allclose(ROLLER_RADIUS - y, MASS * WEIGHT / CONTACT, rtol=1e-9)


def test_variants_with_different_bodies_stand_side_by_side():
    # one of them has a second body, which nothing touches
    options = {"gravity": WEIGHT, "damped": True, "steps": 500}
    one, two = straight(**options), straight(carriers=2, **options)
    two.motions["prescribed"] = 1
    alone = raw.state(raw.run(one)[0])
    both = beside(two, one)
    engine, _ = raw.stepped(both, 501)
    rows = engine.rollers().reshape(2, 6, LINKS)
    for v in range(2):
        np.testing.assert_array_equal(rows[v][:4], alone)
    taken = both.pick_variants([1, 0, 1])
    np.testing.assert_array_equal(taken.drives["first_body"], [0, 1, 3])
    for name in ("motions", "mounts", "bodies"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(both, name)[[2, 0, 1, 2]])


def beside(*parts):
    """Ensembles of one variant each as one."""
    from warpchain.engine.arrays import ARRAYS, PACKED_ARRAYS, fill_first_places

    kinds = {name: ARRAYS[group][of].dimension for name, (group, of) in PACKED_ARRAYS.items()}
    joined = {}
    for name in (name for name, kind in kinds.items() if kind):
        each = [getattr(part, name) for part in parts]
        if kinds[name] == "sprocket":  # there is none: the one row that Warp wants is enough
            each = each[:1]
        joined[name] = np.concatenate(each).astype(each[0].dtype)  # which keeps the structs' alignment
    rest = {name: getattr(parts[0], name) for name in ("precision", "harmonics", "tables", "seats")}
    joined["drives"] = fill_first_places(joined["drives"])
    return PackedEnsemble(**rest, **joined, assemblies=raw.blank_states(len(parts)))
