"""Many drives packed into the flat arrays that the kernels read: each variant's parts one after the other.

Nothing of one variant depends on another: the packing only decides where its values stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.alike import alike, taken
from warpchain.assembly import Assembly, assemble
from warpchain.contact import contact_damping, guide_stiffness, sprocket_stiffness
from warpchain.drive import Drive, Harmonic, ImpactLaw
from warpchain.drive_tables import Table
from warpchain.errors import DriveError, SimulationError
from warpchain.kernels import structs
from warpchain.kernels.impact import FORCES
from warpchain.kernels.rollers import STATE_ROWS
from warpchain.laws import LAWS
from warpchain.mounts import farthest, fill_mount, initial_center, initial_velocity, wheel_inertia
from warpchain.tables import TableList, shaft_ratio

INTEGRATORS = {"leapfrog": 0, "rk4": 1}
FORMS = {force.key: form for form, force in enumerate(FORCES)}
REAL = {"float64": wp.float64, "float32": wp.float32}
ESCAPE_PITCHES = 10.0
"""A roller this many pitches outside the drive's bounding box has left it (the variant diverged)."""


def real_of(precision: str) -> type:
    """Warp's type of a precision; a SimulationError for an unknown one."""
    if precision not in REAL:
        raise SimulationError(f'precision = {precision!r}: allowed are "float64" and "float32"')
    return REAL[precision]


@dataclass(frozen=True)
class Schedule:
    """When a variant steps, samples and measures; counts of steps of `step` seconds."""

    step: float
    steps: int
    window_start: int
    window_end: int
    sample_every: int  # 0: not recorded

    @property
    def frames(self) -> int:
        """Number of frames of the whole run, the one at t = 0 among them."""
        return self.steps // self.sample_every + 1 if self.sample_every else 0


@dataclass
class Packed:
    """An ensemble as numpy structured arrays, in the layout of `kernels.structs`, and where each variant's parts begin.

    Attributes:
        drives ... impact_speed: see `kernels.structs.Ensemble` and `.State`.
        rollers: (6 * all rollers,) each variant's rows: x, y, vx, vy, and the low parts of x, y (float32).
        assemblies: the initial states.
    """

    precision: str
    drives: NDArray[Any]
    chains: NDArray[Any]
    lengths: NDArray[np.floating]
    sprockets: NDArray[Any]
    motions: NDArray[Any]
    mounts: NDArray[Any]
    guides: NDArray[Any]
    harmonics: NDArray[np.float64]
    tables: NDArray[np.float64]
    seats: NDArray[np.floating]
    rollers: NDArray[np.floating]
    bodies: NDArray[Any]
    strands: NDArray[Any]
    seat: NDArray[np.int32]
    assemblies: tuple[Assembly, ...]

    @property
    def real(self) -> type:
        """The Warp scalar type of the precision."""
        return REAL[self.precision]

    @property
    def variants(self) -> int:
        """Number of variants."""
        return len(self.assemblies)

    def first_value(self, v: int) -> int:
        """Where variant v's rows begin in `rollers`."""
        return STATE_ROWS * int(self.drives["first_roller"][v])

    def rows(self, v: int) -> NDArray[np.floating]:
        """View of variant v's rows x, y, vx, vy and low parts of x, y, (6, N)."""
        first, n = self.first_value(v), int(self.drives["rollers"][v])
        return self.rollers[first : first + STATE_ROWS * n].reshape(STATE_ROWS, n)

    def part(self, a: int, b: int) -> Packed:
        """Variants `a` to `b` - 1 as an ensemble of their own."""

        def span(first: str, per: Any) -> slice:
            """The values of these variants in an array that begins at `first` and has `per` values a variant."""
            starts = self.drives[first].astype(np.int64)
            return slice(int(starts[a]), int(starts[b - 1] + per[b - 1]))

        rollers, wheels, bars = (self.drives[name].astype(np.int64) for name in ("rollers", "sprockets", "guides"))
        chain = span("first_roller", rollers)
        disks, rails = span("first_sprocket", wheels), span("first_guide", bars)
        memories = span("first_contact", rollers * (wheels + bars))
        drives = self.drives[a:b].copy()
        for name in ("first_roller", "first_sprocket", "first_guide", "first_contact", "first_tally"):
            drives[name] -= drives[name][0]
        guides = self.guides[rails] if rails.stop > rails.start else self.guides[:1]
        return replace(
            self,
            drives=drives,
            chains=self.chains[a:b],
            lengths=self.lengths[chain],
            sprockets=self.sprockets[disks],
            motions=self.motions[disks],
            mounts=self.mounts[disks],
            guides=guides,
            rollers=self.rollers[STATE_ROWS * chain.start : STATE_ROWS * chain.stop],
            bodies=self.bodies[disks],
            strands=self.strands[disks],
            seat=self.seat[memories],
            assemblies=self.assemblies[a:b],
        )

    def at_precision(self, precision: str) -> Packed:
        """This ensemble, which is in float64, at another precision; what positions lose goes to their low parts.

        Raises:
            SimulationError: for an unknown precision.
        """
        kinds = structs.types(real_of(precision))
        if precision == self.precision:
            return self
        rollers = self.rollers.astype(precision)
        other = replace(
            self,
            precision=precision,
            chains=self.chains.astype(kinds.Chain.numpy_dtype()),
            lengths=self.lengths.astype(precision),
            sprockets=self.sprockets.astype(kinds.Sprocket.numpy_dtype()),
            guides=self.guides.astype(kinds.Guide.numpy_dtype()),
            rollers=rollers,
        )
        for v in range(self.variants):
            exact, rows = self.rows(v), other.rows(v)
            rows[4:6] = exact[0:2] - rows[0:2]
        return other


class _Table:
    """Rows of (order, amplitude, phase), or of seat directions, gathered as drives are packed."""

    def __init__(self, width: int) -> None:
        self.blocks: list[NDArray[np.float64]] = []
        self.length = 0
        self.width = width
        self.known: dict[int, int] = {}

    def add(self, rows: NDArray[np.float64]) -> tuple[int, int]:
        """Appends rows; returns where they begin and how many they are."""
        first = self.length
        self.blocks.append(rows.reshape(-1, self.width))
        self.length += len(self.blocks[-1])
        return first, len(self.blocks[-1])

    def array(self) -> NDArray[np.float64]:
        """All rows; one row of zeros where there are none, since Warp reads no empty array."""
        return np.concatenate(self.blocks) if self.length else np.zeros((1, self.width))


def _layout(drive: Drive) -> tuple[Any, ...]:
    """All of a drive that its initial state hangs on: drives alike in this are assembled once."""
    chain = drive.chain
    wheels = tuple((s.name, s.center, s.teeth, s.pitch, s.wrap, s.prescribed, s.mount) for s in drive.sprockets)
    lengths = (chain.pitch, chain.links, chain.elongation, chain.worn_links, chain.roller_radius)
    return (*lengths, wheels, drive.contact.sprocket, drive.run.gravity)


def _assembled(v: int, drive: Drive, known: dict[tuple[Any, ...], Assembly]) -> Assembly:
    layout = _layout(drive)
    if layout not in known:
        try:
            known[layout] = assemble(drive)
        except DriveError as error:
            raise DriveError(f"variant {v}: {error}") from None
    return known[layout]


def _zeros(struct: Any, count: int) -> NDArray[Any]:
    return np.zeros(max(count, 1), dtype=struct.numpy_dtype())


def _fill_law(row: Any, contact: ImpactLaw, stiffness: float, mass: float) -> None:
    row["form"] = FORMS[LAWS[contact.law].force]
    row["stiffness"] = stiffness
    row["exponent"] = contact.exponent
    row["hysteresis"] = contact_damping(contact, stiffness, mass)
    row["speed_floor"] = contact.impact_speed_floor


def _fill_sprocket(row: Any, drive: Drive, s: int, seats: _Table) -> None:
    teeth = drive.sprockets[s].teeth
    if teeth not in seats.known:
        angle = 2.0 * np.pi * np.arange(teeth) / teeth
        seats.known[teeth], _ = seats.add(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    radius, half_pitch = drive.pitch_radius(s), 0.5 * drive.chain.pitch
    tooth = drive.tooth(s)
    half_seat, roller_radius = 0.5 * tooth.seat_angle, drive.chain.roller_radius
    row["teeth"] = teeth
    row["first_seat"] = seats.known[teeth]
    row["exact_radius"] = row["pitch_radius"] = radius
    row["near_square"] = (radius - half_pitch) ** 2
    row["far_square"] = (radius + half_pitch) ** 2
    row["half_pitch_tangent"] = np.tan(np.pi / teeth)
    row["clearance"] = tooth.seat_radius - roller_radius
    row["cos_half_seat"] = np.cos(half_seat)
    row["sin_half_seat"] = np.sin(half_seat)
    row["flank_curvature"] = 1.0 / (tooth.flank_radius + roller_radius)
    row["tip_reach"] = tooth.tip_radius + roller_radius
    _fill_law(row["law"], drive.contact.sprocket, sprocket_stiffness(drive, s), drive.chain.mass)


def _harmonic_rows(drive: Drive, s: int, harmonics: Sequence[Harmonic]) -> NDArray[np.float64]:
    """(order, amplitude, phase) of sprocket s's harmonics, orders by its own revolutions."""
    rows = [(h.order / shaft_ratio(drive, s, h.shaft), h.amplitude, h.phase) for h in harmonics]
    return np.array(rows, dtype=float)


def _fill_motion(row: Any, drive: Drive, s: int, angle: float, harmonics: _Table, tables: TableList) -> None:
    sprocket = drive.sprockets[s]
    row["sign"] = sprocket.sign
    row["start_angle"] = angle
    if sprocket.prescribed is not None:
        row["prescribed"] = 1
        row["speed"] = sprocket.prescribed.top_speed
        row["ramp_time"] = sprocket.prescribed.ramp_time
        _fill_table(row["drive_table"], drive, s, sprocket.prescribed.table, tables)
        rows = _harmonic_rows(drive, s, sprocket.prescribed.harmonics)
        row["drive_harmonics"]["first"], row["drive_harmonics"]["count"] = harmonics.add(rows)
        return
    assert sprocket.inertia is not None  # the drive's own check
    row["inverse_inertia"] = 1.0 / (sprocket.inertia + wheel_inertia(sprocket))
    if sprocket.load is not None:
        load = sprocket.load
        row["load"] = (load.torque, load.viscous, load.quadratic)
        row["load_ramp_time"] = load.ramp_time
        _fill_table(row["load_table"], drive, s, load.table, tables)
        rows = _harmonic_rows(drive, s, load.harmonics)
        row["load_harmonics"]["first"], row["load_harmonics"]["count"] = harmonics.add(rows)


def _fill_table(row: Any, drive: Drive, s: int, table: Table | None, tables: TableList) -> None:
    if table is not None:
        tables.add(row, table, shaft_ratio(drive, s, table.shaft))


def _fill_guide(row: Any, drive: Drive, g: int) -> None:
    guide = drive.guides[g]
    start, end = np.asarray(guide.start), np.asarray(guide.end)
    length = float(np.hypot(*(end - start)))
    row["start"] = start
    row["direction"] = (end - start) / length
    row["length"] = length
    row["end_radius"] = guide.end_radius
    row["roller_radius"] = drive.chain.roller_radius
    _fill_law(row["law"], drive.guide_contact(g), guide_stiffness(drive, g), drive.chain.mass)


def _fill_strand(row: Any, assembly: Assembly, s: int, rollers: int) -> None:
    path = assembly.path
    chord = path.strand_end[s] - path.strand_start[s]
    length = float(np.hypot(*chord))
    row["start"] = path.strand_start[s]
    row["direction"] = chord / length
    row["length"] = length
    row["middle"] = (int(assembly.strand_first[s]) + int(assembly.strand_links[s]) // 2) % rollers


def _fill_drive(row: Any, drive: Drive, assembly: Assembly) -> None:
    row["rollers"], row["sprockets"], row["guides"] = drive.chain.links, len(drive.sprockets), len(drive.guides)
    row["integrator"] = INTEGRATORS[drive.run.integrator]
    margin = ESCAPE_PITCHES * drive.chain.pitch
    reach = np.array([sprocket.center for sprocket in drive.sprockets])
    radius = np.array([drive.pitch_radius(s) + farthest(sprocket) for s, sprocket in enumerate(drive.sprockets)])[
        :, None
    ]
    row["low"] = np.minimum((reach - radius).min(axis=0), assembly.position.min(axis=0)) - margin
    row["high"] = np.maximum((reach + radius).max(axis=0), assembly.position.max(axis=0)) + margin


def pack(drives: Sequence[Drive], schedules: Sequence[Schedule]) -> Packed:
    """Packs drives in float64, each in its assembled initial state.

    Drives alike in all but their loads are packed once and repeated; then each is given its own loads.

    Raises:
        DriveError: for a drive whose chain does not fit; the message names the variant.
    """
    firsts, which = alike(drives)
    harmonics, seats, tables = _Table(3), _Table(2), TableList()
    packed = _pack_each(drives, firsts, harmonics, seats, tables)
    if len(firsts) < len(drives):
        packed = taken(packed, which)
        blank = np.zeros((), dtype=packed.motions.dtype)
        for drive, kind, begin in zip(drives, which, packed.drives["first_sprocket"].tolist(), strict=True):
            twin = drives[firsts[kind]]
            for s, sprocket in enumerate(drive.sprockets):
                if sprocket is not twin.sprockets[s]:
                    packed.motions[begin + s] = blank
                    angle = float(packed.bodies["angle"][begin + s])
                    _fill_motion(packed.motions[begin + s], drive, s, angle, harmonics, tables)
    for name in ("step", "steps", "window_start", "window_end", "sample_every"):
        packed.drives[name] = [getattr(schedule, name) for _, schedule in zip(drives, schedules, strict=True)]
    packed.harmonics, packed.tables, packed.seats = harmonics.array(), tables.array(), seats.array()
    return packed


def _pack_each(
    everyone: Sequence[Drive], chosen: Sequence[int], harmonics: _Table, seats: _Table, tables: TableList
) -> Packed:
    """Packs the chosen drives one by one, but for their schedules, and gathers what their rows refer to."""
    drives = [everyone[v] for v in chosen]
    kinds = structs.types(wp.float64)
    count = len(drives)
    links = np.array([d.chain.links for d in drives])
    wheels = np.array([len(d.sprockets) for d in drives])
    bars = np.array([len(d.guides) for d in drives])
    known: dict[tuple[Any, ...], Assembly] = {}
    packed = Packed(
        precision="float64",
        drives=_zeros(structs.Drive, count),
        chains=_zeros(kinds.Chain, count),
        lengths=np.concatenate([drive.chain.link_lengths for drive in drives]),
        sprockets=_zeros(kinds.Sprocket, int(wheels.sum())),
        motions=_zeros(structs.Motion, int(wheels.sum())),
        mounts=_zeros(structs.Mount, int(wheels.sum())),
        guides=_zeros(kinds.Guide, int(bars.sum())),
        harmonics=np.zeros(0),
        tables=np.zeros(0),
        seats=np.zeros(0),
        rollers=np.zeros(STATE_ROWS * int(links.sum())),
        bodies=_zeros(structs.SprocketState, int(wheels.sum())),
        strands=_zeros(structs.Strand, int(wheels.sum())),
        seat=np.full(int((links * (wheels + bars)).sum()), -1, dtype=np.int32),
        assemblies=tuple(_assembled(v, drive, known) for v, drive in zip(chosen, drives, strict=True)),
    )
    roller = sprocket = guide = memory = tally = 0
    for v, (drive, assembly) in enumerate(zip(drives, packed.assemblies, strict=True)):
        row = packed.drives[v]
        row["first_roller"], row["first_sprocket"] = roller, sprocket
        row["first_guide"], row["first_contact"], row["first_tally"] = guide, memory, tally
        _fill_drive(row, drive, assembly)
        _fill_chain(packed.chains[v], drive)
        for s, wheel in enumerate(drive.sprockets):
            _fill_sprocket(packed.sprockets[sprocket + s], drive, s, seats)
            _fill_motion(packed.motions[sprocket + s], drive, s, float(assembly.sprocket_angle[s]), harmonics, tables)
            _fill_strand(packed.strands[sprocket + s], assembly, s, drive.chain.links)
            body = packed.bodies[sprocket + s]
            body["angle"], body["speed"] = assembly.sprocket_angle[s], assembly.sprocket_speed[s]
            body["center"], body["velocity"] = initial_center(wheel), initial_velocity(wheel)
            fill_mount(packed.mounts[sprocket + s], wheel, drive.run.gravity)
            held = np.flatnonzero(assembly.seat_sprocket == s)
            packed.seat[memory + s * drive.chain.links + held] = assembly.seat_index[held]
        for g in range(len(drive.guides)):
            _fill_guide(packed.guides[guide + g], drive, g)
        n = drive.chain.links
        packed.rollers[STATE_ROWS * roller : STATE_ROWS * (roller + n)] = state_rows(
            assembly.position, assembly.velocity, "float64"
        ).ravel()
        roller, sprocket, guide = roller + n, sprocket + len(drive.sprockets), guide + len(drive.guides)
        memory += n * (len(drive.sprockets) + len(drive.guides))
        tally += n * (len(drive.sprockets) + 1)
    return packed


def state_rows(position: NDArray[np.float64], velocity: NDArray[np.float64], precision: str) -> NDArray[np.floating]:
    """Rows x, y, vx, vy and the low parts of x, y: what `precision` rounds off a position, (6, N)."""
    high = position.astype(precision)
    return np.concatenate([high.T, velocity.T, (position - high).T]).astype(precision)


def _fill_chain(row: Any, drive: Drive) -> None:
    row["stiffness"] = drive.chain.stiffness
    row["damping"] = drive.chain.link_damping
    row["mass"] = drive.chain.mass
    row["inverse_mass"] = 1.0 / drive.chain.mass
    row["gravity"] = drive.run.gravity
