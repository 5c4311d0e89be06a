"""Tensioners and arms in modes: how they stand, and tensioners' shares of a mode's stiffness and damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from warpchain.modal.matrices import Array
    from warpchain.modal.small_motion import ChainMotion

LEAST_DAMPING = 1e-9


@dataclass(frozen=True)
class PlungerMotion:
    """Motion and energy of T tensioner plungers in K modes."""

    stroke: NDArray[np.complex128]  # (K, T) complex extension [m]
    pressure: NDArray[np.complex128]  # (K, T) complex pressure of the oil [Pa]; 0 without oil
    kinetic: Array  # (K, T) share of the mode's kinetic energy
    stored: Array  # (K, T) share of x* K x in spring, oil and stops
    lost: Array  # (K, T) share of x* C x in dampers and the plunger's gap


@dataclass(frozen=True)
class TensionerElements:
    """Linear springs, dampers and oil of T standing tensioners."""

    force: Array  # (T,) with which each pushes [N]
    stiffness: Array  # (T,) of spring and stops [N/m]
    damping: Array  # (T,) [N s/m]
    on_stop: NDArray[np.bool_]  # (T,) whether the plunger stands on ratchet or chamber bottom
    oil: Array  # (T,) E A^2 / V [N/m]; 0 without oil
    gap: Array  # (T,) A^2 / G of gap and open valve [N s/m]; 0 without oil


def tensioner_elements(found: ChainMotion) -> TensionerElements:
    """Springs, dampers and oil of a chain's standing tensioners."""
    of, x = _tensioner_rows(found), found.extension
    push = of["preload"] - of["stiffness"] * x
    pressing = np.where(of["hydraulic"] == 1, push + (of["rest"] - of["ambient"]) * of["area"], push)
    with np.errstate(divide="ignore", invalid="ignore"):
        tooth = of["ratchet_pitch"] * np.floor(x / of["ratchet_pitch"]) - of["backlash"]
    depth = np.maximum(of["bottom"], np.where(of["ratchet_pitch"] > 0.0, tooth, -np.inf)) - x
    on, works = depth > 0.0, pressing > 0.0
    oil, gap = np.zeros(len(of)), np.zeros(len(of))
    places = found.at.oil_start + np.arange(len(found.at.chambers))
    oil[found.at.chambers] = found.stiffness.diagonal()[places]
    gap[found.at.chambers] = found.damping.diagonal()[places]
    return TensionerElements(
        force=np.maximum(pressing, 0.0) + np.where(on, of["stop_stiffness"] * depth, 0.0),
        stiffness=np.where(works, of["stiffness"], 0.0) + np.where(on, of["stop_stiffness"], 0.0),
        damping=np.where(works, of["damping"], 0.0) + np.where(on, of["stop_damping"], 0.0),
        on_stop=on,
        oil=oil,
        gap=gap,
    )


def plunger_motion(found: ChainMotion, vector: NDArray[np.complex128], stiff: Array, drag: Array) -> PlungerMotion:
    """Motion and energy of a chain's plungers in modes.

    Args:
        stiff, drag: (K,) x* K x, x* C x of the drive.
    """
    at, of, linear = found.at, _tensioner_rows(found), tensioner_elements(found)
    stroke = (at.strokes @ vector).T
    leaked = np.zeros_like(stroke)
    leaked[:, at.chambers] = vector[at.oil_start :].T
    area = np.where(of["hydraulic"] == 1, of["area"], 1.0)
    stored = linear.stiffness * np.abs(stroke) ** 2 + linear.oil * np.abs(stroke + leaked) ** 2
    through = linear.gap * (leaked - of["drag"] / area * stroke)
    lost = linear.damping * np.abs(stroke) ** 2 + (leaked.conj() * through).real
    _, bodies = at.roller_and_body_parts(vector.T)
    kinetic = np.zeros(stroke.shape)
    for t, tensioner in enumerate(found.model.tensioners):
        x, y, angle = np.abs(bodies[:, found.model.tensioner_body(t)].T) ** 2
        on_arm = found.model.tensioner_body(t) >= found.model.first_arm_body
        square = x + y + (found.model.tensioner_lever(t) ** 2 * angle if on_arm else 0.0)
        kinetic[:, t] = tensioner.plunger_mass * square
    stiff, drag = stiff[:, None], drag[:, None]
    return PlungerMotion(
        stroke=stroke,
        pressure=-linear.oil / area * (stroke + leaked),
        kinetic=kinetic,
        stored=stored / stiff,
        lost=np.where(drag > LEAST_DAMPING * np.sqrt(np.abs(stiff)), lost / np.where(drag == 0.0, 1.0, drag), 0.0),
    )


def _tensioner_rows(found: ChainMotion) -> Any:
    """Packed rows of a chain's tensioners."""
    return found.packed.tensioners[: len(found.model.tensioners)]


def standing_lines(found: ChainMotion) -> tuple[str, ...]:
    """Lines of text on how arms and tensioners stand."""
    model, said = found.model, []
    for a, arm in enumerate(model.arms):
        angles, row, carrier = found.state.bodies[0, model.first_arm_body :, 2], found.packed.arms[a], model.parent(a)
        angle = angles[a] - (0.0 if carrier is None else angles[carrier])
        where = "lower" if angle < row["low"] else "upper" if angle > row["high"] else ""
        on = f", on its {where} stop, whose stiffness holds it" if where else ""
        said.append(f"{arm.name} stands at {np.degrees(angle):.3g} degrees{on}")
    linear, of = tensioner_elements(found), _tensioner_rows(found)
    for t, tensioner in enumerate(model.tensioners):
        line = f"{tensioner.name} stands at {1e3 * found.extension[t]:.3g} mm and pushes with {linear.force[t]:.4g} N"
        if linear.force[t] == 0.0:
            line = (
                f"{tensioner.name} has come out too far to push ({1e3 * found.extension[t]:.3g} mm): it takes no part"
            )
        if linear.on_stop[t]:
            line += ", on a stop"
        if linear.oil[t] > 0.0:
            rate = linear.oil[t] / linear.gap[t] / (2.0 * np.pi)
            line += (
                f"; oil at {1e-5 * of['rest'][t]:.3g} bar, check valve {found.valve}: {linear.oil[t]:.3g} N/m in "
                f"series with {linear.gap[t]:.3g} N s/m, a spring above {rate:.3g} Hz and a damper below"
            )
        said.append(line)
    return tuple(said)
