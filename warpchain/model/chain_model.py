"""One chain of a drive with its parts, and what follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, TypeVar

from warpchain.drive.arms import Arm, stop_damping, stop_stiffness
from warpchain.drive.body_ties import driving_sprocket
from warpchain.drive.chain import Chain
from warpchain.drive.contact_settings import Contact, GuideContact, merged_contact_values
from warpchain.drive.face_profile import Profile
from warpchain.drive.guides import Guide, guide_profile
from warpchain.drive.motion_table import PlaceTable
from warpchain.drive.run_settings import Probe, RunSettings
from warpchain.drive.shafts import Coupling, Gear, Shaft
from warpchain.drive.sprocket import ArmMount, Sprocket, strand_names
from warpchain.drive.sprocket_teeth import END_RADIUS, is_catching, pitch_radius, sprocket_tooth, tooth_pitch
from warpchain.drive.stack_math import Number, arcsin, hypot, maximum, power, sqrt, where
from warpchain.drive.stiffness import contact_stiffness
from warpchain.drive.tensioners import Tensioner
from warpchain.drive.tooth_shape import Tooth
from warpchain.drive.valves import Valves
from warpchain.model.parts_between_chains import SprocketShaft
from warpchain.model.train_speeds import driver_top_speed

Value = TypeVar("Value")


def computed_once(value: Callable[[ChainModel, int], Value]) -> Callable[[ChainModel, int], Value]:
    """A function of a chain model and a part's index that computes each value once."""

    @wraps(value)
    def known_value(model: ChainModel, index: int) -> Value:
        known, key = model.known_values, (value.__name__, index)
        if key not in known:
            known[key] = value(model, index)
        found: Value = known[key]
        return found

    return known_value


@dataclass(frozen=True)
class ChainModel:
    """One chain of a drive, or of a stack, with its parts.

    Bodies are numbered sprockets, shafts, arms. Numbers that differ within a stack are arrays (V,).

    Attributes:
        name: "" of a single chain.
        run: with the phase of the chain's leader.
        shafts: (H,) those at home here (`warpchain.model.chain_models`), then `SprocketShaft`s.
        places: indices of its parts in the drive, by list.
    """

    name: str
    chain: Chain
    sprockets: tuple[Sprocket, ...]
    guides: tuple[Guide, ...]
    arms: tuple[Arm, ...]
    tensioners: tuple[Tensioner, ...]
    contact: Contact
    run: RunSettings
    probes: tuple[Probe, ...]
    shafts: tuple[Shaft, ...]
    gears: tuple[Gear, ...]
    couplings: tuple[Coupling, ...]
    valves: tuple[Valves, ...]
    places: Mapping[str, tuple[int, ...]] = field(compare=False, repr=False)

    @cached_property
    def known_values(self) -> dict[tuple[str, int], Any]:
        """Values of parts by function and index, as computed so far (`computed_once`)."""
        return {}

    @property
    def links(self) -> int:
        """Number of the chain's links, or rollers, an absent one counted."""
        return self.chain.rollers

    @cached_property
    def driver(self) -> int:
        """Index of the chain's driving sprocket."""
        return driving_sprocket(self)

    @property
    def driver_speed(self) -> Number:
        """Top speed of the chain's driver [rad/s]."""
        prescribed = self.sprockets[self.driver].prescribed
        return driver_top_speed(self) if prescribed is None else prescribed.top_speed

    @property
    def chain_speed(self) -> Number:
        """Speed of the chain at its driver's top speed [m/s]."""
        return abs(self.driver_speed) * self.pitch_radius(self.driver)

    @property
    def own_shafts(self) -> tuple[Shaft, ...]:
        """Shafts of the chain but `SprocketShaft`s."""
        return tuple(shaft for shaft in self.shafts if not isinstance(shaft, SprocketShaft))

    @property
    def strand_names(self) -> tuple[str, ...]:
        """Names (S,) "FROM->TO" of the chain's strands."""
        return strand_names(self.sprockets)

    @property
    def first_arm_body(self) -> int:
        """Body number of the first arm."""
        return len(self.sprockets) + len(self.shafts)

    def sprocket_pitch(self, s: int) -> float:
        """Pitch of sprocket s' teeth [m]."""
        return tooth_pitch(self.sprockets[s], self.chain)

    @computed_once
    def pitch_radius(self, s: int) -> float:
        """Radius of sprocket s' pitch circle [m]."""
        return pitch_radius(self.sprockets[s], self.chain)

    def riding_radius(self, s: int) -> float:
        """Radius at which rollers ride on sprocket s, seated or, of longer links, on flanks [m]."""
        if self.sprockets[s].is_end:
            return END_RADIUS
        half = math.pi / self.sprockets[s].teeth
        alone = maximum(self.sprocket_pitch(s), self.chain.worn_pitch) / (2.0 * math.sin(half))
        if self.chain.outer is None:
            return alone
        inner, outer = self.chain.pulled_pair
        over_both = sqrt(power(inner, 2) + power(outer, 2) + 2.0 * inner * outer * math.cos(2.0 * half))
        return where(inner == outer, alone, maximum(self.pitch_radius(s), over_both / (2.0 * math.sin(2.0 * half))))

    def riding_lean(self, s: int) -> float:
        """Angle by which outer links outreach a tooth of sprocket s [rad]."""
        if self.chain.outer is None or self.sprockets[s].is_end:
            return 0.0
        inner, outer = self.chain.pulled_pair
        radius = self.riding_radius(s)
        lean = 0.5 * (arcsin(0.5 * outer / radius) - arcsin(0.5 * inner / radius))
        return where((inner == outer) | (radius <= self.pitch_radius(s)), 0.0, lean)

    @computed_once
    def tooth(self, s: int) -> Tooth:
        """Tooth gap of sprocket s."""
        return sprocket_tooth(self.sprockets[s], self.chain, self.contact.sprocket)

    def seat_angle(self, s: int) -> float:
        """Seat arc's angle of sprocket s [rad]."""
        return self.tooth(s).seat_angle

    def tip_radius(self, s: int) -> float:
        """Radius of sprocket s' tips [m]."""
        return self.tooth(s).tip_radius

    def engagement(self, s: int) -> float:
        """Height over sprocket s' pitch circle that keeps rollers [m]."""
        if self.sprockets[s].is_end:
            return 0.0
        size = self.chain.plate.reach if self.chain.is_silent else self.chain.roller_radius
        reach = self.tip_radius(s) + size - self.pitch_radius(s)
        return maximum(0.5 * self.chain.pitch, reach)

    def catching_sprockets(self) -> tuple[int, ...]:
        """Indices of sprockets whose straight flanks catch rollers."""
        of = enumerate(self.sprockets)
        return tuple(s for s, sprocket in of if is_catching(sprocket, self.chain, self.tooth(s)))

    @computed_once
    def guide_contact(self, g: int) -> GuideContact:
        """Contact settings of guide g, its own over the common ones."""
        common, own = self.contact.guide, self.guides[g].contact
        assert common is not None  # the drive's own rule
        return common if own is None else GuideContact.model_construct(**merged_contact_values(common, own))

    def profile(self, g: int) -> Profile:
        """Face of guide g as drawn."""
        profile = guide_profile(self.guides[g], self.chain.pitch)
        assert profile is not None  # the guide's own rules
        return profile

    def guide_offset(self, g: int) -> float:
        """Height of touching rollers over guide g's face [m]."""
        own = self.guides[g].offset
        return self.chain.roller_radius if own is None else own

    def arm_index(self, name: str) -> int | None:
        """Index of an arm by name, or None."""
        return next((a for a, arm in enumerate(self.arms) if arm.name == name), None)

    def arm_of(self, g: int) -> int | None:
        """Index of the arm that carries guide g, or None."""
        name = self.guides[g].arm
        return None if name is None else self.arm_index(name)

    def guides_of(self, a: int) -> tuple[int, ...]:
        """Indices of guides on arm a."""
        return tuple(g for g, guide in enumerate(self.guides) if guide.arm == self.arms[a].name)

    def carrier(self, s: int) -> int | None:
        """Index of the arm that carries sprocket s, or None."""
        mount = self.sprockets[s].mount
        return self.arm_index(mount.arm) if isinstance(mount, ArmMount) else None

    def parent(self, a: int) -> int | None:
        """Index of the arm that carries arm a, or None."""
        name = self.arms[a].arm
        return None if name is None else self.arm_index(name)

    def arms_on(self, a: int) -> tuple[int, ...]:
        """Indices of arms on arm a."""
        return tuple(k for k, arm in enumerate(self.arms) if arm.arm == self.arms[a].name)

    def masses_on(self, a: int) -> list[tuple[float, tuple[float, float]]]:
        """Masses [kg] and drawn places [m] of arm a and what it carries."""
        arm, carried = self.arms[a], (self.sprockets[s] for s in self.sprockets_on(a))
        found = [(arm.mass, arm.center), *((s.mass, s.center) for s in carried if s.mass is not None)]
        return found + [(sum(mass for mass, _ in self.masses_on(k)), self.arms[k].pivot) for k in self.arms_on(a)]

    def pivot_table(self, s: int) -> PlaceTable | None:
        """Table that leads sprocket s' pivot, or None."""
        arm = self.carrier(s)
        return None if arm is None else self.arms[arm].pivot_table

    def sprockets_on(self, a: int) -> tuple[int, ...]:
        """Indices of sprockets on arm a."""
        return tuple(s for s in range(len(self.sprockets)) if self.carrier(s) == a)

    def center_lever(self, s: int) -> float:
        """Distance of sprocket s from its arm's pivot [m]."""
        (x, y), (px, py) = self.sprockets[s].center, self.arms[self.carrier(s)].pivot  # type: ignore[index]
        return hypot(x - px, y - py)

    def arm_lever(self, a: int) -> float:
        """Largest distance of guided chain and sprockets from arm a's pivot [m]."""
        px, py = self.arms[a].pivot
        faces = [self.profile(g).points(self.chain.pitch, caps=False).tolist() for g in self.guides_of(a)]
        reach = maximum(0.0, *(hypot(px - x, py - y) for face in faces for x, y in face))
        reach = maximum(reach, *(self.center_lever(s) for s in self.sprockets_on(a)))
        beside = self.arms[a].center_radius
        return where(reach > 0.0, reach, where(beside > 0.0, beside, self.chain.pitch))

    def stop_stiffness(self, a: int) -> float:
        """Stiffness of arm a's stops [N m/rad]."""
        return stop_stiffness(self.arms[a], self.arm_lever(a), self.chain.stiffness, self.chain.mass)

    def stop_damping(self, a: int) -> float:
        """Damping of arm a's stops [N m s/rad]."""
        return stop_damping(self.arms[a], self.stop_stiffness(a))

    def arm_inertia(self, a: int) -> float:
        """Inertia of arm a and what it carries about its pivot [kg m^2]."""
        body, (px, py) = self.first_arm_body + a, self.arms[a].pivot
        carried = 0.0
        for s in self.sprockets_on(a):
            carried = carried + self.sprockets[s].mass * power(self.center_lever(s), 2)
        for k in self.arms_on(a):
            (x, y), mass = self.arms[k].pivot, sum(own for own, _ in self.masses_on(k))
            carried = carried + mass * power(hypot(x - px, y - py), 2)
        return self.arms[a].inertia + self.plunger_mass_on(body) + carried

    def plunger_mass_on(self, body: int) -> float:
        """Plungers' mass on a sprocket [kg], or inertia on an arm [kg m^2]."""
        tensioners = range(len(self.tensioners))
        on = (t for t in tensioners if self.tensioner_body(t) == body)
        return sum(self.tensioners[t].plunger_mass * power(self.tensioner_lever(t), 2) for t in on)

    def tensioner_lever(self, t: int) -> float:
        """Lever of tensioner t on an arm, 1 on a sprocket [m]."""
        tensioner = self.tensioners[t]
        arm = self.arm_index(tensioner.on)
        if arm is None:
            return 1.0
        (x, y), (dx, dy) = tensioner.at, tensioner.unit_direction
        px, py = self.arms[arm].pivot
        return (x - px) * dy - (y - py) * dx

    def tensioner_body(self, t: int) -> int:
        """Body number, of a sprocket or an arm, that tensioner t pushes."""
        name = self.tensioners[t].on
        arm = self.arm_index(name)
        if arm is not None:
            return self.first_arm_body + arm
        return next(s for s, sprocket in enumerate(self.sprockets) if sprocket.name == name)

    @computed_once
    def sprocket_stiffness(self, s: int) -> float:
        """Generalized contact stiffness of sprocket s, eq. (20), bush and pin in series; of an end a link's [N/m^n].

        Raises:
            DriveError: reference load beyond validity.
        """
        if self.sprockets[s].is_end:
            return self.chain.mean_stiffness
        law, chain = self.contact.sprocket, self.chain
        radii = (
            (chain.plate.flank_length, math.inf)
            if chain.is_silent
            else (chain.roller_radius, self.tooth(s).seat_radius)
        )
        tooth = contact_stiffness(law, *radii, "contact.sprocket")
        return tooth if law.bush_stiffness is None else 1.0 / (1.0 / tooth + 1.0 / law.bush_stiffness)

    @computed_once
    def guide_stiffness(self, g: int) -> float:
        """Generalized contact stiffness of guide g [N/m^n], eq. (20).

        Raises:
            DriveError: reference load beyond validity.
        """
        path = f"guides.{self.guides[g].name}.contact" if self.guides[g].contact is not None else "contact.guide"
        return contact_stiffness(self.guide_contact(g), self.chain.roller_radius, math.inf, path)
