"""Values that a drive file may leave out, and what they then are: those of a chain of a catalogue size on steel wheels.

Each hangs on what the file has: on the pitch, the teeth, the centers, the speed of the driver. `warpchain check` lists
those that a file leaves out. A drive that is written has them all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from warpchain.drive.catalogue import CHAINS, STEEL, CatalogueChain
from warpchain.drive.contact_settings import MATERIALS
from warpchain.drive.quantities import converted
from warpchain.drive.schema import Part, elements, get, numbers

Path = tuple[str | int, ...]
Values = Iterator[tuple[Path, Any]]

CLEARANCE, BUSH_STIFFNESS = 0.004, 5.0e9
"""Clearance in a seat over the pitch [-], stiffness of bush and pin over pitch and strands [N/m^2]."""
TOOTH_WIDTH, INNER_WIDTH = 0.93, 0.62
"""Width of teeth over the chain's inner width, and that over the pitch, as in ISO 606 [-]."""
SAFETY = 15.0
"""Breaking load over the pull that contacts are as stiff as under, where no load says it [-]."""
LAW = {"restitution": 0.3, "restitution_means": "rebound", "impact_speed_floor": 0.02}
STEEL_BODY = {"youngs_modulus": 210e9, "poissons_ratio": 0.3}
TEETH_FRICTION = 0.06
"""Of rollers on teeth."""
DAMPING_RATIO = 0.02
SAMPLES_A_TOOTH, SAMPLE_RATE, CIRCUITS = 20.0, 2000.0, 1.5
"""Samples a tooth of the driver, rate where its speed is not known [Hz], circuits of the chain in a run."""


FREE_KEYS = {
    "Drive": ("contact", "run"),
    "Contact": ("sprocket",),
    "SprocketContact": ("restitution", "impact_speed_floor"),
    "RunSettings": ("duration", "step", "sample_rate"),
    "Chain": ("links", "stiffness"),
    "NamedChain": ("stiffness",),
    "Sprocket": ("name", "wrap"),
}
"""Keys of parts that have such defaults, by the name of the part's class, of those that it needs otherwise."""


UNKNOWN_LINKS = 100
"""Links around sprockets whose teeth or centers are wrong, which is an error of its own."""


def two_figures(value: float) -> float:
    """A value rounded to two figures."""
    return float(f"{value:.2g}")


def disk(radius: float, width: float) -> tuple[float, float]:
    """Mass [kg] and inertia [kg m^2] of a disk of steel, to two figures."""
    mass = STEEL * math.pi * radius**2 * width
    return two_figures(mass), two_figures(0.5 * mass * radius**2)


def default_values(values: Any) -> dict[Path, Any]:
    """Defaults of what a drive's values leave out, by key path; none where they say too little for it.

    Args:
        values: nested tables and lists of a drive file; numbers may be quantities.
    """
    if not isinstance(values, Mapping):
        return {}
    chains = elements(values, "chains") or [get(values, "chain")]
    found = dict(_chain_values(values, len(chains) == 1))
    found |= dict(_contact_values(values, chains[0]))
    return found | dict(_run_values(values, chains[0], found))


def with_defaults(values: Any) -> Any:
    """A drive's values with what they leave out; themselves where that is nothing."""
    found = default_values(values)
    if not found:
        return values
    whole: Any = dict(values)
    for path, value in found.items():
        node = whole
        for key in path[:-1]:
            inner = node[key] if isinstance(key, int) or key in node else {}
            node[key] = list(inner) if isinstance(inner, list | tuple) else dict(inner or {})
            node = node[key]
        node[path[-1]] = value
    return whole


def _number(value: Any, unit: str) -> float | None:
    """A number, or a quantity in a unit; None for anything else, and for what is not above 0."""
    found: Any = converted(value, unit) if isinstance(value, str) else value
    return float(found) if numbers(found) and found > 0.0 else None


def _size(chain: Any) -> CatalogueChain | None:
    """The catalogue's row of a chain; any for a size that is not in it, which is an error of its own."""
    size = get(chain, "size")
    return CHAINS.get(size, CHAINS["16B"]) if isinstance(size, str) else None


def _pitch(chain: Any) -> float | None:
    """Pitch of a chain [m], its own or that of its size."""
    own, size = _number(get(chain, "pitch"), "m"), _size(chain)
    return size.pitch if own is None and size is not None and get(chain, "pitch") is None else own


def _chain_values(values: Mapping[str, Any], alone: bool) -> Values:
    """Of chains with a size: stiffness and damping; of a single one its links, names, senses and inertias."""
    several = elements(values, "chains")
    for k, chain in enumerate(several or [get(values, "chain")]):
        place: Path = ("chains", k) if several else ("chain",)
        if _size(chain) is None or isinstance(chain, Part):
            continue
        if get(chain, "stiffness") is None:
            yield (*place, "stiffness"), "estimate"
        if get(chain, "damping") is None and get(chain, "damping_ratio") is None:
            yield (*place, "damping_ratio"), DAMPING_RATIO
    chain, sprockets = get(values, "chain"), elements(values, "sprockets")
    size, pitch = _size(chain), _pitch(chain)
    if not alone or size is None or pitch is None or not all(isinstance(one, Mapping) for one in sprockets):
        return
    at = _centers(sprockets)
    senses = ["ccw"] * len(sprockets) if at is None else wrap_senses(at)
    for s, sprocket in enumerate(sprockets):
        if get(sprocket, "name") is None:
            yield ("sprockets", s, "name"), f"sprocket {s + 1}"
        if get(sprocket, "wrap") is None:
            yield ("sprockets", s, "wrap"), senses[s]
        teeth = get(sprocket, "teeth")
        if all(get(sprocket, key) is None for key in ("inertia", "prescribed", "shaft")):
            radius = 0.5 * pitch / math.sin(math.pi / teeth) if numbers(teeth) and teeth > 2 else pitch
            yield ("sprockets", s, "inertia"), disk(radius, TOOTH_WIDTH * size.inner_width * size.strands)[1]
    bent = any(elements(values, kind) for kind in ("guides", "arms", "tensioners"))
    if get(chain, "links") is None and not bent:
        turned = [get(one, "wrap") or sense for one, sense in zip(sprockets, senses, strict=True)]
        yield ("chain", "links"), _even_links(sprockets, turned, pitch) or UNKNOWN_LINKS


def _centers(sprockets: Any) -> list[tuple[float, float]] | None:
    """Centers of sprockets [m]; None where one is missing or wrong."""
    found = []
    for sprocket in sprockets:
        center = elements(sprocket, "center")
        place: list[Any] = [converted(x, "m") if isinstance(x, str) else x for x in center]
        if len(place) != 2 or not numbers(*place):
            return None
        found.append((float(place[0]), float(place[1])))
    return found


def wrap_senses(centers: list[tuple[float, float]]) -> list[str]:
    """Senses in which a chain goes around each sprocket: that of the polygon, the other one at its notches."""
    senses = []
    for (ax, ay), (bx, by), (cx, cy) in zip(centers[-1:] + centers, centers, centers[1:] + centers[:1], strict=False):
        turn = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
        senses.append("cw" if turn < 0.0 else "ccw")
    return senses


def _even_links(sprockets: Any, senses: list[Any], pitch: float) -> int | None:
    """The even number of links that a chain around sprockets needs, rounded up (DIN 8196); None where it has no way."""
    at, count, teeth = _centers(sprockets), len(senses), [get(sprocket, "teeth") for sprocket in sprockets]
    if at is None or count < 2 or not numbers(*teeth) or any(z < 3 for z in teeth):
        return None
    ways = [-1.0 if sense == "cw" else 1.0 for sense in senses]
    radii = [0.5 * way * pitch / math.sin(math.pi / z) for way, z in zip(ways, teeth, strict=True)]
    headings, length = [], 0.0
    for s in range(count):
        (ax, ay), (bx, by) = at[s], at[(s + 1) % count]
        apart, across = math.hypot(bx - ax, by - ay), radii[(s + 1) % count] - radii[s]
        if apart <= abs(across):
            return None
        headings.append(math.atan2(by - ay, bx - ax) - math.asin(across / apart))
        length += math.sqrt(apart * apart - across * across) / pitch
    for s in range(count):
        length += (ways[s] * (headings[s] - headings[s - 1])) % math.tau * teeth[s] / math.tau
    return 2 * math.ceil(0.5 * length - 1e-3)


def _contact_values(values: Mapping[str, Any], chain: Any) -> Values:
    """Of `[contact.sprocket]`, what it needs; where it is missing also friction, bushes and pins."""
    contact, pitch, size = get(values, "contact"), _pitch(chain), _size(chain)
    given = get(contact, "sprocket")
    if pitch is None or not isinstance(contact, Mapping | None) or not isinstance(given, Mapping | None):
        return
    place: Path = ("contact", "sprocket")
    strands = 1 if size is None else size.strands
    if get(given, "restitution") is None:
        for key in ("restitution", "restitution_means"):
            if get(given, key) is None:
                yield (*place, key), LAW[key]
    if get(given, "impact_speed_floor") is None:
        yield (*place, "impact_speed_floor"), LAW["impact_speed_floor"]
    if get(given, "clearance") is None and get(given, "profile") in (None, "circular"):
        yield (*place, "clearance"), two_figures(CLEARANCE * pitch)
    if get(given, "stiffness") is None:
        inner = INNER_WIDTH * pitch if size is None else size.inner_width
        made = (TOOTH_WIDTH * inner * strands, _pull(values, size, pitch), STEEL_BODY, STEEL_BODY)
        for key, value in zip(MATERIALS, made, strict=True):
            if get(given, key) is None:
                yield (*place, key), value if isinstance(value, dict) else float(f"{value:.3g}")
    if given is None:
        yield (*place, "bush_stiffness"), two_figures(BUSH_STIFFNESS * pitch * strands)
        yield (*place, "friction"), TEETH_FRICTION


def _pull(values: Mapping[str, Any], size: CatalogueChain | None, pitch: float) -> float:
    """About the chain's pull [N]: of the largest torque of a sprocket's load, else a part of the breaking load."""
    pulls = []
    for sprocket in elements(values, "sprockets"):
        torque, teeth = _number(get(get(sprocket, "load"), "torque"), "N m"), get(sprocket, "teeth")
        if torque is not None and numbers(teeth) and teeth > 2:
            pulls.append(torque * 2.0 * math.sin(math.pi / teeth) / pitch)
    breaking = 1e8 * pitch**2 if size is None else size.breaking_load
    return two_figures(max(pulls, default=breaking / SAFETY))


def _run_values(values: Mapping[str, Any], chain: Any, found: Mapping[Path, Any]) -> Values:
    """Of `[run]`: the automatic step, samples by the teeth that pass, and a duration of a few circuits."""
    run = get(values, "run")
    if not isinstance(run, Mapping | None):
        return
    rate = None
    for sprocket in elements(values, "sprockets"):
        speed, teeth = _number(get(get(sprocket, "prescribed"), "speed"), "rad/s"), get(sprocket, "teeth")
        if rate is None and speed is not None and numbers(teeth):
            rate = speed * teeth / math.tau
    if get(run, "step") is None:
        yield ("run", "step"), "auto"
    if get(run, "sample_rate") is None:
        yield ("run", "sample_rate"), SAMPLE_RATE if rate is None else two_figures(SAMPLES_A_TOOTH * rate)
    links = found.get(("chain", "links"), get(chain, "links"))
    if get(run, "duration") is None and _size(chain) is not None and rate is not None and numbers(links):
        yield ("run", "duration"), two_figures(CIRCUITS * links / rate)
