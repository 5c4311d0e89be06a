"""The command `warpchain fit`: fits a drive, and writes its file back with its comments."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpchain.assembly.assembly import assemble_chain
from warpchain.assembly.fitting import fit_angle, fit_links, fit_position, fit_wrap, fitted_chain, strand_sag
from warpchain.assembly.guide_fit import fit_indentation
from warpchain.assembly.layout_checks import idle_arm_advice, layout_faults, strain_advice
from warpchain.assembly.rating import resting_sags
from warpchain.assembly.statics import at_rest
from warpchain.drive import loads_drive, read_drive_text, write_drive_text
from warpchain.drive.drive_text import self_contained_text, text_with_changes
from warpchain.drive.examples import drive_path, is_example
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model

if TYPE_CHECKING:
    from warpchain.drive import Drive

FIT_DIGITS = 15
ANGLE_TOLERANCE = 1.0
"""Miss of a wanted arm angle that goes without a line [degrees]."""


def fit_lines(arguments: Namespace) -> list[str]:
    """Fits a drive file as asked and writes it; returns the lines to print.

    Raises:
        DriveError: a drive that is wrong, a wish that cannot be met or a file that cannot be written.
    """
    moving = arguments.sprocket is not None
    if (arguments.guide is None) != (arguments.indentation is None):
        raise DriveError("--guide and --indentation: give both, or none")
    if not (moving or arguments.links or arguments.guide is not None):
        raise DriveError("nothing to fit: give --links, or --sprocket with --along and what is wanted")
    if moving != (arguments.along is not None):
        raise DriveError("--sprocket and --along: give both, or none")
    wanted = (arguments.strain, arguments.preload, arguments.sag)
    if not moving and any(x is not None for x in wanted):
        raise DriveError("--strain, --preload, --sag: need a sprocket to move, --sprocket and --along")
    _check_wrap(arguments, moving)
    if arguments.angle is not None and any(x is not None for x in wanted) and not arguments.links:
        raise DriveError("--angle: without --links it stands alone; leave out --strain, --preload, --sag")
    path = drive_path(arguments.drive)
    output = arguments.output or path
    if is_example(output):
        raise DriveError(f"{arguments.drive} comes with the package: give -o OUT.toml to write a file of your own")

    text = read_drive_text(path)
    before = loads_drive(text, str(path), Path(path).parent)
    angle = _wanted_arm_angle(before, arguments)
    if before.chains and arguments.chain is None and arguments.sprocket is None:
        names = ", ".join(chain.name for chain in before.chains)
        raise DriveError(f"--chain: must be given, as there are several chains; allowed are {names}")
    chain = fitted_chain(before, arguments.chain, arguments.sprocket).name or None
    if moving and chain not in (None, own := fitted_chain(before, sprocket=arguments.sprocket).name):
        raise DriveError(f'--chain {chain}: "{arguments.sprocket}" is of the chain "{own}"')
    drive = before
    if arguments.guide is not None:
        drive = fit_indentation(drive, arguments.guide, arguments.indentation)
    if arguments.wrap is not None:
        line = _direction_from_word(arguments.along)
        drive = fit_wrap(drive, arguments.sprocket, line, arguments.wrap, arguments.around)
    drive = fit_links(drive, odd=arguments.odd, angle=angle, chain=chain) if arguments.links else drive
    moving = moving and arguments.wrap is None
    if moving and angle is not None and not any(x is not None for x in wanted):
        drive = fit_angle(drive, arguments.sprocket, _direction_from_word(arguments.along), angle)
    elif moving:
        drive = fit_position(
            drive,
            arguments.sprocket,
            _direction_from_word(arguments.along),
            strain=arguments.strain,
            preload=arguments.preload,
            sag=arguments.sag,
            strand=arguments.strand,
        )
    beside = output.parent.resolve() == path.parent.resolve()
    write_drive_text(
        text_with_changes(text if beside else self_contained_text(path), before, drive, FIT_DIGITS), output
    )
    return [
        *_fit_change_lines(before, drive),
        *_fit_state_lines(drive),
        *_missed_angle_lines(drive, angle or {}),
        f"written: {output}",
    ]


def _check_wrap(arguments: Namespace, moving: bool) -> None:
    """Raises DriveError for a wrap to fit that moves no sprocket, or is decided already."""
    if arguments.wrap is None and arguments.around is not None:
        raise DriveError("--around: needs --wrap")
    if arguments.wrap is not None and not moving:
        raise DriveError("--wrap: needs a sprocket to move, --sprocket and --along")
    others = (arguments.strain, arguments.preload, arguments.sag, arguments.angle)
    if arguments.wrap is not None and any(x is not None for x in others):
        raise DriveError("--wrap: leave out --strain, --preload, --sag and --angle; --links may stand beside it")


def _wanted_arm_angle(drive: Drive, arguments: Namespace) -> dict[str, float] | None:
    """Arm angle [degrees] to fit by arm, or None."""
    if arguments.angle is None:
        if arguments.arm is not None:
            raise DriveError("--arm: needs --angle")
        return None
    if arguments.arm is None and len(drive.arms) != 1:
        raise DriveError(f"--angle: needs --arm, the drive has {len(drive.arms)} arms")
    return {arguments.arm or drive.arms[0].name: arguments.angle}


def _direction_from_word(word: str) -> list[float]:
    """Direction (x, y) from a word of `fit --along`."""
    try:
        direction = [float(part) for part in word.split(",")]
    except ValueError:
        direction = []
    if len(direction) != 2:
        raise DriveError(f"--along {word}: must be two numbers DX,DY, such as 1,0")
    return direction


def _fit_change_lines(before: Drive, after: Drive) -> list[str]:
    """Lines on links and centers that a fit changed."""
    lines = []
    for one, other in zip(Model(before).chains, Model(after).chains, strict=True):
        if other.links != one.links:
            place = f"chains.{other.name}" if other.name else "chain"
            lines.append(f"{place}.links = {other.links} (was {one.links})")
    for old, new in zip(before.as_read.sprockets, after.as_read.sprockets, strict=True):
        if old.center != new.center:
            lines.append(f"sprockets.{new.name}.center = {list(new.center)} (was {list(old.center)})")
    return lines or ["nothing changed: as it is, it is the nearest to what was asked"]


def _missed_angle_lines(drive: Drive, wanted: dict[str, float]) -> list[str]:
    """Lines on arms that a fit leaves off their wanted angle [degrees]."""
    lines = []
    for model in Model(drive).chains:
        mine = [(a, arm.name) for a, arm in enumerate(model.arms) if arm.name in wanted]
        angles = np.degrees(assemble_chain(model).arm_angle) if mine else ()
        lines += [
            f"LOOK AT arms.{name}: stands at {angles[a]:.4g} degrees, where {wanted[name]:g} was asked: --sprocket "
            "with --angle moves a sprocket until it stands there"
            for a, name in mine
            if abs(angles[a] - wanted[name]) > ANGLE_TOLERANCE
        ]
    return lines


def _fit_state_lines(drive: Drive) -> list[str]:
    """Lines on strain, preload and sags of a fitted drive."""
    lines = []
    for model in Model(drive).chains:
        name = f"{model.name}: " if model.name else ""
        try:
            lines += [f"{name}{line}" for line in _chain_fit_lines(model)]
        except DriveError as error:
            lines.append(f"LOOK AT {name}{error}")
    return lines


def _chain_fit_lines(model: ChainModel) -> list[str]:
    """Lines on strain, preload, sags and findings of a fitted chain."""
    assembly = assemble_chain(model)
    state = "taut" if assembly.strain >= 0.0 else "slack"
    preload = max(0.0, model.chain.mean_stiffness * model.chain.pitch * assembly.strain)
    free = [k for k in range(len(model.strand_names)) if assembly.path.strings[k] is None]
    held = {k: strand_sag(model, assembly, k) for k in free}
    resting = resting_sags(model, assembly, at_rest(model, assembly)) if held else {}
    arms = ", ".join(
        f"{arm.name} {math.degrees(angle):.4g}" for arm, angle in zip(model.arms, assembly.arm_angle, strict=True)
    )
    return [
        f"fit: {state}, strain {assembly.strain:+.3e}, preload {preload:.4g} N",
        *([f"sag at rest, as check has it: {_sags_text(model, resting)}"] if resting else []),
        *([f"sag while all sprockets are held, as --sag means it: {_sags_text(model, held)}"] if held else []),
        *([f"arms at assembly, degrees: {arms}"] if arms else []),
        *(f"LAYOUT: {finding}" for finding in layout_faults(model, assembly.path)),
        *(f"LOOK AT {line}" for line in strain_advice(model, assembly.strain)),
        *(f"LOOK AT {line}" for line in idle_arm_advice(model, assembly.path)),
    ]


def _sags_text(model: ChainModel, sags: Mapping[int, float]) -> str:
    """Text of a fit's sags [m], by strand."""
    return ", ".join(f"{model.strand_names[k]} {1e3 * sag:.3g} mm" for k, sag in sags.items())
