"""The drives, and the values that differ between variants, of `golden.py`."""

import math
from collections.abc import Sequence
from typing import Any

from common.drives import Values

import warpchain
from warpchain import Drive, Run

STUDY = """
factors = [
  {{ name = "torque", path = "sprockets.driven.load.torque", range = [100.0, 400.0]{points} }},
  {{ name = "teeth", path = "sprockets.driven.teeth", levels = [20, 21] }},
]
constraints = [{{ require = "torque < 350 or teeth > 20" }}]
[study]
drive = "pair.toml"
[design]
{design}
[adjust]
sprocket = "driven"
direction = [1.0, 0.0]
links = "even"
strain = "1e-6 * torque"
[run]
duration = 0.002
shard = 3
device = "cpu"
[record]
variants = [1]
worst = {{ metric = "tension_max", count = 2 }}
rate = 20000.0
[fatigue]
exponent = 5
range = 100
"""
DESIGNS = {"factorial": 'kind = "factorial"', "halton": 'kind = "halton"\ncount = 5'}
DESIGNS |= {"latin": 'kind = "latin-hypercube"\ncount = 6\nseed = 3', "sobol": 'kind = "sobol"\ncount = 4'}

ISO: Values = {
    "contact.sprocket.profile": "iso606",
    "contact.sprocket.clearance": None,
    "contact.sprocket.seat_angle": None,
}
PROFILES: dict[str, Values] = {"circular": {}, "minimum": ISO | {"contact.sprocket.gap": "minimum"}}
PROFILES |= {"maximum": ISO | {"contact.sprocket.gap": "maximum"}}
LAWS = [(law, n) for law in ("lankarani-nikravesh", "flores", "hunt-crossley") for n in (1.0, 1.5)]
LAWS += [("kelvin-voigt", 1.0)]
WORN: Values = {
    "chain.elongation": 1e-4,
    "chain.worn_links": [{"link": 3, "elongation": 1e-3}, {"link": 7, "elongation": 2e-3}],
}

WHEEL = {"mass": 2.0, "radius": 0.05, "phase": 0.3}
SPRINGS = {"kind": "elastic", "stiffness": [1e6, 1e6], "damping": [1e3, 1e3], "preload": [2e3, -500.0]}
SLIDER = {"kind": "slider", "direction": [1.0, 0.2], "stiffness": 1e5, "damping": 200.0, "preload": 1e3}
SHAKEN = {"kind": "prescribed", "direction": [0.0, 1.0], "offset": 1e-5, "amplitude": 1e-4, "frequency": 40.0}
MOUNTS: list[Values] = [
    {"sprockets.driven.mount": SPRINGS, "sprockets.driven.mass": 30.0, "sprockets.driven.balance_wheel": WHEEL},
    {"sprockets.driven.mount": SLIDER, "sprockets.driven.mass": 30.0, "sprockets.driver.mount": SHAKEN},
    {"sprockets.driven.mount": {"kind": "fixed"}, "sprockets.driver.balance_wheel": WHEEL},
]

TURN = 2.0 * math.pi
SPEED, LOAD = "sprockets.driver.prescribed", "sprockets.driven.load"
OVER_TIME: Values = {"time": [0.0, 2e-3, 7e-3], "interpolation": "cubic"}
OVER_ANGLE: Values = {"angle": [0.0, 1.0, 2.0, TURN]}
TABLES: list[Values] = [
    {f"{SPEED}.table": OVER_TIME | {"speed": [5.0, 12.0, 9.0]}, f"{LOAD}.ramp_time": 5e-3},
    {f"{SPEED}.table": OVER_ANGLE | {"speed": [9.0, 10.0, 9.5, 9.0], "factor": 1.5}, f"{LOAD}.viscous": 2.0},
    {f"{LOAD}.table": OVER_TIME | {"torque": [0.0, 500.0, 100.0]}, f"{LOAD}.quadratic": 0.5},
    {f"{LOAD}.table": OVER_ANGLE | {"torque": [0.0, 90.0, -40.0, 0.0], "interpolation": "cubic", "shaft": "driver"}},
    {f"{SPEED}.harmonics": [{"order": 2.5, "amplitude": 0.05, "phase": 0.2}], f"{SPEED}.ramp_time": 4e-3},
    {f"{LOAD}.harmonics": [{"order": 6, "amplitude": 80.0}, {"order": 2, "amplitude": 50.0, "shaft": "driver"}]},
]
ARCHIVES: dict[str, Values] = {
    "zstd": {},
    "none": {"compression": "none", "seed": 7, "attachments": {"note.csv": b"a,b\n"}},
    "lz4": {"compression": "lz4", "values": "float32", "exact_positions": True},
    "split": {"split_variants": 1},
}


def run_on_one_core(drives: Drive | Sequence[Drive], **settings: Any) -> Run:
    """Simulates on one core."""
    return warpchain.simulate(drives, device="cpu", workers=1, **settings)
