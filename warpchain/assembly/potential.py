"""Potential energy of a drive whose chain travels steadily, with gradient and Hessian."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import RestingArm, RestingTensioner
from warpchain.assembly.back_energy import Backs
from warpchain.assembly.guide_obstacles import profile_at, rotated_place
from warpchain.assembly.toe_energy import Wheel
from warpchain.drive.body_ties import first_coupling_ratio, nearest_sprocket
from warpchain.drive.face_profile import unit_vector
from warpchain.drive.sprocket import ElasticMount, PrescribedMount, SliderMount
from warpchain.model.mounts import moving_mass, unit_direction, wheel_mass
from warpchain.model.trains import body_turning_sign, coupling_rest_angle, is_held_body

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from warpchain.model import ChainModel

Array = NDArray[np.float64]

_TINY = 1e-12  # m: a roller this near to the middle of its seat


Map = tuple[NDArray[np.int64], Array]
"""Free coordinate that moves each coordinate, and its weight."""


class CarriedPlace(NamedTuple):
    """Place, two coordinates, that an arm moves on a circle.

    Attributes:
        place: its first coordinate.
        of: place that goes round the arm's pivot with it.
        second: whether another arm, on this one, moves it, too.
    """

    place: int
    arm: int
    of: int
    second: bool


@dataclass
class EnergyTerms:
    """Energy, gradient and Hessian of a drive, added up term by term."""

    size: int
    energy: float
    gradient: Array
    rows: list[NDArray[np.int64]]
    columns: list[NDArray[np.int64]]
    values: list[Array]

    def add_blocks(self, where: NDArray[np.int64], blocks: Array) -> None:
        """Adds blocks (M, b, b) of the Hessian at the unknowns `where` (M, b)."""
        b = where.shape[1]
        self.rows.append(np.repeat(where, b, axis=1).ravel())
        self.columns.append(np.tile(where, (1, b)).ravel())
        self.values.append(blocks.ravel())

    def add_contacts(self, at: NDArray[np.int64], slope: Array, block: Array, rho: Array | None) -> None:
        """Adds gradient and Hessian of M rollers that press on a body.

        Args:
            at: (M, b) unknowns: roller's place; body's center, if it moves; body's angle, if it turns.
            slope: (M, 2) dE/dr [N], r the roller's place.
            block: (M, 2, 2) d^2E/dr^2 [N/m].
            rho: (M, 2) from the center of turn to the roller [m]; None for a body at rest.
        """
        moves = np.zeros((len(at), 2, at.shape[1]))  # of the roller against the body, by the unknowns
        moves[:, :, :2] = np.eye(2)
        if at.shape[1] > 3:
            moves[:, :, 2:4] = -np.eye(2)
        if rho is not None:
            moves[:, 0, -1], moves[:, 1, -1] = rho[:, 1], -rho[:, 0]
        blocks = np.einsum("mki,mkl,mlj->mij", moves, block, moves)
        if rho is not None:
            left = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
            mixed = np.einsum("mki,mk->mi", moves[:, :, :-1], left)
            blocks[:, :-1, -1] += mixed
            blocks[:, -1, :-1] += mixed
            blocks[:, -1, -1] -= np.einsum("mi,mi->m", rho, slope)
        np.add.at(self.gradient, at, np.einsum("mki,mk->mi", moves, slope))
        self.add_blocks(at, blocks)

    def gradient_of_coordinates(self, maps: Sequence[Map], count: int) -> Array:
        """Gradient of the energy by `count` free coordinates."""
        found = np.zeros(count)
        for column, weight in maps:
            found += np.bincount(column, weight * self.gradient, count)
        return found

    def hessian(self, maps: Sequence[Map], count: int) -> csc_matrix:
        """Hessian of the energy by `count` free coordinates y, dx_i = sum of weight_i dy_column(i)."""
        from scipy.sparse import coo_matrix

        rows, columns, values = (np.concatenate(of) for of in (self.rows, self.columns, self.values))
        found = []
        for (down, one), (across, other) in product(maps, maps):
            free = np.flatnonzero(one[rows] * other[columns])
            value = values * one[rows] * other[columns]
            found.append((value[free], down[rows[free]], across[columns[free]]))
        value, down, across = (np.concatenate(of) for of in zip(*found, strict=True))
        return coo_matrix((value, (down, across)), shape=(count, count)).tocsc()


def stacked_terms(terms: Sequence[EnergyTerms]) -> EnergyTerms:
    """Energy terms of several chains as one, their coordinates one after the other."""
    found = EnergyTerms(0, 0.0, np.concatenate([of.gradient for of in terms]), [], [], [])
    for of in terms:
        found.energy += of.energy
        found.rows += [rows + found.size for rows in of.rows]
        found.columns += [columns + found.size for columns in of.columns]
        found.values += of.values
        found.size += of.size
    return found


class Potential:
    """Potential energy E of a chain by its coordinates.

    These are rollers (2 N), centers (2 S), angles of sprockets and shafts (S + H), arms' absolute angles (A), and
    pivots of arms on arms.

    Args:
        frequency: links a second [Hz].
        moments: (S + H,) loads against forward rotation [N m].
        hanging: whether balance wheels hang where they are, or turn nothing in the mean.
        laid: (S,) angles of the sprockets as laid [rad], for couplings.
        held: (S + H,) whether an angle is; None as `is_held_body`, and of a shaft without a sprocket near.
        goods: (N,) masses on the pins [kg].

    Attributes:
        lever: (S + H,) length as which a turn counts [m/rad]: the pitch radius, of a shaft the nearest sprocket's.
        hung: arms on arms, and what carries each.
        carried: what arms carry along.
    """

    def __init__(
        self,
        model: ChainModel,
        frequency: float,
        moments: Array,
        hanging: bool = False,
        laid: Array | None = None,
        held: Sequence[bool] | None = None,
        goods: Array | float = 0.0,
    ) -> None:
        chain, sprockets = model.chain, model.sprockets
        self.goods = np.zeros(chain.rollers) + goods
        self.model, self.rollers, self.sprockets = model, chain.rollers, len(sprockets)
        self.turning = self.sprockets + len(model.shafts)
        self.arms = [RestingArm(model, a) for a in range(len(model.arms))]
        self.first_arm = 2 * self.rollers + 2 * self.sprockets + self.turning
        self.hung = [(a, p) for a in range(len(self.arms)) if (p := model.parent(a)) is not None]
        self.first_pivot = self.first_arm + len(self.arms)
        self.size = self.first_pivot + 2 * len(self.hung)
        self.gravity = np.asarray(model.run.gravity, dtype=float)
        self.push = chain.mass * frequency**2  # of centrifugal force on a link, over its length [N/m], in the mean
        self.stiffness, self.play = self._stiffness_and_play()
        self.lengths = chain.link_lengths
        self.teeth = [model.tooth(s) for s in range(self.sprockets)]
        self.radius = np.array([model.pitch_radius(s) for s in range(self.sprockets)])
        self.tooth_stiffness = [model.sprocket_stiffness(s) for s in range(self.sprockets)]
        self.guide_stiffness = [model.guide_stiffness(g) for g in range(len(model.guides))]
        self.carried = self._carried_places()
        near = [nearest_sprocket(model, b) for b in range(self.turning)]
        self.held = held or [near[b] is None or is_held_body(model, b) for b in range(self.turning)]
        self.lever = self.radius[[s or 0 for s in near]]
        geared = [] if laid is None else [float(first_coupling_ratio(coupling) or 1) for coupling in model.couplings]
        self.couplings = [(*coupling_rest_angle(model, c, ratio, laid), ratio) for c, ratio in enumerate(geared)]
        self.moments = np.array([body_turning_sign(model, b) for b in range(self.turning)]) * moments
        self.moments[np.array(self.held)] = 0.0
        self.pulled = False  # whether links with play are taken to be pulled, all of them
        self.softness = 1.0  # of all contacts: what their stiffnesses are multiplied by
        self.home, self.spring, self.pull = _mount_values(model, self.gravity)
        self.tensioners = [
            (s, RestingTensioner(model, tensioner))
            for t, tensioner in enumerate(model.tensioners)
            if (s := model.tensioner_body(t)) < self.sprockets
        ]
        self.wheels = np.zeros((self.turning, 2))  # the arms q of balance wheels at angle 0 [kg m]
        for s, sprocket in enumerate(sprockets):
            if hanging and sprocket.balance_wheel is not None:
                wheel = sprocket.balance_wheel
                self.wheels[s] = wheel_mass(sprocket) * wheel.radius * np.array(unit_vector(wheel.phase))

    def _stiffness_and_play(self) -> tuple[Array, Array]:
        """Stiffnesses (N,) [N/m] and plays (N,) [m] of the links."""
        chain = self.model.chain
        stiffness = np.full(chain.rollers, chain.stiffness)
        if chain.varied_links:
            stiffness[0::2] = chain.outer_stiffness
        stiffness[chain.links :] = 0.0  # the absent link of an open chain
        return stiffness, np.full(chain.rollers, chain.link_play if chain.varied_links else 0.0)

    def parts_of_coordinates(self, x: Array) -> tuple[Array, Array, Array]:
        """Rollers (N, 2), centers (S, 2) and angles (S + H,) as views of coordinates."""
        n, s = 2 * self.rollers, 2 * self.sprockets
        return x[:n].reshape(-1, 2), x[n : n + s].reshape(-1, 2), x[n + s : self.first_arm]

    def _carried_places(self) -> list[CarriedPlace]:
        """Places that arms carry: pivots of arms, then sprocket centers."""
        pivot = {a: self.first_pivot + 2 * k for k, (a, _) in enumerate(self.hung)}
        found = [CarriedPlace(pivot[a], p, pivot[a], False) for a, p in self.hung]
        on = dict(self.hung)
        for s in range(self.sprockets):
            if (a := self.model.carrier(s)) is not None:
                center = 2 * (self.rollers + s)
                found.append(CarriedPlace(center, a, center, False))
                found += [CarriedPlace(center, on[a], pivot[a], True)] if a in on else []
        return found

    def pivots(self, x: Array) -> Array:
        """Pivots of the arms (A, 2) [m]."""
        found = np.array([arm.pivot for arm in self.model.arms], dtype=np.float64)
        for k, (a, _) in enumerate(self.hung):
            found[a] = x[self.first_pivot + 2 * k :][:2]
        return found

    def arm_angles(self, x: Array) -> Array:
        """Angles of the arms (A,) to their parent arms or the ground [rad]."""
        found = np.array(x[self.first_arm : self.first_pivot])
        for a, p in self.hung:
            found[a] -= x[self.first_arm + p]
        return found

    def move_carried(self, x: Array) -> None:
        """Moves carried pivots and sprocket centers, in coordinates x, with their arms."""
        arms, centers = self.model.arms, self.parts_of_coordinates(x)[1]
        for k, (own, p) in enumerate(self.hung):
            place = rotated_place(arms[p].pivot, arms[own].pivot, float(x[self.first_arm + p]))
            x[self.first_pivot + 2 * k :][:2] = place
        pivots, hung = self.pivots(x), dict(self.hung)
        for s, sprocket in enumerate(self.model.sprockets):
            if (a := self.model.carrier(s)) is not None:
                centers[s] = rotated_place(arms[a].pivot, sprocket.center, float(x[self.first_arm + a]))
                centers[s] += pivots[a] - arms[a].pivot if a in hung else 0.0

    def levers(self, x: Array) -> Array:
        """Vectors from arm pivots to carried places (C, 2) [m]."""
        pivots = self.pivots(x)
        return np.array([x[one.of :][:2] - pivots[one.arm] for one in self.carried]).reshape(-1, 2)

    def tensions(self, x: Array) -> Array:
        """Tensions of the links (N,), centrifugal part included [N]."""
        r, _, _ = self.parts_of_coordinates(x)
        d = np.roll(r, -1, axis=0) - r
        return self.link_springs(np.hypot(d[:, 0], d[:, 1]))[1]

    def link_springs(self, length: Array) -> tuple[Array, Array, Array]:
        """Energy [J], tension [N] and stiffness [N/m] of links of lengths (N,)."""
        drawn = length - self.lengths
        stretch = drawn - (self.play if self.pulled else np.clip(drawn, -self.play, self.play))
        stiffness = np.where((stretch != 0.0) | (self.play == 0.0), self.stiffness, 0.0)
        tension = stiffness * stretch
        return 0.5 * tension * stretch, tension, stiffness

    def terms(self, x: Array) -> EnergyTerms:
        """Energy, gradient and Hessian of a chain at coordinates x."""
        terms = EnergyTerms(self.size, 0.0, np.zeros(self.size), [], [], [])
        self._add_links(x, terms)
        for s in range(self.sprockets):
            self._add_teeth(x, s, terms)
        for g in range(len(self.model.guides)):
            self._add_guide(x, g, terms)
        self._add_constant_forces(x, terms)
        self._add_couplings(x, terms)
        hung = dict(self.hung)
        for a, arm in enumerate(self.arms):
            at = self.first_arm + a
            angle = float(x[at])
            if a in hung:
                self._add_parent_arm(x, a, hung[a], terms)
                continue
            terms.energy += arm.energy(angle)
            terms.gradient[at] -= arm.moment(angle)
            terms.add_blocks(np.array([[at]]), np.array([[[arm.stiffness(angle)]]]))
        for one, lever in zip(self.carried, self.levers(x), strict=True):  # it moves on a circle
            bent = -float(terms.gradient[one.place :][:2] @ lever)
            terms.add_blocks(np.array([[self.first_arm + one.arm]]), np.array([[[bent]]]))
        return terms

    def _add_parent_arm(self, x: Array, a: int, p: int, terms: EnergyTerms) -> None:
        """Adds the energy of arm a on arm p: springs and weight."""
        arm, at, on = self.arms[a], self.first_arm + a, self.first_arm + p
        angle, turned = float(x[at]), float(x[at] - x[on])
        place = self.first_pivot + 2 * [own for own, _ in self.hung].index(a)
        weight = sum(mass for mass, _ in arm.weights) * self.gravity
        terms.energy += (
            arm.energy(turned) + arm.weight_work(turned) - arm.weight_work(angle) - float(weight @ x[place : place + 2])
        )
        terms.gradient[at] -= arm.joint_moment(turned) + arm.weight_moment(angle)
        terms.gradient[on] += arm.joint_moment(turned)
        terms.gradient[place : place + 2] -= weight
        between = (arm.stiffness(turned) - arm.weight_work(turned)) * np.array([[1.0, -1.0], [-1.0, 1.0]])
        terms.add_blocks(np.array([[at, on]]), between[None])
        terms.add_blocks(np.array([[at]]), np.array([[[arm.weight_work(angle)]]]))

    def torques(self, x: Array) -> tuple[Array, Array]:
        """Twists of the couplings (C,) [rad], and moments on them from their first bodies (C,) [N m].

        Freewheels are locked; a brake is off and a backstop overrun.
        """
        angles, couplings = self.parts_of_coordinates(x)[2], self.model.couplings
        twist = np.array(
            [angles[a] - ratio * angles[b] - rest if a >= 0 else 0.0 for a, b, rest, ratio in self.couplings]
        )
        lash = np.array([coupling.lash for coupling in couplings])[: len(twist)]
        stiffness = np.array([coupling.stiffness for coupling in couplings])[: len(twist)]
        return twist, stiffness * (twist - np.clip(twist, -lash, lash))

    def _add_couplings(self, x: Array, terms: EnergyTerms) -> None:
        """Adds the energy of couplings."""
        moments = self.torques(x)[1]
        for (a, b, _, ratio), coupling, moment in zip(self.couplings, self.model.couplings, moments, strict=False):
            if a < 0:
                continue
            pair = np.array([1.0, -ratio])
            at = self.first_arm - self.turning + np.array([a, b])
            terms.energy += 0.5 * float(moment) ** 2 / coupling.stiffness
            terms.gradient[at] += moment * pair
            holds = coupling.stiffness if moment != 0.0 or coupling.lash == 0.0 else 0.0
            terms.add_blocks(at[None], holds * np.outer(pair, pair)[None])

    def _add_links(self, x: Array, terms: EnergyTerms) -> None:
        """Adds the energy of links."""
        r, _, _ = self.parts_of_coordinates(x)
        n = self.rollers
        d = np.roll(r, -1, axis=0) - r
        length = np.hypot(d[:, 0], d[:, 1])
        u = d / length[:, None]
        energy, tension, stiffness = self.link_springs(length)
        push = np.where(np.arange(n) < self.model.chain.links, self.push, 0.0)
        terms.energy += float(np.sum(energy - 0.5 * push * length**2))
        force = tension - push * length
        pull = force[:, None] * u
        terms.gradient[: 2 * n] += (np.roll(pull, 1, axis=0) - pull).ravel()
        block = _along_across(u, stiffness - push, force / length)
        i = np.arange(n)
        j = (i + 1) % n
        where = np.stack([2 * i, 2 * i + 1, 2 * j, 2 * j + 1], axis=1)
        terms.add_blocks(where, np.block([[block, -block], [-block, block]]))

    def _add_teeth(self, x: Array, s: int, terms: EnergyTerms) -> None:
        """Adds the energy of rollers on the teeth of sprocket s."""
        if self.model.chain.is_silent:
            self._add_toes(x, s, terms)
            return
        r, centers, angles = self.parts_of_coordinates(x)
        tooth, radius, stiffness = self.teeth[s], float(self.radius[s]), self.softness * self.tooth_stiffness[s]
        rho = r - centers[s]
        distance = np.hypot(rho[:, 0], rho[:, 1])
        roller_radius, pitch = self.model.chain.roller_radius, self.model.chain.pitch
        near = np.flatnonzero((distance < tooth.tip_radius + roller_radius) & (distance > radius - pitch))
        exponent = self.model.contact.sprocket.exponent
        if self.model.sprockets[s].is_end:
            near, exponent = np.array([0 if s == 0 else self.rollers - 1]), 1.0
        rho = rho[near]
        angle = 2.0 * math.pi / self.model.sprockets[s].teeth
        polar = angles[s] + angle * np.rint((np.arctan2(rho[:, 1], rho[:, 0]) - angles[s]) / angle)
        e = np.stack([np.cos(polar), np.sin(polar)], axis=1)
        xi = np.einsum("ij,ij->i", rho, e) - radius
        eta = rho[:, 1] * e[:, 0] - rho[:, 0] * e[:, 1]
        pen, along, across, bend = self._tooth_penetration(xi, eta, s, distance[near])
        hit = pen > 0.0
        if not hit.any():
            return
        near, rho, e, pen, bend = near[hit], rho[hit], e[hit], pen[hit], bend[hit]
        normal = along[hit, None] * e + across[hit, None] * np.stack([-e[:, 1], e[:, 0]], axis=1)
        force, block = _add_contact_energy(terms, pen, normal, bend, stiffness, exponent)
        base, center = 2 * self.rollers, np.full(len(near), 2 * (self.rollers + s))
        angle_at = np.full(len(near), base + 2 * self.sprockets + s)
        at = np.stack([2 * near, 2 * near + 1, center, center + 1, angle_at], axis=1)
        terms.add_contacts(at, -force[:, None] * normal, block, rho)

    def _add_toes(self, x: Array, s: int, terms: EnergyTerms) -> None:
        """Adds the energy of toes on the teeth of sprocket s."""
        r, centers, angles = self.parts_of_coordinates(x)
        stiffness, exponent = 0.5 * self.softness * self.tooth_stiffness[s], self.model.contact.sprocket.exponent
        wheel = Wheel(self.model, s, stiffness, exponent)
        near, base = wheel.near_pins(r - centers[s]), 2 * self.rollers
        for number in range(4):
            far = (near + (1 if number < 2 else -1)) % self.rollers
            one = np.ones(len(near), dtype=np.int64)
            center, turn = (base + 2 * s) * one, (base + 2 * self.sprockets + s) * one
            at = np.stack([2 * near, 2 * near + 1, 2 * far, 2 * far + 1, center, center + 1, turn], axis=1)
            values = np.column_stack([r[near], r[far], np.outer(one, centers[s]), angles[s] * one])
            energy, slope = wheel.energy(values, number)
            hit = energy > 0.0
            if hit.any():
                terms.energy += float(energy.sum())
                np.add.at(terms.gradient, at[hit], slope[hit])
                terms.add_blocks(at[hit], wheel.hessian(values[hit], number))

    def _tooth_penetration(self, xi: Array, eta: Array, s: int, distance: Array) -> tuple[Array, Array, Array, Array]:
        """Tooth penetration [m], its normal (outward, counter-clockwise) and curvature [1/m]."""
        tooth, roller_radius = self.teeth[s], self.model.chain.roller_radius
        cosine, sine = math.cos(0.5 * tooth.seat_angle), math.sin(0.5 * tooth.seat_angle)
        clearance = tooth.seat_radius - roller_radius
        side, off = np.where(eta >= 0.0, 1.0, -1.0), np.abs(eta)
        size = np.maximum(np.hypot(xi, eta), _TINY)
        straight = off * sine - xi * cosine - clearance
        curvature = 1.0 / (tooth.flank_radius + roller_radius)
        t = off * cosine + xi * sine
        across, along = 1.0 - curvature * straight, curvature * t
        reach = np.hypot(across, along)
        pen = (straight * (1.0 + across) - along * t) / (1.0 + reach)
        outward, lateral = (across * cosine + along * sine) / reach, side * (along * cosine - across * sine) / reach
        bend = -curvature / reach
        arc = off * cosine <= -xi * sine
        pen, bend = np.where(arc, size - clearance, pen), np.where(arc, 1.0 / size, bend)
        outward, lateral = np.where(arc, -xi / size, outward), np.where(arc, -eta / size, lateral)
        above = tooth.tip_radius + roller_radius - distance
        tip = (pen > 0.0) & (above < pen)
        pen, bend = np.where(tip, above, pen), np.where(tip, -1.0 / distance, bend)
        outward = np.where(tip, (self.radius[s] + xi) / distance, outward)
        return pen, outward, np.where(tip, eta / distance, lateral), bend

    def _add_guide(self, x: Array, g: int, terms: EnergyTerms) -> None:
        """Adds the energy of rollers on guide g (`warpchain.drive.face_profile`, (a))."""
        r, _, _ = self.parts_of_coordinates(x)
        arm, pivots = self.model.arm_of(g), self.pivots(x)
        hung = [a for a, _ in self.hung]
        offset, law = self.model.guide_offset(g), self.model.guide_contact(g)
        for piece in profile_at(self.model, g, self.arm_angles(x).tolist()).pieces:
            (u, w, s, height, root), k = piece.heights(r), piece.curvature
            pen = offset - height
            hit = np.flatnonzero((pen > 0.0) & (pen < 1.5 * offset) & (s >= 0.0) & (s < piece.length))
            if not len(hit):
                continue
            t, root = np.array(unit_vector(piece.heading)), np.maximum(root[hit, None], 1e-6)
            normal = (1.0 - k * w[hit, None]) / root * [-t[1], t[0]] - k * u[hit, None] / root * t
            stiffness = self.softness * self.guide_stiffness[g]
            force, block = _add_contact_energy(terms, pen[hit], normal, k / root[:, 0], stiffness, law.exponent)
            at, rho = np.stack([2 * hit, 2 * hit + 1], axis=1), None
            if arm is not None:
                rho = r[hit] - pivots[arm]
                own = [self.first_arm + arm]
                if arm in hung:
                    place = self.first_pivot + 2 * hung.index(arm)
                    own = [place, place + 1, *own]
                at = np.column_stack([at, *(np.full(len(hit), i) for i in own)])
            terms.add_contacts(at, -force[:, None] * normal, block, rho)
        if self.model.chain.is_silent:
            self._add_backs(x, g, terms)

    def _add_backs(self, x: Array, g: int, terms: EnergyTerms) -> None:
        """Adds the energy of the backs of links on guide g."""
        r, arm, pivots = self.parts_of_coordinates(x)[0], self.model.arm_of(g), self.pivots(x)
        hung = [a for a, _ in self.hung]
        profile = profile_at(self.model, g, self.arm_angles(x).tolist())
        stiffness, exponent = self.softness * self.guide_stiffness[g], self.model.guide_contact(g).exponent
        center = np.zeros(2) if arm is None else pivots[arm]
        backs = Backs(self.model.chain, self.model.sprockets[0].sign, profile, center, self.model.guide_offset(g),
                      stiffness, exponent)  # fmt: skip
        near = backs.near_links(r)
        at = np.column_stack([2 * near, 2 * near + 1, 2 * (near + 1) % (2 * self.rollers)])
        at = np.column_stack([at, at[:, 2] + 1])
        free = [0, 1, 2, 3]
        if arm in hung:
            place = self.first_pivot + 2 * hung.index(arm)
            at, free = np.column_stack([at, np.full((len(near), 2), [place, place + 1])]), [*free, 4, 5]
        if arm is not None:
            at, free = np.column_stack([at, np.full(len(near), self.first_arm + arm)]), [*free, 6]
        values = np.zeros((len(near), 7))
        values[:, :4], values[:, 4:6] = r.ravel()[at[:, :4]], center
        energy, slope = backs.energy(values)
        terms.energy += float(energy.sum())
        np.add.at(terms.gradient, at, slope[:, free])
        terms.add_blocks(at, backs.hessian(values)[:, free][:, :, free])

    def _add_constant_forces(self, x: Array, terms: EnergyTerms) -> None:
        """Adds the energy of weight, centrifugal forces, loads and mounts."""
        r, centers, angles = self.parts_of_coordinates(x)
        n, s = 2 * self.rollers, 2 * self.sprockets
        chain = self.model.chain
        weight = chain.mass * self.gravity
        more = (chain.roller_masses - chain.mass + self.goods)[:, None] * self.gravity  # than a roller in the mean
        terms.energy += float(-np.sum(r @ weight) - np.sum(r * more) + self.moments @ angles)
        terms.gradient[:n] -= np.tile(weight, self.rollers)
        terms.gradient[:n] -= more.ravel()
        terms.gradient[n + s : self.first_arm] += self.moments
        off = centers - self.home
        terms.energy += float(np.sum(0.5 * self.spring * off**2 - self.pull * off))
        terms.gradient[n : n + s] += (self.spring * off - self.pull).ravel()
        at = np.arange(n, n + s)[:, None]
        terms.add_blocks(at, self.spring.reshape(-1, 1, 1))
        cosine, sine = np.cos(angles), np.sin(angles)
        q = np.stack([cosine, sine], axis=1) * self.wheels[:, :1]
        q += np.stack([-sine, cosine], axis=1) * self.wheels[:, 1:]
        terms.energy -= float(np.sum(q @ self.gravity))
        terms.gradient[n + s : self.first_arm] -= q[:, 0] * self.gravity[1] - q[:, 1] * self.gravity[0]
        terms.add_blocks(np.arange(n + s, self.first_arm)[:, None], (q @ self.gravity).reshape(-1, 1, 1))
        for of, tensioner in self.tensioners:
            way, place = np.asarray(tensioner.unit_direction), n + 2 * of + np.arange(2)
            extension = float((centers[of] - self.model.sprockets[of].center) @ way)
            terms.energy += tensioner.energy(extension)
            terms.gradient[place] -= tensioner.force(extension) * way
            terms.add_blocks(place[None], tensioner.stiffness(extension) * np.outer(way, way)[None])


def _along_across(u: Array, along: Array, across: Array) -> Array:
    """Matrices (M, 2, 2) with eigenvalues `along` and `across` unit vectors u (M, 2)."""
    outer = u[:, :, None] * u[:, None, :]
    return np.asarray(across[:, None, None] * np.eye(2) + (along - across)[:, None, None] * outer)


def _add_contact_energy(
    terms: EnergyTerms, pen: Array, normal: Array, bend: Array, stiffness: float, exponent: float
) -> tuple[Array, Array]:
    """Adds contacts' energy; returns forces (M,) [N] and derivatives by place (M, 2, 2) [N/m]."""
    force = stiffness * pen**exponent
    terms.energy += float(np.sum(force * pen)) / (exponent + 1.0)
    return force, _along_across(normal, exponent * force / pen, force * bend)


def _mount_values(model: ChainModel, gravity: Array) -> tuple[Array, Array, Array]:
    """Mean places [m], springs [N/m] and steady forces [N] of sprocket centers, each (S, 2)."""
    count = len(model.sprockets)
    home = np.array([sprocket.center for sprocket in model.sprockets], dtype=float)
    spring, pull = np.zeros((count, 2)), np.zeros((count, 2))
    for s, sprocket in enumerate(model.sprockets):
        mount = sprocket.mount
        if isinstance(mount, PrescribedMount) and mount.direction is not None:
            home[s] += mount.offset * unit_direction(mount.direction)
        elif isinstance(mount, ElasticMount):
            spring[s], pull[s] = mount.stiffness, np.asarray(mount.preload) + moving_mass(sprocket) * gravity
        elif isinstance(mount, SliderMount):
            spring[s] = mount.stiffness
            pull[s] = mount.preload * unit_direction(mount.direction) + moving_mass(sprocket) * gravity
    return home, spring, pull
