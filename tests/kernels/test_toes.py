"""Toes of silent chains on wheel teeth: forces against an energy, closed forms, symmetries, blocks against the CPU."""

import math
from functools import partial

import blocks
import numpy as np
import pytest
import warp as wp
from raw import stepped
from silent_chains import pulled_silent_drive, silent_drive

from warpchain import Drive, simulate
from warpchain.assembly.potential import Potential
from warpchain.assembly.timestep import automatic_step
from warpchain.assembly.toe_energy import Wheel
from warpchain.drive.plate import toe_clearance, wheel_tooth
from warpchain.engine.force_probe import ForceProbe, ProbeStates
from warpchain.engine.gpu_kernels import Bucket, block_kind, kernel_kind, variant_kind_columns
from warpchain.engine.pack import pack
from warpchain.kernels.physics.toe import ENDS, approach_bound
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule

FAMILIES = [blocks.silent, blocks.silent_rubbing, blocks.silent_guided]


@pytest.mark.parametrize("drives", FAMILIES)
@pytest.mark.parametrize("many", [False, True])
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many):
    blocks.assert_steps_of_the_cpu(drives, many, "float64")


@pytest.mark.parametrize("drives", FAMILIES)
def test_block_kernel_takes_the_steps_of_the_cpu_kernel_at_float32(fibers, drives):
    variants = drives()
    schedules = [Schedule(drive.run.step, 300, 111, 290, 0) for drive in variants]
    packed = blocks.pack_for(variants, schedules, "float32")
    serial, none = stepped(packed, 301)
    kind = blocks.kind_of(packed, blocks.shape_of(variants, 1))
    state, sums = blocks.run_blocks(packed, kind, [150, 151], [1, 0], none)
    # a contact at a hair's breadth closes a step apart
    close = partial(np.testing.assert_allclose, atol=3e-4, rtol=3e-4)
    mine, theirs = state.rollers.numpy(), serial.state.rollers.numpy()
    assert (~np.isclose(mine, theirs, atol=3e-4, rtol=3e-4)).mean() < 2e-3
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    summed = serial.sums()
    close(sums["chain"]["tension"], summed["chain"]["tension"], rtol=2e-3)
    close(sums["sprocket"]["moment"], summed["sprocket"]["moment"], rtol=2e-2)


@wp.kernel
def find_bounds(
    relative: wp.array[wp.vec2d],
    more: wp.array[wp.vec2d],
    turn: wp.array[wp.float64],
    angular: wp.array[wp.float64],
    bound: wp.array[wp.float64],
):
    k = wp.tid()
    bound[k] = approach_bound(relative[k], more[k], turn[k], angular[k], wp.float64(6e-3), wp.float64(3e-6))


def test_no_point_of_a_link_nears_a_wheel_faster_than_its_bound():
    random, count = np.random.default_rng(1), 500
    relative, more = random.normal(size=(count, 2)), 3e5 * random.normal(size=(count, 2))
    turn, angular = 200.0 * random.normal(size=count), 5e7 * random.normal(size=count)
    relative[:50] *= 1e-3  # all by rotation
    bound = wp.zeros(count, dtype=wp.float64, device="cpu")
    rows = [wp.array(values, dtype=kind, device="cpu") for values, kind in
            ((relative, wp.vec2d), (more, wp.vec2d), (turn, wp.float64), (angular, wp.float64))]  # fmt: skip
    wp.launch(find_bounds, count, [*rows, bound], device="cpu")
    place = np.exp(1j * np.linspace(0.0, math.tau, 60)) * 6e-3
    motion = (relative + 3e-6 * more) @ [1.0, 1j]
    speed = np.abs(motion[:, None] + 1j * (turn + 3e-6 * angular)[:, None] * place).max(axis=1)
    assert (speed <= bound.numpy()).all()
    assert (speed > 0.5 * bound.numpy()).mean() > 0.5


def perturbed(drive, size, seed):
    """Potential of a drive, coordinates near its seats with pins moved by up to `size` pitches, and its pack."""
    model = single_chain(drive)
    packed = pack([drive], [Schedule(1e-6, 10, 1, 10, 0)])
    energy = Potential(model, 0.0, np.zeros(len(model.sprockets)), held=[False] * len(model.sprockets))
    rows, bodies = packed.roller_rows(0), packed.bodies
    random = np.random.default_rng(seed)
    place = rows[0:2].T + random.uniform(-size, size, rows[0:2].T.shape) * drive.chain.pitch
    x = np.concatenate([place.ravel(), bodies["center"].ravel(), bodies["angle"]])
    x[-1] += 0.3 * random.uniform(-size, size)
    return energy, x, packed


@pytest.mark.parametrize(("wrap", "size"), [("ccw", 1e-3), ("cw", 1e-3), ("ccw", 0.1)])
def test_forces_are_the_slope_of_the_energy(wrap, size):
    """The kernel's forces on pins and wheels, far off their seats too, where toes meet tips and corners.

    The energy is written a second time, with numpy; the probe's step rounds nothing.
    """
    drive = silent_drive(stiffness=1e3)
    values = drive.model_dump(exclude_none=True)
    values["sprockets"] = [of | {"wrap": wrap} for of in values["sprockets"]]
    drive = Drive(**values)
    energy, x, packed = perturbed(drive, size, seed=5)
    probe = ForceProbe(packed)
    n, s = probe.rollers, probe.sprockets
    place = np.column_stack([x[2 * n : 2 * n + 2 * s].reshape(-1, 2), x[2 * n + 2 * s :][:s]])
    states = ProbeStates(
        x[: 2 * n].reshape(1, n, 2), np.zeros((1, n, 2)), place[None], np.zeros((1, s, 3)), np.zeros((1, 0))
    )
    straight, turned, _ = probe(states)
    probe.close()
    terms = energy.terms(x)
    slope = terms.gradient
    largest = np.abs(slope[: 2 * n]).max()
    assert largest > 1e3
    np.testing.assert_allclose(drive.chain.mass * straight[0].ravel(), -slope[: 2 * n], atol=1e-6 * largest)
    load = -300.0 if wrap == "ccw" else 300.0
    assert 2.0 * turned[0, 1, 2] - load == pytest.approx(-slope[2 * n + 2 * s + 1], abs=1e-6 * largest)


def test_gradient_and_hessian_are_differences_of_the_energy():
    energy, x, _ = perturbed(silent_drive(), 3e-3, seed=2)
    terms = energy.terms(x)
    size, step = len(x), 1e-8
    maps = [(np.arange(size), np.ones(size))]
    whole = terms.hessian(maps, size).toarray()
    for k in (0, 7, 41, size - 2, size - 1):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += step
        behind[k] -= step
        found = (energy.terms(ahead).energy - energy.terms(behind).energy) / (2.0 * step)
        assert found == pytest.approx(terms.gradient[k], rel=1e-5, abs=1e-4 * np.abs(terms.gradient).max())
        column = (energy.terms(ahead).gradient - energy.terms(behind).gradient) / (2.0 * step)
        np.testing.assert_allclose(whole[:, k], column, rtol=1e-4, atol=1e-4 * np.abs(column).max())


def test_a_link_pressed_into_its_seat():
    """By N, each flank stands N / (2 K sin 30) deep: two halves of K on each of two flanks, at 30 degrees to N."""
    drive = silent_drive()
    model, force, depth = single_chain(drive), 800.0, 0.0
    stiffness = model.sprocket_stiffness(0)
    depth = force / (2.0 * stiffness * math.sin(math.radians(30.0)) ** 2)  # of the link, along its normal
    wheel = Wheel(model, 0, 0.5 * stiffness, 1.0)
    step, radius = 2.0 * math.pi / 20, model.pitch_radius(0)
    seats = radius * np.array([[math.cos(k * step), math.sin(k * step)] for k in (0, 1)])
    normal = np.array([math.cos(0.5 * step), math.sin(0.5 * step)])
    pins = seats - depth * normal
    whole, slopes = 0.0, np.zeros(2)
    for number in range(int(ENDS)):
        pin, far = (0, 1) if number < 2 else (1, 0)
        x = np.concatenate([pins[pin], pins[far], np.zeros(3)])[None]
        energy, slope = wheel.energy(x, number)
        whole += float(energy[0])
        slopes -= slope[0, 0:2] + slope[0, 2:4]
    np.testing.assert_allclose(slopes, force * normal, rtol=1e-9, atol=1e-6)
    penetration = force / (2.0 * stiffness * math.sin(math.radians(30.0)))
    assert whole == pytest.approx(stiffness * penetration**2, rel=1e-9)  # two flanks, K pen^2 / 2 each


@pytest.mark.parametrize("teeth", [17, 19, 25, 41, 120])
def test_toes_clear_the_teeth_on_entry(teeth):
    plate = silent_drive().chain.plate
    assert toe_clearance(plate, teeth, plate.pitch) == pytest.approx(0.0, abs=1e-12 * plate.pitch)
    shallow = plate.__class__(**vars(plate) | {"toe_depths": (0.1 * plate.pitch, 0.5 * plate.pitch)})
    assert toe_clearance(shallow, teeth, plate.pitch) < -1e-3 * plate.pitch
    # flanks of a gap touch the circle about the seated pin: half a tooth is 30 - 360/z degrees
    half_gap = 0.5 * math.pi - 0.5 * wheel_tooth(plate, teeth, plate.pitch).seat_angle
    assert math.degrees(half_gap) - 180.0 / teeth == pytest.approx(30.0 - 360.0 / teeth)


def turned(drive, angle, shift):
    """A drive turned about the origin and moved."""
    cosine, sine = math.cos(angle), math.sin(angle)
    centers = {
        f"sprockets.{s}.center": [cosine * x - sine * y + shift[0], sine * x + cosine * y + shift[1]]
        for s, (x, y) in enumerate(of.center for of in drive.sprockets)
    }
    return drive.with_values(centers)


def mirrored(drive):
    """A drive mirrored at the x axis, its wheels turning the other way."""
    values = drive.model_dump(exclude_none=True)
    values["sprockets"] = [
        of | {"center": [of["center"][0], -of["center"][1]], "wrap": "cw"} for of in values["sprockets"]
    ]
    return Drive(**values)


def test_a_drive_turned_moved_or_mirrored_is_the_same():
    """To round-off, which contacts amplify: positions of 1 m carry 1e-16 of it, contacts of 2e8 N/m 1e-8 N."""
    drive = silent_drive(duration=0.01).with_values({"chain.elongation": -2e-4})
    forces = [
        simulate(of, device="cpu").metrics.to_pydict()
        for of in (drive, turned(drive, 0.7, (0.3, -2.0)), mirrored(drive))
    ]
    for name in ("tension_max", "tension_min", "driver.force_max", "driven.moment_mean", "driven.speed_mean"):
        first, *others = (abs(of[name][0]) for of in forces)
        assert others == pytest.approx([first, first], rel=1e-5), name


def test_energy_is_kept_to_the_second_order_of_the_step():
    """Of what goes through a drive with hard contacts: 3e-4 at the automatic step, an eighth at a third of it."""
    drive = silent_drive(damping=2000.0, duration=0.3, load_ramp=0.05, ramp=0.05, viscous=2.0, torque=100.0)
    slider = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 0.0, "damping": 2000.0, "preload": 4000.0}
    drive = drive.with_values({"sprockets.driven.mount": slider, "sprockets.driven.mass": 20.0, "run.step": "auto"})
    smaller = drive.with_values({"run.step": automatic_step(drive) / 3.0})
    coarse, fine = np.abs(simulate([drive, smaller], device="cpu").metrics.to_pydict()["energy_residual_relative"])
    assert coarse < 4e-4 and fine < 4e-5


def test_bits_do_not_hang_on_cuts():
    """A run in pieces has the bits of one in a single launch: what flank ends exerted is kept between launches."""
    drive = silent_drive(duration=2e-3).with_values({"chain.elongation": -2e-4})
    packed = pack([drive], [Schedule(drive.run.step, 400, 100, 390, 0)])
    whole, _ = stepped(packed, 401)
    pieces, _ = stepped(packed, 137, 1, 200, 63)
    for name in ("rollers", "push", "impact_speed", "damper_speed"):
        assert getattr(whole.state, name).numpy().tobytes() == getattr(pieces.state, name).numpy().tobytes(), name
    for name in ("chain", "contact", "sprocket"):
        ours, theirs = whole.sums()[name], pieces.sums()[name]
        for field in ours.dtype.names:
            np.testing.assert_allclose(ours[field], theirs[field], rtol=1e-12, err_msg=f"{name}.{field}")


def test_blocks_take_the_steps_of_the_cpu_where_contacts_hardly_bear(fibers):
    """From a violent start, in which closed contacts bear nothing for a while: their dampers pull."""
    drive = pulled_silent_drive(**{"sprockets.drive.prescribed.ramp_time": 0.02})
    packed = blocks.pack_for([drive], [Schedule(6e-6, 500, 600, 700, 0)], "float64")
    serial, none = stepped(packed, 40)
    for each in (1, 100):
        kind = blocks.kind_of(packed, blocks.shape_of([drive], each), measuring=False)
        state, _ = blocks.run_blocks(packed, kind, [40], [0], none)
        np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=1e-9, rtol=1e-9)


def test_silent_chains_settle_on_blocks_as_such():
    packed = pack([silent_drive()], [Schedule(1e-6, 10, 1, 10, 0)])
    columns = {name: int(values[0]) for name, values in variant_kind_columns(packed).items()}
    bucket = Bucket(block_kind(packed.real, columns, 8), np.zeros(1, dtype=np.intp), None)
    assert all(kernel_kind(name, bucket).silent for name in ("advance", "measure", "relax"))
