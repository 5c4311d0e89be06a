"""Longer runs that go on from where shorter ones stood: the same bits as of one run, at both precisions."""

import numpy as np
import pytest
from drives import example, timing, two_sprockets

from warpchain import Record, simulate
from warpchain.engine.checkpoint import (
    MOST_STOPS,
    StateKeeper,
    States,
    VariantState,
    has_usable_sums,
    latest_stop_step,
    stop_steps,
    usable_notes,
)
from warpchain.engine.window_sums import LONG_BATCHES, note_steps
from warpchain.errors import SimulationError
from warpchain.results.schedule import Schedule

STEP = 2.0**-18
SHORT, LONG = 1024 * STEP, 2048 * STEP


def ensemble():
    """A settled drive with a guide-bar, one with arm and tensioner, one that slides, one that begins elsewhere, and one
    with an idler on an arm, whose bearing rubs.
    """
    marine = example("marine").with_values({"run.settle": True, "run.step": 1e-5})
    car = example("car")
    rubbing = two_sprockets().with_values({"contact.sprocket.friction": 0.1, "run.integrator": "rk4"})
    swing = example("swing_idler")
    started = {"run.perturbation": 3, "run.phase": 0.25, "run.seating": 2}
    drives = [marine, car, rubbing, marine.with_values(started), swing]
    return [drive.with_values({"run.step": STEP if k != 1 else STEP / 2}) for k, drive in enumerate(drives)]


def same(one, other):
    """Whether tables have the same bits, also where nothing is."""
    assert one.column_names == other.column_names
    for name in one.column_names:
        assert one[name].to_pylist() == other[name].to_pylist(), name


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize(
    ("window", "longer"),
    [
        ((256 * STEP, SHORT), (256 * STEP, 256 * STEP + 2 * 768 * STEP)),  # twice as long
        ((512 * STEP, 1000 * STEP), (1024 * STEP, LONG)),  # later: sums begin anew
    ],
)
def test_a_run_that_is_gone_on_with_has_the_bits_of_one_run(precision, window, longer):
    drives, record = ensemble(), Record("none")
    same_run = {"step": None, "precision": precision, "record": record, "device": "cpu"}
    short = States()
    simulate(drives, duration=SHORT, window=window, states=short, **same_run)
    assert all(kept is not None for kept in short.kept) and short.used == [False] * 5
    begin = [VariantState.from_bytes(kept.to_bytes()) for kept in short.kept]
    on, whole = States(begin=begin), States()
    gone_on = simulate(drives, duration=LONG, window=longer, states=on, **same_run)
    assert on.used == [True] * 5
    at_once = simulate(drives, duration=LONG, window=longer, states=whole, **same_run)
    same(gone_on.metrics, at_once.metrics)
    assert [kept.data for kept in on.kept] == [kept.data for kept in whole.kept]  # and so on from there
    plain = simulate(drives, duration=LONG, window=longer, **same_run)
    same(plain.metrics, at_once.metrics)  # stopping leaves no trace


@pytest.mark.parametrize("start", [8, 40])
def test_a_run_is_gone_on_with_where_looks_are_64_steps_apart(start):
    """Kept at a step with a look, and between two; of windows that are long enough for such looks."""
    drive = two_sprockets().with_values({"run.step": STEP})
    end = start + 20 * 16 * 64
    same_run = {"step": None, "record": Record("none"), "device": "cpu"}
    short = States()
    simulate([drive], duration=end * STEP, window=(start * STEP, end * STEP), states=short, **same_run)
    assert short.kept[0].facts["look_every"] == 64
    longer = {"duration": 2 * end * STEP, "window": (start * STEP, (2 * end - start) * STEP)}
    on = States(begin=short.kept)
    gone_on = simulate([drive], states=on, **longer, **same_run)
    assert on.used == [True]
    same(gone_on.metrics, simulate([drive], **longer, **same_run).metrics)


def test_what_does_not_fit_begins_anew():
    """Another start of the window; another drive, step or precision; a recorded variant."""
    drive = two_sprockets().with_values({"run.step": STEP})
    plain = {"step": None, "record": Record("none"), "device": "cpu"}
    short = States()
    simulate([drive] * 2, duration=SHORT, window=(0.0, SHORT), states=short, **plain)

    def used(drives, **more):
        states = States(begin=short.kept, keep=False)
        run = simulate(drives, states=states, **{**plain, "duration": LONG, **more})
        assert states.kept == [None] * 2
        same(run.metrics, simulate(drives, **{**plain, "duration": LONG, **more}).metrics)
        return states.used

    assert used([drive] * 2, window=(0.0, LONG)) == [True, True]
    assert used([drive] * 2, window=(0.0, 1.5 * SHORT)) == [True, True]  # each look of a window so short has its notes
    assert used([drive] * 2, window=(8 * STEP, LONG)) == [False, False]
    assert used([drive] * 2, window=(0.0, LONG), precision="float32") == [False, False]
    other = drive.with_values({"sprockets.driven.load.torque": 299.0})
    assert used([drive, other], window=(0.0, LONG)) == [True, False]
    assert used([drive, drive.with_values({"run.step": 0.5 * STEP})], window=(0.0, LONG)) == [True, False]
    assert used([drive] * 2, window=(0.0, LONG), record=Record((1,))) == [True, False]
    with pytest.raises(SimulationError, match="there are 2 for 3 variants"):
        used([drive] * 3)


def test_a_gpu_goes_on_with_the_same_window():
    """With a later one it begins anew; neither hangs on what is beside a variant."""
    drive = two_sprockets().with_values({"run.step": STEP})
    short, run = States(), "float64 cuda"
    simulate([drive], duration=SHORT, step=STEP, window=(0.0, SHORT), states=short, device="cpu", record=Record("none"))
    kept = VariantState({**short.kept[0].facts, "run": run}, short.kept[0].data)
    twice, later = (Schedule(STEP, 2048, first, 2048, 0) for first in (0, 1024))
    for begin, schedule, used in (
        ([kept, kept], twice, [True, True]),
        ([kept, kept], later, [False, False]),
        ([kept, None], twice, [True, False]),
    ):
        states = States(begin=begin)
        states.prepare(2)
        StateKeeper(states, [drive] * 2, [schedule] * 2, np.arange(2), run)
        assert states.used == used


def test_notes_are_taken_over_where_they_were_taken():
    """Note k of W steps from a is at the first multiple of 32 from a + k W / 80 on; of 2 W, at every other of them."""

    def kept(first, last):
        facts = {"window": [first, last], "look_every": 32}
        return VariantState({**facts, "next": latest_stop_step(Schedule(STEP, last, first, last, 0))}, b"")

    assert note_steps(0, 3200, 32).tolist() == [32 * -(-40 * k // 32) for k in range(1, 80)]
    assert note_steps(0, 3200, 32, LONG_BATCHES).tolist() == [160 * k for k in range(1, 20)]
    later = note_steps(np.array([0, 3]), np.array([3200, 3203]), 32)[1]
    assert later.tolist() == [32 * -(-(3 + 40 * k) // 32) for k in range(1, 80)]
    assert usable_notes(kept(0, 3200), Schedule(STEP, 6400, 0, 6400, 0)) == [(k, 2 * k + 1) for k in range(39)]
    assert usable_notes(kept(0, 3200), Schedule(STEP, 4800, 0, 4800, 0)) is None
    assert usable_notes(kept(0, 3200), Schedule(STEP, 64000, 0, 64000, 0)) == [(0, 19), (1, 39), (2, 59)]
    assert usable_notes(kept(0, 3200), Schedule(STEP, 256000, 0, 256000, 0)) == []  # the first is still ahead
    assert has_usable_sums(kept(0, 3200), Schedule(STEP, 64000, 0, 64000, 0))
    assert not has_usable_sums(kept(0, 3200), Schedule(STEP, 64000, 8, 64008, 0))
    assert not has_usable_sums(
        kept(0, 3200), Schedule(STEP, 64000, 0, 64000, 0, sample_interval=64)
    )  # looks weigh otherwise
    before = kept(0, 3200)  # of a version in which looks were always 32 steps apart
    before = VariantState({name: value for name, value in before.facts.items() if name != "look_every"}, before.data)
    assert has_usable_sums(before, Schedule(STEP, 64000, 0, 64000, 0))
    assert not has_usable_sums(before, Schedule(STEP, 64000, 0, 64000, 0, sample_interval=64))


@pytest.mark.parametrize("every", [0, 16, 48, 96, -32])
def test_looks_fall_on_steps_at_which_sums_are_merged(every):
    with pytest.raises(ValueError, match="allowed is 32 times a power of two"):
        Schedule(STEP, 100, 0, 100, 0, every)


def test_variants_of_many_steps_are_kept_at_few():
    schedules = [Schedule(STEP, n, 0, n, 0) for n in range(1000, 3000, 7)]
    stops = stop_steps(schedules)
    assert len(set(stops.tolist())) == MOST_STOPS and (stops % 32 == 0).all()
    wanted = np.array([latest_stop_step(schedule) for schedule in schedules])
    assert (stops <= wanted).all() and (stops > 0.9 * wanted - 160).all()


def test_a_state_of_the_timing_drive_is_small():
    """Of a hundred links on three sprockets and two guides: tens of kilobytes, as the documents say."""
    states = States()
    drive = timing()
    simulate(drive, duration=SHORT, step=STEP, states=states, device="cpu", record=Record("none"))
    assert 1e4 < len(states.kept[0].to_bytes()) < 2e5
