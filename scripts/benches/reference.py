"""The same work by hand in plain C and in CUDA C++, compiled on the spot."""

import math
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from common.cases import SCRIPTS

from benches.probe import packed_of, schedule
from warpchain import Drive
from warpchain.engine.packed import Packed


def reference_input(packed: Packed) -> bytes:
    """Variant 0 in the layout that the programs read."""
    drive, chain = packed.drives[0], packed.chains[0]
    n, sprockets, guides = int(drive["rollers"]), int(drive["sprockets"]), int(drive["guides"])
    head = [n, sprockets, guides, drive["step"], packed.lengths[0], chain["stiffness"], chain["damping"], chain["mass"]]
    values = [*head, *chain["gravity"], 0.0, 0.0]
    law = ("stiffness", "exponent", "damping", "speed_floor", "most_damping")
    of_teeth = ("half_pitch_tangent", "clearance", "cos_half_seat", "sin_half_seat", "tip_reach")
    of_motion = ("prescribed", "sign", "inverse_inertia", "speed", "ramp_time", "start_angle")
    for s in range(sprockets):
        teeth, motion, body = packed.sprockets[s], packed.motions[s], packed.bodies[s]
        values += [*body["center"], teeth["pitch_radius"], teeth["near_square"], teeth["far_square"]]
        values += [*(teeth[name] for name in of_teeth), *(teeth["law"][name] for name in law)]
        values += [*(motion[name] for name in of_motion), *motion["load"], motion["load_ramp_time"]]
        rows = motion["drive_harmonics"] if motion["prescribed"] else motion["load_harmonics"]
        values += [rows["count"], teeth["teeth"]]
        harmonics = np.zeros((8, 3))
        harmonics[: rows["count"]] = packed.harmonics[rows["first"] : rows["first"] + rows["count"]]
        values += [*harmonics.ravel(), body["angle"], body["speed"]]
    for g in range(guides):
        bar = packed.guides[g]
        values += [*bar["start"], *bar["direction"], bar["length"], bar["end_radius"], bar["roller_radius"]]
        values += [bar["law"][name] for name in law]
    values += [*packed.rollers[: 4 * n], *packed.seat[: sprockets * n]]
    return np.array(values, dtype=np.float64).tobytes()


def run(program: Path, drive: Drive, *words: object) -> tuple[str, np.ndarray]:
    """A program's lines for a drive, and the final x, y, vx, vy rows."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "in").write_bytes(reference_input(packed_of(drive, 1, "float64", schedule(drive, False))))
        command = [str(program), f"{name}/in", f"{name}/out", *map(str, words)]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return said, np.fromfile(f"{name}/out")


def compiled(program: Path, *command: str) -> Path | None:
    """A program that a compiler makes, if it is not there yet; None without the compiler."""
    if shutil.which(command[0]) is None:
        return None
    if not program.exists():
        subprocess.run([*command, "-o", str(program)], check=True)
    return program


def c_program(folder: Path, *flags: str) -> Path | None:
    """The C program in a folder."""
    source = str(SCRIPTS / "chain_reference.c")
    return compiled(folder / "-".join(["c", *flags]), "cc", "-O3", "-march=native", *flags, source, "-lm")


def cuda_program(folder: Path) -> Path | None:
    """The CUDA program in a folder."""
    return compiled(folder / "cuda", "nvcc", "-O3", "-arch=native", str(SCRIPTS / "chain_reference.cu"))


def cuda_seconds(drive: Drive, precision: str, steps: int, variants: int, folder: Path) -> float:
    """Seconds of the CUDA program; NaN without nvcc."""
    program = cuda_program(folder)
    if program is None:
        return math.nan
    words = [line.split() for line in run(program, drive, steps, variants)[0].splitlines()]
    return {"float64" if size == "8" else "float32": float(seconds) for size, _, seconds in words}[precision]
