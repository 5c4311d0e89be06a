"""Results of docs/validation.md that are exact; helpers of tests/ compute those of the tests."""

import cmath
import importlib.util
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common.cases import ROOT
from common.drives import TWO
from scipy.optimize import brentq

from warpchain import load_drive
from warpchain.fit import fit_links, fit_position
from warpchain.modal.campbell import campbell


class ValidationRow(NamedTuple):
    """A result of others, and the same of warpchain. The page has the words of what is empty."""

    name: str
    source: str = ""
    states: str = ""
    drive: str = ""
    gives: str = ""
    differs: str = ""
    verdict: str = ""


def test_helpers(place: str) -> Any:
    """A module of tests/, whose helpers compute what the tests hold."""
    before = sys.path[:]
    sys.path.insert(0, str(ROOT / "tests"))
    try:
        spec = importlib.util.spec_from_file_location(f"validated_{Path(place).stem}", ROOT / "tests" / f"{place}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path[:] = before


def relative_difference(found: float, exact: float) -> str:
    """Relative difference."""
    return f"{found / exact - 1.0:+.1e}"


def polygon_action() -> ValidationRow:
    """Speed ratio of two slow sprockets of 16 teeth, 7.5 pitches apart, as links and contacts stiffen."""
    ratio_range = test_helpers("engine/test_drive_physics").ratio_range
    low, high = math.cos(math.pi / 16), 1.0 / math.cos(math.pi / 16)
    steps = [ratio_range(True, k, 4.0 * k, inertia) for k, inertia in ((1e8, 20.0), (5e8, 2.0))]
    errors = [max(abs(found[0] - low), abs(found[1] - high)) for found in steps]
    return ValidationRow(
        name="polygon action",
        states=f"speed ratio from cos(pi/16) = {low:.5f} to 1/cos(pi/16) = {high:.5f}, rigid links",
        gives=f"{steps[1][0]:.5f} to {steps[1][1]:.5f}",
        differs=f"{errors[1]:.1e}; 1e8 N/m and 20 kg m^2: {errors[0]:.1e}",
    )


def string_modes() -> ValidationRow:
    """Frequencies of a strand of nine rollers between fixed ends, by time steps."""
    strand_frequency = test_helpers("kernels/test_chain_physics").strand_frequency
    pairs = [strand_frequency(1, k) for k in (1, 2, 3)]
    exact = ", ".join(f"{exact:.4f}" for _, exact in pairs)
    return ValidationRow(
        name="string modes",
        states=f"f_k = (1/pi) sqrt(T/(m p)) sin(k pi/20), p stretched: {exact} Hz",
        gives=", ".join(f"{found:.4f}" for found, _ in pairs) + " Hz",
        differs=f"{max(abs(found / exact - 1.0) for found, exact in pairs):.1e}",
    )


def wave_speed() -> ValidationRow:
    """First mode of a strand that travels, beside a moving string's."""
    two_sprockets = test_helpers("drives").two_sprockets
    taut = two_sprockets(teeth=60, links=180, span=60.1, torque=0.0, inertia=200.0, stiffness=1e7)
    result = campbell(taut, [0.0, 4.0], 4).modes[1]
    v, length = 4.0 * taut.pitch_radius(0), 60.1 * taut.chain.pitch
    c = math.sqrt(float(result.tension[50:70].mean()) * taut.chain.pitch / taut.chain.mass)
    exact = (c * c - v * v) / (2.0 * length * c)
    found = float(result.frequency[int(np.argmax(result.across[:4] > 0.9))])
    return ValidationRow(
        name="wave speed",
        states=f"f_1 = (c^2 - v^2)/(2 L c), c = sqrt(T p/m) = {c:.2f} m/s, v = {v:.2f} m/s: {exact:.4f} Hz",
        gives=f"{found:.4f} Hz",
        differs=relative_difference(found, exact),
    )


def restitution() -> ValidationRow:
    """Rebound of a mass from a contact, by the kernels' own contact force."""
    laws = test_helpers("drive/test_laws")
    parameters = (0.3, 0.5, 0.8)
    exact = [laws.hysteretic(0.75 * (1.0 - e * e)) for e in parameters]
    found = [laws.kernel_rebound(laws.drive("lankarani-nikravesh", e)) for e in parameters]
    return ValidationRow(
        name="restitution",
        states="d - ln(1 + d) = -d r - ln(1 - d r), d = 3 (1 - e^2)/4; e = 0.3, 0.5, 0.8: "
        + ", ".join(f"{r:.5f}" for r in exact),
        gives=", ".join(f"{r:.5f}" for r in found),
        differs=f"{max(abs(a / b - 1.0) for a, b in zip(found, exact, strict=True)):.1e}",
    )


def sag() -> ValidationRow:
    """Sag of a strand that has settled under its weight."""
    test_fit = test_helpers("assembly/test_fit")
    start = test_fit.pair().with_values({"contact.sprocket.clearance": 0.0})
    fitted = fit_position(start, "s1", (1.0, 0.0), sag=4e-3, strand="s0->s1")
    found = 1e3 * test_fit.settled_sag(fitted)
    return ValidationRow("sag", gives=f"{found:.4f} mm", differs=relative_difference(found, 4.0))


def centrifugal_tension() -> ValidationRow:
    """Tension of a ring of rollers that turns freely."""
    raw = test_helpers("raw")
    n, omega, pitch, mass, stiffness, steps = 40, 30.0, 0.1, 2.0, 5e6, 20_000
    vertices, radius = raw.polygon(n, pitch)
    s = 2.0 * math.sin(math.pi / n)
    r = stiffness * pitch * s / (stiffness * s * s - mass * omega**2)  # where k (L - p) holds m omega^2 r
    position = vertices * r / radius
    velocity = omega * np.stack([-position[:, 1], position[:, 0]], axis=1)
    given = {"mass": mass, "pitch": pitch, "stiffness": stiffness, "step": 1e-6, "steps": steps}
    sums = raw.run(raw.chain(position, velocity, window=(0, steps), **given))[0].sums()["chain"][0]
    found, exact = float(sums["tension"] / sums["samples"] / n), mass * omega**2 * r / s
    return ValidationRow(
        name="centrifugal tension",
        states=f"T = (m/p) v^2, p stretched: {exact:.5f} N",
        gives=f"{found:.5f} N",
        differs=f"{abs(found / exact - 1.0):.0e}",
    )


def load_of_an_arc() -> ValidationRow:
    """Tension from tooth to tooth of a seated chain whose sprocket is locked."""
    arc_ratio = test_helpers("kernels/test_sliding").arc_ratio
    found, pressure, pitch = arc_ratio(0.0)
    rubbed = arc_ratio(0.1)[0]

    def exact(angle: float) -> float:
        return math.sin(angle) / math.sin(angle + pitch)

    series, leaning = exact(pressure), exact(pressure - math.atan(0.1))
    return ValidationRow(
        name="load along an arc",
        states="tension falls by sin(phi)/sin(phi + 2 pi/z) a tooth, with friction mu by that of phi - atan(mu): "
        f"{series:.4f}, with 0.1 {leaning:.4f}; measured on 20 teeth: hardly depends on elasticity",
        gives=f"{found:.4f}, with 0.1 {rubbed:.4f}",
        differs=f"{relative_difference(found, series)}, {relative_difference(rubbed, leaning)}",
    )


def silent_arc() -> ValidationRow:
    """Least and largest fall of tension along a silent chain's arc on a held wheel, and forces of a pulled one."""
    module = test_helpers("assembly/test_silent_chains")
    tension, _ = module.forces_on_links(module.arc_drive(30, (0.2, 0.5)))
    found, exact = float(tension[12] / tension[11]), module.falls(0.2, 30)
    pulled = module.arc_drive(30, (0.2, 0.5), torque=0.0).with_values(module.PULLED)
    tension, force = module.forces_on_links(pulled)
    both, own = float(force[7].sum() / 2.0), float(tension[7]) * math.tan(math.pi / 30) / math.sin(module.FLANK)
    return ValidationRow(
        name="arc of a silent chain",
        states=f"a tooth's fall where flanks begin {exact:.4f}; pulled without moment, each flank has "
        f"T tan(pi/z)/sin(30) = {own:.2f} N",
        gives=f"{found:.4f}; {both:.2f} N",
        differs=f"{relative_difference(found, exact)}; {relative_difference(both, own)}",
    )


def silent_backs() -> ValidationRow:
    """Height of a silent chain's pins in the middle of a guide's arc over that on a flat face."""
    found, exact = test_helpers("kernels/test_backs").pin_heights(0.15)
    return ValidationRow(
        name="backs of a silent chain on a guide",
        states=f"links touch with their middles, so pins stand {1e6 * exact:.2f} um farther off",
        gives=f"{1e6 * found:.2f} um",
        differs=relative_difference(found, exact),
    )


def silent_polygon_action() -> ValidationRow:
    """Angle of two equal wheels of a stiff silent chain against each other, as of a four-bar linkage."""
    module = test_helpers("assembly/test_silent_chains")
    found, exact = module.angle_range(7.5), module.exact_range(7.5)
    return ValidationRow(
        name="polygon action of a silent chain",
        states=f"wheels {1e3 * exact:.4f} mrad apart within a tooth, rigid links",
        gives=f"{1e3 * found:.4f} mrad",
        differs=relative_difference(found, exact),
    )


def orders() -> ValidationRow:
    """Order of convergence of a chain in smooth motion, beside DOP853."""
    physics, raw = test_helpers("kernels/test_chain_physics"), test_helpers("raw")
    position, _ = raw.polygon(16, physics.PITCH)
    velocity = np.random.default_rng(5).normal(scale=0.2, size=position.shape)
    exact, found = physics.reference(position, velocity, 0.004, 0.0), {}
    given = {"mass": physics.MASS, "pitch": physics.PITCH, "stiffness": physics.STIFFNESS, "gravity": (0.0, -9.81)}
    for integrator in ("leapfrog", "rk4"):
        errors = []
        for steps in (200, 400):
            packed = raw.chain(position, velocity, step=0.004 / steps, steps=steps, integrator=integrator, **given)
            errors.append(np.abs(raw.state(raw.run(packed)[0])[:2].T - exact).max())
        found[integrator] = math.log2(errors[0] / errors[1])
    return ValidationRow(
        name="order in the step",
        gives=f"{found['leapfrog']:.2f} and {found['rk4']:.2f}",
        differs=f"{abs(found['leapfrog'] - 2.0):.0e} and {abs(found['rk4'] - 4.0):.0e}",
    )


def rigid_centers(teeth: tuple[int, int], pitch: float, links: int, places: int = 20) -> list[float]:
    """Center distances [m] at which rigid links close, rollers on pitch circles and their tangents.

    A link that goes from an arc to a tangent cuts the corner, by more or less as the first roller's place is.
    """
    small, large = (pitch / (2.0 * math.sin(math.pi / z)) for z in teeth)

    def length_excess(center: float, place: float) -> float:
        """Length of the links beyond one round [m], the first roller at a share of it."""
        lean = math.asin((large - small) / center)
        strand = math.sqrt(center * center - (large - small) ** 2)
        normal = cmath.exp(1j * (0.5 * math.pi + lean))  # of the upper tangent
        arcs = strand + (math.pi - 2.0 * lean) * small, (math.pi + 2.0 * lean) * large
        whole = arcs[0] + strand + arcs[1]

        def place_on_path(s: float) -> complex:
            """Place [m] on the path at an arc length [m]."""
            s %= whole
            if s < strand:
                return center + large * normal + (small - large) * normal * s / strand - center * s / strand
            if s < arcs[0]:
                return small * normal * cmath.exp(1j * (s - strand) / small)
            s -= arcs[0]
            low = normal.conjugate()
            if s < strand:
                return small * low + ((large - small) * low + center) * s / strand
            return center + large * low * cmath.exp(1j * (s - strand) / large)

        def next_roller(s: float) -> float:
            """Arc length of the next roller [m]."""
            last = place_on_path(s)
            return float(
                brentq(lambda u: abs(place_on_path(u) - last) - pitch, s + 0.99 * pitch, s + 1.05 * pitch, xtol=1e-15)
            )

        s = place * whole
        for _ in range(links):
            s = next_roller(s)
        return s - (place + 1.0) * whole

    about = 0.5 * pitch * (links - 0.5 * sum(teeth))
    return [
        float(brentq(length_excess, 0.98 * about, 1.01 * about, args=(k / places,), xtol=1e-14)) for k in range(places)
    ]


def center_distance() -> ValidationRow:
    """Links and center distance of 11 and 20 teeth about 400 mm apart."""
    values = {
        "chain.pitch": 0.0254,
        "chain.roller_radius": 0.00794,
        "contact.sprocket.seat_angle": 115.0,
        "sprockets.driver.teeth": 11,
        "sprockets.driven.teeth": 20,
        "sprockets.driven.center": [0.4, 0.0],
    }
    start = fit_links(load_drive(TWO).with_values(values), odd=True)
    fitted = fit_position(start, "driven", (1.0, 0.0), strain=0.0)
    found, stated = 1e3 * fitted.sprockets[1].center[0], 398.338658801
    rigid = 1e3 * np.array(rigid_centers((11, 20), 0.0254, 47))
    return ValidationRow(
        name="links and centers",
        states=f"ASA 80, 11 and 20 teeth, about 400 mm: 47 links, {stated} mm",
        gives=f"{fitted.chain.links} links, {found:.6f} mm",
        differs=f"{found - stated:+.4f} mm; rigid links close from {rigid.min():.4f} to {rigid.max():.4f} mm",
    )


EXACT: tuple[Callable[[], ValidationRow], ...] = (
    polygon_action,
    string_modes,
    wave_speed,
    restitution,
    sag,
    centrifugal_tension,
    load_of_an_arc,
    silent_arc,
    silent_backs,
    silent_polygon_action,
    orders,
    center_distance,
)
"""Rows that take a second or a few."""
