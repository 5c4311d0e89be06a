"""A drive with its chains, and how they turn each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from warpchain.drive import Drive
from warpchain.drive.body_ties import ratios_with_chains
from warpchain.drive.stack_math import Number
from warpchain.model.chain_model import ChainModel
from warpchain.model.chain_models import chain_models
from warpchain.model.parts_between_chains import SprocketShaft

ChainBody = tuple[int, int]
"""Chain's index and body's number in it."""


@dataclass(frozen=True)
class Model:
    """A drive, or a stack, with its chains."""

    drive: Drive

    @cached_property
    def chains(self) -> tuple[ChainModel, ...]:
        """Models of the drive's chains."""
        return chain_models(self.drive)

    @cached_property
    def loaded_chains(self) -> tuple[ChainModel, ...]:
        """Models of the drive's chains, sprocket shafts with loads."""
        return chain_models(self.drive, loaded=True)

    @property
    def chain(self) -> ChainModel:
        """Model of the drive's only chain.

        Raises:
            DriveError: there are several.
        """
        self.drive.require_single_chain()
        return self.chains[0]

    @property
    def driver_speed(self) -> Number:
        """Top speed of the drive's driver [rad/s]."""
        driver = self.drive.driver
        prescribed = self.drive.sprockets[driver].prescribed
        if prescribed is not None:
            return prescribed.top_speed
        chain, s = self.chain_of_sprocket(driver)
        speed = chain.driver_speed
        return speed if s == chain.driver else speed * chain.sprockets[chain.driver].teeth / chain.sprockets[s].teeth

    @property
    def driver_ratios(self) -> list[float]:
        """Speed of each chain's driver over the drive's."""
        drivers = [chain.places["sprockets"][chain.driver] for chain in self.chains]
        return [self.speed_ratio(driver, self.drive.driver) for driver in drivers]

    @property
    def shaft_ratios(self) -> dict[str, float]:
        """Speeds of shafts over the driver's, by name."""
        shafts = enumerate(self.drive.shafts, len(self.drive.sprockets))
        return {shaft.name: self.speed_ratio(b, self.drive.driver) for b, shaft in shafts}

    @property
    def shared_bodies(self) -> list[tuple[ChainBody, ChainBody]]:
        """Pairs of one body: home chain's shaft, other chain's sprocket."""
        sprockets = {of.name: (r, k) for r, chain in enumerate(self.chains) for k, of in enumerate(chain.sprockets)}
        return [
            ((r, b), sprockets[shaft.name])
            for r, chain in enumerate(self.chains)
            for b, shaft in enumerate(chain.shafts, len(chain.sprockets))
            if isinstance(shaft, SprocketShaft)
        ]

    def speed_ratio(self, b: int, other: int) -> float:
        """Forward speed of a body over another's; 1 if untied."""
        found, _ = ratios_with_chains(self.drive)
        return abs(float(found.ratio[b] / found.ratio[other])) if found.root[b] == found.root[other] else 1.0

    def chain_of_sprocket(self, s: int) -> tuple[ChainModel, int]:
        """Chain of sprocket s of the drive, and its index there."""
        around = next(chain for chain in self.chains if s in chain.places["sprockets"])
        return around, around.places["sprockets"].index(s)

    def bodies_of_chain(self, chain: ChainModel) -> list[int]:
        """Numbers in the drive of a chain's bodies."""
        count, names = len(self.drive.sprockets), [sprocket.name for sprocket in self.drive.sprockets]
        shafts = [count + h for h in chain.places["shafts"]]
        shafts += [names.index(shaft.name) for shaft in chain.shafts if isinstance(shaft, SprocketShaft)]
        first_arm = count + len(self.drive.shafts)
        return [*chain.places["sprockets"], *shafts, *(first_arm + a for a in chain.places["arms"])]


def chains_of(of: Drive | ChainModel) -> tuple[ChainModel, ...]:
    """Models of a drive's chains; of a chain, itself."""
    return (of,) if isinstance(of, ChainModel) else Model(of).chains


def single_chain(of: Drive | ChainModel) -> ChainModel:
    """Model of a drive's only chain, or a chain itself.

    Raises:
        DriveError: there are several.
    """
    return of if isinstance(of, ChainModel) else Model(of).chain
