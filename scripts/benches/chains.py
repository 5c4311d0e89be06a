"""Drives of several chains: beside one chain with as many rollers and partners, and beside their chains untied."""

import argparse
import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from common.cases import Line, case, case_option
from common.drives import example_drive
from common.timing import run_in_turns, second_best_rate

from benches.probe import endless_schedule, launch_seconds
from warpchain import Drive
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.pack import pack
from warpchain.model.stacks import stacks_of_drives

PITCH, SIDE = 0.05, 23
"""Of the chains [m], and links of a strand."""
CHAIN = {"pitch": PITCH, "roller_mass": 1.0, "stiffness": 5e7, "damping": 2000.0, "roller_radius": 0.015}
LAW = {"clearance": 1e-4, "seat_angle": 125.0, "restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 2e8}
FRICTION = {"friction": 0.1, "pin_radius": 0.008}
OUTER, INNER = 26.594, 6.5
"""Pitches from the middle of a star to its sprockets, at which 180 links are taut by a thousandth."""


def sprocket_row_drive(sprockets: list[dict[str, Any]], **parts: Any) -> Drive:
    """A drive of sprockets in a row, the first of which leads the chain at 10 pitches of 20 teeth a radian."""
    run = {"duration": 1.0, "step": 5e-6, "settle": False, "sample_rate": 2000.0}
    driver, *driven = sprockets
    driver["prescribed"], driven[-1]["load"] = {"speed": 200.0 / driver["teeth"]}, {"torque": 300.0}
    own = [{"inertia": 2.0, **sprocket} for sprocket in driven]
    values: dict[str, Any] = {"sprockets": [driver, *own], "contact": {"sprocket": LAW}, "run": run}
    return Drive(**values, **parts)


def chains_in_a_row(joint: dict[str, float] | None) -> Drive:
    """Three chains of 60 links one after the other, each around half of two sprockets of 14 teeth."""
    span, sprockets = SIDE * PITCH * 1.001, []
    for c in range(3):
        for end in (c, c + 1):
            place = {"center": [end * span, 0.0], "wrap": "ccw", "chain": f"c{c}"}
            shaft = {"shaft": f"s{end}"} if 0 < end < 3 else {}
            sprockets.append({"name": f"on {c} {end}", "teeth": 14, **place, **shaft})
    chains = [{"name": f"c{c}", "links": 60, "joint": joint, **CHAIN} for c in range(3)]
    return sprocket_row_drive(sprockets, chains=chains, shafts=[{"name": f"s{end}"} for end in (1, 2)])


def chain_around_a_star(joint: dict[str, float] | None) -> Drive:
    """One chain of 180 links around the outside of three sprockets of 20 teeth and the inside of three: as many
    rollers and sprockets, 42 rollers on these as on those, and strands as long."""
    sprockets = []
    for k in range(6):
        turn, away = math.pi * k / 3.0, PITCH * (INNER if k % 2 else OUTER)
        place = {"center": [away * math.cos(turn), away * math.sin(turn)], "wrap": "cw" if k % 2 else "ccw"}
        sprockets.append({"name": f"s{k}", "teeth": 20, **place})
    return sprocket_row_drive(sprockets, chain={"links": 180, "joint": joint, **CHAIN})


def roller_step_rate(
    drive: Drive, device: str, count: int, steps: int, precision: str, metrics: bool, tied: bool = True
) -> float:
    """1e6 roller-steps a second, on the CPU of CPU time on one core, compilation and start apart."""
    drives = [drive] * count
    rows = ChainRows(drives, stacks_of_drives(drives))
    when = endless_schedule(drives[0], metrics)
    packed = pack(rows.models, [when] * len(rows.models), rows.stacks)
    if tied:
        rows.couple_chains(packed)
    return count * drive.links * steps / launch_seconds(packed.at_precision(precision), device, steps)[0] / 1e6


@case(
    case_option("--steps", type=int, default=100_000, help="of each timed run, of `v6` a fourth (default 100000)"),
    case_option("--rounds", type=int, default=7, help="of which the best but one counts (default 7)"),
    case_option("--device", default="cpu", help="cpu (one core, CPU time; default) or such as cuda:0"),
    case_option("--variants", type=int, default=1, help="how many at once"),
)
def chains(asked: argparse.Namespace) -> Iterator[Line]:
    """Roller-steps a second of drives with several chains.

    python scripts/bench.py chains
    python scripts/bench.py chains --device cuda:0 --variants 1056 --steps 2000

    Three chains beside one with as many rollers and sprockets and as many rollers on these, and beside themselves
    untied, each a drive of its own; and `v6` beside itself untied. All are timed in turns, and the best but one is
    compared: ratios are what counts.
    """
    yield ("", "tied", "of one chain", "of untied chains")
    for precision in ("float64", "float32"):
        for title in ("three", "three, joint friction", "v6"):
            joint = FRICTION if "joint" in title else None
            drive = example_drive("v6") if title == "v6" else chains_in_a_row(joint)
            steps = asked.steps // 4 if title == "v6" else asked.steps
            for metrics in (False, True):
                fixed = {"device": asked.device, "count": asked.variants, "precision": precision, "metrics": metrics}
                timed = partial(roller_step_rate, steps=steps, **fixed)
                jobs = {"tied": partial(timed, drive), "untied": partial(timed, drive, tied=False)}
                if title != "v6":
                    jobs["one"] = partial(timed, chain_around_a_star(joint))
                best = {kind: second_best_rate(found) for kind, found in run_in_turns(jobs, asked.rounds).items()}
                one = f"{best['tied'] / best['one']:.2f}" if "one" in best else ""
                words = f"{title}, {precision}{', metrics' if metrics else ''}"
                yield (words, best["tied"], one, f"{best['tied'] / best['untied']:.2f}")
