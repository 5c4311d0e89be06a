r"""A drive that stands under its loads: static equilibrium of its chain and of all bodies that are free.

First the chain settles with all bodies held, as before a run; then free bodies are let go, and both relax: they move
from rest, links damped as in settling and contacts without dissipation, and whenever the kinetic energy has passed a
peak, everything stops and begins anew from there.

A chain that runs steadily along a path of its own passes f = v / p rollers a second, and its rollers are accelerated by
f^2 (r_{i+1} - 2 r_i + r_{i-1}), to second order in the pitch. That is what links of no length and of stiffness -m f^2
would do beside the chain's own, so a running chain stands as one of

    k' = k - m f^2,    l' = l k / k'                                                                  (a)

does at rest: its strands keep their tension, of which m f^2 p bends it around the sprockets.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.statics import load_moments
from warpchain.assembly.timestep import step_limit
from warpchain.drive import Drive
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.engine.settling import SETTLE_STEP, elastic, settle
from warpchain.errors import SimulationError
from warpchain.kernels import structs
from warpchain.kernels.integrate import INTEGRATORS
from warpchain.results.schedule import Schedule

TOLERANCE, ENOUGH = 1e-6, 1e-4
"""Largest net force on a roller, and on a body at its rim, over the largest link force: wanted, and taken at the limit
of steps."""
SPELL, IRREGULAR = 8, 17
"""Steps between two looks at the kinetic energy, and up to how many more: no fast motion may come back in step with
the looks, to be stopped where it began."""
SPELLS = 20_000
"""Most of them."""
GRAVITY = 9.81


def passing_rate(drive: Drive, speed: float) -> float:
    """Rollers that pass a point in a second, the tooth frequency [Hz], at the driver's angular speed [rad/s]."""
    return speed * drive.sprockets[drive.driver].teeth / (2.0 * np.pi)


def standing(drive: Drive, speed: float = 0.0) -> Packed:
    """A drive in static equilibrium under the means of its loads, in float64; nothing in it hangs on time any more.

    Args:
        speed: of the driver [rad/s], at which loads are taken and by which the chain's steady running counts.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast to stay on its sprockets; one line.
    """
    return released(beginning(drive, speed), drive)


def beginning(drive: Drive, speed: float = 0.0, start: Packed | None = None) -> Packed:
    """A drive as `standing`, but not yet in equilibrium: settled with all bodies held, or as it stands in `start`.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a chain too fast to stay on its sprockets.
    """
    packed = pack([drive], [Schedule(1.0, 1, 2, 2, 0)])
    if start is None:
        _settle(packed, drive)
    else:
        packed = packed.with_arrays(bodies=start.bodies, rollers=start.rollers, seat=start.seat)
    still = _stopped(packed, drive, speed)
    own, slack = link_stiffness(still), float(still.chains["mass"][0]) * passing_rate(drive, speed) ** 2
    if (slack >= 0.1 * own).any():
        raise SimulationError(f"speed = {speed:g}: at this speed the chain would lengthen by a tenth")
    still.lengths = still.lengths * (own / (own - slack))
    still.links["play"] *= float((own / (own - slack)).mean())
    still.chains["stiffness"] -= slack
    still.links["outer_stiffness"] -= np.where(still.links["varied_links"] == 1, slack, 0.0)
    return still


def link_stiffness(packed: Packed) -> NDArray[np.float64]:
    """(N,) of each link of one variant [N/m]: outer links, which may differ, have an even index."""
    stiffness = np.full(len(packed.lengths), float(packed.chains["stiffness"][0]))
    if packed.links["varied_links"][0]:
        stiffness[0::2] = packed.links["outer_stiffness"][0]
    return stiffness


def link_tension(packed: Packed, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) elastic force of each link of one variant [N], its rollers at (N, 2)."""
    stretch = np.hypot(*(np.roll(position, -1, axis=0) - position).T) - packed.lengths
    play = float(packed.links["play"][0])
    return np.asarray(link_stiffness(packed) * (stretch - np.clip(stretch, -play, play)))


def _settle(packed: Packed, drive: Drive) -> None:
    """Settles the chain with all bodies held, as before a run."""

    def run(futures: list[Future[None]], _: Callable[[], tuple[float, float]]) -> bool:
        for future in futures:
            future.result()
        return True

    settle(packed, [drive.with_values({"run.settle": True})], ("cpu",), 1, 2000, run)


def _stopped(packed: Packed, drive: Drive, speed: float) -> Packed:
    """A packed drive at rest, without what hangs on time: prescribed motions stand, loads have their mean,
    and nothing rubs."""
    still = packed.copy()
    for name in ("joints", "tooth_sliding", "guide_sliding"):
        setattr(still, name, np.zeros_like(getattr(still, name)))
    still.rows(0)[2:] = 0.0
    still.guides["deepest_entry"] = np.inf
    still.bodies["speed"], still.bodies["velocity"] = 0.0, 0.0
    still.mounts["amplitude"], still.mounts["frequency"] = 0.0, 0.0
    nothing = np.zeros((), dtype=structs.Harmonics.numpy_dtype())
    for motion in still.motions:
        motion["speed"], motion["ramp_time"], motion["load_ramp_time"] = 0.0, 0.0, 0.0
        motion["drive_harmonics"] = motion["load_harmonics"] = nothing
        motion["drive_table"]["cells"] = motion["load_table"]["cells"] = 0
    moments = load_moments(drive, speed)
    for s, sprocket in enumerate(drive.sprockets):
        if sprocket.prescribed is None and sprocket.load is not None:
            turning = speed * drive.sprockets[drive.driver].teeth / sprocket.teeth
            load = sprocket.load
            still.motions[s]["load"] = (moments[s], load.viscous + 2.0 * load.quadratic * turning, 0.0)
    return still


class _Relaxing:
    """One variant that moves from rest, and stops on request."""

    def __init__(self, packed: Packed, step: float) -> None:
        soft = elastic(packed)
        soft.mounts["damping"], soft.motions["load"][:, 1:] = 0.0, 0.0
        row = soft.drives[0]
        row["integrator"], row["step"], row["steps"], row["sample_every"] = INTEGRATORS["leapfrog"], step, 2**30, 0
        row["window_start"] = row["window_end"] = 2**30
        self.packed, self.step = packed, step
        self.engine = CpuEngine(soft, 1)
        state = self.engine.state
        self.rows = state.rollers.numpy().reshape(6, -1)
        self.bodies, self.progress, self.seat = state.bodies.numpy(), state.progress.numpy(), state.seat.numpy()
        self._frames = self.engine.frame_buffer(1)
        self.mass = float(packed.chains["mass"][0])
        motions, mounts, inertia = packed.motions, packed.mounts, np.zeros(len(packed.bodies))
        free = motions["prescribed"] == 0
        plain = free & (mounts["active"] == 0) & (motions["inverse_inertia"] > 0.0)
        mounted = free & (mounts["active"] == 1)
        inertia[plain], inertia[mounted] = 1.0 / motions["inverse_inertia"][plain], mounts["inertia"][mounted]
        arms = int(row["arms"])
        self.inertia = inertia
        self.moving = np.where(mounts["inverse_mass"].any(axis=(1, 2)), mounts["mass"], 0.0)
        self.radius = np.full(len(packed.bodies), np.inf)
        self.radius[: len(packed.sprockets)] = packed.sprockets["exact_radius"]
        self.radius[len(inertia) - arms :] = packed.arms["reach"][:arms]

    def run(self, steps: int) -> None:
        for future in self.engine.advance(steps, self._frames):
            future.result()

    def stop(self) -> None:
        self.rows[2:4], self.bodies["speed"], self.bodies["velocity"] = 0.0, 0.0, 0.0
        self.progress["step"] = 0

    def energy(self) -> float:
        """Twice the kinetic energy [J]."""
        turning = (self.inertia * self.bodies["speed"] ** 2).sum()
        straight = (self.moving[:, None] * self.bodies["velocity"] ** 2).sum()
        return float(self.mass * (self.rows[2:4] ** 2).sum() + turning + straight)

    def residual(self) -> float:
        """Largest net force over the largest link force, of the state, which is at rest and stays; infinite outside the
        drive's box."""
        place, held = self.rows[0:2].copy(), self.bodies.copy()
        self.run(1)
        kick = 0.5 * self.step
        net = max(
            self.mass * float(np.hypot(*self.rows[2:4]).max()),
            float((self.inertia * np.abs(self.bodies["speed"]) / self.radius).max()),
            float((self.moving * np.hypot(*self.bodies["velocity"].T)).max()),
        )
        if self.progress["diverged"][0]:
            return float("inf")
        self.rows[0:2], self.bodies[:] = place, held
        self.stop()
        pull = float(np.abs(link_tension(self.packed, place.T)).max())
        return net / kick / max(pull, self.mass * GRAVITY)

    def state(self) -> Packed:
        """The variant where it stands."""
        still = self.packed.copy()
        still.bodies[:], still.seat[:] = self.bodies, self.seat
        still.rows(0)[0:2] = self.rows[0:2]
        return still


def released(packed: Packed, drive: Drive) -> Packed:
    """A variant at rest, relaxed with its free bodies let go.

    Raises:
        SimulationError: a drive that does not settle; one line.
    """
    relaxing = _Relaxing(packed, SETTLE_STEP * step_limit(drive))
    try:
        before, residual = 0.0, relaxing.residual()
        for spell in range(SPELLS):
            if residual < TOLERANCE:
                return relaxing.state()
            relaxing.run(SPELL + 7 * spell % IRREGULAR)
            if relaxing.progress["diverged"][0]:
                residual = np.inf
                break
            now = relaxing.energy()
            if now < before:
                relaxing.stop()
                residual, now = relaxing.residual(), 0.0
            before = now
        if residual < ENOUGH:
            return relaxing.state()
    finally:
        relaxing.engine.close()
    if not np.isfinite(residual):
        raise SimulationError("the drive does not settle under its loads: the chain leaves its sprockets")
    steps = (SPELL + IRREGULAR // 2) * SPELLS
    raise SimulationError(
        f"the drive does not settle under its loads: after {steps} steps the largest net force is still "
        f"{residual:.1e} of the largest link force (wanted {ENOUGH:g})"
    )
