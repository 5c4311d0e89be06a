"""Settling on blocks of threads: relaxation (`relaxation`) with one block a variant."""

from functools import cache

import warp as wp

from ..modules import own_module, uncontracted
from ..native import moved
from ..physics.body import aligned_pose, pose_with_coordinates, relax_arm
from ..relaxation import ENERGY_EVERY, Settling, finite_size, judged, relative_residual, relaxation_kick
from ..structs import Tallies
from .bodies import body_access, body_steps
from .contact_pairs import contact_forces
from .contacts import wrench_parts
from .geometry import contact_geometry
from .hydraulics import block_tensioners
from .jointed import block_jointed
from .kind import BlockKind, Mine, mine_of
from .links import link_forces
from .near import near_partners
from .rollers import roller_rows
from .shared_memory import shared_arrays, view
from .sync import lanes, sync


@cache
def block_relax_kernel(kind: BlockKind, blocks: int) -> wp.Kernel:
    """The kernel that settles drives of a kind, in float64; the sprockets are held."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets = kind.parts.sprockets
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, forces, partners, wrenches = roller_rows(kind), contact_forces(kind), near_partners(kind), wrench_parts(kind)
    of, bodies, steps, tensioners = contact_geometry(kind), body_access(kind), body_steps(kind), block_tensioners(kind)
    joints = block_jointed(kind)
    barrier, warp_sum, warp_max = sync(kind).barrier, sync(kind).warp_sum, sync(kind).warp_max
    shared_of, lengths_of = shared_arrays(kind), view(Real)
    pull, acceleration, velocity = link_forces(kind).pull, row.acceleration, row.velocity
    set_velocity, move = row.set_velocity, row.move

    @wp.func
    def begin(ensemble: Ensemble, state: State, shared: Shared, variant: int, i: int):
        """The place of thread i; shares the chain and the bodies, the sprockets at rest."""
        drive = ensemble.drives[variant]
        mine = mine_of(drive, variant, i, wrenches.body_of(i))
        mine.sprocket = -1  # all sprockets are held
        row.fetch(state, shared, mine)
        if i == 0:
            of.share_chain(ensemble, shared, drive, variant)
        if i < wp.static(kind.parts.bodies):
            pose = bodies.pose_from(ensemble, state, drive, i)
            if i < wp.static(kind.parts.mounted):
                pose.speed = wp.float64(0.0)
                pose.velocity = wp.vec2d()
            if i < wp.static(sprockets):
                of.share_sprocket(ensemble, shared, drive, i, pose.center)
            of.put_pose(shared, i, pose)
            bodies.share_hub(ensemble, shared, variant, variant, i)
            shared.motions[i] = ensemble.motions[drive.first_body + i]
        return mine

    @wp.func
    def turn_arm(shared: Shared, mine: Mine, angular: wp.float64, kick: wp.float64, h: wp.float64):
        """A step of the thread's arm."""
        pose = shared.poses[mine.body]
        arm = relax_arm(bodies.state_of(pose), angular, kick, h)
        of.put_pose(shared, mine.body, aligned_pose(pose_with_coordinates(pose, arm)))

    @wp.func
    def rest_arm(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, wrench: kinds.Wrench):
        """Angular acceleration of the thread's arm [rad/s^2]."""
        pose = shared.poses[mine.body]
        if wp.static(kind.parts.tensioners > 0):
            wrench = tensioners.pushed(ensemble, state, mine, 0, pose, wrench)
        load = wp.float64(0.0)
        if wp.static(kind.parts.jointed):
            load = joints.own_on(ensemble, shared, mine) + joints.joints_on(ensemble, shared, mine)
        else:
            load = steps.load_on(ensemble, shared, mine, load, load, pose)
        return (wrench.moment + load) * shared.motions[mine.body].inverse_inertia

    @wp.func
    def share_of_warps(shared: Shared, value: Real, i: int):
        """Makes the value of each warp stand among the parts."""
        barrier()
        if i % lanes() == 0:
            shared.parts[i // lanes()] = value
        barrier()

    @wp.func
    def block_largest(shared: Shared, value: Real, i: int):
        """The largest `value` of all threads."""
        share_of_warps(shared, warp_max(value), i)
        result = wp.float64(shared.parts[0])
        for w in range(1, wp.static(threads) // lanes()):
            result = wp.max(result, wp.float64(shared.parts[w]))
        barrier()
        return result

    @wp.func
    def block_total(shared: Shared, value: wp.float64, i: int):
        """The sum of `value` over all threads."""
        share_of_warps(shared, Real(warp_sum(value)), i)
        result = wp.float64(0.0)
        for w in range(wp.static(threads) // lanes()):
            result = result + wp.float64(shared.parts[w])
        barrier()
        return result

    @wp.func
    def energy_and_residual(ensemble: Ensemble, shared: Shared, mine: Mine, tension: of_each, angular: wp.float64):
        """Kinetic energy [J] and residual of chain and arms; all threads together."""
        chain = shared.chain[0]
        i = mine.thread
        square = wp.float64(0.0)
        size = Real(0.0)
        most = Real(0.0)
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            if j < mine.rollers:
                v = velocity(shared.rows, j)
                square = square + wp.float64(wp.dot(v, v))
                size = wp.max(size, finite_size(acceleration(shared, j)))
                most = wp.max(most, wp.abs(tension[k]))
        mass = wp.float64(chain.mass)
        if wp.static(kind.parts.arms > 0):
            if mine.arm >= 0:
                reach = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm].reach
                inverse_inertia = shared.motions[mine.body].inverse_inertia
                speed = shared.poses[mine.body].speed
                square = square + speed * speed / (inverse_inertia * mass)
                turning = wp.vec2d(angular, wp.float64(0.0)) / (inverse_inertia * reach * mass)
                size = wp.max(size, Real(finite_size(turning)))
        gravity = wp.vec2d(wp.float64(chain.gravity[0]), wp.float64(chain.gravity[1]))
        energy = wp.float64(0.5) * mass * block_total(shared, square, i)
        worst = block_largest(shared, size, i)
        most_tension = block_largest(shared, most, i)
        return energy, relative_residual(worst, most_tension, mass, gravity, wp.float64(chain.stiffness))

    @wp.func
    def stop(shared: Shared, i: int):
        """The thread's rollers at rest."""
        for k in range(wp.static(rollers_per_thread)):
            set_velocity(shared, k * wp.static(threads) + i, vec2())

    @wp.func
    def kick_drift(shared: Shared, i: int, kick: Real, h: Real):
        """v += kick a, then x += h v, of the thread's rollers."""
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            v = moved(velocity(shared.rows, j), kick, acceleration(shared, j))
            set_velocity(shared, j, v)
            move(shared, j, h, v)

    @wp.kernel(
        enable_backward=False,
        module=own_module(__file__, "relax_block", kind, blocks),
        grid_stride=False,
        launch_bounds=(threads, blocks),
    )
    def relax_block(
        ensemble: Ensemble,
        state: State,
        tallies: Tallies,
        settling: wp.array[Settling],
        order: wp.array[wp.int32],
        steps: int,
    ):
        """Variants `order[b]`, one a block of threads: up to `steps` steps of relaxation."""
        number = wp.tid() // wp.static(threads)
        i = wp.tid() % wp.static(threads)
        shared = shared_of(state, number)
        mine = begin(ensemble, state, shared, order[number], i)
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.shape.slots))
        now = settling[mine.variant]
        end = wp.min(now.steps + steps, now.limit)
        barrier()
        near = partners.remembered(state, shared, mine)
        still = Now()
        while now.steps < end and now.settled == 0:
            tension, rate = pull(state, shared, mine, Now(), lengths)
            near = partners.update_near(state, shared, mine, still, near)
            touch = forces.touch_of(ensemble, state, shared, mine, near)
            forces.contacts(ensemble, state, tallies, shared, mine, still, touch)
            barrier()
            angular = wp.float64(0.0)
            if wp.static(kind.parts.arms > 0):
                moment = wrenches.moment_on(shared, i)
                acting = joints.hang(ensemble, shared, mine, wrenches.acting_on(shared, i, moment, 0))
                if mine.arm >= 0:
                    angular = rest_arm(ensemble, state, shared, mine, wrenches.wrench_of(acting))
                if wp.static(kind.parts.jointed):
                    barrier()  # others see where the arm was
            restart = int(0)
            if now.steps % ENERGY_EVERY == 0:
                energy, residual = energy_and_residual(ensemble, shared, mine, tension, angular)
                now, restart = judged(now, energy, residual)
                if restart == 1:
                    stop(shared, i)
            if now.settled == 0:
                kick_drift(shared, i, Real(relaxation_kick(now, restart)), Real(now.step))
                if wp.static(kind.parts.arms > 0):
                    if mine.arm >= 0:
                        turn_arm(shared, mine, angular, relaxation_kick(now, restart), now.step)
                if wp.static(kind.parts.jointed):
                    barrier()
                    joints.carry(ensemble, shared, mine, 1)
                if wp.static(kind.parts.hubs > 0):
                    barrier()
                    bodies.carry(shared, mine.body)
                now.steps = now.steps + 1
            barrier()
        row.put_back(state, shared, mine)
        if wp.static(kind.parts.arms > 0):
            if mine.arm >= 0 or (wp.static(kind.parts.hubs > 0) and mine.body >= 0):
                at = ensemble.drives[mine.variant].first_body + mine.body
                state.bodies[at] = bodies.state_of(shared.poses[mine.body])
        if i == 0:
            settling[mine.variant] = now

    return uncontracted(relax_block)
