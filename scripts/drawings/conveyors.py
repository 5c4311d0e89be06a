"""Figures of the conveyors of docs/conveyors.md."""

import argparse
import math
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example_drive

from warpchain import Limits, Record, simulate
from warpchain.view.figures.figure_style import panel_grid

GRAVITY = 9.81


@case()
def conveyors(_: argparse.Namespace) -> Iterator[Line]:
    """Pull of `chain_conveyor` and power of `bucket_elevator`, by hand and by run; both starts.

    python scripts/figures.py conveyors
    """
    figure, axes = panel_grid(4, 2, 6.0, 2.1)
    yield ("what", "by hand", "by run")
    yield from _conveyor_rows(axes[:2])
    yield from _elevator_rows(axes[2:])
    for axis in axes:
        axis.margins(x=0.0)
    for axis in axes[-2:]:
        axis.set_xlabel("time [s]")
    yield {"conveyors": figure}


def _conveyor_rows(axes: list) -> Iterator[Line]:
    """Rows of `chain_conveyor`: the head's pull as a sum of friction, feed and bearing."""
    drive = example_drive("chain_conveyor")
    chain, (rail,) = drive.chain, drive.guides
    load, rubbing = chain.load, drive.contact.guide
    assert load is not None and load.end is not None and rail.start is not None and rail.end is not None
    assert rubbing is not None and rubbing.friction is not None and chain.mass_per_length is not None
    run = simulate(drive, record=Record(rate=500.0), window=(4.0, 8.0), limits=Limits())
    (row,) = run.metrics.to_pylist()
    radius = 0.5 * chain.pitch / math.sin(math.pi / 16)
    speed = 1.5 * 16 * chain.pitch / math.tau
    length = 0.5 * (rail.end[0] - rail.start[0] + drive.sprockets[1].center[0])  # and half of what is beside it
    goods = load.load_per_length * (load.end - load.begin)
    tension = row["tension_mean"]
    by_hand = {
        "friction on the rail, mu g (w L + q l)": rubbing.friction * GRAVITY * (chain.mass_per_length * length + goods),
        "goods brought to the chain's speed, q v^2": load.load_per_length * speed**2,
        "bearing of the tail, 2 T mu r / R": 2.0 * tension * 0.1 * 0.03 / radius,
    }
    seconds = row["window_end"] - row["window_start"]
    by_run = (row["rail.friction"], row["goods.work"], row["tail.bearing_friction"])
    for (name, force), work in zip(by_hand.items(), by_run, strict=True):
        yield f"`chain_conveyor`: {name} [N]", f"{force:.1f}", f"{work / seconds / speed:.1f}"
    pull = row["input_work"] / seconds / speed
    yield "`chain_conveyor`: pull at the head [N]", f"{sum(by_hand.values()):.1f}", f"{pull:.1f}"
    time, tensions = run[0].time, np.asarray(run[0].tension, float)
    axes[0].plot(time, 1e-3 * tensions.max(axis=1), label="most tense link")
    axes[0].plot(time, 1e-3 * tensions.min(axis=1), label="least tense link")
    axes[0].set_ylabel("chain_conveyor:\ntension [kN]")
    axes[0].set_ylim(0.0, 11.5)
    axes[0].legend(fontsize=7, frameon=False, loc="upper right", ncol=2)
    axes[1].plot(time, np.abs(np.asarray(run[0].sprocket_speed, float)))
    axes[1].set_ylabel("speeds of tail\nand head [rad/s]")


def _elevator_rows(axes: list) -> Iterator[Line]:
    """Rows of `bucket_elevator`: power on goods, strand at the head, torque that the backstop holds."""
    drive = example_drive("bucket_elevator")
    load = drive.chain.load
    assert load is not None
    run = simulate(drive, record=Record(rate=500.0), window=(0.8, 1.6), limits=Limits())
    (row,) = run.metrics.to_pylist()
    pitch, radius = drive.chain.pitch, 0.5 * drive.chain.pitch / math.sin(math.pi / 20)
    speed = abs(row["head.speed_mean"]) * 20 * pitch / math.tau
    height = drive.sprockets[1].center[1] - load.begin
    seconds = row["window_end"] - row["window_start"]
    power = load.load_per_length * speed * (GRAVITY * height + speed**2)
    yield "`bucket_elevator`: power on goods, q v (g H + v^2) [W]", f"{power:.0f}", f"{row['goods.work'] / seconds:.0f}"
    time = np.asarray(run[0].time)
    held = np.asarray(run[0].coupling_torque, float)[:, 0]
    torque = load.load_per_length * height * GRAVITY * radius
    late = time > 2.7
    yield "`bucket_elevator`: torque that the backstop holds [N m]", f"{torque:.0f}", f"{held[late].mean():.0f}"
    tension = np.asarray(run[0].tension, float).max(axis=1)
    steady = tension[(time > 0.8) & (time < 1.6)].mean()
    speeding_up = (time > 0.15) & (time < 0.8)  # the head has come to lie against the backstop before
    peak = f"{tension[speeding_up].max() / steady:.2f}"
    yield "`bucket_elevator`: largest tension as it speeds up over that at work", "-", peak
    axes[0].plot(time, 1e-3 * tension)
    axes[0].set_ylabel("bucket_elevator:\nmost tense link [kN]")
    axes[1].plot(time, np.abs(np.asarray(run[0].sprocket_speed, float))[:, 1], label="head [rad/s]")
    axes[1].plot(time, 1e-2 * np.abs(held), label="backstop [100 N m]")
    axes[1].legend(fontsize=7, frameon=False)
