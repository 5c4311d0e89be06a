"""`ChainModel`: one chain of a drive with the parts that belong to it, and what follows from their values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from warpchain.drive.arms import Arm, stop_damping, stop_stiffness
from warpchain.drive.body_ties import driving_sprocket
from warpchain.drive.chain import Chain
from warpchain.drive.contact_settings import Contact, GuideContact, merged_contact_values
from warpchain.drive.face_profile import Profile
from warpchain.drive.guides import Guide, guide_profile
from warpchain.drive.motion_table import PlaceTable
from warpchain.drive.run_settings import Probe, RunSettings
from warpchain.drive.shafts import Coupling, Gear, Shaft
from warpchain.drive.sprocket import ArmMount, Sprocket
from warpchain.drive.sprocket_teeth import is_catching, pitch_radius, sprocket_tooth, tooth_pitch
from warpchain.drive.stack_math import arcsin, hypot, maximum, power, sqrt, where
from warpchain.drive.stiffness import contact_stiffness
from warpchain.drive.tensioners import Tensioner
from warpchain.drive.tooth_shape import Tooth
from warpchain.drive.valves import Valves
from warpchain.model.parts_between_chains import SprocketShaft
from warpchain.model.train_speeds import driver_top_speed


@dataclass(frozen=True)
class ChainModel:
    """One chain of a drive, or of a stack of drives, with the parts that belong to it.

    Its bodies are its sprockets, then its shafts, then its arms. Numbers of a stack that differ among its variants are
    arrays (V,), and so is what follows from them.

    Attributes:
        name: of the chain, "" where it is the only one.
        chain: its links.
        sprockets: (S,) in the order in which it visits them; the first that is prescribed leads it. Where none is, the
            one that another chain turns counts as prescribed (`LedSprocket`).
        guides: (G,) guides.
        arms: (A,) bodies that turn about a pivot.
        tensioners: (T,) what pushes its arms, or its sprockets on sliders.
        contact: contact settings.
        run: run settings; its phase is that of the sprocket that leads the chain.
        probes: places at which it is looked at.
        shafts: (H,) shafts of which this is the home (`warpchain.model.chain_models`), then those that stand for other
            chains' sprockets (`SprocketShaft`).
        gears, couplings, valves: those between and on its shafts.
        places: by list, `CHAIN_PARTS` and `TRAIN_PARTS`, the places of its parts in the whole drive.
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

    @property
    def links(self) -> int:
        """Number of the chain's links."""
        return self.chain.links

    @property
    def driver(self) -> int:
        """Index of the sprocket that drives: the first prescribed one, or the nearest to the shaft that drives."""
        prescribed = (s for s, sprocket in enumerate(self.sprockets) if sprocket.prescribed is not None)
        first = next(prescribed, None)
        return driving_sprocket(self) if first is None else first

    @property
    def driver_speed(self) -> Any:
        """Top speed of the driver [rad/s], its harmonics aside; with a motor, about the speed where moments balance."""
        prescribed = self.sprockets[self.driver].prescribed
        return driver_top_speed(self) if prescribed is None else prescribed.top_speed

    @property
    def chain_speed(self) -> Any:
        """Speed of the chain [m/s] where the driver turns at its top speed, its harmonics aside."""
        return abs(self.driver_speed) * self.pitch_radius(self.driver)

    @property
    def own_shafts(self) -> tuple[Shaft, ...]:
        """The shafts but for those that stand for other chains' sprockets; they stand first."""
        return tuple(shaft for shaft in self.shafts if not isinstance(shaft, SprocketShaft))

    @property
    def strand_names(self) -> tuple[str, ...]:
        """(S,) "FROM->TO": strand k leaves sprocket k and reaches the next."""
        names = [sprocket.name for sprocket in self.sprockets]
        return tuple(f"{a}->{b}" for a, b in zip(names, names[1:] + names[:1], strict=True))

    @property
    def first_arm_body(self) -> int:
        """Number of the first arm among the bodies: sprockets, shafts, arms."""
        return len(self.sprockets) + len(self.shafts)

    def sprocket_pitch(self, s: int) -> float:
        """Pitch of the teeth of sprocket s [m]: its own, or else the chain's."""
        return tooth_pitch(self.sprockets[s], self.chain)

    def pitch_radius(self, s: int) -> float:
        """Radius of the circle of sprocket s on which its seats lie [m]: p / (2 sin(pi/z))."""
        return pitch_radius(self.sprockets[s], self.chain)

    def riding_radius(self, s: int) -> float:
        """Radius at which the rollers ride on sprocket s [m]: in their seats, or on the flanks where links are longer.

        Links of the length l that take a tooth each span the pitch angle at l / (2 sin(pi/z)); an outer and an inner
        link of unlike lengths l, l' span two of them, a = 4 pi/z, at sqrt(l^2 + l'^2 + 2 l l' cos(a/2)) / (2 sin(a/2)).
        """
        half = math.pi / self.sprockets[s].teeth
        alone = maximum(self.sprocket_pitch(s), self.chain.worn_pitch) / (2.0 * math.sin(half))
        if self.chain.outer is None:
            return alone
        inner, outer = self.chain.pulled_pair
        over_both = sqrt(power(inner, 2) + power(outer, 2) + 2.0 * inner * outer * math.cos(2.0 * half))
        return where(inner == outer, alone, maximum(self.pitch_radius(s), over_both / (2.0 * math.sin(2.0 * half))))

    def riding_lean(self, s: int) -> float:
        """Angle [rad] by which outer links on sprocket s reach beyond a tooth at either end, and inner ones fall short.

        Where rollers ride above their seats, links of unlike lengths span unlike angles, 2 asin(l / 2R): roller i
        stands that angle before the middle of its gap if i is even, as outer links begin there, else after it.
        """
        if self.chain.outer is None:
            return 0.0
        inner, outer = self.chain.pulled_pair
        radius = self.riding_radius(s)
        lean = 0.5 * (arcsin(0.5 * outer / radius) - arcsin(0.5 * inner / radius))
        return where((inner == outer) | (radius <= self.pitch_radius(s)), 0.0, lean)

    def tooth(self, s: int) -> Tooth:
        """The tooth gap of sprocket s: its own, or the contact's, or that of ISO 606 for its teeth."""
        return sprocket_tooth(self.sprockets[s], self.chain, self.contact.sprocket)

    def seat_angle(self, s: int) -> float:
        """Angle of the seat arc of sprocket s [rad]."""
        return self.tooth(s).seat_angle

    def tip_radius(self, s: int) -> float:
        """Radius at which the teeth of sprocket s end [m]."""
        return self.tooth(s).tip_radius

    def engagement(self, s: int) -> float:
        """Distance from the pitch circle of sprocket s within which it keeps rollers [m]: half a pitch, or to the tips.

        The maximum gap of ISO 606 has teeth that reach 0.625 pitches beyond it.
        """
        reach = self.tip_radius(s) + self.chain.roller_radius - self.pitch_radius(s)
        return maximum(0.5 * self.chain.pitch, reach)

    def catching_sprockets(self) -> tuple[int, ...]:
        """Indices of sprockets whose straight flanks do not let a strand's rollers go (`drive.tooth_shape`)."""
        of = enumerate(self.sprockets)
        return tuple(s for s, sprocket in of if is_catching(sprocket, self.chain, self.tooth(s)))

    def guide_contact(self, g: int) -> GuideContact:
        """Contact settings of guide-bar g: the common ones with its own put over them."""
        common, own = self.contact.guide, self.guides[g].contact
        assert common is not None  # the drive's own rule
        return common if own is None else GuideContact.model_construct(**merged_contact_values(common, own))

    def profile(self, g: int) -> Profile:
        """The face of guide g as drawn: at its arm's angle 0 (`warpchain.drive.face_profile`)."""
        profile = guide_profile(self.guides[g], self.chain.pitch)
        assert profile is not None  # the guide's own rules
        return profile

    def guide_offset(self, g: int) -> float:
        """Height of a touching roller's center over the face of guide g [m]: its own, or the rollers' radius."""
        own = self.guides[g].offset
        return self.chain.roller_radius if own is None else own

    def arm_index(self, name: str) -> int | None:
        """Index of the arm of a name; None if there is none."""
        return next((a for a, arm in enumerate(self.arms) if arm.name == name), None)

    def arm_of(self, g: int) -> int | None:
        """Index of the arm that carries guide g; None on the ground."""
        name = self.guides[g].arm
        return None if name is None else self.arm_index(name)

    def guides_of(self, a: int) -> tuple[int, ...]:
        """Indices of the guides that arm a carries."""
        return tuple(g for g, guide in enumerate(self.guides) if guide.arm == self.arms[a].name)

    def carrier(self, s: int) -> int | None:
        """Index of the arm that carries sprocket s; None where none does."""
        mount = self.sprockets[s].mount
        return self.arm_index(mount.arm) if isinstance(mount, ArmMount) else None

    def parent(self, a: int) -> int | None:
        """Index of the arm that carries arm a; None on the ground."""
        name = self.arms[a].arm
        return None if name is None else self.arm_index(name)

    def arms_on(self, a: int) -> tuple[int, ...]:
        """Indices of the arms that arm a carries."""
        return tuple(k for k, arm in enumerate(self.arms) if arm.arm == self.arms[a].name)

    def masses_on(self, a: int) -> list[tuple[float, tuple[float, float]]]:
        """Masses [kg] and places, as drawn, of arm a, of sprockets on it and, at their pivots, of arms on it."""
        arm, carried = self.arms[a], (self.sprockets[s] for s in self.sprockets_on(a))
        found = [(arm.mass, arm.center), *((s.mass, s.center) for s in carried if s.mass is not None)]
        return found + [(sum(mass for mass, _ in self.masses_on(k)), self.arms[k].pivot) for k in self.arms_on(a)]

    def pivot_table(self, s: int) -> PlaceTable | None:
        """Table that leads the pivot of the arm that carries sprocket s; None where nothing does."""
        arm = self.carrier(s)
        return None if arm is None else self.arms[arm].pivot_table

    def sprockets_on(self, a: int) -> tuple[int, ...]:
        """Indices of the sprockets that arm a carries."""
        return tuple(s for s in range(len(self.sprockets)) if self.carrier(s) == a)

    def center_lever(self, s: int) -> float:
        """Distance of sprocket s from the pivot of the arm that carries it [m]."""
        (x, y), (px, py) = self.sprockets[s].center, self.arms[self.carrier(s)].pivot  # type: ignore[index]
        return hypot(x - px, y - py)

    def arm_lever(self, a: int) -> float:
        """Largest distance of guided chain and of sprockets' centers from the pivot of arm a [m]; where it carries
        neither, that of its center of mass.
        """
        px, py = self.arms[a].pivot
        faces = [self.profile(g).points(self.chain.pitch, caps=False).tolist() for g in self.guides_of(a)]
        reach = maximum(0.0, *(hypot(px - x, py - y) for face in faces for x, y in face))
        reach = maximum(reach, *(self.center_lever(s) for s in self.sprockets_on(a)))
        beside = self.arms[a].center_radius
        return where(reach > 0.0, reach, where(beside > 0.0, beside, self.chain.pitch))

    def stop_stiffness(self, a: int) -> float:
        """Stiffness of the stops of arm a [N m/rad]: its own, or what `arms.stop_stiffness` chooses."""
        return stop_stiffness(self.arms[a], self.arm_lever(a), self.chain.stiffness, self.chain.mass)

    def stop_damping(self, a: int) -> float:
        """Damping of the stops of arm a [N m s/rad]: its own, or half the critical one."""
        return stop_damping(self.arms[a], self.stop_stiffness(a))

    def arm_inertia(self, a: int) -> float:
        """Inertia of arm a about its pivot [kg m^2], with plungers that move with it, sprockets' masses at their levers
        and those of arms on it at their pivots.
        """
        body, (px, py) = self.first_arm_body + a, self.arms[a].pivot
        carried = 0.0
        for s in self.sprockets_on(a):
            carried = carried + self.sprockets[s].mass * power(self.center_lever(s), 2)
        for k in self.arms_on(a):
            (x, y), mass = self.arms[k].pivot, sum(own for own, _ in self.masses_on(k))
            carried = carried + mass * power(hypot(x - px, y - py), 2)
        return self.arms[a].inertia + self.plunger_mass_on(body) + carried

    def plunger_mass_on(self, body: int) -> float:
        """Mass that the plungers on a body add to it [kg], or inertia that they add to an arm [kg m^2]."""
        tensioners = range(len(self.tensioners))
        on = (t for t in tensioners if self.tensioner_body(t) == body)
        return sum(self.tensioners[t].plunger_mass * power(self.tensioner_lever(t), 2) for t in on)

    def tensioner_lever(self, t: int) -> float:
        """Lever of tensioner t about its arm's pivot as drawn [m]; 1 on a sprocket, which it only shifts."""
        tensioner = self.tensioners[t]
        arm = self.arm_index(tensioner.on)
        if arm is None:
            return 1.0
        (x, y), (dx, dy) = tensioner.at, tensioner.unit_direction
        px, py = self.arms[arm].pivot
        return (x - px) * dy - (y - py) * dx

    def tensioner_body(self, t: int) -> int:
        """The body that tensioner t pushes: a sprocket's index, or an arm's from `first_arm_body` on."""
        name = self.tensioners[t].on
        arm = self.arm_index(name)
        if arm is not None:
            return self.first_arm_body + arm
        return next(s for s, sprocket in enumerate(self.sprockets) if sprocket.name == name)

    def sprocket_stiffness(self, s: int) -> float:
        """Generalized stiffness of the contact of rollers with sprocket s [N/m^n], given or from materials (eq. (20)).

        The roller, of radius R1, lies in a seat of radius R2; both count as convex, as in the paper. Bush and pin, if
        their stiffness is given, stand in series with that.

        Raises:
            DriveError: if the reference load is beyond the formula's validity; the message names the key.
        """
        law, radius = self.contact.sprocket, self.chain.roller_radius
        tooth = contact_stiffness(law, radius, self.tooth(s).seat_radius, "contact.sprocket")
        return tooth if law.bush_stiffness is None else 1.0 / (1.0 / tooth + 1.0 / law.bush_stiffness)

    def guide_stiffness(self, g: int) -> float:
        """Generalized stiffness of the contact of rollers with guide-bar g [N/m^n], given or from materials (eq. (20)).

        The bar counts as flat, also at its rounded ends.

        Raises:
            DriveError: if the reference load is beyond the formula's validity; the message names the key.
        """
        path = f"guides.{self.guides[g].name}.contact" if self.guides[g].contact is not None else "contact.guide"
        return contact_stiffness(self.guide_contact(g), self.chain.roller_radius, math.inf, path)
