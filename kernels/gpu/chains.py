"""Several chains of a variant on one block, one after the other: rollers, sprockets, guides and arms.

A roller's chain decides its neighbors, its partners, and the row of `Drive` of its state and sums. One chain needs no
look-up.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.link import chain_at_roller
from ..physics.strand_load import carried_relative_mass
from ..physics.toe import ENDS
from ..structs import GROUND, Drive
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .shared_memory import joint_rows, roller_rows, shared_rows


@dataclass(frozen=True)
class ChainFunctions:
    """Chain functions of a block."""

    chain_number: wp.Function
    chain_number_of_guide: wp.Function
    drive_row: wp.Function
    relative_mass: wp.Function
    set_own_mass: wp.Function
    chain_at: wp.Function
    chain_span: wp.Function
    own_chain_span: wp.Function
    next_roller: wp.Function
    previous_roller: wp.Function
    partners_of_chain: wp.Function
    contact_memory: wp.Function
    chain_length: wp.Function
    push_memory: wp.Function
    toe_memory: wp.Function
    strand_in_chain: wp.Function
    body_index: wp.Function
    body_on_block: wp.Function
    tensioner_count: wp.Function


@cache
def chain_functions(kind: BlockKind) -> ChainFunctions:
    """Chain functions of block kernels."""
    chain_count, sprockets, rotors = kind.parts.chains, kind.parts.sprockets, kind.parts.rotors
    several = chain_count > 1
    kinds = kind.types
    Ensemble, Shared = kinds.Ensemble, kinds.Shared
    Real = kind.Real
    access = row_access(Real)
    row, first_mass = roller_rows(kind), (shared_rows(kind.Real) + joint_rows(kind)) * kind.shape.slots

    @wp.func
    def chain_number(shared: Shared, j: int):
        """Number of the chain of roller j on a block; of the last chain for a roller beyond all."""
        number = int(0)
        for r in range(1, chain_count):
            number = number + wp.where(j >= shared.first_rollers[r - 1], 1, 0)
        return number

    @wp.func
    def chain_number_of_guide(shared: Shared, g: int):
        """Number of the chain of guide g on a block."""
        number = int(0)
        for r in range(1, chain_count):
            number = number + wp.where(g >= shared.chain_places[r].first_guide, 1, 0)
        return number

    @wp.func
    def drive_row(shared: Shared, mine: ThreadParts, j: int):
        """Row of the drives of the chain of roller j on a block."""
        return mine.variant + chain_number(shared, j)

    @wp.func
    def relative_mass(shared: Shared, j: int):
        """Mass of a block's roller j with goods on it, relative to its chain's; of links that vary."""
        position = kinds.vec2(access.load(shared.rows, row.x + j), access.load(shared.rows, row.y + j))
        carried = carried_relative_mass(position, shared.chains[chain_number(shared, j)].load)
        return access.load(shared.rows, first_mass + j) + carried

    @wp.func
    def set_own_mass(shared: Shared, j: int, value: Real):
        """Sets the relative mass of a block's roller j without goods, of links that vary."""
        access.store(shared.rows, first_mass + j, value)

    @wp.func
    def chain_at(shared: Shared, j: int):
        """Chain of roller j on a block, with that roller's mass."""
        if wp.static(kind.links == "varied"):
            relative = relative_mass(shared, j)
            return chain_at_roller(shared.chains[chain_number(shared, j)], relative, Real(1.0) / relative)
        else:
            return shared.chains[chain_number(shared, j)]

    @wp.func
    def span_of_chain(shared: Shared, r: int, n: int):
        """First roller and number of rollers of chain r on a block; `n` of all chains."""
        if wp.static(several):
            place = shared.chain_places[r]
            return place.first_roller, place.end_roller - place.first_roller
        else:
            return 0, n

    @wp.func
    def chain_span(shared: Shared, j: int, n: int):
        """First roller and number of rollers of the chain of a block's roller j; `n` of all chains."""
        first, count = span_of_chain(shared, chain_number(shared, j), n)
        return first, count

    @wp.func
    def own_chain_span(shared: Shared, mine: ThreadParts):
        """First roller and number of rollers of the chain of the thread's body."""
        first, count = span_of_chain(shared, mine.drive_row - mine.variant, mine.rollers)
        return first, count

    @wp.func
    def next_roller(shared: Shared, j: int, n: int):
        """Number of the block's roller after roller j in its chain, of `n`; a valid one where j is beyond all."""
        next = j + 1
        first = int(0)
        for r in range(1, chain_count):
            next = wp.where(j + 1 == shared.first_rollers[r - 1], first, next)
            first = shared.first_rollers[r - 1]
        return wp.where(j + 1 < n, next, first)

    @wp.func
    def previous_roller(shared: Shared, j: int, n: int):
        """Number of the block's roller before roller j in its chain, of `n`."""
        last = j - 1
        first = int(0)
        for r in range(1, chain_count):
            last = wp.where(j == first, shared.first_rollers[r - 1] - 1, last)
            first = shared.first_rollers[r - 1]
        return wp.where(j == first, n - 1, last)

    @wp.func
    def partners_of_chain(shared: Shared, j: int, mask: int):
        """Partners of `mask`, as bits, in the chain of a block's roller j."""
        if wp.static(several):
            return mask & shared.chain_places[chain_number(shared, j)].partners
        else:
            return mask

    @wp.func
    def contact_memory(shared: Shared, mine: ThreadParts, j: int, p: int):
        """Index of the contact memory of a block's roller j with partner p of its chain."""
        if wp.static(several):
            return shared.contact_begins[p] + j
        elif wp.static(kind.silent):
            of_sprockets = wp.min(p, sprockets) * ENDS + wp.max(p - sprockets, 0)
            return mine.first_contact + j + of_sprockets * mine.rollers
        else:
            return mine.first_contact + j + p * mine.rollers

    @wp.func
    def chain_length(shared: Shared, mine: ThreadParts, j: int):
        """Number of rollers of the chain of a block's roller j."""
        first, count = chain_span(shared, j, mine.rollers)
        return count

    @wp.func
    def push_memory(shared: Shared, mine: ThreadParts, j: int, at: int):
        """Index in `State.push` of the force of a block's pin j's flank end whose contact memory is at `at`."""
        if wp.static(several):
            place = shared.chain_places[chain_number(shared, j)]
            return at - place.first_contact + place.first_push
        else:
            return at - mine.first_contact + mine.first_push

    @wp.func
    def toe_memory(shared: Shared, mine: ThreadParts, j: int):
        """Index in `State.push` of the force of contacts on a block's pin j in x, and the offset of that in y."""
        if wp.static(several):
            place = shared.chain_places[chain_number(shared, j)]
            count = place.end_roller - place.first_roller
            contacts = place.sprockets * ENDS + place.backs
            return place.first_push + contacts * count + j - place.first_roller, count
        else:
            contacts = wp.static(sprockets * int(ENDS) + kind.parts.guides // 2)
            return mine.first_push + contacts * mine.rollers + j, mine.rollers

    @wp.func
    def strand_in_chain(shared: Shared, drive: Drive, j: int, strand: int):
        """Strand, or none, of a block's roller j's link in its chain `drive`, from that among all chains."""
        if wp.static(several):
            return wp.min(strand - shared.chain_places[chain_number(shared, j)].first_sprocket, drive.sprockets)
        else:
            return wp.min(strand, drive.sprockets)

    @wp.func
    def body_index(shared: Shared, first: int, b: int):
        """Index of a block's body b among all of the ensemble; the variant's begin at `first`."""
        if wp.static(several):
            return shared.body_indices[b]
        else:
            return first + b

    @wp.func
    def body_on_block(ensemble: Ensemble, shared: Shared, row: int, chain: int, b: int):
        """Body of the block that is body `b`, or the ground, of a chain in a row of the drives."""
        if wp.static(several):
            drive = ensemble.drives[row]
            arm = b - (drive.bodies - drive.arms)
            sprocket = shared.chain_places[chain].first_sprocket + b
            of_arm = rotors + shared.chain_places[chain].first_arm + arm
            of_shaft = sprockets + shared.chain_places[chain].first_shaft + b - drive.sprockets
            turning = wp.where(b < drive.sprockets, sprocket, of_shaft)
            return wp.where(b == GROUND, b, wp.where(arm >= 0, of_arm, turning))
        else:
            return b

    @wp.func
    def tensioner_count(drive: Drive):
        """Number of tensioners of a chain on a block."""
        if wp.static(several):
            return drive.tensioners
        else:
            return wp.static(kind.parts.tensioners)

    return ChainFunctions(
        chain_number=chain_number,
        chain_number_of_guide=chain_number_of_guide,
        drive_row=drive_row,
        relative_mass=relative_mass,
        set_own_mass=set_own_mass,
        chain_at=chain_at,
        chain_span=chain_span,
        own_chain_span=own_chain_span,
        next_roller=next_roller,
        previous_roller=previous_roller,
        partners_of_chain=partners_of_chain,
        contact_memory=contact_memory,
        chain_length=chain_length,
        push_memory=push_memory,
        toe_memory=toe_memory,
        strand_in_chain=strand_in_chain,
        body_index=body_index,
        body_on_block=body_on_block,
        tensioner_count=tensioner_count,
    )
