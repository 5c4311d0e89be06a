"""The command line: `warpchain check | run | view | plot | export`.

Exit status 0: done. 1: a variant diverged, or the run was interrupted. 2: a mistake of the user's or a refusal of the
machine's, told in one line each.
"""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from warpchain.errors import WarpchainError

DONE, UNFINISHED, WRONG = 0, 1, 2

EPILOG = """examples:
  warpchain check marine
  warpchain run marine -o marine.mcap
  warpchain run my_drive.toml -o out.mcap --set sprockets.camshaft.load.torque=8e3 --duration 0.5
  warpchain view marine.mcap
  warpchain plot marine.mcap -o plots
"""


class _Parser(argparse.ArgumentParser):
    """A parser that tells a mistake in one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG, f"warpchain: error: {message}; see {self.prog} --help\n")


def _float(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is not a number") from None


def _bytes(word: str) -> int:
    """A memory budget in GiB as a number of bytes."""
    gib = _float(word)
    if not (math.isfinite(gib) and gib > 0.0):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a finite number above 0 (GiB)")
    return int(gib * 2**30)


def _add(commands: Any, name: str, run: Callable[[argparse.Namespace], int], text: str, example: str) -> Any:
    parser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


def parser() -> argparse.ArgumentParser:
    """The command line's parser."""
    top = _Parser(
        prog="warpchain",
        description="Dynamics of roller-chain drives, many variants at once.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="store_true", help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND")
    drive_help = "drive file (TOML), or the name of an example drive such as marine"

    check = _add(
        commands, "check", _check, "print what a drive amounts to, without running it", "warpchain check marine"
    )
    check.add_argument("drive", metavar="DRIVE", help=drive_help)
    check.add_argument("--set", metavar="PATH=VALUE", action="append", default=[], help="change a value of the drive")
    check.add_argument("--json", action="store_true", help="as JSON, in SI units")

    run = _add(
        commands,
        "run",
        _run,
        "simulate a drive and write an archive",
        "warpchain run marine -o marine.mcap --set run.duration=0.5 --rate 2000",
    )
    run.add_argument("drive", metavar="DRIVE", help=drive_help)
    run.add_argument("-o", "--output", metavar="OUT.mcap", type=Path, required=True, help="the archive to write")
    run.add_argument("--set", metavar="PATH=VALUE", action="append", default=[], help="change a value of the drive")
    run.add_argument("--device", help='where to run: "cpu"')
    run.add_argument("--precision", default="float64", choices=["float64", "float32"], help="default float64")
    run.add_argument("--duration", type=_float, metavar="SECONDS", help="simulated time; default the drive's own")
    run.add_argument("--step", type=_float, metavar="SECONDS", help="time step; default the drive's own")
    run.add_argument("--rate", type=_float, metavar="HZ", help="samples a second; default the drive's own")
    run.add_argument("--memory", type=_bytes, metavar="GIB", default="2", help="memory budget in GiB (default 2)")
    run.add_argument("--overwrite", action="store_true", help="replace an archive of that name")
    run.add_argument("--quiet", action="store_true", help="no progress bar")

    view = _add(commands, "view", _view, "show an archive in Rerun", "warpchain view marine.mcap --save marine.rrd")
    view.add_argument("archive", metavar="OUT.mcap", type=Path)
    view.add_argument(
        "--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening the viewer"
    )
    view.add_argument("--variant", type=int, metavar="I", help="which variant; default the first recorded")

    plot = _add(commands, "plot", _plot, "draw an archive's figures", "warpchain plot marine.mcap -o plots")
    plot.add_argument("archive", metavar="OUT.mcap", type=Path)
    plot.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder for the figures")
    plot.add_argument("--variant", type=int, metavar="I", help="which variant; default the first recorded")

    export = _add(
        commands,
        "export",
        _export,
        "write an archive's trajectories as numpy arrays",
        "warpchain export marine.mcap -o marine.npz",
    )
    export.add_argument("archive", metavar="OUT.mcap", type=Path)
    export.add_argument("-o", "--output", metavar="OUT.npz", type=Path, required=True, help="file to write")
    export.add_argument("--variant", type=int, metavar="I", help="which variant; default the first recorded")
    return top


def _value(word: str) -> Any:
    """A value as TOML reads it; a word that is not TOML is a text."""
    import tomllib

    try:
        table = tomllib.loads(f"value = {word}")
    except tomllib.TOMLDecodeError:
        return word
    return table["value"] if len(table) == 1 else word


def _load(arguments: argparse.Namespace) -> Any:
    from warpchain.drive import load_drive
    from warpchain.examples import drive_path

    drive = load_drive(drive_path(arguments.drive))
    changes = {}
    for change in arguments.set:
        path, mark, value = change.partition("=")
        if not mark or not path.strip():
            raise WarpchainError(f"--set {change}: must be PATH=VALUE, such as run.duration=0.5")
        changes[path.strip()] = _value(value.strip())
    return drive.with_values(changes) if changes else drive


def _check(arguments: argparse.Namespace) -> int:
    from warpchain.check import derive, report

    values = derive(_load(arguments))
    if arguments.json:
        import json

        print(json.dumps(values, indent=2))
    else:
        print(report(values))
    return DONE


def _run(arguments: argparse.Namespace) -> int:
    from warpchain.record import Record
    from warpchain.simulation import simulate

    _start_warp()
    drive = _load(arguments)
    run = simulate(
        drive,
        device=arguments.device,
        precision=arguments.precision,
        duration=arguments.duration,
        step=arguments.step,
        record=Record(rate=arguments.rate),
        progress=not arguments.quiet,
        memory=arguments.memory,
        archive=arguments.output,
        overwrite=arguments.overwrite,
    )
    row = run.metrics.to_pylist()[0]
    for line in _summary(drive, row, run.info.wall_time):
        print(line)
    print(f"archive: {arguments.output}; look at it with: warpchain view {arguments.output}")
    if run.info.ended != "complete":
        print(f"interrupted: the archive holds what was recorded until then ({len(run[0].time)} frames)")
    return UNFINISHED if row["diverged"] or run.info.ended != "complete" else DONE


def _start_warp() -> None:
    """Starts Warp without its talk, such as that there is no GPU: the bar and the summary speak."""
    import os

    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _summary(drive: Any, row: dict[str, Any], seconds: float) -> list[str]:
    """What a run came to, in a few lines."""
    if row["diverged"]:
        return [
            f"diverged at {row['diverged_time']:.4g} s: take a smaller step (run.step) or a higher impact_speed_floor"
        ]
    if row.get("tension_mean") is None:
        return [f"{seconds:.1f} s; the window for metrics was not reached"]
    lines = [
        f"window {row['window_start']:g} to {row['window_end']:g} s; the run took {seconds:.1f} s",
        f"tension: mean {row['tension_mean']:.0f} N, from {row['tension_min']:.0f} to {row['tension_max']:.0f} N",
    ]
    for sprocket in drive.sprockets:
        name = sprocket.name
        lines.append(
            f"{name}: speed {row[f'{name}.speed_mean']:.5g} rad/s, moment {row[f'{name}.moment_mean']:.5g} N m, "
            f"largest contact force {row[f'{name}.force_max']:.0f} N, {row[f'{name}.impacts']} impacts"
        )
        if row.get(f"{name}.travel_max") is not None:
            lines.append(
                f"{name}: center up to {row[f'{name}.travel_max']:.4g} m from its place, mean mount force "
                f"{row[f'{name}.mount_force_mean']:.0f} N"
            )
    residual = row["energy_residual_relative"]
    lines.append(f"energy: in {row['input_work']:.5g} J, out {row['output_work']:.5g} J, residual {residual:+.1e}")
    if row.get("settle_residual") is not None and row["settle_residual"] > 1e-3:
        lines.append(f"settling stopped at a residual of {row['settle_residual']:.2g} of the largest link force")
    return lines


def _view(arguments: argparse.Namespace) -> int:
    from warpchain.playback import view

    view(arguments.archive, variant=arguments.variant, save=arguments.save)
    return DONE


def _plot(arguments: argparse.Namespace) -> int:
    from warpchain.plots import plot_figures

    for path in plot_figures(arguments.archive, arguments.output, variant=arguments.variant):
        print(path)
    return DONE


def _export(arguments: argparse.Namespace) -> int:
    from warpchain.export import export_npz

    print(export_npz(arguments.archive, arguments.output, variant=arguments.variant))
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit status."""
    top = parser()
    arguments = top.parse_args(argv)
    if arguments.version:
        from importlib.metadata import version

        print(f"warpchain {version('warpchain')}")
        return DONE
    if arguments.command is None:
        top.print_help()
        return WRONG
    warnings.showwarning = _warning
    try:
        return int(arguments.run(arguments))
    except WarpchainError as error:
        for line in str(error).splitlines():
            print(f"warpchain: error: {line}", file=sys.stderr)
        return WRONG
    except BrokenPipeError:
        sys.stderr.close()
        return UNFINISHED
    except KeyboardInterrupt:
        print("warpchain: interrupted", file=sys.stderr)
        return UNFINISHED


def _warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """A warning as one line."""
    print(f"warpchain: warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
