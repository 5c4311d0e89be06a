"""Tensioners at float32 without float64, against those at float64."""

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel
from pairs import BLOCKS, both, given, launched
from tensioner_rig import RELIEF, VENT, moved, tensioner

from warpchain.kernels.number import float64_from_pair, leading_value, pair_from_float64, vector
from warpchain.kernels.physics.body import pose_of
from warpchain.kernels.physics.tensioner import (
    advance_tensioner,
    extension_rate,
    plunger_arm,
    plunger_extension,
    resting_state,
    tensioner_energy,
    tensioner_force,
)
from warpchain.kernels.structs import BodyState, Tensioner, Valve
from warpchain.kernels.sums import add_flows

COLUMNS = (
    "force", "pressure", "energy", "leaked", "supplied", "leak_loss", "valve_loss", "work", "content", "relieved",
    "vented",
)  # fmt: skip
CASES = [(0.0, {}), (0.01, {}), (0.06, {}), (0.01, RELIEF | VENT), (0.01, {"drained": 0.2, "rest": 1e5})]
"""Air, and what is unlike the published tensioner: its outlets, and a drained start."""
FLOWING = {"leaked", "supplied", "leak_loss", "valve_loss", "work", "relieved", "vented"}


def at_both(t):
    """A tensioner, and the same as blocks at float32 keep it, as arrays."""
    values = {name: getattr(t, name) for name in Tensioner.vars if name != "supply_table"}
    for name in ("check", "relief", "vent"):
        values[name] = tuple(getattr(values[name], field) for field in Valve.vars)
    return both(Tensioner, **{name: tuple(v) if isinstance(v, wp.vec2d) else v for name, v in values.items()})


@kernel
def lead(
    places: wp.array[wp.float64],
    h: wp.float64,
    exact: wp.array[Tensioner],
    ours: wp.array[BLOCKS.Tensioner],
    every: int,
    out: wp.array2d[wp.float64],
):
    t = ours[0]
    rest = resting_state(places[0], exact[0])
    state = BLOCKS.TensionerState()
    state.content = pair_from_float64(rest.content)
    state.root = wp.float32(rest.root)
    state.farthest = wp.float32(rest.farthest)
    state.unfilled = wp.float32(rest.unfilled)
    meter = BLOCKS.TensionerFlows()
    for i in range(1, places.shape[0]):
        x = pair_from_float64(places[i])
        rate = wp.float32((places[i] - places[i - 1]) / h)
        after, flows = advance_tensioner(x, rate, wp.float32(h), True, state, t)
        state = after
        meter = add_flows(meter, flows)
        force, pressure = tensioner_force(x, rate, True, state, t)
        if i % every == 0:
            row = i // every - 1
            out[row, 0] = wp.float64(force)
            out[row, 1] = wp.float64(pressure)
            out[row, 2] = wp.float64(tensioner_energy(x, pressure, state, t))
            out[row, 3] = float64_from_pair(meter.leaked)
            out[row, 4] = float64_from_pair(meter.supplied)
            out[row, 5] = float64_from_pair(meter.leak_loss)
            out[row, 6] = float64_from_pair(meter.valve_loss)
            out[row, 7] = float64_from_pair(meter.supply_work)
            out[row, 8] = float64_from_pair(state.content)
            out[row, 9] = float64_from_pair(meter.relieved)
            out[row, 10] = float64_from_pair(meter.vented)


@pytest.mark.parametrize(("air", "outlets"), CASES)
def test_a_led_plunger_at_float32_does_what_it_does_at_float64(air, outlets):
    # five turns of a shaker in a hundred thousand steps: the valve opens, oil leaks, the chamber is pressed to 30 bar
    t, steps, every = tensioner(air=air, ratchet_pitch=1e-3, backlash=2e-4, **outlets), 100_000, 100
    places = 1e-4 * np.sin(2.0 * np.pi * 5.0 * np.arange(steps + 1) / steps) + 1.5e-3
    h = 1.0 / (200.0 * steps / 5.0)
    out = launched(lead, 1, given(places), h, *at_both(t), every, width=len(COLUMNS), rows=steps // every)
    found = dict(zip(COLUMNS, out.T, strict=True))
    exact = moved(t, places, h)
    wanted = {key: exact[key][every::every] for key in COLUMNS if key != "content"}
    for key in FLOWING:
        wanted[key] = np.cumsum(exact[key])[every::every]
    assert wanted["pressure"].max() > 5e5 and wanted["supplied"][-1] > 0.0
    assert all(wanted[key][-1] > 0.0 for key in ("relieved", "vented") if "vent.preload" in outlets)
    # the root is found to 1e-8 and held to 6e-8; P = z^7, and forces lose P_0 A; what flows hangs on both and adds up
    for key, values in wanted.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(found[key], values, rtol=0, atol=2e-5 * scale, err_msg=key)


@kernel
def touch(
    angles: wp.array[wp.float64],
    exact: wp.array[Tensioner],
    ours: wp.array[BLOCKS.Tensioner],
    center: wp.vec2d,
    out: wp.array2d[wp.float64],
):
    i = wp.tid()
    body = BodyState()
    body.angle = angles[i]
    pose = pose_of(body)
    arm = plunger_arm(pose, exact[0])
    found = BLOCKS.Pose()
    found.cosine = pair_from_float64(pose.cosine)
    found.sine = pair_from_float64(pose.sine)
    arm_found = plunger_arm(found, ours[0])
    x = plunger_extension(vector(pair_from_float64(center[0]), pair_from_float64(center[1])), arm_found, ours[0])
    out[i, 0] = float64_from_pair(x) - plunger_extension(center, arm, exact[0])
    rate = extension_rate(leading_value(arm_found), float(1.0), wp.vec2f(), ours[0])
    out[i, 1] = wp.float64(rate) - extension_rate(arm, wp.float64(1.0), wp.vec2d(), exact[0])


def test_the_extension_in_pairs_is_that_of_float64():
    t = tensioner(point=wp.vec2d(0.21, -0.037), home=wp.vec2d(1.312, 0.433), direction=wp.vec2d(-0.6, 0.8))
    angles = np.random.default_rng(7).uniform(-0.5, 0.5, 5000)
    found = np.abs(launched(touch, len(angles), given(angles), *at_both(t), wp.vec2d(1.1, 0.47), width=2))
    # products and sums of numbers below 1.5 m to a few parts in 2^48; the rate is the lever, in float32
    assert found[:, 0].max() <= 16 * 2.0**-48 * 1.5
    assert found[:, 1].max() <= 4 * 2.0**-24 * 0.22
