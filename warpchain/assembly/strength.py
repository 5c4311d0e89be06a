"""Safety of a chain of ISO 606 against breaking and yield, and joint pressure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from warpchain.assembly.run_up import missing_effects
from warpchain.drive.body_ties import nearest_sprocket
from warpchain.drive.sprocket import Load
from warpchain.model import ChainModel
from warpchain.model.trains import body_speed_ratio, free_body_loads, is_held_body

LEAST_STATIC, LEAST_DYNAMIC = 7.0, 5.0
"""Least breaking load over the tension at work, and over that with peaks."""
YIELD = 0.7
"""Tension at which links begin to yield, over the breaking load."""


def _load_peak_moment(load: Load) -> float:
    """Largest moment of a load over its mean, all harmonics at once [N m]."""
    found = sum(abs(h.amplitude) for h in load.harmonics)
    if load.table is not None:
        over, values = load.table.over, load.table.values
        areas = ((b - a) * (u + v) for a, b, u, v in zip(over, over[1:], values, values[1:], strict=False))
        found += max(values) - 0.5 * sum(areas) / (over[-1] - over[0])
    return found


def peak_tension(model: ChainModel) -> float:
    """Tension that the loads' peaks add to the chain at once [N]."""
    found = 0.0
    for b, load in free_body_loads(model):
        s = nearest_sprocket(model, b)
        if s is not None and not is_held_body(model, s):
            beside = 1.0 if b == s else abs(body_speed_ratio(model, b, s))
            found += beside * _load_peak_moment(load) / model.pitch_radius(s)
    return found


class HardestPull(NamedTuple):
    """Largest tension on the way to work [N], with the driver's speed [rad/s] and acceleration [rad/s^2]."""

    tension: float
    speed: float
    acceleration: float


def strength_values(
    model: ChainModel, tensions: Sequence[float], run_up: HardestPull | None = None
) -> dict[str, Any] | None:
    """Safeties of a chain and joint pressure by name, in SI units; None without breaking load or tension.

    Args:
        tensions: of the strands at work [N].
        run_up: harder pull on the way there.
    """
    load, area = model.chain.breaking_load, model.chain.joint_area
    if load is None or not len(tensions) or max(tensions) <= 0.0:
        return None
    largest = float(max(tensions))
    peak = (largest if run_up is None else max(largest, run_up.tension)) + peak_tension(model)
    return {
        "working": largest,
        "run_up": None if run_up is None or run_up.tension <= largest else run_up._asdict(),
        "peak": peak,
        "left_out": list(missing_effects(model)),
        "static_safety": load / largest,
        "dynamic_safety": load / peak,
        "yield_load": YIELD * load,
        "yield_safety": YIELD * load / peak,
        "joint_area": area,
        "pressure": None if area is None else largest / area,
        "peak_pressure": None if area is None else peak / area,
    }


def strength_advice(model: ChainModel, tensions: Sequence[float], run_up: HardestPull | None = None) -> list[str]:
    """Advice on too small a safety: yield, static or dynamic."""
    found, load = strength_values(model, tensions, run_up), model.chain.breaking_load
    if found is None or load is None:
        return []
    for name, of, least in (
        ("yield", "peak", 1.0),
        ("static", "working", LEAST_STATIC),
        ("dynamic", "peak", LEAST_DYNAMIC),
    ):
        safety, force = found[f"{name}_safety"], found[of]
        if safety < least:
            speeding = of == "peak" and found["run_up"] is not None
            when = "on the way to work" if speeding else "at work"
            when += " with the loads at their peaks" if of == "peak" else ""
            against = (
                f"{1e-3 * YIELD * load:.4g} kN at which links yield"
                if name == "yield"
                else f"breaking load of {1e-3 * load:.4g} kN"
            )
            return [
                f"chain: {1e-3 * force:.4g} kN {when} is a safety of {safety:.2g} against the {against}, where "
                f"{least:g} is the least, before any vibration: take a larger chain.size or less load"
                + (", or speed up more slowly" if speeding else "")
            ]
    return []
