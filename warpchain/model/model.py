"""`Model`: a drive as a whole with its chains, and how they turn each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from warpchain.drive import Drive
from warpchain.drive.body_ties import ratios_with_chains
from warpchain.model.chain_model import ChainModel
from warpchain.model.chain_models import chain_models
from warpchain.model.parts_between_chains import SprocketShaft

ChainBody = tuple[int, int]
"""A body of a chain: the chain's number and its own among the chain's bodies."""


@dataclass(frozen=True)
class Model:
    """A drive, or a stack of drives, with its chains, one or more, and how they turn each other.

    The bodies of the whole drive are its sprockets, then its shafts, then its arms.

    Attributes:
        drive: what the file says.
    """

    drive: Drive

    @cached_property
    def chains(self) -> tuple[ChainModel, ...]:
        """The chains, in the file's order."""
        return chain_models(self.drive)

    @cached_property
    def loaded_chains(self) -> tuple[ChainModel, ...]:
        """The chains, each with the loads that other chains' sprockets on its shafts turn: for figures before a run."""
        return chain_models(self.drive, loaded=True)

    @property
    def chain(self) -> ChainModel:
        """The chain of a drive that has one.

        Raises:
            DriveError: there are several.
        """
        self.drive.require_single_chain()
        return self.chains[0]

    @property
    def driver_speed(self) -> Any:
        """Top speed of the drive's driver [rad/s], as `ChainModel.driver_speed`."""
        driver = self.drive.driver
        prescribed = self.drive.sprockets[driver].prescribed
        if prescribed is not None:
            return prescribed.top_speed
        chain, s = self.chain_of_sprocket(driver)
        speed = chain.driver_speed
        return speed if s == chain.driver else speed * chain.sprockets[chain.driver].teeth / chain.sprockets[s].teeth

    @property
    def driver_ratios(self) -> list[float]:
        """Speed of the sprocket that drives each chain over that of the drive's driver."""
        drivers = [chain.places["sprockets"][chain.driver] for chain in self.chains]
        return [self.speed_ratio(driver, self.drive.driver) for driver in drivers]

    @property
    def shaft_ratios(self) -> dict[str, float]:
        """Speeds of the shafts over that of the drive's driver, by name."""
        shafts = enumerate(self.drive.shafts, len(self.drive.sprockets))
        return {shaft.name: self.speed_ratio(b, self.drive.driver) for b, shaft in shafts}

    @property
    def shared_bodies(self) -> list[tuple[ChainBody, ChainBody]]:
        """Pairs of bodies that are one: the shaft of its home chain, and the sprocket in another chain."""
        sprockets = {of.name: (r, k) for r, chain in enumerate(self.chains) for k, of in enumerate(chain.sprockets)}
        return [
            ((r, b), sprockets[shaft.name])
            for r, chain in enumerate(self.chains)
            for b, shaft in enumerate(chain.shafts, len(chain.sprockets))
            if isinstance(shaft, SprocketShaft)
        ]

    def speed_ratio(self, b: int, other: int) -> float:
        """Forward speed of sprocket or shaft b over that of another; 1 where nothing ties them."""
        found, _ = ratios_with_chains(self.drive)
        return abs(float(found.ratio[b] / found.ratio[other])) if found.root[b] == found.root[other] else 1.0

    def chain_of_sprocket(self, s: int) -> tuple[ChainModel, int]:
        """The chain around sprocket s of the whole drive, and the sprocket's index there."""
        around = next(chain for chain in self.chains if s in chain.places["sprockets"])
        return around, around.places["sprockets"].index(s)

    def bodies_of_chain(self, chain: ChainModel) -> list[int]:
        """Numbers in the whole drive of a chain's bodies; a shaft that stands for a sprocket has the sprocket's."""
        count, names = len(self.drive.sprockets), [sprocket.name for sprocket in self.drive.sprockets]
        shafts = [count + h for h in chain.places["shafts"]]
        shafts += [names.index(shaft.name) for shaft in chain.shafts if isinstance(shaft, SprocketShaft)]
        first_arm = count + len(self.drive.shafts)
        return [*chain.places["sprockets"], *shafts, *(first_arm + a for a in chain.places["arms"])]


def chains_of(of: Drive | ChainModel) -> tuple[ChainModel, ...]:
    """The chains of a drive, or of a stack of drives; of a chain, that alone."""
    return (of,) if isinstance(of, ChainModel) else Model(of).chains


def single_chain(of: Drive | ChainModel) -> ChainModel:
    """The chain of a drive that has one, or a chain itself.

    Raises:
        DriveError: a drive of several.
    """
    return of if isinstance(of, ChainModel) else Model(of).chain
