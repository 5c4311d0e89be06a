"""What arms and tensioners keep at float32 without float64, and the window's sums of them, as `block_spin_sums`.

Read from the state and written back as float64, which holds them exactly; added to by the functions of `sums`.
"""

import warp as wp

from ..pairs import pair_of, whole
from ..structs import LeverSums, PlungerMeter, PlungerState, PlungerSums, TensionerState
from ..sum_structs import ArmSums, TensionerFlows, TensionerSums


@wp.func
def plunger_of(state: TensionerState):
    """What a tensioner remembers, in pairs."""
    made = PlungerState()
    made.content = pair_of(state.content)
    made.pressure = wp.float32(state.pressure)
    made.farthest = wp.float32(state.farthest)
    return made


@wp.func
def tensioner_of(state: PlungerState):
    """The same in float64."""
    made = TensionerState()
    made.content = whole(state.content)
    made.pressure = wp.float64(state.pressure)
    made.farthest = wp.float64(state.farthest)
    return made


@wp.func
def meter_of(flows: TensionerFlows):
    """A meter in pairs."""
    meter = PlungerMeter()
    meter.leaked = pair_of(flows.leaked)
    meter.supplied = pair_of(flows.supplied)
    meter.leak_loss = pair_of(flows.leak_loss)
    meter.valve_loss = pair_of(flows.valve_loss)
    meter.supply_work = pair_of(flows.supply_work)
    meter.lift = wp.float32(flows.lift)
    return meter


@wp.func
def flows_of(meter: PlungerMeter):
    """A meter in float64."""
    flows = TensionerFlows()
    flows.leaked = whole(meter.leaked)
    flows.supplied = whole(meter.supplied)
    flows.leak_loss = whole(meter.leak_loss)
    flows.valve_loss = whole(meter.valve_loss)
    flows.supply_work = whole(meter.supply_work)
    flows.lift = wp.float64(meter.lift)
    return flows


@wp.func
def plunger_sums_of(sums: TensionerSums):
    """A tensioner's sums in pairs."""
    made = PlungerSums()
    made.force_min = wp.float32(sums.force_min)
    made.force_max = wp.float32(sums.force_max)
    made.force = pair_of(sums.force)
    made.pressure_min = wp.float32(sums.pressure_min)
    made.pressure_max = wp.float32(sums.pressure_max)
    made.pressure = pair_of(sums.pressure)
    made.extension_min = wp.float32(sums.extension_min)
    made.extension_max = wp.float32(sums.extension_max)
    made.extension = pair_of(sums.extension)
    made.dissipated = pair_of(sums.dissipated)
    return made


@wp.func
def with_plunger_sums(sums: TensionerSums, made: PlungerSums):
    """A tensioner's sums in float64; what flowed is in `sums`."""
    sums.force_min = wp.float64(made.force_min)
    sums.force_max = wp.float64(made.force_max)
    sums.force = whole(made.force)
    sums.pressure_min = wp.float64(made.pressure_min)
    sums.pressure_max = wp.float64(made.pressure_max)
    sums.pressure = whole(made.pressure)
    sums.extension_min = wp.float64(made.extension_min)
    sums.extension_max = wp.float64(made.extension_max)
    sums.extension = whole(made.extension)
    sums.dissipated = whole(made.dissipated)
    return sums


@wp.func
def lever_sums_of(sums: ArmSums):
    """An arm's sums in pairs."""
    made = LeverSums()
    made.angle_min = wp.float32(sums.angle_min)
    made.angle_max = wp.float32(sums.angle_max)
    made.angle = pair_of(sums.angle)
    made.angle_square = pair_of(sums.angle_square)
    made.moment = pair_of(sums.moment)
    made.dissipated = pair_of(sums.dissipated)
    return made


@wp.func
def arm_sums_of(made: LeverSums):
    """An arm's sums in float64."""
    sums = ArmSums()
    sums.angle_min = wp.float64(made.angle_min)
    sums.angle_max = wp.float64(made.angle_max)
    sums.angle = whole(made.angle)
    sums.angle_square = whole(made.angle_square)
    sums.moment = whole(made.moment)
    sums.dissipated = whole(made.dissipated)
    return sums
