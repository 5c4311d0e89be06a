"""A tensioner by itself in tests: its numbers, and kernels that move it as they are told or load it."""

import math
from types import SimpleNamespace

import numpy as np
import warp as wp
from own_kernels import kernel

from warpchain import loads_drive
from warpchain.drive.examples import FOLDER
from warpchain.engine.body_struct_rows import oil_energies
from warpchain.kernels.physics.tensioner import (
    advance_tensioner,
    chamber_pressure,
    oil_compression,
    oil_specific_energy,
    pressure_root,
    resting_state,
    tensioner_energy,
    tensioner_force,
    valve_flow,
    valve_lift,
)
from warpchain.kernels.structs import Tensioner, TensionerState

DIAMETER, GAP, LENGTH, ECCENTRICITY = 16e-3, 50e-6, 7e-3, 0.9
HOLE, DENSITY, VISCOSITY, MODULUS = 1.4e-3, 800.0, 8e-5, 8e8
COLUMNS = (
    "x", "force", "pressure", "energy", "leaked", "supplied", "leak_loss", "valve_loss", "work", "lift", "mass",
    "relieved", "vented", "filling", "unfilled",
)  # fmt: skip

BLOCK = """
[[tensioners]]
name = "element"
on = "tensioner"
at = [0.038317, 0.18]
direction = [-1.0, 0.0]
kind = "hydraulic"
spring = { stiffness = 3500.0, preload = 90.0 }
plunger = { diameter = 0.016, mass = 0.033, gap = 5.0e-5, length = 0.007, eccentricity = 0.9 }
chamber = { volume = 1.0e-6 }
valve = { ball_radius = 0.003, seat_diameter = 0.0014, lift = 0.001, stiffness = 75.0, preload = 0.075 }
oil = { density = 800.0, viscosity = 8.0e-5, bulk_modulus = 8.0e8, air = 0.01, supply = 3.0e5, ambient = 1.0e5 }
ratchet = { pitch = 0.001, backlash = 2.0e-4 }

[[tensioners]]
name = "plain"
on = "tensioner"
at = [0.038317, 0.18]
direction = [-1.0, 0.0]
kind = "spring"
spring = { stiffness = 3500.0, preload = 90.0, damping = 20.0 }
"""
"""Two tensioners on the engine's slider: that of the model's section on bodies with a ratchet, and a spring."""

TEXT = (FOLDER / "engine.toml").read_text() + BLOCK


def engine():
    """The engine with both."""
    return loads_drive(TEXT)


def oil_modulus(tensioner, pressure):
    """E = E_0 (1 + a) / (1 + a (E_0/n) P_0^(1/n) P^(-1 - 1/n)) [Pa] of a drive's oil with its air."""
    oil, n = tensioner.oil, 1.4
    soft = oil.air * oil.bulk_modulus / (n * oil.ambient) * (oil.ambient / pressure) ** (1.0 + 1.0 / n)
    return oil.bulk_modulus * (1.0 + oil.air) / (1.0 + soft)


def tensioner(air=0.01, **values):
    """The tensioner of the model's section on bodies, at rest at 2.508 bar, with a share of air; `values` change what
    they name, those of valves as "check.lift_max".
    """
    made, slope = Tensioner(), math.radians(45.0)
    leak = math.pi * DIAMETER * GAP**3 * (1.0 + 1.5 * ECCENTRICITY**2) / (12.0 * DENSITY * VISCOSITY * LENGTH)
    numbers = {
        "direction": wp.vec2d(1.0, 0.0), "stiffness": 3500.0, "preload": 90.0, "hydraulic": 1,
        "area": 0.25 * math.pi * DIAMETER**2, "volume": 1e-6, "leak": leak, "drag": 0.5 * math.pi * DIAMETER * GAP,
        "supply": 3e5, "ambient": 1e5, "floor": 0.01 ** (1 / 7), "rest": 250824.87602763646,
        "oil_share": 1e5 / (MODULUS * (1.0 + air)), "air_share": air / (1.0 + air),
        "check.hole_area": 0.25 * math.pi * HOLE**2, "check.preload": 0.075, "check.compliance": 1.0 / 75.0,
        "check.lift_max": 1e-3, "check.seat_width": 6e-3 * math.tan(slope),
        "check.seat_growth": math.sin(slope) / math.cos(slope) ** 2, "check.discharge": 0.2, "density": DENSITY,
        "laminar_limit": 5e3, "bottom": -4.5e-3, "stop_stiffness": 1e7,
    }  # fmt: skip
    for name, value in (numbers | values).items():
        valve, _, field = name.rpartition(".")
        setattr(getattr(made, valve) if valve else made, field, value)
    oil = SimpleNamespace(air=air, bulk_modulus=MODULUS, ambient=made.ambient, supply=made.supply)
    made.still, made.supplied = oil_energies(oil)
    return made


RELIEF = {
    "relief.hole_area": 0.25 * math.pi * 2e-3**2, "relief.preload": 4e5 * 0.25 * math.pi * 2e-3**2,
    "relief.compliance": 1.0 / 2e4, "relief.lift_max": 3e-4, "relief.seat_width": 2e-3, "relief.discharge": 0.6,
}  # fmt: skip
"""A relief valve of 2 mm that opens at 5 bar; its 0.3 mm are reached 19 bar above that."""

VENT = {
    "vent.hole_area": 0.6 * 0.25 * math.pi * 2e-4**2, "vent.preload": -1.0, "vent.compliance": 1.0,
    "vent.lift_max": 1.0, "vent.seat_width": 1.0, "vent.discharge": 1.0,
}  # fmt: skip
"""A vent of 0.2 mm, as drives give it to kernels."""


def still(pressure=1e5, **values):
    """A tensioner whose valve does not lift, at rest at a pressure [Pa], without what the plunger drags along."""
    return tensioner(**{"check.lift_max": 0.0, "rest": pressure, "drag": 0.0} | values)


@wp.func
def noted(x: wp.float64, rate: wp.float64, state: TensionerState, t: Tensioner, out: wp.array2d[wp.float64], i: int):
    """Writes what the columns name for a place; what flows is written by `flowed`."""
    force, pressure = tensioner_force(x, rate, True, state, t)
    out[i, 0] = x
    out[i, 1] = force
    out[i, 2] = pressure
    out[i, 3] = tensioner_energy(x, pressure, state, t)
    out[i, 10] = t.volume * wp.exp(state.content)
    return force


@wp.func
def flowed(state: TensionerState, x: wp.float64, rate: wp.float64, h: wp.float64, t: Tensioner,
           out: wp.array2d[wp.float64], i: int):  # fmt: skip
    """A step's flows."""
    state, flows = advance_tensioner(x, rate, h, True, state, t)
    out[i, 4] = flows.leaked
    out[i, 5] = flows.supplied
    out[i, 6] = flows.leak_loss
    out[i, 7] = flows.valve_loss
    out[i, 8] = flows.supply_work
    out[i, 9] = valve_lift(t.supply - chamber_pressure(x, True, state, t), t.check)
    out[i, 11] = flows.relieved
    out[i, 12] = flows.vented
    out[i, 13] = flows.filling
    out[i, 14] = wp.float64(flows.unfilled)
    return state


@kernel
def move(places: wp.array[wp.float64], h: wp.float64, t: Tensioner, out: wp.array2d[wp.float64]):
    """A plunger that is led from place to place."""
    state = resting_state(places[0], t)
    rate = wp.float64(0.0)
    noted(places[0], rate, state, t, out, 0)
    for i in range(1, places.shape[0]):
        rate = (places[i] - places[i - 1]) / h
        state = flowed(state, places[i], rate, h, t, out, i)
        noted(places[i], rate, state, t, out, i)


@kernel
def load(x: wp.float64, mass: wp.float64, loads: wp.array[wp.float64], h: wp.float64, t: Tensioner,
         out: wp.array2d[wp.float64]):  # fmt: skip
    """A mass that is pressed inwards, by leapfrog from rest at x."""
    state = resting_state(x, t)
    rate = wp.float64(0.0)
    for i in range(loads.shape[0]):
        force = noted(x, rate, state, t, out, i)
        kick = wp.where(i == 0, wp.float64(0.5) * h, h)
        rate += kick * (force - loads[i]) / mass
        x += h * rate
        state = flowed(state, x, rate, h, t, out, i)


@kernel
def look(pressures: wp.array[wp.float64], near: wp.array[wp.float64], t: Tensioner, out: wp.array2d[wp.float64]):
    """Functions of the pressure, and the pressure again from the content at x = 0, from other ones to begin at."""
    i = wp.tid()
    pressure = pressures[i]
    z = pressure_root(pressure, t)
    phi, slope = oil_compression(z, t)
    flow, flow_slope = valve_flow(t.supply - pressure, t.check, t)
    state = TensionerState()
    state.content = phi
    state.root = pressure_root(near[i], t)
    out[i, 0] = phi
    energy, volume = oil_specific_energy(pressure_root(pressure, t), t)
    out[i, 1] = energy
    out[i, 2] = wp.float64(7.0) * pressure / (z * slope)  # E = dP/dphi with P = P_0 z^7
    out[i, 3] = flow
    out[i, 4] = -flow_slope
    out[i, 5] = valve_lift(t.supply - pressure, t.check)
    out[i, 6] = chamber_pressure(wp.float64(0.0), False, state, t)


def array(values):
    return wp.array(np.asarray(values, dtype=float), dtype=wp.float64, device="cpu")


def columns(out):
    return dict(zip(COLUMNS, out.numpy().T, strict=True))


def moved(t, places, h):
    """What a tensioner does while its plunger is led through `places` [m], `h` [s] apart; by column."""
    out = wp.zeros((len(places), len(COLUMNS)), dtype=wp.float64, device="cpu")
    wp.launch(move, dim=1, inputs=[array(places), h, t, out], device="cpu")
    return columns(out)


def loaded(t, loads, h, x=0.0, mass=0.05):
    """What it does while `loads` [N], `h` [s] apart, press a mass [kg] against it; by column."""
    out = wp.zeros((len(loads), len(COLUMNS)), dtype=wp.float64, device="cpu")
    wp.launch(load, dim=1, inputs=[x, mass, array(loads), h, t, out], device="cpu")
    return columns(out)


def looked(t, pressures, near=None):
    """phi, u, E, Q_cv, dQ_cv/dP, lift and P(phi, 0) at pressures [Pa], as rows."""
    out = wp.zeros((len(pressures), 7), dtype=wp.float64, device="cpu")
    near = pressures if near is None else near
    wp.launch(look, dim=len(pressures), inputs=[array(pressures), array(near), t, out], device="cpu")
    return out.numpy().T
