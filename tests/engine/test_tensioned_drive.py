"""A drive with a tensioner on its slider, against the slider's own spring, and its energy."""

import numpy as np
import pytest
from blocks import drawn
from drives import timing, two_sprockets
from tensioner_rig import engine

from warpchain import Record, simulate
from warpchain.drive import Drive
from warpchain.model.oil import static_pressure

BARE = {f"sprockets.tensioner.mount.{name}": 0.0 for name in ("stiffness", "damping", "preload")}
"""The engine's slider without the spring of its own."""


def test_a_spring_tensioner_is_the_slider_s_own_spring():
    plain = engine().with_values({"tensioners": [], "run.settle": False})
    spring = {name: getattr(plain.sprockets[1].mount, name) for name in ("stiffness", "preload", "damping")}
    assert min(spring.values()) > 0.0
    drives = [
        plain,
        plain.with_values(BARE | {"tensioners": [engine().tensioners[1].model_dump() | {"spring": spring}]}),
    ]
    record = Record(rate=1e4, channels=("position", "sprocket_center"))
    run = simulate(drives, duration=0.003, record=record, device="cpu")
    own, other = run[0], run[1]
    moved = np.abs(own.sprocket_center - own.sprocket_center[0]).max()
    assert moved > 1e-3
    # the same force on the slider, summed in another order
    assert other.sprocket_center == pytest.approx(own.sprocket_center, abs=1e-9 * moved)
    assert other.position == pytest.approx(own.position, abs=1e-9 * moved)


def test_dampers_of_a_tensioner_never_give():
    """Of a plunger that its oil would hold back, with a damper and without; what that takes has a place of its own."""
    run = simulate(drawn(), duration=0.004, window=(0.0, 0.004), record=Record(variants="none"), device="cpu")
    plain, damped = run.metrics.to_pylist()
    assert plain["tensioner.damping_loss"] == 0.0 < damped["tensioner.damping_loss"]
    for row in (plain, damped):
        assert row["tensioner.force_min"] == 0.0 and row["tensioner.pressure_min"] < 1e5
        assert abs(row["tensioner.suction_work"]) > 1e-5
        # a hundredth of that: leapfrog's kinks where plungers come to bear
        assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_supply_that_stays_is_that_of_a_number():
    """Bit for bit, be it over time or over speed."""
    path = "tensioners.0.oil.supply_table"
    still = {"pressure": [3e5, 3e5]}
    tables = [{path: still | {key: [0.0, 100.0]}} for key in ("time", "speed")]
    drives = [timing(), *(timing().with_values(table) for table in tables)]
    plain, *others = simulate(drives, duration=0.002, window=(0.0, 0.002), device="cpu").metrics.to_pylist()
    assert plain["tensioner.supplied"] > 0.0
    for other in others:
        assert other["tensioner.supplied"] == plain["tensioner.supplied"]
        assert other["tension_mean"] == plain["tension_mean"]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_the_chamber_follows_its_supply(precision):
    """Of a plunger that stands still, P is where what comes in goes out, at the P_s of every instant.

    The pump turns with the driver, which speeds up: P_s rises with its speed; or with the time, by as much.
    """
    mount = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 1e12, "damping": 1e8, "preload": 0.0}
    oil = timing().tensioners[0].model_dump() | {"name": "plunger", "on": "driven", "direction": [1.0, 0.0]}
    start = {"sprockets.driver.prescribed.speed": 1e-2, "sprockets.driver.prescribed.ramp_time": 0.02}
    still = two_sprockets().with_values({"sprockets.driven.mount": mount, "sprockets.driven.mass": 1e5} | start)
    ramp = 3.0 * np.linspace(0.0, 1.0, 51) ** 2 - 2.0 * np.linspace(0.0, 1.0, 51) ** 3
    over_time = {"time": np.linspace(0.0, 0.02, 51).tolist(), "pressure": (2e5 + 4e5 * ramp).tolist()}
    over_speed = {"speed": [0.0, 1e-2], "pressure": [2e5, 6e5]}
    parts = [
        oil | {"oil": oil["oil"] | {"air": 0.0, "supply": 2e5, "supply_table": table}}
        for table in (over_time, over_speed)
    ]
    drives = [Drive(**still.model_dump(exclude_none=True) | {"tensioners": [part]}) for part in parts]
    record = Record(rate=1e3, channels=("chamber_pressure",))
    run = simulate(drives, duration=0.02, record=record, device="cpu", precision=precision)
    supply = np.interp(run[0].time, over_time["time"], over_time["pressure"])
    of = drives[0].tensioners[0]
    wanted = [static_pressure(of.model_copy(update={"oil": of.oil.model_copy(update={"supply": p})})) for p in supply]
    for v in range(2):
        # what compresses the oil, V / E of 1.2e-15 m^3/Pa at up to 3e7 Pa/s, is 0.04 of 400 mm^3/s that come in
        assert run[v].chamber_pressure[:, 0] == pytest.approx(np.array(wanted), rel=2e-3)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_drained_start(precision):
    """On its spring alone until oil has filled it; the metric is that time, None where it has not."""
    base = engine().with_values(BARE | {"tensioners": [engine().tensioners[0]]})
    shares = [{"tensioners.0.chamber.drained": share} for share in (0.02, 1.0)]
    drives = [base.with_values(share | {"run.settle": False}) for share in shares]
    record = Record(rate=2e4, channels=("chamber_pressure", "tensioner_extension"))
    run = simulate(drives, duration=0.02, window=(0.01, 0.02), record=record, device="cpu", precision=precision)
    soon, late = run.metrics.to_pylist()
    assert late["element.filling_time"] is None and 0.0 < soon["element.filling_time"] < 0.02
    pressure, time = run[0].chamber_pressure[:, 0], run[0].time
    assert pressure[time < soon["element.filling_time"] - 1e-4] == pytest.approx(1e5, rel=1e-6)
    assert pressure[np.searchsorted(time, soon["element.filling_time"])] > 1e5
    assert run[1].chamber_pressure == pytest.approx(1e5, rel=1e-6)
    assert "element.filling_time" not in simulate([base], duration=1e-4, device="cpu").metrics.column_names


def test_relief_valve_and_vent_leave_the_energy_balance_as_good():
    relief = {"pressure": 5e5, "diameter": 2e-3, "stiffness": 2e4, "lift": 3e-4}
    outlets = {"relief": relief, "vent": {"diameter": 2e-4}}
    shut = engine().with_values(BARE | {"tensioners": [engine().tensioners[0]]})
    drives = [shut, shut.with_values({f"tensioners.0.{key}": value for key, value in outlets.items()})]
    closed, opened = simulate(drives, duration=0.03, step=5e-7, device="cpu").metrics.to_pylist()
    assert opened["element.relieved"] > 0.0 and opened["element.vented"] > 0.0
    assert closed["element.relieved"] is None and opened["element.pressure_max"] < closed["element.pressure_max"]
    # as without: what contacts leave over, first order in the step, and 1e-3 of what the oil takes
    assert abs(opened["energy_residual"]) < 2.0 * abs(closed["energy_residual"]) + 1e-3 * opened["element.oil_loss"]


def test_oil_leaves_the_energy_balance_as_good_as_without():
    oiled = engine()
    drives = [oiled.with_values({"tensioners": []}), oiled.with_values(BARE | {"tensioners": [oiled.tensioners[0]]})]
    without, with_oil = simulate(drives, duration=0.03, step=5e-7, device="cpu").metrics.to_pylist()
    assert with_oil["element.pressure_max"] > 5e5 > with_oil["element.pressure_min"]  # its valve closes and opens
    assert with_oil["element.oil_loss"] > 0.0
    # what contacts leave over, first order in the step, and 1e-3 of what the oil takes
    assert (
        abs(with_oil["energy_residual"]) < 2.0 * abs(without["energy_residual"]) + 1e-3 * with_oil["element.oil_loss"]
    )
