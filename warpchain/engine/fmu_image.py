"""Image of an exported drive: a kernel launch's memory as bytes, and the C header of its layout."""

from __future__ import annotations

import ctypes
import string
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.arrays import ARRAYS, dtype_of
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.input_ports import CELL, InputPort, own_center, packed_array
from warpchain.engine.output_ports import OutputPort
from warpchain.kernels.structs import Tabulated
from warpchain.results.schedule import MOST_STEPS

ALIGNMENT = 64
"""Alignment of an image's arrays [bytes]."""


@dataclass
class Image:
    """Memory image of a launch.

    Attributes:
        content: bytes, without scratch.
        pointers: (where, to what) in it.
        places: of arrays, by group and name, and "arguments", "steps", "frames".
        scratch: bytes of scratch behind it.
    """

    content: bytearray = field(default_factory=bytearray)
    pointers: list[tuple[int, int]] = field(default_factory=list)
    places: dict[Any, int] = field(default_factory=dict)
    scratch: int = 0

    def append(self, part: bytes) -> int:
        """Appends bytes to an image, aligned; returns where they begin."""
        self.content += bytes(-len(self.content) % ALIGNMENT)
        begin = len(self.content)
        self.content += part
        return begin


def launch_image(engine: CpuEngine, frames: Any) -> Image:
    """Memory image of the engine's next launch, unmeasured and without an end."""
    drives = engine.packed.drives
    drives["steps"] = drives["window_start"] = drives["window_end"] = MOST_STEPS
    engine.set_constants("drives", drives)
    launch = engine.prepared_launch(frames)
    image = Image()
    image.append(bytes(launch.bounds))
    image.places["arguments"] = first = image.append(bytes(launch.arguments))
    kind = type(launch.arguments)
    begins = [first + getattr(kind, name).offset for name, _ in kind._fields_]
    image.places["steps"] = begins[-1]
    structs = {"ensemble": engine.ensemble, **engine.changing_structs()}
    for begin, (group, struct) in zip(begins, structs.items(), strict=False):
        for name, row in ARRAYS[group].items():
            array, is_scratch = getattr(struct, name), not (row.dimension or row.packed_name)
            content = bytes(array.capacity) if is_scratch else ctypes.string_at(array.ptr, array.capacity)
            image.places[group, name] = image.append(content)
            image.pointers.append((begin + getattr(type(struct._ctype), name).offset, image.places[group, name]))
    image.places["frames"] = image.append(bytes(frames.capacity))
    image.pointers += [(begins[3], image.places["frames"]), (begins[4], image.append(b""))]
    for at, _ in image.pointers:
        image.content[at : at + 8] = bytes(8)
    image.scratch = launch.scratch.capacity
    return image


def image_header(
    image: Image,
    engine: CpuEngine,
    inputs: Sequence[InputPort],
    starts: Sequence[float],
    outputs: Sequence[OutputPort],
    names: Mapping[str, str],
) -> str:
    """C header of a memory image; `starts` are inputs' first values, `names` macros."""
    drives = engine.packed.drives
    kept = len(image.content)
    places = np.concatenate([np.zeros(0, dtype=np.int64), *(port.places[0].ravel() for port in outputs)])
    numbers = {
        "STEP": c_number(drives["step"][0]),
        "MOST_STEPS": MOST_STEPS,
        "KEPT_BYTES": kept,
        "IMAGE_BYTES": kept + image.scratch + -(kept + image.scratch) % ALIGNMENT,
        "ARGUMENTS": image.places["arguments"],
        "STEPS": image.places["steps"],
        "PROGRESS": image.places["state", "progress"],
        "TABLES": image.places["ensemble", "tables"],
        "FRAMES": image.places["frames"],
        "FRAME_INTERVAL": image.places["ensemble", "drives"] + drives.dtype.fields["frame_interval"][1],
        "CELL": CELL,
        "ROW_BYTES": dtype_of(Tabulated).itemsize,
        "DRIVES": len(drives),
        "DRIVE_BYTES": drives.dtype.itemsize,
        "INPUTS": len(inputs),
        "VALUES": len(starts),
        "OUTPUTS": len(places),
    }
    lines = [f"#define {name} {value}" for name, value in {**names, **numbers}.items()]
    pairs = ", ".join(f"{{{at}, {to}}}" for at, to in image.pointers)
    lines.append(f"static const Pointer POINTERS[] = {{{pairs}}};")
    lines.append(f"static const double STARTS[] = {{{c_numbers([*starts, 0.0])}}};")
    lines.append(f"static const int OUTPUT_PLACES[] = {{{', '.join(map(str, [*places.tolist(), 0]))}}};")
    rows, value = [], 0
    for number, port in enumerate(inputs):
        lines += _offset_lines(image, engine, port, number)
        rows.append(_input_row(engine, port, number, value))
        value += port.places.shape[1]
    lines.append(f"static const Input INPUT_TABLE[] = {{{', '.join([*rows, '{0}'])}}};")
    return "\n".join(lines) + "\n"


def c_number(value: float) -> str:
    """C literal of a number, exact in every bit."""
    return float(value).hex() if np.isfinite(value) else "-INFINITY" if value < 0.0 else "INFINITY"


def c_numbers(values: Iterable[float]) -> str:
    """C literals of numbers, with commas."""
    return ", ".join(c_number(value) for value in values)


def _offset_lines(image: Image, engine: CpuEngine, port: InputPort, number: int) -> list[str]:
    """C arrays of offsets in the image of an input's values."""
    kind, array = port.kind, packed_array(engine.packed, port)
    begins = image.places["ensemble", kind.array] + array.dtype.itemsize * port.rows
    offset = {name: place[1] for name, place in (array.dtype.fields or {}).items()}
    tables = [begin + offset[table] for begin in begins.tolist() for table in kind.tables]
    name, _ = kind.replaced
    replaced = [begin + offset[name] for begin in begins.tolist()] if name else []
    both = (("TABLES_OF", tables), ("REPLACED_OF", replaced))
    return [f"static const long {what}_{number}[] = {{{', '.join(map(str, [*of, 0]))}}};" for what, of in both]


def _input_row(engine: CpuEngine, port: InputPort, number: int, value: int) -> str:
    """C initializer of an input, numbered from `value`."""
    packed, kind, first = engine.packed, port.kind, int(port.first_rows[0])
    axes = port.places.shape[1]
    name, beside = kind.replaced
    form = "LED" if kind.is_led else "NUMBER" if not kind.tables else "SPEED" if kind.name == "speed" else "HELD"
    members = {
        "name": f'"{c_text(port.name)}"',
        "kind": form,
        "least": c_number(kind.least),
        "axes": axes,
        "value": value,
        "rows": len(port.rows),
        "places": f"{{{', '.join(map(str, port.places[0].tolist()))}}}",
        "tables": f"TABLES_OF_{number}",
        "replaced": f"REPLACED_OF_{number}" if name else "NULL",
        "beside": c_number(beside),
    }
    if form == "SPEED":
        motion = packed.motions[first]
        members |= {"own": f"{{{_own_table(motion['drive_table'])}}}"}
        members |= {name: c_number(motion[name]) for name in ("speed", "ramp_time")}
    elif form == "LED":
        mount = packed.mounts[first]
        members |= {"own": f"{{{', '.join(_own_table(mount[f'{axis}_table']) for axis in 'xy')}}}"}
        members |= {name: f"{{{c_numbers(mount[name])}}}" for name in ("home", "direction")}
        members |= {name: c_number(mount[name]) for name in ("offset", "amplitude", "frequency", "phase")}
    return "{" + ", ".join(f".{name} = {of}" for name, of in members.items()) + "}"


def _own_table(table: Any) -> str:
    """C initializer of a drive's own table."""
    whole = ", ".join(str(int(table[name])) for name in ("cells", "first", "repeats"))
    return f"{{{whole}, {c_numbers((table['start'], table['spacing']))}}}"


def c_text(text: str) -> str:
    """C string literal's content for a text."""
    plain = {ord(c) for c in string.ascii_letters + string.digits + " ._-"}
    return "".join(chr(b) if b in plain else f"\\{b:03o}" for b in text.encode())


def start_values(engine: CpuEngine, port: InputPort) -> NDArray[np.float64]:
    """Values (axes,) of a drive's own input at t = 0; 0 of tables over angle or speed."""
    packed, first, zero = engine.packed, port.first_rows, np.zeros(1)
    if port.kind.is_led:
        return packed.mounts["home"][first][0] + own_center(packed, first, zero)[0][0]
    if not port.kind.tables:
        return np.asarray(packed_array(packed, port)[port.kind.replaced[0]][first], dtype=float)
    if (packed_array(packed, port)[port.kind.tables[0]][first]["over_angle"] != 0).any():
        return zero
    return np.asarray(port.value_at(packed, zero)[0])
