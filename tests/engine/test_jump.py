"""Tooth jump: what teeth hold at rest, drives in reverse, and the search over ensembles, held against closed forms."""

import json
import math

import numpy as np
import pytest
from command import refused
from command import run as command
from drives import example, two_sprockets
from silent_chains import pulled_silent_drive

from warpchain import loads_drive
from warpchain.assembly import assemble, statics
from warpchain.assembly.tooth_hold import has_tooth_jump, held_tension_ratio, top_radius
from warpchain.drive import dumps_drive
from warpchain.drive.reversed_drive import reversed_drive
from warpchain.engine.jump import find_jumps, jump_in_metrics
from warpchain.errors import DriveError, SimulationError
from warpchain.fit import fit_links
from warpchain.model import single_chain

FORCE, HEIGHT = 4000.0, 0.6
SLOPE = -math.tan(0.5 * math.atan(HEIGHT))
TRIANGLE = f"""
[chain]
pitch = 0.05
links = 106
roller_mass = 0.2
stiffness = 5e7
damping = 500.0
roller_radius = 0.015
[[sprockets]]
name = "driver"
teeth = 20
center = [0.0, 0.0]
wrap = "ccw"
prescribed = {{ speed = 5.0, ramp_time = 0.3 }}
[[sprockets]]
name = "tensioner"
teeth = 20
center = [2.0, 0.0]
wrap = "ccw"
mass = 5.0
inertia = 0.05
mount = {{ kind = "slider", direction = [1.0, {SLOPE}], stiffness = 0.0, damping = 1000.0, preload = {FORCE} }}
[[sprockets]]
name = "driven"
teeth = 20
center = [1.0, {HEIGHT}]
wrap = "ccw"
inertia = 0.5
load = {{ torque = 300.0, ramp_time = 0.3 }}
[contact.sprocket]
seat_angle = 125.0
clearance = 1e-4
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 2e8
[run]
duration = 2.5
step = "auto"
sample_rate = 20000.0
"""
"""A sprocket that few teeth hold, 62 degrees of 20; the strand towards the tensioner has a constant tension."""


@pytest.fixture(scope="module")
def triangle():
    return fit_links(loads_drive(TRIANGLE))


def test_a_tooth_holds_the_ratio_at_which_its_force_balances_two_links():
    """The force N at theta from the gap's middle, two links pi/z below the tangent: two equations for N and T'."""
    drive = two_sprockets(teeth=17, links=57, seat_angle=118.0)
    theta, half = math.radians(59.0), math.pi / 17
    columns = [[math.cos(theta), -math.sin(half)], [math.sin(theta), math.cos(half)]]
    _, behind = np.linalg.solve(columns, [math.sin(half), math.cos(half)])
    assert held_tension_ratio(single_chain(drive), 0) == pytest.approx(1.0 / behind, rel=1e-12)


@pytest.mark.long
def test_few_teeth_jump_at_the_ratio_that_they_hold(triangle):
    """Forward the slack strand has the tensioner's T, and M = R T (q^n - 1), n from the whole number of teeth below the
    wrap's to the one above; in reverse it is the tight one, M = R T (1 - q^-n), which n hardly changes.
    """
    q, wrap = held_tension_ratio(single_chain(triangle), 2), float(assemble(triangle).path.wrap_angle[2])
    n, radius, tension = (
        wrap * 20 / math.tau,
        single_chain(triangle).pitch_radius(2),
        float(statics.at_work(single_chain(triangle)).tension[1]),
    )
    assert tension == pytest.approx(0.5 * FORCE / math.cos(0.5 * math.atan(HEIGHT)), rel=0.02)  # the chain's polygon
    told = []
    forward, backward = find_jumps(triangle, tolerance=0.1, most=6000.0, device="cpu", report=told.append)
    assert (forward.sprocket, backward.sprocket, forward.on) == ("driven", "driven", "driven")
    low, at, high = (radius * tension * (q**k - 1.0) for k in (math.floor(n), n, math.ceil(n)))
    assert low < forward.holds < forward.jumps < high
    assert forward.estimate == pytest.approx(at, rel=0.06)  # bisected to 5 %
    assert forward.slack == pytest.approx(tension, rel=0.05) and forward.tension > forward.tight > forward.slack
    least = radius * tension * (1.0 - q**-n)
    assert backward.estimate == pytest.approx(least, rel=0.06)
    assert least * 0.95 < backward.jumps < least * 1.5  # just above it the chain climbs for longer than the run lasts
    assert backward.jumps - backward.holds <= 0.1 * backward.jumps
    assert len(told) >= 4 and told[0].startswith("forward: holds at")


def test_on_fixed_centers_a_chain_jumps_where_its_slack_lets_it_over_the_tips():
    """Two sprockets of 20 teeth, wraps of pi: at the wear e a chain of length L has s_0 + e L of slack. The
    other wrap, whose rollers ride on flanks, takes in pi R e of it, and the climb the rest, pi (rho_top - R).
    """
    motion = {"speed": 5.0, "ramp": 0.2, "load_ramp": 0.3, "torque": 1000.0, "duration": 1.0, "step": 2e-5}
    drive = two_sprockets(links=60, span=19.9, mass=0.2, inertia=0.5, damping=500.0, **motion)
    (found,) = find_jumps(drive, "wear", directions=("forward",), tolerance=0.05, device="cpu")
    radius, top = single_chain(drive).pitch_radius(1), top_radius(single_chain(drive), 1)
    wear = (math.pi * (top - radius) - 2 * 0.1 * 0.05) / (60 * 0.05 - math.pi * radius)
    assert found.estimate == pytest.approx(wear, rel=0.2)  # rollers beside the wrap are on teeth, too
    assert found.jumps == pytest.approx(wear, rel=0.25)  # likewise, in a chain that vibrates
    assert found.sprocket in ("driver", "driven") and found.own == 0.0


def test_where_nothing_jumps_the_search_says_so(triangle):
    (found,) = find_jumps(triangle, directions=("forward",), most=200.0, values=2, duration=0.1, device="cpu")
    assert (found.holds, found.jumps, found.sprocket, found.estimate) == (200.0, None, None, None)


def test_a_chain_that_leaves_its_teeth_has_jumped(triangle):
    row = {f"{name}.slips": 0 for name in ("driver", "tensioner", "driven")} | {"diverged": False}
    row |= {"driver.engaged": 1.1, "tensioner.engaged": 0.9, "driven.engaged": 1.0}
    assert jump_in_metrics(triangle, row) == (False, None)
    assert jump_in_metrics(triangle, row | {"tensioner.engaged": 0.49}) == (True, "tensioner")
    assert jump_in_metrics(triangle, row | {"driver.slips": 1, "driven.slips": 3}) == (True, "driven")
    assert jump_in_metrics(triangle, {"diverged": True}) == (True, None)


@pytest.mark.parametrize("name", ["car", "engine", "marine", "v6"])
def test_a_drive_in_reverse_stands_where_it_stood(name):
    """The same arcs and strands the other way around; twice in reverse is the drive itself."""
    drive = example(name)
    back = reversed_drive(drive)
    assert [(s.name, s.wrap) for s in reversed_drive(back).sprockets] == [(s.name, s.wrap) for s in drive.sprockets]
    if drive.chains:
        assert {s.name for s in back.sprockets} == {s.name for s in drive.sprockets}
        return
    there, here = assemble(drive).path, assemble(back).path
    order = [drive.sprockets.index(next(o for o in drive.sprockets if o.name == s.name)) for s in back.sprockets]
    assert here.wrap_angle == pytest.approx(there.wrap_angle[order], abs=1e-3)  # where arms balance
    strands = dict(zip(drive.strand_names, there.strand_length, strict=True))
    turned = dict(zip(back.strand_names, here.strand_length, strict=True))
    assert turned == pytest.approx({"->".join(reversed(k.split("->"))): v for k, v in strands.items()}, abs=1e-4)


def test_cams_in_reverse_store_the_same_energy():
    """M = dE/dphi of E(phi); against the other way, phi' = -phi, it is dE/dphi' = -M(-phi')."""
    load = {"torque": 0.0, "harmonics": [{"order": 4.0, "amplitude": 6.0, "phase": 0.7}]}
    drive = two_sprockets().with_values({"sprockets.driven.load": load})
    (before,), (after,) = (of.sprockets[1].load.harmonics for of in (drive, reversed_drive(drive)))
    for angle in (0.0, 0.3, 1.1):
        against = 6.0 * math.cos(4.0 * angle + after.phase)
        assert against == pytest.approx(-6.0 * math.cos(-4.0 * angle + before.phase), abs=1e-12)


def test_the_command_prints_and_gives_json(capsys, tmp_path, triangle, monkeypatch):
    monkeypatch.setattr("warpchain.assembly.tooth_hold.has_tooth_jump", lambda drive, s: True)  # which takes its time
    file = tmp_path / "triangle.toml"
    file.write_text(dumps_drive(triangle))
    words = ["jump", file, "--direction", "reverse", "--tolerance", "0.3", "--values", "3", "--most", "600"]
    words += ["--device", "cpu", "--duration", "0.6"]
    status, out, err = command(capsys, *words)
    assert (
        status == 0
        and out[0].startswith("reverse: the chain jumps on driven at ")
        and "times its own, 300 N m" in out[0]
    )
    assert "estimate at rest" in out[2] and err[0].startswith("warpchain: reverse: ")
    status, out, err = command(capsys, *words, "--json", "--quiet")
    told = json.loads("\n".join(out))
    assert (status, err, told["by"], told["unit"]) == (0, [], "torque", "N m")
    assert told["reverse"]["margin"] == pytest.approx(told["reverse"]["holds"] / 300.0)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["marine", "--on", "tightener"], "tightener: has no load; allowed is one of camshaft"),
        (["marine", "--by", "wear", "--on", "x"], "x: no such chain"),
        (["marine", "--tolerance", "0"], "--tolerance 0.0: must be a number from 1e-4 to 0.5"),
        (["marine", "--values", "2000"], "--values 2000: must be a whole number from 1 to 1000"),
        (["marine", "--most", "-1"], "--most -1.0: must be a finite number above 0"),
        (["conveyor", "--direction", "reverse"], "has no sprocket"),
    ],
)
def test_refusals(capsys, words, told):
    assert told in refused(capsys, "jump", *words)


def test_a_drive_without_load_has_no_torque_to_raise():
    bare = two_sprockets().with_values({"sprockets.driven.load": None})
    with pytest.raises(DriveError, match="load: no sprocket or shaft of the drive has one"):
        find_jumps(bare)
    with pytest.raises(SimulationError, match="by = "):
        find_jumps(bare, "speed")


@pytest.mark.parametrize(("share", "jumps"), [(0.57, False), (1.03, True)])
def test_toes_hold_until_a_tensioner_of_constant_force_leaves_no_tension(share, jumps):
    """Preload F is T1 + T2 less the centrifugal parts, and 11.5 teeth hold q^n = 3,200: M = R F (q^n - 1)/(q^n + 1)."""
    model = single_chain(pulled_silent_drive())
    assert held_tension_ratio(model, 1) == pytest.approx(
        math.sin(math.radians(30)) / math.sin(math.radians(30 - 360 / 23)), rel=1e-12
    )
    load = {"torque": share * 1000.0 * model.pitch_radius(1)}
    assert has_tooth_jump(single_chain(pulled_silent_drive(**{"sprockets.driven.load": load})), 1) is jumps
