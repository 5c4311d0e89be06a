"""Drives of several chains that tests share."""

import math
import tomllib

from parts import coupling, gears, shaft

from warpchain import Drive, dumps_drive, loads_drive


def span(first, second, links, pitch, strain=2e-4):
    """Distance of two sprockets [m] at which the path of a chain around them is longer than it by `strain`.

    2 sqrt(a^2 - d^2) + R_1 (pi - 2 b) + R_2 (pi + 2 b), d = R_2 - R_1, sin(b) = d / a, wrapped arcs in chords.
    """
    radii = [pitch / (2.0 * math.sin(math.pi / z)) for z in (first, second)]
    d = radii[1] - radii[0]

    def length(a):
        lean = math.asin(d / a)
        wraps = first * pitch * (math.pi - 2.0 * lean) + second * pitch * (math.pi + 2.0 * lean)
        return 2.0 * math.sqrt(a * a - d * d) + wraps / (2.0 * math.pi)

    low, high = abs(d) + 1e-6, links * pitch
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) < links * pitch * (1.0 + strain) else (low, middle)
    return 0.5 * (low + high)


CONTACT = """
[contact.sprocket]
clearance = 1e-4
seat_angle = 125.0
restitution = 0.5
impact_speed_floor = 0.02
stiffness = 2e8
"""


def chain(name, links, pitch=0.05, mass=1.0, stiffness=5e7, damping=2000.0, plane=None):
    of_plane = "" if plane is None else f'plane = "{plane}"'
    return f"""
[[chains]]
name = "{name}"
pitch = {pitch}
links = {links}
roller_mass = {mass}
stiffness = {stiffness}
damping = {damping}
roller_radius = {0.3 * pitch}
{of_plane}
"""


def sprocket(name, teeth, center, chain="", shaft="", more=""):
    of_chain = f'chain = "{chain}"' if chain else ""
    of_shaft = f'shaft = "{shaft}"' if shaft else ""
    return f"""
[[sprockets]]
name = "{name}"
teeth = {teeth}
center = [{center[0]!r}, {center[1]!r}]
wrap = "ccw"
{of_chain}
{of_shaft}
{more}
"""


def run(duration=0.2, step=5e-6, settle="false", gravity=0.0):
    return f"""
[run]
duration = {duration}
step = {step}
settle = {settle}
sample_rate = 2000.0
gravity = [0.0, {gravity}]
"""


def two_stages(teeth=(20, 30, 18, 36), links=(66, 68), pitches=(0.05, 0.04), speed=10.0, torque=300.0, **settings):
    """A crank turns a shaft by chain "first", which turns a last one by chain "second"; its load is a torque [N m]."""
    z, mid = teeth, span(teeth[0], teeth[1], links[0], pitches[0])
    end = mid + span(teeth[2], teeth[3], links[1], pitches[1])
    return loads_drive(
        chain("first", links[0], pitches[0])
        + chain("second", links[1], pitches[1], mass=0.7, stiffness=4e7)
        + shaft("mid")
        + sprocket("crank", z[0], (0.0, 0.0), "first", more=f"prescribed = {{ speed = {speed} }}")
        + sprocket("mid in", z[1], (mid, 0.0), "first", "mid", "inertia = 1.0")
        + sprocket("mid out", z[2], (mid, 0.0), "second", "mid", "inertia = 1.0")
        + sprocket("out", z[3], (end, 0.0), "second", more=f"inertia = 2.0\nload = {{ torque = {torque} }}")
        + CONTACT
        + run(**settings)
    )


def side_by_side(count, **settings):
    """Between two shafts `count` equal chains, or for 0 one of twice the mass, stiffness, damping and contact."""
    links, z, twice = 60, (20, 20), 1 if count else 2
    a = span(*z, links, 0.05)
    text = ""
    for k in range(max(count, 1)):
        text += chain(f"c{k}", links, mass=twice, stiffness=5e7 * twice, damping=2000.0 * twice)
    text += shaft("A") + shaft("B")
    for k in range(max(count, 1)):
        own = "prescribed = { speed = 10.0 }" if k == 0 else ""
        text += sprocket(f"a{k}", z[0], (0.0, 0.0), f"c{k}", "A", own)
        own = "inertia = 2.0\nload = { torque = 600.0 }" if k == 0 else ""
        text += sprocket(f"b{k}", z[1], (a, 0.0), f"c{k}", "B", own)
    return loads_drive(text + CONTACT.replace("2e8", f"{2e8 * twice}") + run(**settings))


def twice(drive):
    """A drive of one chain, and the same again in another plane, joined by nothing."""
    whole = tomllib.loads(dumps_drive(drive))
    chain, sprockets, arms = (whole.pop(kind) for kind in ("chain", "sprockets", "arms"))
    of = {"chains": [], "sprockets": [], "arms": []}
    for name in "ab":
        of["chains"].append(chain | {"name": name, "plane": f"of {name}"})
        for arm in arms:
            on = {"arm": f"{name} {arm['arm']}"} if "arm" in arm else {}
            of["arms"].append(arm | on | {"name": f"{name} {arm['name']}"})
        for sprocket in sprockets:
            more = {"name": f"{name} {sprocket['name']}", "chain": name}
            if "arm" in sprocket["mount"]:
                more["mount"] = {"kind": "arm", "arm": f"{name} {sprocket['mount']['arm']}"}
            of["sprockets"].append(sprocket | more)
    return Drive(**whole, **of)


def plus(drive, text, **values):
    """A drive with further parts, and with values."""
    values = {"sprockets.out.load": None} | values if '"wheel"' in text else values
    return loads_drive(dumps_drive(drive) + text).with_values(values)


PUMP = shaft("pump", inertia=0.8, load={"viscous": 2.0}) + gears("pair", ["mid", "pump"], [20, 40])
"""Geared to the shaft between two stages."""
WHEEL = shaft("wheel", inertia=3.0, load={"torque": 250.0})
WHEEL += coupling("joint", ["out", "wheel"], 4e4, damping=20.0, lash=1e-3)
"""On a coupling, turned by the last of two stages."""
CUSH = coupling("cush", ["mid", "mid out"], 3e4, damping=15.0)
"""Between a shaft and a sprocket on it, of the second of two stages."""


def geared_stages(**settings):
    """Two stages, a pump geared to the shaft between them, and a wheel on a coupling."""
    return plus(two_stages(**settings), PUMP + WHEEL)


def cushed_stages(**settings):
    """Two stages and the pump, of which a coupling turns the second."""
    return plus(two_stages(**settings), PUMP + CUSH)


def light_gears(**settings):
    """Two stages whose shafts, lighter than the rollers on them, a pair of gears ties: rho = -1/2."""
    pair = gears("pair", ["mid in", "mid out"], [20, 40])
    found = tomllib.loads(dumps_drive(two_stages(**settings)) + pair)
    del found["shafts"]
    found["chains"][1]["plane"] = "behind"
    for sprocket in found["sprockets"]:
        if sprocket.pop("shaft", None) is not None:
            sprocket["inertia"] = 2e-3
        if sprocket["chain"] == "second":
            sprocket["wrap"] = "cw"
    return Drive(**found)


def motored_stages(**settings):
    """Geared stages that a motor starts, on the crank's shaft."""
    motor = shaft("engine", inertia=0.4, motor={"torque": 300.0, "power": 3e3})
    text = dumps_drive(geared_stages(**settings)).replace("prescribed = { speed = 10.0, ramp_time = 0.0 }\n", "", 1)
    return loads_drive(text.replace('name = "crank"\n', 'name = "crank"\ninertia = 0.1\nshaft = "engine"\n', 1) + motor)
