"""Force probe: forces of a drive in given states, as accelerations of perturbed copies, by the CPU kernel.

A copy takes one leapfrog step of 2^21 s, so that nothing is rounded: a = (v' - v) / (h / 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.cpu import CpuEngine
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.kernels.integrate import INTEGRATORS
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.structs import GROUND

Array = NDArray[np.float64]

PROBE_STEP = 2.0**21
COPIES = 32
"""Copies of one launch of a force probe."""


@dataclass
class ProbeStates:
    """States of a drive's copies in a force probe."""

    position: Array  # (copies, N, 2) of the rollers [m]
    velocity: Array  # (copies, N, 2) of the rollers [m/s]
    bodies: Array  # (copies, B, 3) centers and angles (x, y, theta) [m], [rad]
    rates: Array  # (copies, B, 3) [m/s], [rad/s]
    oil: Array  # (copies, T) log mass of oil in tensioners (`physics.tensioner`, (6))


@dataclass(frozen=True)
class BodyFreedom:
    """Free directions and inertia of a body in a force probe."""

    free: Array  # (3, k) free directions of (x, y, theta), as columns
    inertia: Array  # (3, 3) mass matrix in (x, y, theta)

    def without_turning(self) -> BodyFreedom:
        """Freedom of a body whose turning another body has."""
        return BodyFreedom(self.free[:, ~self.free[2].astype(bool)], self.inertia)


class ForceProbe:
    """Force probe of a drive's rollers and bodies in given states.

    `packed` is one variant at rest, in float64, `workers` CPU threads.
    """

    def __init__(self, packed: PackedEnsemble, workers: int = 1) -> None:
        base = packed.copy()
        row = base.drives[0]
        row["integrator"], row["step"], row["steps"] = INTEGRATORS["leapfrog"], PROBE_STEP, 2
        row["window_start"], row["window_end"], row["frame_interval"] = 3, 3, 0
        base.remove_lag()
        self.base = base
        self.rollers = int(base.drives["rollers"][0])
        self.sprockets = int(base.drives["sprockets"][0])
        self.body_count = int(base.drives["bodies"][0])
        self.tensioners = int(base.drives["tensioners"][0])
        self._engine = CpuEngine(base.pick_variants([0] * COPIES), workers)
        self._frames = self._engine.frame_buffer(1)
        self._rollers = self._engine.state.rollers.numpy().reshape(COPIES, STATE_ROWS, self.rollers)
        self._bodies = self._engine.state.bodies.numpy()[: COPIES * self.body_count].reshape(COPIES, self.body_count)
        oil, pushes = self._engine.state.tensioners.numpy(), self._engine.state.pushes.numpy()
        self._oil = oil[: COPIES * self.tensioners].reshape(COPIES, self.tensioners)
        self._pushes = pushes[: COPIES * self.tensioners].reshape(COPIES, self.tensioners)
        self._progress = self._engine.state.progress.numpy()
        self._seat = self._engine.state.seat.numpy()
        self._impact_speed = self._engine.state.impact_speed.numpy()
        self._start_seat = self._seat.copy()
        first, arms = self.body_count - int(base.drives["arms"][0]), base.arms
        on_arms = [(b, first + int(arm["on"]) - 1, arm["lever"]) for b, arm in enumerate(arms, first) if arm["on"]]
        hubs = [(s, int(hub["arm"]), hub["lever"]) for s, hub in enumerate(base.hubs[: self.sprockets])]
        self._carried = on_arms + [of for of in hubs if of[1] != GROUND]

    def packed_state(self) -> ProbeStates:
        """State at rest of a force probe, as one copy."""
        rows, bodies = self.base.roller_rows(0), self.base.bodies
        place = np.column_stack([bodies["center"], bodies["angle"]])
        position = np.ascontiguousarray(rows[0:2].T)
        oil = self.base.oil["content"][: self.tensioners]
        return ProbeStates(
            position[None], np.zeros_like(position)[None], place[None], np.zeros_like(place)[None], oil[None]
        )

    def body_freedom(self, b: int, angle: float) -> BodyFreedom:
        """Free directions and inertia of body b at an angle [rad]."""
        motion, mount = self.base.motions[b], self.base.mounts[b]
        turns = np.zeros((3, 0)) if motion["prescribed"] else np.array([[0.0], [0.0], [1.0]])
        if not mount["active"]:
            inverse = float(motion["inverse_inertia"])
            return BodyFreedom(turns, np.diag([0.0, 0.0, 1.0 / inverse + self._valve_inertia(b) if inverse else 0.0]))
        share, along = np.linalg.eigh(mount["inverse_mass"])
        slides = np.zeros((3, int((share > 0.0).sum())))
        slides[:2] = along[:, share > 0.0]
        if slides.shape[1] == 2:
            slides = np.eye(3)[:, :2]
        w, (c, s) = mount["wheel"], (np.cos(angle), np.sin(angle))
        q = np.array([-(w[0] * s + w[1] * c), w[0] * c - w[1] * s])
        inertia = np.diag([mount["mass"], mount["mass"], mount["inertia"]])
        inertia[:2, 2] = inertia[2, :2] = q
        return BodyFreedom(np.hstack([slides, turns]), inertia)

    def arm_joints(self, angles: Array) -> list[tuple[int, int, float]]:
        """Arms on arms: bodies, carriers and d.s [kg m^2]."""
        found, first = [], self.body_count - int(self.base.drives["arms"][0])
        for b, arm in enumerate(self.base.arms[: self.body_count - first], first):
            if arm["on"]:
                on = first + int(arm["on"]) - 1
                (dx, dy), (sx, sy) = arm["lever"], arm["mass_moment"]
                c, s = np.cos(angles[b] - angles[on]), np.sin(angles[b] - angles[on])
                found.append((b, on, float(dx * (c * sx - s * sy) + dy * (s * sx + c * sy))))
        return found

    @cached_property
    def _cam_states(self) -> NDArray[Any]:
        """Inertia and moment of valves on the probe's bodies."""
        self._evaluate(self.packed_state())
        return np.array(self._engine.state.cams.numpy()[: self.body_count])

    def _valve_inertia(self, b: int) -> float:
        """Inertia of valves [kg m^2] on body b with its train."""
        if not self.base.drives["valves"][0]:
            return 0.0
        motions, cams = self.base.motions[: self.body_count], self._cam_states
        train = motions["train"] == motions["train"][b]
        if motions["train"][b] < 0:  # turns alone
            return float(cams["inertia"][b])
        return float(((motions["ratio"][train] / motions["ratio"][b]) ** 2 * cams["inertia"][train]).sum())

    def train_angles(self, b: int) -> Array:
        """Angles (B,), normalized, of the bodies of body b's train."""
        motions = self.base.motions[: self.body_count]
        if not self.base.drives["tied"][0] or motions["train"][b] < 0:
            return np.ones(1)
        if motions["train"][b] != b:
            return np.ones(0)
        ratios = np.where(motions["train"] == b, motions["ratio"], 0.0)
        return np.ones(1) if np.count_nonzero(ratios) == 1 else np.asarray(ratios / np.linalg.norm(ratios))

    def __call__(self, states: ProbeStates) -> tuple[Array, Array, Array]:
        """Accelerations of rollers (copies, N, 2), bodies (copies, B, 3), and pressures (copies, T) [Pa].

        NaN for a copy outside the drive's box.
        """
        count = len(states.position)
        straight, turned = np.empty_like(states.position), np.empty_like(states.bodies)
        pressure = np.empty_like(states.oil)
        for first in range(0, count, COPIES):
            part = slice(first, min(first + COPIES, count))
            some = ProbeStates(**{name: value[part] for name, value in vars(states).items()})
            straight[part], turned[part], pressure[part] = self._evaluate(some)
        return straight, turned, pressure

    def _evaluate(self, states: ProbeStates) -> tuple[Array, Array, Array]:
        """Accelerations and pressures of at most `COPIES` states."""
        count = len(states.position)
        rows, bodies = self._rollers[:count], self._bodies[:count]
        rows[:, 0:2], rows[:, 2:4], rows[:, 4:6] = states.position.mT, states.velocity.mT, 0.0
        bodies["center"], bodies["angle"] = states.bodies[..., :2], states.bodies[..., 2]
        bodies["velocity"], bodies["speed"] = states.rates[..., :2], states.rates[..., 2]
        for b, on, (x, y) in self._carried:  # where its arm has it, which accelerates it too
            arm = bodies[:, on]
            cosine, sine = np.cos(arm["angle"]), np.sin(arm["angle"])
            lever = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
            turning = arm["speed"][:, None] * np.stack([-lever[:, 1], lever[:, 0]], axis=-1)
            bodies["center"][:, b], bodies["velocity"][:, b] = arm["center"] + lever, arm["velocity"] + turning
        self._oil[:] = self.base.oil[: self.tensioners]
        self._oil["content"][:count], self._oil["root"] = states.oil, 0.0
        self._seat[:], self._impact_speed[:] = self._start_seat, 0.0
        self._progress["step"], self._progress["diverged"] = 0, 0
        self._progress["diverged"][count:] = 1
        for future in self._engine.advance(1, self._frames):
            future.result()
        kick = 0.5 * PROBE_STEP
        straight = (rows[:, 2:4].mT - states.velocity) / kick
        after = np.concatenate([bodies["velocity"], bodies["speed"][..., None]], axis=-1)
        turned = (after - states.rates) / kick
        gone = self._progress["diverged"][:count] == 1
        straight[gone], turned[gone] = np.nan, np.nan
        return straight, turned, self._pushes["pressure"][:count]

    def touching_rollers(self, states: ProbeStates) -> NDArray[np.bool_]:
        """Whether rollers touch sprockets and guides (S + G, N) in probed states."""
        self._evaluate(ProbeStates(**{name: value[:1] for name, value in vars(states).items()}))
        points, guides = (int(self.base.drives[key][0]) for key in ("points", "guides"))
        rows = self.sprockets * points + guides
        touches = self._impact_speed[: rows * self.rollers].reshape(rows, self.rollers) > 0.0
        teeth = touches[: self.sprockets * points].reshape(self.sprockets, points, self.rollers)
        on_guides = touches[self.sprockets * points :].reshape(1 + (points > 1), -1, self.rollers)  # backs, then pins
        return np.concatenate([teeth.any(axis=1), on_guides.any(axis=0)])

    def close(self) -> None:
        """Ends the force probe's threads."""
        self._engine.close()
