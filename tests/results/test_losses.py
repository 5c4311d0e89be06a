"""Losses by group: with output, change of energy and residual they make up the input."""

import pytest
from drives import example, row
from silent_chains import pulled_silent_drive

from warpchain import simulate
from warpchain.results.losses import friction_power, losses


def test_losses_close_the_energy_balance():
    """input = output + losses + change + residual, all of them sums of the same window: to rounding of float64."""
    drive = example("engine").with_values({"run.duration": 0.004})
    metrics = row(drive)
    found = losses(drive, metrics)
    assert list(found) == sorted(found, key=lambda group: -found[group])
    assert set(found) == {"joints", "sprocket contacts", "guides", "links", "mounts"}
    assert min(found.values()) > 0.0
    total = metrics["output_work"] + sum(found.values()) + metrics["energy_change"] + metrics["energy_residual"]
    assert total == pytest.approx(metrics["input_work"], rel=1e-9)


def test_what_a_start_stored_is_no_work_of_the_loads():
    """Marine, lightly loaded, gives back in 0.3 to 0.6 s what its start stored, 7 % of the input; 4 s tell 0.927."""
    path = {"sprockets.camshaft.load.torque": 6000.0, "sprockets.crankshaft.prescribed.speed": 8.0}
    drive = example("marine").with_values(path)
    early, late = row(drive, duration=0.6), row(drive, duration=4.0)
    assert early["output_work"] / early["input_work"] > 0.98
    assert early["efficiency"] == pytest.approx(late["efficiency"], abs=0.005)
    assert early["status"] == "suspect" and "% of the losses" in early["reason"]
    assert (late["status"], late["reason"]) == ("ok", "")


def test_only_groups_that_a_drive_has():
    from drives import two_sprockets

    drive = two_sprockets(duration=0.001, settle="false")
    assert set(losses(drive, row(drive))) == {"sprocket contacts", "links"}


def test_frames_of_silent_chains_tell_no_friction_of_teeth():
    drive = pulled_silent_drive(
        **{"contact.sprocket.friction": 0.1, "chain.joint": {"friction": 0.1, "pin_radius": 0.0014}}
    )
    assert list(friction_power(simulate(drive, duration=0.001, device="cpu")[0])) == ["joints"]
