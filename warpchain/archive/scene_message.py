"""The outlines that Foxglove draws: teeth, pitch circles and guide-bars of a drive as one `foxglove.SceneUpdate`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.archive.archive_format import message_type, sprocket_frame, varint
from warpchain.archive.chunk_layout import Form
from warpchain.drive import Drive
from warpchain.drive.rings import rings_of
from warpchain.results.scene import guide_outline, tooth_outline

FRAME = "drive"
"""Coordinate frame of everything in an archive [m]."""
CIRCLE_POINTS = 96
TEETH_COLOR = {"r": 0.55, "g": 0.58, "b": 0.62, "a": 1.0}
PITCH_COLOR = {"r": 0.35, "g": 0.40, "b": 0.48, "a": 0.6}
GUIDE_COLOR = {"r": 0.75, "g": 0.55, "b": 0.30, "a": 1.0}
LINE_WIDTH = 2.0
"""Width of the lines [pixels]."""
POINT = np.dtype(
    [
        ("head", "u1", (3,)),
        ("x", "<f8"),
        ("y_tag", "u1"),
        ("y", "<f8"),
        ("z_tag", "u1"),
        ("z", "<f8"),
    ]
)
"""Field 5 (points) of a LinePrimitive, a Point3 with all of its numbers."""


def scene_update(form: Form, drive: Drive) -> bytes:
    """A serialized `foxglove.SceneUpdate` of a drive.

    One entity a sprocket, `sprocket/NAME`: its teeth (closed) and its pitch circle (closed), in the frame that turns
    with it, or, where the frames do not hold how it lies, at angle zero in the drive's frame; one a guide,
    `guide/NAME`: its face and ends (open), in the frame of the arm that carries it if it has one. Points in metres.
    """
    entities = [entity for ring in rings_of(drive) for entity in _entities(form, ring.drive)]
    return b"".join(_field(2, entity) for entity in entities)


def _entities(form: Form, drive: Drive) -> list[bytes]:
    """The entities of a chain's sprockets and guides."""
    entities = []
    turn = np.linspace(0.0, 2.0 * math.pi, CIRCLE_POINTS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for s, sprocket in enumerate(drive.sprockets):
        center = np.zeros(2) if form.turns else np.asarray(sprocket.center, dtype=float)
        frame = sprocket_frame(form.variant, sprocket.name) if form.turns else FRAME
        teeth, pitch = tooth_outline(drive, s)[:-1] + center, circle * drive.pitch_radius(s) + center
        facts = {"teeth": str(sprocket.teeth), "pitch_radius": repr(drive.pitch_radius(s))}
        lines = [_line("LINE_LOOP", teeth, TEETH_COLOR), _line("LINE_LOOP", pitch, PITCH_COLOR)]
        entities.append(_entity(frame, f"sprocket/{sprocket.name}", facts, lines))
    for g, guide in enumerate(drive.guides):
        outline, frame = guide_outline(drive, g), FRAME
        if guide.arm in form.turning[len(form.sprockets) :] and form.turns:
            assert guide.arm is not None
            frame = sprocket_frame(form.variant, guide.arm)
            outline = outline - np.asarray(next(arm.pivot for arm in drive.arms if arm.name == guide.arm))
        entities.append(_entity(frame, f"guide/{guide.name}", {}, [_line("LINE_STRIP", outline, GUIDE_COLOR)]))
    return entities


def _field(number: int, data: bytes) -> bytes:
    """A length-delimited protobuf field."""
    return varint(number << 3 | 2) + varint(len(data)) + data


def _entity(frame: str, name: str, facts: dict[str, str], lines: list[bytes]) -> bytes:
    entity: Any = message_type("foxglove.SceneEntity")(frame_id=frame, id=name)
    for key, value in facts.items():
        entity.metadata.add(key=key, value=value)
    return bytes(entity.SerializeToString()) + b"".join(_field(11, line) for line in lines)


def _line(kind: str, points: NDArray[np.floating], color: dict[str, float]) -> bytes:
    line: Any = message_type("foxglove.LinePrimitive")(thickness=LINE_WIDTH, scale_invariant=True, color=color)
    line.type = line.Type.Value(kind)
    line.pose.orientation.w = 1.0
    packed = np.zeros(len(points), dtype=POINT)
    packed["head"] = (5 << 3 | 2, POINT.itemsize - 2, 0x09)
    packed["y_tag"], packed["z_tag"] = 0x11, 0x19
    packed["x"], packed["y"] = points[:, 0], points[:, 1]
    return bytes(line.SerializeToString()) + packed.tobytes()
