"""CPU benchmark: roller-steps a second and core, beside plain C doing the same work, compiled on the spot.

    python scripts/bench_cpu.py

Each case is timed in turns with the C reference, several rounds in one run, and the best but one of each is compared:
ratios are what counts, absolute times depend on the machine. On one core the CPU time is taken, so that what else runs
on the machine does not count. Without a C compiler the reference is left out, with a message.
"""

import argparse
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import warp as wp

from warpchain import Drive, load_drive, loads_drive
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.looks import longest_apart
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.results.schedule import Schedule

HERE = Path(__file__).resolve().parent
FOREVER = 10**9

TWO_SPROCKETS = """
[chain]
pitch = 0.1
links = 118
roller_mass = 3.0
stiffness = 2.0e8
damping = 2000.0
roller_radius = 0.03
[[sprockets]]
name = "driver"
teeth = 30
center = [0.0, 0.0]
wrap = "ccw"
prescribed = { speed = 12.0 }
[[sprockets]]
name = "driven"
teeth = 30
center = [4.4004, 0.0]
wrap = "ccw"
inertia = 50.0
load = { torque = 5000.0 }
[contact.sprocket]
seat_angle = 137.0
clearance = 1.0e-4
restitution = 0.8
impact_speed_floor = 0.05
stiffness = 5.0e8
[run]
duration = 1.0
step = 5.0e-6
sample_rate = 5000.0
"""


def schedule(drive: Drive, metrics: bool) -> Schedule:
    """A run without end, without frames; the window is either all of it or far away."""
    step = resolve_step(drive)
    looks = int(longest_apart(drive, step))  # as far apart as in a long window
    return Schedule(step, FOREVER, 0 if metrics else FOREVER - 1, FOREVER, 0, looks)


def reference_input(packed: Packed) -> bytes:
    """Variant 0 in the layout that chain_reference.c reads."""
    drive, chain = packed.drives[0], packed.chains[0]
    n, sprockets, guides = int(drive["rollers"]), int(drive["sprockets"]), int(drive["guides"])
    head = [n, sprockets, guides, drive["step"], packed.lengths[0], chain["stiffness"], chain["damping"], chain["mass"]]
    values = [*head, *chain["gravity"], 0.0, 0.0]
    law = ("stiffness", "exponent", "damping", "speed_floor", "most_damping")
    for s in range(sprockets):
        teeth, motion, body = packed.sprockets[s], packed.motions[s], packed.bodies[s]
        values += [*body["center"], teeth["pitch_radius"], teeth["near_square"], teeth["far_square"]]
        values += [teeth["half_pitch_tangent"], teeth["clearance"], teeth["cos_half_seat"], teeth["sin_half_seat"]]
        values += [teeth["tip_reach"], *(teeth["law"][name] for name in law)]
        values += [
            motion["prescribed"],
            motion["sign"],
            motion["inverse_inertia"],
            motion["speed"],
            motion["ramp_time"],
        ]
        values += [motion["start_angle"], *motion["load"], motion["load_ramp_time"]]
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


class Reference:
    """The C program, compiled in a folder of its own."""

    def __init__(self, folder: Path, compiler: str, *flags: str) -> None:
        self.folder = folder
        self.program = folder / "-".join(["chain_reference", *flags]).replace("--", "-")
        source = str(HERE / "chain_reference.c")
        command = [compiler, "-O3", "-march=native", *flags, "-o", str(self.program), source, "-lm"]
        subprocess.run(command, check=True)
        print("reference:", " ".join(Path(word).name for word in command))

    def run(self, packed: Packed, steps: int) -> tuple[float, np.ndarray]:
        """CPU time of the time loop [s], and the final x, y, vx, vy rows."""
        (self.folder / "in").write_bytes(reference_input(packed))
        command = [str(self.program), str(self.folder / "in"), str(self.folder / "out"), str(steps)]
        seconds = float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        return seconds, np.fromfile(self.folder / "out")


def engine_rate(drive: Drive, variants: int, workers: int, steps: int, metrics: bool, precision: str) -> float:
    """Roller-steps a second of the engine, compilation and start apart; with one worker, a second of CPU time."""
    clock = time.process_time if workers == 1 else time.perf_counter
    engine = CpuEngine(pack([drive] * variants, [schedule(drive, metrics)] * variants).at_precision(precision), workers)
    buffer = engine.frame_buffer(1)
    for future in engine.advance(64, buffer):
        future.result()
    begin = clock()
    for future in engine.advance(steps, buffer):
        future.result()
    seconds = clock() - begin
    engine.close()
    return variants * drive.chain.links * steps / seconds


def compare(
    name: str, drive: Drive, reference: Reference | None, quick: Reference | None, steps: int, rounds: int
) -> None:
    """Prints one drive's lines; `quick` is the reference without errno, which lets the compiler vectorize roots."""
    n = drive.chain.links
    packed = pack([drive], [schedule(drive, False)])
    cases = {
        "float64, 1 core": (1, 1, False, "float64"),
        "float64, 1 core, metrics": (1, 1, True, "float64"),
        "float32, 1 core": (1, 1, False, "float32"),
        "float64, 8 variants, 1 core": (8, 1, False, "float64"),
        "float64, 8 variants, 2 cores": (8, 2, False, "float64"),
    }
    found: dict[str, list[float]] = {name: [] for name in (*cases, "plain", "vectorized")}
    for _ in range(rounds):
        if reference and quick:
            found["plain"].append(n * steps / reference.run(packed, steps)[0])
            found["vectorized"].append(n * steps / quick.run(packed, steps)[0])
        for case, (variants, workers, metrics, precision) in cases.items():
            found[case].append(engine_rate(drive, variants, workers, steps, metrics, precision))
    best = {case: best_but_one(found[case]) for case in cases}
    plain, vectorized = (best_but_one(found[of]) for of in ("plain", "vectorized"))
    print(f"\n{name}: {n} rollers, {len(drive.sprockets)} sprockets, {len(drive.guides)} guide-bars, {steps} steps")
    if reference:
        print(f"  {'plain C, float64, 1 core':38s} {plain / 1e6:8.1f} million roller-steps/s")
        print(f"  {'the same with -fno-math-errno':38s} {vectorized / 1e6:8.1f} million roller-steps/s")
    for case, rate in best.items():
        note = f"   {rate / plain:5.2f}, {rate / vectorized:5.2f} of C" if reference and "2 cores" not in case else ""
        if "2 cores" in case:
            note = f"   {rate / best['float64, 8 variants, 1 core']:5.2f} of 1 core"
        print(f"  {'warpchain, ' + case:38s} {rate / 1e6:8.1f} million roller-steps/s{note}")
    if reference:
        check(drive, reference)


def best_but_one(rates: Sequence[float]) -> float:
    """The second of some rates, or the best of fewer than three, 0 of none: a clock that once jumps makes a best."""
    return sorted([0.0, *rates])[-2 if len(rates) > 2 else -1]


def check(drive: Drive, reference: Reference, steps: int = 2000) -> None:
    """Prints how far engine and reference are apart after the same steps: they do the same work."""
    packed = pack([drive], [schedule(drive, False)])
    engine = CpuEngine(packed, 1)
    for future in engine.advance(steps, engine.frame_buffer(1)):
        future.result()
    n = drive.chain.links
    apart = np.abs(engine.state.rollers.numpy()[: 4 * n] - reference.run(packed, steps)[1])
    engine.close()
    print(f"  largest difference in position after {steps} steps: {apart[: 2 * n].max():.1e} m")


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--steps", type=int, default=40_000, help="steps of each timed run (default 40000)")
    made.add_argument("--rounds", type=int, default=5, help="rounds, of which the best but one counts (default 5)")
    return made


SMOOTH = {
    "chain.joint": None,
    "contact.sprocket.friction": None,
    "contact.guide.friction": None,
    "contact.guide.rolling": False,
}
"""The values that take friction from a drive."""


def bench_drives() -> dict[str, Drive]:
    """The drives that speed is measured on, without friction."""
    marine = load_drive(drive_path("marine")).with_values(SMOOTH)
    return {"two equal 30-tooth sprockets": loads_drive(TWO_SPROCKETS), "marine drive": marine}


RUBBING = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = RUBBING | {"chain.joint.static_friction": 0.15, "chain.joint.stribeck_speed": 0.05}


def joints(drive: Drive, steps: int, rounds: int) -> None:
    """Prints what joint friction costs, timed in turns with the same drive without it."""
    kinds = {"without": drive, "joint friction": drive.with_values(RUBBING), "Stribeck": drive.with_values(STRIBECK)}
    for precision in ("float64", "float32"):
        found: dict[str, list[float]] = {name: [] for name in kinds}
        for _ in range(rounds):
            for name, kind in kinds.items():
                found[name].append(engine_rate(kind, 1, 1, steps, False, precision))
        best = {name: best_but_one(rates) for name, rates in found.items()}
        for name in ("joint friction", "Stribeck"):
            rate, note = best[name], f"{best[name] / best['without']:5.2f} of without"
            print(f"  {f'warpchain, {precision}, {name}':38s} {rate / 1e6:8.1f} million roller-steps/s   {note}")


def main() -> int:
    """Runs all cases."""
    arguments = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(Path(folder), compiler) if compiler else None
        quick = Reference(Path(folder), compiler, "-fno-math-errno") if compiler else None
        if reference is None:
            print("no C compiler (cc, gcc or clang) found: the reference is left out")
        for name, drive in bench_drives().items():
            compare(name, drive, reference, quick, arguments.steps, arguments.rounds)
            joints(drive, arguments.steps, arguments.rounds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
