"""What to look at before a run: thin wraps, idlers with few teeth, bars that miss or dent, too weak a chain."""

import math

import pytest
from command import run as command
from drives import SPRUNG, example, timing, two_sprockets, with_bar

from warpchain import loads_drive
from warpchain.assembly.layout_checks import layout_advice
from warpchain.assembly.strength import peak_tension, strength_advice, strength_values
from warpchain.assembly.summary import derived_quantities, report
from warpchain.model import single_chain

PITCH, ROLLER = 0.05, 0.015
DROP = PITCH / (2.0 * math.sin(math.pi / 20))
"""Half the distance of the strands of `two_sprockets`: driver->driven is at y = -DROP, run to the right."""


def with_bar_below(height, start=0.3, end=0.7):
    """A bar below whose rollers would ride `height` above the strand driver->driven."""
    y = -DROP + height - ROLLER
    return with_bar((start, y), (end, y))


def test_equal_sprockets_are_told_nothing():
    assert layout_advice(single_chain(two_sprockets())) == ()
    assert layout_advice(single_chain(with_bar_below(0.0))) == ()


def test_an_idler_with_few_teeth_in_mesh():
    """The marine tightener turns the chain by 18 degrees: 25 * 18 / 360 = 1.2 teeth."""
    (line,) = layout_advice(single_chain(example("marine")))
    assert line.startswith("sprockets.tightener: 1.2 teeth in mesh (18 degrees), where an idler wants 3")
    assert f"LOOK AT {line}" in report(derived_quantities(example("marine")))


VENTED = {"relief": {"pressure": 4e5, "diameter": 2e-3, "stiffness": 2e4, "lift": 3e-4}, "vent": {"diameter": 1e-4}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, None),
        ({"oil.supply_table": {"time": [0.0, 1.0], "pressure": [3e5, 6e5]}}, None),
        ({"oil.supply_table": {"speed": [0.0, 1.0], "pressure": [1e5, 6e5]}}, None),
        ({"chamber.drained": 1.0, "oil.supply": 4e5}, None),
        ({"chamber.drained": 1.0, "oil.supply": 1.4e5}, "chamber.drained: oil does not carry the plunger within the r"),
        ({"relief.pressure": 2e5}, "relief: stands open at rest and lets out "),
        ({"vent.diameter": 2e-3}, "vent: lets out "),
        (
            {"oil.supply_table": {"time": [1.0, 2.0], "pressure": [1e5, 3e5]}},
            "oil.supply_table: begins at 1 bar, where ",
        ),
    ],
)
def test_oil_that_is_lost_at_rest_or_jumps(changes, said):
    drive = timing().with_values({f"tensioners.0.{key}": value for key, value in VENTED.items()})
    drive = drive.with_values({f"tensioners.0.{key}": value for key, value in changes.items()})
    lines = [line for line in layout_advice(single_chain(drive)) if line.startswith("tensioners.")]
    assert len(lines) == (said is not None)
    assert not lines or lines[0].startswith(f"tensioners.tensioner.{said}")


def test_a_driver_with_a_thin_wrap():
    """A small sprocket near a large one: pi - 2 asin((R - r) / d)."""
    drive = two_sprockets().with_values(
        {
            "sprockets.driver.teeth": 15,
            "sprockets.driven.teeth": 120,
            "sprockets.driven.center": (1.1, 0.0),
            "chain.links": 124,
        }
    )
    radius = [PITCH / (2.0 * math.sin(math.pi / z)) for z in (15, 120)]
    wrap = 180.0 - 2.0 * math.degrees(math.asin((radius[1] - radius[0]) / 1.1))
    assert wrap < 90.0
    (line,) = layout_advice(single_chain(drive))
    assert f"sprockets.driver: passes on a moment with {wrap:.0f} degrees of wrap" in line


@pytest.mark.parametrize(
    "height, word",
    [
        (-0.6 * PITCH, "misses the chain: its face stands 30 mm, 0.6 pitches, off"),
        (-0.4 * PITCH, None),
        (0.4 * PITCH, None),
        (0.6 * PITCH, "dents"),
        (1.2 * PITCH, None),  # beyond a pitch: told as a mistake of the layout
    ],
)
def test_bars_that_miss_or_dent_their_strand(height, word):
    found = layout_advice(single_chain(with_bar_below(height)))
    assert len(found) == (word is not None)
    if word:
        assert word in found[0] and '"driver->driven"' in found[0]


def test_a_bar_past_all_strands_misses():
    (line,) = layout_advice(single_chain(with_bar_below(0.0, 2.0, 2.5)))
    assert "no strand passes over its face" in line


def test_tension_against_the_breaking_load_at_speed():
    """The motorcycle pulls 1.6 kN of 17.8; at four times the torque about 6.4, a safety of 2.8. Centrifugal force at
    five times the speed, m v^2 / p = 0.69 * 32^2 N, adds 0.7 kN of the rest."""
    drive = example("motorcycle")
    assert (
        layout_advice(
            single_chain(drive), tensions=[k["working_tension"] for k in derived_quantities(drive)["strands"]]
        )
        == ()
    )
    assert layout_advice(single_chain(drive), tensions=[]) == ()
    (line,) = layout_advice(single_chain(drive), tensions=[100.0, 17.8e3 / 5.0])
    assert "chain: 3.56 kN at work is a safety of 5 against the breaking load of 17.8 kN, where 7 is the least" in line
    heavy = drive.with_values({"sprockets.wheel.load.torque": 4.0 * drive.sprockets[1].load.torque})
    (line,) = [line for line in derived_quantities(heavy)["advice"] if "breaking load" in line]
    assert line.startswith("chain: ")


def test_a_chain_that_runs_off_the_end_of_its_shoe():
    """`car`'s fixed guide covers 169.5 to 156.3 degrees at 0.8 m, and at work the chain lies on 23 to 159 mm; ended
    at 161 degrees the face is 8.5 degrees long, 0.8 m times 0.148 = 118.7 mm, and the chain goes beyond."""
    car = example("car")
    assert derived_quantities(car)["advice"] == []
    (line,) = derived_quantities(car.with_values({"guides.fixed guide.arcs.0.to": 161.0}))["advice"]
    assert line.startswith("guides.fixed guide: the chain runs off its end: it lies on 23.1 to 119")
    assert "of a face of 118.7 mm, so on a rounded end of 9.53 mm radius" in line


def test_a_shoe_that_never_touches():
    """The fixed guide indents its strand by up to 9 mm: moved back by 20 it is free of it."""
    away = example("car").with_values({"guides.fixed guide.arcs.0.center": (0.851728, -0.094911)})
    (line,) = derived_quantities(away)["advice"]
    assert line.startswith('guides.fixed guide: never touches the chain: strand "exhaust cam->crank" passes')


def test_an_arm_at_the_free_angle_of_its_spring():
    """Two links more leave the chain slack, and the spring of 20 N m/rad holds 0.09 kg against gravity alone: 0.05
    degrees off the 8 of its free angle."""
    held, slack = (loads_drive(SPRUNG).with_values({"chain.links": links}) for links in (92, 94))
    assert not [line for line in layout_advice(single_chain(held)) if line.startswith("arms")]
    (line,) = [line for line in layout_advice(single_chain(slack)) if line.startswith("arms")]
    assert line.startswith("arms.tensioner arm: stands at 7.952 degrees, as it would without a chain, its free angle")


def test_a_step_beyond_the_largest_that_keeps_a_percent():
    """The automatic step of `engine` is 3.43 us; files round it."""
    engine = example("engine")
    (line,) = [
        line for line in derived_quantities(engine.with_values({"run.step": 5e-6}))["advice"] if "run.step" in line
    ]
    assert line.startswith("run.step: 5e-06 s is 1.46 of the largest step that keeps 1 %, 3.42")
    assert not [
        line for line in derived_quantities(engine.with_values({"run.step": 3.43e-6}))["advice"] if "run.step" in line
    ]


def test_strength_of_a_chain_at_work_and_at_its_loads_peaks():
    """12B on 20 teeth, R = p / (2 sin 9 degrees): harmonics of 30 and 10 N m and a triangle of a table, 20 N m over its
    mean of 20, add (40 + 20) / R at their peaks. Bearing area 5.72 times 17.28 mm (1.48 times 11.68)."""
    chain = {"size": "12B", "links": 60, "stiffness": "estimate", "damping_ratio": 0.02}
    table = {"angle": (0.0, math.pi, 2.0 * math.pi), "torque": (0.0, 40.0, 0.0)}
    beat = ({"order": 2.0, "amplitude": 30.0}, {"order": 4.0, "amplitude": -10.0})
    drive = two_sprockets().with_values(
        {
            "chain": chain,
            "sprockets.driven.center": (20 * 0.01905, 0.0),
            "sprockets.driven.load": {"torque": 50.0, "harmonics": beat, "table": table},
        }
    )
    radius = single_chain(drive).pitch_radius(1)
    assert peak_tension(single_chain(drive)) == pytest.approx(60.0 / radius, rel=1e-12)
    found = strength_values(single_chain(drive), [100.0, 2000.0])
    peak = 2000.0 + 60.0 / radius
    assert found["static_safety"] == pytest.approx(28.9e3 / 2000.0)
    assert found["dynamic_safety"] == pytest.approx(28.9e3 / peak)
    assert found["yield_safety"] == pytest.approx(0.7 * 28.9e3 / peak)
    assert found["pressure"] == pytest.approx(2000.0 / (5.72e-3 * 1.48 * 11.68e-3))
    assert found["peak_pressure"] == pytest.approx(found["pressure"] * peak / 2000.0)
    assert (
        strength_values(single_chain(two_sprockets()), [100.0]) is None
        and strength_values(single_chain(drive), []) is None
    )


def test_advice_names_the_first_strength_that_is_too_small():
    """Of 17.8 kN: a harmonic of 2.5 kN makes 4 kN of 1.5, a dynamic safety of 4.45; 13.5 kN of 11, beyond 0.7 of it."""
    drive = example("motorcycle")
    radius = single_chain(drive).pitch_radius(1)
    beating = drive.with_values({"sprockets.wheel.load.harmonics": ({"order": 1.0, "amplitude": 2500.0 * radius},)})
    assert strength_advice(single_chain(drive), [1500.0]) == []
    (line,) = strength_advice(single_chain(beating), [1500.0])
    assert line.startswith("chain: 4 kN at work with the loads at their peaks is a safety of 4.5 against the breaking")
    (line,) = strength_advice(single_chain(beating), [11.0e3])
    assert "a safety of 0.92 against the 12.46 kN at which links yield, where 1 is the least" in line


def test_check_prints_strength_with_its_sources(capsys):
    status, out, _ = command(capsys, "check", "car")
    found = derived_quantities(example("car"))["strength"]
    text = "\n".join(out)
    assert status == 0 and f"static {found['static_safety']:.3g} (at least 7)" in text
    assert "from about 6.23 kN on, 70 % of the breaking load (Tsubaki)" in text
    assert f"{1e-6 * found['pressure']:.4g} N/mm^2 at work on 27.77 mm^2, d2 b2 of ISO 606" in text
