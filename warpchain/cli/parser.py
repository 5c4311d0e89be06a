"""The command line's parser and its start: `warpchain new | check | draw | run | view | study | ...`.

Mistakes of the user and refusals of the machine are one line each.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from warpchain.cli import commands as do
from warpchain.cli.better_command import add_better_command
from warpchain.cli.commands import DONE, UNFINISHED, WRONG
from warpchain.cli.mcp_server import add_mcp_command
from warpchain.cli.search_commands import add_calibrate_command, add_optimize_command, add_risk_command
from warpchain.cli.shared_options import (
    CommandBody,
    add_command,
    add_shared_options,
    angular_speed_from_word,
    archive_path_from_word,
    bytes_from_gibibytes,
    bytes_from_mebibytes,
    length_from_word,
    load_plugins_of_arguments,
    message_with_options,
    number_from_word,
    number_or_auto_from_word,
    page_path_from_word,
    power_from_word,
    service_factor_from_word,
    time_from_word,
    whole_number_from_word,
)
from warpchain.cli.study_commands import add_play_command, add_report_commands, add_study_commands
from warpchain.errors import WarpchainError
from warpchain.files import refusal_reason
from warpchain.gc_tuning import rare_collections

HELP_EXAMPLES = """examples:
  warpchain check marine
  warpchain run marine -o marine.mcap
  warpchain run my_drive.toml -o out.mcap --set sprockets.camshaft.load.torque=8e3 --duration 0.5
  warpchain view marine.mcap
  warpchain plot marine.mcap -o plots
  warpchain report marine.mcap -o marine.html
"""


SHELLS = ("bash", "zsh", "fish")

STEP_OPTION: Any = {
    "type": number_or_auto_from_word,
    "metavar": "SECONDS",
    "help": 'time step, or "auto"; default the drive\'s own',
}
"""Option --step of `run` and `export`."""

JSON_HELP = "print JSON, in SI units (warpchain schema output; docs/scripts.md)"
"""Help of --json."""


class _OneLineParser(argparse.ArgumentParser):
    """Argument parser that prints a mistake in one line."""

    def error(self, message: str) -> NoReturn:
        """Ends the program with the parser's error in one line."""
        self.exit(WRONG, f"warpchain: error: {message}; see {self.prog} --help\n")


def _add_function_command(commands: Any, run: CommandBody, text: str, example: str) -> Any:
    """Adds a command named as its function begins; returns its parser."""
    return add_command(commands, run.__name__.partition("_")[0], run, text, example)


def _command_of_file(name: str) -> CommandBody:
    """Body of `warpchain NAME`: prints the lines of `NAME_lines` in `NAME_command.py`, imported only then."""

    def run(arguments: argparse.Namespace) -> int:
        """Prints the command's lines; returns exit status done."""
        lines = getattr(import_module(f"warpchain.cli.{name}_command"), f"{name}_lines")
        return do.print_lines(lines(arguments))

    return run


def _add_file_command(commands: Any, name: str, text: str, example: str) -> Any:
    """Adds a command with a file of its own; returns its parser."""
    return add_command(commands, name, _command_of_file(name), text, example)


def _add_new_command(commands: Any) -> None:
    """Adds `warpchain new` to the parser."""
    example = "warpchain new drive.toml --size 16B --teeth 19 57 --centers 0 0 1.0 0 --speed 300rpm --torque 900"
    parser = _add_file_command(commands, "new", "write a commented drive file from a size, teeth and centers", example)
    parser.add_argument("output", metavar="OUT.toml", type=Path, help="drive file to write")
    parser.add_argument("--size", required=True, metavar="SIZE", help="of the chain, such as 16B (warpchain chains)")
    text = "of each sprocket, in the order in which the chain visits them; the first drives, the last is braked"
    parser.add_argument("--teeth", required=True, type=whole_number_from_word, nargs="+", metavar="N", help=text)
    parser.add_argument(
        "--centers", required=True, type=number_from_word, nargs="+", metavar="X Y", help="of each sprocket [m]"
    )
    parser.add_argument(
        "--speed", type=angular_speed_from_word, metavar="SPEED", help="of the first [rad/s], or as 300rpm"
    )
    parser.add_argument("--torque", type=number_from_word, metavar="N_M", help="moment that brakes the last [N m]")
    text = "leave the last sprocket where it is, however the even number of links fits"
    parser.add_argument("--keep-centers", action="store_true", help=text)
    parser.add_argument("--overwrite", action="store_true", help="replace a file of that name")


def _add_select_command(commands: Any) -> None:
    """Adds `warpchain select` to the parser."""
    parser = _add_file_command(
        commands,
        "select",
        "list the sizes and strands that standards rate for a power, and write the drive file of one",
        "warpchain select --power 7.5kW --speed 300rpm --ratio 3 --service moderate -o drive.toml",
    )
    parser.add_argument("--power", required=True, type=power_from_word, metavar="POWER", help="[W], or as 7.5kW, 10hp")
    parser.add_argument(
        "--speed", required=True, type=angular_speed_from_word, metavar="SPEED", help="of the driver [rad/s], or 300rpm"
    )
    text = "speed of the driver over that of the driven (default 1)"
    parser.add_argument("--ratio", type=number_from_word, default=1.0, metavar="X", help=text)
    text = "distance of the centers [m], or as 800mm (default 40 pitches)"
    parser.add_argument("--centers", type=length_from_word, metavar="LENGTH", help=text)
    text = "factor on the power; or smooth, moderate or heavy, with ,hydraulic or ,engine where no motor drives"
    parser.add_argument("--service", type=service_factor_from_word, default=1.0, metavar="FACTOR", help=text)
    text = "of the smaller sprocket (default 19)"
    parser.add_argument("--teeth", type=whole_number_from_word, default=19, metavar="N", help=text)
    parser.add_argument("-o", "--output", metavar="OUT.toml", type=Path, help="write the drive file of one")
    text = "which one's, such as 16B-2 (default the first with one strand)"
    parser.add_argument("--size", metavar="SIZE", help=text)
    parser.add_argument("--overwrite", action="store_true", help="replace a file of that name")


def _add_check_command(commands: Any) -> None:
    """Adds `warpchain check` to the parser."""
    parser = _add_function_command(
        commands, do.check_command, "check a drive without running it", "warpchain check marine"
    )
    add_shared_options(parser, "drive", "--set")
    parser.add_argument("--json", action="store_true", help=JSON_HELP)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="also draw the drive there: .png or .svg")


def _add_draw_command(commands: Any) -> None:
    """Adds `warpchain draw` to the parser."""
    parser = _add_file_command(
        commands,
        "draw",
        "draw a drive before it runs, and print what check finds",
        "warpchain draw drive.toml -o drive.svg --watch",
    )
    add_shared_options(parser, "drive", "--set")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="the drawing: .png or .svg")
    parser.add_argument(
        "--watch", action="store_true", help="draw again whenever the drive file is saved, until Ctrl-C"
    )


def _add_explain_command(commands: Any) -> None:
    """Adds `warpchain explain` to the parser."""
    text = "say what a metric, a key of drive and study files, a limit, or a line of an error or of check means"
    parser = _add_file_command(commands, "explain", text, "warpchain explain tension_q999")
    parser.add_argument("text", metavar="TEXT", help="one name, or the line of an error or of check")


def _add_chains_command(commands: Any) -> None:
    """Adds `warpchain chains` to the parser."""
    _add_function_command(
        commands,
        do.chains_command,
        "list the chains that size = names: ISO 606, motorcycles, bush chains, silent chains",
        "warpchain chains",
    )


def _add_metrics_command(commands: Any) -> None:
    """Adds `warpchain metrics` to the parser."""
    text = "list the metrics that a run of a drive gives, with units and words"
    parser = _add_function_command(commands, do.metrics_command, text, "warpchain metrics car | grep tension")
    add_shared_options(parser, "drive", "--set")
    parser.add_argument("--json", action="store_true", help="as a JSON list of name, unit and title")


def _add_schema_command(commands: Any) -> None:
    """Adds `warpchain schema` to the parser."""
    text = "print the JSON schema of drive files or study files, for editors, or of the output of --json, for scripts"
    parser = _add_function_command(commands, do.schema_command, text, "warpchain schema drive > drive.schema.json")
    parser.add_argument("of", choices=["drive", "study", "output"], help="which one")


def _add_devices_command(commands: Any) -> None:
    """Adds `warpchain devices` to the parser."""
    text = "list the devices that runs can take"
    _add_function_command(commands, do.devices_command, text, "warpchain devices")


def _add_fit_command(commands: Any) -> None:
    """Adds `warpchain fit` to the parser."""
    parser = _add_file_command(
        commands,
        "fit",
        "move a sprocket or pick the links for a wanted strain, preload or sag, in the drive file",
        "warpchain fit drive.toml --sprocket tightener --along 1,0 --preload 5000",
    )
    add_shared_options(parser, "drive")
    parser.add_argument("--links", action="store_true", help="first pick the even number of links that fits best")
    parser.add_argument("--odd", action="store_true", help="with --links: an odd number will do, too")
    parser.add_argument("--chain", metavar="NAME", help="with --links: which chain's, where there are several")
    parser.add_argument("--sprocket", metavar="NAME", help="the sprocket to move")
    parser.add_argument("--along", metavar="DX,DY", help="the line it moves along, either way, as in --along=-1,0")
    parser.add_argument("--strain", type=number_from_word, metavar="X", help="wanted strain of the strands")
    parser.add_argument("--preload", type=number_from_word, metavar="N", help="wanted tension at assembly [N]")
    parser.add_argument("--sag", type=number_from_word, metavar="METRES", help="wanted sag of a strand at rest [m]")
    parser.add_argument("--strand", metavar="FROM->TO", help="which strand's sag; default the longest")
    parser.add_argument(
        "--angle", type=number_from_word, metavar="DEG", help="wanted angle of an arm at assembly [degrees]"
    )
    parser.add_argument("--arm", metavar="NAME", help="which arm's; default the only one")
    wrap = "wanted wrap of the sprocket [degrees]; with --links these are picked afterwards"
    parser.add_argument("--wrap", type=number_from_word, metavar="DEG", help=wrap)
    parser.add_argument("--around", metavar="NAME", help="which sprocket's wrap; default the one that moves")
    parser.add_argument("--guide", metavar="NAME", help="the guide to move across its strand")
    depth = "depth by which it presses that in, as drawn [m]; with --links these are picked afterwards"
    parser.add_argument("--indentation", type=number_from_word, metavar="METRES", help=depth)
    parser.add_argument("-o", "--output", metavar="OUT.toml", type=Path, help="write there; default DRIVE itself")


def _add_modes_command(commands: Any) -> None:
    """Adds `warpchain modes` to the parser."""
    parser = _add_file_command(
        commands,
        "modes",
        "list a drive's natural frequencies, damping ratios and mode shapes",
        "warpchain modes marine --speed 0 15 -o modes.html",
    )
    add_shared_options(parser, "drive")
    parser.add_argument(
        "--count", type=whole_number_from_word, default=20, metavar="N", help="modes to list (default 20)"
    )
    parser.add_argument(
        "--speed",
        type=angular_speed_from_word,
        nargs="+",
        default=[0.0],
        metavar="SPEED",
        help="driver's speed [rad/s], or as 3000rpm; two: from one to the other, as a Campbell diagram (default 0)",
    )
    parser.add_argument(
        "--points", type=whole_number_from_word, default=25, metavar="N", help="speeds of a diagram (default 25)"
    )
    phases = "of a tooth pitch that a diagram's frequencies are means of (default 1: as the drive stands)"
    parser.add_argument("--phases", type=whole_number_from_word, default=1, metavar="N", help=phases)
    valves = "check valves of hydraulic tensioners: shut (default), or open as at rest, for the faintest motion"
    parser.add_argument("--valve", choices=("shut", "open"), default="shut", help=valves)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="also write there: .html, .png, .svg, .rrd (Rerun) or .npz"
    )
    add_shared_options(parser, "--set")


def _add_tensioner_command(commands: Any) -> None:
    """Adds `warpchain tensioner` to the parser."""
    parser = _add_file_command(
        commands,
        "tensioner",
        "impose a sine on a tensioner's plunger as a test rig does; print and draw what it does",
        "warpchain tensioner drive.toml tensioner --amplitude 2e-4 --frequency 100 -o loop.png",
    )
    add_shared_options(parser, "drive")
    parser.add_argument("name", metavar="NAME", help="of the tensioner")
    parser.add_argument(
        "--amplitude", type=number_from_word, default=2e-4, metavar="M", help="of the sine [m] (default 2e-4)"
    )
    parser.add_argument(
        "--frequency", type=number_from_word, nargs="+", default=[100.0], metavar="HZ", help="one or more (default 100)"
    )
    parser.add_argument(
        "--cycles", type=whole_number_from_word, default=10, metavar="N", help="of the sine (default 10)"
    )
    parser.add_argument(
        "--extension",
        type=number_from_word,
        default=0.0,
        metavar="M",
        help="about which it swings [m] (default 0, as drawn)",
    )
    parser.add_argument(
        "--viscosity",
        type=number_from_word,
        nargs="+",
        default=[],
        metavar="M^2/S",
        help="kinematic; default the drive's own",
    )
    parser.add_argument("--sweep", choices=["frequency", "temperature"], help="ride many sines instead")
    parser.add_argument(
        "--range",
        type=number_from_word,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="with --sweep: from, to [Hz], [degrees C] (default 1 500, 20 140)",
    )
    parser.add_argument(
        "--points", type=whole_number_from_word, default=25, metavar="N", help="of a sweep (default 25)"
    )
    parser.add_argument(
        "--at", type=number_from_word, metavar="C", help="temperature of the drive's own viscosity (default 40)"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="also write there: .png, .svg, or .csv, .parquet"
    )
    add_shared_options(parser, "--set")


def _add_jump_command(commands: Any) -> None:
    """Adds `warpchain jump` to the parser."""
    text = "find the torque, or the wear, at which the chain jumps a tooth, forward and in reverse"
    parser = _add_file_command(commands, "jump", text, "warpchain jump industrial --by wear --direction forward")
    add_shared_options(parser, "drive")
    parser.add_argument("--by", choices=["torque", "wear"], default="torque", help="what grows (default torque)")
    on = "sprocket or shaft whose load grows, default the largest; with --by wear, the chain"
    parser.add_argument("--on", metavar="NAME", help=on)
    ways = ["forward", "reverse", "both"]
    parser.add_argument("--direction", choices=ways, default="both", help="the way that the drive runs (default both)")
    most = "largest [N m], [1] (default what breaks the chain; 0.1)"
    parser.add_argument("--most", type=number_from_word, metavar="X", help=most)
    parser.add_argument("--tolerance", type=number_from_word, default=0.02, metavar="X", help="relative (default 0.02)")
    parser.add_argument(
        "--values", type=whole_number_from_word, default=8, metavar="N", help="runs of a round (default 8)"
    )
    parser.add_argument(
        "--duration", type=number_from_word, metavar="SECONDS", help="of each run; default the drive's own"
    )
    parser.add_argument("--device", help='"cpu", "cuda", "cuda:1"; default what should finish first')
    parser.add_argument("--precision", default="float64", choices=["float64", "float32"], help="default float64")
    parser.add_argument("--json", action="store_true", help="as JSON, in SI units")
    add_shared_options(parser, "--set", "--workers", "--quiet")


def _add_run_command(commands: Any) -> None:
    """Adds `warpchain run` to the parser."""
    parser = _add_function_command(
        commands,
        do.run_command,
        "simulate a drive and write an archive",
        "warpchain run marine -o marine.mcap --set run.duration=0.5 --rate 2000",
    )
    add_shared_options(parser, "drive")
    text = "the archive to write; may be left out with --json"
    parser.add_argument("-o", "--output", metavar="OUT.mcap", type=archive_path_from_word, help=text)
    parser.add_argument("--json", action="store_true", help=JSON_HELP)
    add_shared_options(parser, "--set")
    parser.add_argument(
        "--device",
        help='where to run: "cpu", "cuda" (all GPUs), "cuda:1" (one); default what should finish first',
    )
    parser.add_argument("--precision", default="float64", choices=["float64", "float32"], help="default float64")
    parser.add_argument(
        "--duration", type=number_from_word, metavar="SECONDS", help="simulated time; default the drive's own"
    )
    parser.add_argument("--step", **STEP_OPTION)
    parser.add_argument(
        "--window",
        type=number_from_word,
        nargs=2,
        metavar=("START", "END"),
        help="times over which metrics are taken [s]; default the latter half",
    )
    parser.add_argument("--rate", type=number_from_word, metavar="HZ", help="samples a second; default the drive's own")
    parser.add_argument(
        "--channels",
        nargs="+",
        default=["default"],
        metavar="NAME",
        help="what to record (docs/archive.md); default: all but joint_friction_power and hub_force, on request",
    )
    parser.add_argument(
        "--memory", type=bytes_from_gibibytes, metavar="GIB", default="2", help="memory budget in GiB (default 2)"
    )
    parser.add_argument("--compression", default="zstd", choices=["zstd", "lz4", "none"], help="default zstd")
    parser.add_argument(
        "--values", default="run", choices=["run", "float32"], help="archived values; default the run's own"
    )
    parser.add_argument(
        "--exact-positions", action="store_true", help="with --values float32: positions also as float64"
    )
    parser.add_argument(
        "--split-size", type=bytes_from_mebibytes, metavar="MIB", help="begin another file at this size"
    )
    add_shared_options(parser, "--overwrite")
    parser.add_argument(
        "--limit",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change what the run is judged by, such as energy_residual=0.02 (docs/judged-runs.md)",
    )
    parser.add_argument("--strict", action="store_true", help="exit with status 3 if the run is suspect")
    add_shared_options(parser, "--quiet")


def _add_warm_command(commands: Any) -> None:
    """Adds `warpchain warm` to the parser."""
    text = "compile the kernels that runs need, so that the first one does not wait for them"
    parser = _add_file_command(commands, "warm", text, "warpchain warm")
    drives = "drive files or examples; default three whose kernels serve all drives of up to 231 links a chain on a CPU"
    parser.add_argument("drives", metavar="DRIVE", nargs="*", help=drives)
    parser.add_argument("--device", default="cpu", help='"cpu", "cuda", "cuda:1"; default cpu')
    parser.add_argument("--precision", default="float64", choices=["float64", "float32"], help="default float64")
    add_shared_options(parser, "--quiet")


def _add_view_command(commands: Any) -> None:
    """Adds `warpchain view` to the parser."""
    parser = _add_function_command(
        commands, do.view_command, "show an archive in Rerun", "warpchain view marine.mcap --save marine.rrd"
    )
    add_shared_options(parser, "archive")
    parser.add_argument(
        "--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening the viewer"
    )
    add_shared_options(parser, "--variant")
    parser.add_argument(
        "--compare",
        metavar="OTHER",
        nargs="+",
        default=[],
        help="variants to lay beside and over it: numbers, other archives, or ARCHIVE:NUMBER",
    )
    parser.add_argument("--frames", type=int, metavar="N", help="frames to draw at most, peaks kept (default 1000)")
    parser.add_argument("--tab", metavar="NAME", help="the tab to open first, such as spectrum")
    parser.add_argument("--web", action="store_true", help="serve the web viewer until Ctrl-C")
    add_shared_options(parser, "--scale")
    parser.add_argument("--bind", metavar="ADDRESS", default="127.0.0.1", help="where to listen (default 127.0.0.1)")


def _add_plot_command(commands: Any) -> None:
    """Adds `warpchain plot` to the parser."""
    parser = _add_function_command(
        commands, do.plot_command, "draw an archive's figures", "warpchain plot marine.mcap -o plots"
    )
    add_shared_options(parser, "archive")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder for the figures")
    add_shared_options(parser, "--variant")
    parser.add_argument("--format", nargs="+", default=["png"], choices=["png", "svg"], help="default png")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=[], help="figures to draw, such as order-spectrum")
    add_shared_options(parser, "--scale")
    parser.add_argument(
        "--roller", type=int, metavar="I", help="whose forces to draw; default that with the largest contact force"
    )
    parser.add_argument(
        "--sweep",
        nargs="*",
        metavar="OTHER.mcap",
        type=Path,
        help="draw Campbell diagrams instead, over all recorded variants of this archive and others",
    )


def _add_report_command(commands: Any) -> None:
    """Adds `warpchain report` to the parser."""
    parser = _add_function_command(
        commands,
        do.report_command,
        "write the engineering report of a recorded run as one HTML page",
        "warpchain report engine.mcap -o engine.html",
    )
    add_shared_options(parser, "archive")
    parser.add_argument(
        "-o", "--output", metavar="report.html", type=page_path_from_word, required=True, help="the page to write"
    )
    add_shared_options(parser, "--variant")
    parser.add_argument("--title", help="heading of the page")
    parser.add_argument(
        "--wear-coefficient",
        type=number_from_word,
        metavar="M2/N",
        help="of pins and bushes, volume lost over force times sliding distance (default 2e-16; docs/wear.md)",
    )
    parser.add_argument(
        "--bearing-area", type=number_from_word, metavar="M2", help="of a joint; default that of the size"
    )


def _add_export_command(commands: Any) -> None:
    """Adds `warpchain export` to the parser."""
    parser = _add_function_command(
        commands,
        do.export_command,
        "write for other programs: a drive as an FMU (.fmu); an archive's trajectory (.npz, .csv, .parquet, .h5, "
        ".mat), its loads on the housing (.unv, .mf4), or its metrics",
        "warpchain export marine.mcap -o marine.csv\n  warpchain export conveyor -o conveyor.fmu",
    )
    parser.add_argument("drive", metavar="SOURCE", help="archive (OUT.mcap); for .fmu a drive file, or an example")
    parser.add_argument(
        "-o", "--output", metavar="OUT.csv", type=Path, required=True, help="file to write; its ending says how"
    )
    parser.add_argument("--metrics", action="store_true", help="the metrics instead, a row a variant (.csv, .parquet)")
    orders = "levels of the loads on the housing instead, in dB over the driver's orders (.csv, .parquet)"
    parser.add_argument("--orders", action="store_true", help=orders)
    add_shared_options(parser, "--variant")
    text = "inputs of the FMU, such as driven.load_torque; default the torques of all loads; none with no name"
    parser.add_argument("--inputs", metavar="PART.KIND", nargs="*", help=text)
    text = "outputs of the FMU, such as tension or driven.sprocket_speed; default all but those of rollers and links"
    parser.add_argument("--outputs", metavar="CHANNEL", nargs="+", help=text)
    parser.add_argument("--step", **STEP_OPTION)
    add_shared_options(parser, "--set")


def _add_import_command(commands: Any) -> None:
    """Adds `warpchain import` to the parser."""
    parser = _add_file_command(
        commands,
        "import",
        "lay a measured signal (CSV, MAT, MDF, TDMS) over a run: statistics, orders, figures, Rerun",
        "warpchain import rig.csv marine.mcap --as 'camshaft->crankshaft.tension' --unit kN -o rig.png rig.rrd",
    )
    parser.add_argument("signal", metavar="RIG.csv", type=Path, help="values over time: text, MAT, MDF or TDMS")
    parser.add_argument("archive", metavar="OUT.mcap", type=Path, help="the run to compare with")
    parser.add_argument(
        "--as", dest="name", metavar="NAME", required=True, help="what was measured, such as 'camshaft.moment'"
    )
    parser.add_argument("--column", metavar="NAME", help="which column of the file; default the first after the time")
    parser.add_argument("--time", metavar="NAME", help="the column of time; default the first")
    parser.add_argument("--unit", metavar="UNIT", help="of the values, such as kN; default what the head says, or SI")
    parser.add_argument("--time-unit", metavar="UNIT", help="of the time; default what the head says, or s")
    parser.add_argument(
        "--decimal", choices=(".", ","), help="sign before decimals in text; default the one that all its numbers have"
    )
    parser.add_argument("--head", metavar="LINE", type=int, help="line of the names in text; default is found")
    parser.add_argument(
        "--offset", default="0", metavar="SECONDS", help="added to the measured time; auto: where both agree best"
    )
    add_shared_options(parser, "--variant")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, nargs="+", default=[], help=".png, .svg, .rrd (Rerun) or .json"
    )


def _add_cut_command(commands: Any) -> None:
    """Adds `warpchain cut` to the parser."""
    parser = _add_function_command(
        commands,
        do.cut_command,
        "write a piece of an archive as an archive of its own: some variants, between two times",
        "warpchain cut sweep.mcap -o piece.mcap --time 0.2 0.4 --variants 3 17",
    )
    add_shared_options(parser, "archive")
    parser.add_argument(
        "-o", "--output", metavar="PIECE.mcap", type=archive_path_from_word, required=True, help="archive to write"
    )
    text = "first and last time of frames [s], or as 200ms (default all)"
    parser.add_argument("--time", type=time_from_word, nargs=2, metavar=("START", "END"), help=text)
    text = "recorded variants to keep (default all)"
    parser.add_argument("--variants", type=int, nargs="+", metavar="I", help=text)
    parser.add_argument("--compression", default="zstd", choices=["zstd", "lz4", "none"], help="default zstd")
    add_shared_options(parser, "--overwrite")


def _add_recover_command(commands: Any) -> None:
    """Adds `warpchain recover` to the parser."""
    parser = _add_function_command(
        commands,
        do.recover_command,
        "restore an archive that was cut or damaged, up to its last whole chunk",
        "warpchain recover broken.mcap -o fixed.mcap",
    )
    parser.add_argument(
        "archive", metavar="BROKEN.mcap", type=Path, help="the file, or the name of a cut run's archive"
    )
    parser.add_argument(
        "-o", "--output", metavar="FIXED.mcap", type=archive_path_from_word, required=True, help="archive to write"
    )
    add_shared_options(parser, "--overwrite")


def _add_study_command(commands: Any) -> None:
    """Adds `warpchain study` with its commands to the parser."""
    text = "run and analyze a design of experiments"
    parser = add_command(commands, "study", None, text, "warpchain study run STUDY.toml -o DIR")
    studies = parser.add_subparsers(dest="study_command", metavar="COMMAND", required=True)
    add_study_commands(studies)
    add_report_commands(studies)
    add_play_command(studies)


COMMAND_ADDERS = (
    _add_select_command,
    _add_new_command,
    _add_check_command,
    _add_draw_command,
    _add_metrics_command,
    _add_explain_command,
    _add_chains_command,
    _add_schema_command,
    _add_devices_command,
    _add_fit_command,
    _add_modes_command,
    _add_tensioner_command,
    _add_jump_command,
    _add_run_command,
    _add_warm_command,
    _add_view_command,
    _add_plot_command,
    _add_report_command,
    _add_export_command,
    _add_import_command,
    _add_cut_command,
    _add_recover_command,
    _add_study_command,
    add_optimize_command,
    add_risk_command,
    add_better_command,
    add_calibrate_command,
    add_mcp_command,
)
"""Functions that add the commands, in the help's order."""


def command_line_parser() -> argparse.ArgumentParser:
    """Parser of the whole command line."""
    top = _OneLineParser(
        prog="warpchain",
        description="Dynamics of roller-chain drives, many variants at once.",
        epilog=HELP_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="store_true", help="print the version and exit")
    text = "print what makes a shell complete commands, options and files; needs the extra completions"
    top.add_argument("--completions", choices=SHELLS, help=text)
    commands = top.add_subparsers(dest="command", metavar="COMMAND")
    for add in COMMAND_ADDERS:
        add(commands)
    return top


def run_command_line(argv: Sequence[str] | None = None) -> int:
    """Runs the parsed command line; returns the exit status, errors printed in one line each."""
    warnings.showwarning = _print_warning
    with contextlib.suppress(AttributeError, ValueError, OSError):  # a standard error that is no file
        faulthandler.enable()
    try:
        top = command_line_parser()
        arguments = top.parse_args(argv)
        with rare_collections():
            status = _run_parsed_command(top, arguments)
        sys.stdout.flush()
        return status
    except WarpchainError as error:
        for line in str(error).splitlines():
            _print_error_line(f"error: {line}")
        return WRONG
    except BrokenPipeError:
        _discard_output()
        return UNFINISHED
    except OSError as error:
        _discard_output()
        _print_error_line(f"error: {f'{error.filename}: ' if error.filename else ''}{refusal_reason(error)}")
        return WRONG
    except MemoryError:
        _print_error_line("error: this machine has too little memory for it")
        return WRONG
    except KeyboardInterrupt:
        _print_error_line("interrupted")
        return UNFINISHED


def _run_parsed_command(top: argparse.ArgumentParser, arguments: argparse.Namespace) -> int:
    """Runs the command that was parsed; errors name its options."""
    if arguments.version:
        from importlib.metadata import version

        print(f"warpchain {version('warpchain')}")
        return DONE
    if arguments.completions is not None:
        print(completion_script(top, arguments.completions))
        return DONE
    if arguments.command is None:
        top.print_help()
        return WRONG
    try:
        load_plugins_of_arguments(arguments)
        return int(arguments.run(arguments))
    except WarpchainError as error:
        raise WarpchainError(message_with_options(str(error), arguments)) from None


def _print_error_line(line: str) -> None:
    """Prints a line on standard error, if possible."""
    with contextlib.suppress(OSError):
        print(f"warpchain: {line}", file=sys.stderr)


def _discard_output() -> None:
    """Discards output that could not be printed, so that Python does not try again."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _print_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Prints a warning as one line on standard error."""
    _print_error_line(f"warning: {message}")


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Script by which a shell completes the parser's command line, made by shtab.

    Raises:
        WarpchainError: without the package shtab.
    """
    from warpchain.extras import require_extra

    require_extra("completions", "--completions", WarpchainError)
    import shtab

    _mark_file_arguments(parser, {"DIR": shtab.DIRECTORY}, shtab.FILE)
    return str(shtab.complete(parser, shell))


def _mark_file_arguments(parser: argparse.ArgumentParser, folders: dict[str, object], file: object) -> None:
    """Marks a parser's arguments that are files or folders, for completion."""
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for inner in action.choices.values():
                _mark_file_arguments(inner, folders, file)
        elif action.type is Path or action.metavar == "DRIVE":
            action.complete = folders.get(str(action.metavar), file)  # type: ignore[attr-defined]


if __name__ == "__main__":
    sys.exit(run_command_line())
