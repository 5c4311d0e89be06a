"""Settling on blocks of threads: `relax` with one roller a thread, one block a variant."""

from functools import cache

import warp as wp

from .block_forces import block_forces
from .exchange import barrier, lanes
from .relax import LOOK_EVERY, Settling
from .structs import Wheel, types
from .sum_structs import Tallies
from .trigonometry import sine_cosine


@cache
def block_relax_kernel(Real: type, threads: int, sprockets: int, guides: int, blocks: int) -> wp.Kernel:
    """The kernel that settles drives of up to `threads` rollers and of these numbers of sprockets and guide-bars.

    The sprockets are held.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    part = block_forces(Real, threads, sprockets, guides)
    talk = part.talk
    State = talk.state
    shared_arrays, state_of_next, force_of_previous = talk.shared_arrays, talk.state_of_next, talk.force_of_previous
    warp_sum, warp_max = talk.warp_sum, talk.warp_max
    link_of, contacts, store_mesh, move = part.link_of, part.contacts, part.store_mesh, part.move
    share_geometry = part.share_geometry
    engaged, fetch, put_back = part.engaged, part.fetch, part.put_back

    @wp.func
    def start_sprocket(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, variant: int, s: int):
        """What is shared of sprocket s, at rest, and with the first of the chain."""
        mine = ensemble.drives[variant].first_sprocket + s
        body = state.sprockets[mine]
        sine, cosine = sine_cosine(body.angle)
        wheel = Wheel()
        wheel.cosine = cosine
        wheel.sine = sine
        wheel.center = body.center
        shared.wheels[s] = wheel
        share_geometry(ensemble, shared, variant, s, body.center)

    @wp.func
    def block_largest(shared: kinds.Shared, value: Real, i: int):
        """The largest `value` of all threads."""
        barrier()
        largest = warp_max(value)
        if i % lanes() == 0:
            shared.parts[i // lanes()] = wp.float64(largest)
        barrier()
        result = shared.parts[0]
        for w in range(1, wp.static(threads) // lanes()):
            result = wp.max(result, shared.parts[w])
        barrier()
        return result

    @wp.func
    def block_total(shared: kinds.Shared, value: Real, i: int):
        """The sum of `value` over all threads."""
        barrier()
        total = warp_sum(value)
        if i % lanes() == 0:
            shared.parts[i // lanes()] = wp.float64(total)
        barrier()
        result = wp.float64(0.0)
        for w in range(wp.static(threads) // lanes()):
            result = result + shared.parts[w]
        barrier()
        return result

    @wp.kernel(enable_backward=False, module="unique", grid_stride=False, launch_bounds=(threads, blocks))
    def relax_block(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        settling: wp.array(dtype=Settling),
        order: wp.array(dtype=wp.int32),
        block: int,
    ):
        """Variants `order[b]`, one a block of threads: up to `block` steps of relaxation."""
        variant = order[wp.tid() // wp.static(threads)]
        i = wp.tid() % wp.static(threads)
        n = ensemble.drives[variant].rollers
        live = i < n
        shared = shared_arrays(state, ensemble.drives[variant].first_roller, n)
        own = fetch(ensemble, state, variant, i)
        length = ensemble.lengths[ensemble.drives[variant].first_roller + wp.min(i, n - 1)]
        mesh = engaged(ensemble, state, variant, i)
        if i < wp.static(sprockets):
            start_sprocket(ensemble, state, shared, variant, i)
        now = settling[variant]
        end = wp.min(now.steps + block, now.limit)
        h = Real(now.step)
        barrier()
        chain = shared.chain[0]
        while now.steps < end and now.settled == 0:
            other = state_of_next(own, i, n)
            tension, rate, link = link_of(shared, own, other, length)
            contact, mesh = contacts(ensemble, state, tallies, shared, variant, own, mesh, i, live, 0, 0, Real(0.0), 0)
            previous = force_of_previous(link, i, n)
            total = link + contact - previous
            a = vec2(chain.inverse_mass * total[0] + chain.gravity[0], chain.inverse_mass * total[1] + chain.gravity[1])
            half = now.steps == 0
            if now.steps % LOOK_EVERY == 0:
                square = Real(0.0)
                size = Real(0.0)
                pull = Real(0.0)
                if live:
                    square = own[2] * own[2] + own[3] * own[3]
                    size = wp.length(a)
                    pull = wp.abs(tension)
                    if not size < Real(1.0e30):
                        size = Real(1.0e30)
                energy = wp.float64(0.5) * wp.float64(chain.mass) * block_total(shared, square, i)
                worst = block_largest(shared, size, i)
                scale = wp.max(block_largest(shared, pull, i), wp.float64(chain.mass * wp.length(chain.gravity)))
                now.residual = worst
                if scale > wp.float64(0.0):
                    now.residual = wp.float64(chain.mass) * worst / scale
                if now.residual < now.tolerance:
                    now.settled = 1
                if energy < now.energy:
                    own[2] = Real(0.0)
                    own[3] = Real(0.0)
                    energy = wp.float64(0.0)
                    half = True
                now.energy = energy
            if now.settled == 0:
                kick = h
                if half:
                    kick = Real(0.5) * h
                own[2] = own[2] + kick * a[0]
                own[3] = own[3] + kick * a[1]
                own = move(own, h * own[2], h * own[3])
                now.steps = now.steps + 1
        if live:
            put_back(ensemble, state, variant, own, i)
            store_mesh(state, tallies, shared, ensemble.drives[variant], mesh, i)
        if i == 0:
            settling[variant] = now

    return relax_block
