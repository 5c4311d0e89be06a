"""Statics of a drive in steady motion: equilibrium of rollers, sprockets and moving centers.

Means over a tooth pitch without vibration and friction; each state minimizes the energy of `potential` by Newton's
method with a shift of the Hessian (Levenberg, Marquardt).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly, assemble_chain
from warpchain.assembly.potential import EnergyTerms, Map, Potential, stacked_terms
from warpchain.assembly.strand_load import goods_on_pins
from warpchain.assembly.table_cells import shaft_ratio, table_cells
from warpchain.drive.body_ties import body_names, rigid_ratios
from warpchain.drive.schema import HUGE
from warpchain.drive.sprocket import ElasticMount, SliderMount
from warpchain.errors import SimulationError
from warpchain.model.mounts import unit_direction
from warpchain.model.parts_between_chains import LedSprocket, SprocketShaft
from warpchain.model.trains import body_speed_ratio, free_body_loads, is_free_body, is_held_body, turns_per_roller

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from warpchain.model import ChainModel

Array = NDArray[np.float64]

PHASES = 4
"""States within a tooth pitch over which statics averages."""

MOST = 2000
"""Most links of a chain whose steady state is sought; that takes 20 s."""

_SOFTER = (0.01, 0.1)
"""Relative contact stiffnesses of first guesses, for tight or hard pockets."""

_ITERATIONS = 400
_ACCURACY = 1e-4  # of the largest force at work: what is left on any coordinate
_ENOUGH = 1e-6  # of it, where a search ends
_FINEST = 1e-11  # of it, for small motion about the state
_SAME = 1e-6  # relative: speeds of prescribed sprockets that count as one
_ON = 0.02  # of a pitch off the pitch circle: a roller that turns with the sprocket
_FARTHEST = 0.1  # of a pitch: the longest step, well within a tooth gap
_GROWTH, _DECAY = 4.0, 0.15  # of the shift, after a step that is refused or taken


@dataclass(frozen=True)
class Steady:
    """Steady state of a drive of S sprockets: means over a tooth pitch.

    Attributes:
        tension: (S,) of strand k's links, centrifugal part included [N].
        centrifugal: m v^2 / p [N].
        displacement: (S,) at mid-strand from the nominal line, left of its travel positive [m].
        center: (S, 2) sprockets [m].
        arm_angle: (A,) [rad].
        twist, torque: (C,) of couplings [rad], and on them from their first bodies [N m].
        failure: why no equilibrium was found, which voids the rest; else None.
        residual: largest force that is left over the largest that acts [-].
    """

    tension: Array
    centrifugal: float
    displacement: Array
    center: Array
    arm_angle: Array
    twist: Array
    torque: Array
    failure: str | None
    residual: float


def load_moments(model: ChainModel, speed: float | Array) -> Array:
    """Mean load moments against forward rotation, less further motors' (S + H, ...) [N m].

    At the driver's speed (...) [rad/s]; 0 on prescribed bodies.
    """
    found = np.zeros((len(model.sprockets) + len(model.shafts), *np.shape(speed)))
    for b, load in free_body_loads(model):
        own: Any = speed * body_speed_ratio(model, b, model.driver)
        if b < len(model.sprockets):
            own = speed * model.sprockets[model.driver].teeth / model.sprockets[b].teeth
        found[b] = load.steady_moment(own)
        if load.table is not None:
            cells = table_cells(load.table, shaft_ratio(model, b, load.table.shaft))
            found[b] += (cells.integral[-1] - cells.integral[0]) / (cells.spacing * len(cells.coefficients))
    for b, shaft in enumerate(model.shafts, len(model.sprockets)):
        if shaft.motor is not None and is_free_body(model, b):
            found[b] -= shaft.motor.at(speed * body_speed_ratio(model, b, model.driver))
    return found


def at_work(
    model: ChainModel, assembly: Assembly | None = None, speed: float | None = None, moments: Array | None = None
) -> Steady:
    """Steady state at work under load, of an open chain at rest.

    Args:
        assembly: its own, if known.
        speed: of the driver, else its top speed [rad/s].
        moments: (S + H,) against forward rotation, else `load_moments` [N m].

    Raises:
        DriveError: a chain that does not fit.
    """
    driver, top = model.sprockets[model.driver], 0.0 if model.chain.is_open else model.driver_speed
    frequency = top * driver.teeth / math.tau
    assembly = assembly or assemble_chain(model)
    for sprocket in () if model.chain.is_open else model.sprockets:
        own = frequency if sprocket.prescribed is None else sprocket.prescribed.top_speed * sprocket.teeth / math.tau
        if abs(own - frequency) > _SAME * frequency:
            words = f'"{driver.name}" and "{sprocket.name}" lead the chain at unlike speeds'
            return _unknown_state(model, assembly, frequency, words)
    speed = top if speed is None else speed
    moments = load_moments(model, speed) if moments is None else moments
    return _steady_state(model, assembly, passing_rate(model, speed), moments)


def at_rest(model: ChainModel, assembly: Assembly | None = None) -> Steady:
    """Steady state at rest without loads, couplings in mid-play.

    Raises:
        DriveError: a chain that does not fit.
    """
    assembly = assembly or assemble_chain(model)
    if any(coupling.lash for coupling in model.couplings):
        tight = tuple(coupling.model_copy(update={"lash": 0.0}) for coupling in model.couplings)
        model = replace(model, couplings=tight)
    return _steady_state(model, assembly, 0.0, np.zeros(len(model.sprockets) + len(model.shafts)))


def _unknown_state(model: ChainModel, assembly: Assembly, frequency: float, failure: str) -> Steady:
    """Steady state, NaN with the reason, where no equilibrium was found."""
    nothing = np.full(len(model.sprockets), math.nan)
    centrifugal = model.chain.mass * model.chain.pitch * frequency**2
    slack = np.full(len(model.couplings), math.nan)
    return Steady(nothing, centrifugal, nothing, nothing, assembly.arm_angle, slack, slack, failure, math.inf)


def _steady_state(model: ChainModel, assembly: Assembly, frequency: float, moments: Array) -> Steady:
    """Steady state at links a second [Hz] under moments (S + H,)."""
    if model.chain.rollers > MOST:
        return _unknown_state(model, assembly, frequency, f"not sought for a chain of more than {MOST} links")
    goods = goods_on_pins(model, assembly.path, assembly.position)
    potential = Potential(model, frequency, moments, laid=assembly.sprocket_angle, goods=goods)
    solver, x = _Solver([potential], [assembly]), _assembled_coordinates(potential, assembly)
    means: list[tuple[Array, ...]] = []
    failure = None
    for phase in range(1 if model.chain.is_open else PHASES):
        if phase:
            x, residual = solver.settle(_advanced_guess(potential, x, 1.0 / PHASES))
        else:
            x, residual = solver.settle_assembled(x)
        seen = potential.parts_of_coordinates(x)[1], potential.arm_angles(x), *potential.torques(x)
        means.append((*_strand_values(potential, assembly, x), *seen))
        failure = solver.failure(x, residual)
        if failure is not None:
            when = "at work" if frequency or moments.any() else "at rest"
            failure = f"{when} {failure}"
            break
    tension, *others = (np.asarray(np.mean(values, axis=0)) for values in zip(*means, strict=True))
    displacement, center, arm_angle, twist, torque = others
    centrifugal = potential.push * model.chain.pitch
    return Steady(tension, centrifugal, displacement, center, arm_angle, twist, torque, failure, residual)


def _assembled_coordinates(potential: Potential, assembly: Assembly) -> Array:
    """Coordinates of an assembled chain's potential."""
    arms = np.array(assembly.arm_angle)
    for a, p in potential.hung:
        arms[a] += assembly.arm_angle[p]
    angles = assembly.sprocket_angle, np.zeros(len(potential.model.shafts)), arms
    x = np.concatenate([assembly.position.ravel(), potential.home.ravel(), *angles, np.zeros(2 * len(potential.hung))])
    potential.move_carried(x)
    return x


def passing_rate(model: ChainModel, speed: float) -> float:
    """Rollers that pass a point a second at the driver's speed [Hz]."""
    return speed * model.sprockets[model.driver].teeth / math.tau


Joined = Sequence[Sequence[tuple[int, int]]]
"""Shafts shared by chains: of each its (chain, body) pairs."""


def equilibrium(
    models: Sequence[ChainModel],
    speeds: Sequence[float],
    assemblies: Sequence[Assembly],
    near: Sequence[Array] | None = None,
    shafts: Joined = (),
) -> tuple[list[Potential], list[Array]]:
    """Potentials of a drive's chains, and the coordinates that minimize their sum.

    Args:
        speeds: of the chains' drivers [rad/s].
        near: coordinates at a speed nearby.

    Raises:
        SimulationError: a chain that does not stay on its sprockets, or that comes to no rest.
    """
    potentials = []
    for model, speed, assembly in zip(models, speeds, assemblies, strict=True):
        if not abs(speed) <= HUGE:
            raise SimulationError(f"speed = {speed:g}: must be within {HUGE:g} rad/s of 0")
        moments, laid = load_moments(model, speed), assembly.sprocket_angle
        if shafts:  # the sprockets that they are have the loads
            moments[[b for b, of in enumerate(model.shafts, len(laid)) if isinstance(of, SprocketShaft)]] = 0.0
        held = _held_angles(model) if shafts else None
        goods = goods_on_pins(model, assembly.path, assembly.position)
        rate = passing_rate(model, speed)
        potentials.append(Potential(model, rate, moments, hanging=True, laid=laid, held=held, goods=goods))
        if (potentials[-1].push >= 0.1 * potentials[-1].stiffness[: model.chain.links]).any():
            raise SimulationError(f"speed = {speed:g}: at this speed the chain would lengthen by a tenth")
    solver = _Solver(potentials, assemblies, shafts)
    found, residual = (
        np.concatenate([_assembled_coordinates(*of) for of in zip(potentials, assemblies, strict=True)]),
        math.inf,
    )
    if near is not None:
        begun, residual = solver.settle(np.concatenate(near), _FINEST)
    if near is not None and residual <= _ENOUGH:
        found = begun
    else:
        found, residual = solver.settle_assembled(found)
        if residual <= _ACCURACY:
            found, residual = solver.settle(found, _FINEST)
    if math.isinf(residual):
        raise SimulationError("the drive does not settle under its loads: the chain leaves its sprockets")
    if not residual <= _ACCURACY:
        raise SimulationError(
            f"the drive does not settle under its loads: after {_ITERATIONS} steps the largest net force is still "
            f"{residual:.1e} of the largest force at work (wanted {_ACCURACY:g})"
        )
    return potentials, solver.parts_of_coordinates(found)


def _held_angles(model: ChainModel) -> list[bool]:
    """Whether angles of one of several chains are held."""
    led = any(isinstance(sprocket, LedSprocket) for sprocket in model.sprockets)
    bodies = range(len(model.sprockets) + len(model.shafts))
    return [not is_free_body(model, b) or (not led and is_held_body(model, b)) for b in bodies]


def _advanced_guess(potential: Potential, x: Array, part: float) -> Array:
    """First guess of coordinates a part of a tooth pitch later."""
    x = x.copy()
    r, centers, angles = potential.parts_of_coordinates(x)
    before = r.copy()
    r += part * (np.roll(r, -1, axis=0) - r)
    for s, sprocket in enumerate(potential.model.sprockets):
        turn = part * sprocket.sign * 2.0 * math.pi / sprocket.teeth
        angles[s] += turn
        arm = before - centers[s]
        on = np.abs(np.hypot(arm[:, 0], arm[:, 1]) - potential.radius[s]) < _ON * potential.model.chain.pitch
        cosine, sine = math.cos(turn), math.sin(turn)
        r[on] = centers[s] + arm[on] @ np.array([[cosine, sine], [-sine, cosine]])
    if potential.model.shafts:
        angles[potential.sprockets :] += (
            part * math.tau * np.array(turns_per_roller(potential.model)[potential.sprockets :])
        )
    return x


def _strand_values(potential: Potential, assembly: Assembly, x: Array) -> tuple[Array, Array]:
    """Strands' mean tensions (S,) [N], and displacements at their middles (S,) [m]."""
    r, _, _ = potential.parts_of_coordinates(x)
    tension, path = potential.tensions(x), assembly.path
    ends = np.roll(r, -1, axis=0)
    found, off = np.zeros(potential.sprockets), np.zeros(potential.sprockets)
    for k in range(potential.sprockets - potential.model.chain.is_open):
        straight = path.strings[k] is None
        length = float(path.strand_length[k] if straight else math.dist(path.strand_start[k], path.strand_end[k]))
        u = (path.strand_end[k] - path.strand_start[k]) / length
        a, b = (r - path.strand_start[k]) @ u, (ends - path.strand_start[k]) @ u
        left = np.array([-u[1], u[0]])
        ha, hb = (r - path.strand_start[k]) @ left, (ends - path.strand_start[k]) @ left
        index = (int(assembly.strand_first[k]) + np.arange(-1, int(assembly.strand_links[k]) + 2)) % potential.rollers
        index = index[index < potential.model.chain.links]  # not the absent link of an open chain
        on = index[(a[index] > 0.0) & (b[index] < length)]
        middle = index[np.argmin(np.abs(0.5 * (a + b)[index] - 0.5 * length))]
        part = (0.5 * length - a[middle]) / (b[middle] - a[middle])
        off[k] = ha[middle] + part * (hb[middle] - ha[middle])
        found[k] = tension[on if len(on) else [middle]].mean()
    return found, off


class _Solver:
    """Minimizer of the energy of a drive's chains over their free coordinates."""

    def __init__(self, parts: Sequence[Potential], assemblies: Sequence[Assembly], shafts: Joined = ()) -> None:
        self.parts, self.assemblies = parts, assemblies
        self.ends = np.cumsum([0, *(potential.size for potential in parts)]).tolist()
        self.maps, self.count = _free_coordinates_of_chains(parts, shafts)
        self.force = max(_largest_force(*of) for of in zip(parts, assemblies, strict=True))
        self.stiffest = max(4.0 * of.model.chain.stiffness + max(of.tooth_stiffness) for of in parts)
        self.pitch = min(of.model.chain.pitch for of in parts)

    def parts_of_coordinates(self, x: Array) -> list[Array]:
        """Views of each chain's coordinates in x."""
        return [x[a:b] for a, b in pairwise(self.ends)]

    def settle_assembled(self, x: Array) -> tuple[Array, float]:
        """Equilibrium from the assembled state x, chains on the teeth as laid; returns as `settle`."""
        found, residual = x, math.inf
        for softer in (_SOFTER, ()):
            found = x
            if any(of.play.any() for of in self.parts):
                self._set_in_potentials("pulled", True)
                found, _ = self.settle(found, 10.0 * _ENOUGH)
                self._set_in_potentials("pulled", False)
            for softness in softer:
                self._set_in_potentials("softness", softness)
                found, _ = self.settle(found, 10.0 * _ENOUGH)
            self._set_in_potentials("softness", 1.0)
            found, residual = self.settle(found)
            if any(_slipped_sprocket(*of) is not None for of in self._chains_at(found)):
                residual = math.inf
            if residual <= _ACCURACY:
                break
        return found, residual

    def _set_in_potentials(self, name: str, value: Any) -> None:
        """Sets an attribute of all chains' potentials."""
        for potential in self.parts:
            setattr(potential, name, value)

    def _chains_at(self, x: Array) -> Iterator[tuple[Potential, Assembly, Array]]:
        """Potential, assembly and part of x of each chain."""
        return zip(self.parts, self.assemblies, self.parts_of_coordinates(x), strict=True)

    def _terms(self, x: Array) -> EnergyTerms:
        """Energy, gradient and Hessian of all chains at x."""
        found = [potential.terms(own) for potential, own in zip(self.parts, self.parts_of_coordinates(x), strict=True)]
        return found[0] if len(found) == 1 else stacked_terms(found)

    def settle(self, x: Array, enough: float = _ENOUGH) -> tuple[Array, float]:
        """Equilibrium near x, and the largest force left over the largest at work."""
        shift, least = 1e-6 * self.stiffest, 1e-12 * self.stiffest
        terms = self._terms(x)
        self._move_levers(x)
        slope, curvature = terms.gradient_of_coordinates(self.maps, self.count), terms.hessian(self.maps, self.count)
        for _ in range(_ITERATIONS):
            if float(np.abs(slope).max()) <= enough * self.force or shift > 1e6 * self.stiffest:
                break
            change = self._solve(curvature, slope, shift)
            change *= min(1.0, _FARTHEST * self.pitch / float(np.abs(change).max()))
            moved = x + sum(weight * change[column] for column, weight in self.maps)
            for potential, own in zip(self.parts, self.parts_of_coordinates(moved), strict=True):
                potential.move_carried(own)
            after = self._terms(moved)
            gain, noise = -float(slope @ change), 1e-13 * abs(terms.energy)
            if gain > 0.0 and after.energy <= terms.energy - 1e-4 * gain + noise:
                whole, before = shift == least, float(np.abs(slope).max())
                x, terms, shift = moved, after, max(_DECAY * shift, least)
                self._move_levers(x)
                slope, curvature = (
                    terms.gradient_of_coordinates(self.maps, self.count),
                    terms.hessian(self.maps, self.count),
                )
                if whole and 0.5 * before < float(np.abs(slope).max()) <= _ENOUGH * self.force:
                    break
            else:
                shift *= _GROWTH
        return x, float(np.abs(slope).max()) / self.force

    def failure(self, x: Array, residual: float) -> str | None:
        """Reason why x is no equilibrium, and the remedy, or None."""
        for potential, assembly, own in self._chains_at(x) if math.isinf(residual) else ():
            slipped = _slipped_sprocket(potential, assembly, own)
            if slipped is not None:
                return (
                    f'the chain does not stay on the teeth of "{potential.model.sprockets[slipped].name}": take more '
                    "preload or wrap (warpchain fit), or less load"
                )
        if residual <= _ACCURACY:
            return None
        force, (column, weight) = np.abs(self._terms(x).gradient_of_coordinates(self.maps, self.count)), self.maps[0]
        worst = int(np.flatnonzero((column == force.argmax()) & (weight != 0.0))[0])
        part = int(np.searchsorted(self.ends, worst, side="right")) - 1
        name = _coordinate_name(self.parts[part], self.assemblies[part], worst - self.ends[part])
        return (
            f"no equilibrium was found: after {_ITERATIONS} steps {force.max():.3g} N are left on {name}, "
            f"{residual:.2g} of the largest force that acts (wanted {_ACCURACY:g}); look at what holds it there, at "
            "the layout and how the chain fits (warpchain fit), or take tensions from a run"
        )

    def _move_levers(self, x: Array) -> None:
        """Updates the weights with which arms move what they carry."""
        weights = [self.parts_of_coordinates(weight) for _, weight in self.maps]
        for potential, own, *of in zip(self.parts, self.parts_of_coordinates(x), *weights, strict=True):
            for one, (dx, dy) in zip(potential.carried, potential.levers(own), strict=True):
                of[one.second][one.place :][:2] = np.array([-dy, dx]) * of[0][potential.first_arm + one.arm]

    def _solve(self, curvature: csc_matrix, slope: Array, shift: float) -> Array:
        """Newton step of the free coordinates, the Hessian's diagonal shifted."""
        from scipy.sparse.linalg import splu

        shifted = curvature.copy()
        shifted.setdiag(curvature.diagonal() + shift)
        return np.asarray(splu(shifted, permc_spec="MMD_AT_PLUS_A").solve(-slope))


def _largest_force(potential: Potential, assembly: Assembly) -> float:
    """Largest force on a chain and what moves with it [N]."""
    chain = potential.model.chain
    return max(
        chain.stiffness * assembly.path.pitch * max(assembly.strain, 0.0),
        float(np.max(np.abs(potential.moments) / potential.lever)),
        float(np.abs(potential.pull).max()),
        *(tensioner.push for arm in potential.arms for tensioner in arm.tensioners),
        *(tensioner.push for _, tensioner in potential.tensioners),
        chain.mass * float(np.hypot(*potential.gravity)) * 10.0,
        1e-9 * chain.stiffness * chain.pitch,
    )


def _coordinate_name(potential: Potential, assembly: Assembly, i: int) -> str:
    """Name of the drive's part of coordinate i."""
    model, rollers, sprockets = potential.model, potential.rollers, potential.sprockets
    if i >= potential.first_pivot:
        i = potential.first_arm + potential.hung[(i - potential.first_pivot) // 2][0]
    if i >= potential.first_arm:
        return f'arm "{model.arms[i - potential.first_arm].name}"'
    if i >= 2 * rollers:
        within = i - 2 * rollers
        b = within // 2 if within < 2 * sprockets else within - 2 * sprockets
        return f'{"sprocket" if b < sprockets else "shaft"} "{body_names(model)[b]}"'
    roller = i // 2
    s = int(assembly.seat_sprocket[roller])
    if s >= 0:
        return f'a roller on "{model.sprockets[s].name}"'
    before = (roller - assembly.strand_first) % rollers
    return f'a roller of strand "{model.strand_names[int(before.argmin())]}"'


def _slipped_sprocket(potential: Potential, assembly: Assembly, x: Array) -> int | None:
    """Index of the sprocket whose teeth the chain has left amid its wrap, or None."""
    r, centers, angles = potential.parts_of_coordinates(x)
    for s, sprocket in enumerate(potential.model.sprockets):
        rollers = np.flatnonzero(assembly.seat_sprocket == s)
        middle = rollers[len(rollers) // 2]
        arm = r[middle] - centers[s]
        polar = math.atan2(arm[1], arm[0]) - angles[s]
        teeth = sprocket.teeth
        seat = round(polar * teeth / (2.0 * math.pi)) % teeth
        if seat != assembly.seat_index[middle]:
            return s
    return None


def _free_coordinates_of_chains(parts: Sequence[Potential], shafts: Joined) -> tuple[list[Map], int]:
    """Free coordinates of chains with shared shafts: columns, weights, count."""
    columns, weights, seconds, count = [], [], [], 0
    for potential in parts:
        column, weight, own = _free_coordinates(potential)
        arms = column[potential.first_arm : potential.first_pivot]
        second = np.zeros_like(column)
        for one in potential.carried:
            (second if one.second else column)[one.place :][:2] = arms[one.arm]
        columns.append(column + count)
        seconds.append(second + count)
        weights.append(weight)
        count += own
    angles = [potential.first_arm - potential.turning for potential in parts]
    kept = np.ones(count, dtype=np.bool_)
    for (r, s), *others in shafts:
        for other, t in others if weights[r][angles[r] + s] else ():
            kept[columns[other][angles[other] + t]] = False
            columns[other][angles[other] + t] = columns[r][angles[r] + s]
            weights[other][angles[other] + t] = weights[r][angles[r] + s]
    number, weight = np.cumsum(kept) - 1, np.concatenate(weights)
    maps = [(number[np.concatenate(columns)], weight)]
    if any(potential.hung for potential in parts):
        maps.append((number[np.concatenate(seconds)], np.zeros_like(weight)))
    return maps, int(kept.sum())


def _free_coordinates(potential: Potential) -> tuple[NDArray[np.int64], Array, int]:
    """Free coordinates of a chain, dx_i = weight_i dy_column(i): columns, weights, count.

    Angles count as lengths; weights of carried places are `_Solver`'s.
    """
    n, s = 2 * potential.rollers, potential.sprockets
    column, weight, count = np.zeros(potential.size, dtype=np.int64), np.zeros(potential.size), n
    column[:n], weight[:n] = np.arange(n), 1.0
    tied, begun = rigid_ratios(potential.model), dict[int, tuple[int, int]]()
    for b in range(potential.turning):
        x, y, angle = n + 2 * b, n + 2 * b + 1, n + 2 * s + b
        mount = potential.model.sprockets[b].mount if b < s else None
        if isinstance(mount, ElasticMount):
            column[x], column[y], weight[x : y + 1] = count, count + 1, 1.0
            count += 2
        elif isinstance(mount, SliderMount):
            column[x : y + 1], weight[x : y + 1] = count, unit_direction(mount.direction)
            count += 1
        if not potential.held[b]:
            first, place = begun.setdefault(tied.root[b], (b, count))
            column[angle] = place
            weight[angle] = float(tied.ratio[b] / tied.ratio[first]) / float(potential.lever[first])
            count += first == b
    for a in range(len(potential.arms)):
        column[potential.first_arm + a], weight[potential.first_arm + a] = count, 1.0 / potential.model.arm_lever(a)
        count += 1
    return column, weight, count
