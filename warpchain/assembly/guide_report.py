"""Values of `check` on guides under the chain, arms and tensioners."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from warpchain.assembly.arm_balance import RestingArm, stop_name
from warpchain.drive.face_profile import unit_vector
from warpchain.model.oil import static_force, static_pressure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from warpchain.assembly.assembly import Assembly
    from warpchain.assembly.path import ChainPath
    from warpchain.assembly.statics import Steady
    from warpchain.model import ChainModel


def guide_touch(model: ChainModel, path: ChainPath, g: int, pull: Sequence[float]) -> dict[str, Any] | None:
    """Values of `check` on the chain's touch of guide g; None without one.

    Args:
        path: with arms where they stand.
        pull: (S,) tensions of the strands less m v^2 / p [N].
    """
    for k, string in enumerate(path.strings):
        own = [] if string is None else [touch for touch in string.touches if touch.arc.guide == g]
        if own:
            ends = [place for touch in own for place in touch.places]
            (ax, ay), (bx, by) = unit_vector(own[0].arrive), unit_vector(own[-1].leave)
            tension = max(float(pull[k]), 0.0)
            return {
                "strand": model.strand_names[k],
                "places": [min(ends), max(ends)],
                "wrap": sum(touch.wrap for touch in own),
                "load": tension / min(touch.arc.radius for touch in own),
                "force": tension * math.hypot(bx - ax, by - ay),
            }
    return None


def arm_report(model: ChainModel, assembly: Assembly, resting: Steady, running: Steady) -> list[dict[str, Any]]:
    """Values of `check` on arms: angles [rad], and their stops at work."""
    found = []
    for a, arm in enumerate(model.arms):
        angles = _values_at_states(assembly, resting, running, lambda angles, a=a: angles[a])
        last = float(assembly.arm_angle[a] if running.failure else running.arm_angle[a])
        found.append(
            {
                "name": arm.name,
                **dict(zip(("angle", "standing_angle", "working_angle"), angles, strict=True)),
                "stops": None if arm.stops is None else [math.radians(stop) for stop in arm.stops],
                "on_stop": stop_name(model, a, last),
            }
        )
    return found


def tensioner_report(model: ChainModel, assembly: Assembly, resting: Steady, running: Steady) -> list[dict[str, Any]]:
    """Values of `check` on tensioners: extensions [m], static pressures [Pa], forces [N]."""
    found = []
    for tensioner in model.tensioners:
        a = model.arm_index(tensioner.on)
        if a is None:
            s, (ux, uy) = model.tensioner_body(model.tensioners.index(tensioner)), tensioner.unit_direction
            home = model.sprockets[s].center
            places = [None if state.failure else state.center[s] - home for state in (resting, running)]
            reach = [0.0, *(None if place is None else float(place @ (ux, uy)) for place in places)]
        else:
            still = RestingArm(model, a)
            reach = _values_at_states(
                assembly,
                resting,
                running,
                lambda angles, t=tensioner, still=still, a=a: still.extension(t, float(angles[a])),
            )
        force = [None if x is None else static_force(tensioner, x) for x in reach]
        found.append(
            {
                "name": tensioner.name,
                "on": tensioner.on,
                "static_pressure": static_pressure(tensioner) if tensioner.hydraulic else None,
                **dict(zip(("extension", "standing_extension", "working_extension"), reach, strict=True)),
                **dict(zip(("force", "standing_force", "working_force"), force, strict=True)),
            }
        )
    return found


def _values_at_states(assembly: Assembly, resting: Steady, running: Steady, value: Any) -> list[float | None]:
    """Values of `check` by arm angles at assembly, rest and work; None without a steady state."""
    states = [None if state.failure else float(value(state.arm_angle)) for state in (resting, running)]
    return [float(value(assembly.arm_angle)), *states]
