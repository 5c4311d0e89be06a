"""Places of the parts of each of several chains among those of a variant on a block."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.back import back_count
from .block_kinds import BlockKind
from .block_structs import MOST_CHAINS, ThreadParts
from .sync import sync_functions


@wp.func
def bit_range(first: int, count: int):
    """`count` bits from `first` on, as of a chain's partners on a block."""
    return ((1 << count) - 1) << first


@dataclass(frozen=True)
class ChainPlaceFunctions:
    """Chain place functions of a block."""

    among_chains: wp.Function
    first_rollers: wp.Function


@cache
def chain_place_functions(kind: BlockKind) -> ChainPlaceFunctions:
    """Chain place functions of block kernels."""
    chain_count, sprockets, rotors = kind.parts.chains, kind.parts.sprockets, kind.parts.rotors
    several, of_others = chain_count > 1, wp.types.vector(MOST_CHAINS - 1, int)
    kinds = kind.types
    Ensemble, Shared, ChainPlace = kinds.Ensemble, kinds.Shared, kinds.ChainPlace
    sync = sync_functions(kind)

    @wp.func
    def share_chain_place(ensemble: Ensemble, shared: Shared, variant: int, r: int):
        """Shares the place of chain r: of its rollers, partners and bodies."""
        whole, drive = ensemble.drives[variant], ensemble.drives[variant + r]
        place = ChainPlace()
        place.first_roller = drive.first_roller - whole.first_roller
        place.end_roller = place.first_roller + drive.rollers
        place.first_sprocket = drive.first_sprocket - whole.first_sprocket
        place.first_guide = drive.first_guide - whole.first_guide
        place.first_arm = drive.first_arm - whole.first_arm
        place.first_shaft = drive.first_shaft - whole.first_shaft
        place.first_push = drive.first_push
        place.backs = back_count(drive.points, drive.guides)
        place.first_contact = drive.first_contact
        place.sprockets = drive.sprockets
        bars = sprockets + place.first_guide
        place.partners = bit_range(place.first_sprocket, drive.sprockets) | bit_range(bars, drive.guides)
        shared.chain_places[r] = place
        for s in range(drive.sprockets):
            shared.body_indices[place.first_sprocket + s] = drive.first_body + s
            shared.contact_begins[place.first_sprocket + s] = (
                drive.first_contact + s * drive.points * drive.rollers - place.first_roller
            )
        for g in range(drive.guides):
            shared.contact_begins[bars + g] = (
                drive.first_contact + (drive.sprockets * drive.points + g) * drive.rollers - place.first_roller
            )
        for h in range(drive.shafts):
            shared.body_indices[sprockets + place.first_shaft + h] = drive.first_body + drive.sprockets + h
        for a in range(drive.arms):
            shared.body_indices[rotors + place.first_arm + a] = drive.first_body + drive.bodies - drive.arms + a

    @wp.func
    def among_chains(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Thread's parts among those of all chains, whose places it shares first; all threads together."""
        if wp.static(several):
            if mine.thread < chain_count:
                share_chain_place(ensemble, shared, mine.variant, mine.thread)
            sync.barrier()
            mine.rollers = shared.chain_places[wp.static(chain_count - 1)].end_roller
            mine.sprocket = wp.where(mine.body < sprockets, mine.body, -1)
            mine.arm = wp.max(mine.body - rotors, -1)
            if mine.body >= 0:
                place = shared.body_indices[mine.body]
                for r in range(chain_count):
                    if place >= ensemble.drives[mine.variant + r].first_body:
                        mine.drive_row = mine.variant + r
                mine.body_number = place - ensemble.drives[mine.drive_row].first_body
        return mine

    @wp.func
    def first_rollers(shared: Shared):
        """First roller of each chain but the first, from shared places."""
        begins = of_others()
        for r in range(1, chain_count):
            begins[r - 1] = shared.chain_places[r].first_roller
        return begins

    return ChainPlaceFunctions(among_chains=among_chains, first_rollers=first_rollers)
