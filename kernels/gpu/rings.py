"""Several chains of a variant on one block, where they stand as one: rollers, sprockets, guides and arms of all chains
one after the other, those of the first chain first.

So all threads are at work on all chains at once, and bodies of one shaft pass on moments as trains do. Which chain a
roller is of decides its neighbors, what it may touch, and where the state and the sums have what is its own: each chain
is a row of `Drive`, and lies there as if it were alone. With one chain nothing is looked up.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..structs import GROUND, Drive
from .kind import MOST_CHAINS, BlockKind, Mine
from .sync import sync


@cache
def block_rings(kind: BlockKind) -> SimpleNamespace:
    """The functions by which the chains of one variant on a block are kept apart."""
    rings, sprockets, mounted = kind.parts.rings, kind.parts.sprockets, kind.parts.mounted
    several, of_others = rings > 1, wp.types.vector(MOST_CHAINS - 1, int)
    kinds = kind.types
    Ensemble, Shared, Ring = kinds.Ensemble, kinds.Shared, kinds.Ring
    barrier = sync(kind).barrier

    @wp.func
    def bits(first: int, count: int):
        """So many bits from `first` on."""
        return ((1 << count) - 1) << first

    @wp.func
    def share_ring(ensemble: Ensemble, shared: Shared, variant: int, r: int):
        """Shares where the rollers, partners and bodies of chain r are."""
        whole, drive = ensemble.drives[variant], ensemble.drives[variant + r]
        ring = Ring()
        ring.first = drive.first_roller - whole.first_roller
        ring.end = ring.first + drive.rollers
        ring.sprocket = drive.first_sprocket - whole.first_sprocket
        ring.guide = drive.first_guide - whole.first_guide
        ring.arm = drive.first_arm - whole.first_arm
        ring.shaft = drive.first_shaft - whole.first_shaft
        bars = wp.static(sprockets) + ring.guide
        ring.partners = bits(ring.sprocket, drive.sprockets) | bits(bars, drive.guides)
        shared.rings[r] = ring
        for s in range(drive.sprockets):
            shared.places[ring.sprocket + s] = drive.first_body + s
            shared.memories[ring.sprocket + s] = drive.first_contact + s * drive.rollers - ring.first
        for g in range(drive.guides):
            shared.memories[bars + g] = drive.first_contact + (drive.sprockets + g) * drive.rollers - ring.first
        for h in range(drive.shafts):
            shared.places[wp.static(sprockets) + ring.shaft + h] = drive.first_body + drive.sprockets + h
        for a in range(drive.arms):
            shared.places[wp.static(mounted) + ring.arm + a] = drive.first_body + drive.bodies - drive.arms + a

    @wp.func
    def among(ensemble: Ensemble, shared: Shared, mine: Mine):
        """`mine` among the parts of all chains, which are shared before; all threads together."""
        if wp.static(several):
            if mine.thread < wp.static(rings):
                share_ring(ensemble, shared, mine.variant, mine.thread)
            barrier()
            mine.rollers = shared.rings[wp.static(rings - 1)].end
            mine.sprocket = wp.where(mine.body < wp.static(sprockets), mine.body, -1)
            mine.arm = wp.max(mine.body - wp.static(mounted), -1)
            if mine.body >= 0:
                place = shared.places[mine.body]
                for r in range(wp.static(rings)):
                    if place >= ensemble.drives[mine.variant + r].first_body:
                        mine.row = mine.variant + r
                mine.number = place - ensemble.drives[mine.row].first_body
        return mine

    @wp.func
    def begins_of(shared: Shared):
        """The first roller of each chain but the first, which a thread keeps; the chains are shared before."""
        begins = of_others()
        for r in range(1, wp.static(rings)):
            begins[r - 1] = shared.rings[r].first
        return begins

    @wp.func
    def ring_of(shared: Shared, j: int):
        """The number of roller j's chain; beyond all, of the last."""
        ring = int(0)
        for r in range(1, wp.static(rings)):
            ring = ring + wp.where(j >= shared.begins[r - 1], 1, 0)
        return ring

    @wp.func
    def ring_of_guide(shared: Shared, g: int):
        """The number of guide g's chain."""
        ring = int(0)
        if wp.static(several):
            for r in range(1, wp.static(rings)):
                ring = ring + wp.where(g >= shared.rings[r].guide, 1, 0)
        return ring

    @wp.func
    def row_of(shared: Shared, mine: Mine, j: int):
        """The row of roller j's chain among the drives."""
        return mine.variant + ring_of(shared, j)

    @wp.func
    def chain_at(shared: Shared, j: int):
        """Roller j's chain."""
        return shared.chain[ring_of(shared, j)]

    @wp.func
    def span_of(shared: Shared, j: int, n: int):
        """The first roller of roller j's chain, and how many it has; all have `n`."""
        if wp.static(several):
            ring = shared.rings[ring_of(shared, j)]
            return ring.first, ring.end - ring.first
        else:
            return 0, n

    @wp.func
    def own_span(shared: Shared, mine: Mine):
        """The same of the chain on the thread's body."""
        if wp.static(several):
            ring = shared.rings[mine.row - mine.variant]
            return ring.first, ring.end - ring.first
        else:
            return 0, mine.rollers

    @wp.func
    def next_to(shared: Shared, j: int, n: int):
        """The roller after roller j; one that there is where j is beyond all, which are n."""
        next = j + 1
        first = int(0)
        for r in range(1, wp.static(rings)):
            next = wp.where(j + 1 == shared.begins[r - 1], first, next)
            first = shared.begins[r - 1]
        return wp.where(j + 1 < n, next, first)

    @wp.func
    def last_to(shared: Shared, j: int, n: int):
        """The roller before roller j, of n in all."""
        last = j - 1
        first = int(0)
        for r in range(1, wp.static(rings)):
            last = wp.where(j == first, shared.begins[r - 1] - 1, last)
            first = shared.begins[r - 1]
        return wp.where(j == first, n - 1, last)

    @wp.func
    def partners_of(shared: Shared, j: int, mask: int):
        """Those of the partners `mask`, as bits, that are of roller j's chain."""
        if wp.static(several):
            return mask & shared.rings[ring_of(shared, j)].partners
        else:
            return mask

    @wp.func
    def memory_of(shared: Shared, mine: Mine, j: int, p: int):
        """The contact memory of roller j with partner p, which is of its chain."""
        if wp.static(several):
            return shared.memories[p] + j
        else:
            return mine.memory + j + p * mine.rollers

    @wp.func
    def strand_in(shared: Shared, drive: Drive, j: int, strand: int):
        """Strand, or none, of roller j's link in its chain `drive`, from that among all."""
        if wp.static(several):
            return wp.min(strand - shared.rings[ring_of(shared, j)].sprocket, drive.sprockets)
        else:
            return strand

    @wp.func
    def place_of(shared: Shared, first: int, b: int):
        """Body b's place among all bodies of the ensemble; the variant's begin at `first`."""
        if wp.static(several):
            return shared.places[b]
        else:
            return first + b

    @wp.func
    def body_of(ensemble: Ensemble, shared: Shared, row: int, ring: int, b: int):
        """The body among those of the variant that is body `b`, or the ground, of its chain in a row of the drives."""
        if wp.static(several):
            drive = ensemble.drives[row]
            arm = b - (drive.bodies - drive.arms)
            sprocket = shared.rings[ring].sprocket + b
            of_arm = wp.static(mounted) + shared.rings[ring].arm + arm
            of_shaft = wp.static(sprockets) + shared.rings[ring].shaft + b - drive.sprockets
            turning = wp.where(b < drive.sprockets, sprocket, of_shaft)
            return wp.where(b == GROUND, b, wp.where(arm >= 0, of_arm, turning))
        else:
            return b

    @wp.func
    def tensioners_of(drive: Drive):
        """The number of tensioners of a chain."""
        if wp.static(several):
            return drive.tensioners
        else:
            return wp.static(kind.parts.tensioners)

    return SimpleNamespace(**locals())
