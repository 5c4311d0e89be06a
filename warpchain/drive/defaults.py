"""Values that a drive file may leave out, of a chain of a catalogue size on steel sprockets."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from warpchain.drive.catalogue import CHAINS, STEEL, CatalogueChain
from warpchain.drive.contact_settings import MATERIALS
from warpchain.drive.parts_by_chain import Path, chain_nodes
from warpchain.drive.quantities import converted_number
from warpchain.drive.schema import Part, are_numbers, node_list, node_value

Values = Iterator[tuple[Path, Any]]

CLEARANCE, BUSH_STIFFNESS = 0.004, 5.0e9
"""Clearance of a seat over the pitch [-], stiffness of bush and pin over pitch and strands [N/m^2]."""
TOOTH_WIDTH, INNER_WIDTH = 0.93, 0.62
"""Width of teeth over inner width, and that over the pitch [-]."""
SAFETY = 15.0
"""Breaking load over the pull of drives without loads [-]."""
LAW = {"restitution": 0.3, "restitution_means": "rebound", "impact_speed_floor": 0.02}
STEEL_BODY = {"youngs_modulus": 210e9, "poissons_ratio": 0.3}
TEETH_FRICTION = 0.06
"""Coefficient of friction of rollers on teeth [-]."""
DAMPING_RATIO = 0.02
SAMPLES_A_TOOTH, SAMPLE_RATE, CIRCUITS = 20.0, 2000.0, 2.2  # half the circuits, the window, is one at least
"""Samples a driver's tooth, sampling rate without speed [Hz], chain circuits in a run."""


FREE_KEYS = {
    "Drive": ("contact", "run"),
    "Contact": ("sprocket",),
    "SprocketContact": ("restitution", "impact_speed_floor"),
    "RunSettings": ("duration", "step", "sample_rate"),
    "Chain": ("links", "stiffness"),
    "NamedChain": ("stiffness",),
    "Sprocket": ("name", "wrap"),
}
"""Keys of parts that have defaults, by class."""


UNKNOWN_LINKS = 100
"""Number of links where sprockets are wrong."""


def rounded_to_two_figures(value: float) -> float:
    """A value rounded to two significant figures."""
    return float(f"{value:.2g}")


def disk_mass_and_inertia(radius: float, width: float) -> tuple[float, float]:
    """Default mass [kg] and inertia [kg m^2] of a steel disk, rounded."""
    mass = STEEL * math.pi * radius**2 * width
    return rounded_to_two_figures(mass), rounded_to_two_figures(0.5 * mass * radius**2)


def default_values(values: Any) -> dict[Path, Any]:
    """Defaults by key path that a drive's values leave out."""
    if not isinstance(values, Mapping):
        return {}
    chains = [chain for _, chain in chain_nodes(values)]
    found = dict(_end_values(values, chains)) | dict(_chain_values(values, len(chains) == 1))
    found |= dict(_contact_values(values, chains[0]))
    return found | dict(_run_values(values, chains[0], found))


def values_with_defaults(values: Any) -> Any:
    """A drive's values with the defaults of those left out."""
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


def _positive_number(value: Any, unit: str) -> float | None:
    """A positive number, or quantity in a unit, for defaults; else None."""
    found: Any = converted_number(value, unit) if isinstance(value, str) else value
    return float(found) if are_numbers(found) and found > 0.0 else None


def _catalogue_row(chain: Any) -> CatalogueChain | None:
    """Catalogue's row for a chain, any for an unknown size."""
    size = node_value(chain, "size")
    return CHAINS.get(size, CHAINS["16B"]) if isinstance(size, str) else None


def _chain_pitch(chain: Any) -> float | None:
    """Pitch of a chain for defaults, its own or its size's [m]."""
    own, size = _positive_number(node_value(chain, "pitch"), "m"), _catalogue_row(chain)
    return size.pitch if own is None and size is not None and node_value(chain, "pitch") is None else own


def _chain_values(values: Mapping[str, Any], alone: bool) -> Values:
    """Defaults of chains with a size, and a single one's sprockets."""
    for place, chain in chain_nodes(values):
        if _catalogue_row(chain) is None or isinstance(chain, Part):
            continue
        if node_value(chain, "stiffness") is None:
            yield (*place, "stiffness"), "estimate"
        if node_value(chain, "damping") is None and node_value(chain, "damping_ratio") is None:
            yield (*place, "damping_ratio"), DAMPING_RATIO
    chain, sprockets = node_value(values, "chain"), node_list(values, "sprockets")
    size, pitch = _catalogue_row(chain), _chain_pitch(chain)
    if not alone or size is None or pitch is None or not all(isinstance(one, Mapping) for one in sprockets):
        return
    at = _sprocket_centers(sprockets)
    senses = ["ccw"] * len(sprockets) if at is None else wrap_senses(at)
    ends = node_list(chain, "ends")
    for s, sprocket in enumerate(sprockets):
        if node_value(sprocket, "name") is None:
            yield ("sprockets", s, "name"), f"sprocket {s + 1}"
        if node_value(sprocket, "wrap") is None:
            yield ("sprockets", s, "wrap"), senses[s]
        teeth = node_value(sprocket, "teeth")
        if node_value(sprocket, "name") in ends:
            continue
        if all(node_value(sprocket, key) is None for key in ("inertia", "prescribed", "shaft")):
            radius = 0.5 * pitch / math.sin(math.pi / teeth) if are_numbers(teeth) and teeth > 2 else pitch
            yield (
                ("sprockets", s, "inertia"),
                disk_mass_and_inertia(radius, TOOTH_WIDTH * size.inner_width * size.strands)[1],
            )
    bent = any(node_list(values, kind) for kind in ("guides", "arms", "tensioners"))
    if node_value(chain, "links") is None and not bent and not ends:
        turned = [node_value(one, "wrap") or sense for one, sense in zip(sprockets, senses, strict=True)]
        yield ("chain", "links"), _even_links(sprockets, turned, pitch) or UNKNOWN_LINKS


def _end_values(values: Mapping[str, Any], chains: Sequence[Any]) -> Values:
    """Defaults of open chains' ends."""
    ends = [name for chain in chains for name in node_list(chain, "ends")]
    for s, sprocket in enumerate(node_list(values, "sprockets") if ends else ()):
        if isinstance(sprocket, Mapping) and node_value(sprocket, "name") in ends:
            if node_value(sprocket, "wrap") is None:
                yield ("sprockets", s, "wrap"), "ccw"
            if all(node_value(sprocket, key) is None for key in ("prescribed", "shaft", "rim")):
                yield ("sprockets", s, "prescribed"), {"speed": 0.0}


def _sprocket_centers(sprockets: Any) -> list[tuple[float, float]] | None:
    """Centers of sprockets for defaults [m]; None if one is wrong."""
    found = []
    for sprocket in sprockets:
        center = node_list(sprocket, "center")
        place: list[Any] = [converted_number(x, "m") if isinstance(x, str) else x for x in center]
        if len(place) != 2 or not are_numbers(*place):
            return None
        found.append((float(place[0]), float(place[1])))
    return found


def wrap_senses(centers: list[tuple[float, float]]) -> list[str]:
    """Default senses of wrap of sprockets: their polygon's, opposite at notches."""
    senses = []
    for (ax, ay), (bx, by), (cx, cy) in zip(centers[-1:] + centers, centers, centers[1:] + centers[:1], strict=False):
        turn = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
        senses.append("cw" if turn < 0.0 else "ccw")
    return senses


def _even_links(sprockets: Any, senses: list[Any], pitch: float) -> int | None:
    """Default even number of links around sprockets (DIN 8196), or None."""
    at, count, teeth = (
        _sprocket_centers(sprockets),
        len(senses),
        [node_value(sprocket, "teeth") for sprocket in sprockets],
    )
    if at is None or count < 2 or not are_numbers(*teeth) or any(z < 3 for z in teeth):
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
    """Defaults of `[contact.sprocket]`."""
    contact, pitch, size = node_value(values, "contact"), _chain_pitch(chain), _catalogue_row(chain)
    given = node_value(contact, "sprocket")
    if pitch is None or not isinstance(contact, Mapping | None) or not isinstance(given, Mapping | None):
        return
    place: Path = ("contact", "sprocket")
    strands = 1 if size is None else size.strands
    if node_value(given, "restitution") is None:
        for key in ("restitution", "restitution_means"):
            if node_value(given, key) is None:
                yield (*place, key), LAW[key]
    if node_value(given, "impact_speed_floor") is None:
        yield (*place, "impact_speed_floor"), LAW["impact_speed_floor"]
    if node_value(given, "clearance") is None and node_value(given, "profile") in (None, "circular"):
        silent = "silent" in (node_value(chain, "kind"), None if size is None else size.kind)
        yield (*place, "clearance"), 0.0 if silent else rounded_to_two_figures(CLEARANCE * pitch)
    if node_value(given, "stiffness") is None:
        inner = INNER_WIDTH * pitch if size is None else size.inner_width
        made = (TOOTH_WIDTH * inner * strands, _estimated_pull(values, size, pitch), STEEL_BODY, STEEL_BODY)
        for key, value in zip(MATERIALS, made, strict=True):
            if node_value(given, key) is None:
                yield (*place, key), value if isinstance(value, dict) else float(f"{value:.3g}")
    if given is None:
        yield (*place, "bush_stiffness"), rounded_to_two_figures(BUSH_STIFFNESS * pitch * strands)
        yield (*place, "friction"), TEETH_FRICTION


def _estimated_pull(values: Mapping[str, Any], size: CatalogueChain | None, pitch: float) -> float:
    """Estimated pull of the chain, by load or breaking load [N]."""
    pulls = []
    for sprocket in node_list(values, "sprockets"):
        torque, teeth = (
            _positive_number(node_value(node_value(sprocket, "load"), "torque"), "N m"),
            node_value(sprocket, "teeth"),
        )
        if torque is not None and are_numbers(teeth) and teeth > 2:
            pulls.append(torque * 2.0 * math.sin(math.pi / teeth) / pitch)
    breaking = 1e8 * pitch**2 if size is None else size.breaking_load
    return rounded_to_two_figures(max(pulls, default=breaking / SAFETY))


def _run_values(values: Mapping[str, Any], chain: Any, found: Mapping[Path, Any]) -> Values:
    """Defaults of `[run]`: step, sampling rate and duration."""
    run = node_value(values, "run")
    if not isinstance(run, Mapping | None):
        return
    rate = None
    for sprocket in node_list(values, "sprockets"):
        speed, teeth = (
            _positive_number(node_value(node_value(sprocket, "prescribed"), "speed"), "rad/s"),
            node_value(sprocket, "teeth"),
        )
        if rate is None and speed is not None and are_numbers(teeth) and speed * teeth > 0.0:
            rate = speed * teeth / math.tau
    if node_value(run, "step") is None:
        yield ("run", "step"), "auto"
    if node_value(run, "sample_rate") is None:
        yield ("run", "sample_rate"), SAMPLE_RATE if rate is None else rounded_to_two_figures(SAMPLES_A_TOOTH * rate)
    links = found.get(("chain", "links"), node_value(chain, "links"))
    if (
        node_value(run, "duration") is None
        and _catalogue_row(chain) is not None
        and rate is not None
        and are_numbers(links)
    ):
        yield ("run", "duration"), rounded_to_two_figures(CIRCUITS * links / rate)
