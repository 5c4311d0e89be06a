"""Chain tensioner: a plunger that pushes a body out, on a spring, on oil behind a check valve, with a ratchet.

The plunger touches a body at r, r_0 as drawn, and pushes along a fixed unit vector d:

    x = (r - r_0) . d,    x' = r' . d                                                           (1)
    spring:     F = max(0, f_0 - k x - c x') + F_s                                              (2)
    hydraulic:  F = max(0, (P - P_0) A + f_0 - k x - c x') + F_s.                               (3)

**Oil** with a share a of air at ambient pressure P_0, n = 1.4, in a chamber of volume V = V_0 + A x:

    1/E(P) = (1/E_0 + (a/n) P_0^(1/n) P^(-1-1/n)) / (1 + a)                                     (4)
    phi(P) = int dP/E = (P/E_0 - a (P_0/P)^(1/n)) / (1 + a)                                     (5)
    mu = ln(M) = phi(P) + ln(V/V_0),    M' = exp(phi) Q   (M in units of rho V_0 at phi = 0)    (6)

Q is the flow into it. P follows from mu and x, by z = (P/P_0)^(1/7); below the vapor pressure P_v, P = P_v and the rest
of the volume is vapor. The state keeps z of the last step's end.

**Flows** through gap, check valve (dP = P_s - P), relief valve and vent (dP = P - P_0), of lift y:

    Q = Q_cv - Q_leak - Q_relief - Q_vent,    Q_leak = G (P - P_0) + (pi d h / 2) x'            (7)
    y = clip((dP A_b - F_0) / k_cv, 0, y_max),    S = C_d pi y (2 r_B tan(g) + y sin(g) / cos(g)^2)
    Q_cv = S_e sqrt(2 dP / rho),    1/S_e^2 = 1/S^2 + 1/A_b^2,    below 5 kPa linear in dP.     (8)

A step h takes flows at its end, after the body has moved:

    phi(P) + ln((V - h Q(P)) / V_0) = mu before the step.                                       (9)

Until oil has filled a drained chamber, air moves freely, at P_0 for P_v, and no oil goes out.

**Energy.** Of a unit of M, and of all oil,

    u = int (p - P_0) exp(-phi) dphi from P_0 to P,    H = u + (P - P_0) exp(-phi)              (10)
    U = M u - (P - P_0) (V - M exp(-phi)).                                                      (11)

dM in takes H(P_s) dM from the supply, of which the valve loses (H(P_s) - H(P)) dM; dM out loses H(P) dM. With
phi = q - b of oil and air,

    u = K(P) - K(P_0) + P_0 (exp(-phi) - exp(-phi_0)),
    K = P sum (5 j - 7 i)/(7 (i + 1) - 5 j) (-q)^i/i! b^j/j!.                                   (10a)

**Ratchet** of pitch a and backlash s, x_max the farthest x so far, x_b the chamber's bottom:

    x_s = max(a floor(x_max / a) - s, x_b),    F_s = max(0, k_s (x_s - x) - c_s x') while x < x_s.   (12)

**Losses.** With E = (P - P_0) A + f_0 - k x, dampers of spring and stop take

    (E - max(0, E - c x')) x' + (k_s max(0, x_s - x) - F_s) x' >= 0.                            (13)

The plunger follows its body even where E < 0, by outside work (suction)

    -E x'   while E < 0 and E - c x' <= 0.                                                      (14)
"""

import math
from typing import Any

import warp as wp

from ..native import inverse_root, quotient
from ..number import (  # noqa: F401
    Pair,
    add,
    component,
    difference,
    leading_value,
    log_of_sum,
    logarithm,
    mul,
    number_of,
    rounded_value,
    sub,
    trimmed_value,
)
from ..precision import at_float32
from ..structs import Push, Tensioner, TensionerFlows, TensionerState, types
from .guide import world_vector
from .motion import table_value
from .train import OVER_SPEED

BLOCKS = types(wp.float32, blocks=True)
BlockFlows = at_float32(TensionerFlows, {})
"""Tensioner flows of one step in float32, without pairs."""

MOST_ROUNDS = wp.constant(60)
"""Most Newton steps for a tensioner's oil pressure."""

LARGEST_ROOT = 8.0
"""z above any pressure of a tensioner's oil."""

SMALL_EXPONENT = 0.03
"""Largest |x| at which `exponential` is a polynomial, to 1e-16."""

LEAST_OIL_SHARE = 1e-6
"""Least share of oil in a drained tensioner chamber."""

DEGREES = (12, 4, 2, 1, 0, 0, 0)
"""Degrees of eq. (10a) in b, for each power of q."""
SERIES = [
    [
        (5 * j - 7 * i) / (7 * (i + 1) - 5 * j) * (-1) ** i / math.factorial(i) / math.factorial(j)
        for j in range(degree + 1)
    ]
    for i, degree in enumerate(DEGREES)
]
"""Coefficients of b^j in eq. (10a), a row a power of q."""


@wp.func
def plunger_arm(body: Any, tensioner: Any):
    """Vector [m] from a body's center to a tensioner's plunger."""
    return world_vector(tensioner.point, body)


@wp.func
def plunger_extension(center: Any, arm: Any, tensioner: Any):
    """Extension x [m] of a tensioner's plunger, eq. (1); `arm` [m] is from the body's center."""
    q = center + arm - tensioner.home
    d = tensioner.direction
    return component(q, 0) * component(d, 0) + component(q, 1) * component(d, 1)


@wp.func
def extension_rate(arm: Any, speed: Any, velocity: Any, tensioner: Any):
    """Extension rate x' [m/s] of a tensioner's plunger on a moving body, eq. (1)."""
    return wp.dot(velocity + speed * type(velocity)(-arm[1], arm[0]), leading_value(tensioner.direction))


@wp.func
def extension_and_rate(body: Any, tensioner: Any):
    """Extension x [m] of a tensioner and rate [m/s], by its body's pose."""
    arm = plunger_arm(body, tensioner)
    rate = extension_rate(leading_value(arm), leading_value(body.speed), leading_value(body.velocity), tensioner)
    return plunger_extension(body.center, arm, tensioner), rate


@wp.func
def chamber_volume(x: Any, tensioner: Any):
    """Volume V [m^3] of a tensioner's chamber, at least the bottom's."""
    return tensioner.volume + tensioner.area * wp.max(rounded_value(x), tensioner.bottom)


@wp.func
def pressure_root(pressure: Any, tensioner: Any):
    """z = (P / P_0)^(1/7) [-] of a tensioner's oil pressure P [Pa]."""
    return wp.pow(pressure / tensioner.ambient, type(pressure)(wp.static(1.0 / 7.0)))


@wp.func
def pressure_of_root(z: Any, tensioner: Any):
    """Oil pressure P = P_0 z^7 [Pa] in a tensioner."""
    square = z * z
    return tensioner.ambient * square * square * square * z


@wp.func
def oil_compression(z: Any, tensioner: Any):
    """Compression phi [-] of a tensioner's oil and dphi/dz, eq. (5)."""
    square = z * z
    sixth = square * square * square
    stiff = tensioner.oil_share * sixth
    soft = quotient(tensioner.air_share, sixth)
    return (stiff - soft) * z, type(z)(7.0) * stiff + type(z)(5.0) * soft


@wp.func
def supply_pressure(time: Any, forward: Any, tensioner: Any, tables: Any):
    """Oil supply pressure P_s [Pa] of a tensioner, tabulated over time or pump speed `forward` [rad/s]."""
    x = time
    if tensioner.supply_table.over_angle == OVER_SPEED:
        x = number_of(forward)
    return table_value(x, tensioner.supply_table, tables)


@wp.func
def valve_lift(drop: Any, valve: Any):
    """Lift y [m] of a tensioner's valve at dP [Pa], eq. (8)."""
    push = drop * valve.hole_area - valve.preload
    return wp.clamp(push * valve.compliance, type(drop)(0.0), valve.lift_max)


@wp.func
def valve_flow(drop: Any, valve: Any, tensioner: Any):
    """Oil flow [m^3/s] through a tensioner's valve at dP [Pa], and derivative, eq. (8)."""
    zero = type(drop)(0.0)
    two = type(drop)(2.0)
    flow = zero
    slope = zero
    y = zero
    if drop > zero and valve.hole_area > zero:
        y = valve_lift(drop, valve)
    if y > zero:
        around = valve.discharge * type(drop)(wp.static(math.pi))
        curtain = around * y * (valve.seat_width + y * valve.seat_growth)
        hole = valve.hole_area
        part = hole * inverse_root(curtain * curtain + hole * hole)
        limit = wp.max(drop, tensioner.laminar_limit)
        quicker = inverse_root(two * limit * tensioner.density)
        speed = two * drop * quicker
        if drop < limit:
            quicker = two * quicker
        flow = part * curtain * speed
        slope = part * curtain * quicker
        if y < valve.lift_max:
            wider = around * (valve.seat_width + two * y * valve.seat_growth) * part * part * part
            slope = slope + wider * speed * hole * valve.compliance
    return flow, slope


@wp.func
def chamber_flows(pressure: Any, rate: Any, tensioner: Any):
    """Oil flows Q_cv, Q_leak, Q_relief, Q_vent [m^3/s] of a tensioner, derivatives by P, eq. (7), (8)."""
    supplied, slope = valve_flow(tensioner.supply - pressure, tensioner.check, tensioner)
    drop = pressure - tensioner.ambient
    leaked = tensioner.leak * drop + tensioner.drag * rate
    relieved, relief_slope = valve_flow(drop, tensioner.relief, tensioner)
    vented, vent_slope = valve_flow(drop, tensioner.vent, tensioner)
    flows = wp.vector(supplied, leaked, relieved, vented)
    return flows, wp.vector(-slope, tensioner.leak, relief_slope, vent_slope)


@wp.func
def net_inflow(flows: Any):
    """Oil flow Q [m^3/s] into a tensioner's chamber, eq. (7)."""
    return flows[0] - (flows[1] + flows[2] + flows[3])


@wp.func
def chamber_filling(x: wp.float64, state: Any, tensioner: Any):
    """Volume V [m^3] of a tensioner's chamber and mu - ln(V/V_0) of its oil, eq. (6), in float64."""
    volume = chamber_volume(x, tensioner)
    return volume, state.content - wp.log(quotient(volume, tensioner.volume))


@wp.func
def chamber_filling(x: Pair, state: Any, tensioner: Any):
    """Volume V [m^3] of a tensioner's chamber and mu - ln(V/V_0) of its oil, eq. (6), from pairs."""
    reach = x
    if x.high < tensioner.bottom:
        reach = number_of(tensioner.bottom)
    part = tensioner.area / tensioner.volume * reach + 1.0
    return chamber_volume(x, tensioner), difference(state.content, logarithm(part))


@wp.func
def exponential(x: Any):
    """exp(x) for a tensioner's oil, to round-off."""
    one = type(x)(1.0)
    value = one
    if wp.abs(x) < type(x)(wp.static(SMALL_EXPONENT)):
        for k in range(8):
            value = one + x * type(x)(wp.static(1.0 / (8 - k))) * value
    else:
        value = wp.exp(x)
    return value


@wp.func
def flow_imbalance(z: Any, content: Any, per_volume: Any, rate: Any, t: Any):
    """Residual of a tensioner's oil balance (9) at z, times any factor, its derivative, and flows with theirs.

    `content` is mu - ln(V/V_0), `per_volume` h / V (0: eq. (6)), `rate` x'.
    """
    phi, slope = oil_compression(z, t)
    rest = phi - content
    zero = type(z)(0.0)
    flows = wp.vector(zero, zero, zero, zero)
    changes = flows
    if per_volume > zero:
        pressure = pressure_of_root(z, t)
        flows, changes = chamber_flows(pressure, rate, t)
        part = wp.max(-per_volume * net_inflow(flows), type(z)(-0.99))
        steep = type(z)(7.0) * pressure
        whole = z * (type(z)(1.0) + part)
        rest = whole * (rest + log_of_sum(part))
        slope = whole * slope - per_volume * net_inflow(changes) * steep
        changes = changes * quotient(steep, z)
    return rest, slope, flows, changes


@wp.func
def newton_tolerance(z: wp.float64):
    """Newton step of z that solves a tensioner's oil pressure, in float64."""
    return wp.float64(1e-6) * z


@wp.func
def newton_tolerance(z: wp.float32):
    """Newton step of z that solves a tensioner's oil pressure, in float32."""
    return 1.0e-4 * z


@wp.func
def solve_root(content: Any, per_volume: Any, rate: Any, near: Any, floor: Any, tensioner: Any):
    """z of a tensioner's oil by eq. (9), at least `floor`, and flows [m^3/s]; `near` is a guess."""
    low = type(near)(0.0)
    high = type(near)(wp.static(LARGEST_ROOT))
    z = near
    change = high
    zero = type(near)(0.0)
    flows = wp.vector(zero, zero, zero, zero)
    rounds = int(0)
    while rounds < MOST_ROUNDS and wp.abs(change) > newton_tolerance(z):
        rest, slope, there, changes = flow_imbalance(z, content, per_volume, rate, tensioner)
        if rest > type(near)(0.0):
            high = z
        else:
            low = z
        after = wp.max(z - quotient(rest, slope), floor)
        if (after <= low and z > low) or after > high:
            after = type(near)(0.5) * (low + high)
        change = after - z
        z = after
        flows = there + change * changes
        rounds += 1
    return z, flows


@wp.func
def lowest_pressure_root(state: Any, tensioner: Any):
    """Least z of a tensioner's oil: of P_0 while draining, then P_v."""
    z = tensioner.floor
    if state.unfilled > type(z)(0.0):
        z = type(z)(1.0)
    return z


@wp.func
def pressure_root_before(state: Any, tensioner: Any):
    """z of a tensioner's oil at the last step's end or rest."""
    z = state.root
    if z <= type(z)(0.0):
        z = pressure_root(tensioner.rest, tensioner)
    return z


@wp.func
def chamber_pressure(x: Any, kept: bool, state: Any, tensioner: Any):
    """Oil pressure P [Pa] of a tensioner, eq. (6); ambient without oil.

    `kept`: x is of the last step's end.
    """
    pressure = tensioner.ambient
    if tensioner.hydraulic == 1:
        z = state.root
        if not kept or z <= type(z)(0.0):
            volume, content = chamber_filling(x, state, tensioner)
            zero = type(z)(0.0)
            before = pressure_root_before(state, tensioner)
            z, flows = solve_root(content, zero, zero, before, lowest_pressure_root(state, tensioner), tensioner)
        pressure = pressure_of_root(z, tensioner)
    return pressure


@wp.func
def elastic_plunger_force(x: Any, pressure: Any, tensioner: Any):
    """Force (P - P_0) A + f_0 - k x [N] of a tensioner, eq. (2), (3)."""
    push = tensioner.preload - tensioner.stiffness * rounded_value(x)
    if tensioner.hydraulic == 0:
        push = wp.max(push, type(pressure)(0.0))
    return push + (pressure - tensioner.ambient) * tensioner.area


@wp.func
def stop_place(state: Any, tensioner: Any):
    """Extension x_s [m] of a tensioner below which its ratchet or bottom pushes, eq. (12)."""
    place = tensioner.bottom
    pitch = tensioner.ratchet_pitch
    if pitch > type(pitch)(0.0):
        place = wp.max(place, pitch * wp.floor(state.farthest / pitch) - tensioner.backlash)
    return place


@wp.func
def stop_force(x: Any, rate: Any, state: Any, tensioner: Any):
    """Force F_s [N] of a tensioner's ratchet or bottom, eq. (12)."""
    force = type(rate)(0.0)
    depth = stop_place(state, tensioner) - rounded_value(x)
    if depth > force:
        force = wp.max(force, tensioner.stop_stiffness * depth - tensioner.stop_damping * rate)
    return force


@wp.func
def tensioner_force(x: Any, rate: Any, kept: bool, state: Any, tensioner: Any):
    """Force F >= 0 [N] of a tensioner along d, and oil pressure P [Pa], eq. (2), (3).

    `rate` is x'; `kept` as in `chamber_pressure`.
    """
    pressure = chamber_pressure(x, kept, state, tensioner)
    push = elastic_plunger_force(x, pressure, tensioner) - tensioner.damping * rate
    return wp.max(push, type(rate)(0.0)) + stop_force(x, rate, state, tensioner), pressure


@wp.func
def zero_push(tensioner: Tensioner):
    """Push (`structs.Push`) of a tensioner without force, in float64."""
    return Push()


@wp.func
def zero_push(tensioner: BLOCKS.Tensioner):
    """Push (`structs.Push`) of a tensioner without force, on a float32 block."""
    return BLOCKS.Push()


@wp.func
def tensioner_push(body: Any, kept: bool, remembered: Any, tensioner: Any):
    """Force and moment of a tensioner on its body (`structs.Push`)."""
    arm = plunger_arm(body, tensioner)
    lever = leading_value(arm)
    push = zero_push(tensioner)
    push.extension = plunger_extension(body.center, arm, tensioner)
    rate = extension_rate(lever, leading_value(body.speed), leading_value(body.velocity), tensioner)
    force, pressure = tensioner_force(push.extension, rate, kept, remembered, tensioner)
    push.force = force
    push.pressure = pressure
    push.thrust = force * leading_value(tensioner.direction)
    push.moment = lever[0] * push.thrust[1] - lever[1] * push.thrust[0]
    return push


@wp.func
def plunger_losses(push: Any, rate: Any, state: Any, tensioner: Any):
    """Power [W] of a tensioner's dampers, eq. (13), and suction, eq. (14), at `rate` x'."""
    zero = type(rate)(0.0)
    elastic = elastic_plunger_force(push.extension, push.pressure, tensioner)
    pushed = wp.max(elastic - tensioner.damping * rate, zero)
    lost = (elastic - pushed) * rate
    suction = zero
    if elastic < zero and pushed == zero:
        suction = -lost
        lost = zero
    depth = wp.max(stop_place(state, tensioner) - rounded_value(push.extension), zero)
    stop = stop_force(push.extension, rate, state, tensioner)
    return lost + (tensioner.stop_stiffness * depth - stop) * rate, suction


@wp.func
def oil_energy_series(z: Any, tensioner: Any):
    """K [Pa] of a tensioner's oil at z, (10a), and phi [-]."""
    square = z * z
    q = tensioner.oil_share * square * square * square * z
    b = quotient(tensioner.air_share, square * square * z)
    total = type(z)(0.0)
    for i in range(wp.static(len(SERIES))):
        row = type(z)(0.0)
        for j in range(wp.static(DEGREES[len(SERIES) - 1 - i] + 1)):
            row = row * b + type(z)(wp.static(SERIES[len(SERIES) - 1 - i][DEGREES[len(SERIES) - 1 - i] - j]))
        total = total * q + row
    return pressure_of_root(z, tensioner) * total, q - b


@wp.func
def oil_specific_energy(z: Any, tensioner: Any):
    """Energy u [Pa] of a tensioner's oil, eq. (10), (10a), and its volume exp(-phi)."""
    energy, phi = oil_energy_series(z, tensioner)
    volume = exponential(-phi)
    return energy + tensioner.ambient * volume - tensioner.still, volume


@wp.func
def oil_enthalpy(z: Any, tensioner: Any):
    """Enthalpy H [Pa] of a tensioner's oil, eq. (10)."""
    energy, volume = oil_specific_energy(z, tensioner)
    return energy + (pressure_of_root(z, tensioner) - tensioner.ambient) * volume


@wp.func
def oil_energy(x: Any, pressure: Any, state: Any, tensioner: Any):
    """Energy U [J] of a tensioner's oil, eq. (11)."""
    energy, volume = oil_specific_energy(pressure_root(pressure, tensioner), tensioner)
    mass = tensioner.volume * wp.exp(rounded_value(state.content))
    vapor = chamber_volume(x, tensioner) - mass * volume
    return mass * energy - (pressure - tensioner.ambient) * vapor


@wp.func
def tensioner_energy(x: Any, pressure: Any, state: Any, tensioner: Any):
    """Energy [J] of a tensioner's spring, stop and oil."""
    half = type(tensioner.volume)(0.5)
    zero = type(tensioner.volume)(0.0)
    reach = rounded_value(x)
    if tensioner.hydraulic == 0 and tensioner.stiffness > zero:
        reach = wp.min(reach, tensioner.preload / tensioner.stiffness)
    energy = reach * (half * tensioner.stiffness * reach - tensioner.preload)
    depth = wp.max(stop_place(state, tensioner) - rounded_value(x), zero)
    energy += half * tensioner.stop_stiffness * depth * depth
    if tensioner.hydraulic == 1:
        energy += oil_energy(x, pressure, state, tensioner)
    return energy


@wp.func
def plunger_losses_at_extension(x: wp.float64, rate: wp.float64, state: TensionerState, tensioner: Tensioner):
    """Power [W] of a tensioner's dampers, eq. (13), and suction, eq. (14), at extension x [m]."""
    push = Push()
    push.extension = x
    push.pressure = chamber_pressure(x, True, state, tensioner)
    lost, suction = plunger_losses(push, rate, state, tensioner)
    return lost, suction


@wp.func
def resting_state(x: wp.float64, tensioner: Tensioner):
    """State of a tensioner at rest at extension x [m], its ratchet latched."""
    state = TensionerState()
    state.farthest = x
    if tensioner.hydraulic == 1:
        state.root = pressure_root(tensioner.rest, tensioner)
        phi, slope = oil_compression(state.root, tensioner)
        state.content = phi + wp.log(chamber_volume(x, tensioner) / tensioner.volume)
        if tensioner.drained > wp.float64(0.0):
            state.content += wp.log(wp.max(wp.float64(1.0) - tensioner.drained, wp.float64(wp.static(LEAST_OIL_SHARE))))
            state.unfilled = wp.float64(1.0)
            state.root = wp.float64(0.0)
    return state


@wp.func
def zero_flows(h: wp.float64):
    """Flows of a tensioner's oil before any, in float64."""
    return TensionerFlows()


@wp.func
def zero_flows(h: wp.float32):
    """Flows of a tensioner's oil before any, in float32."""
    return BlockFlows()


@wp.func
def add_flow_energies(flows: Any, before: Any, z: Any, tensioner: Any):
    """Flows of a tensioner's oil in a step with energies [J]; z is `before` and `z` after it."""
    # at the mean z, work on the plunger and what is stored, lost and supplied differ by O(h^2)
    phi, slope = oil_compression(z, tensioner)
    density = exponential(phi)
    middle = oil_enthalpy(type(z)(0.5) * (before + z), tensioner)
    flows.leak_loss = middle * density * (flows.leaked + flows.relieved + flows.vented)
    if flows.supplied > type(z)(0.0):
        supplied = tensioner.supplied
        if tensioner.supply_table.cells > 0:
            supplied = oil_enthalpy(pressure_root(tensioner.supply, tensioner), tensioner)
        flows.supply_work = supplied * density * flows.supplied
        flows.valve_loss = flows.supply_work - middle * density * flows.supplied
    return flows


@wp.func
def advance_oil(x: Any, rate: Any, h: Any, metered: bool, state: Any, tensioner: Any):
    """State of a tensioner's oil after a step, eq. (9), and flows, with energies if `metered`."""
    before = pressure_root_before(state, tensioner)
    if state.unfilled > type(h)(0.0):
        tensioner.drag = type(rate)(0.0)
    volume, content = chamber_filling(x, state, tensioner)
    per_volume = quotient(h, volume)
    floor = lowest_pressure_root(state, tensioner)
    near = wp.max(before + state.growth + state.bend, floor)  # so that one evaluation does as a rule
    z, rates = solve_root(content, per_volume, rate, near, floor, tensioner)
    flows = zero_flows(h)
    flows.supplied = h * rates[0]
    flows.leaked = h * rates[1]
    flows.relieved = h * rates[2]
    flows.vented = h * rates[3]
    phi, slope = oil_compression(z, tensioner)
    gain = per_volume * net_inflow(rates)
    state.content = trimmed_value(state.content + log_of_sum(exponential(phi - content) * gain))
    state.root = z
    growth = z - before
    state.bend = growth - state.growth
    state.growth = growth
    if metered:
        flows = add_flow_energies(flows, before, z, tensioner)
    if state.unfilled > type(h)(0.0):
        flows.filling = h
        state.unfilled = wp.where(pressure_of_root(z, tensioner) > tensioner.ambient, type(h)(0.0), type(h)(1.0))
    flows.unfilled = state.unfilled
    return state, flows


@wp.func
def advance_tensioner(x: Any, rate: Any, h: Any, metered: bool, state: Any, tensioner: Any):
    """State of a tensioner a step after its body has moved, and oil's flows, with energies if `metered`.

    `rate` is the step's mean x'.
    """
    flows = zero_flows(h)
    if tensioner.hydraulic == 1:
        state, flows = advance_oil(x, rate, h, metered, state, tensioner)
    state.farthest = wp.max(state.farthest, rounded_value(x))
    return state, flows
