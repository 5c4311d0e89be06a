"""Chain layouts for tests: drives built from a few numbers, and random ones for property tests."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hypothesis import strategies as st

from warpchain.drive import Drive, loads_drive

PITCH = 0.0127


@dataclass(frozen=True)
class Placed:
    """A sprocket of a layout: prescribed if `speed` is given, else free."""

    teeth: int
    center: tuple[float, float]
    wrap: str = "ccw"
    speed: float | None = None
    ramp_time: float = 0.0
    harmonics: tuple[tuple[int, float, float], ...] = ()
    pitch: float | None = None

    @property
    def radius(self) -> float:
        return (self.pitch or PITCH) / (2.0 * math.sin(math.pi / self.teeth))

    def toml(self, index: int) -> str:
        lines = ["[[sprockets]]", f'name = "s{index}"', f"teeth = {self.teeth}", f'wrap = "{self.wrap}"']
        lines.append(f"center = [{float(self.center[0])!r}, {float(self.center[1])!r}]")
        if self.pitch is not None:
            lines.append(f"pitch = {self.pitch!r}")
        if self.speed is None:
            lines.append("inertia = 0.01")
        else:
            rows = ", ".join(f"{{ order = {o}, amplitude = {a!r}, phase = {f!r} }}" for o, a, f in self.harmonics)
            lines.append(
                f"prescribed = {{ speed = {self.speed!r}, ramp_time = {self.ramp_time!r}, harmonics = [{rows}] }}"
            )
        return "\n".join(lines)


def drive_of(sprockets: list[Placed], links: int, gravity: tuple[float, float] = (0.0, -9.81)) -> Drive:
    """A drive of these sprockets; the first is driven at 10 rad/s where none has a speed."""
    if all(sprocket.speed is None for sprocket in sprockets):
        sprockets = [replace(sprockets[0], speed=10.0), *sprockets[1:]]
    text = f"""
[chain]
pitch = {PITCH}
links = {links}
roller_mass = 0.01
stiffness = 1.0e7
damping = 10.0
roller_radius = 0.00425

{chr(10).join(sprocket.toml(index) for index, sprocket in enumerate(sprockets))}

[contact.sprocket]
profile = "circular"
clearance = 4.0e-5
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 1.0e8

[run]
duration = 0.1
step = 1.0e-6
sample_rate = 1000.0
gravity = [{gravity[0]}, {gravity[1]}]
"""
    return loads_drive(text)


def winding(speed: float) -> Drive:
    """A chain that winds back and forth about five sprockets: s0->s1 and s2->s3 both cross the plane through mid-strand
    of s0->s1, and the same way, 0.14 m apart.
    """
    places = [(0.0, 0.2, "cw"), (0.4, 0.2, "cw"), (0.15, 0.1, "ccw"), (0.39895, 0.0, "cw"), (0.0, 0.0, "cw")]
    sprockets = [Placed(20, (x, y), wrap) for x, y, wrap in places]
    sprockets[0] = replace(sprockets[0], speed=speed)
    return drive_of(sprockets, 158)


@st.composite
def loops(draw: st.DrawFn) -> list[Placed]:
    """2 to 6 sprockets about a loop that does not cross itself, run either way; inner ones wrap the other way."""
    size = draw(st.integers(2, 6))
    teeth = draw(st.lists(st.integers(9, 34), min_size=size, max_size=size))
    turn = draw(st.floats(0.0, 2.0 * math.pi))
    scale = draw(st.sampled_from([1.0, 0.6, 0.35]))
    centers = []
    for index in range(size):
        angle = turn + (index + draw(st.floats(-0.15, 0.15))) * 2.0 * math.pi / size
        reach = scale * draw(st.floats(0.25, 0.6))
        centers.append((reach * math.cos(angle), reach * math.sin(angle)))
    wraps = []
    for index, (x, y) in enumerate(centers):
        (x0, y0), (x1, y1) = centers[index - 1], centers[(index + 1) % size]
        inner = size > 2 and (x - x0) * (y1 - y) - (y - y0) * (x1 - x) < 0.0
        wraps.append("cw" if inner else "ccw")
    sprockets = [Placed(z, center, wrap) for z, center, wrap in zip(teeth, centers, wraps, strict=True)]
    if draw(st.booleans()):
        sprockets = [
            replace(sprocket, wrap="cw" if sprocket.wrap == "ccw" else "ccw") for sprocket in reversed(sprockets)
        ]
    driver = draw(st.integers(0, size - 1))
    sprockets[driver] = replace(sprockets[driver], speed=draw(st.floats(0.0, 50.0)))
    return sprockets


@st.composite
def tangles(draw: st.DrawFn) -> list[Placed]:
    """2 to 6 sprockets on a ring with any wraps, so that strands may cross."""
    size = draw(st.integers(2, 6))
    sprockets = []
    for index in range(size):
        angle = (index + draw(st.floats(-0.2, 0.2))) * 2.0 * math.pi / size
        reach = draw(st.floats(0.35, 0.6))
        center = (reach * math.cos(angle), reach * math.sin(angle))
        sprockets.append(Placed(draw(st.integers(9, 30)), center, draw(st.sampled_from(["ccw", "cw"]))))
    return sprockets
