"""Energy residual and tension at float32 beside float64: 64 copies of a drive, unlike by 0.1 % in links' stiffness.

    python scripts/float32_accuracy.py [NAME ...] --device cuda:0

Drives are the two equal sprockets of `bench_cpu.py`, the same by rk4, and examples by name. Run it in two trees to
compare them (it needs nothing but the package and `bench_cpu.py`).
"""

import argparse

import numpy as np
from bench_cpu import bench_drives

from warpchain import Drive, Record, load_drive, simulate
from warpchain.drive.examples import drive_path

SECONDS = {"two": 0.4, "rk4": 0.2, "marine": 0.6, "engine": 0.1, "car": 0.03, "industrial": 0.6, "motorcycle": 0.2}
"""Simulated time [s]; the metrics are of the second half."""

COPIES = 64
COLUMNS = ("energy_residual_relative", "tension_mean", "tension_std", "tension_max")


def base(name: str) -> Drive:
    """A drive by name; "rk4" is "two" by that integrator."""
    if name == "rk4":
        return base("two").with_values({"run.integrator": "rk4"})
    return next(iter(bench_drives().values())) if name == "two" else load_drive(drive_path(name))


def copies(drive: Drive) -> list[Drive]:
    """Copies whose stiffness differs, by the same numbers whenever it is called."""
    factors = 1.0 + 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, COPIES)
    return [drive.with_values({"chain.stiffness": drive.chain.stiffness * factor}) for factor in factors]


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("names", metavar="NAME", nargs="*", default=["two", "marine", "engine"])
    made.add_argument("--device", default="cuda:0")
    made.add_argument("--precision", choices=("float32", "float64"), nargs="+", default=["float32", "float64"])
    return made


def main() -> None:
    """Prints a line for each drive and precision."""
    words = parser().parse_args()
    for name in words.names:
        drives = copies(base(name))
        for precision in words.precision:
            none = Record(variants="none")
            run = simulate(drives, device=words.device, precision=precision, duration=SECONDS[name], record=none)
            metrics = run.metrics
            column = {key: np.array(metrics[key].to_pylist(), dtype=float) for key in COLUMNS}
            residual = np.abs(column.pop("energy_residual_relative"))
            means = "  ".join(f"{key} {values.mean():.6g} N" for key, values in column.items())
            print(f"{name:10s} {precision}  residual {residual.mean():.3g}, largest {residual.max():.3g}  {means}")


if __name__ == "__main__":
    main()
