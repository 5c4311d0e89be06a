"""The same work by hand in plain C and in CUDA C++, compiled on the spot."""

import fcntl
import math
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import SCRIPTS

from benches.probe import endless_schedule, packed_copies
from warpchain import Drive
from warpchain.engine.packed_ensemble import PackedEnsemble

LAW = "form stiffness exponent damping speed_floor lag yielding answer ahead"
FRICTION = "spring damper mu_dynamic mu_static stribeck_speed"
BODY = "prescribed sign inverse_inertia speed ramp_time start_angle load load_ramp_time"
PLACED = "center angle speed angular"
TEETH = """
    teeth pitch_radius near_square far_square half_pitch_tangent clearance cos_half_seat sin_half_seat tip_reach
"""
GUIDE = """
    start direction length end_radius roller_radius deepest_entry body pieces first_piece low high
"""
PIECE = "start direction curvature"
ARM = "stiffness free_angle damping low high stop_stiffness stop_damping mass_moment gravity"
TENSIONER = """
    body point home direction stiffness preload damping hydraulic area volume leak drag supply ambient floor
    oil_share air_share
"""
VALVE = "hole_area preload compliance lift_max seat_width seat_growth discharge"
BEHIND = "density laminar_limit bottom stop_stiffness stop_damping"
"""Fields of the engine's structs that those of `chain_reference.h` have, in their order."""
REAL = {"float64": "double", "float32": "float"}


def struct_numbers(row: Any, names: str) -> list[float]:
    """Numbers of a struct's fields, those of vectors one by one."""
    return [float(value) for name in names.split() for value in np.ravel(row[name])]


def motion_harmonics(packed: PackedEnsemble, motion: Any) -> tuple[int, list[float]]:
    """Number of a motion's harmonics, and their orders, amplitudes and phases with room for eight."""
    rows, found = motion["drive_harmonics"] if motion["prescribed"] else motion["load_harmonics"], np.zeros((8, 3))
    found[: rows["count"]] = packed.harmonics[rows["first"] : rows["first"] + rows["count"]]
    return rows["count"], [*found.ravel()]


def friction_numbers(partner: Any, names: str, friction: Any) -> list[float]:
    """Numbers of a sprocket or a guide, of its contact law and of its friction."""
    law = struct_numbers(partner["law"], LAW)
    return [*struct_numbers(partner, names), *law, friction["inertia"] > 0.0, *struct_numbers(friction, FRICTION)]


def unknown_parts(packed: PackedEnsemble) -> list[str]:
    """Parts of variant 0 that the programs do not know."""
    drive = packed.drives[0]
    found = {
        "stages": drive["integrator"] != 0,
        "shafts": drive["tied"] != 0,
        "hubs": drive["hubs"] != 0,
        "mounts": packed.mounts["active"].any() or packed.mounts["moves"].any(),
        "links that differ": packed.has_varied_links.any() or np.ptp(packed.lengths[: drive["rollers"]]) > 0.0,
        "tables": packed.motions["drive_table"]["cells"].any() or packed.motions["load_table"]["cells"].any(),
        "curved flanks": packed.sprockets["flank_curvature"].any(),
        "ratchets": packed.tensioners["ratchet_pitch"].any(),
    }
    return [name for name, there in found.items() if there]


def part_counts(packed: PackedEnsemble) -> dict[str, int]:
    """Numbers of variant 0's parts."""
    drive = packed.drives[0]
    return {
        "rollers": int(drive["rollers"]),
        "sprockets": int(drive["sprockets"]),
        "guides": int(drive["guides"]),
        "pieces": len(packed.pieces) if packed.guides["pieces"].any() else 0,
        "arms": int(drive["bodies"] - drive["sprockets"]),
        "tensioners": int(drive["tensioners"]),
    }


def variant_layout(packed: PackedEnsemble) -> bytes:
    """Variant 0 in the layout that the programs read.

    Raises:
        SystemExit: what they do not know, in one line.
    """
    if unknown := unknown_parts(packed):
        raise SystemExit(f"the C program takes no drive with {', '.join(unknown)}")
    drive, chain = packed.drives[0], packed.chains[0]
    n, sprockets, guides, pieces, arms, tensioners = part_counts(packed).values()
    bodies = sprockets + arms
    values: list[float] = [n, sprockets, guides, pieces, arms, tensioners]
    values += [drive["step"], packed.lengths[0], *struct_numbers(chain, "stiffness damping mass gravity")]
    values += [
        chain["joint"]["inertia"] > 0.0,
        *struct_numbers(chain, "pin_radius joint_arm"),
        *struct_numbers(chain["joint"], FRICTION),
    ]
    for motion, body in zip(packed.motions[:bodies], packed.bodies, strict=False):
        count, harmonics = motion_harmonics(packed, motion)
        values += [*struct_numbers(motion, BODY), count, *harmonics, *struct_numbers(body, PLACED)]
    for partner, friction in zip(packed.sprockets[:sprockets], packed.tooth_friction, strict=False):
        values += friction_numbers(partner, TEETH, friction)
    for partner, friction in zip(packed.guides[:guides], packed.guide_friction, strict=False):
        values += friction_numbers(partner, GUIDE, friction)
    for piece in packed.pieces[:pieces]:
        values += struct_numbers(piece, PIECE)
    for arm in packed.arms[:arms]:
        values += struct_numbers(arm, ARM)
    for tensioner, oil in zip(packed.tensioners[:tensioners], packed.oil, strict=False):
        values += [
            *struct_numbers(tensioner, TENSIONER),
            *struct_numbers(tensioner["check"], VALVE),
            *struct_numbers(tensioner, BEHIND),
        ]
        values += struct_numbers(oil, "content root")
    values += [*packed.rollers[: 4 * n], *packed.seat[: (sprockets + guides) * n]]
    return np.array(values, dtype=np.float64).tobytes()


def packed_variant(drive: Drive) -> PackedEnsemble:
    """One variant of a drive, as the programs take it."""
    return packed_copies(drive, 1, "float64", endless_schedule(drive, False))


def run_program(program: Path, drive: Drive, *words: object) -> tuple[float, np.ndarray]:
    """A program's seconds for a drive, and the final x, y, vx, vy rows."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "in").write_bytes(variant_layout(packed_variant(drive)))
        command = [str(program), f"{name}/in", f"{name}/out", *map(str, words)]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return float(said), np.fromfile(f"{name}/out")


def compiled_program(folder: Path, compiler: str, *words: str) -> Path | None:
    """A program that a compiler makes in a folder, if it is not there yet; None without the compiler."""
    if shutil.which(compiler) is None:
        return None
    program = folder / "".join([compiler, *words])
    with open(f"{program}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # as several processes may want it
        if not program.exists():
            subprocess.run([compiler, "-O3", "-o", str(program), *words], cwd=SCRIPTS, check=True)
    return program


def c_program(folder: Path, *flags: str) -> Path | None:
    """The C program in a folder."""
    return compiled_program(folder, "cc", "-march=native", *flags, "chain_reference.c", "-lm")


def cuda_constants(packed: PackedEnsemble, precision: str) -> dict[str, object]:
    """Numbers that the CUDA program is compiled for."""
    joint, contacts = packed.chains[0]["joint"], (packed.tooth_friction, packed.guide_friction)
    rubs = joint["inertia"] > 0.0 or any(of["inertia"].any() for of in contacts)
    return {"real": REAL[precision], **part_counts(packed), "rubs": int(rubs)}


def cuda_program(drive: Drive, precision: str, folder: Path) -> Path | None:
    """The CUDA program for a kind of drive in a folder."""
    flags = [f"-D{name.upper()}={value}" for name, value in cuda_constants(packed_variant(drive), precision).items()]
    return compiled_program(folder, "nvcc", "-arch=native", *flags, "chain_reference.cu")


def cuda_seconds(drive: Drive, precision: str, steps: int, variants: int, folder: Path) -> float:
    """Seconds of the CUDA program; NaN without nvcc."""
    program = cuda_program(drive, precision, folder)
    return run_program(program, drive, steps, variants)[0] if program else math.nan
