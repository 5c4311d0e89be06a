"""The contact laws by name: rebound in the kernel against closed forms and a 1-D impact, mixing."""

import math

import numpy as np
import pytest
import warp as wp
from bouncing import KINDS, bounce
from drives import two_sprockets
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from warpchain import Record, simulate
from warpchain.assembly.summary import derived_quantities, report
from warpchain.assembly.timestep import highest_frequency, step_limit
from warpchain.drive.laws import LAWS
from warpchain.drive.stiffness import contact_rebound, rebound_ratio
from warpchain.engine.pack import pack
from warpchain.errors import DriveError, SimulationError
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule

MASS, STIFFNESS = 1.0, 2e8


def drive(law, e=0.5, means="parameter", exponent=1.0, **options):
    values = {"law": law, "restitution": e, "restitution_means": means, "exponent": exponent}
    return two_sprockets(mass=MASS, contact=STIFFNESS, **options).with_values(
        {f"contact.sprocket.{key}": value for key, value in values.items()}
    )


def packed_law(drive):
    """The kernels' parameters of the drive's sprocket contact."""
    row = pack([drive], [Schedule(1e-6, 1, 0, 1, 0)]).sprockets[0]["law"]
    law = KINDS.ContactLaw()
    for name in row.dtype.names:
        setattr(law, name, row[name].item())
    return law


def kernel_rebound(drive, speed=0.7):
    """Rebound of one free mass, stepped by the kernels' own contact at 5e-5 of sqrt(m / K)."""
    law = packed_law(drive)
    law.speed_floor, law.lag, law.yielding = 1e-9, 0.0, 0.0
    out = wp.zeros(3, dtype=wp.float64, device="cpu")
    n = law.exponent
    scale = (MASS / STIFFNESS * speed ** (1 - n)) ** (1 / (1 + n))
    wp.launch(bounce, dim=1, inputs=[law, MASS, speed, 5e-5 * scale, out], device="cpu")
    return out.numpy()[0] / speed


def hysteretic(d):
    """d - ln(1 + d) = -d r - ln(1 - d r), by bracketing, for d r < 1."""
    if d == 0:
        return 1.0
    return brentq(lambda r: d - math.log1p(d) + d * r + math.log1p(-d * r), 1e-12, min(1.0, 1 / d) - 1e-12)


def kelvin_voigt(e):
    """Leaves when the force vanishes: r = exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2))."""
    zeta = -math.log(e) / math.hypot(math.pi, math.log(e))
    return math.exp(-2 * zeta * math.acos(zeta) / math.sqrt(1 - zeta * zeta)) if zeta > 0 else 1.0


CLOSED = {
    "lankarani-nikravesh": lambda e: hysteretic(0.75 * (1 - e * e)),
    "flores": lambda e: hysteretic(8 * (1 - e) / (5 * e)),
    "hunt-crossley": lambda e: hysteretic(1.5 * (1 - e)),
    "kelvin-voigt": kelvin_voigt,
}


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("law", CLOSED)
def test_rebound_in_the_kernel_is_the_closed_form(law, e):
    # midpoint steps of 5e-5 of the contact's time: the last step's overshoot is of that order
    assert rebound_ratio(e, law) == pytest.approx(CLOSED[law](e), rel=1e-9)
    assert contact_rebound(drive(law, e).contact.sprocket) == pytest.approx(CLOSED[law](e), rel=1e-9)
    assert kernel_rebound(drive(law, e)) == pytest.approx(CLOSED[law](e), abs=2e-4)


@pytest.mark.parametrize(("law", "exponent"), [("flores", 1.5), ("hunt-crossley", 1.5), ("kelvin-voigt", 1.0)])
def test_rebound_is_that_of_the_impact_written_out(law, exponent):
    # x'' = -F(x, x') / m with unit mass, stiffness and speed, to 1e-11, until the force vanishes
    e = 0.4
    factor = {"flores": 1.6 * 0.6 / 0.4, "hunt-crossley": 0.9}.get(law)
    zeta = -math.log(e) / math.hypot(math.pi, math.log(e))

    def force(x, v):
        if law == "kelvin-voigt":
            return x + 2 * zeta * v
        return max(x, 0.0) ** exponent * (1 + factor * v)

    def leaves(t, y):
        return y[0] if law != "kelvin-voigt" else force(*y)

    leaves.terminal, leaves.direction = True, -1
    start = [1e-12, 1.0] if law != "kelvin-voigt" else [0.0, 1.0]
    exact = {"method": "DOP853", "events": leaves, "rtol": 1e-11, "atol": 1e-14}
    flight = solve_ivp(lambda t, y: [y[1], -force(*y)], (0, 100), start, **exact)
    assert -flight.y[1, -1] == pytest.approx(rebound_ratio(e, law), rel=1e-7)
    assert kernel_rebound(drive(law, e, exponent=exponent)) == pytest.approx(rebound_ratio(e, law), abs=5e-4)


@pytest.mark.parametrize("e", [0.05, 0.3, 0.5, 0.999, 1.0])
@pytest.mark.parametrize("law", LAWS)
def test_rebound_means_what_comes_back(law, e):
    # also below what the law can return at all as its parameter's value (Lankarani-Nikravesh: 0.66 for e = 0)
    asked = drive(law, e, "rebound")
    assert contact_rebound(asked.contact.sprocket) == pytest.approx(e, rel=1e-9)
    assert kernel_rebound(asked) == pytest.approx(e, abs=3e-4)


def test_rebound_ratio_of_an_unknown_law():
    with pytest.raises(DriveError, match=r"^law = 'hertz': must be one of lankarani-nikravesh, flores, "):
        rebound_ratio(0.5, "hertz")


@pytest.mark.usefixtures("device")
def test_laws_mix_in_an_ensemble():
    variants = [drive(law, 0.3, duration=0.01) for law in LAWS]
    together = simulate(variants, record=Record("all"))
    positions = [together[v].position for v in range(len(LAWS))]
    for one, position in zip(variants, positions, strict=True):
        np.testing.assert_array_equal(simulate(one)[0].position, position)
    for a in range(len(LAWS)):
        for b in range(a):
            assert np.abs(positions[a] - positions[b]).max() > 1e-9


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.usefixtures("device")
def test_energy_balance_of_every_law(law):
    # the residual is of the step's order, as with the default law (5e-3 at 8e-6 s)
    run = simulate(drive(law, 0.3, duration=0.4, step=2e-6), record=Record("none"))
    values = run.metrics.to_pylist()[0]
    assert abs(values["energy_residual_relative"]) < 2e-3
    assert values["driver.dissipated"] > 0.0


@pytest.mark.usefixtures("device")
def test_dampers_of_links_shorten_the_longest_step_and_those_of_contacts_do_not():
    # leapfrog with dampers' speeds half a step late: omega^2 h^2 + 2 (c/m) h = 4, of links c = 4 times one link's;
    # contacts' are centered in time. The sprocket that turns freely adds K (z - 1) R^2 / J
    free, damped = drive("lankarani-nikravesh", 0.05), drive("kelvin-voigt", 0.05)
    h = step_limit(damped)
    driven = damped.sprockets[1]
    turning = (driven.teeth - 1) * STIFFNESS * single_chain(damped).pitch_radius(1) ** 2 / driven.inertia
    omega_square, links = (4 * 5e7 + STIFFNESS) / MASS + turning, 4 * damped.chain.damping / MASS
    assert omega_square * h * h + 2 * links * h == pytest.approx(4.0, rel=1e-12)
    assert step_limit(free) == pytest.approx(h, rel=1e-12)
    assert 2.0 / highest_frequency(free, damped_links=False) == pytest.approx(2 / math.sqrt(omega_square), rel=1e-12)
    with pytest.raises((DriveError, SimulationError), match=r"must be above 0 and below .* less for dampers"):
        simulate(damped.with_values({"run.step": 1.01 * h}))


def test_check_tells_the_rebound():
    values = derived_quantities(drive("flores", 0.4, "rebound"))
    assert values["law"] == "flores"
    assert values["rebound"] == pytest.approx(0.4, rel=1e-9)
    assert "teeth: flores, a free roller rebounds with 0.400" in report(values)
