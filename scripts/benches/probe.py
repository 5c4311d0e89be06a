"""The speed of the time loop in one tree. `guard` runs this file by itself with the package of either tree.

So it takes only what either tree has, and imports nothing else of `scripts`.
"""

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import warp as wp

import warpchain
import warpchain.engine.simulation as simulation
from warpchain.assembly.timestep import resolve_step
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.gpu import GpuEngine
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule

FOREVER = 10**9


def endless_schedule(drive: Any, metrics: bool) -> Any:
    """A run without end, without frames; the window is either all of it or far away."""
    step = resolve_step(drive)
    known = vars(simulation)
    interval = known.get("longest_sample_interval") or known["longest_apart"]  # its name in older trees
    apart = int(interval(drive, step))  # as in a long window
    return Schedule(step, FOREVER, 0 if metrics else FOREVER - 1, FOREVER, 0, apart)


def packed_copies(drive: Any, variants: int, precision: str, when: Any) -> Any:
    """A drive packed so many times over, without assembling each."""
    packed: Any = pack([drive], [when]).at_precision(precision)
    pick = getattr(packed, "pick_variants", None) or packed.taken  # its name in older trees
    return pick([0] * variants)


def engine_of_device(packed: Any, device: str, cores: int) -> Any:
    """An engine on a GPU, or on some cores."""
    return CpuEngine(packed, cores) if device == "cpu" else GpuEngine(packed, device)


def launch_seconds(packed: Any, device: str, steps: int, after: int = 0, cores: int = 1) -> tuple[float, float]:
    """Seconds of `steps` steps, and of the 64 and `after` before them; of CPU time on one core.

    Raises:
        SystemExit: the run diverged.
    """
    clock = time.process_time if device == "cpu" and cores == 1 else time.perf_counter
    engine, taken = engine_of_device(packed, device, cores), []
    frames = engine.frame_buffer(1 if device == "cpu" else 0)
    for count in (64 + after, steps):
        begin = clock()
        for future in engine.advance(count, frames):
            future.result()
        taken.append(clock() - begin)
    if device != "cpu" and engine.progress()["diverged"].any():
        raise SystemExit(f"{len(packed.drives)} variants: the run diverged")
    engine.close()
    return taken[1], taken[0]


def roller_step_rate(
    drive: Any, steps: int, precision: str, metrics: bool, variants: int, device: str, cores: int = 1, after: int = 0
) -> float:
    """1e6 roller-steps a second, compilation and start apart; metrics are taken from step `after` on."""
    when = endless_schedule(drive, metrics)
    packed = packed_copies(drive, variants, precision, replace(when, window_start=after) if metrics else when)
    return variants * int(drive.chain.links) * steps / launch_seconds(packed, device, steps, after, cores)[0] / 1e6


def assembly_rate(drive: Any, count: int) -> float:
    """Drives that differ, assembled and packed in a second of CPU time."""
    sprocket = drive.sprockets[-1]
    x, y = sprocket.center
    place, mass = f"sprockets.{sprocket.name}.center", drive.chain.mass
    values = [{place: [x + 1e-7 * k, y], "chain.roller_mass": mass * (1.0 + 1e-5 * k)} for k in range(count)]
    drives = [drive.with_values(each) for each in values]
    whens = [Schedule(1e-6, 10, 0, 10, 0)] * count
    begin = time.process_time()
    pack(drives, whens)
    return count / (time.process_time() - begin)


def step_changes(drive: Any, finer: int) -> dict[str, float]:
    """The drive's step [s], and by how much results at it differ from those at a `finer`-th of it, if that is not 0."""
    step = float(resolve_step(drive))
    if not finer:
        return {"step": step}
    drives = [drive.with_values({"run.step": h}) for h in (step, step / finer)]
    run = warpchain.simulate(drives, device="cpu", record=warpchain.Record("none"))
    coarse, fine = run.metrics.to_pylist()
    lost = [
        sum(value for name, value in row.items() if name.endswith((".dissipated", ".friction", "_loss")) and value)
        for row in (coarse, fine)
    ]
    found = {name: coarse[name] / fine[name] - 1.0 for name in ("tension_mean", "tension_q999", "tension_max")}
    return {"step": step, **found, "losses": lost[0] / lost[1] - 1.0}


def rates_by_case(asked: dict[str, Any]) -> dict[str, float]:
    """Rates by case: 1e6 roller-steps a second, and drives assembled in a second.

    Args:
        asked: `drives` (title to file and values), `precisions`, `variants`, `device`, `steps` of a launch at float64
            with one variant on the CPU, of any on a GPU, `after`, `repeats`, `assemble`; `finer`, where steps are
            wanted, and results to be held against those of such a part of them.
    """
    found: dict[str, float] = {}
    device = asked["device"]
    for title, (file, values) in asked["drives"].items():
        drive = warpchain.load_drive(Path(file)).with_values(values)
        if "finer" in asked:
            found |= {f"{title}, {name}": value for name, value in step_changes(drive, asked["finer"]).items()}
        for precision in asked["precisions"]:
            for variants in asked["variants"]:
                for metrics in (False, True):
                    steps = max(1, asked["steps"] // variants) if device == "cpu" else asked["steps"]
                    name = f"{title}, {precision}, {variants}{', metrics' if metrics else ''}"
                    case = (drive, steps, precision, metrics, variants, device)
                    found[name] = max(roller_step_rate(*case, after=asked["after"]) for _ in range(asked["repeats"]))
        if asked["assemble"]:
            found[f"{title}, assembly of {asked['assemble']}"] = assembly_rate(drive, asked["assemble"])
    return found


def main() -> None:
    """Reads what is asked from standard input and prints what is found, after checking whose package this is."""
    asked = json.load(sys.stdin)
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    package = Path(str(warpchain.__file__)).resolve()
    if not package.is_relative_to(Path(asked["tree"]).resolve()):
        raise SystemExit(f"{package} is not of {asked['tree']}")
    print(json.dumps(rates_by_case(asked)))


if __name__ == "__main__":
    main()
