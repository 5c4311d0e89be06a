"""Judgement of variants: every limit by made-up metrics, as a caller sets it, and the line that tells."""

import math
import time

import numpy as np
import pytest
from drives import example, two_sprockets

from warpchain import Limits, Record, simulate
from warpchain.engine.struct_rows import JOINT_INERTIA
from warpchain.errors import DriveError
from warpchain.kernels import relaxation
from warpchain.kernels.physics import friction
from warpchain.results.judgement import (
    LEAST_STRETCH,
    LIMIT_RULES,
    UNMEASURED_REASON,
    common_reasons,
    judge_variants,
    judgement_warning,
)
from warpchain.results.metric_formulas import EnergyBalance
from warpchain.results.step_resolution import BRISTLE_STIFFNESS

SIZED = two_sprockets().with_values(  # its breaking load is 250 kN
    {"chain.size": "32B", "chain.stiffness": 5e7, "sprockets.driver.prescribed.ramp_time": 0.1}
)


def judged(drive=SIZED, limits=None, measured=True, layouts=None, **metrics):
    """(status, reason) of one variant with these metrics."""
    given = {"diverged": False, "diverged_time": 0.0, **metrics}
    columns = {
        name.replace("__", "."): (np.array([value if value is not None else 0.0]), np.array([value is None]))
        for name, value in given.items()
    }
    found = judge_variants([drive], columns, np.array([measured]), limits, layouts)
    return found.status[0], found.reason[0]


PULLED = {"tension_min": -1000.0, "tension_max": 10.0}
AFTER = {"tension_mean": 100.0, "window_start": 0.1, "window_end": 0.3}
BEYOND = {
    "energy_residual": ({"energy_residual_relative": -0.011}, {"energy_residual_relative": -0.009}, "-1.1 %"),
    "energy_change": ({"energy_change_relative": -0.51}, {"energy_change_relative": 0.49}, "-51 % of the losses"),
    "settle_residual": (PULLED | {"settle_force": 11.0}, PULLED | {"settle_force": 9.0}, "0.011"),
    "breaking_load": ({"tension_max": 175.1e3}, {"tension_max": 174.9e3}, "links yield from 0.7 on"),
    "compression": (
        {"tension_max": 100.0, "a->b__tension_min": -101.0},
        {"tension_max": 100.0, "a->b__tension_min": -99.0},
        "a->b: a link pushes with 1 of the largest tension",
    ),
    "mean_compression": (
        {"tension_max": 100.0, "a->b__tension_mean": -1.1},
        {"tension_max": 100.0, "a->b__tension_mean": -0.9},
        "a->b: pushes in the mean, with 0.011 of the largest tension",
    ),
    "resolution": ({"joints__resolution": 44.0}, {"joints__resolution": 46.0}, "joints: only 44 steps in the shortest"),
    "joint_give": (
        {"a->b__joint_give": 0.08, "energy_change_relative": -0.6},
        {"a->b__joint_give": 0.04, "energy_change_relative": -0.6},
        # the square of the step: half of sqrt(0.05 / 0.08)
        "a->b: joints that stick give way by 8 % of its tension_q999 at this step, but little at 0.4 of it",
    ),
    "start": (
        AFTER | {"tension_drift": -7.1},
        AFTER | {"tension_drift": 6.9},
        "the mean tension changes by -7.1 % in the window: the start still swings",
    ),
    "slips": ({"driver__slips": -2}, {"driver__slips": 0}, "driver: slipped by 2 teeth"),
    "missed": ({"blade__missed": 3}, {"blade__missed": 0}, "blade: missed by 3 rollers"),
    "engaged": ({"driven__engaged": 0.4}, {"driven__engaged": 0.6}, "driven: only 40 %"),
    "valve_float": ({"inlets__valve_float": 0.2}, {"inlets__valve_float": 0.0}, "inlets: followers would lift off"),
}
"""Of each limit metrics beyond it, metrics within, and what the reason says."""
OFF = {"engaged": 0.0, "resolution": 0.0}
WIDER = {"energy_residual": 0.02, "energy_change": 0.6, "settle_residual": 2e-2, "breaking_load": 1.5}
WIDER |= {"slips": 2.0, "missed": 3.0, "engaged": 0.3, "resolution": 43.0, "compression": 1.1, "mean_compression": 0.02}
WIDER |= {"valve_float": 0.3, "start": 0.08, "joint_give": 0.09}
BESIDE = {"joint_give": {"energy_change": math.inf}}
"""Other limits, of what is judged in starts only."""


@pytest.mark.parametrize("key", [rule.key for rule in LIMIT_RULES])
def test_a_limit_judges_by_its_metric_as_the_caller_sets_it(key):
    beyond, within, words = BEYOND[key]
    (rule,) = (rule for rule in LIMIT_RULES if rule.key == key)
    beside = BESIDE.get(key, {})
    status, reason = judged(limits=Limits(**beside), **beyond)
    assert status == "suspect" and words in reason and reason.endswith(rule.advice)
    assert judged(limits=Limits(**beside), **within) == ("ok", "")
    assert judged(limits=Limits(**beside, **{key: WIDER[key]}), **beyond) == ("ok", "")
    assert judged(limits=Limits(**beside, **{key: OFF.get(key, math.inf)}), **beyond) == ("ok", "")


def test_a_start_is_judged_by_what_holds_in_one_and_drives_beside_it_by_all():
    start = SIZED.with_values({"run.start": True})
    for key, (beyond, _, words) in BEYOND.items():
        beside = Limits(**BESIDE.get(key, {}))
        status, reason = judged(start, beside, **beyond)
        assert (status, words in reason) == (("ok", False) if key in ("energy_change", "start") else ("suspect", True))
    columns = {"energy_change_relative": np.array([0.9, 0.9]), "diverged": np.zeros(2), "diverged_time": np.zeros(2)}
    given = {name: (values, np.zeros(2, dtype=bool)) for name, values in columns.items()}
    assert judge_variants([start, SIZED], given, np.ones(2, dtype=bool)).status == ["ok", "suspect"]


def test_limits_and_rules_are_the_same_keys():
    assert [*(rule.key for rule in LIMIT_RULES), "layout"] == list(Limits.model_fields)


def test_what_is_null_or_has_no_scale_is_not_judged():
    assert judged(driver__slips=None, energy_residual_relative=None) == ("ok", "")
    assert judged(two_sprockets(), tension_max=1e12) == ("ok", "")  # without a size no breaking load
    assert judged(settle_force=1e-12, tension_min=0.0, tension_max=0.0) == ("ok", "")
    assert judged(**AFTER | {"tension_drift": 90.0, "window_start": 0.09}) == ("ok", "")  # the ramp is not over
    assert judged(two_sprockets(), **AFTER | {"tension_drift": 90.0}) == ("ok", "")  # without a ramp
    for change in ({}, {"energy_change_relative": 0.4}, {"energy_change_relative": None}):  # no start
        assert judged(**{"a->b__joint_give": 90.0}, **change) == ("ok", "")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_suspect_whatever_the_limits(value):
    said = "take a smaller step (run.step) or a higher impact_speed_floor, or less load"
    assert judged(energy_residual_relative=value) == ("suspect", f"energy_residual_relative is not finite: {said}")
    wide = Limits(energy_residual=math.inf, energy_change=math.inf)
    assert judged(limits=wide, energy_residual=value, energy_residual_relative=0.0)[0] == "suspect"
    assert judged(energy_residual=None) == ("ok", "")


def test_several_reasons_stand_together_and_diverged_is_worst():
    status, reason = judged(energy_residual_relative=0.5, driver__slips=1)
    assert status == "suspect" and "energy residual +50 %" in reason and "; driver: slipped by 1 teeth" in reason
    told = "diverged at 0.25 s: take a smaller step (run.step) or a higher impact_speed_floor"
    assert judged(diverged=True, diverged_time=0.25, measured=False, driver__slips=1) == ("diverged", told)
    assert judged(measured=False) == ("suspect", UNMEASURED_REASON)


def test_a_layout_that_is_wrong_is_the_reason_and_takes_the_place_of_the_smaller_step():
    assert judged(layouts=[("strands cross",)]) == ("suspect", "strands cross")
    assert judged(layouts=[("strands cross",)], limits=Limits(layout=1.0)) == ("ok", "")
    status, reason = judged(diverged=True, diverged_time=0.25, measured=False, layouts=[("strands cross",)])
    assert (status, reason) == ("diverged", "diverged at 0.25 s; strands cross")


def test_mistakes_in_limits_are_told_all_at_once():
    with pytest.raises(DriveError) as caught:
        Limits(energy_residual=-1, engaged=2, slip=1)
    assert caught.value.errors == (
        "limits: energy_residual = -1: must be a number of at least 0, or inf",
        "limits: engaged = 2: must be a number from 0 to 1",
        "limits: slip = 1: unknown key; did you mean slips?",
    )


def test_one_line_names_variants_counts_and_the_first_of_like_reasons():
    status = ["ok", "suspect", "diverged", *7 * ["suspect"], "suspect"]
    reason = ["", "a: 1", "gone at 3 s", *(f"a: {v}" for v in range(7)), UNMEASURED_REASON]
    assert judgement_warning(status, reason) == (
        "8 of 11 variants are suspect and 1 diverged (1, 2, 3, 4, 5, 6 and 3 more): 8 variants, e.g. a: 1; "
        "1 variant: gone at 3 s"
    )
    assert judgement_warning(["suspect"], ["a: 1"]) == "suspect: a: 1"
    assert judgement_warning(["diverged"], ["diverged at 1 s"]) == "diverged at 1 s"
    assert judgement_warning(["ok", "suspect"], ["", UNMEASURED_REASON]) is None
    alike = common_reasons([("suspect", "x 1"), ("suspect", "x 2e-3"), ("suspect", "y")])
    assert alike == [("suspect", "x 1", 2), ("suspect", "y", 1)]


def test_a_residual_is_held_against_a_thousandth_of_what_is_stored_where_hardly_any_energy_is_turned_over():
    """1e-9 J missing of 1e-8 J turned over, with 1 kJ stored, is round-off: 1e-9 / (1e-3 1e3); of 10 J it stays."""
    still = EnergyBalance(input=1e-8, output=9e-9, links=0.0, dissipated=0.0, change=0.0, stored=1e3)
    assert still.relative_residual == pytest.approx(1e-9, rel=1e-6)
    busy = EnergyBalance(input=10.0, output=9.0, links=0.0, dissipated=0.0, change=0.0, stored=1e3)
    assert busy.relative_residual == pytest.approx(1.0 / 9.5)


def test_reasons_of_a_variant_do_not_depend_on_what_runs_beside_it():
    """A crowd's columns stand in the order of its first variants; clauses of one limit in that of the variant's own."""
    strands = SIZED.strand_names
    given = {f"{strand}.tension_mean": -2.0 for strand in strands}
    given |= {f"{name}.slips": 1.0 for name in ("driver", "driven")} | {"driven.gap_max": math.nan, "links": math.nan}
    given |= {"tension_max": 100.0, "diverged_time": 0.0, "diverged": False}

    def reason(names):
        columns = {name: (np.full(2, given[name]), np.array([False, False])) for name in names}
        return judge_variants([example("marine"), SIZED], columns, np.ones(2, dtype=bool)).reason[1]

    alone = reason(list(given))
    assert [alone.index(f"{strand}: pushes") for strand in strands] == sorted(
        alone.index(f"{strand}: pushes") for strand in strands
    )
    assert reason(sorted(given)) == reason(list(reversed(given))) == alone


def test_a_chain_of_another_drive_does_not_take_a_strand_from_its_limit():
    """A drive of several chains, one named like a sprocket of this drive, runs beside it."""
    beside = example("v6")
    name = beside.chains[0].name
    drive = two_sprockets()
    drive = drive.model_copy(
        update={"sprockets": (drive.sprockets[0].model_copy(update={"name": name}), *drive.sprockets[1:])}
    )
    columns = {f"{name}.slips": 1.0, "diverged": False, "diverged_time": 0.0}

    def reason(drives):
        given = {of: (np.full(len(drives), value), np.zeros(len(drives), dtype=bool)) for of, value in columns.items()}
        return judge_variants(drives, given, np.ones(len(drives), dtype=bool)).reason[0]

    assert reason([drive]) == reason([drive, beside]) != ""


def test_ten_thousand_variants_are_judged_in_little_time():
    """0.05 ms a variant at most, all of them suspect for three reasons; 0.01 ms here."""
    count = 10_000
    columns = {name: (np.full(count, value), np.zeros(count, dtype=bool)) for name, value in {
        "diverged": False, "diverged_time": 0.0, "energy_residual_relative": 0.5, "tension_max": 1e6,
        "driver.slips": 1.0, "driver.engaged": 1.1, "driven.engaged": 1.1,
    }.items()}  # fmt: skip
    took = []
    for _ in range(3):
        begin = time.process_time()
        found = judge_variants([SIZED] * count, columns, np.ones(count, dtype=bool), None, [()] * count)
        took.append(time.process_time() - begin)
    assert min(took) < 5e-5 * count
    assert set(found.status) == {"suspect"} and found.reason[0].count("; ") == 2


def test_numbers_of_kernels_are_theirs():
    """Results and kernels cannot import one another."""
    assert float(relaxation.LEAST_STRETCH) == LEAST_STRETCH
    assert pytest.approx(friction.SPRING * JOINT_INERTIA, rel=1e-12) == BRISTLE_STIFFNESS  # rounded


@pytest.mark.parametrize("torque", [1e25, 1e29])
def test_a_load_beyond_all_bounds_is_not_ok_whatever_the_limits(torque):
    """1e25 N m turn a camshaft of 1e-3 kg m^2 at 1e24 rad/s in 1e-4 s: J omega^2 / 2 is 1e45 J, and the rollers that it
    meets have energies whose differences are not numbers at 1e29 N m."""
    beats = {
        f"sprockets.{cam} cam.load.harmonics": [
            {"order": 4, "amplitude": 7.56, "phase": phases[0]}, {"order": 8, "amplitude": 0.96, "phase": phases[1]}
        ]
        for cam, phases in (("intake", (1.5708, -1.5708)), ("exhaust", (2.9671, 1.2217)))
    }  # fmt: skip
    values = beats | {"sprockets.intake cam.load.torque": torque, "valves": []}
    drive = example("car").with_values(values)
    (row,) = simulate(drive, duration=1e-4, record=Record("none")).metrics.to_pylist()
    assert row["status"] == "suspect"
    limits = Limits(**{key: OFF.get(key, math.inf) for key in Limits.model_fields})
    (row,) = simulate(drive, duration=1e-4, record=Record("none"), limits=limits).metrics.to_pylist()
    finite = math.isfinite(row["energy_residual"])
    assert (row["status"] == "ok") == finite and (finite or "is not finite" in row["reason"])
    assert finite == (torque < 1e29)
