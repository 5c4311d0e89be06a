"""Rating, wear, sag and critical speeds of `check`, each against its closed form."""

import math

import numpy as np
import pytest
from drives import example, two_sprockets

from warpchain.assembly.frequencies import moving_frequency
from warpchain.assembly.rating import passes_moment
from warpchain.assembly.summary import derived_quantities, report
from warpchain.model import single_chain
from warpchain.model.power_rating import rated_power

PITCH, TEETH = 0.05, 20


def sized(**changes):
    """`two_sprockets` with a chain of 16B."""
    drive = two_sprockets(**{"torque": 100.0, "stiffness": 2e8, **changes})
    values = {"chain.size": "16B", "chain.stiffness": drive.chain.stiffness, "chain.roller_mass": drive.chain.mass}
    values |= {"sprockets.driven.center": (20 * 0.0254, 0.0), "contact.sprocket.clearance": 5e-5}
    return drive.with_values(values)


def test_the_power_of_the_load_beside_the_rated_one():
    """T w of a load of 100 N m at 10 rad/s, without preload to hide it."""
    found = derived_quantities(sized())["rating"]
    assert found["power"] == pytest.approx(100.0 * 10.0, rel=0.01)  # the mean speed of a polygon of 20 sides
    assert found["rated_power"] == pytest.approx(rated_power("16B", 20, 10.0).least, rel=1e-12)
    assert found["use"] == found["power"] / found["rated_power"] and found["limited_by"] == "link plates"
    assert (found["elongation_limit"], found["rated_life"], found["lubrication"]) == (0.03, 15000.0 * 3600.0, "A")


def test_too_much_power_is_something_to_look_at():
    assert not [line for line in derived_quantities(sized())["advice"] if "rated for" in line]
    (line,) = [line for line in derived_quantities(sized(torque=900.0))["advice"] if "rated for" in line]
    assert (
        line.startswith("chain: passes on 8.989 kW at work, 1.82 times the 4.952 kW that it is rated for")
        and "ISO 10823, an ESTIMATE by ASME B29.1" in line
    )


def test_wear_by_archards_law():
    """Every joint turns by 2 pi / z on and off both sprockets, under the tensions on either side."""
    drive = sized()
    values = derived_quantities(drive)
    chain, tensions = drive.chain, [strand["working_tension"] for strand in values["strands"]]
    turned = 2.0 * math.tau / 20.0 * sum(tensions)
    circuit = chain.links * chain.pitch / values["mean_chain_speed"]
    rate = 2e-16 * chain.pin_radius * turned / (chain.joint_area * chain.pitch) / circuit
    assert values["rating"]["wear_life"] == pytest.approx(0.03 / rate, rel=1e-9)


def test_critical_speeds():
    """Teeth pass with the frequency that a moving string has at that speed; lengthwise that of springs and masses."""
    drive = two_sprockets(torque=1000.0)
    values = derived_quantities(drive)
    found, strands = values["critical_speeds"], {strand["name"]: strand for strand in values["strands"]}
    one, strand = found["transverse"], strands[found["transverse"]["strand"]]
    pull = strand["working_tension"] - strand["centrifugal_tension"]
    for key, period in (("teeth_speed", PITCH), ("revolution_speed", TEETH * PITCH)):
        speed = one[key] * TEETH * PITCH / math.tau
        tension = pull + drive.chain.mass / PITCH * speed**2
        assert moving_frequency(single_chain(drive), strand["length"], tension, speed) == pytest.approx(
            speed / period, rel=1e-9
        )
    assert one["frequency"] == pytest.approx(one["teeth_speed"] * TEETH / math.tau, rel=1e-12)
    n = strands[found["longitudinal"]["strand"]]["links"]
    springs = 2.0 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)
    held = math.sqrt(np.linalg.eigvalsh(springs)[0] * drive.chain.stiffness / drive.chain.mass) / math.tau
    assert found["longitudinal"]["frequency"] == pytest.approx(held, rel=1e-9)


def test_a_load_turns_against_a_led_driver_on_the_pulled_strand():
    """sqrt(k R^2 / (n J)) with gravity, as the slack strand gives; on both strands without."""
    drive = two_sprockets(torque=1000.0, gravity=-9.81)
    links = {strand["links"] for strand in derived_quantities(drive)["strands"]}
    assert links == {20}
    radius = PITCH / (2.0 * math.sin(math.pi / TEETH))
    alone = math.sqrt(drive.chain.stiffness / 20.0 * radius**2 / 2.0) / math.tau
    found = derived_quantities(drive)["critical_speeds"]["torsional"]
    assert found["frequency"] == pytest.approx(alone, rel=0.02) and found["strand"] == ""


def test_sag_and_what_the_hand_moves():
    """A parabola of the weight, m g L^2 / (8 p T), of a strand whose ends are up to half a link off those
    of the tangent, so that it hangs up to 5 % deeper; by hand 4/sqrt(3) of it."""
    drive = two_sprockets(torque=1000.0, gravity=-9.81).with_values({"sprockets.driven.center": (0.995, 0.0)})
    values = derived_quantities(drive)
    found = values["sag"]
    (strand,) = [strand for strand in values["strands"] if strand["name"] == found["strand"]]
    assert strand["working_tension"] == min(one["working_tension"] for one in values["strands"])
    tension = strand["standing_tension"]
    hung = drive.chain.mass * 9.81 * strand["length"] ** 2 / (8.0 * PITCH * tension)
    assert found["sag"] == pytest.approx(hung, rel=0.07)
    assert found["slack"] == pytest.approx(4.0 / math.sqrt(3.0) * found["sag"] / strand["length"], rel=1e-12)
    advised = [line for line in values["advice"] if "can be moved by" in line]
    assert len(advised) == (found["slack"] > 0.06) == 1
    assert derived_quantities(two_sprockets())["sag"] is None  # without gravity


def test_the_report_has_each_with_its_source():
    text = report(derived_quantities(example("industrial")))
    for line, source in (
        ("rating: ", "ISO 10823, an ESTIMATE by ASME B29.1"),
        ("  that leaves out ", "run the drive"),
        ("life: ", "(ACA)"),
        ("lubrication: B", "(Machinery's Handbook)"),
        ("sag: ", "(Tsubaki)"),
        ("critical, transverse: ", "(Sack 1954)"),
        ("critical, longitudinal: ", "springs and masses"),
        ("critical, torsional: ", "(Ernst 1965)"),
    ):
        (found,) = [one for one in text.splitlines() if one.startswith(line)]
        assert source in found
    assert derived_quantities(example("marine"))["rating"] is None  # no size


def test_sprockets_that_pass_on_a_moment():
    drive = example("swing_idler")
    assert [passes_moment(sprocket) for sprocket in drive.sprockets] == [True, False, True]
