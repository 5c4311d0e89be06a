"""Settling on blocks of threads: relaxation (`relaxation`) with one block a variant."""

from functools import cache

import warp as wp

from ..modules import own_module, without_contraction
from ..native import sum_with_multiple
from ..physics.body import aligned_pose, pose_with_coordinates, relax_arm
from ..relaxation import ENERGY_EVERY, Settling, finite_size, relative_residual, relaxation_after_check, relaxation_kick
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts, thread_parts
from .block_sums import block_sum_functions
from .body_states import body_state_functions
from .carried_arms import carried_arm_functions
from .contact_forces import contact_force_functions
from .geometry import geometry_functions
from .links import link_functions
from .loads import load_functions
from .near_partners import near_partner_functions
from .rollers import roller_functions
from .shared_memory import array_view, shared_arrays
from .sync import sync_functions
from .tensioners import tensioner_functions
from .wrench_parts import wrench_part_functions


@cache
def block_relax_kernel(kind: BlockKind, blocks: int) -> wp.Kernel:
    """Block kernel, in float64, that settles drives of a kind by relaxation, the sprockets held."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets, rotors, body_count = kind.parts.sprockets, kind.parts.rotors, kind.parts.bodies
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    wrench_parts = wrench_part_functions(kind)
    rollers = roller_functions(kind)
    geometry = geometry_functions(kind)
    body_states = body_state_functions(kind)
    tensioners = tensioner_functions(kind)
    carried_arms = carried_arm_functions(kind)
    loads = load_functions(kind)
    sync = sync_functions(kind)
    near_partners = near_partner_functions(kind)
    links = link_functions(kind)
    contact_forces = contact_force_functions(kind)
    shared_of, lengths_of = shared_arrays(kind), array_view(Real)
    block_sums = block_sum_functions(kind)

    @wp.func
    def begin_settling(ensemble: Ensemble, state: State, shared: Shared, variant: int, i: int):
        """Parts of thread i; shares the chain and bodies to settle, the sprockets at rest."""
        drive = ensemble.drives[variant]
        mine = thread_parts(drive, variant, i, wrench_parts.thread_body(i))
        mine.sprocket = -1  # all sprockets are held
        rollers.fetch(state, shared, mine)
        if i == 0:
            geometry.share_chains_and_guides(ensemble, shared, drive, variant)
        if i < body_count:
            pose = body_states.pose_from_state(ensemble, state, drive, i)
            if i < rotors:
                pose.speed = wp.float64(0.0)
                pose.velocity = wp.vec2d()
            if i < sprockets:
                geometry.share_sprocket(ensemble, shared, drive, i, pose.center)
            geometry.put_pose(shared, i, pose)
            body_states.share_hub(ensemble, shared, variant, variant, i)
            shared.motions[i] = ensemble.motions[drive.first_body + i]
        return mine

    @wp.func
    def turn_arm(shared: Shared, mine: ThreadParts, angular: wp.float64, kick: wp.float64, h: wp.float64):
        """Moves the thread's arm by a relaxation step."""
        pose = shared.poses[mine.body]
        arm = relax_arm(body_states.body_from_pose(pose), angular, kick, h)
        geometry.put_pose(shared, mine.body, aligned_pose(pose_with_coordinates(pose, arm)))

    @wp.func
    def arm_acceleration(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, wrench: kinds.Wrench):
        """Angular acceleration [rad/s^2] of the thread's arm in relaxation."""
        pose = shared.poses[mine.body]
        if wp.static(kind.parts.tensioners):
            wrench = tensioners.add_tensioner_forces(ensemble, state, mine, 0, pose, wrench)
        load = wp.float64(0.0)
        if wp.static(kind.parts.jointed):
            load = carried_arms.own_moment(ensemble, shared, mine) + carried_arms.spring_moment_of_carried(
                ensemble, shared, mine
            )
        else:
            load = loads.body_load(ensemble, shared, mine, load, load, pose)
        return (wrench.moment + load) * shared.motions[mine.body].inverse_inertia

    @wp.func
    def energy_and_residual(
        ensemble: Ensemble, shared: Shared, mine: ThreadParts, tension: of_each, angular: wp.float64
    ):
        """Kinetic energy [J] and residual of chain and arms in relaxation; all threads together."""
        chain = shared.chains[0]
        i = mine.thread
        square = wp.float64(0.0)
        size = Real(0.0)
        most = Real(0.0)
        for k in range(rollers_per_thread):
            j = k * threads + i
            if j < mine.rollers:
                v = rollers.velocity(shared.rows, j)
                square = square + wp.float64(wp.dot(v, v))
                size = wp.max(size, finite_size(rollers.acceleration(shared, j)))
                most = wp.max(most, wp.abs(tension[k]))
        mass = wp.float64(chain.mass)
        if wp.static(kind.parts.arms):
            if mine.arm >= 0:
                reach = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm].reach
                inverse_inertia = shared.motions[mine.body].inverse_inertia
                speed = shared.poses[mine.body].speed
                square = square + speed * speed / (inverse_inertia * mass)
                turning = wp.vec2d(angular, wp.float64(0.0)) / (inverse_inertia * reach * mass)
                size = wp.max(size, Real(finite_size(turning)))
        gravity = wp.vec2d(wp.float64(chain.gravity[0]), wp.float64(chain.gravity[1]))
        energy = wp.float64(0.5) * mass * block_sums.block_total(shared, square, i)
        worst = block_sums.block_largest(shared, size, i)
        most_tension = block_sums.block_largest(shared, most, i)
        return energy, relative_residual(worst, most_tension, mass, gravity, wp.float64(chain.stiffness))

    @wp.func
    def stop_rollers(shared: Shared, i: int):
        """Sets the velocities of the thread's rollers to zero."""
        for k in range(rollers_per_thread):
            rollers.set_velocity(shared, k * threads + i, vec2())

    @wp.func
    def kick_and_drift(shared: Shared, i: int, kick: Real, h: Real):
        """Moves the thread's rollers by a relaxation step: v += kick a, then x += h v."""
        for k in range(rollers_per_thread):
            j = k * threads + i
            v = sum_with_multiple(rollers.velocity(shared.rows, j), kick, rollers.acceleration(shared, j))
            rollers.set_velocity(shared, j, v)
            rollers.move(shared, j, h, v)

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
        """Settles variants `order[b]`, a block each, by up to `steps` steps of relaxation."""
        number = wp.tid() // threads
        i = wp.tid() % threads
        shared = shared_of(state, number)
        mine = begin_settling(ensemble, state, shared, order[number], i)
        lengths = lengths_of(ensemble.lengths, mine.first_roller, wp.static(kind.shape.slots))
        now = settling[mine.variant]
        end = wp.min(now.steps + steps, now.limit)
        sync.barrier()
        near = near_partners.remembered_partners(state, shared, mine)
        still = Now()
        while now.steps < end and now.settled == 0:
            tension, rate = links.find_link_forces(state, shared, mine, Now(), lengths)
            near = near_partners.update_near_partners(state, shared, mine, still, near)
            contact_forces.add_contact_forces(ensemble, state, tallies, shared, mine, still, near)
            sync.barrier()
            angular = wp.float64(0.0)
            if wp.static(kind.parts.arms):
                moment = wrench_parts.chain_moment(shared, i)
                acting = carried_arms.add_carried_wrenches(
                    ensemble, shared, mine, wrench_parts.chain_moment_and_force(shared, i, moment, 0)
                )
                if mine.arm >= 0:
                    angular = arm_acceleration(ensemble, state, shared, mine, wrench_parts.wrench_from_vector(acting))
                if wp.static(kind.parts.jointed):
                    sync.barrier()  # others see where the arm was
            restart = int(0)
            if now.steps % ENERGY_EVERY == 0:
                energy, residual = energy_and_residual(ensemble, shared, mine, tension, angular)
                now, restart = relaxation_after_check(now, energy, residual)
                if restart == 1:
                    stop_rollers(shared, i)
            if now.settled == 0:
                kick_and_drift(shared, i, Real(relaxation_kick(now, restart)), Real(now.step))
                if wp.static(kind.parts.arms):
                    if mine.arm >= 0:
                        turn_arm(shared, mine, angular, relaxation_kick(now, restart), now.step)
                if wp.static(kind.parts.jointed):
                    sync.barrier()
                    carried_arms.place_carried_arm(ensemble, shared, mine, 1)
                if wp.static(kind.parts.hubs):
                    sync.barrier()
                    body_states.place_carried_sprocket(shared, mine.body)
                now.steps = now.steps + 1
            sync.barrier()
        rollers.put_back(state, shared, mine)
        if wp.static(kind.parts.arms):
            if mine.arm >= 0 or (wp.static(kind.parts.hubs) != 0 and mine.body >= 0):
                at = ensemble.drives[mine.variant].first_body + mine.body
                state.bodies[at] = body_states.body_from_pose(shared.poses[mine.body])
        if i == 0:
            settling[mine.variant] = now

    return without_contraction(relax_block)
