"""A packed ensemble as Warp arrays on a device."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.fill import INTEGRATORS
from warpchain.engine.packed import Packed, dtype_of
from warpchain.kernels import batches, structs, sum_structs
from warpchain.kernels.tension_bins import BINS

SPARE_LENGTHS = 4096
"""Lengths after the last: the block kernels' threads that have no roller read them."""


def split_seats(seats: NDArray[np.floating]) -> NDArray[np.floating]:
    """Directions (seats, 2) as (seats, 4): their multiples of 2^-12, and what these round off (`physics.seat`)."""
    coarse = np.rint(4096.0 * seats) / 4096.0
    return np.hstack([coarse, seats - coarse]).astype(np.float32)


def split(values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Numbers (n,) as pairs of float32 (n, 2)."""
    high = values.astype(np.float32)
    return np.stack([high, (values - high).astype(np.float32)], axis=-1)


def split_tables(motions: NDArray[Any]) -> NDArray[Any]:
    """(2 * bodies,) `structs.SplitTable`: the table of each body's motion and that of its load."""
    tables = np.stack([motions["drive_table"], motions["load_table"]], axis=1).ravel()
    made = np.zeros(len(tables), dtype=structs.SplitTable.numpy_dtype())
    for name in ("cells", "first", "over_angle", "repeats"):
        made[name] = tables[name]
    spacing = np.where(tables["cells"] > 0, tables["spacing"], 1.0)
    for name, values in (("start", tables["start"]), ("spacing", spacing), ("rate", 1.0 / spacing)):
        pairs = split(values)
        made[name]["high"], made[name]["low"] = pairs[:, 0], pairs[:, 1]
    return made


def split_pieces(pieces: NDArray[Any]) -> NDArray[np.float32]:
    """Pieces of profiles as rows of four (`physics.face`), (3 * pieces, 4)."""
    made = np.zeros((len(pieces), 3, 4), dtype=np.float32)
    for k, name in enumerate(("start", "direction")):
        made[:, k] = np.moveaxis(split(pieces[name]), 2, 1).reshape(-1, 4)
    made[:, 2, 0] = pieces["curvature"]
    return made.reshape(-1, 4)


def strokes(tensioners: NDArray[Any]) -> NDArray[Any]:
    """(tensioners,) `structs.Stroke`."""
    made = np.zeros(len(tensioners), dtype=structs.Stroke.numpy_dtype())
    (px, py), (dx, dy) = tensioners["point"].T, tensioners["direction"].T
    home = (tensioners["home"] * tensioners["direction"]).sum(axis=1)
    along, across = px * dx + py * dy, px * dy - py * dx
    for name, values in zip(made.dtype.names or (), (home, dx, dy, along, across), strict=True):
        pairs = split(values)
        made[name]["high"], made[name]["low"] = pairs[:, 0], pairs[:, 1]
    return made


def upload_ensemble(packed: Packed, device: str) -> Any:
    """What does not change during a run (`kernels.structs.types(...).Ensemble`), copied to `device`."""
    kinds = structs.types(packed.real)
    ensemble = kinds.Ensemble()
    paired = packed.precision == "float32"
    tabulated = paired and len(packed.tables) > 0
    arms, tensioners = packed.arms[: None if paired else 0], packed.tensioners[: None if paired else 0]
    for name, values, dtype in (
        ("drives", packed.drives, structs.Drive),
        ("chains", packed.chains, kinds.Chain),
        ("lengths", np.append(packed.lengths, np.ones(SPARE_LENGTHS)), packed.real),
        ("sprockets", packed.sprockets, kinds.Sprocket),
        ("motions", packed.motions, structs.Motion),
        ("mounts", packed.mounts, structs.Mount),
        ("guides", packed.guides, kinds.Guide),
        ("pieces", packed.pieces, structs.Piece),
        ("arms", packed.arms, structs.Arm),
        ("tensioners", packed.tensioners, structs.Tensioner),
        ("levers", arms.astype(dtype_of(structs.Lever)), structs.Lever),
        ("plungers", tensioners.astype(dtype_of(structs.Plunger)), structs.Plunger),
        ("strokes", strokes(tensioners), structs.Stroke),
        ("seats", packed.seats, wp.vec2d),
        ("split_seats", split_seats(packed.seats) if paired else np.zeros((1, 4)), wp.vec4f),
        ("split_harmonics", np.column_stack([packed.harmonics, np.sin(packed.harmonics[:, 2])]), wp.vec4f),
        ("split_tables", split_tables(packed.motions[: None if tabulated else 0]), structs.SplitTable),
        ("split_values", split(packed.tables[: None if tabulated else 0]), wp.vec2f),
        ("split_pieces", split_pieces(packed.pieces[: None if paired else 0]), wp.vec4f),
        ("tooth_sliding", packed.tooth_sliding, kinds.Sliding),
        ("guide_sliding", packed.guide_sliding, kinds.Sliding),
        ("joints", packed.joints, kinds.Joint),
        ("links", packed.links, kinds.Links),
    ):
        setattr(ensemble, name, wp.array(values, dtype=dtype, device=device, copy=True))
    ensemble.curves.harmonics = wp.array(packed.harmonics, dtype=wp.vec3d, device=device, copy=True)
    ensemble.curves.tables = wp.array(packed.tables, dtype=wp.float64, device=device, copy=True)
    return ensemble


def _stage_rows() -> int:
    """Rows of a roller between rk4's stages; where no GPU takes it, the GPU's kernels are not loaded."""
    from warpchain.kernels.gpu.block_rk4 import STAGE_ROWS

    return STAGE_ROWS


def upload_state(packed: Packed, device: str, large: tuple[int, int] | None = None) -> Any:
    """The initial state (`kernels.structs.types(...).State`), copied to `device`.

    `large` is for block kernels: how many values, and values of parts, that blocks share lie in global memory.
    """
    kinds = structs.types(packed.real)
    state = kinds.State()
    in_rows, in_parts = large or (0, 0)
    state.rows = wp.empty(max(in_rows, 1), dtype=packed.real, device=device)
    state.parts = wp.empty(max(in_parts, 1), dtype=packed.real, device=device)
    rk4 = large is not None and bool((packed.drives["integrator"] == INTEGRATORS["rk4"]).any())
    state.stages = wp.empty(_stage_rows() * len(packed.lengths) if rk4 else 1, dtype=packed.real, device=device)
    state.extra = wp.zeros(1 if large is None else len(packed.lengths), dtype=kinds.Extra, device=device)
    for name, values, dtype in (
        ("rollers", packed.rollers, packed.real),
        ("bodies", packed.bodies, structs.BodyState),
        ("strands", packed.strands, structs.Strand),
        ("seat", packed.seat, wp.int32),
    ):
        setattr(state, name, wp.array(values, dtype=dtype, device=device, copy=True))
    state.impact_speed = wp.zeros(len(packed.seat), dtype=packed.real, device=device)
    partners = len(packed.sprockets) + len(packed.guides)
    state.totals = wp.zeros(partners, dtype=sum_structs.Totals, device=device)
    state.body_stages = wp.zeros(len(packed.bodies), dtype=structs.BodyStages, device=device)
    state.wrenches = wp.zeros(len(packed.bodies), dtype=structs.Wrench, device=device)
    on_cpu = len(packed.bodies) if large is None else 1
    state.poses = wp.zeros(on_cpu, dtype=structs.Pose, device=device)
    state.rates = wp.zeros(on_cpu, dtype=wp.vec3d, device=device)
    state.tensioners = wp.array(packed.oil, dtype=structs.TensionerState, device=device, copy=True)
    state.pushes = wp.zeros(len(packed.oil), dtype=structs.Push, device=device)
    state.meters = wp.zeros(len(packed.oil), dtype=sum_structs.TensionerFlows, device=device)
    state.progress = wp.zeros(packed.variants, dtype=structs.Progress, device=device)
    return state


NOTES = ("chain_notes", "strand_notes", "sprocket_notes", "mount_notes")
SUMS = ("chain", "strand", "sprocket", "mount", "arm", "tensioner", "contact", "slip", "tension_counts", *NOTES)
"""The fields of `kernels.sum_structs.Sums`."""


def empty_sums(packed: Packed, device: str) -> sum_structs.Sums:
    """Sums to which nothing has been added: minima at +infinity, maxima at -infinity."""
    sums = sum_structs.Sums()
    sums.tension_counts = wp.zeros(_histogram_values(packed), dtype=wp.int32, device=device)
    for name, struct, count in _sums_of(packed):
        array: wp.array = wp.zeros(count, dtype=struct, device=device)
        least, extremes = struct(), False
        for field in struct.numpy_dtype()["names"]:
            if field.endswith("_min") or (field.endswith("_max") and (name, field) != ("contact", "force_max")):
                setattr(least, field, np.inf if field.endswith("_min") else -np.inf)
                extremes = True
        if extremes and count:
            array.fill_(least)  # where they are: half a gigabyte of 67,584 variants does not go through the host
        setattr(sums, name, array)
    return sums


def sums_bytes(packed: Packed) -> int:
    """Bytes that an ensemble's sums and statistics take: about a kilobyte a strand, 136 a sprocket and batch."""
    held = sum(count * struct.numpy_dtype()["itemsize"] for _, struct, count in _sums_of(packed))
    return int(held) + 4 * _histogram_values(packed)


def _histogram_values(packed: Packed) -> int:
    """Bins of all strands, and of each variant's links on none."""
    return (int(packed.drives["sprockets"].sum()) + packed.variants) * int(BINS)


def _sums_of(packed: Packed) -> tuple[tuple[str, Any, int], ...]:
    """Name, struct and number of an ensemble's sums."""
    notes = int(batches.NOTES)
    return (
        ("chain", sum_structs.ChainSums, packed.variants),
        ("strand", sum_structs.StrandSums, len(packed.sprockets)),
        ("sprocket", sum_structs.SprocketSums, len(packed.sprockets)),
        ("mount", sum_structs.MountSums, len(packed.sprockets)),
        ("arm", sum_structs.ArmSums, len(packed.arms)),
        ("tensioner", sum_structs.TensionerSums, len(packed.tensioners)),
        ("contact", sum_structs.ContactSums, len(packed.sprockets) + len(packed.guides)),
        ("slip", sum_structs.SlipSums, len(packed.sprockets)),
        ("chain_notes", sum_structs.ChainNote, packed.variants * notes),
        ("strand_notes", sum_structs.StrandNote, len(packed.sprockets) * notes),
        ("sprocket_notes", sum_structs.SprocketSums, len(packed.sprockets) * notes),
        ("mount_notes", sum_structs.MountSums, len(packed.sprockets) * notes),
    )


OF_CONTACTS = dict.fromkeys(("impacts", "contacts", "missed"), wp.int32) | dict.fromkeys(
    ("dissipated", "friction", "impulse", "force_max"), wp.float64
)
"""What block kernels sum up contact by contact, of `kernels.sum_structs.Tallies`, and its type."""


def empty_tallies(packed: Packed, device: str) -> sum_structs.Tallies:
    """Tallies to which nothing has been added, for the block kernels."""
    links, sprockets = packed.drives["rollers"].astype(np.int64), packed.drives["sprockets"].astype(np.int64)
    tallies = sum_structs.Tallies()
    tallies.link = wp.zeros(int((links * (sprockets + 1)).sum()), dtype=sum_structs.LinkTally, device=device)
    for name, kind in OF_CONTACTS.items():
        setattr(tallies, name, wp.zeros(len(packed.seat), dtype=kind, device=device))
    tallies.roller = wp.zeros(int(links.sum()), dtype=sum_structs.RollerTally, device=device)
    tallies.body = wp.zeros(len(packed.bodies), dtype=sum_structs.RollerTally, device=device)
    return tallies
