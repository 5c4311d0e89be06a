"""Figures of standards and makers for a chain at work."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from warpchain.assembly.assembly import Assembly
from warpchain.assembly.path import ChainPath
from warpchain.assembly.statics import Steady
from warpchain.drive.body_ties import nearest_sprocket
from warpchain.drive.sprocket import Sprocket
from warpchain.model import ChainModel
from warpchain.model.power_rating import (
    LEFT_OUT,
    LUBRICATION,
    RATED_HOURS,
    WEAR_COEFFICIENT,
    elongation_limit,
    lubrication_class,
    lubrication_limits,
    rated_power,
    size_rating,
)
from warpchain.model.trains import body_speed_ratio, inertia_behind_body, is_free_body

SLACK = (0.02, 0.04, 0.06)
"""Slack strand's movement by hand over its length [-]: 4 % by Tsubaki, 2 % if long or steep, 6 % by Diamond Chain."""

Strands = Sequence[Mapping[str, Any]]


def passes_moment(sprocket: Sprocket) -> bool:
    """Whether a sprocket passes on a moment: driver, loaded or on a shaft."""
    return sprocket.prescribed is not None or sprocket.load is not None or sprocket.shaft is not None


def smallest_driven(model: ChainModel) -> int:
    """Index of the sprocket with the fewest teeth of those that pass on a moment."""
    passing = (s for s, sprocket in enumerate(model.sprockets) if s == model.driver or passes_moment(sprocket))
    return min(passing, key=lambda s: model.sprockets[s].teeth)


def rating_values(model: ChainModel, strands: Strands, speed: float) -> dict[str, Any] | None:
    """Rated power, life and lubrication of a chain by name, in SI units; None without a rating.

    Args:
        strands: each with its "working_tension" [N].
        speed: mean speed of the chain at work [m/s].
    """
    chain, small = model.chain, smallest_driven(model)
    standard = size_rating(chain.size)
    if standard is None or chain.size is None or speed == 0.0 or chain.is_open:
        return None
    tensions = [strand["working_tension"] for strand in strands]
    teeth, power = model.sprockets[small].teeth, (max(tensions) - min(tensions)) * abs(speed)
    turning = math.tau * abs(speed) / (chain.pitch * teeth)
    rated = rated_power(chain.size, teeth, turning)
    limit = elongation_limit(max(sprocket.teeth for sprocket in model.sprockets))
    worn = wear_rate(model, tensions, speed)
    return {
        "standard": standard.standard,
        "power": power,
        "rated_power": float(rated.least),
        "use": power / float(rated.least),
        "limited_by": rated.limited_by,
        "teeth": teeth,
        "speed": turning,
        "rated_life": 3600.0 * RATED_HOURS,
        "elongation_limit": limit,
        "wear_life": limit / worn if worn else None,
        "lubrication": lubrication_class(chain.pitch, abs(speed)),
        "lubrication_limits": list(lubrication_limits(chain.pitch)),
        "left_out": LEFT_OUT,
    }


def wear_rate(model: ChainModel, tensions: Sequence[float], speed: float) -> float:
    """Elongation rate of a chain by wear of its joints [1/s].

    Args:
        tensions: of the strands [N].
        speed: of the chain [m/s].
    """
    chain = model.chain
    assert chain.pin_radius is not None and chain.joint_area is not None  # a size has both
    turned = sum(
        math.tau / sprocket.teeth * (tensions[s - 1] + tensions[s]) for s, sprocket in enumerate(model.sprockets)
    )
    circuits = abs(speed) / (chain.links * chain.pitch)
    return circuits * WEAR_COEFFICIENT / (chain.joint_area * chain.pitch) * chain.pin_radius * max(turned, 0.0)


def resting_sags(model: ChainModel, assembly: Assembly, resting: Steady) -> dict[int, float]:
    """Sag at rest of strands on no guide [m], by index; none without gravity or rest."""
    if resting.failure or not any(model.run.gravity):
        return {}
    strands = range(len(model.strand_names))
    return {k: abs(float(resting.displacement[k])) for k in strands if assembly.path.strings[k] is None}


def resting_sag(model: ChainModel, assembly: Assembly, strands: Strands, resting: Steady) -> dict[str, Any] | None:
    """Sag at rest, by name, of the strand slackest at work; None on guides, without gravity or rest."""
    k = min(range(len(strands)), key=lambda k: float(strands[k]["working_tension"]))
    hangs, length = resting_sags(model, assembly, resting).get(k), float(strands[k]["length"])
    if hangs is None:
        return None
    moved = 4.0 / math.sqrt(3.0) * hangs  # docs/selection.md
    return {"strand": strands[k]["name"], "sag": hangs, "length": length, "movement": moved, "slack": moved / length}


def critical_speeds(model: ChainModel, path: ChainPath, strands: Strands, speed: float) -> dict[str, dict[str, Any]]:
    """Frequencies of strands and sprockets, and the driver's speeds that excite them.

    Args:
        strands: each with "name", "links", "free_lengths", "working_tension", "centrifugal_tension".
        speed: of the driver at work [rad/s].

    Returns:
        "transverse", "longitudinal" and "torsional", where present, each with "strand" ("" for all), "frequency" [Hz],
            "teeth_speed" and "revolution_speed" [rad/s]; nothing where no sprocket drives.
    """
    if model.sprockets[model.driver].is_end:
        return {}
    chain, teeth = model.chain, model.sprockets[model.driver].teeth

    def critical(strand: str, frequency: float, revolution: float) -> dict[str, Any]:
        """Row of a critical frequency [Hz] and its speeds [rad/s]."""
        return {
            "strand": strand,
            "frequency": frequency,
            "teeth_speed": math.tau * frequency / teeth,
            "revolution_speed": revolution,
        }

    across, along = [], []
    for strand in strands:
        pull = (strand["working_tension"] - strand["centrifugal_tension"]) * chain.pitch / chain.mass
        length = max(strand["free_lengths"])
        if pull > 0.0 and length > 0.0:
            by_teeth, by_turns = (_swinging_speed(pull, length, q) for q in (chain.pitch, teeth * chain.pitch))
            turns = math.tau * by_turns / (teeth * chain.pitch)
            across.append(critical(strand["name"], by_teeth / chain.pitch, turns))
            rate = math.sqrt(chain.mean_stiffness / chain.mass) / math.pi
            held = rate * math.sin(math.pi / (2.0 * strand["links"]))
            along.append(critical(strand["name"], held, math.tau * held))
    found = {
        name: min(of, key=lambda one: abs(math.log(one["teeth_speed"] / speed)) if speed else one["teeth_speed"])
        for name, of in (("transverse", across), ("longitudinal", along))
        if of
    }
    turning = torsional_frequency(model, path, strands)
    return found if turning is None else found | {"torsional": critical("", turning, math.tau * turning)}


def _swinging_speed(pull: float, length: float, period: float) -> float:
    """Chain speed at which a strand swings once per period of length [m/s]."""
    return math.sqrt(0.5 * (math.sqrt(pull * pull + (pull * period / length) ** 2) - pull))


def torsional_frequency(model: ChainModel, path: ChainPath, strands: Strands) -> float | None:
    """Lowest torsional frequency of sprockets on pulled strands [Hz], or None."""
    count, (gx, gy) = len(model.sprockets), model.run.gravity
    masses = np.zeros(count)
    for b in range(count + len(model.shafts)):
        s = nearest_sprocket(model, b)
        if s is not None:
            inertia = inertia_behind_body(model, b) if is_free_body(model, b) else math.inf
            masses[s] += inertia * (body_speed_ratio(model, b, s) / model.pitch_radius(s)) ** 2
    stiffness = np.zeros((count, count))
    for k, strand in enumerate(strands):
        pull = strand["working_tension"] - strand["centrifugal_tension"]
        if pull > 0.0:
            x, y = path.strand_end[k] - path.strand_start[k]
            weight = model.chain.mass / model.chain.pitch * (gx * y - gy * x)  # w L
            give = strand["links"] / model.chain.mean_stiffness + weight**2 * math.hypot(x, y) / (12.0 * pull**3)
            ends, spring = [k, (k + 1) % count], 1.0 / give
            stiffness[np.ix_(ends, ends)] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    free = np.flatnonzero(np.isfinite(masses) & (masses > 0.0))
    scale = 1.0 / np.sqrt(masses[free])
    squares = np.linalg.eigvalsh(scale[:, None] * stiffness[np.ix_(free, free)] * scale)
    turning = squares[squares > 1e-9 * squares.max(initial=0.0)]
    return float(math.sqrt(turning[0]) / math.tau) if len(turning) else None


def rating_advice(found: Mapping[str, Any] | None, hung: Mapping[str, Any] | None) -> list[str]:
    """Advice on more power than rated, and on a strand that hangs too far."""
    lines = []
    if found is not None and found["use"] > 1.0:
        lines.append(
            f"chain: passes on {1e-3 * found['power']:.4g} kW at work, {found['use']:.3g} times the "
            f"{1e-3 * found['rated_power']:.4g} kW that it is rated for ({found['standard']}): take a larger size, or "
            "more strands"
        )
    if hung is not None and hung["slack"] > SLACK[2]:
        lines.append(
            f'strand "{hung["strand"]}": sags by {1e3 * hung["sag"]:.3g} mm at rest, so that it can be moved by '
            f"{100.0 * hung['slack']:.2g} % of its length, where makers ask for at most {100.0 * SLACK[2]:g} %: take "
            "links out, or move a sprocket (warpchain fit --sag)"
        )
    return lines


def rating_lines(found: Mapping[str, Any] | None) -> list[str]:
    """Report lines of `check` on rating, life and lubrication."""
    if found is None:
        return []
    rpm, (slow, fast) = found["speed"] * 30.0 / math.pi, found["lubrication_limits"]
    worn = "" if found["wear_life"] is None else (
        f"; by Archard's law {found['wear_life'] / 3600.0:.3g} h at work, k = {WEAR_COEFFICIENT:g} m^2/N (docs/wear.md)"
    )  # fmt: skip
    kind = found["lubrication"]
    return [
        f"rating: {1e-3 * found['power']:.4g} kW at work, {found['use']:.3g} of the {1e-3 * found['rated_power']:.4g} "
        f"kW for {found['teeth']} teeth at {rpm:.4g} rpm ({found['standard']}), by {found['limited_by']}",
        f"  that leaves out {found['left_out']}: run the drive",
        f"life: at its rated power {found['rated_life'] / 3600.0:g} h until it is "
        f"{100.0 * found['elongation_limit']:.3g} % longer (ACA){worn}",
        f"lubrication: {kind}, {LUBRICATION[kind]} (ASME B29.1); A up to {slow:.3g} m/s, B up to {fast:.3g} m/s "
        "(Machinery's Handbook)",
    ]


def strand_lines(hung: Mapping[str, Any] | None, speeds: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Report lines of `check` on a strand's sag and on critical speeds."""
    lines = []
    if hung is not None:
        least, usual, most = (100.0 * share for share in SLACK)
        share = 100.0 * hung["sag"] / hung["length"]
        lines.append(
            f'sag: slack strand "{hung["strand"]}", {1e3 * hung["sag"]:.3g} mm at rest, {share:.2g} % of its length; '
            f"by hand it moves {100.0 * hung['slack']:.2g} %, of which makers ask for {least:g} to {usual:g} % "
            f"(Tsubaki), {most:g} % at most (Diamond Chain)"
        )
    words = {
        "transverse": "moving string (Sack 1954)",
        "longitudinal": "springs and masses, ends held",
        "torsional": "inertias on pulled strands (Ernst 1965)",
    }
    for name, one in speeds.items():
        of = f'"{one["strand"]}"' if one["strand"] else "sprockets against each other"
        teeth, turns = (one[key] * 30.0 / math.pi for key in ("teeth_speed", "revolution_speed"))
        lines.append(
            f"critical, {name}: {of}, {one['frequency']:.4g} Hz, at {teeth:.4g} rpm of the driver by its teeth, "
            f"{turns:.4g} rpm by its revolutions; {words[name]}"
        )
    return lines
