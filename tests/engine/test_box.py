"""The box that a drive's rollers stay in: as wide as the chain may hang; why a variant has left it."""

import math
import warnings
from concurrent.futures import wait

import numpy as np
import pytest
from drives import of_long, two_sprockets

from warpchain import Record, simulate
from warpchain.assembly import assemble
from warpchain.assembly.bounds import ESCAPE_PITCHES, escape_distance
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.end_states import divergence_causes
from warpchain.engine.pack import pack
from warpchain.engine.settling import settle_variants
from warpchain.engine.simulation import schedules_of
from warpchain.model import single_chain
from warpchain.results.judgement import DIVERGENCE_CAUSES

NONE = Record("none")
PITCH = 0.05
STILL = {"speed": 0.01, "torque": 0.0, "gravity": -9.81}
LONG = STILL | {"links": 620, "span": 300.0, "stiffness": 1e6}
"""Taut, and so long and soft that its weight lets each strand of 300 links sag by 46 pitches."""


def sag(links, stiffness, mass=1.0, gravity=9.81):
    """Depth s [m] at which a taut strand of chord C rests: its links pull with k p (8/3)(s/C)^2 = m g C^2/(8 p s)."""
    return (3.0 / 64.0 * mass * gravity * (links * PITCH) ** 4 / (stiffness * PITCH**2)) ** (1.0 / 3.0)


@pytest.mark.long
@pytest.mark.parametrize("links", [2020, 4020])
def test_thousands_of_links_that_sag_settle_within_their_box(links):
    """Of a stiff chain, by 60 and 150 pitches; was "diverged at 0 s"."""
    drive = two_sprockets(**STILL, links=links, span=(links - 20) / 2, stiffness=5e7, step=2e-6)
    run = simulate(drive, device="cpu", duration=1e-5)
    assert not run.metrics["diverged"][0].as_py()
    assert lowest(run) > 50.0 * PITCH


def lowest(run):
    return -run[0].position[..., 1].min()


@pytest.mark.parametrize("precision", [*of_long("float64"), pytest.param("float32", marks=pytest.mark.thorough)])
def test_a_long_taut_chain_that_settles_far_below_its_strands_runs(precision):
    """To 5 %: a parabola for a catenary, and C from seat to seat."""
    run = simulate(two_sprockets(**LONG, duration=0.001, step=1e-5), device="cpu", precision=precision)
    assert run.metrics["status"].to_pylist() == ["ok"]
    radius = 0.05 / (2.0 * math.sin(math.pi / 20))
    assert lowest(run) - radius == pytest.approx(sag(300, 1e6), rel=0.05)
    assert lowest(run) - radius > 4.0 * ESCAPE_PITCHES * PITCH


@pytest.mark.long
def test_one_that_falls_from_its_straight_strands_runs():
    """It passes its place of rest and comes to about 4^(1/3) times the depth: m g s (2/3) = k p^2 (8/3)^2 (s/C)^4 / 2 a
    link. In 1.2 s it is through that: of free fall it would be 0.7 s."""
    drive = two_sprockets(**LONG | {"stiffness": 4e6}, settle="false", duration=1.2, step=2e-5, damping=20.0)
    run = simulate(drive, device="cpu", record=Record(rate=20.0))
    assert not run.metrics["diverged"][0].as_py(), run.metrics["reason"][0].as_py()
    assert lowest(run) > 1.3 * sag(300, 4e6) > 2.0 * ESCAPE_PITCHES * PITCH


@pytest.mark.long
@pytest.mark.parametrize(
    ("gravity", "links"), [((0.0, -9.81), 428), ((-9.81, 0.0), 428), ((9.81, 9.81), 410), ((0.0, 0.0), 428)]
)
def test_the_box_holds_the_settled_chain_and_what_its_slack_lets_it_do(gravity, links):
    """All slack, and 5 % of stretch, in one strand of chord C: it reaches off it to the ellipse about its ends."""
    drive = two_sprockets(**STILL, links=links, span=195.0).with_values({"run.gravity": list(gravity)})
    packed = pack([drive], schedules_of([drive], None, None, NONE, None))
    margin = escape_distance(single_chain(drive), packed.assemblies[0])
    chord = 195 * PITCH
    spare = 2.0 * chord * (1.05 / (1.0 + min(packed.assemblies[0].strain, 0.0)) - 1.0)
    half = 0.5 * (chord + spare)
    assert margin == pytest.approx(half * math.sqrt(1.0 - (0.5 * chord / half) ** 2), rel=1e-3)
    before = packed.roller_rows(0)[0:2].copy()
    assert settle_variants(packed, [drive], "cpu", 1, 10**6, lambda futures, _: not wait(futures).not_done)[
        "settled"
    ].all()
    after, (row,) = packed.roller_rows(0)[0:2], packed.drives
    for place in (before, after):
        assert (place.min(axis=1) - margin >= row["low"]).all() and (place.max(axis=1) + margin <= row["high"]).all()


def test_short_drives_keep_their_ten_pitches():
    drive = two_sprockets()
    assert escape_distance(single_chain(drive), assemble(drive)) == ESCAPE_PITCHES * PITCH


def moved(drives, change):
    """Why the variants diverge, after `change` of the packed ensemble and one step."""
    packed = pack(drives, schedules_of(drives, None, None, NONE, None))
    change(packed)
    engine = CpuEngine(packed, 1)
    for future in engine.advance(1, engine.frame_buffer(0)):
        future.result()
    gone = engine.progress()["diverged"] != 0
    engine.close()
    return gone.tolist(), divergence_causes(engine, drives, gone)


def test_the_cause_is_told_by_where_everything_is():
    drives = [two_sprockets(), *(two_sprockets(settle="false") for _ in range(2)), *(two_sprockets() for _ in range(3))]

    def change(packed):
        packed.roller_rows(1)[0] += 50.0  # whole, elsewhere
        packed.roller_rows(2)[1, 3] = 9.0  # one roller
        packed.roller_rows(3)[0, 5] = np.nan
        packed.bodies["center"][packed.drives["first_body"][4] + 1] = (0.0, -90.0)

    gone, causes = moved(drives, change)
    assert gone == [False, True, True, True, True, False]
    assert causes == ["", "left", "torn", "settling", "center", ""]
    assert set(causes) - {""} == set(DIVERGENCE_CAUSES)


def test_what_blows_up_is_told_to_take_a_smaller_step():
    wild = two_sprockets(floor=1e-9, viscous=1e9, settle="false", step=5.0e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (row,) = simulate(wild, device="cpu", duration=0.05, record=NONE).metrics.to_pylist()
    assert row["status"] == "diverged" and row["reason"].endswith(f": {DIVERGENCE_CAUSES['torn']}")
