"""Inputs of a stepped run, written into an ensemble's constant data between launches.

An input is a table of one cell over time, which kernels read as a drive's own. It goes from v_0 at t_0 to v_1 at t_1
along a line, then is held:

    v = v_0 + (v_1 - v_0) w,    w = min((t - t_0) / (t_1 - t_0), 1)                                        (1)

Held at once: t_0 = 0, t_1 = 1 s, v_0 = v_1. A speed keeps the angle phi turned up to t: its table's integral begins at
phi_0 = phi(t) less that of (1) up to t. A force is the preload of a tensioner.

As kernels cannot take a jump of a center's velocity, centers and pivots go on at their velocity u and come to rest
after T = t_1 - t_0, by the cubic

    v = v_0 + u T w + (3 D - 2 u T) w^2 + (u T - 2 D) w^3,    D = v_1 - v_0.                               (2)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.errors import SimulationError
from warpchain.kernels.physics.motion import CELL_VALUES
from warpchain.kernels.physics.mount import PRESCRIBED
from warpchain.model import ChainModel
from warpchain.model.trains import prescribed_leader

Values = NDArray[np.float64]
CELL = int(CELL_VALUES)
TABLE_VALUES = CELL + 1
"""Values of an input's table: one cell, and one behind it that kernels read."""


@dataclass(frozen=True)
class InputKind:
    """Kind of input: unit, parts, and where kernels read it."""

    name: str
    unit: str
    words: str  # parts that have it
    array: str  # of `PackedEnsemble`, whose rows have the tables
    tables: tuple[str, ...]  # their fields, one for each axis; () for a number
    replaced: tuple[str, float] = ("", 0.0)  # field that the tables stand in for, and its value beside them
    least: float = -np.inf
    is_led: bool = False  # whether a jump would be at no finite speed


_KINDS = (
    InputKind("load_torque", "N m", "free sprockets and shafts", "motions", ("load_table",), ("load", 0.0)),
    InputKind("motor_torque", "N m", "shafts with a motor", "motors", ("table",), ("torque", 0.0)),
    InputKind("capacity", "N m", "couplings with a clutch", "couplings", ("engagement",), ("capacity", 1.0), 0.0),
    InputKind("speed", "rad/s", "sprockets and shafts whose speed is prescribed", "motions", ("drive_table",)),
    InputKind("center", "m", "sprockets whose center is prescribed", "mounts", ("x_table", "y_table"), is_led=True),
    InputKind("pivot", "m", "arms whose pivot is led", "mounts", ("x_table", "y_table"), is_led=True),
    InputKind("force", "N", "tensioners with a spring", "tensioners", (), ("preload", 0.0), 0.0),
)
KINDS = {kind.name: kind for kind in _KINDS}


@dataclass
class InputPort:
    """An input of V variants, with `axes` values each.

    Attributes:
        name: PART.KIND.
        rows: (R,) rows of the packed array that have it; of a train, several of a variant.
        owners: (R,) their variants.
        places: (V, axes) of its tables among the ensemble's.
        start, end: (V,) t_0 and t_1 [s].
        before, after: (V, axes) v_0 and v_1, NaN until set.
        pace: (V, axes) u T of a center, else 0.
        turned: (V,) phi_0 of a speed [rad].
        values_at_start: v_0 of its tables among the ensemble's values.
        is_held: whether last set at once.
    """

    name: str
    kind: InputKind
    rows: NDArray[np.int64]
    owners: NDArray[np.int64]
    places: NDArray[np.int64]
    start: Values = field(init=False)
    end: Values = field(init=False)
    before: Values = field(init=False)
    after: Values = field(init=False)
    pace: Values = field(init=False)
    turned: Values = field(init=False)
    values_at_start: slice = field(init=False)
    is_held: bool = False

    def __post_init__(self) -> None:
        variants = len(self.places)
        self.start, self.end, self.turned = np.zeros(variants), np.ones(variants), np.zeros(variants)
        self.before, self.after = np.full((2, *self.places.shape), np.nan)
        self.pace = np.zeros(self.places.shape)
        self.values_at_start = slice(int(self.places[0, 0]), int(self.places[-1, -1]) + 1, TABLE_VALUES)

    @property
    def is_set(self) -> bool:
        """Whether the input has been set."""
        return math.isfinite(self.after[0, 0])

    @property
    def is_plainly_held(self) -> bool:
        """Whether another value to hold is one number of its table."""
        return self.is_held and self.kind.name != "speed"

    def hold(self, value: float | Values, tables: NDArray[Any]) -> None:
        """Holds one value for all variants, or (V,), in kernels' `tables`, once the input `is_plainly_held`."""
        self.before[:, 0] = self.after[:, 0] = tables[self.values_at_start] = value

    def value_at(self, packed: PackedEnsemble, time: Values) -> Values:
        """Value (V, axes) at `time` (V,), the drive's own until set.

        Raises:
            SimulationError: its own is a table over angle or speed.
        """
        if not self.is_set:
            return self._own_values(packed, time)
        w, _ = self._part_of_line(time)
        c1, c2, c3 = self._coefficients()
        return self.before + w * (c1 + w * (c2 + w * c3))

    def _part_of_line(self, time: Values) -> tuple[Values, Values]:
        """w of (1) and its rate [1/s], both (V, 1)."""
        u = (time - self.start) / (self.end - self.start)
        return np.clip(u, 0.0, 1.0)[:, None], np.where(u < 1.0, 1.0 / (self.end - self.start), 0.0)[:, None]

    def _coefficients(self) -> tuple[Values, Values, Values]:
        """Coefficients (V, axes) of w, w^2 and w^3 in (1) or (2)."""
        way = self.after - self.before
        if not self.kind.is_led:
            return way, self.pace, self.pace
        return self.pace, 3.0 * way - 2.0 * self.pace, self.pace - 2.0 * way

    def _led_velocity(self, packed: PackedEnsemble, time: Values) -> Values:
        """Velocity (V, 2) of a center or pivot at `time` (V,) [m/s]."""
        if not self.is_set:
            return own_center(packed, self.first_rows, time)[1]
        w, rate = self._part_of_line(time)
        c1, c2, c3 = self._coefficients()
        return rate * (c1 + w * (2.0 * c2 + w * 3.0 * c3))

    def set_values(self, packed: PackedEnsemble, values: Values, time: Values, end: Values | None) -> set[str]:
        """Sets the input in `packed`; returns the names of changed arrays.

        Args:
            values: (V, axes).
            time: (V,) from when on [s].
            end: (V,) when they are reached [s]; None: at once.
        """
        settled = self.is_held or (self.end <= time).all()
        if end is None and self.is_set and settled and (self.after == values).all():
            return set()
        if not self.kind.tables:
            packed_array(packed, self)[self.kind.replaced[0]][self.rows] = values[self.owners, 0]
            self.before = self.after = values.copy()
            return {self.kind.array}
        if self.kind.name == "speed":
            turned = self._angle_turned(packed, time)
            self.turned = turned - values[:, 0] * time if end is None else turned
        before = values if end is None else self.value_at(packed, time)
        if end is not None and self.kind.is_led:
            self.pace = self._led_velocity(packed, time) * (end - time)[:, None]
        is_fresh, was_held = not self.is_set, self.is_held
        self.before, self.after, self.is_held = before.copy(), values.copy(), end is None
        cells = packed.tables[self.places.flat[0] : self.places.flat[-1] + TABLE_VALUES]
        cells = cells.reshape(*self.places.shape, TABLE_VALUES)
        cells[..., 0], cells[..., CELL - 1] = before, self.turned[:, None]
        for k, coefficient in enumerate(self._coefficients(), 1):
            cells[..., k] = coefficient
        if not is_fresh and was_held and self.is_held:
            return {"tables"}
        self.start, self.end = (np.zeros(len(time)), np.ones(len(time))) if end is None else (time, end)
        self._write_rows(packed)
        return {"tables", self.kind.array}

    @property
    def first_rows(self) -> NDArray[np.int64]:
        """First row (V,) of each variant."""
        return self.rows[np.searchsorted(self.owners, np.arange(len(self.places)))]

    def _write_rows(self, packed: PackedEnsemble) -> None:
        """Writes places and times of the tables into the rows."""
        array, (name, value) = packed_array(packed, self), self.kind.replaced
        for axis, of in enumerate(self.kind.tables):
            table = array[of]
            table["cells"][self.rows], table["over_angle"][self.rows], table["repeats"][self.rows] = 1, 0, 0
            table["first"][self.rows] = self.places[self.owners, axis]
            table["start"][self.rows] = self.start[self.owners]
            table["spacing"][self.rows] = (self.end - self.start)[self.owners]
        if name == "load":
            array[name][self.rows, 0] = value
        elif name:
            array[name][self.rows] = value

    def _own_values(self, packed: PackedEnsemble, time: Values) -> Values:
        """The drive's own value (V, axes) at `time` (V,)."""
        array, (name, _), first = packed_array(packed, self), self.kind.replaced, self.first_rows
        if self.kind.name == "speed":
            return own_course(packed, first, time)[1][:, None]
        if self.kind.is_led:
            return own_center(packed, first, time)[0]
        tables = array[self.kind.tables[0]][first]
        if (tables["over_angle"] != 0).any():
            raise SimulationError(
                f"{self.name}: follows a table over angle or speed until it is set; set it once without over= before"
            )
        constant = array[name][first]
        constant = constant[:, 0] if name == "load" else constant
        own = np.array([table_value(packed.tables, *of)[0] for of in zip(tables, time, strict=True)])
        has = tables["cells"] > 0
        both = constant * own if name == "capacity" else constant + own
        return np.asarray(np.where(has, both, constant))[:, None]

    def _angle_turned(self, packed: PackedEnsemble, time: Values) -> Values:
        """Angle phi (V,) [rad] of a prescribed body at `time`, without harmonics."""
        if not self.is_set:
            return own_course(packed, self.first_rows, time)[0]
        span, first, last = self.end - self.start, self.before[:, 0], self.after[:, 0]
        u = (time - self.start) / span
        w = np.clip(u, 0.0, 1.0)
        return self.turned + span * w * (first + 0.5 * (last - first) * w) + (u - w) * span * last


def packed_array(packed: PackedEnsemble, port: InputPort) -> NDArray[Any]:
    """Packed array that has an input's rows."""
    return np.asarray(getattr(packed, port.kind.array))


def table_value(tables: NDArray[np.floating], table: Any, x: float) -> tuple[float, float, float]:
    """Value, slope, and integral from 0, of a packed table at `x`; 0 for none."""
    cells, first, spacing = int(table["cells"]), int(table["first"]), float(table["spacing"])
    if not cells:
        return 0.0, 0.0, 0.0
    u = (x - float(table["start"])) / spacing
    rounds = math.floor(u / cells) if table["repeats"] else 0
    u -= rounds * cells
    within = min(max(u, 0.0), cells)
    cell = min(int(within), cells - 1)
    c0, c1, c2, c3, before = tables[first + CELL * cell : first + CELL * (cell + 1)].tolist()
    w, beyond = within - cell, u - within
    value = c0 + w * (c1 + w * (c2 + w * c3))
    slope = (c1 + w * (2.0 * c2 + w * 3.0 * c3)) / spacing if beyond == 0.0 else 0.0
    integral = before + spacing * w * (c0 + w * (c1 / 2 + w * (c2 / 3 + w * c3 / 4))) + beyond * spacing * value
    return value, slope, integral + (rounds * float(tables[first + CELL * cells]) if rounds else 0.0)


def own_center(packed: PackedEnsemble, bodies: NDArray[np.int64], time: Values) -> tuple[Values, Values]:
    """Displacement [m] and velocity [m/s] (V, 2) of led centers by their own motion."""
    mounts = packed.mounts[bodies]
    argument, direction = mounts["frequency"] * time + mounts["phase"], mounts["direction"]
    place = (mounts["offset"] + mounts["amplitude"] * np.sin(argument))[:, None] * direction
    velocity = (mounts["amplitude"] * mounts["frequency"] * np.cos(argument))[:, None] * direction
    for v in np.flatnonzero((mounts["x_table"]["cells"] > 0) | (mounts["y_table"]["cells"] > 0)).tolist():
        of = [table_value(packed.tables, mounts[f"{axis}_table"][v], float(time[v])) for axis in "xy"]
        place[v], velocity[v] = [each[0] for each in of], [each[1] for each in of]
    return place, velocity


def own_course(packed: PackedEnsemble, bodies: NDArray[np.int64], time: Values) -> tuple[Values, Values]:
    """Angle [rad] and rate [rad/s] (V,) of prescribed bodies by their own motion, without harmonics."""
    motions = packed.motions[bodies]
    duration = np.where(motions["ramp_time"] > 0.0, motions["ramp_time"], 1.0)
    u = np.where(motions["ramp_time"] > 0.0, np.minimum(time / duration, 1.0), 1.0)
    rate = motions["speed"] * u * u * (3.0 - 2.0 * u)
    ramped = np.where(u < 1.0, motions["ramp_time"] * u**3 * (1.0 - 0.5 * u), time - 0.5 * motions["ramp_time"])
    phi = motions["speed"] * ramped
    for v in np.flatnonzero(motions["drive_table"]["cells"] > 0).tolist():
        rate[v], _, phi[v] = table_value(packed.tables, motions["drive_table"][v], float(time[v]))
    return phi, rate


def make_ports(names: Sequence[str], rows: ChainRows, packed: PackedEnsemble) -> dict[str, InputPort]:
    """Inputs by name, their tables appended to those of `packed`.

    Raises:
        SimulationError: an unknown input, or a variant without its part.
    """
    tables = packed.tables.reshape(-1)
    zero, end = len(tables), len(tables) + TABLE_VALUES
    ports = {}
    for name in names:
        part, _, of = name.rpartition(".")
        if of not in KINDS:
            raise SimulationError(
                f"inputs: {name!r}: must be PART.KIND, such as driven.load_torque; kinds are {', '.join(KINDS)}"
            )
        kind, found = (
            KINDS[of],
            [(row, v) for v in range(len(rows.drives)) for row in _port_rows(of, part, rows, v, packed)],
        )
        missing = sorted(set(range(len(rows.drives))) - {v for _, v in found})
        if missing:
            raise SimulationError(f"inputs: {name!r}: {_missing_words(of, part, rows.drives[missing[0]], missing[0])}")
        axes = max(len(kind.tables), 1)
        places = end + TABLE_VALUES * np.arange(len(rows.drives) * axes, dtype=np.int64).reshape(-1, axes)
        end += TABLE_VALUES * places.size
        both = np.array(found, dtype=np.int64)
        ports[name] = InputPort(name, kind, both[:, 0], both[:, 1], places)
    packed.tables = np.append(tables, np.zeros(end - len(tables)))
    for port in ports.values():
        if port.kind.array in ("motions", "mounts"):  # so that block kernels read tables at all
            table = packed.motions["load_table"]
            mine = port.rows[table["cells"][port.rows] == 0]
            table["cells"][mine], table["first"][mine], table["spacing"][mine] = 1, zero, 1.0
    return ports


def _missing_words(of: str, part: str, drive: Any, v: int) -> str:
    """Why a variant lacks an input, in words."""
    parts = [
        each for kind in ("sprockets", "shafts", "arms", "tensioners", "couplings") for each in getattr(drive, kind)
    ]
    names = [each.name for each in parts]
    whose = f"variant {v}"
    if part not in names:
        return f"no part {part!r} in {whose}; parts are {', '.join(names)}"
    return f"{of} is an input of {KINDS[of].words}, which {part!r} of {whose} is not"


def _port_rows(of: str, part: str, rows: ChainRows, v: int, packed: PackedEnsemble) -> Iterator[int]:
    """Rows of variant v's parts that an input sets."""
    for r in range(int(rows.first_rows[v]), int(rows.first_rows[v + 1])):
        model, at = rows.models[r], packed.drives[r]
        if of == "speed":
            yield from _led_bodies(part, model, at, packed)
        elif of in ("load_torque", "center"):
            names = _body_names(model)
            mine = [int(at["first_body"]) + b for b, name in enumerate(names) if name == part]
            yield from (row for row in mine if _takes(of, row, packed))
        elif of == "motor_torque":
            yield from (int(at["first_shaft"]) + h for h, shaft in enumerate(model.shafts)
                        if shaft.name == part and packed.motors["present"][int(at["first_shaft"]) + h])  # fmt: skip
        elif of == "capacity":
            yield from (int(at["first_coupling"]) + c for c, each in enumerate(model.couplings)
                        if each.name == part and each.clutch is not None)  # fmt: skip
        elif of == "pivot":
            first = int(at["first_body"]) + model.first_arm_body
            yield from (first + a for a, arm in enumerate(model.arms)
                        if arm.name == part and packed.mounts["moves"][first + a] == PRESCRIBED)  # fmt: skip
        elif of == "force":
            yield from (int(at["first_tensioner"]) + t for t, each in enumerate(model.tensioners)
                        if each.name == part and each.spring is not None)  # fmt: skip


def _takes(of: str, row: int, packed: PackedEnsemble) -> bool:
    """Whether a body takes a load, at its home, or has a led center."""
    if of == "center":
        return bool(packed.mounts["moves"][row] == PRESCRIBED)
    motion = packed.motions[row]
    return bool(motion["prescribed"] == 0 and motion["shaft_offset"] == 0)


def _body_names(model: ChainModel) -> list[str]:
    """Names of a chain's sprockets and shafts."""
    return [*(sprocket.name for sprocket in model.sprockets), *(shaft.name for shaft in model.shafts)]


def _led_bodies(part: str, model: ChainModel, at: Any, packed: PackedEnsemble) -> Iterator[int]:
    """Bodies of a chain that follow a prescribed part's angle."""
    names = _body_names(model)
    for b in range(len(names)):
        row, leader = int(at["first_body"]) + b, prescribed_leader(model, b)
        motion = packed.motions[row]
        if motion["prescribed"] and not motion["shaft_offset"] and leader is not None and names[leader[0]] == part:
            yield row
            away = np.flatnonzero(np.arange(len(packed.motions)) + packed.motions["shaft_offset"] == row)
            yield from (int(other) for other in away if other != row)
