"""Settling: brings assembled chains to static equilibrium, all sprockets held, before the first step.

Always in float64, by the kernel `relax`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly
from warpchain.assembly.bounds import escape_distance
from warpchain.assembly.timestep import highest_frequency, moving_bodies, step_limit
from warpchain.drive import Drive
from warpchain.drive.stack_math import maximum, power, table_of_columns, where
from warpchain.engine.devices import make_engine
from warpchain.engine.pack import rest_tensioners, tensioners_as_springs
from warpchain.engine.packed_ensemble import (
    PackedEnsemble,
    consecutive_places,
    gather_values,
    roller_coordinates,
    scatter_values,
)
from warpchain.engine.struct_rows import FORCE_NUMBERS, widen_box
from warpchain.kernels import relaxation
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.relaxation import LEAST_STRETCH
from warpchain.model import ChainModel, single_chain
from warpchain.model.stacks import Stack, stacks_of_drives

SETTLE_LIMIT = 100_000
"""Most steps of settling a variant."""

SETTLE_TOLERANCE = 1.0e-3
"""Residual of settling over the largest link force."""

SETTLE_DAMPING = 0.1
"""Link damping while settling, of sqrt(k m)."""

SETTLE_STEP = 0.7
"""Step of settling over the stability limit."""


def settling_ensemble(packed: PackedEnsemble) -> PackedEnsemble:
    """Packed ensemble to settle: at rest, held, damped, frictionless.

    Guides push rollers out through the face.
    """
    still = packed.copy()
    for name in ("tooth_friction", "guide_friction"):
        setattr(still, name, np.zeros_like(getattr(still, name)))
    still.hubs["bearing"] = 0.0
    still.tensioners = tensioners_as_springs(packed.tensioners)
    for of in ("", "outer_"):
        stiffness = still.chains[f"{of}stiffness"]
        still.chains[f"{of}damping"] = SETTLE_DAMPING * np.sqrt(stiffness * still.chains["mass"])
    for law in (still.sprockets["law"], still.guides["law"]):
        law["damping"] = 0.0
    still.remove_lag()
    still.guides["deepest_entry"] = np.inf
    still.arms["damping"], still.arms["stop_damping"] = 0.0, 0.0
    led = (still.mounts["x_table"]["cells"] > 0) | (still.mounts["y_table"]["cells"] > 0)
    still.mounts[led] = np.zeros((), still.mounts.dtype)  # which stay as drawn
    still.bodies["speed"], still.bodies["velocity"] = 0.0, 0.0
    for _, first, count in packed.groups_by_rollers():
        scatter_values(still.rollers, STATE_ROWS * first + 2 * count, np.zeros(2 * count))
    return still


def damp_arm_contacts(still: PackedEnsemble) -> None:
    """Damps contacts of drives with arms, for settling."""
    models = still.drives
    damping = SETTLE_DAMPING * np.sqrt(still.chains["stiffness"] * still.chains["mass"])
    for laws, count in ((still.sprockets["law"], "sprockets"), (still.guides["law"], "guides")):
        owner = np.repeat(np.arange(still.variants), models[count])
        armed = np.flatnonzero(models["arms"][owner] > 0)
        laws["form"][armed] = FORCE_NUMBERS["kelvin_voigt_damper"]
        laws["damping"][armed] = damping[owner[armed]]


def lighten_arms(packed: PackedEnsemble, stacks: Sequence[Stack[ChainModel]]) -> None:
    """Reduces arms' inertias for settling, as its step allows."""
    for stack in stacks:
        model, count = stack.one, len(stack.one.arms)
        if count:
            squares = [body.square for body in moving_bodies(model, held=True)]
            other = power(highest_frequency(model, damped_links=False, held=True), 2) - maximum(*squares)
            lighter = [where(of > 0.0, 0.5 * other / where(of > 0.0, of, 1.0), 1.0) for of in squares[-count:]]
            arms = consecutive_places(packed.drives["first_body"][stack.members] + model.first_arm_body, count)
            packed.motions["inverse_inertia"][arms] *= np.maximum(table_of_columns(lighter, len(arms)), 1.0)


def settle_variants(
    packed: PackedEnsemble,
    chains: Sequence[Drive | ChainModel],
    device: str,
    cores: int,
    steps: int,
    run: Callable[[list[Future[None]], Callable[[], tuple[float, float]]], bool],
    stacks: Sequence[Stack[ChainModel]] | None = None,
) -> NDArray[Any]:
    """Settles variants in a packed ensemble; returns `Settling` (variants,).

    Args:
        chains: drives of one chain, or models of chains.
        steps: of one launch.
        run: waits for launches, given a function that reports (done, total); False ends it.
    """
    wanted = np.array([of.run.settle for of in chains])
    state = np.zeros(packed.variants, dtype=relaxation.Settling.numpy_dtype())
    stacks = stacks_of_drives([single_chain(of) for of in chains]) if stacks is None else stacks
    for stack in stacks:
        state["step"][stack.members] = SETTLE_STEP * step_limit(stack.one, held=True)
    state["tolerance"] = SETTLE_TOLERANCE
    state["limit"] = np.where(wanted, SETTLE_LIMIT, 0)
    if not wanted.any():
        return state
    still = settling_ensemble(packed)
    damp_arm_contacts(still)
    lighten_arms(still, stacks)
    engine = make_engine(device, still, cores)

    def done() -> tuple[float, float]:
        """Number of drives settled so far, and of all."""
        now = engine.settling_states()
        return float(np.where(now["settled"], 1.0, now["steps"] / SETTLE_LIMIT)[wanted].sum()), float(wanted.sum())

    try:
        engine.start_settling(state)
        now, going = state, run([], done)
        while going:
            going = run(engine.settle(steps), done)
            now = engine.settling_states()
            going = going and bool(((now["settled"] == 0) & (now["steps"] < now["limit"])).any())
        moved, bodies = engine.rollers(), engine.bodies()
    finally:
        engine.close()
    for part, assembly in packed.assemblies.parts_of_stacks(stacks):
        if part.one.run.settle:
            _move_to_settled(packed, part, assembly, moved, bodies)
    rest_tensioners(packed)
    return now


def _move_to_settled(
    packed: PackedEnsemble,
    part: Stack[ChainModel],
    assembly: Assembly,
    moved: NDArray[np.floating],
    bodies: NDArray[Any],
) -> None:
    """Moves rollers, arms and boxes to where they settled."""
    model, rows = part.one, packed.drives[part.members]
    links = model.chain.rollers
    first = STATE_ROWS * rows["first_roller"].astype(np.int64)
    here = gather_values(moved, first, 2 * links)
    scatter_values(packed.rollers, first, here)
    arms = consecutive_places(rows["first_body"] + model.first_arm_body, len(model.arms))
    packed.bodies["angle"][arms] = bodies["angle"][arms]
    packed.bodies["center"][arms] = bodies["center"][arms]
    for s in range(len(model.sprockets)):
        if model.carrier(s) is not None:
            packed.bodies["center"][rows["first_body"] + s] = bodies["center"][rows["first_body"] + s]
    widen_box(rows, here.reshape(-1, 2, links), escape_distance(model, assembly)[..., None])
    for name in ("low", "high"):
        packed.drives[name][part.members] = rows[name]


def largest_net_forces(packed: PackedEnsemble, residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest net force (V,) [N] on a roller after settling to `residual` (V,)."""
    largest = np.zeros(packed.variants)
    for alike, first, count in packed.groups_by_rollers():
        x, y = roller_coordinates(packed.rollers, first, count)
        span = np.hypot(np.roll(x, -1, axis=1) - x, np.roll(y, -1, axis=1) - y)
        span -= gather_values(packed.lengths, first, count)
        span[np.arange(count) + 1 == packed.chains["absent"][alike, None]] = 0.0
        largest[alike] = packed.chains["stiffness"][alike] * np.abs(span).max(axis=1)
    weight = packed.chains["mass"] * np.hypot(*packed.chains["gravity"].T)
    least = float(LEAST_STRETCH) * packed.chains["stiffness"]
    return residual * np.maximum(np.maximum(largest, weight), least)
