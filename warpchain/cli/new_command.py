"""The command `warpchain new`: a commented drive file from a chain's size, numbers of teeth and centers."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.assembly.fitting import fit_links, fit_position
from warpchain.assembly.summary import derived_quantities, fit_and_findings
from warpchain.drive import loads_drive, write_drive_text
from warpchain.drive.catalogue import CHAINS, CatalogueChain
from warpchain.drive.defaults import (
    BUSH_STIFFNESS,
    CIRCUITS,
    CLEARANCE,
    DAMPING_RATIO,
    SAFETY,
    SAMPLES_A_TOOTH,
    TEETH_FRICTION,
    TOOTH_WIDTH,
    disk_mass_and_inertia,
    rounded_to_two_figures,
    wrap_senses,
)
from warpchain.drive.json_schema import drive_schema, schema_text
from warpchain.drive.plate import LEAST_TEETH
from warpchain.drive.schema import nearest_key_text
from warpchain.errors import DriveError
from warpchain.model.power_rating import rated_power, size_rating

if TYPE_CHECKING:
    from warpchain.drive import Drive

Point = tuple[float, float]

SCHEMA = "drive.schema.json"
"""Schema's file, from which editors complete keys."""
CHAIN_SPEED = 3.0
"""Speed of the chain by default [m/s]."""


@dataclass(frozen=True)
class DriveRequest:
    """Drive that `warpchain new` is asked for, and the values that follow.

    Attributes:
        chain: row of the catalog.
        teeth, centers: (S,) of the sprockets, in the order in which the chain visits them [m].
        speed: of the first sprocket [rad/s].
        torque: that brakes the last one [N m].
        links: number of links.
        moved: how far the last sprocket stands from where it was asked for [m].
    """

    chain: CatalogueChain
    teeth: tuple[int, ...]
    centers: tuple[Point, ...]
    speed: float
    torque: float
    links: int = 100
    moved: float = 0.0

    @property
    def sprocket_names(self) -> list[str]:
        """Names of a new drive's sprockets: driver, idlers, driven."""
        idlers = [f"idler {k}" if len(self.teeth) > 3 else "idler" for k in range(1, len(self.teeth) - 1)]
        return ["driver", *idlers, "driven"]

    @property
    def wrap_senses(self) -> list[str]:
        """Senses of a new drive's chain around sprockets, the other one at notches."""
        return wrap_senses(list(self.centers))


def new_lines(arguments: Namespace) -> list[str]:
    """Writes a new drive file and its schema; returns the lines to print.

    Raises:
        DriveError: an unknown size, too few sprockets or centers, a chain without a path, or a file that is there.
    """
    return write_drive_request(_drive_request(arguments), arguments.output, arguments.overwrite, arguments.keep_centers)


def write_drive_request(asked: DriveRequest, path: Path, overwrite: bool, keep_centers: bool = False) -> list[str]:
    """Writes a new drive's file, with links and center that fit, and schema; returns lines to print.

    Raises:
        DriveError: a chain without a path, or a file that is there.
    """
    if path.exists() and not overwrite:
        raise DriveError(f"{path}: exists; --overwrite replaces it")
    drive = fit_links(loads_drive(_drive_file_text(asked)))
    if not keep_centers:
        (ax, ay), (bx, by) = asked.centers[0], asked.centers[-1]
        drive = fit_position(drive, asked.sprocket_names[-1], (bx - ax, by - ay), strain=0.0)
    centers = tuple(sprocket.center for sprocket in drive.sprockets)
    moved = math.dist(centers[-1], asked.centers[-1])
    text = _drive_file_text(replace(asked, links=drive.chain.links, centers=centers, moved=moved))
    lines = fit_and_findings(derived_quantities(loads_drive(text)))
    write_drive_text(text, path)
    if overwrite or not (path.parent / SCHEMA).exists():
        write_drive_text(schema_text(drive_schema()), path.parent / SCHEMA)
    written = f"written: {path}, {SCHEMA} for editors; next: warpchain draw {path} -o {path.stem}.svg"
    return [*_choice_lines(asked, drive, moved), *lines, written]


def _drive_request(arguments: Namespace) -> DriveRequest:
    """Drive that `warpchain new`'s arguments ask for.

    Raises:
        DriveError: an unknown size, or too few teeth or centers.
    """
    size, teeth, flat = arguments.size, tuple(arguments.teeth), arguments.centers
    if size not in CHAINS:
        raise DriveError(
            f"--size {size}: not in the catalog; {nearest_key_text(size, CHAINS, 12)}; warpchain chains lists all"
        )
    if len(teeth) < 2:
        raise DriveError("--teeth: must be at least two numbers, one for each sprocket")
    if len(flat) != 2 * len(teeth):
        raise DriveError(
            f"--centers: must be X Y for each of the {len(teeth)} sprockets; {len(flat)} numbers are given"
        )
    chain, centers = CHAINS[size], tuple(zip(flat[::2], flat[1::2], strict=True))
    for of, found in ((teeth[0], arguments.speed), (teeth[-1], arguments.torque)):
        if of < 5 or (found is not None and found <= 0.0):
            raise DriveError("--teeth, --speed, --torque: must be at least 5 teeth, a speed and a moment above 0")
    if chain.kind == "silent" and min(teeth) < LEAST_TEETH:
        raise DriveError(f"--teeth {min(teeth)}: must be at least {LEAST_TEETH} with a silent chain")
    if chain.kind == "silent" and len(set(wrap_senses(list(centers)))) > 1:
        raise DriveError("--centers: a silent chain must go around all sprockets the same way, on a convex polygon")
    driver, driven = (0.5 * chain.pitch / math.sin(math.pi / z) for z in (teeth[0], teeth[-1]))
    speed = arguments.speed or rounded_to_two_figures(CHAIN_SPEED / driver * 30.0 / math.pi) * math.pi / 30.0
    most = chain.breaking_load / SAFETY * driven
    if size_rating(size) is not None:
        fewest = min(teeth)
        rated = rated_power(size, fewest, speed * teeth[0] / fewest).least / (speed * teeth[0] / teeth[-1])
        most = min(most, 0.95 * rated)
    return DriveRequest(chain, teeth, centers, speed, arguments.torque or rounded_to_two_figures(most))


def _choice_lines(asked: DriveRequest, drive: Drive, moved: float) -> list[str]:
    """Line on links and last center chosen for a new drive."""
    last = f"{asked.sprocket_names[-1]} moved by {1e3 * moved:.3g} mm"
    place = "" if moved == 0.0 else f"; {last} to [{_center_text(drive.sprockets[-1].center)}]"
    return [f"{drive.chain.links} links{place}"]


def _center_text(center: Point) -> str:
    """Text of a sprocket's center in a new drive file."""
    return ", ".join(repr(float(x)) for x in center)


def _drive_file_text(asked: DriveRequest) -> str:
    """Text of a new drive file, with its comments."""
    chain, size = asked.chain, asked.chain.size
    radii = [0.5 * chain.pitch / math.sin(math.pi / z) for z in asked.teeth]
    tooth = asked.speed * asked.teeth[0] / math.tau
    round_time, silent = asked.links / tooth, chain.kind == "silent"
    part = f"width {1e3 * chain.inner_width:g} mm" if silent else f"roller {1e3 * chain.roller_diameter:g} mm"
    about = (
        f"pitch {1e3 * chain.pitch:g} mm, {part}, {chain.mass_per_length:g} kg/m, "
        f"breaking load {1e-3 * chain.breaking_load:g} kN{', ESTIMATES but pitch and width' * silent}"
    )
    seat = [('profile = "circular"', ""),
            (f"clearance = {CLEARANCE * chain.pitch:.2g}", f"ESTIMATE: {CLEARANCE:g} of the pitch")]  # fmt: skip
    steel = "{ youngs_modulus = 210e9, poissons_ratio = 0.3 }"
    blocks = [
        [
            (f"#:schema ./{SCHEMA}", ""),
            (f"# A drive of {len(radii)} sprockets with a {size} chain, written by warpchain new.", ""),
            ('# Lengths in m, forces in N, angles in rad; or a text with a unit, such as "540 rpm" or "12.7 mm".', ""),
            ("# Replace what is marked ESTIMATE as you know better. All keys: docs/drive-file.md.", ""),
            ("[chain]", ""),
            (f'size = "{size}"', about),
            (f"links = {asked.links}", "the even number that fits best"),
            ('stiffness = "estimate"', "ESTIMATE, good to a factor of three; or a measured value of one link [N/m]"),
            (f"damping_ratio = {DAMPING_RATIO:g}", "ESTIMATE"),
            ("joint = { friction = 0.1 }", "ESTIMATE: greased; the pins' radius comes with the size"),
        ],
        *(_sprocket_table_lines(asked, s, radii[s], 0.2 * round_time) for s in range(len(radii))),
        [
            ("[contact.sprocket]", ""),
            *([] if silent else seat),
            (
                "restitution = 0.3",
                f"ESTIMATE: a free {'link' if silent else 'roller'} rebounds with this share of its speed",
            ),
            ('restitution_means = "rebound"', ""),
            (
                f"bush_stiffness = {BUSH_STIFFNESS * chain.pitch * chain.strands:.2g}",
                f"ESTIMATE: {BUSH_STIFFNESS:g} N/m^2 times pitch and strands; bush, pin, grease",
            ),
            (f"friction = {TEETH_FRICTION:g}", f"ESTIMATE: of {'toes' if silent else 'rollers'} on teeth"),
            ("impact_speed_floor = 0.02", ""),
            (
                f"width = {TOOTH_WIDTH * chain.inner_width * chain.strands:.3g}",
                f"of all teeth side by side: {TOOTH_WIDTH:g} of the inner width",
            ),
            (
                f"reference_load = {rounded_to_two_figures(asked.torque / radii[-1]):g}",
                "about the chain's pull: contacts are as stiff",
            ),
            (f"roller = {steel}", ""),
            (f"partner = {steel}", ""),
        ],
        [
            ("[run]", ""),
            (
                f"duration = {rounded_to_two_figures(CIRCUITS * round_time):g}",
                "twice around; metrics are of the latter half, a round of the chain",
            ),
            ('step = "auto"', ""),
            (
                f"sample_rate = {rounded_to_two_figures(SAMPLES_A_TOOTH * tooth):g}",
                "of the recording: 20 a tooth of the driver",
            ),
        ],
    ]
    rows = "\n\n".join("\n".join(f"{line:<29} # {said}" if said else line for line, said in block) for block in blocks)
    return rows.replace("\n[chain]", "\n\n[chain]") + "\n"


def _sprocket_table_lines(asked: DriveRequest, s: int, radius: float, ramp_time: float) -> list[tuple[str, str]]:
    """Lines of sprocket s in a new drive file, with comments."""
    last, ramp = len(asked.teeth) - 1, f"ramp_time = {rounded_to_two_figures(ramp_time):g}"
    mass, inertia = disk_mass_and_inertia(radius, TOOTH_WIDTH * asked.chain.inner_width * asked.chain.strands)
    moved = f"moved by {1e3 * asked.moved:.3g} mm, so that {asked.links} links fit" if asked.moved and s == last else ""
    lines = [
        ("[[sprockets]]", ""),
        (f'name = "{asked.sprocket_names[s]}"', ""),
        (f"teeth = {asked.teeth[s]}", ""),
        (f"center = [{_center_text(asked.centers[s])}]", moved),
        (f'wrap = "{asked.wrap_senses[s]}"', "sense in which the chain goes around it"),
    ]
    if s == 0:
        rpm = asked.speed * 30.0 / math.pi
        return [*lines, (f'prescribed = {{ speed = "{rpm:.6g} rpm", {ramp} }}', "turns so, whatever pulls at it")]
    lines.append((f"mass = {mass:g}", "ESTIMATE: a disk of steel as wide as the teeth"))
    lines.append((f"inertia = {inertia:g}", "ESTIMATE: that disk's; add what turns with it"))
    braked = [(f"load = {{ torque = {asked.torque:g}, {ramp} }}", "moment that brakes it")]
    return [*lines, *(braked if s == last else [])]
