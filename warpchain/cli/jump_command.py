"""The command `warpchain jump`: the load or the wear at which a chain jumps a tooth."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict

from warpchain.cli.shared_options import drive_of_arguments
from warpchain.engine.jump import BOTH, UNITS, Jump, find_jumps


def jump_lines(arguments: argparse.Namespace) -> list[str]:
    """Searches where a chain jumps a tooth, as asked; returns lines to print."""
    from warpchain.engine import start_warp

    start_warp(precompiled=False)
    quiet = arguments.quiet
    found = find_jumps(
        drive_of_arguments(arguments),
        arguments.by,
        arguments.on,
        directions=BOTH if arguments.direction == "both" else (arguments.direction,),
        most=arguments.most,
        tolerance=arguments.tolerance,
        values=arguments.values,
        duration=arguments.duration,
        device=arguments.device,
        precision=arguments.precision,
        workers=arguments.workers,
        progress=not quiet and sys.stderr.isatty(),
        report=(lambda line: None) if quiet else lambda line: print(f"warpchain: {line}", file=sys.stderr),
    )
    if arguments.json:
        directions = {jump.direction: _jump_json(jump, arguments.by) for jump in found}
        return [json.dumps({"units": "SI", "by": arguments.by, "unit": UNITS[arguments.by], **directions}, indent=2)]
    return [line for jump in found for line in _margin_lines(jump, arguments.by)]


def margin_to_jump(jump: Jump, by: str) -> float | None:
    """Margin to a tooth jump: torque that holds over the drive's, or wear less its own, or None."""
    if by == "wear":
        return jump.holds - jump.own
    return jump.holds / abs(jump.own) if jump.own else None


def _jump_json(jump: Jump, by: str) -> dict[str, object]:
    """Values of `warpchain jump --json`, in SI units."""
    values = {key: value for key, value in asdict(jump).items() if key != "direction"}
    known = {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}
    return known | {"margin": margin_to_jump(jump, by)}


def _margin_lines(jump: Jump, by: str) -> list[str]:
    """Lines on the load or wear at which a chain jumps one way."""

    def load_text(value: float) -> str:
        """Text of a tooth jump's load [N m] or wear [%]."""
        return f"{value:.4g} N m on {jump.on}" if by == "torque" else f"{100.0 * value:.3g} % of wear{chain}"

    chain = f" of {jump.on}" if by == "wear" and jump.on else ""
    if jump.jumps is None:
        return [f"{jump.direction}: no jump up to {load_text(jump.holds)}; {_own_load_text(jump, by)}"]
    where = "the chain breaks down" if jump.sprocket is None else f"the chain jumps on {jump.sprocket}"
    jumps, holds = load_text(jump.jumps), load_text(jump.holds)
    lines = [f"{jump.direction}: {where} at {jumps}, and holds at {holds}; {_own_load_text(jump, by)}"]
    if not math.isnan(jump.tension):
        beside = f", {jump.tight:.4g} and {jump.slack:.4g} N in the mean beside it" if jump.sprocket else ""
        lines.append(f"  tension there: {jump.tension:.4g} N at most{beside}")
    if jump.sprocket is not None:
        words = "none in the range" if jump.estimate is None else load_text(jump.estimate)
        lines.append(f"  estimate at rest: {words} (docs/jump.md)")
    return lines


def _own_load_text(jump: Jump, by: str) -> str:
    """Text of the drive's own load or wear, with margin to a jump."""
    far = margin_to_jump(jump, by)
    if by == "wear":
        return f"its own is {100.0 * jump.own:.3g} %"
    return "it has none of its own" if far is None else f"{far:.3g} times its own, {abs(jump.own):.4g} N m"
