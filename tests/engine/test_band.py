"""Rollers are looked after as far as teeth reach: the maximum gap of ISO 606, whose teeth end beyond half a pitch."""

import numpy as np
import pytest
from drives import two_sprockets

from warpchain import Record, loads_drive, simulate
from warpchain.assembly.fitting import fit_position
from warpchain.engine.pack import pack
from warpchain.engine.struct_rows import CONTACT_MARGIN
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule

MAXIMUM = {"contact.sprocket.profile": "iso606", "contact.sprocket.gap": "maximum"}
MAXIMUM |= {"contact.sprocket.clearance": None, "contact.sprocket.seat_angle": None}

SLACK = """
[chain]
size = "08B"
links = 100
stiffness = 1.4e7
damping_ratio = 0.02
[[sprockets]]
name = "driver"
teeth = 19
center = [0.0, 0.0]
wrap = "ccw"
prescribed = { speed = 51.84 }
[[sprockets]]
name = "driven"
teeth = 38
center = [0.4572, 0.0]
wrap = "ccw"
inertia = 1.043e-3
load = { torque = 27.47 }
[contact.sprocket]
profile = "iso606"
gap = "maximum"
restitution = 0.5
impact_speed_floor = 0.02
stiffness = 1.4e8
[run]
duration = 0.25
step = "auto"
sample_rate = 4000.0
"""


def test_the_band_reaches_from_where_tips_end_as_far_inward():
    drive = two_sprockets().with_values(MAXIMUM)
    reach = single_chain(drive).tip_radius(0) + drive.chain.roller_radius - single_chain(drive).pitch_radius(0)
    assert single_chain(drive).engagement(0) == pytest.approx(0.625 * drive.chain.pitch, rel=1e-12)
    assert single_chain(drive).engagement(0) == reach
    assert single_chain(two_sprockets()).engagement(0) == pytest.approx(0.5 * 0.05, rel=1e-12)
    packed = pack([drive], [Schedule(5e-6, 1, 0, 1, 0)]).sprockets[0]
    reach += CONTACT_MARGIN * drive.chain.roller_radius  # and what may touch a tip within a step
    np.testing.assert_allclose(np.sqrt(packed["far_square"]), single_chain(drive).pitch_radius(0) + reach, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(packed["near_square"]), single_chain(drive).pitch_radius(0) - reach, rtol=1e-12)


def test_a_band_ends_at_the_center():
    drive = two_sprockets(teeth=5, links=50, span=22.5).with_values(MAXIMUM | {"chain.roller_radius": 0.001})
    assert single_chain(drive).engagement(0) > 0.7 * single_chain(drive).pitch_radius(0)
    assert pack([drive], [Schedule(5e-6, 1, 0, 1, 0)]).sprockets[0]["near_square"] >= 0.0


def test_a_slack_chain_on_the_maximum_gap_is_not_struck_by_teeth_that_it_rides_on():
    # -2 %: with a band of half a pitch rollers came back an eighth of a pitch deep in a tooth: 203 kN, and a quarter of
    # the energy from nowhere. Twice the tight strand's 0.7 kN, and impacts at some m/s, sqrt(K m) v = 1 kN a m/s
    drive = fit_position(loads_drive(SLACK), "driven", [1.0, 0.0], strain=-0.02)
    values = simulate(drive, device="cpu", record=Record(variants="none")).metrics.to_pylist()[0]
    assert max(values["driver.force_max"], values["driven.force_max"]) < 6e3
    assert abs(values["energy_residual_relative"]) < 1e-3


@pytest.mark.usefixtures("device")
def test_first_touches_are_rollers_that_came_and_impacts_have_their_chatter_too():
    # 2 revolutions of 20 teeth: as many rollers come, but for those of the ends; the first instant counts who is seated
    drive = two_sprockets(duration=2 * 2 * np.pi / 10.0, span=20.002, seat_angle=115.0)
    start = 0.25 * drive.run.duration
    values = simulate(drive, window=(start, drive.run.duration), record=Record(variants="none")).metrics.to_pylist()[0]
    for name in ("driver", "driven"):
        assert values[f"{name}.contacts"] == pytest.approx(0.75 * 2 * 20, abs=2)
        assert values[f"{name}.impacts"] >= values[f"{name}.contacts"]
    assert "driver.missed" not in values
