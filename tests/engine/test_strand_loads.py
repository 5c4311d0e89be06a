"""Goods on a strand: what they weigh, their inertia, feeding and work, against closed forms."""

import numpy as np
import pytest
from drives import two_sprockets
from open_chains import CONTACT, hoist
from raw import settling, state

from warpchain import Drive, Record, dumps_drive, loads_drive, simulate
from warpchain.assembly.assembly import assemble_chain
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import at_work
from warpchain.assembly.strand_load import goods_on_pins
from warpchain.assembly.timestep import step_limit
from warpchain.engine.pack import pack
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule

GRAVITY, HEIGHT, PITCH, OWN = 9.81, 2.0, 0.1, 5.0


def elevator(load=None, angle=90.0, speed=4.0, **run):
    """A chain of 60 links on wheels of 20 teeth, 2 m apart, the upper one turned; its strand "tail" to "head" rises."""
    way = HEIGHT * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    return Drive(
        chain={
            "pitch": PITCH, "links": 60, "mass_per_length": OWN, "stiffness": 2e7, "damping_ratio": 0.05,
            "roller_radius": 0.02,
        }
        | ({"load": {"between": ["tail", "head"]} | load} if load else {}),
        sprockets=[
            {"name": "tail", "teeth": 20, "center": [0.0, 0.0], "wrap": "ccw", "inertia": 0.5},
            {"name": "head", "teeth": 20, "center": way.tolist(), "wrap": "ccw", "prescribed": {"speed": speed}},
        ],
        contact={"sprocket": CONTACT},
        run={"duration": 0.5, "gravity": [0.0, -GRAVITY], "sample_rate": 1000.0} | run,
    )  # fmt: skip


def metrics(drive, **options):
    (row,) = simulate(drive, record=Record("none"), device="cpu", **options).metrics.to_pylist()
    return row


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("feed", [0.0, 1.0])
def test_goods_are_lifted_and_brought_to_the_chain_s_speed(feed, precision):
    """Power q v (g H + v^2 / 2 - u^2 / 2 + (v - u)^2 / 2): height, kinetic energy, and what their slip takes."""
    row = metrics(elevator({"load_per_length": 20.0, "feed_speed": feed}), precision=precision)
    seconds = row["window_end"] - row["window_start"]
    speed = 4.0 * 20 * PITCH / (2 * np.pi)
    each = GRAVITY * HEIGHT + 0.5 * speed**2 - 0.5 * feed**2 + 0.5 * (speed - feed) ** 2
    # the window holds 3.2 pitches of each wheel, of which a part is 2e-3 of the time; polygon action 6e-3 of the speed
    assert row["goods.work"] / seconds == pytest.approx(20.0 * speed * each, rel=3e-3)
    assert row["output_work"] == row["goods.work"]
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_steps_of_half_the_length_change_the_work_by_the_second_order():
    drive = elevator({"load_per_length": 20.0}, duration=0.1)
    work = [metrics(drive, step=step, window=(0.02, 0.1))["energy_residual"] for step in (1.6e-5, 8e-6)]
    assert abs(work[1]) < 0.6 * abs(work[0]) < 0.01


def test_a_strand_at_rest_bears_the_goods_on_it():
    # between two links of the strand hangs what lies between them, chain and goods; and settled forces are the gradient
    drive = elevator({"load_per_length": 20.0, "begin": 0.5, "end": 1.25}, speed=0.0)
    packed = pack([drive], [Schedule(5e-6, 1, 1, 1, 0)])
    engine, _ = settling(packed, 0.3 * step_limit(drive), 1e-8, 1_000_000)
    assert engine.settling_states()["settled"][0] == 1
    model = single_chain(drive)
    assembly = assemble_chain(model)
    place = state(engine)[:2].T
    side = np.roll(place, -1, axis=0) - place
    pull = 2e7 * (np.hypot(*side.T) - PITCH)
    rising = np.flatnonzero((place[:, 0] > 0.25) & (place[:, 1] > 0.2) & (place[:, 1] < 1.8))
    first, last = rising.min(), rising.max()
    weight = GRAVITY * (OWN * PITCH * (last - first) + 20.0 * 0.75)
    assert pull[last] - pull[first] == pytest.approx(weight, rel=1e-3)  # its links are upright to that
    goods = goods_on_pins(model, assembly.path, place)
    assert goods.sum() == pytest.approx(20.0 * 0.75, rel=1e-4)  # links' stretch
    potential = Potential(model, 0.0, np.zeros(2), goods=goods)
    x = np.zeros(potential.size)
    rollers, centers, angles = potential.parts_of_coordinates(x)
    rollers[:], centers[:], angles[:] = place, packed.bodies["center"], packed.bodies["angle"]
    assert np.abs(potential.terms(x).gradient[: 2 * len(place)]).max() < 1e-6 * pull.max()
    # and so says the check: the strand's mean tension over the other one's
    plain, loaded = at_work(single_chain(elevator(speed=0.0))).tension, at_work(model).tension
    assert loaded[0] - plain[0] > 0.3 * GRAVITY * 20.0 * 0.75


def incline(angle, friction, load, speed=0.4):
    """40 links of an open chain on a rail of an angle, led up it by its last pin, held back by 50 N at its first.

    Goods lie all along it.
    """
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    across = np.array([-along[1], along[0]])
    at = [(s * along).tolist() for s in (0.0, 40 * PITCH)]
    rail = [(s * along - 0.02 * across).tolist() for s in (-1.0, 6.0)]
    time = np.linspace(0.0, 0.8, 161)
    ramp = np.clip(time / 0.32, 0.0, 1.0)  # four periods of its stretching, which it hardly excites
    way = speed * (0.32 * (ramp**3 - 0.5 * ramp**4) + np.maximum(time - 0.32, 0.0))
    led = {
        "kind": "prescribed",
        "table": {"time": time.tolist(), "x": (along[0] * way).tolist(), "y": (along[1] * way).tolist()},
    }
    back = {"kind": "slider", "direction": (-along).tolist(), "stiffness": 0.0, "damping": 0.0, "preload": 50.0}
    return Drive(
        chain={
            "pitch": PITCH, "links": 40, "mass_per_length": OWN, "stiffness": 2e6, "damping_ratio": 0.2,
            "roller_radius": 0.02, "ends": ["rear", "front"],
        }
        | ({"load": {"between": ["rear", "front"], "load_per_length": load}} if load else {}),
        sprockets=[
            {"name": "rear", "center": at[0], "mass": 0.5, "mount": back},
            {"name": "front", "center": at[1], "mount": led},
        ],
        guides=[{"name": "rail", "start": rail[0], "end": rail[1], "end_radius": 0.1}],
        contact={
            "sprocket": CONTACT,
            "guide": {"stiffness": 1e6, "restitution": 0.1, "restitution_means": "rebound", "impact_speed_floor": 0.02,
                      "friction": friction},
        },
        run={"duration": 0.72, "gravity": [0.0, -GRAVITY], "start": True, "sample_rate": 1000.0},
    )  # fmt: skip


@pytest.mark.parametrize(("angle", "friction", "load"), [(0.0, 0.2, 0.0), (20.0, 0.2, 0.0), (20.0, 0.2, 15.0)])
def test_the_pull_up_an_incline_is_w_l_of_mu_cosine_and_sine(angle, friction, load):
    run = simulate(incline(angle, friction, load), device="cpu", window=(0.4, 0.72))
    trajectory = run[0]
    late = trajectory.time > 0.4
    pull = trajectory.tension[late, 39].mean()
    pins = np.ones(41)
    pins[-1] = 0.0  # the last pin is what pulls
    mass = (
        0.5 + OWN * PITCH * pins.sum() + load * PITCH * (pins.sum() - 0.5)
    )  # the first pin has goods on one side only
    radians = np.radians(angle)
    on_rail = mass - 0.5  # what the slide of the first pin holds does not rub
    expected = 50.0 + GRAVITY * (mass * np.sin(radians) + friction * on_rail * np.cos(radians))
    assert pull == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("load", "line"),
    [
        ({"load_per_length": -1.0}, "chain.load.load_per_length = -1.0: must be a number of at least 0"),
        ({}, "chain.load.load_per_length: missing; must be a number of at least 0"),
        (
            {"load_per_length": 1.0, "begin": 1.0, "end": 0.5},
            "chain.load.end = 0.5: must be more than begin, 1",
        ),
        (
            {"load_per_length": 1.0, "between": ["tail", "neck"]},
            'chain.load.between = ["tail", "neck"]: must be two sprockets of the chain, one after the other: one of '
            "[tail, head], [head, tail]",
        ),
        ({"load_per_length": 1.0, "where": 1.0}, "chain.load.where = 1.0: unknown key; "),
    ],
)
def test_what_is_wrong_is_one_line(load, line):
    with pytest.raises(DriveError) as caught:
        elevator(load or {"feed_speed": 0.0})
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_goods_beyond_their_strand_are_refused():
    with pytest.raises(DriveError, match=r"load\.end = 2\.5: must be at most the length of the strand from tail"):
        simulate(elevator({"load_per_length": 1.0, "end": 2.5}), device="cpu")


def test_an_open_chain_s_gap_carries_nothing():
    with pytest.raises(DriveError, match=r"one of \[start, wheel\], \[wheel, weight\]"):
        hoist().with_values({"chain.load": {"load_per_length": 1.0, "between": ["weight", "start"]}})


def test_files_keep_them():
    drive = two_sprockets().with_values({"chain.load": {"load_per_length": 1.0, "between": ["driver", "driven"]}})
    assert loads_drive(dumps_drive(drive)) == drive
