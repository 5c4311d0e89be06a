"""Options that commands share, and values from the words of a command line."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from warpchain.argument_checks import MOST_WORKERS
from warpchain.errors import WarpchainError

CommandBody = Callable[[argparse.Namespace], int]
"""Function of a command, from arguments to exit status."""


def add_command(commands: Any, name: str, run: CommandBody | None, text: str, example: str) -> Any:
    """Adds a command to the command line; returns its parser for options.

    Args:
        run: its body; None where commands below it have theirs.
        text: its help, without a capital and a full stop.
        example: a line to try.
    """
    parser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    if run is not None:
        add_shared_options(parser, "--plugin")
    return parser


def load_plugins_of_arguments(arguments: argparse.Namespace) -> None:
    """Loads the plug-ins that a command's options name."""
    if arguments.plugin:
        from warpchain.drive.plugins import load_plugin

        for path in arguments.plugin:
            load_plugin(path)


def value_from_word(word: str) -> Any:
    """Value of a command's --set as TOML, else a text."""
    import tomllib

    try:
        table = tomllib.loads(f"value = {word}")
    except (ValueError, RecursionError):  # also a number of thousands of digits
        return word
    return table["value"] if len(table) == 1 else word


def drive_of_arguments(arguments: argparse.Namespace) -> Any:
    """Drive that a command's arguments name, changed by --set."""
    from warpchain.drive import load_drive
    from warpchain.drive.examples import drive_path

    drive = load_drive(drive_path(arguments.drive))
    changes = {}
    for change in arguments.set:
        path, mark, value = change.partition("=")
        if not mark or not path.strip():
            raise WarpchainError(f"--set {change}: must be PATH=VALUE, such as run.duration=0.5")
        changes[path.strip()] = value_from_word(value.strip())
    return drive.with_values(changes) if changes else drive


def number_from_word(word: str) -> float:
    """Number from an option's word.

    Raises:
        argparse.ArgumentTypeError: in one line, as of all words here.
    """
    try:
        return float(word)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is not a number") from None


def _quantity_from_word(word: str, unit: str, units: str) -> float:
    """Number in `unit` from an option's word such as 3000rpm; an error names `units`."""
    from warpchain.drive.quantities import converted_number

    value = converted_number(word, unit)
    try:
        found = float(word) if value is None else value
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a finite number of {unit}, or one with {units}")
    return found


def angular_speed_from_word(word: str) -> float:
    """Angular speed [rad/s] from an option's word: a number, or 3000rpm."""
    return _quantity_from_word(word, "rad/s", "rad/s or rpm")


def power_from_word(word: str) -> float:
    """Power [W] from an option's word: a number, or 7.5kW."""
    return _quantity_from_word(word, "W", "W, kW or hp")


def length_from_word(word: str) -> float:
    """Length [m] from an option's word: a number, or 800mm."""
    return _quantity_from_word(word, "m", "m, mm or in")


def time_from_word(word: str) -> float:
    """Time [s] from an option's word: a number, or 200ms."""
    return _quantity_from_word(word, "s", "s or ms")


def service_factor_from_word(word: str) -> float:
    """Service factor from an option's word: a number, or LOAD or LOAD,SOURCE of makers' tables."""
    from warpchain.model.power_rating import SERVICE_FACTORS

    load, _, source = word.partition(",")
    if load in SERVICE_FACTORS and (source or "motor") in SERVICE_FACTORS[load]:
        return SERVICE_FACTORS[load][source or "motor"]
    try:
        return float(word)
    except ValueError:
        loads, sources = " or ".join(SERVICE_FACTORS), " or ".join(SERVICE_FACTORS["smooth"])
        text = f"{word!r}: must be a number, or {loads}, with or without a comma and {sources}"
        raise argparse.ArgumentTypeError(text) from None


def number_or_auto_from_word(word: str) -> float | str:
    """Number from an option's word, or "auto"."""
    return word if word == "auto" else number_from_word(word)


def page_path_from_word(word: str) -> Path:
    """Path of an HTML page (.html, .htm) from an option's word."""
    return _path_with_ending(word, ".html", ".htm")


def archive_path_from_word(word: str) -> Path:
    """Path of an archive (.mcap) from an option's word."""
    return _path_with_ending(word, ".mcap")


def _path_with_ending(word: str, *endings: str) -> Path:
    """Path from an option's word with one of these endings."""
    path = Path(word)
    if path.suffix.lower() not in endings:
        raise argparse.ArgumentTypeError(f"{word!r}: must end in {', '.join(endings)}")
    return path


def bytes_from_gibibytes(word: str) -> int:
    """Memory budget [bytes] from an option's word in GiB."""
    gib = number_from_word(word)
    if not (math.isfinite(gib * 2**30) and gib > 0.0):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a finite number above 0 (GiB)")
    return int(gib * 2**30)


def bytes_from_mebibytes(word: str) -> int:
    """Size [bytes] from an option's word in MiB."""
    mib = number_from_word(word)
    if not (math.isfinite(mib * 2**20) and mib * 2**20 >= 1.0):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a finite number above 0 (MiB)")
    return int(mib * 2**20)


def whole_number_from_word(word: str) -> int:
    """Whole number above 0 from an option's word."""
    if not (word.isdecimal() and int(word) > 0):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a whole number above 0")
    return int(word)


def workers_from_word(word: str) -> int:
    """Number of worker threads from an option's word."""
    if not (word.isdecimal() and 1 <= int(word) <= MOST_WORKERS):
        raise argparse.ArgumentTypeError(f"{word!r}: must be a whole number from 1 to {MOST_WORKERS}")
    return int(word)


def shard_part_from_word(word: str) -> tuple[int, int]:
    """Part (I, N) of a study's shards from an option's word I/N."""
    first, _, parts = word.partition("/")
    if not (first.isdecimal() and parts.isdecimal() and int(first) < int(parts)):
        raise argparse.ArgumentTypeError(f"{word!r}: must be I/N, whole numbers with 0 <= I < N")
    return int(first), int(parts)


def precision_from_word(word: str) -> tuple[str, float]:
    """Metric and positive number from an option's word METRIC=VALUE."""
    name, mark, value = word.partition("=")
    if not mark or not name.strip() or not (math.isfinite(number_from_word(value)) and number_from_word(value) > 0.0):
        raise argparse.ArgumentTypeError(f"{word!r}: must be METRIC=VALUE, a metric and a number above 0")
    return name.strip(), number_from_word(value)


def woehler_curve_from_word(word: str) -> tuple[float, ...]:
    """Three numbers of a Woehler curve from an option's word M,RANGE,CYCLES."""
    try:
        values = tuple(float(value) for value in word.split(","))
    except ValueError:
        values = ()
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"{word!r}: must be three numbers M,RANGE,CYCLES such as 5,2e5,1e6")
    return values


OptionSettings = Mapping[str, Mapping[str, Any]]
SHARED_OPTIONS: OptionSettings = {
    "drive": {"metavar": "DRIVE", "help": "drive file (TOML), or the name of an example drive such as marine"},
    "archive": {"metavar": "OUT.mcap", "type": Path},
    "--plugin": {
        "metavar": "FILE.py",
        "action": "append",
        "default": [],
        "help": "load laws and metrics of one's own (docs/plugins.md)",
    },
    "--set": {"metavar": "PATH=VALUE", "action": "append", "default": [], "help": "change a value of the drive"},
    "--variant": {"type": int, "metavar": "I", "help": "which variant; default the first recorded"},
    "--workers": {"metavar": "N", "type": workers_from_word, "help": "CPU threads; default all cores"},
    "--memory": {
        "metavar": "GIB",
        "type": bytes_from_gibibytes,
        "default": "2",
        "help": "memory of a shard (default 2)",
    },
    "--quiet": {"action": "store_true", "help": "no progress bar"},
    "--overwrite": {"action": "store_true", "help": "replace an archive of that name"},
    "--scale": {
        "metavar": "NEWTON",
        "help": "tension at the red end of the colors, or breaking; default 99.9 %% of it in the run's latter half",
    },
}
"""Options that several commands share, as `add_argument` takes them."""


def add_shared_options(parser: Any, *names: str) -> None:
    """Adds options of `SHARED_OPTIONS` to a parser."""
    for name in names:
        parser.add_argument(name, **SHARED_OPTIONS[name])


def add_run_options(parser: Any) -> None:
    """Adds the options of commands that run variants to a parser."""
    add_shared_options(parser, "--workers", "--memory", "--quiet")


def run_options_from_arguments(arguments: argparse.Namespace) -> dict[str, Any]:
    """Threads, memory and progress, by name, from a command's arguments."""
    return {"workers": arguments.workers, "memory": arguments.memory, "progress": not arguments.quiet}


def status_printer(arguments: argparse.Namespace) -> Callable[[str], None] | None:
    """Function that prints a line on standard error, or None with the option --quiet."""
    return None if arguments.quiet else lambda line: print(f"warpchain: {line}", file=sys.stderr)


def message_with_options(message: str, arguments: argparse.Namespace) -> str:
    """Message of an error that names a command's options, not Python's arguments."""

    def option_text(found: re.Match[str]) -> str:
        """Option of the command line for an argument in a message."""
        name, value = found["name"], found["value"] or ""
        if hasattr(arguments, name):
            option = f"--{name.replace('_', '-')}"
            return option if value in ("", "True") else f"{option} {value.strip(chr(34) + chr(39))}"
        of_study = hasattr(arguments, "study") or hasattr(arguments, "folder")
        return f"run.{name} = {value}" if of_study and name in ("device", "precision") else found[0]

    lines = (
        re.sub(r"^(?:record\.)?(?P<name>[a-z_]+) = (?P<value>\S+)(?<!:)", option_text, line)
        for line in message.split("\n")
    )
    return re.sub(r'(?<![-.\w])(?P<name>[a-z_]+)=(?P<value>True|"\w+"|)(?![^\s,;)])', option_text, "\n".join(lines))
