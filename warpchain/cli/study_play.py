"""The command `warpchain study play`: options and body."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from warpchain.cli.arguments import add_command, whole_number
from warpchain.cli.commands import DONE


def add_play_command(commands: Any) -> None:
    """Adds the command to the subparsers of `warpchain study`."""
    text = "play one variant, which is run again if it was not recorded"
    parser = add_command(commands, "play", text, "warpchain study play DIR 12")
    parser.add_argument("folder", metavar="DIR", type=Path, help="a study's folder, or a search's")
    parser.add_argument("variant", metavar="VARIANT", type=int, help="its number in the table")
    parser.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    parser.add_argument("--workers", metavar="N", type=whole_number, help="CPU threads; default all cores")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(study_run=_play)


def _play(arguments: argparse.Namespace) -> int:
    from warpchain.engine.start import start_warp
    from warpchain.study.run.play import recording_of
    from warpchain.view.rerun.playback import view

    start_warp(precompiled=False)
    bar = not arguments.quiet and sys.stderr.isatty()
    archive, number = recording_of(arguments.folder, arguments.variant, workers=arguments.workers, progress=bar)
    print(f"{archive}, variant {number}")
    view(archive, variant=number, save=arguments.save)
    return DONE
