"""A simulated second in one tree beside another's, each at its own step, and what the steps change."""

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import ROOT, Line, case, case_option

from benches.drives import drive_by_name
from benches.guard import tree_checkout, tree_rates
from warpchain import Record, simulate
from warpchain.assembly.timestep import automatic_step, step_limit
from warpchain.drive.paths import changed_part

EXAMPLES = ("industrial", "engine", "motorcycle", "car", "marine")
SHORT = {"industrial": 0.4, "marine": 0.6}
"""Simulated seconds of the runs that are held against finer steps, where examples take longer."""
CHANGES = ("tension_mean", "tension_q999", "tension_max", "losses")


@case(
    case_option("a", metavar="A", help="a commit, or the folder of a tree"),
    case_option("b", metavar="B", nargs="?", default=str(ROOT), help="what to hold against it (default this tree)"),
    case_option("--device", default="cpu", help="cpu (one core, CPU time; default) or such as cuda:0"),
    case_option("--drives", nargs="+", metavar="NAME", default=list(EXAMPLES), help="examples"),
    case_option("--variants", type=int, default=1, help="how many at once"),
    case_option("--precision", default="float64", help="float64 (default) or float32"),
    case_option("--finer", type=int, default=8, help="the part of each step that results are held against; 0: none"),
)
def steps(asked: argparse.Namespace) -> Iterator[Line]:
    """Simulated seconds a second of examples in two trees, at the step of the file of each, and at "auto".

    python scripts/bench.py steps b7c6549
    python scripts/bench.py steps ../before --device cuda:0 --variants 1056 --finer 0

    The changes are those of mean, 99.9 % quantile and largest tension and of all losses from an eighth of the step;
    what is chaotic scatters by some percent at any step.
    """
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        trees = [stack.enter_context(tree_checkout(Path(name), side, getattr(asked, side))) for side in ("a", "b")]
        yield ("drive, step", "tree", "step [us]", *(f"{change} [%]" for change in CHANGES), "s a s", "B/A")
        for drive in asked.drives:
            duration = {"run.duration": SHORT[drive]} if drive in SHORT else {}
            for which, values in (("file", {}), ("auto", {"run.step": "auto"})):
                speeds = []
                for side, tree in zip("AB", trees, strict=True):
                    file = tree / "warpchain" / "drive" / "examples" / f"{drive}.toml"
                    found = tree_rates(
                        tree,
                        {
                            "drives": {drive: (str(file), values | duration)},
                            "precisions": [asked.precision],
                            "variants": [asked.variants],
                            "device": asked.device,
                            "steps": 40_000 if asked.device == "cpu" else 2000,
                            "after": 0,
                            "repeats": 2,
                            "assemble": 0,
                            "finer": asked.finer,
                        },
                    )
                    step = found[f"{drive}, step"]
                    rate = found[f"{drive}, {asked.precision}, {asked.variants}, metrics"]
                    speeds.append(rate * step)
                    changes = [f"{100.0 * found.get(f'{drive}, {of}', float('nan')):+.2f}" for of in CHANGES]
                    ratio = f"{speeds[-1] / speeds[0]:.2f}"
                    yield (f"{drive}, {which}", side, f"{1e6 * step:.3g}", *changes, f"{speeds[-1]:.4g}", ratio)


FINE, SHARES = 0.15, (0.3, 0.6, 0.8, 0.95)
"""Of the limit of stability: the step that results are held against, and those that are held against it."""


@case(
    case_option("--drives", nargs="+", metavar="NAME", default=list(EXAMPLES), help="examples"),
    case_option("--builds", type=int, default=4, help="of each drive"),
)
def shares(asked: argparse.Namespace) -> Iterator[Line]:
    """Changes of examples by steps up to the limit of stability, from a step of 0.15 of it.

    python scripts/bench.py shares

    Means are between builds (`replicate_by = "build"`), the residual is the largest.
    """
    names = {"tension_mean": "mean", "tension_q999": "99.9 %", "friction_power": "friction", "tension_max": "largest"}
    yield ("drive", "of the limit", *(f"{name} [%]" for name in names.values()), "residual")
    for name in asked.drives:
        drive, known = drive_by_name(name), dict[str, float]()
        for share in (FINE, *SHARES):
            run = simulate(drive, duration=SHORT.get(name), step=share * step_limit(drive), record=Record("none"),
                           replicates=asked.builds, replicate_by="build")  # fmt: skip
            means = {of: np.mean(run.metrics[of].to_pylist()) for of in names}
            known = known or means
            changes = [f"{100.0 * (means[of] / known[of] - 1.0):+.2f}" for of in names]
            residual = np.abs(run.metrics["energy_residual_relative"].to_pylist()).max()
            if share > FINE:
                yield (name, f"{share:g}", *changes, f"{residual:.1e}")


WINDOWS = {
    "industrial": (0.4, 0.8), "conveyor": (0.3, 0.6), "engine": (0.1, 0.3), "car": (0.1, 0.2), "motorcycle": (0.1, 0.2),
    "marine": (0.5, 1.0), "marine_lever": (0.3, 0.6), "swing_idler": (0.3, 0.6), "derailleur": (0.3, 0.6),
    "motorcycle_drivetrain": (0.1, 0.2), "v6": (0.05, 0.12), "balance_shafts": (0.05, 0.12),
    "silent_timing": (0.1, 0.2),
}  # fmt: skip
"""Windows of examples [s] in which single contacts are held against shorter steps."""
OF_CONTACTS = {"force_max": "largest force", "dissipated": "dissipated", "impacts": "impacts"}


def metric_changes(coarse: list[dict[str, Any]], fine: list[dict[str, Any]], metric: str) -> tuple[float, float]:
    """Change of a metric's mean over copies, and its scatter over them at the fine step, over the mean [%]."""
    a, b = (np.array([float(row[metric]) for row in rows]) for rows in (coarse, fine))
    scatter = 100.0 * b.std(ddof=1) / abs(b.mean()) if len(b) > 1 else 0.0
    return 100.0 * (a.mean() / b.mean() - 1.0), scatter


@case(
    case_option("--drives", nargs="+", metavar="NAME", choices=WINDOWS, default=list(WINDOWS), help="examples"),
    case_option("--copies", type=int, default=4, help="1e-9 pitches apart"),
    case_option("--finer", type=int, default=8, help="the part of the automatic step that it is held against"),
)
def contacts(asked: argparse.Namespace) -> Iterator[Line]:
    """Single contacts of examples at the automatic step, held against an eighth of it.

    python scripts/bench.py contacts

    Of the partners, sprockets and guides, the one whose metric changes most stands there; in brackets what copies
    scatter by. Partners that take less than a hundredth of the dissipated energy, or of the impacts, are left out.
    """
    warnings.simplefilter("ignore")
    yield ("drive", *(f"{change} [%]" for change in CHANGES), *(f"{words} [%]" for words in OF_CONTACTS.values()))
    for name in asked.drives:
        begin, end = WINDOWS[name]
        drive = changed_part(drive_by_name(name), {"run.duration": end})
        coarse, fine = (
            simulate(drive, step=automatic_step(drive) / part, window=(begin, end), replicates=asked.copies,
                     replicate_by="perturbation", device="cpu", record=Record("none")).metrics.to_pylist()
            for part in (1, asked.finer)
        )  # fmt: skip
        for rows in (coarse, fine):
            for row in rows:
                row["losses"] = sum(
                    v for k, v in row.items() if k.endswith((".dissipated", ".friction", "_loss")) and v
                )
        found = []
        for change in CHANGES:
            of_chains = [f"{chain.name}.{change}" for chain in drive.chains if change != "losses"] or [change]
            found.append(f"{max((metric_changes(coarse, fine, key)[0] for key in of_chains), key=abs):+.1f}")
        for metric in OF_CONTACTS:
            partners = [key for key in fine[0] if key.endswith(f".{metric}") and not key.startswith("links.")]
            least = 0.01 * sum(float(fine[0][key] or 0.0) for key in partners)
            counted = [key for key in partners if float(fine[0][key] or 0.0) > least]
            changes = {key: metric_changes(coarse, fine, key) for key in counted}
            key = max(changes, key=lambda of: abs(changes[of][0]))
            found.append(f"{changes[key][0]:+.1f} ({changes[key][1]:.1f}), {key.rpartition('.')[0]}")
        yield (name, *found)
