"""Ensembles made by hand for tests of the physics: a closed chain anywhere, with any sprockets, stepped by the
engine.
"""

import numpy as np
import warp as wp

from warpchain.assembly.stack_assembly import Assemblies
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.pack import fill_bristles, fill_step_dependence
from warpchain.engine.packed_ensemble import REAL_TYPES, PackedEnsemble, roller_state_rows
from warpchain.engine.struct_rows import JOINT_INERTIA
from warpchain.kernels import structs
from warpchain.kernels.integrate import INTEGRATORS
from warpchain.kernels.physics.mount import CARRIED
from warpchain.kernels.relaxation import Settling


def blank_states(variants):
    """Initial states that are not looked at."""
    return Assemblies((), np.zeros(variants, dtype=np.int64), np.zeros(variants, dtype=np.int64))


def chain(
    position,
    velocity,
    *,
    mass,
    pitch,
    stiffness,
    damping=0.0,
    gravity=(0.0, 0.0),
    sprockets=(),
    guides=(),
    carriers=0,
    arms=(),
    step,
    steps,
    integrator="leapfrog",
    window=None,
    frame_interval=0,
    joint=None,
    precision="float64",
):
    """One variant: a closed chain of rollers; each sprocket and guide-bar is a dict of the values that it needs.

    After the sprockets' bodies come those of `carriers`, whose rows are left at zero, then those of `arms`. A guide
    with `pieces`, (start, heading, curvature, length) each, has a profile.
    """
    kinds = structs.types(REAL_TYPES[precision])
    n, wheels, bars = len(position), len(sprockets), len(guides)
    rows = roller_state_rows(np.asarray(position, dtype=float), np.asarray(velocity, dtype=float))
    rows[4:6] = rows[0:2] - rows[0:2].astype(precision)  # what it rounds off
    bodies = wheels + carriers + len(arms)
    pieces = sum(len(bar["pieces"]) + 1 for bar in guides if "pieces" in bar)
    zeros = lambda struct, count=1: np.zeros(max(count, 1), dtype=struct.numpy_dtype())  # noqa: E731
    packed = PackedEnsemble(
        precision=precision, drives=zeros(structs.Drive), chains=zeros(kinds.Chain), plates=zeros(kinds.Plate),
        lengths=np.full(n, pitch, dtype=precision), relative_mass=np.ones(n, dtype=precision),
        sprockets=zeros(kinds.Sprocket, wheels), motions=zeros(structs.Motion, bodies),
        mounts=zeros(structs.Mount, bodies), guides=zeros(kinds.Guide, bars),
        pieces=zeros(structs.Piece, pieces), arms=zeros(structs.Arm, len(arms)),
        hubs=zeros(structs.Hub, wheels), tensioners=zeros(structs.Tensioner), oil=zeros(structs.TensionerState),
        motors=zeros(structs.Motor), couplings=zeros(structs.Coupling),
        engaged=zeros(structs.Engaged), gears=zeros(structs.Gear), valves=zeros(structs.ValveGroup),
        tooth_friction=zeros(kinds.Friction, wheels), guide_friction=zeros(kinds.Friction, bars),
        harmonics=np.zeros((1, 3)), tables=np.zeros(1), seats=np.zeros((1, 2)),
        rollers=rows.astype(precision).ravel(),
        bodies=zeros(structs.BodyState, bodies), strands=zeros(structs.Strand, wheels),
        seat=np.full(max(n * (wheels + bars), 1), -1, dtype=np.int32), assemblies=blank_states(1),
    )  # fmt: skip
    row = packed.drives[0]
    row["chains"] = row["points"] = 1
    row["rollers"], row["sprockets"], row["guides"], row["bodies"] = n, wheels, bars, bodies
    row["pieces"], row["arms"] = pieces, len(arms)
    row["integrator"] = INTEGRATORS[integrator]
    row["step"], row["steps"], row["frame_interval"] = step, steps, frame_interval
    row["window_start"], row["window_end"] = window or (0, steps)
    row["low"], row["high"] = -1e3, 1e3
    row = packed.chains[0]
    row["stiffness"], row["damping"] = row["outer_stiffness"], row["outer_damping"] = stiffness, damping
    row["mass"], row["inverse_mass"], row["gravity"] = mass, 1.0 / mass, gravity
    if joint is not None:
        put_joint(packed, pitch, **joint)
    seats = []
    for s, values in enumerate(sprockets):
        teeth, half = values["teeth"], 0.5 * values.get("seat_angle", np.radians(137.0))
        radius = pitch / (2 * np.sin(np.pi / teeth))
        sprocket = packed.sprockets[s]
        sprocket["teeth"], sprocket["exact_radius"], sprocket["first_seat"] = teeth, radius, sum(map(len, seats))
        sprocket["pitch_radius"] = radius
        sprocket["near_square"], sprocket["far_square"] = (radius - pitch / 2) ** 2, (radius + pitch / 2) ** 2
        sprocket["half_pitch_tangent"], sprocket["clearance"] = np.tan(np.pi / teeth), values.get("clearance", 0.0)
        sprocket["cos_half_seat"], sprocket["sin_half_seat"] = np.cos(half), np.sin(half)
        sprocket["flank_curvature"] = values.get("flank_curvature", 0.0)
        sprocket["tip_reach"], sprocket["law"]["ahead"] = radius + pitch / 2, pitch / 20
        law = sprocket["law"]
        put_friction(packed.tooth_friction[s], values.get("friction", 0.0), values.get("effective_mass", mass), step)
        law["stiffness"], law["exponent"] = values["stiffness"], values.get("exponent", 1.0)
        law["damping"] = 0.75 * (1 - values.get("restitution", 1.0) ** 2)
        law["speed_floor"] = values.get("speed_floor", 0.01)
        motion, body = packed.motions[s], packed.bodies[s]
        motion["sign"] = 1.0
        motion["prescribed"] = int("inertia" not in values)
        motion["speed"] = values.get("speed", 0.0) if "inertia" not in values else 0.0
        motion["start_angle"] = body["angle"] = values.get("angle", 0.0)
        body["speed"], body["center"] = values.get("speed", 0.0), values.get("center", (0.0, 0.0))
        if "inertia" in values:
            motion["inverse_inertia"] = 1.0 / values["inertia"]
            motion["load"] = values.get("load", (0.0, 0.0, 0.0))
        packed.hubs[s]["arm"] = structs.GROUND
        for name, value in values.get("hub", {}).items():
            packed.hubs[s][name] = value
            packed.drives["hubs"] = 1
        packed.mounts[s]["moves"] = CARRIED if packed.hubs[s]["arm"] != structs.GROUND else 0
        angle = 2 * np.pi * np.arange(teeth) / teeth
        seats.append(np.stack([np.cos(angle), np.sin(angle)], axis=1))
        strand = packed.strands[s]
        strand["direction"], strand["length"] = (1.0, 0.0), 1.0
    for g, (bar, values) in enumerate(zip(packed.guides, guides, strict=False)):
        put_friction(packed.guide_friction[g], values.get("friction", 0.0), values.get("effective_mass", mass), step)
        if "pieces" in values:
            put_profile(packed, bar, values["pieces"])
            values = values | {"start": bar["start"], "end": bar["start"] + bar["length"] * bar["direction"]}
        chord = np.subtract(values["end"], values["start"])
        bar["body"], bar["start"], bar["length"] = values.get("body", structs.GROUND), values["start"], np.hypot(*chord)
        bar["direction"] = chord / np.hypot(*chord)
        bar["roller_radius"], bar["end_radius"] = values["roller_radius"], values.get("end_radius", 0.1)
        bar["deepest_entry"], bar["law"]["ahead"] = 0.5 * values["roller_radius"], values["roller_radius"] / 16
        law = bar["law"]
        law["form"], law["stiffness"], law["exponent"] = values.get("form", 0), values["stiffness"], 1.0
        law["damping"], law["speed_floor"] = values.get("damping", 0.0), 0.01
    if seats:
        packed.seats = np.concatenate(seats)
    for a, values in enumerate(arms):
        put_arm(packed, a, gravity, **values)
    fill_step_dependence(packed)
    return packed


def put_profile(packed, bar, pieces):
    """A profile as the pieces of a hand-made guide, whose box is so large that it never ends."""
    first = int(packed.guides["pieces"].sum()) + int((packed.guides["pieces"] > 0).sum())
    bar["pieces"], bar["first_piece"] = len(pieces), first
    place = 0.0
    for row, (start, heading, curvature, length) in zip(packed.pieces[first:], pieces, strict=False):
        row["start"], row["direction"] = start, (np.cos(heading), np.sin(heading))
        row["curvature"], row["place"] = curvature, place
        place += length
    start, heading, curvature, length = pieces[-1]
    mean = heading + 0.5 * curvature * length
    end = np.add(start, length * np.sinc(0.5 * curvature * length / np.pi) * np.array([np.cos(mean), np.sin(mean)]))
    last, turned = packed.pieces[first + len(pieces)], heading + curvature * length
    last["start"], last["direction"], last["place"] = end, (np.cos(turned), np.sin(turned)), place
    chord = end - packed.pieces[first]["start"]
    bar["start"], bar["length"] = packed.pieces[first]["start"], np.hypot(*chord)
    bar["direction"], bar["low"], bar["high"] = chord / np.hypot(*chord), -10.0, 10.0


def put_arm(packed, a, gravity, *, pivot, inertia, angle=0.0, speed=0.0, stops=(-1e9, 1e9), **values):
    """A hand-made arm."""
    b = len(packed.bodies) - len(packed.arms) + a
    row, body, packed.motions["inverse_inertia"][b] = packed.arms[a], packed.bodies[b], 1.0 / inertia
    row["pivot"], row["gravity"] = pivot, gravity
    row["low"], row["high"] = stops
    for name, value in values.items():
        row[name] = value
    body["center"], body["angle"], body["speed"] = pivot, angle, speed


def put_friction(row, friction, effective_mass, step):
    """Friction of a hand-made contact."""
    row["inertia"], row["stiffness"] = effective_mass if friction > 0.0 else 0.0, np.inf
    fill_bristles(row, step)
    row["mu_dynamic"] = row["mu_static"] = friction
    row["stribeck_speed"] = 1.0


def put_joint(packed, pitch, friction, pin_radius, factor=4 / np.pi):
    """Friction in the joints of a hand-made chain."""
    row = packed.chains[0]
    row["pin_radius"], row["joint_arm"] = pin_radius, factor * pin_radius
    inertia = JOINT_INERTIA * row["mass"] * pitch**2 / 6.0
    put_friction(row["joint"], friction, inertia, packed.drives[0]["step"])


def struck_sprocket(*, step, steps, integrator="leapfrog", precision="float64", **contact):
    """A tossed ring of 20 rollers of 1 kg about a free sprocket of 3 kg m^2 at 4 rad/s, without gravity and load."""
    position, radius = polygon(20, 0.05)
    velocity = np.random.default_rng(0).normal(scale=0.2, size=(20, 2))
    sprocket = {"teeth": 20, "stiffness": 2e8, "clearance": 1e-4, "inertia": 3.0, "speed": 4.0, "restitution": 0.5}
    return chain(
        position * (1.0 + 1e-4 / radius), velocity, mass=1.0, pitch=0.05, stiffness=5e7, damping=500.0,
        sprockets=[sprocket | contact], step=step, steps=steps, integrator=integrator, precision=precision,
    )  # fmt: skip


def momenta(rollers, body, own=0.0):
    """Momentum (x, y) and angular momentum about the origin of rollers of 1 kg and a sprocket of 3 kg m^2."""
    (x, y, vx, vy), (cx, cy), (ux, uy) = rollers, body["center"], body["velocity"]
    spin = (x * vy - y * vx).sum() + own * (cx * uy - cy * ux) + 3.0 * body["speed"]
    return np.array([vx.sum() + own * ux, vy.sum() + own * uy, spin])


class Frames(CpuEngine):
    """A CPU engine that stands for a GPU's: its frame buffers know their length."""

    def frame_buffer(self, values):
        buffer = super().frame_buffer(values)
        buffer.values = values
        return buffer


def stepped(packed, *launches, values=0, workers=1):
    """The engine after launches of so many steps each, and its frame buffer of so many values."""
    engine = CpuEngine(packed, workers)
    buffer = engine.frame_buffer(values)
    for steps in launches:
        for future in engine.advance(steps, buffer):
            future.result()
    engine.close()
    return engine, buffer


def settling(packed, step, tolerance, limit):
    """The engine after settling to a tolerance in at most `limit` steps, and the row that it began with."""
    engine = CpuEngine(packed, 1)
    start = np.zeros(1, dtype=Settling.numpy_dtype())
    start["step"], start["tolerance"], start["limit"] = step, tolerance, limit
    engine.start_settling(start)
    for future in engine.settle(limit):
        future.result()
    engine.close()
    return engine, start


def run(packed, workers=1):
    """Steps a hand-made ensemble to its end; returns the engine and, where sampled, frames (F, values)."""
    steps = int(packed.drives["steps"][0])
    every = int(packed.drives["frame_interval"][0])
    width = 7 * int(packed.drives["rollers"][0]) + 5 * int(packed.drives["sprockets"][0])
    frames = steps // every + 1 if every else 0
    engine, buffer = stepped(packed, steps + 1, values=frames * width, workers=workers)
    assert engine.progress()["diverged"][0] == 0
    return engine, buffer.numpy()[: frames * width].reshape(frames, width)


def polygon(n, pitch):
    """Vertices of a regular polygon of n sides, (n, 2), and its radius."""
    radius = pitch / (2 * np.sin(np.pi / n))
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), radius


def state(engine):
    """Final x, y, vx, vy rows, (4, N), in float64."""
    rows = engine.state.rollers.numpy().reshape(6, -1).astype(float)
    return rows[:4] + np.concatenate([rows[4:], 0 * rows[4:]])


__all__ = ["Frames", "chain", "momenta", "polygon", "run", "settling", "state", "stepped", "struck_sprocket", "wp"]
