"""Block kernels on cooperative fibers of the CPU, and drives of every kind to hold them against the CPU's kernels."""

import tomllib
from dataclasses import replace
from functools import cache, partial
from itertools import accumulate, product

import chains
import numpy as np
import pytest
import warp as wp
from drives import jointed_blade, timing, two_sprockets
from open_chains import hoist
from parts import coupling, gears, shaft
from raw import stepped
from silent_chains import guided_silent_drive, silent_drive

from warpchain import Drive, dumps_drive, load_drive
from warpchain.drive.drive import drive_values
from warpchain.drive.examples import drive_path
from warpchain.engine.arrays import ARRAYS, device_values, empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.gpu_kernels import block_kind as engine_kind
from warpchain.engine.gpu_kernels import block_shape, roller_capacity, variant_kind_columns
from warpchain.engine.pack import pack
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.shared_memory import block_memory
from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.kernels.statistics import BINS
from warpchain.model import Model
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.channels import CHANNEL_NAMES, PartCounts, drive_frame_width, frame_with_channels
from warpchain.results.schedule import Schedule, schedules_as_columns

OTHER_TEETH = {
    "chain.worn_links": [{"link": 3, "elongation": 1e-3}],
    "contact.sprocket.law": "kelvin-voigt",
    "contact.sprocket.profile": "iso606",
    "contact.sprocket.gap": "maximum",
    "contact.sprocket.clearance": None,
    "contact.sprocket.seat_angle": None,
}


def marine():
    drive = load_drive(drive_path("marine")).with_values({"run.step": 1e-5})
    return [drive, drive.with_values({"sprockets.camshaft.load.torque": 5e3, "run.step": 8e-6})]


def led_elsewhere():
    """A drive two of whose three sprockets are prescribed, and one whose last is."""
    first = load_drive(drive_path("marine")).with_values({"run.step": 1e-5})
    crankshaft, tightener, camshaft = first.sprockets
    speeds = [crankshaft.prescribed.speed * crankshaft.teeth / other.teeth for other in (tightener, camshaft)]
    free = {"sprockets.crankshaft.prescribed": None, "sprockets.crankshaft.inertia": 900.0}
    return [
        first.with_values({"sprockets.tightener.prescribed": {"speed": speeds[0]}}),
        first.with_values({"sprockets.camshaft.prescribed": {"speed": speeds[1]}}).with_values(free),
    ]


def equal_sprockets():
    return [two_sprockets(), two_sprockets(teeth=24, links=64, torque=100.0).with_values(OTHER_TEETH)]


def light_wheels():
    """Wheels of the inertia of one roller at their pitch radius."""
    light = two_sprockets(teeth=24, links=64, torque=100.0, inertia=0.037).with_values(OTHER_TEETH)
    return [two_sprockets(inertia=0.026), light]


def long_chains():
    return [two_sprockets(links=320, span=150.0), two_sprockets(links=340, span=160.0)]


def unusual_contacts():
    table = {"time": [0.0, 5e-4, 2e-3], "torque": [0.0, 500.0, 100.0]}
    drives = [
        {
            "contact.sprocket.profile": "iso606",
            "contact.sprocket.gap": "maximum",
            "contact.sprocket.clearance": None,
            "contact.sprocket.seat_angle": None,
            "contact.sprocket.law": "kelvin-voigt",
            "sprockets.driven.load.table": table,
        },
        {
            "contact.sprocket.law": "flores",
            "contact.sprocket.exponent": 1.5,
            "contact.sprocket.stiffness": 1e10,
            "chain.worn_links": [{"link": 7, "elongation": 2e-3}],
            "chain.elongation": 1e-4,
        },
    ]
    return [two_sprockets().with_values(values) for values in drives]


def moving_sprockets():
    springs = {"kind": "elastic", "stiffness": [1e6, 1e6], "damping": [1e3, 1e3], "preload": [2e3, -500.0]}
    slider = {"kind": "slider", "direction": [1.0, 0.2], "stiffness": 1e5, "damping": 200.0, "preload": 1e3}
    shaken = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 40.0}
    wheel = {"mass": 2.0, "radius": 0.05, "phase": 0.3}
    drives = [
        {"sprockets.driven.mount": springs, "sprockets.driven.mass": 30.0, "sprockets.driven.balance_wheel": wheel},
        {"sprockets.driven.mount": slider, "sprockets.driven.mass": 30.0, "sprockets.driver.mount": shaken},
    ]
    return [two_sprockets().with_values(values) for values in drives]


def large(kind, blocks):
    """What `upload_state` is to keep in global memory for such blocks."""
    of = block_memory(kind)
    return blocks * of.values, blocks * of.part_values


def kind_of(packed, shape, measuring=True):
    """The kind of the block kernel, with metrics or without, for an ensemble of like drives that has these blocks."""
    columns = {name: values.max() for name, values in variant_kind_columns(packed).items()}
    columns["linear_hysteretic"] = packed.has_linear_hysteretic_contacts.all()
    kind = engine_kind(packed.real, columns, 1)
    moving = kind.moving or packed.frame.holds("hub_force")
    return replace(kind, shape=shape, measuring=measuring, moving=moving)


def rk4():
    drives = [*equal_sprockets()[:1], *moving_sprockets()[1:]]
    return [drive.with_values({"run.integrator": "rk4"}) for drive in drives]


BENDING = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = {"chain.joint": {"friction": 0.08, "static_friction": 0.12, "stribeck_speed": 0.02, "pin_radius": 0.02}}


def bending():
    first, second = marine()
    return [first.with_values(BENDING), second.with_values(STRIBECK)]


def bending_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in bending()]


RUBS = {"contact.sprocket.friction": 0.1, "contact.guide.friction": 0.2}
RUBS |= {"contact.sprocket.static_friction": 0.15, "contact.sprocket.stribeck_speed": 0.1}
"""Friction at teeth and guide-bars."""


def rubbing():
    """On a bar that rollers of its ends are pressed on and others have missed, and one that all have; tight chains."""
    drives = []
    for drive, deep in zip(marine(), (0.02, 0.05), strict=True):
        bar = {f"guides.0.{end}.0": getattr(drive.guides[0], end)[0] + deep for end in ("start", "end")}
        tight = {"chain.elongation": -2e-4, "sprockets.crankshaft.prescribed.ramp_time": 0.0}
        drives.append(drive.with_values(RUBS | bar | tight))
    return drives


def uneven():
    first, second = marine()
    outer = {"elongation": 1e-3, "stiffness": 1.2e9, "damping": 2e4}
    return [first.with_values(BENDING | {"chain.play": 2e-5}), second.with_values({"chain.outer": outer})]


BUCKETS = {"chain.attachments": [{"every": 3, "mass": 20.0, "first": 1}, {"mass": 50.0, "first": 7}]}
"""Masses of up to four rollers on some links."""


def bucketed():
    first, second = rubbing()
    return [first.with_values(BUCKETS | BENDING), second.with_values(BUCKETS | STRIBECK)]


def bucketed_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in bucketed()]


GOODS = {"load_per_length": 4.0, "between": ["wheel", "weight"], "begin": 0.1, "end": 0.28, "feed_speed": 0.3}


RIM = {
    "sprockets.start.center": [-0.18521, -0.4], "sprockets.start.rim": 0.1,
    "sprockets.start.prescribed": {"speed": 2.0, "ramp_time": 0.01},
}  # fmt: skip
"""The first end of `hoist` on the rim of a wheel that turns, at the same place."""


def hoists():
    """Open chains: from a rim to a swinging weight, with rubbing joints and goods; between a led end and a slider."""
    first = hoist()
    led = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-3, "frequency": 200.0}
    slider = {"kind": "slider", "direction": [0.0, -1.0], "stiffness": 1e3, "damping": 10.0, "preload": 50.0}
    return [
        first.with_values(BENDING | RIM | {"sprockets.wheel.load": {"torque": 5.0}, "chain.load": GOODS}),
        first.with_values({"sprockets.start.mount": led, "sprockets.weight.mount": slider}),
    ]


def silent():
    """Silent chains, tight, one with a worn link."""
    worn = {"chain.elongation": -5e-4, "chain.worn_links": [{"link": 3, "elongation": 1e-4}]}
    return [silent_drive().with_values({"chain.elongation": -2e-4}), silent_drive(torque=100.0).with_values(worn)]


def silent_rubbing():
    """Silent chains that rub, in their joints too, one with a wheel on a slider."""
    slider = {"kind": "slider", "direction": [1.0, 0.2], "stiffness": 1e5, "damping": 200.0, "preload": 2e3}
    pulled = {"sprockets.driven.mount": slider, "sprockets.driven.mass": 30.0}
    rubs = {name: value for name, value in RUBS.items() if "guide" not in name}
    return [drive.with_values(rubs | BENDING | more) for drive, more in zip(silent(), ({}, pulled), strict=True)]


def silent_guided():
    """Silent chains that rub on a bar and on a bent rail, which an arm on a spring carries."""
    arm = {"name": "arm", "pivot": [0.19, 0.06], "mass": 0.2, "center": [0.11, 0.05], "inertia": 2e-3}
    arm |= {"stiffness": 2e3, "damping": 1.0}
    values = drive_values(guided_silent_drive(**RUBS, **{"sprockets.driven.load": {"torque": 20.0}}))
    values["guides"][0]["arm"], values["run"]["step"] = "arm", 5e-6
    drive = Drive(**values | {"arms": [arm]})
    slow = {"sprockets.drive.prescribed.speed": 50.0, "contact.guide.law": "kelvin-voigt"}
    return [drive, drive.with_values(slow)]


def arms():
    """An arm with a hydraulic tensioner, and one with a spring, ratchet and damper against its stop."""
    coil = {"at": [-0.04, 0.15], "anchor": [-0.14, 0.16], "stiffness": 500.0, "free_length": 0.11, "damping": 2.0}
    latched = {
        "arms.0.spring": coil,
        "tensioners.0.kind": "spring", "tensioners.0.chamber": None, "tensioners.0.valve": None,
        "tensioners.0.oil": None, "tensioners.0.ratchet": {"pitch": 1e-3, "backlash": 2e-4},
        "tensioners.0.spring.damping": 50.0, "arms.0.damping": 1e-3, "arms.0.stiffness": 2.0,
        "arms.0.stops": [-12.0, -0.1],
    }  # fmt: skip
    return [timing(), timing().with_values(latched)]


def drawn():
    """Tensioners whose oil holds their plungers back, at once behind a sprung arm, or later: hardly any comes in."""
    weak = {"tensioners.0.spring.preload": 0.6109, "tensioners.0.valve.stiffness": 52090.0}
    sprung = {"arms.0.stiffness": 20.0, "arms.0.free_angle": -20.0, "tensioners.0.oil.supply": 1.1e5}
    loose = {"tensioners.0.spring.stiffness": 100.0, "tensioners.0.spring.damping": 2.0}
    return [timing().with_values(weak | sprung), timing().with_values(weak | loose)]


def oiled():
    """Five drives whose arm two tensioners push, that differ in a spring."""
    values = timing().model_dump(exclude_none=True)
    first = values["tensioners"][0]
    second = first | {"name": "second", "at": [-0.095, 0.19]}
    drive = type(timing())(**values | {"tensioners": [first, second]})
    return [drive.with_values({"tensioners.1.spring.preload": 40.0 + 5.0 * k}) for k in range(5)]


MOTOR = {"table": {"speed": [0.0, 12.0, 20.0], "torque": [300.0, 400.0, 0.0]}, "ramp_time": 1e-4}
GEARED = (
    shaft("engine", inertia=0.4, motor=MOTOR, initial_speed=10.0)
    + shaft("cross", inertia=0.6, load={"torque": 80.0, "viscous": 2.0})
    + shaft("governor", prescribed={"speed": 9.0, "harmonics": [{"order": 1.0, "amplitude": 0.05}]})
    + gears("primary", ["driver", "engine"], [41, 20])
    + coupling("cush", ["driven", "cross"], 4e4, damping=15.0, lash=1e-4)
    + coupling("slack", ["cross", "governor"], 1e3, damping=3.0)
)
"""A motor geared to the driver, a shaft with play on the driven sprocket, and a third that leads it a little."""


def trains(inertia=2.0):
    values = tomllib.loads(dumps_drive(two_sprockets(inertia=inertia)) + GEARED)
    values["sprockets"][0] |= {"inertia": 0.7}
    del values["sprockets"][0]["prescribed"]
    drive = Drive(**values)
    gas = {"angle": [0.0, 0.004, 0.011, 2.0, 4.0 * np.pi], "torque": [0.0, 300.0, -200.0, 100.0, 0.0], "factor": 0.5}
    return [drive, drive.with_values({"couplings.cush.lash": 0.0, "shafts.engine.motor.table": gas})]


def gear_changes():
    """Those trains, their play a clutch that slips and a gearbox that changes while it does, or is let out."""
    drive = trains()[0]
    table = {"time": [0.0, 5e-4, 8e-4, 1.2e-3], "torque": [50.0, 50.0, 0.0, 30.0]}
    gears = {"couplings.cush.clutch": {"table": table}, "couplings.slack.clutch": {"torque": 0.5}}
    ratios = [{"time": [0.0, 7.02e-4, time], "ratio": [-1.5, 0.0, 1.25]} for time in (9.03e-4, 8.01e-4)]
    return [
        drive.with_values({"couplings.slack.ratios": ratios[0], "couplings.slack.stiffness": 1e5}),
        drive.with_values({"couplings.cush.ratios": ratios[1]} | gears),
    ]


def gear_changes_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in gear_changes()]


def freewheels():
    """Those trains with a freewheel that is overrun, a brake over speed and a backstop, or a centrifugal clutch."""
    drive = trains()[0]
    named = {"stiffness": 2e4, "damping": 10.0}
    table = {"speed": [0.0, 20.0], "torque": [0.0, 300.0]}
    brake = named | {"name": "brake", "between": ["ground", "cross"], "clutch": {"table": table}}
    stop = named | {"name": "backstop", "between": ["ground", "driven"], "freewheel": True}
    cush, slack = drive.couplings
    by_speed = {"couplings.cush.clutch": {"table": table}, "shafts.governor.prescribed.speed": 8.0}
    by_speed |= {"shafts.engine.motor.governor": {"speed": 9.0, "band": 4.0, "most": 1.2}}
    held = stop | {"between": ["ground", "cross"]}
    return [
        drive.with_values({"couplings": [cush, slack, brake, stop]}).with_values({"couplings.slack.freewheel": True}),
        drive.with_values({"couplings": [cush, slack, held, brake]}).with_values(by_speed),
    ]


def freewheels_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in freewheels()]


CAMS = {
    "number": 2, "phases": [0.0, 90.0], "mass": 0.8, "spring": {"preload": 900.0, "stiffness": 2e4},
    "profile": {"lift": 0.02, "rise": 70.0, "dwell": 10.0, "fall": 60.0},
}  # fmt: skip


def valves():
    """Cams on a driven sprocket, a geared shaft and a led one of trains; others in the second."""
    named = (("a", "driven", -15.0), ("b", "engine", -40.0), ("c", "governor", -100.0))
    groups = [CAMS | {"name": f"valves {word}", "on": on, "phase": phase} for word, on, phase in named]
    drive = trains()[0].with_values({"valves": groups})
    return [drive, drive.with_values({"valves.valves b.on": "cross", "valves.valves c.profile.shape": "cosine"})]


def valves_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in valves()]


def trains_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in trains()]


def light_trains():
    """The same with a driven sprocket that is light beside its rollers."""
    return trains(inertia=0.02)


LIGHT = {"sprockets.idler.inertia": 4e-5, "sprockets.idler.mass": 0.05, "arms.0.inertia": 2e-3, "arms.0.mass": 0.1}
"""Of an idler on an arm that are light beside their rollers."""


def swung(**values):
    """An idler on an arm, one whose bearing rubs, the other in a drive whose last sprocket's does, too."""
    at_once = {"run.step": 5e-6, "chain.elongation": -2e-3, "contact.sprocket.clearance": 1e-5}
    at_once |= {"sprockets.gearbox.prescribed.ramp_time": 0.0, "sprockets.auger.load.ramp_time": 0.0}
    at_once |= {"sprockets.idler.inertia": 5e-3}  # 125 times that of `LIGHT`
    idler = load_drive(drive_path("swing_idler")).with_values(at_once | values)
    return [idler, idler.with_values({"sprockets.auger.bearing": {"friction": 0.1, "radius": 0.02}})]


def shod():
    """Those idlers with a bar on their arms, on which the upper strand lies."""
    values = swung()[0].model_dump(exclude_none=True)
    bar = {"name": "shoe", "start": [0.44, 0.1035], "end": [0.19, 0.081], "end_radius": 0.05, "arm": "swing arm"}
    values["guides"] = [bar]
    values["contact"]["guide"] = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e6}
    drive = Drive(**values)
    return [drive, drive.with_values({"sprockets.auger.load.torque": 120.0})]


def led():
    """Those idlers with the pivots of their arms led along a table, the second with its last sprocket's center, too."""
    table = {"time": [0.0, 4e-4, 1e-3, 2e-3], "x": [0.0, 1e-5, -2e-5, 0.0], "y": [0.0, -1e-5, 1e-5, 3e-5]}
    first, second = swung(**{"arms.0.pivot_table": table})
    center = {"kind": "prescribed", "table": {"time": table["time"], "y": table["x"], "factor": 0.5}}
    return [first, second.with_values({"sprockets.auger.mount": center})]


def led_light():
    return [drive.with_values(LIGHT) for drive in led()]


def led_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in led()]


def swung_trains():
    """Those idlers, the first on a shaft that a coupling ties to another."""
    shafts = [{"name": "on it", "inertia": 2e-3}, {"name": "beside", "inertia": 5e-3, "load": {"torque": 1.0}}]
    coupling = {"name": "soft", "between": ["on it", "beside"], "stiffness": 900.0, "damping": 0.1}
    tied = {"shafts": shafts, "couplings": [coupling], "sprockets.idler.shaft": "on it"}
    return [drive.with_values(tied) for drive in swung()]


def swung_light():
    return swung(**LIGHT)


def segments():
    """A blade of two segments, and one whose upper pivot is led and whose lower segment leans on a stop."""
    # so that no roller of the start is at the hair's breadth from a guide at which float32 decides by rounding
    drive = Drive(**jointed_blade()).with_values({"run.step": 1.6e-6, "run.phase": 0.2})
    # no knot at a step, where float32 may take the cell before it: accelerations jump there
    led = {"time": [0.0, 2.003e-4, 4.007e-4], "x": [0.0, 1e-5, -1e-5], "y": [0.0, -2e-5, 1e-5]}
    return [drive, drive.with_values({"arms.upper.pivot_table": led, "arms.lower.stops": [-5.0, -0.1]})]


def segments_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in segments()]


def folded():
    """Those idlers on an arm that hangs on one that comes after it."""
    base = {"name": "base", "pivot": [0.0, -0.2], "mass": 1.0, "center": [0.02, -0.15], "inertia": 0.02}
    base |= {"stiffness": 400.0, "free_angle": 10.0, "damping": 1.0}
    return [drive.with_values({"arms": [drive.arms[0].model_dump(exclude_none=True) | {"arm": "base"}, base]})
            for drive in swung()]  # fmt: skip


def folded_led():
    """The same, the pivot of what carries that arm led along a table."""
    table = led()[0].arms[0].pivot_table.model_dump(exclude_none=True)
    return [drive.with_values({"arms.base.pivot_table": table}) for drive in folded()]


def folded_light():
    return [drive.with_values(LIGHT) for drive in folded()]


def unjoined_folded():
    return [chains.twice(drive) for drive in folded()]


def swung_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in swung()]


def v6():
    """Four chains, three shafts, arms with tensioners: its loads at once, and with another one and a worn link."""
    at_once = {"run.step": 1e-6, "sprockets.crank.prescribed.ramp_time": 0.0}
    at_once |= {f"sprockets.{cam}.load.ramp_time": 0.0 for cam in ("left cam", "right cam", "exhaust cam")}
    drive = load_drive(drive_path("v6")).with_values(at_once)
    worn = {"chains.right.worn_links": [{"link": 4, "elongation": 1e-3}]}
    return [drive, drive.with_values({"sprockets.exhaust cam.load.torque": 4.0} | worn)]


def v6_fed():
    """The same with supplies of two chains' tensioners over the speeds of sprockets there."""
    over = {
        f"tensioners.{side} tensioner.oil.supply_table": {
            "speed": speed,
            "pressure": [1e5, 8e5],
            "shaft": f"{side} cam",
        }
        for side, speed in (("left", [0.0, 300.0]), ("right", [100.0, 900.0]))
    }
    return [drive.with_values(over) for drive in v6()]


def stages_of_two_chains():
    """Two chains that differ in all: in pitch, in how links alternate, and one with play whose joints rub."""
    drive = chains.two_stages(step=2e-6)
    outer = {"elongation": 1e-3, "stiffness": 6e7, "damping": 1500.0}
    joint = {"friction": 0.1, "pin_radius": 0.008}
    unlike = {"chains.first.outer": outer, "chains.second.play": 1e-5, "chains.second.joint": joint}
    return [drive, drive.with_values(unlike)]


def light_stages():
    """The same alike, with a shaft that is light beside the rollers of both chains."""
    light = {"sprockets.mid in.inertia": 1e-3, "sprockets.mid out.inertia": 1e-3}
    drive = chains.two_stages(step=2e-6).with_values(light)
    return [drive, drive.with_values({"sprockets.out.load.torque": 100.0})]


def geared_light_stages():
    """Two tight stages on gears between bodies that are light beside their rollers."""
    tight = {f"chains.{name}.elongation": -2e-3 for name in ("first", "second")}
    drive = chains.light_gears(step=2e-6).with_values(tight)
    return [drive, drive.with_values({"sprockets.out.load.torque": 100.0})]


def stages_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in stages_of_two_chains()]


def geared_stages():
    """Two stages with gears and a coupling, and with less load."""
    drive = chains.motored_stages(step=2e-6)
    return [drive, drive.with_values({"shafts.wheel.load.torque": 100.0})]


def cushed_stages():
    """Two stages, with bodies that are light beside their rollers, on a coupling."""
    light = {"sprockets.mid in.inertia": 1e-3, "sprockets.mid out.inertia": 0.02, "shafts.pump.inertia": 2e-3}
    drive = chains.cushed_stages(step=2e-6).with_values(light)
    stop = {"name": "backstop", "between": ["ground", "mid out"], "stiffness": 1e4, "freewheel": True}
    brake = {"name": "brake", "between": ["ground", "out"], "stiffness": 1e4, "clutch": {"torque": 40.0}}
    return [drive, drive.with_values({"couplings": [drive.couplings[0], stop, brake]})]


def valved_stages():
    """Two stages with valves on the shaft between them, on a sprocket of the second and on the geared pump; others."""
    named = (("a", "mid", -15.0), ("b", "out", -40.0), ("c", "pump", -100.0))
    groups = [
        CAMS | {"name": f"valves {word}", "on": on, "phase": phase, "phases": [30.0 * k for k in range(6)]}
        for word, on, phase in named
    ]  # more cams in all than a kernel for those of one chain has room for
    light = {"sprockets.mid in.inertia": 0.02, "sprockets.mid out.inertia": 0.02}
    drive = chains.plus(chains.two_stages(step=2e-6), chains.PUMP).with_values(light | {"valves": groups})
    return [drive, drive.with_values({"valves.valves b.on": "mid out", "valves.valves c.profile.shape": "cosine"})]


def unjoined():
    """Two chains, each with an idler on an arm, that nothing joins."""
    return [chains.twice(drive) for drive in swung()]


def unjoined_light():
    return [chains.twice(drive) for drive in swung_light()]


def arms_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in arms()]


def pushed_slider():
    """A sprocket on a slide with a tensioner on it, and another drive whose slide a spring pushes."""
    mount = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 1e5, "damping": 200.0, "preload": 0.0}
    oil = timing().tensioners[0].model_dump() | {"name": "plunger", "on": "driven", "direction": [1.0, 0.0]}
    push = {"name": "plunger", "on": "driven", "at": [0.0, 0.0], "direction": [1.0, 0.0], "kind": "spring"}
    push |= {"spring": {"stiffness": 1e4, "preload": 2e3, "damping": 100.0}, "plunger": {"mass": 0.5}}
    base = two_sprockets().with_values({"sprockets.driven.mount": mount, "sprockets.driven.mass": 30.0})
    return [Drive(**base.model_dump(exclude_none=True) | {"tensioners": [one]}) for one in (oil, push)]


def fed():
    """Arms whose tensioners have relief valve and vent, their supply over a camshaft's speed, and over time."""
    outlets = {
        "tensioners.0.relief": {"pressure": 3e5, "diameter": 2e-3, "stiffness": 2e4, "lift": 3e-4},
        "tensioners.0.vent": {"diameter": 2e-4}, "tensioners.0.chamber.drained": 0.01,
    }  # fmt: skip
    over_speed = {"speed": [0.0, 210.0], "pressure": [1e5, 9e5], "shaft": "intake cam"}
    over_time = {"time": [0.0, 4e-4], "pressure": [2e5, 6e5]}
    tables = [{"tensioners.0.oil.supply_table": table} for table in (over_speed, over_time)]
    return [timing().with_values(outlets | table) for table in tables]


def rubbing_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in rubbing()]


def rubbing_on_moving_sprockets():
    teeth = {key: value for key, value in RUBS.items() if "sprocket" in key} | {"chain.elongation": -2e-4}
    return [drive.with_values(teeth) for drive in moving_sprockets()]


SWUNG = (swung, led, folded, folded_led)
SWUNG_LIGHT = (swung_light, led_light, folded_light)
TRAINS = (trains, gear_changes, freewheels, valves, light_trains)
MOVING = (moving_sprockets, rubbing_on_moving_sprockets)
PUSHED = (*MOVING, pushed_slider, segments)
MOVING_TRAINS = (*TRAINS, *MOVING)
ARMS_RK4 = (arms_rk4, swung_rk4, led_rk4)
OF_THREE_RK4 = (bending_rk4, rubbing_rk4, bucketed_rk4, *ARMS_RK4)
TRAINS_RK4 = (trains_rk4, gear_changes_rk4, freewheels_rk4, valves_rk4)
OF_TWO_RK4 = (rk4, *TRAINS_RK4, segments_rk4)
"""Families of drives that have a kernel in common, each with as many sprockets.

What a kernel has for one of them all others go through, which then is what a test of them is for: beside a family with
arms on arms, shafts, moving centers or valves stands one without.
"""
RUBBING = (rubbing, bending, uneven, bucketed, hoists)
ON_ARMS = (*SWUNG, *SWUNG_LIGHT, arms, drawn, fed)
TENSIONED = (*SWUNG, swung_trains, arms, drawn, fed)
PUSHED_TRAINS = (*PUSHED, *TRAINS)
VALVED = (geared_stages, cushed_stages, light_stages, geared_light_stages, stages_of_two_chains, valved_stages)
V6 = (v6, v6_fed)
USUAL = [
    (RUBBING, True, "float64"),
    ((light_wheels, unusual_contacts), True, "float32"),
    (ON_ARMS, False, "float32"),
    (MOVING_TRAINS, True, "float64"),
    (OF_THREE_RK4, True, "float32"),
    (VALVED, False, "float32"),
]
"""A kernel each: families, whether there are many, and the precision."""
LONG = [
    (TENSIONED, False, "float64"),
    (PUSHED, False, "float64"),
    (PUSHED_TRAINS, True, "float32"),
    (ARMS_RK4, True, "float64"),
    (OF_TWO_RK4, True, "float32"),
    (TRAINS_RK4, False, "float64"),
    (VALVED, True, "float64"),
    (V6, True, "float64"),
    ((stages_rk4,), True, "float32"),
    ((unjoined, unjoined_folded), False, "float64"),
]
THOROUGH = [
    (TRAINS, False, "float32"),
    ((bending_rk4, rubbing_rk4), False, "float32"),
    ((unjoined, unjoined_light), True, "float32"),
]
"""Families that have a kernel above, with another number of threads or at the other precision."""
OF_ONE_CHAIN = (
    marine, *RUBBING, equal_sprockets, light_wheels, long_chains, unusual_contacts, *ON_ARMS, swung_trains, *PUSHED,
    *TRAINS, *OF_THREE_RK4, *OF_TWO_RK4,
)  # fmt: skip
EVERY = (*OF_ONE_CHAIN, *VALVED, *V6, stages_rk4, unjoined, unjoined_light, unjoined_folded)


def on_fibers(kernel):
    """A block kernel that the CPU's compiler does little for, in two thirds of the time: few steps are taken."""
    if kernel.module.options["optimization_level"] is None:
        flags = "-march=native -fno-vectorize -fno-slp-vectorize"
        wp.set_module_options({"optimization_level": 1, "cpu_compiler_flags": flags}, kernel.module)
    return kernel


def run_blocks(packed, kind, blocks, order, frames):
    """The ensemble on blocks of fibers, by the kernel of a kind, in launches of so many steps: its state, its sums."""
    ensemble = upload_ensemble(packed, "cpu", blocks=True)
    state = upload_state(packed, "cpu", large(kind, len(order)))
    sums, tallies = empty_sums(packed, "cpu", blocks=True), empty_tallies(packed, "cpu")
    kernel = on_fibers(block_kernel(kind, 4, packed.frame))
    turn = wp.array(packed.first_rows[order], dtype=wp.int32, device="cpu")
    begun = wp.zeros(len(order), dtype=wp.int32, device="cpu")
    for end in accumulate(blocks):
        ends = wp.full(len(order), end, dtype=wp.int32, device="cpu")
        inputs = [ensemble, state, sums, tallies, frames, turn, ends, begun]
        dim = kind.launch_threads(len(order))
        wp.launch(kernel, dim=dim, inputs=inputs, block_dim=kind.block_threads, device="cpu")
    wp.launch(tally_sum_kernel(packed.real), packed.variants, inputs=[ensemble.drives, tallies, sums], device="cpu")
    return state, {name: device_values(getattr(sums, name), "sums", name, packed.real) for name in ARRAYS["sums"]}


def flat(rows):
    """The fields of structured rows by name, those of nested ones among them."""
    found = {}
    for name in rows.dtype.names:
        found |= flat(rows[name]) if rows.dtype[name].names else {name: rows[name]}
    return found


def joint_powers(packed, drive, frames):
    """Friction power of each joint, of 16 frames of a drive."""
    found = packed.frame.split_frames(frames.reshape(16, -1), PartCounts.of_drive(drive))
    return found["joint_friction_power"]


def shape_of(variants, each):
    """The shape of variants' blocks, of which a multiprocessor has so many."""
    return block_shape(int(roller_capacity(np.array([drive.links for drive in variants])).max()), each)


def pack_for(variants, schedules, precision):
    """An ensemble whose frames have every channel that its drives have."""
    rows = ChainRows(variants, stacks_of_drives(variants))
    packed = pack(rows.models, schedules_as_columns(schedules)[rows.variant_of_row])
    rows.couple_chains(packed)
    packed = packed.at_precision(precision)
    return replace(packed, frame=frame_with_channels(CHANNEL_NAMES if packed.joint_friction_kinds.any() else ()))


SPARE = {
    "guides": {"start": [9.0, 9.0], "end": [9.5, 9.0], "end_radius": 0.1},
    "arms": {"pivot": [0.0, 0.0], "mass": 1.0, "center": [0.0, -0.1], "inertia": 0.02, "stiffness": 500.0},
    "shafts": {"inertia": 1.0, "load": {"torque": 0.5}},
    "tensioners": {
        "on": "spare arms 0", "at": [0.0, -0.2], "direction": [1.0, 0.0], "kind": "spring",
        "spring": {"stiffness": 1e3, "preload": 50.0}, "plunger": {"mass": 0.1},
    },
}  # fmt: skip
"""Parts that touch no chain."""


def with_spares(drive, lacking):
    """A drive with so many spare parts of each sort."""
    if not any(lacking.values()):
        return drive
    values = drive_values(drive)
    for sort, part in SPARE.items():
        values[sort] = [*values.get(sort, ()), *(part | {"name": f"spare {sort} {k}"} for k in range(lacking[sort]))]
    if values.get("guides"):
        values["contact"].setdefault("guide", {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e6})
    return Drive(**values)


def alike(family):
    """Drives by what makes them, with spare parts: all have as many guides, shafts, arms and tensioners."""
    made = [(one, drive) for one in family for drive in one()]
    count = {sort: np.array([len(getattr(drive, sort)) for _, drive in made]) for sort in SPARE}
    lacking = {sort: counts.max() - counts for sort, counts in count.items()}
    arms = count["arms"] + lacking["tensioners"]  # a spare one for each spare tensioner
    lacking["arms"] = arms.max() - count["arms"]
    found = {one: [] for one in family}
    for number, (one, drive) in enumerate(made):
        found[one].append(with_spares(drive, {sort: int(of[number]) for sort, of in lacking.items()}))
    return found


@cache
def sharing(family, many, precision):
    """Drives of a family by what makes them, the kind of the block kernel that takes all of them, and their frames'
    layout.
    """
    drives = alike(family)
    variants = [drive for some in drives.values() for drive in some]
    packed = pack_for(variants, [Schedule(drive.run.step, 1, 0, 1, 0) for drive in variants], precision)
    columns = variant_kind_columns(packed)
    # a kernel goes through so many parts of each drive
    assert all(
        np.ptp(columns[sort]) == 0 for sort in ("sprockets", "guides", "arms", "tensioners", "other_bodies", "chains")
    )
    return drives, kind_of(packed, shape_of(variants, 100 if many else 1)), packed.frame


def assert_steps_of_the_cpu(drives, many, precision, family=()):
    """The block kernel takes the steps of the CPU kernel, with metrics and frames of every channel.

    The kernel is that of a family of drives, with parts that make them alike, or else of these drives alone.
    """
    of_family, kind, frame = sharing(family or (drives,), many, precision)
    variants = of_family[drives]
    looks = 64 if precision == "float64" else 32
    schedules = [Schedule(drive.run.step, 300, 111, 290, 20, looks) for drive in variants]
    packed = replace(pack_for(variants, schedules, precision), frame=frame)
    bends = np.flatnonzero(packed.joint_friction_kinds)
    each = [chain for drive in variants for chain in Model(drive).chains]
    widths = [drive_frame_width(chain, packed.frame) * 16 for chain in each]
    packed.drives["first_value"] = np.cumsum([0, *widths[:-1]])
    serial, theirs = stepped(packed, 301, values=sum(widths))
    ours = serial.frame_buffer(sum(widths))
    ours.fill_(np.nan)
    state, sums = run_blocks(packed, kind, [301], [1, 0], ours)  # the launch's order of variants does not matter
    assert (state.progress.numpy()["step"] == 301).all()
    assert (state.progress.numpy()["diverged"] == 0).all()
    # the same functions in the same order; moments are added up in another: round-off, which contacts amplify
    tolerance = 1e-9 if precision == "float64" else 3e-4
    close = partial(np.testing.assert_allclose, atol=tolerance, rtol=tolerance)
    mine, theirs_ = state.rollers.numpy(), serial.state.rollers.numpy()
    if (
        precision == "float32"
    ):  # a contact at a hair's breadth closes a step apart, at another impact speed: in `v6_fed`
        # a roller meets a tooth at step 244 with 0.0290 m/s, with 0.0289 at float64, and at 245 with 0.0335 on the CPU
        assert (~np.isclose(mine, theirs_, atol=tolerance, rtol=tolerance)).mean() < 1e-3
        close(mine, theirs_, atol=3e-3, rtol=3e-3)
    else:
        close(mine, theirs_)
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    bodies = device_values(state.bodies, "state", "bodies", packed.real)
    for name in ("angle", "speed", "center", "velocity"):
        close(bodies[name], serial.bodies()[name])
    # forces are differences of positions times stiffness: relative to the largest there is
    close(ours.numpy(), theirs.numpy(), atol=(1e-9 if precision == "float64" else 5e-3) * theirs.numpy().max())
    if len(bends):
        chain, first = each[bends[0]], packed.drives["first_value"][bends[0]]
        of_chain = slice(first, first + widths[bends[0]])
        powers = [joint_powers(packed, chain, frames.numpy()[of_chain]) for frames in (ours, theirs)]
        close(*powers, atol=(1e-9 if precision == "float64" else 5e-3) * powers[1].max())
        assert powers[1].max() > 0.0
    summed = serial.sums()
    assert (packed.contact_friction_kinds > 0).all() == (summed["contact"]["friction"] > 0.0).any()
    for name in (name for name in ARRAYS["sums"] if name != "tension_counts"):
        mine, theirs_ = flat(sums[name]), flat(summed[name])
        for field in mine:
            scale = np.abs(theirs_[field][np.isfinite(theirs_[field])]).max(initial=0.0)
            if field == "late_work":  # a small difference of powers, none where motion is steady
                scale = max(scale, 1e-6 * np.abs(theirs_["moment"]).max())
            exact = 1.2e-7 if (name, field) == ("chain", "friction") else 1e-9  # of couples that are kept as float32
            if (name, field) == ("contact", "dissipated"):  # a sum of powers that nearly cancel
                exact = 1e-8
            if (name, field) == ("arm", "late_work"):  # of `swung_light`'s, a rounding of the first state moves 2.6e-9
                exact = 1e-8
            loose = exact if precision == "float64" else 0.1 if field == "late_work" else 1e-2
            close(mine[field], theirs_[field], rtol=loose, atol=loose * scale, err_msg=f"{name}.{field}")
    for name in ("chain", "mount", "arm", "tensioner", "coupling"):  # dampers never give
        assert (flat(sums[name])["dissipated"] >= 0.0).all() and (flat(summed[name])["dissipated"] >= 0.0).all(), name
    assert drives is not drawn or (sums["tensioner"]["suction_work"][0] != 0.0).all()
    # looks at each link at step 111, then at multiples; round-off may take a tension over the edge of its bin
    mine, theirs_ = (each.reshape(-1, BINS) for each in (sums["tension_counts"], summed["tension_counts"]))
    seen = sum(step == 111 or step % looks == 0 for step in range(111, 291))
    assert mine.sum() == theirs_.sum() == seen * sum(chain.chain.links for chain in each)
    np.testing.assert_array_equal(mine.sum(axis=1), theirs_.sum(axis=1))
    moved = np.abs(np.cumsum(mine - theirs_, axis=1)).sum()
    assert moved <= (2 if precision == "float64" else 0.05 * mine.sum()), moved


def case_name(drives, many, precision):
    """How a test of the block kernel is called."""
    return f"{drives.__name__}-{'many' if many else 'few'}-{precision}"


def ways(drives, usual, long=()):
    """Cases of `assert_steps_of_the_cpu` with kernels of each drive's own: all but few are thorough.

    Few and many variants, at both precisions, are four kernels of a drive, each of which takes 15 s to compile. What
    hangs on numbers hardly hangs on precisions and on drives. Those that are not are kernels that users often have, or
    that other tests have, too.
    """
    cases = [*product(drives, (False, True), ("float64", "float32"))]
    names = [case_name(*case) for case in cases]
    return {"argnames": ("drives", "many", "precision"), "argvalues": some_of(cases, usual, long), "ids": names}


def together(usual, long=(), thorough=()):
    """The same with kernels that families of drives share, where a further drive takes 0.1 s: rows of (family, many,
    precision).
    """
    cases = [
        pytest.param(drives, many, precision, family, marks=marks, id=case_name(drives, many, precision))
        for families, marks in ((usual, ()), (long, pytest.mark.long), (thorough, pytest.mark.thorough))
        for family, many, precision in families
        for drives in family
    ]
    return {"argnames": ("drives", "many", "precision", "family"), "argvalues": cases}


def some_of(cases, usual, long=()):
    """Cases, of which those that are not usual are marked `long` if they are among these, and else `thorough`."""
    assert all(case in cases for case in (*usual, *long))

    def marks(case):
        return () if case in usual else pytest.mark.long if case in long else pytest.mark.thorough

    return [pytest.param(*case, marks=marks(case)) for case in cases]
