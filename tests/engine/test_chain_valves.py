"""Valve trains on shafts and sprockets of several chains, against one chain and in the energy balance."""

import chains
import numpy as np
import pytest
from drives import example
from parts import part

from warpchain import simulate
from warpchain.assembly.summary import derived_quantities
from warpchain.errors import DriveError

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")


def heavy(on):
    """Valves whose m l'^2 is as large as the shaft's inertia of 2 kg m^2, and changes within the run."""
    profile = {"shape": "polynomial", "lift": 0.1, "rise": 60.0, "fall": 60.0}
    spring = {"preload": 500.0, "stiffness": 2e4}
    return part("valves", "valves", on=on, number=2, phases=[-20.0, 90.0], mass=20.0, spring=spring, profile=profile)


@pytest.fixture(scope="module", params=["leapfrog", "rk4"])
def beside_each_other(request):
    """Two chains with valves on a shaft, on its sprocket of either chain, and one of twice everything with them."""
    short = {"duration": 0.02, "step": 2.5e-6}
    two = [chains.plus(chains.side_by_side(2, **short), heavy(on)) for on in ("B", "b0", "b1")]
    drives = [*two, chains.plus(chains.side_by_side(0, **short), heavy("b0"))]
    return simulate([drive.with_values({"run.integrator": request.param}) for drive in drives], device="cpu")


def test_valves_beside_two_equal_chains_are_those_of_one_of_twice_everything(beside_each_other):
    """To round-off, as the moments of two chains are added up one after the other."""
    rows, one = beside_each_other.metrics.to_pylist(), beside_each_other[3]
    for v in range(3):
        two = beside_each_other[v]
        for half in (slice(0, 60), slice(60, 120)):
            np.testing.assert_allclose(two.position[:, half], one.position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            two.valve_torque, one.valve_torque, rtol=0, atol=1e-6 * np.abs(one.valve_torque).max()
        )
        for name in ("valves.cam_torque_mean", "valves.cam_force_min", "valves.valve_float", "output_work"):
            assert rows[v][name] == pytest.approx(rows[3][name], rel=1e-8), name
    assert np.ptp(one.valve_torque) > 100.0


def test_their_energy_is_in_the_balance(beside_each_other):
    """That of valves at the window's ends, of some joules, is most of what changes."""
    for row in beside_each_other.metrics.to_pylist():
        assert abs(row["energy_residual_relative"]) < 1e-5
        assert abs(row["energy_change"]) > 1.0


@pytest.mark.long
def test_a_v6_with_valves(device):
    """Groups on cams of three chains; metrics have their names once, and all balances close."""
    car, v6 = (example(name) for name in ("car", "v6"))
    cams = ("left cam", "right cam", "exhaust cam")
    groups = [
        car.valves[0].model_copy(update={"name": f"{cam} valves", "on": cam, "phases": (0.0, 120.0, 240.0)})
        for cam in cams
    ]
    drive = v6.with_values({"valves": groups, **{f"sprockets.{cam}.load.harmonics": () for cam in cams}})
    run = simulate(drive, device=device, duration=0.06)
    (row,) = run.metrics.to_pylist()
    for cam in cams:
        assert row[f"{cam} valves.cam_torque_max"] > 5.0 and row[f"{cam} valves.valve_float"] == 0.0
    assert abs(row["energy_residual_relative"]) < 1e-4
    assert run[0].valve_torque.shape[1] == 3
    found = derived_quantities(drive)
    assert [of["on"] for of in found["valves"]] == [*cams] and not any(
        "valves" in of for of in found["chains"].values()
    )
    for of in found["valves"]:  # a cam turns half as fast as the crank
        assert of["driver_float_speed"] == pytest.approx(2.0 * of["float_speed"], rel=1e-12)


def test_valves_are_on_something_that_turns():
    with pytest.raises(DriveError, match=r'valves.valves.on = "c0": must be the name of a sprocket or a shaft'):
        chains.plus(chains.side_by_side(2), heavy("c0"))
