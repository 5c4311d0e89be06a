"""Settling on blocks of threads: `relax` with one block a variant."""

from functools import cache

import warp as wp

from ..relaxation import LOOK_EVERY, Settling
from ..rows import accessors
from ..structs import Wheel, types
from ..sum_structs import Tallies
from ..trigonometry import sine_cosine
from .block_forces import block_forces
from .block_rows import block_rows
from .exchange import lanes


@cache
def block_relax_kernel(Real: type, threads: int, per: int, sprockets: int, guides: int, blocks: int) -> wp.Kernel:
    """The kernel that settles drives of up to `threads * per` rollers and of these numbers of sprockets and guide-bars.

    The sprockets are held.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    of_each = wp.types.vector(per, Real)
    row = block_rows(Real, threads, per, sprockets, guides)
    part = block_forces(Real, threads, per, sprockets, guides)
    talk = row.talk
    barrier, shared_arrays, warp_sum, warp_max = talk.barrier, talk.shared_arrays, talk.warp_sum, talk.warp_max
    view = talk.view
    link_of, before, acceleration, velocity = row.link_of, row.before, row.acceleration, row.velocity
    force_on, set_force = row.force_on, row.set_force
    near, leave, contacts, SPROCKETS = part.near, part.leave, part.contacts, part.SPROCKETS
    set_velocity, move, fetch, put_back = row.set_velocity, row.move, row.fetch, row.put_back
    share_geometry, load = part.share_geometry, accessors(Real).load

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
    def block_total(shared: kinds.Shared, value: wp.float64, i: int):
        """The sum of `value` over all threads."""
        barrier()
        total = warp_sum(value)
        if i % lanes() == 0:
            shared.parts[i // lanes()] = total
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
        number = wp.tid() // wp.static(threads)
        variant = order[number]
        i = wp.tid() % wp.static(threads)
        n = ensemble.drives[variant].rollers
        first = ensemble.drives[variant].first_roller
        memory = ensemble.drives[variant].first_contact
        shared = shared_arrays(state, number)
        lengths = view(ensemble.lengths, first, n)
        fetch(ensemble, state, shared, variant, i)
        if i < wp.static(sprockets):
            start_sprocket(ensemble, state, shared, variant, i)
        now = settling[variant]
        end = wp.min(now.steps + block, now.limit)
        h = Real(now.step)
        zero = Real(0.0)
        barrier()
        chain = shared.chain[0]
        while now.steps < end and now.settled == 0:
            tension = of_each()
            pull_x = of_each()
            pull_y = of_each()
            for k in range(wp.static(per)):
                j = k * wp.static(threads) + i
                tension_k, rate, force = link_of(shared, j, n, load(lengths, j))
                set_force(shared, j, force)
                tension[k] = tension_k
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            barrier()
            for k in range(wp.static(per)):
                force = force_on(shared, before(k * wp.static(threads) + i, n))
                pull_x[k] = pull_x[k] - force[0]
                pull_y[k] = pull_y[k] - force[1]
            barrier()
            for k in range(wp.static(per)):
                set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
            by_teeth = int(0)
            by_bar = int(0)
            for k in range(wp.static(per)):
                j = k * wp.static(threads) + i
                partners = near(shared, j, n)
                if partners != shared.held[j]:
                    leave(state, memory + j, n, shared.held[j] & ~partners)
                    shared.held[j] = partners
                by_teeth = by_teeth | wp.where(partners & SPROCKETS != 0, (1 << k), 0)
                by_bar = by_bar | wp.where(partners & ~SPROCKETS != 0, (1 << k), 0)
            contacts(ensemble, state, tallies, shared, first, memory, n, i, by_teeth, by_bar, 0, 0, 0, zero, 0)
            barrier()
            half = now.steps == 0
            if now.steps % LOOK_EVERY == 0:
                square = wp.float64(0.0)
                size = Real(0.0)
                most = Real(0.0)
                for k in range(wp.static(per)):
                    j = k * wp.static(threads) + i
                    if j < n:
                        v = velocity(shared.rows, j)
                        square = square + wp.float64(wp.dot(v, v))
                        net = wp.length(acceleration(shared, j))
                        if not net < Real(1.0e30):
                            net = Real(1.0e30)
                        size = wp.max(size, net)
                        most = wp.max(most, wp.abs(tension[k]))
                energy = wp.float64(0.5) * wp.float64(chain.mass) * block_total(shared, square, i)
                worst = block_largest(shared, size, i)
                scale = wp.max(block_largest(shared, most, i), wp.float64(chain.mass * wp.length(chain.gravity)))
                now.residual = worst
                if scale > wp.float64(0.0):
                    now.residual = wp.float64(chain.mass) * worst / scale
                if now.residual < now.tolerance:
                    now.settled = 1
                if energy < now.energy:
                    for k in range(wp.static(per)):
                        set_velocity(shared, k * wp.static(threads) + i, vec2())
                    energy = wp.float64(0.0)
                    half = True
                now.energy = energy
            if now.settled == 0:
                kick = h
                if half:
                    kick = Real(0.5) * h
                for k in range(wp.static(per)):
                    j = k * wp.static(threads) + i
                    v = velocity(shared.rows, j) + kick * acceleration(shared, j)
                    set_velocity(shared, j, v)
                    move(shared, j, h * v[0], h * v[1])
                now.steps = now.steps + 1
            barrier()
        put_back(ensemble, state, shared, variant, i)
        if i == 0:
            settling[variant] = now

    return relax_block
