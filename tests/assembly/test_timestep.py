"""Steps of drives whose numbers are absurd: told, and no number beyond all numbers."""

import pytest
from drives import two_sprockets

from warpchain.assembly.timestep import automatic_step, resolve_step, step_limit
from warpchain.errors import DriveError

ABSURD = {
    "damping of links": {"chain.damping": 1e30, "chain.roller_mass": 1e-300},
    "damping of contacts": {"contact.sprocket.law": "kelvin-voigt", "chain.roller_mass": 1e-300},
    "stiffness": {"chain.stiffness": 1e30, "chain.roller_mass": 1e-300},
    "mass": {"chain.roller_mass": 5e-324},
}


@pytest.mark.parametrize("case", ABSURD)
@pytest.mark.parametrize("step", ["auto", 1e-6])
def test_no_step_is_small_enough_for_absurd_numbers(case, step):
    """The limit 2 / omega_max underflows or is far below any step that is asked for."""
    drive = two_sprockets().with_values(ABSURD[case])
    assert 0.0 <= step_limit(drive) < 1e-100
    if step == "auto" and automatic_step(drive) > 0.0:
        assert resolve_step(drive.with_values({"run.step": "auto"})) == automatic_step(drive)
        return
    with pytest.raises(DriveError, match=r"run\.step = ") as caught:
        resolve_step(drive.with_values({"run.step": step}))
    assert "\n" not in str(caught.value)
