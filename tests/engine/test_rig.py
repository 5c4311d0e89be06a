"""The rig on which tensioners are tried, and what it takes from drives."""

import math

import numpy as np
import pyarrow as pa
import pytest
from tensioner_rig import RELIEF, TEXT, VENT, engine, looked, moved, oil_modulus, still, tensioner

import warpchain
from warpchain import bench_tensioner, loads_drive
from warpchain.assembly.table_cells import TableList
from warpchain.drive.viscosity import walther_from_slope
from warpchain.engine.body_struct_rows import fill_tensioner_row
from warpchain.engine.tensioner_bench import SAMPLES_PER_CYCLE, PlungerMotion, shake_tensioner
from warpchain.errors import DriveError, SimulationError
from warpchain.kernels.structs import Tensioner, Valve
from warpchain.model import oil, single_chain

ELSEWHERE = ("body", "home", "rest", "stop_stiffness", "stop_damping", "bottom", "direction", "point")
ELSEWHERE += ("check", "relief", "vent", "supply_table")


@pytest.fixture(scope="module")
def drive():
    return engine()


def filled(drive, t):
    row = np.zeros(1, dtype=Tensioner.numpy_dtype())[0]
    fill_tensioner_row(row, single_chain(drive), t, TableList())
    return row


# ---- what drives say, as rows ----


def test_a_row_has_the_numbers_of_its_drive(drive):
    row, wanted = filled(drive, 0), tensioner(ratchet_pitch=1e-3, backlash=2e-4)
    for name in row.dtype.names:
        if name not in ELSEWHERE:
            assert row[name] == pytest.approx(getattr(wanted, name), rel=1e-14), name
    for name in row["check"].dtype.names:
        assert row["check"][name] == pytest.approx(getattr(wanted.check, name), rel=1e-14), name
    assert not any(row[name]["hole_area"] for name in ("relief", "vent"))
    assert drive.sprockets[row["body"]].name == "tensioner"
    assert row["home"] == pytest.approx(drive.sprockets[row["body"]].center)
    assert row["direction"] == pytest.approx([-1.0, 0.0]) and not row["point"].any()
    assert row["bottom"] == pytest.approx(-0.95 * 1e-6 / wanted.area)
    assert row["stop_stiffness"] == drive.chain.stiffness
    spring = filled(drive, 1)
    assert (spring["hydraulic"], spring["stiffness"], spring["damping"], spring["area"]) == (0, 3500.0, 20.0, 0.0)
    assert spring["bottom"] == -math.inf


OUTLETS = {
    "tensioners.0.relief": {"pressure": 5e5, "diameter": 2e-3, "stiffness": 2e4, "lift": 3e-4},
    "tensioners.0.vent": {"diameter": 2e-4},
}
"""What `RELIEF` and `VENT` of the rig are in drive files; both discharge at 0.6."""


@pytest.mark.parametrize("valve", ["relief", "vent"])
@pytest.mark.parametrize("field", Valve.numpy_dtype()["names"])
def test_a_row_has_the_relief_valve_and_the_vent_of_its_drive(drive, valve, field):
    """Hole pi d^2 / 4 and curtain pi d y of the one, C_d pi d^2 / 4 of the other, by hand in the rig."""
    row = filled(drive.with_values(OUTLETS), 0)[valve]
    assert row[field] == pytest.approx(getattr(getattr(tensioner(**RELIEF, **VENT), valve), field), rel=1e-14)


def test_at_rest_the_valve_feeds_the_leak(drive):
    part = drive.tensioners[0]
    rest = oil.static_pressure(part)
    assert rest == pytest.approx(tensioner().rest, rel=1e-12)
    assert oil.valve_flow(part, rest) == pytest.approx(part.leak_conductance * (rest - 1e5), rel=1e-8)
    assert oil.static_force(part, 1e-3) == pytest.approx((rest - 1e5) * part.area + 90.0 - 3.5)
    assert oil.static_force(drive.tensioners[1], 1.0) == 0.0
    held = moved(tensioner(rest=rest), np.zeros(1001), 1e-3)
    assert held["pressure"] == pytest.approx(rest, rel=1e-11)


def test_at_rest_without_supply_the_pressure_is_the_ambient_one():
    part = loads_drive(TEXT.replace("supply = 3.0e5", "supply = 1.0e5")).tensioners[0]
    assert oil.static_pressure(part) == 1e5


def test_python_and_kernels_have_one_oil_and_one_valve(drive):
    part, pressures = drive.tensioners[0], np.array([1e3, 1e5, 2e5, 2.3e5, 2.49e5, 2.9e5, 1e6, 1e8])
    found = looked(tensioner(), pressures)
    assert found[2] == pytest.approx([oil_modulus(part, p) for p in pressures], rel=1e-13)
    assert found[3] == pytest.approx([oil.valve_flow(part, p) for p in pressures], rel=1e-13)
    assert oil.oil_stiffness(part) == pytest.approx(8e8 * 1.01 * part.area**2 / 1e-6)
    assert oil.oil_stiffness(drive.tensioners[1]) == 0.0


def test_python_and_kernels_have_one_relief_valve_and_one_vent(drive):
    """One step each, so short that P stays, of a chamber that is so large that nothing changes it."""
    part = drive.with_values(OUTLETS).tensioners[0]
    for pressure in (9e4, 1.02e5, 4e5, 5.1e5, 1e6, 4e6):
        got = moved(still(pressure, volume=1e3, **RELIEF, **VENT), [0.0, 0.0], 1e-6)
        relieved, vented = oil.outlet_flows(part, pressure)
        assert got["relieved"][1] / 1e-6 == pytest.approx(relieved, rel=1e-7)
        assert got["vented"][1] / 1e-6 == pytest.approx(vented, rel=1e-7)
    rest = oil.static_pressure(part)
    assert rest < oil.static_pressure(drive.tensioners[0])  # the vent takes some of it
    held = moved(tensioner(rest=rest, **RELIEF, **VENT), np.zeros(1001), 1e-3)
    assert held["pressure"] == pytest.approx(rest, rel=1e-11)


def test_viscosity_over_temperature_is_walther_s():
    assert walther_from_slope(8e-5).viscosity(40.0) == pytest.approx(8e-5, rel=1e-12)
    # a 5W-30 of 62 mm^2/s at 40 degrees C has about 10.3 at 100
    assert walther_from_slope(62e-6).viscosity(100.0) == pytest.approx(10.3e-6, rel=0.01)
    # VG 100 of a viscosity index of 95 has 11.1 at 100 (B = 3.6)
    assert walther_from_slope(100e-6, slope=3.6).viscosity(100.0) == pytest.approx(11.1e-6, rel=0.03)


# ---- rides ----


def test_a_ride_is_a_table_with_units(drive):
    table = bench_tensioner(drive, "element", amplitude=2e-4, frequency=100.0, cycles=3)
    assert warpchain.bench_tensioner is bench_tensioner
    assert isinstance(table, pa.Table)
    assert table.column_names[:6] == ["time", "extension", "force", "pressure", "valve_lift", "leaked"]
    assert table.schema.field("pressure").metadata == {b"unit": b"Pa"}
    assert len(table) == 3 * SAMPLES_PER_CYCLE + 1
    time, x = np.asarray(table["time"]), np.asarray(table["extension"])
    assert time[-1] == pytest.approx(0.03)
    assert x == pytest.approx(2e-4 * np.sin(2.0 * np.pi * 100.0 * time), abs=1e-16)
    assert (np.diff(np.asarray(table["leaked"])) > -1e-12).all()
    oil_force = (np.asarray(table["pressure"]) - 1e5) * drive.tensioners[0].area
    assert np.asarray(table["force"]) == pytest.approx(oil_force + 90.0 - 3500.0 * x, rel=1e-12)


def test_slowly_it_is_a_damper_of_a_square_over_g(drive):
    part = drive.tensioners[0]
    row = shake_tensioner(drive, "element", [PlungerMotion(2e-4, 10.0)]).rides.to_pylist()[0]
    fastest = 2e-4 * 2.0 * math.pi * 10.0
    damping = part.area * (part.area + part.drag_flow) / part.leak_conductance
    # 197 N on 90 of the spring; compressed oil, in series, is 1 / (omega tau) = 7 times as stiff and takes 1 % of it
    assert row["force_max"] == pytest.approx(90.0 + damping * fastest, rel=0.01)
    # over half a cycle, from where the pressure exceeds that at rest (the valve closes): less than pi/2 c omega X^2
    assert 0.7 < row["work"] / (0.5 * math.pi * damping * fastest * 2e-4) < 1.0


@pytest.mark.parametrize("frequency", [10.0, 100.0, 400.0])
def test_a_cycle_s_energy_is_accounted_for(drive, frequency):
    row = shake_tensioner(drive, "element", [PlungerMotion(2e-4, frequency)]).rides.to_pylist()[0]
    assert abs(left_over(row)) < 1e-6 * row["work"]  # h^2 of 2500 steps
    assert row["openings"] == 1 and row["lift_max"] > 0.0 and row["suction_work"] == row["damper_loss"] == 0.0


def left_over(row):
    """What a cycle's energy balance misses [J]."""
    came = row["work"] + row["supply_work"] + row["suction_work"]
    return came - row["gained"] - row["leak_loss"] - row["valve_loss"] - row["damper_loss"]


@pytest.mark.parametrize("damping", [0.0, 5.0])
@pytest.mark.parametrize("frequency", [10.0, 100.0])
def test_what_draws_a_plunger_out_is_no_loss_of_its_damper(drive, frequency, damping):
    """Hardly any oil comes in, and the weak spring does not hold the plunger to what it touches: it only goes along."""
    weak = {"spring.preload": 0.6, "spring.stiffness": 35.0, "spring.damping": damping, "valve.stiffness": 5e4}
    slack = drive.with_values({f"tensioners.element.{path}": value for path, value in weak.items()})
    row = shake_tensioner(slack, "element", [PlungerMotion(2e-4, frequency)]).rides.to_pylist()[0]
    assert row["pressure_min"] < 2e4 and row["force_min"] == 0.0
    assert row["damper_loss"] >= 0.0 and (row["damper_loss"] > 0.0) == (damping > 0.0)
    assert row["suction_work"] > 0.04 * row["work"]
    assert abs(left_over(row)) < 2e-5 * row["work"]  # h^2; force and flows have kinks where it comes to bear


def test_the_tenth_cycle_is_like_the_ninth(drive):
    table = bench_tensioner(drive, "element", amplitude=2e-4, frequency=100.0, cycles=10)
    force = np.asarray(table["force"])
    assert force[-SAMPLES_PER_CYCLE:] == pytest.approx(force[-2 * SAMPLES_PER_CYCLE : -SAMPLES_PER_CYCLE], rel=1e-6)


def test_rides_together_are_those_alone(drive):
    shakes = [
        PlungerMotion(2e-4, 50.0),
        PlungerMotion(1e-4, 200.0, extension=1e-4),
        PlungerMotion(2e-4, 50.0, viscosity=1e-5),
    ]
    told = []
    together = shake_tensioner(
        drive, "element", shakes, cycles=2, progress=lambda *of: told.append(of)
    ).rides.to_pylist()
    assert told == [("rides", k, 3) for k in (1, 2, 3)]
    for row, one in zip(together, shakes, strict=True):
        assert shake_tensioner(drive, "element", [one], cycles=2).rides.to_pylist()[0] == row
    assert together[2]["viscosity"] == 1e-5 and together[0]["viscosity"] == 8e-5


def force_max(drive, **change):
    values = {f"tensioners.element.{path.replace('__', '.')}": value for path, value in change.items()}
    return (
        shake_tensioner(drive.with_values(values), "element", [PlungerMotion(2e-4, 100.0)], cycles=3)
        .rides["force_max"][0]
        .as_py()
    )


def test_the_force_rises_as_the_gap_shrinks_and_falls_with_thin_oil_and_air(drive):
    """Feng, Yang and Wang, Chin. J. Mech. Eng. 36 (2023)."""
    gaps = [force_max(drive, plunger__gap=gap) for gap in (3e-5, 4e-5, 5e-5, 6e-5, 8e-5)]
    assert (np.diff(gaps) < 0.0).all()
    airs = [force_max(drive, oil__air=air) for air in (0.0, 0.01, 0.03, 0.1)]
    assert (np.diff(airs) < 0.0).all()
    warm = [force_max(drive, oil__viscosity=walther_from_slope(8e-5).viscosity(t)) for t in (20.0, 40.0, 80.0, 120.0)]
    assert (np.diff(warm) < 0.0).all()


def test_a_spring_with_a_damper_loses_its_ellipse(drive):
    row = shake_tensioner(drive, "plain", [PlungerMotion(2e-4, 100.0)]).rides.to_pylist()[0]
    omega = 2.0 * math.pi * 100.0
    assert row["work"] == pytest.approx(math.pi * 20.0 * omega * 2e-4**2, rel=1e-5)  # pi c omega X^2; h^2
    assert row["damper_loss"] == pytest.approx(row["work"], rel=1e-5)
    assert row["force_max"] == pytest.approx(90.0 + math.hypot(3500.0, 20.0 * omega) * 2e-4, rel=1e-5)
    assert row["leaked"] == row["pressure_max"] == 0.0 and math.isnan(row["viscosity"])


# ---- mistakes ----


def test_a_name_that_is_none(drive):
    with pytest.raises(DriveError, match="tensioner 'elemnt': allowed are element, plain"):
        bench_tensioner(drive, "elemnt", amplitude=1e-4, frequency=10.0)
    bare = loads_drive(TEXT.split("[[tensioners]]")[0])
    with pytest.raises(DriveError, match="the drive has no tensioners"):
        bench_tensioner(bare, "element", amplitude=1e-4, frequency=10.0)


@pytest.mark.parametrize(
    ("name", "values", "told"),
    [
        ("element", {"amplitude": 0.0}, "amplitude = 0: must be a number above 0, at most 1 m"),
        ("element", {"amplitude": math.nan}, "amplitude = nan: must be a number above 0"),
        ("element", {"frequency": -1.0}, "frequency = -1: must be from 0.0001 to 100000 Hz"),
        ("element", {"frequency": math.inf}, "frequency = inf: must be from 0.0001 to 100000 Hz"),
        ("element", {"cycles": 0}, "cycles = 0: must be 1 to 10000"),
        ("element", {"cycles": 10_001}, "cycles = 10001: must be 1 to 10000"),
        ("element", {"extension": math.nan}, "extension = nan: must be a number from -1 to 1 m"),
        ("element", {"amplitude": 0.01}, "above the bottom of its chamber, -0.00497"),
        ("element", {"amplitude": 1e-3, "extension": -0.0045}, "above the bottom of its chamber"),
    ],
)
def test_what_cannot_be_ridden_is_refused(drive, name, values, told):
    with pytest.raises(SimulationError) as caught:
        bench_tensioner(drive, name, **{"amplitude": 1e-4, "frequency": 10.0} | values)
    assert told in str(caught.value) and "\n" not in str(caught.value)


def test_rides_of_very_many_cycles_together_are_refused(drive):
    with pytest.raises(SimulationError, match="2 rides of 5001 cycles: must be 10000 cycles together at most"):
        shake_tensioner(drive, "element", [PlungerMotion(1e-4, 10.0)] * 2, 5001, samples=True)


def test_another_oil_is_for_those_with_oil(drive):
    for name, viscosity in (("plain", 1e-5), ("element", 0.0), ("element", math.nan)):
        with pytest.raises(SimulationError, match="viscosity = "):
            shake_tensioner(drive, name, [PlungerMotion(1e-4, 10.0, viscosity=viscosity)])
