"""The drives that speed is measured on, and ensembles of drives that differ."""

from common.drives import Values, equal, example, pair, without_friction

from warpchain import Drive

PITCH, SLACK = 0.1, 0.0004
TWO = equal(30, 118, PITCH, SLACK) | {
    "chain.roller_mass": 3.0,
    "chain.stiffness": 2e8,
    "chain.roller_radius": 0.03,
    "sprockets.driver.prescribed.speed": 12.0,
    "sprockets.driven.inertia": 50.0,
    "sprockets.driven.load.torque": 5000.0,
    "contact.sprocket.seat_angle": 137.0,
    "contact.sprocket.restitution": 0.8,
    "contact.sprocket.impact_speed_floor": 0.05,
    "contact.sprocket.stiffness": 5e8,
    "run": {"duration": 1.0, "step": 5e-6, "sample_rate": 5000.0},
}
"""The values of two equal sprockets."""
JOINT_FRICTION: Values = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = JOINT_FRICTION | {"chain.joint.static_friction": 0.15, "chain.joint.stribeck_speed": 0.05}
HARMONICS: Values = {
    f"sprockets.{cam}.load.harmonics": [
        {"order": 4, "amplitude": 7.56, "phase": 1.5708 + 4.0 * lead},
        {"order": 8, "amplitude": 0.96, "phase": -1.5708 + 8.0 * lead},
    ]
    for cam, lead in (("intake cam", 0.0), ("exhaust cam", 1.9199))
}
"""Two orders of a camshaft's torque at 3000 rpm, for valves, which the C program does not know."""


def named(name: str) -> Drive:
    """A drive by name: `two` equal sprockets, the same by `rk4`, `smooth` (marine without friction), or an example."""
    if name in ("two", "rk4"):
        return pair(TWO | ({"run.integrator": "rk4"} if name == "rk4" else {}))
    return without_friction(example("marine")) if name == "smooth" else example(name)


def without_valves(name: str) -> Drive:
    """A drive by name as the C program knows it: camshafts of `car` have harmonics for valves."""
    return example(name, {"valves": ()} | HARMONICS) if name == "car" else named(name)


def of_length(links: int) -> Drive:
    """Two equal sprockets with a chain of so many links."""
    return named("two").with_values(equal(30, links, PITCH, SLACK))


def other(drive: Drive, k: int) -> Drive:
    """The k-th of marine drives that differ in five values, two of which move rollers to other places.

    The camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping. Of `car` the
    tensioner's preload, a camshaft's inertia, the chain's elongation and damping, and the guides' friction.
    """
    if drive.tensioners:
        return drive.with_values(
            {
                "tensioners.tensioner.spring.preload": 40.0 + 1e-4 * k,
                "sprockets.intake cam.inertia": 1.2e-3 + 1e-9 * k,
                "chain.elongation": 1e-8 * k,
                "chain.damping_ratio": 0.02 + 1e-7 * k,
                "contact.guide.friction": 0.06 + 1e-7 * k,
            }
        )
    x, y = drive.sprockets[1].center
    values = {
        "sprockets.camshaft.load.torque": 8000.0 + 0.2 * k,
        "sprockets.tightener.center": [x - 1e-7 * k, y],
        "chain.elongation": 1e-8 * k,
        "chain.roller_mass": 6.95 + 1e-5 * k,
        "chain.damping": 1.0e5 + k,
    }
    return drive.with_values(values)


def kinds() -> list[Drive]:
    """Two-sprocket drives of 224 kinds: 14 numbers of teeth by 16 of links."""
    base = named("two")
    sizes = [(teeth, links) for teeth in range(20, 34) for links in range(104, 136, 2)]
    return [base.with_values(equal(teeth, links, PITCH, SLACK)) for teeth, links in sizes]
