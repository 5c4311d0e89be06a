"""Plug-ins of tests, as files."""

METRICS = """
import numpy as np
import warpchain


@warpchain.metric("tension_swing", unit="1", title="tension from least to largest, over its mean")
def tension_swing(run):
    return (run["tension_max"] - run["tension_min"]) / run["tension_mean"]


@warpchain.metric("tension_step", unit="N", title="largest change between frames", channels=["tension"])
def tension_step(run):
    assert run.window[0] <= run.trajectory.time[0] <= run.trajectory.time[-1] <= run.window[1] * (1 + 1e-12)
    return np.abs(np.diff(run["tension"], axis=0)).max()
"""

LAW = """
import math
from typing import Any

import numpy as np
import warp as wp
import warpchain


def zeta(e):
    return -math.log(e) / math.hypot(math.pi, math.log(e))


def rebound(zeta):
    root = math.sqrt(abs(1.0 - zeta * zeta))
    turned = math.acos(zeta) if zeta < 1.0 else math.acosh(zeta)
    return math.exp(-zeta * turned / root) if root > 1e-6 else math.exp(-1.0)


@wp.func
def none_of(x: Any):
    return type(x)(0.0)


@warpchain.contact_law(
    "approach", factor=zeta, rebound=rebound, unit=lambda K, m: 2.0 * np.sqrt(K * m), viscous=True
)
@wp.func
def approach_damper(elastic: Any, impact_speed: Any, damping: Any):
    return damping, none_of(elastic), type(elastic)(1.0e30)
"""
"""A spring with a damper that acts only while the roller approaches."""


LOADS = """
import numpy as np
import warpchain


@warpchain.load_law("piston", over="angle", end=2 * np.pi, rows=181)
def piston(angle):
    return 40.0 + 25.0 * np.cos(2.0 * angle)


@warpchain.load_law("rise", over="time", end=0.1, rows=11)
def rise(time):
    return 300.0 * time
"""

CHANNELS = """
import numpy as np
import warpchain


@warpchain.channel("link_power", unit="W", title="tension times the speed of the link", per="link",
                   channels=["tension", "velocity"])
def link_power(run):
    return run.tension * np.hypot(run.velocity[..., 0], run.velocity[..., 1])


@warpchain.metric("link_power_max", unit="W", title="largest power of a link", channels=["link_power"])
def link_power_max(run):
    return run["link_power"].max()
"""


def write_plugin(folder, text, name="own.py"):
    """Writes a plug-in's file; returns its path."""
    path = folder / name
    path.write_text(text)
    return path
