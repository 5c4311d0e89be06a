"""Open chains against closed forms: weights, catenary, swinging, polygon action, balances; ends of every kind."""

import tomllib

import numpy as np
import pytest
from drives import two_sprockets
from open_chains import CONTACT, hoist
from raw import run as raw_run
from raw import state

from warpchain import Drive, Record, assemble, dumps_drive, loads_drive, modes, simulate
from warpchain.assembly.statics import at_rest
from warpchain.engine.pack import pack
from warpchain.errors import DriveError, WarpchainError
from warpchain.fit import fit_position
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule
from warpchain.results.tooth_jump import tooth_jump_margin

GRAVITY = 9.81
PITCH, ROLLER = 0.0254, 2.71 * 0.0254


def run_of(drive, **more):
    run = simulate(drive, device="cpu", record=Record(rate=more.pop("rate", None)), **more)
    return run.trajectories[0], run.metrics.slice(0, 1).to_pylist()[0]


def file_values(drive):
    """Values of a drive that can be changed: its file's."""
    return tomllib.loads(dumps_drive(drive))


def rope(links, ends, **run):
    """A 16B chain between two ends, around nothing."""
    return Drive(
        chain={"size": "16B", "links": links, "stiffness": 2e7, "damping_ratio": 0.05, "ends": ["first", "last"]},
        sprockets=[{"name": name} | end for name, end in zip(("first", "last"), ends, strict=True)],
        contact={"sprocket": CONTACT},
        run={"duration": 0.2, "gravity": [0.0, -GRAVITY], "step": 1e-5, "sample_rate": 2000.0} | run,
    )


def test_a_weight_and_the_chain_below_a_link_are_what_it_bears():
    """At rest T of link i is the weight's and that of the pins below it; the last pin's hole bears the weight alone."""
    trajectory, metrics = run_of(
        rope(30, [{"center": [0.0, 0.0]}, {"center": [0.0, -0.76], "mass": 50.0, "mount": {"kind": "free"}}])
    )
    pins = 30 - np.arange(30)
    expected = GRAVITY * (50.0 + pins * ROLLER)
    # settled to 1e-3 of the largest force on each of 30 pins; it swings about that
    np.testing.assert_allclose(trajectory.tension[0, :30], expected, rtol=1e-2)
    np.testing.assert_allclose(trajectory.tension[:, :30].mean(axis=0), expected, rtol=2e-3)
    assert abs(metrics["energy_residual_relative"]) < 1e-4
    assert (trajectory.tension[:, 30] == 0.0).all()  # the absent link


def test_a_slack_chain_between_two_walls_is_a_catenary():
    """T = T_0 + w y above the lowest point, w the weight of a meter; the polygon of 60 links is one to 1e-3."""
    drive = rope(60, [{"center": [0.0, 0.0]}, {"center": [1.46, 0.0]}], duration=0.01)
    trajectory, _ = run_of(drive)
    x, tension = trajectory.position[0], trajectory.tension[0, :60]
    height = 0.5 * (x[1:, 1] + x[:-1, 1])
    slope, lowest = np.polyfit(height - height.min(), tension, 1)
    assert slope == pytest.approx(2.71 * GRAVITY, rel=5e-3)
    pull = tension * (x[1:, 0] - x[:-1, 0]) / np.hypot(*(x[1:] - x[:-1]).T)
    np.testing.assert_allclose(pull, pull.mean(), rtol=2e-3)  # the horizontal part is the same everywhere
    assert lowest == pytest.approx(pull.mean(), rel=1e-2)


def test_check_and_fit_find_the_sag_of_a_slack_chain_between_two_walls():
    """A parabola of 60 links: 8 s^2 / (3 L) longer than the chord, and w L^2 / (8 s) of tension, to (s / L)^2."""
    drive = rope(60, [{"center": [0.0, 0.0]}, {"center": [1.5, 0.0]}])
    fitted = fit_position(drive, "last", (1.0, 0.0), sag=0.1)
    span = fitted.sprockets[1].center[0]
    assert 60 * PITCH - span == pytest.approx(8.0 * 0.1**2 / (3.0 * span), rel=0.02)
    state = at_rest(single_chain(fitted))
    sag, weight = abs(state.displacement[0]), ROLLER / PITCH * GRAVITY
    assert sag == pytest.approx(0.1, rel=0.015)  # of a parabola whose links do not stretch
    pull = weight * span**2 / (8.0 * sag)
    assert state.tension[0] == pytest.approx(pull * (1.0 + 8.0 / 3.0 * (sag / span) ** 2), rel=0.02)


def test_a_hoist_lifts_its_weight_by_mass_times_gravity_and_acceleration():
    """T = M (g + a) and the chain's own below, in the mean of a steady acceleration."""
    ramp = {"speed": 20.0, "ramp_time": 1.0}  # 20 rad/s^2 at a radius of 85 mm: 1.7 m/s^2
    drive = hoist(links=100, weight=60.0, below=1.2, duration=0.9)
    values = file_values(drive)
    values["sprockets"][1] |= {"prescribed": ramp, "wrap": "ccw"}
    first, wheel, weight = values["sprockets"]
    first |= {"center": [0.08521, -1.2], "mass": 2.0, "mount": {"kind": "free"}}
    weight |= {"center": [-0.08521, weight["center"][1]]}
    wheel["wrap"] = "ccw"
    trajectory, metrics = run_of(Drive(**values), window=(0.1, 0.9), rate=5000.0)
    late = trajectory.time > 0.1  # some ten periods of its bouncing
    time, speed = trajectory.time[late], np.abs(trajectory.sprocket_speed[late, 1])
    acceleration = 0.08521 * (speed[-1] - speed[0]) / (time[-1] - time[0])
    own = trajectory.tension[late, 99].mean()
    assert own == pytest.approx((60.0 + ROLLER) * (GRAVITY - acceleration), rel=5e-3)  # it is let down
    assert abs(metrics["energy_residual_relative"]) < 1e-4, sorted(metrics)


def swing_frequencies(links, weight):
    """Circular frequencies of a hanging chain of point masses with a weight on its last pin [rad/s], lumped."""
    masses = np.full(links, ROLLER)
    masses[-1] += weight
    tension = GRAVITY * np.cumsum(masses[::-1])[::-1]  # of link i, above pin i + 1
    stiffness = np.diag(tension / PITCH) + np.diag(np.append(tension[1:], 0.0) / PITCH)
    stiffness -= np.diag(tension[1:] / PITCH, 1) + np.diag(tension[1:] / PITCH, -1)
    return np.sqrt(np.linalg.eigvals(stiffness / masses[:, None]).real.clip(0.0))


def test_a_hanging_chain_swings_as_bessel_says():
    """omega_k^2 = j_k^2 g / (4 L), j_k the zeros of J_0; of point masses, with a small weight on the last, lumped."""
    links, weight = 60, 0.02
    lumped = np.sort(swing_frequencies(links, weight))[:3]
    length = links * PITCH
    bessel = np.array([2.404825557695773, 5.520078110286311, 8.653727912911013]) * np.sqrt(GRAVITY / length) / 2.0
    np.testing.assert_allclose(lumped, bessel, rtol=2.0 / links)  # of first order in 1/N: half a pin too many, and that
    drive = rope(links, [{"center": [0.0, 0.0]}, {"center": [0.0, -length], "mass": weight, "mount": {"kind": "free"}}])
    found = 2.0 * np.pi * np.sort(modes(drive, count=3).frequency)
    np.testing.assert_allclose(found, lumped, rtol=1e-3)  # links' stretch is 1e-6 of them


def test_the_last_link_over_a_wheel_is_lifted_as_polygon_action_says():
    """A weight on a slider below a wheel of z teeth at constant speed: largest acceleration p omega^2 / 2."""
    omega = 1.0
    values = file_values(hoist(links=60, weight=100.0, duration=1.3))
    values["chain"]["stiffness"] = 2e8  # it bounces at twelve times the frequency of the teeth
    first, wheel, weight = values["sprockets"]
    wheel |= {"prescribed": {"speed": omega, "ramp_time": 0.3}}
    first |= {"mass": 2.0, "mount": {"kind": "slider", "direction": [0.0, -1.0], "stiffness": 0.0, "damping": 0.0}}
    weight |= {"mount": {"kind": "slider", "direction": [0.0, -1.0], "stiffness": 0.0, "damping": 2000.0}}
    trajectory, _ = run_of(Drive(**values), rate=5000.0)
    speed = np.gradient(trajectory.sprocket_center[:, 2, 1], trajectory.time)
    late = trajectory.time > 1.3 - 3.0 * 2.0 * np.pi / (omega * 21)  # three pitches
    radius = 0.5 * PITCH / np.sin(np.pi / 21)
    assert np.mean(speed[late]) == pytest.approx(-omega * 21 * PITCH / (2.0 * np.pi), rel=2e-3)
    # the polygon's speeds are R omega cos(pi / z) to R omega; the jumps of acceleration, p omega^2, let it bounce
    bouncing = np.sqrt(2e8 / 31.0 / 100.0)  # on the 31 links below the wheel
    polygon = radius * omega * (1.0 - np.cos(np.pi / 21))
    assert np.ptp(speed[late]) == pytest.approx(polygon + 2.0 * PITCH * omega**2 / bouncing, rel=0.15)


ENDS = {
    "fixed": {"center": [-0.08521, -0.4]},
    "led": {
        "center": [-0.08521, -0.4],
        "mount": {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 2e-4, "frequency": 15.0},
    },
    "slider": {
        "center": [-0.08521, -0.4], "mass": 40.0,
        "mount": {"kind": "slider", "direction": [0.0, -1.0], "stiffness": 2e5, "damping": 100.0},
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ENDS)
def test_energy_is_in_balance_with_an_end_that_is(kind):
    """Of second order in the step: with a led end 3.3e-4 at 10 us, 8e-5 at 5."""
    trajectory, metrics = run_of(hoist(start=ENDS[kind], duration=0.1, step=5e-6))
    assert abs(metrics["energy_residual_relative"]) < 1e-4
    assert trajectory.position.shape[1] == 41 and not metrics["diverged"]


def test_an_end_on_an_arm_turns_it():
    """An arm of 0.3 m from its pivot to the end, on a spring: k angle = T times the lever, at rest."""
    drive = hoist(duration=0.3)
    values = file_values(drive)
    values["arms"] = [
        {"name": "beam", "pivot": [-0.38521, -0.4], "mass": 1.0, "center": [-0.23521, -0.4], "inertia": 0.05,
         "stiffness": 2e4, "free_angle": 0.0, "damping": 50.0},
    ]  # fmt: skip
    first = values["sprockets"][0]
    first |= {"mass": 0.5, "mount": {"kind": "arm", "arm": "beam"}}
    trajectory, metrics = run_of(Drive(**values))
    late = trajectory.time > 0.1
    angle, tension = trajectory.arm_angle[late, 0], trajectory.tension[late, 0]
    lever = 0.3 * np.cos(angle.mean())
    weight = GRAVITY * (1.0 * 0.15 + 0.5 * 0.3)
    assert 2e4 * angle.mean() == pytest.approx(tension.mean() * lever - weight, rel=0.02)
    assert abs(metrics["energy_residual_relative"]) < 1e-4


def test_an_open_chain_reads_back_and_is_assembled_from_end_to_end():
    drive = hoist()
    assert loads_drive(dumps_drive(drive)) == drive
    assert drive.strand_names == ("start->wheel", "wheel->weight")
    state = assemble(drive)
    assert state.position.shape == (41, 2)
    assert state.seat_sprocket[0] == 0 and state.seat_sprocket[-1] == 2
    np.testing.assert_allclose(state.position[0], [-0.08521, -0.4], atol=1e-8)
    lengths = np.hypot(*np.diff(state.position, axis=0).T)
    np.testing.assert_allclose(lengths, PITCH, rtol=2e-3)


WRONG = {
    "of no sprocket": ({"chain": {"ends": ["start", "nothing"]}}, "chain.ends"),
    "not the last": ({"chain": {"ends": ["weight", "start"]}}, "chain.ends"),
    "one of them": ({"chain": {"ends": ["start"]}}, "chain.ends"),
    "too few links": ({"chain": {"links": 12}}, "chain.links = 12"),
    "teeth": ({"end": {"teeth": 21}}, "sprockets.start.teeth"),
    "a free one without mass": ({"end": {"mount": {"kind": "free"}}}, "sprockets.start.mass"),
    "an unknown arm": ({"end": {"mass": 1.0, "mount": {"kind": "arm", "arm": "beam"}}}, "arm"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_end_is_refused(case):
    changes, place = WRONG[case]
    values = file_values(hoist())
    values["chain"] |= changes.get("chain", {})
    values["sprockets"][0] |= changes.get("end", {})
    with pytest.raises((DriveError, WarpchainError), match=place):
        assemble(Drive(**values))


def test_a_loop_turns_the_shaft_of_an_open_chain():
    """A loop lifts 100 kg through a shaft: energy of both chains in balance, the speed of the load by the ratio."""
    beside = {"name": "lift", "plane": "beside", "ends": ["load", "free end"], "links": 80}
    chain = {"size": "16B", "stiffness": 5e7, "damping_ratio": 0.02}
    names = ("motor", "driven", "load", "wheel", "free end")
    keys: list[dict] = [
        {"chain": "primary", "teeth": 15, "center": [0.5, 0.0], "prescribed": {"speed": 3.0, "ramp_time": 0.2}},
        {"chain": "primary", "teeth": 25, "center": [0.0, 0.0], "shaft": "drum", "inertia": 0.05},
        {"chain": "lift", "center": [-0.061, -1.39], "mass": 100.0, "mount": {"kind": "free"}},
        {"chain": "lift", "teeth": 15, "center": [0.0, 0.0], "shaft": "drum", "inertia": 0.01},
        {"chain": "lift", "center": [0.061, -0.45], "mass": 2.0, "mount": {"kind": "free"}},
    ]
    drive = Drive(
        chains=[chain | {"name": "primary", "links": 60}, chain | beside],
        sprockets=[{"name": name, "wrap": "cw"} | of for name, of in zip(names, keys, strict=True)],
        shafts=[{"name": "drum", "inertia": 0.02}],
        contact={"sprocket": CONTACT},
        run={"duration": 0.5, "gravity": [0.0, -GRAVITY], "step": 4e-6, "sample_rate": 2000.0, "start": True},
    )
    trajectory, metrics = run_of(drive, window=(0.0, 0.5))
    assert abs(metrics["energy_residual_relative"]) < 3e-4
    late = trajectory.time > 0.3
    height = trajectory.sprocket_center[late, 2, 1]
    rising = np.polyfit(trajectory.time[late], height, 1)[0]
    assert rising == pytest.approx(3.0 * 15.0 / 25.0 * 15.0 * PITCH / (2.0 * np.pi), rel=0.1)  # it bounces on the way


def test_only_a_wheel_with_teeth_has_a_margin_to_jump():
    trajectory, _ = run_of(hoist(duration=0.05))
    assert [bool(np.isfinite(tooth_jump_margin(trajectory, s).margin).any()) for s in range(3)] == [False, True, False]


def test_a_weight_on_the_first_pin_hangs_as_one_on_the_last():
    ends = [{"center": [0.0, 0.0]}, {"center": [0.0, -0.76], "mass": 50.0, "mount": {"kind": "free"}}]
    one, other = (assemble(rope(30, of)).position for of in (ends, ends[::-1]))
    np.testing.assert_allclose(other, one[::-1], atol=1e-12)


RIM, WEIGHT = 0.2, 60.0


def crank(turned, last=False, shafts=(), **run):
    """30 links that hang from the rim of a wheel at the height of its center, on its right, down to a weight."""
    rim = {"name": "rim", "center": [-RIM, 0.0], "rim": RIM} | turned
    weight = {"name": "weight", "center": [0.0, -0.762], "mass": WEIGHT, "mount": {"kind": "free"}}
    ends = [weight, rim] if last else [rim, weight]
    return Drive(
        chain={
            "size": "16B", "links": 30, "stiffness": 2e7, "damping_ratio": 0.05, "ends": [end["name"] for end in ends],
        },
        sprockets=ends,
        contact={"sprocket": CONTACT},
        run={"duration": 0.4, "gravity": [0.0, -GRAVITY], "sample_rate": 2000.0, "step": 1e-5} | run,
        **({"shafts": list(shafts)} if shafts else {}),
    )  # fmt: skip


@pytest.mark.parametrize("last", [False, True])
def test_an_end_on_a_rim_is_led_around_its_center(last):
    drive = crank({"prescribed": {"speed": 2.0, "ramp_time": 0.2}}, last)
    trajectory, metrics = run_of(drive, window=(0.0, 0.4))
    s = int(last)
    angle, pin = trajectory.sprocket_angle[:, s], trajectory.position[:, -1 if last else 0]
    place = np.stack([-RIM + RIM * np.cos(angle), RIM * np.sin(angle)], axis=1)
    np.testing.assert_allclose(pin, place, atol=1.5 * 800.0 / 2e7)  # the hole gives by T / k
    # what holds the pin turns the wheel: input work is the rise of the weight and the chain, and their motion
    mass = WEIGHT + 30.5 * ROLLER
    speed = RIM * 2.0 * np.cos(angle[-1])
    expected = mass * GRAVITY * RIM * np.sin(angle[-1]) + 0.5 * mass * speed**2
    assert metrics["input_work"] == pytest.approx(expected, rel=0.02)
    assert abs(metrics["energy_residual_relative"]) < 1e-6


def test_a_wheel_that_turns_freely_balances_its_rim_s_pull():
    pull = GRAVITY * (WEIGHT + 30.5 * ROLLER)
    drive = crank({"inertia": 0.5, "load": {"torque": -pull * RIM}})
    trajectory, metrics = run_of(drive, window=(0.0, 0.4))
    # ramped up or not, it stands: 0.4 s of a hundredth of the torque would turn it by 0.04
    assert np.abs(trajectory.sprocket_angle[:, 0]).max() < 4e-3
    assert abs(metrics["energy_residual_relative"]) < 1e-6


def test_a_rim_on_a_shaft_turns_as_one_that_is_led_itself():
    motion = {"speed": 2.0, "ramp_time": 0.2}
    own, _ = run_of(crank({"prescribed": motion}))
    drum, metrics = run_of(crank({"shaft": "drum"}, shafts=[{"name": "drum", "prescribed": motion}]))
    np.testing.assert_allclose(drum.position, own.position, atol=1e-12)
    assert metrics["drum.speed_max"] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"sprockets.wheel.rim": 0.1}, "sprockets.wheel.rim: only of an end of an open chain"),
        ({"sprockets.weight.rim": 0.1}, "sprockets.weight.mount: must be fixed with rim"),
        ({"sprockets.start.rim": -0.1}, "sprockets.start.rim = -0.1: must be a positive number"),
        (
            {"sprockets.start.key": 30.0},
            "sprockets.start.key = 30.0: not of an end of a chain, which has no teeth and no",
        ),
    ],
)
def test_a_rim_where_none_can_be_is_one_line(values, line):
    with pytest.raises(DriveError) as caught:
        hoist().with_values(values)
    assert line in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("joint", [None, {"friction": 0.1, "pin_radius": 0.008}])
def test_a_loop_cut_open_and_tied_together_again_has_the_loop_s_bits(joint):
    """The way of open chains through the kernel, with no link absent, against that of a loop."""
    drive = two_sprockets(gravity=-GRAVITY, torque=50.0).with_values({"chain.joint": joint} if joint else {})
    loop, tied = (pack([drive], [Schedule(5e-6, 2000, 0, 2000, 0)]) for _ in range(2))
    tied.chains["absent"] = drive.chain.links + 1  # a link that there is not
    found = [state(raw_run(of)[0]) for of in (loop, tied)]
    np.testing.assert_array_equal(found[1], found[0])
    loop.chains["absent"] = drive.chain.links  # cut, it falls apart
    assert np.abs(state(raw_run(loop)[0]) - found[0]).max() > 1e-3


@pytest.mark.parametrize("links", [30, 60])
def test_a_weight_that_stretches_the_chain_too_far_is_refused(links):
    weak = {"chain.stiffness": 1e-300}
    with pytest.raises(
        DriveError, match=r'"weight": its weight and preload stretch the chain by .* %; allowed is at mo'
    ):
        assemble(hoist(links=links).with_values(weak))


def test_copies_of_ends_can_change_anything_but_have_no_teeth():
    drive = crank({"inertia": 0.5, "load": {"torque": -120.0}})
    for values in ({"sprockets.rim.rim": 0.1}, {"sprockets.rim.load": None}, {"sprockets.weight.mass": 3.0}):
        copy = drive.with_values(values)
        assert loads_drive(dumps_drive(copy)) == copy
    assert hoist().with_values({"sprockets.start.prescribed": {"speed": 1.0}}).sprockets[0].prescribed.speed == 1.0
    with pytest.raises(DriveError, match=r"sprockets\.rim\.teeth = 1: must be an integer of at least 5"):
        drive.with_values({"sprockets.rim.teeth": 1})
