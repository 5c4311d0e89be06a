"""Values of `check` on a drive and their text: geometry, strain, preload, tensions, steps, frequencies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import guide_report, run_up, statics, train_report
from warpchain.assembly.assembly import Assembly
from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.frequencies import moving_frequency, strand_frequency
from warpchain.assembly.layout_checks import layout_advice, layout_faults, strain_advice
from warpchain.assembly.path import ChainPath, path_at
from warpchain.assembly.rating import (
    critical_speeds,
    rating_advice,
    rating_lines,
    rating_values,
    resting_sag,
    strand_lines,
)
from warpchain.assembly.run_up import RunUp
from warpchain.assembly.statics import Steady
from warpchain.assembly.strength import LEAST_DYNAMIC, LEAST_STATIC, YIELD, HardestPull, strength_values
from warpchain.assembly.timestep import automatic_step, resolve_step, step_limit, stiffest_part
from warpchain.drive import Drive
from warpchain.drive.body_ties import driving_body, part_of_body
from warpchain.drive.catalogue import CHAINS, ELONGATION_AT_BREAKING_LOAD
from warpchain.drive.stiffness import contact_rebound
from warpchain.drive.thermal import Expansion, expansion_factor
from warpchain.drive.viscosity import REFERENCE
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model
from warpchain.model.friction_coefficients import guide_friction_coefficients, tooth_friction_coefficients
from warpchain.model.mounts import has_active_mount, mount_frequencies, moving_mass, wheel_force

_ROUND = 1e-3
"""Relative rounding of the automatic step in a file."""

__all__ = ["derived_quantities", "report", "strand_frequency", "working_tensions"]


def working_tensions(
    model: ChainModel, preload: float, links: list[int], speed: float | None = None, moments: NDArray[Any] | None = None
) -> list[float]:
    """Quick estimate of the strands' working tensions [N]: preload, loads / pitch radius, and (m / p) v^2.

    Args:
        preload: at assembly [N].
        links: of the strands.
        speed, moments: as of `warpchain.assembly.statics.at_work`.
    """
    speed = model.driver_speed if speed is None else speed
    moments = statics.load_moments(model, speed) if moments is None else moments
    rise = run_up.tension_rises(model, moments[:, None])[:, 0].tolist()
    mean = sum(n * tension for n, tension in zip(links, rise, strict=True)) / sum(links)
    offset = max(preload - mean, -min(rise))
    push = model.chain.mass / model.chain.pitch * (speed * model.pitch_radius(model.driver)) ** 2
    return [tension + offset + push for tension in rise]


def _links_and_joints(model: ChainModel) -> dict[str, Any]:
    """Values of `check` on joints, outer links and play that are set."""
    chain = model.chain
    found: dict[str, Any] = {}
    if chain.joint is not None:
        found["joint"] = chain.joint.model_dump() | {"pin_radius": chain.pin_radius}
    if chain.outer is not None:
        elongation = chain.outer_pitch / chain.pitch - 1.0
        found["outer"] = {
            "elongation": elongation,
            "stiffness": chain.outer_stiffness,
            "damping": chain.outer_damping,
        }
    if chain.link_play > 0.0:
        found["play"] = chain.link_play
    return found


def derived_quantities(drive: Drive) -> dict[str, Any]:
    """Derived quantities of a drive by name, in SI units; docs/scripts.md lists the keys.

    Without a steady state `tensions_estimated` says why. Of several chains "chains" has those of each.

    Raises:
        DriveError: a chain that does not fit, chains of one plane that cross, or a step beyond its limit.
    """
    model = Model(drive)
    chains, begins = model.loaded_chains, model.driver_ratios
    home = next(r for r, chain in enumerate(chains) if drive.driver in chain.places["sprockets"])
    assemblies, passed = assemble_chains(model), run_up.driver_run_up(chains[home])
    step = _step_values(drive)
    own, advice = {}, _step_advice(step) if len(chains) == 1 else []
    for chain, assembly, begin in zip(chains, assemblies, begins, strict=True):
        own[chain.name] = _derive_chain(chain, assembly, passed.times(begin / begins[home]), advice)
    whole = {"valves": train_report.valve_report(model)} if drive.valves else {}
    whole |= step | _temperature_values(drive)
    if len(chains) == 1:
        return own[""] | whole
    return {"chains": {name: found | step for name, found in own.items()}, "shafts": _shaft_values(model), **whole}


def _derive_chain(model: ChainModel, assembly: Assembly, passed: RunUp, step_advice: list[str]) -> dict[str, Any]:
    """Derived quantities of one chain with its driver's run-up, by name."""
    path, count = assembly.path, len(model.sprockets)
    preload = max(0.0, model.chain.mean_stiffness * path.pitch * assembly.strain)
    driver, speed = model.sprockets[model.driver], model.driver_speed
    moments = run_up.run_up_moments(model, passed)
    resting, running = statics.at_rest(model, assembly), statics.at_work(model, assembly, speed, moments[:, -1])
    strands = _strand_values(model, assembly, preload, resting, running, moments[:, -1])
    hardest = _hardest_pull(model, assembly, preload, passed, moments)
    working = path_at(model, running.arm_angle.tolist()) if model.arms and not running.failure else path
    mean_speed = model.chain.pitch * speed * driver.teeth / math.tau
    rated, hung = rating_values(model, strands, mean_speed), resting_sag(model, assembly, strands, resting)
    return {
        "links": model.chain.links,
        "pitch": model.chain.pitch,
        "elongation": path.pitch / model.chain.pitch - 1.0,
        "kind": model.chain.kind,
        "roller_mass": model.chain.mass,
        "size": model.chain.size,
        "breaking_load": model.chain.breaking_load,
        "driver": _driver_values(model, passed),
        "strength": strength_values(model, [strand["working_tension"] for strand in strands], hardest),
        "stiffness": model.chain.stiffness,
        "stiffness_is_estimate": model.chain.stiffness_is_estimate,
        **_links_and_joints(model),
        "chain_speed": speed * model.pitch_radius(model.driver),
        "mean_chain_speed": mean_speed,
        "rating": rated,
        "sag": hung,
        "critical_speeds": critical_speeds(model, path, strands, speed),
        "strain": assembly.strain,
        "nominal_strain": path.nominal_strain,
        "preload": preload,
        **_fault_and_advice_lines(model, assembly, strands, working, hardest, rating_advice(rated, hung) + step_advice),
        "sprockets": [
            {
                "name": model.sprockets[s].name,
                "teeth": model.sprockets[s].teeth,
                "pitch_radius": model.pitch_radius(s),
                "riding_radius": float(path.radius[s]),
                "tip_radius": model.tip_radius(s),
                "seat_angle": model.seat_angle(s),
                "wrap": float(path.wrap_angle[s]),
                "contact_stiffness": model.sprocket_stiffness(s),
                "catches": s in model.catching_sprockets(),
            }
            for s in range(count)
        ],
        "standing_preload": float(
            np.average([k["standing_tension"] for k in strands], weights=assembly.strand_links[: len(strands)])
        ),
        "strands": strands,
        "tensions_estimated": resting.failure or running.failure,
        "law": model.contact.sprocket.law,
        "rebound": contact_rebound(model.contact.sprocket),
        "friction": tooth_friction_coefficients(model).dynamic,
        "guides": _guide_values(model, working, strands, running),
        "arms": guide_report.arm_report(model, assembly, resting, running),
        "tensioners": guide_report.tensioner_report(model, assembly, resting, running),
        **({"shafts": train_report.shaft_report(model)} if model.own_shafts else {}),
        **({"gears": train_report.gear_report(model)} if model.gears else {}),
        **({"couplings": train_report.coupling_report(model, running)} if model.couplings else {}),
        "mounts": [
            {
                "name": sprocket.name,
                "kind": sprocket.mount.kind,
                "mass": moving_mass(sprocket),
                "frequencies": list(mount_frequencies(sprocket)),
                "working_travel": None if running.failure else (running.center[s] - sprocket.center).tolist(),
                "wheel_force": wheel_force(sprocket, speed * model.pitch_radius(model.driver) / model.pitch_radius(s)),
            }
            for s, sprocket in enumerate(model.sprockets)
            if has_active_mount(sprocket)
        ],
        "tooth_passing_frequency": speed * driver.teeth / (2.0 * math.pi),
    }


def _driver_values(model: ChainModel, passed: RunUp) -> dict[str, Any]:
    """Values of `check` on the driver at the start and at work."""
    speed, acceleration = passed.at(-1)
    prescribed = part_of_body(model, driving_body(model)).prescribed is not None
    return {
        "name": model.sprockets[model.driver].name,
        "prescribed": prescribed,
        "start": passed.at(0)[0],
        "speed": speed,
        "acceleration": acceleration,
    }


def _hardest_pull(
    model: ChainModel, assembly: Assembly, preload: float, passed: RunUp, moments: NDArray[Any]
) -> HardestPull | None:
    """Hardest pull on the chain on its way to work; None where none exceeds work's."""
    k = run_up.hardest_place(model, passed, moments)
    if k < 0:
        return None
    speed, acceleration = passed.at(k)
    found = statics.at_work(model, assembly, speed, moments[:, k])
    links = [int(n) for n in assembly.strand_links]
    tensions = working_tensions(model, preload, links, speed, moments[:, k]) if found.failure else found.tension
    return HardestPull(float(max(tensions)), speed, acceleration)


def _temperature_values(drive: Drive) -> dict[str, Any]:
    """Values of `check` on temperature, growth and oils, if set."""
    if drive.temperature is None:
        return {}
    found: dict[str, Any] = {of: expansion_factor(drive, of) - 1.0 for of in Expansion.model_fields}
    oils = {t.name: t.oil.viscosity for t in drive.tensioners if t.oil is not None}
    return {"temperature": {"temperature": drive.temperature, **found, "viscosity": oils}}


def _step_values(drive: Drive) -> dict[str, Any]:
    """Values of `check` on the time step and its limits."""
    return {
        "step": resolve_step(drive),
        "step_limit": step_limit(drive),
        "stiffest_part": stiffest_part(drive),
        "automatic_step": automatic_step(drive),
    }


def _shaft_values(model: Model) -> list[dict[str, Any]]:
    """Values of `check` on shared shafts: sprockets, speeds [rad/s], ratios."""
    ratios, speed = model.shaft_ratios, model.driver_speed
    return [
        {
            "name": shaft.name,
            "sprockets": [s.name for s in model.drive.sprockets if s.shaft == shaft.name],
            "ratio": ratios[shaft.name],
            "speed": ratios[shaft.name] * speed,
        }
        for shaft in model.drive.shafts
    ]


def _guide_values(
    model: ChainModel, path: ChainPath, strands: list[dict[str, Any]], running: Steady
) -> list[dict[str, Any]]:
    """Values of `check` on guides: contact, and the chain's touch at work."""
    pull = [strand["working_tension"] - running.centrifugal for strand in strands]
    return [
        {
            "name": guide.name,
            "contact_stiffness": model.guide_stiffness(g),
            "law": model.guide_contact(g).law,
            "rebound": contact_rebound(model.guide_contact(g)),
            "friction": guide_friction_coefficients(model, g).dynamic,
            "face_length": model.profile(g).face_length,
            "touch": guide_report.guide_touch(model, path, g, pull),
        }
        for g, guide in enumerate(model.guides)
    ]


def _fault_and_advice_lines(
    model: ChainModel,
    assembly: Assembly,
    strands: list[dict[str, Any]],
    working: ChainPath,
    hardest: HardestPull | None,
    rated: list[str],
) -> dict[str, list[str]]:
    """Layout faults, and advice on layout, rating and strength, by name."""
    path, strain = assembly.path, assembly.strain
    rules = layout_advice(model, path, [strand["working_tension"] for strand in strands], working, hardest)
    return {
        "layout": list(layout_faults(model, path)),
        "advice": [
            *strain_advice(model, strain),
            *rules,
            *rated,
            *train_report.motor_advice(model),
            *train_report.tie_advice(model),
        ],
    }


def _step_advice(values: dict[str, Any]) -> list[str]:
    """Advice of `check` on a time step too large for 1 %."""
    step, largest = values["step"], values["automatic_step"]
    if step <= largest * (1.0 + _ROUND):
        return []
    return [
        f"run.step: {step:.4g} s is {step / largest:.2f} of the largest step that keeps 1 %, {largest:.4g} s: largest "
        f'tensions come out higher, by a tenth and more toward {values["step_limit"]:.4g} s; take "auto"'
    ]


def _strand_values(
    model: ChainModel, assembly: Assembly, preload: float, resting: Steady, running: Steady, moments: NDArray[Any]
) -> list[dict[str, Any]]:
    """Values of `check` on strands, estimated without a steady state."""
    links = [int(n) for n in assembly.strand_links]
    still, working = resting.tension, running.tension
    if resting.failure:
        still = np.full(len(links), preload)
    if running.failure:
        working = np.array(working_tensions(model, preload, links, moments=moments))
    speed = math.sqrt(running.centrifugal * model.chain.pitch / model.chain.mass)
    lengths = [float(length) for length in assembly.path.strand_length]
    free = [assembly.path.free_lengths(k) for k in range(len(links))]
    guided = [string is not None for string in assembly.path.strings]
    return [
        {
            "name": name,
            "length": lengths[k],
            "links": links[k],
            "standing_tension": float(still[k]),
            "standing_frequency": moving_frequency(model, max(free[k]), float(still[k]), 0.0)
            if guided[k]
            else strand_frequency(model, links[k], float(still[k])),
            "working_tension": float(working[k]),
            "centrifugal_tension": running.centrifugal,
            "working_frequency": moving_frequency(model, max(free[k]), float(working[k]), speed),
            "free_lengths": list(free[k]),
            "working_displacement": None if running.failure else float(running.displacement[k]),
        }
        for k, name in enumerate(model.strand_names)
    ]


def table_lines(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of a text table, first column to the left."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    return [
        "  "
        + "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in (head, *rows)
    ]


def _size_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on the catalogue's data of a chain's size."""
    if values["size"] is None:
        return []
    chain = CHAINS[values["size"]]
    standard = f" ({chain.standard})" if chain.standard else ""
    lines = [f"size: {values['size']}{standard}, breaking load {1e-3 * values['breaking_load']:.4g} kN"]
    if chain.estimate:
        lines.append(f"  an ESTIMATE of the catalogue, {chain.estimate}")
    area = "d2 by half the width" if chain.kind == "silent" else "d2 b2 of ISO 606"
    lines += [*_strength_lines(values["strength"], area), *rating_lines(values["rating"])]
    if chain.kind == "silent":
        lines.append("rating: none; ASME B29.1 and ISO 10823 rate roller chains only")
    if values["stiffness_is_estimate"]:
        lines.append(
            f"stiffness: {values['stiffness']:.4g} N/m, an ESTIMATE good to a factor of three: "
            f"{100.0 * ELONGATION_AT_BREAKING_LOAD:g} % elongation at the breaking load"
        )
    return lines


def _strength_lines(found: dict[str, Any] | None, area: str) -> list[str]:
    """Report lines on safeties and pressure on a joint's `area`."""
    if found is None:
        return []
    way, passed = found["run_up"], ""
    if way is not None:
        at = f"{way['speed']:.4g} rad/s and {way['acceleration']:+.4g} rad/s^2"
        passed = f"{way['tension']:.4g} N on the way there, at {at}, "
    lines = [
        f"strength: {found['working']:.4g} N at work, {passed}{found['peak']:.4g} N with the loads at their peaks; "
        f"safeties: static {found['static_safety']:.3g} (at least {LEAST_STATIC:g}), "
        f"dynamic {found['dynamic_safety']:.3g} (at least {LEAST_DYNAMIC:g})",
        f"yield: links stay longer from about {1e-3 * found['yield_load']:.4g} kN on, {100.0 * YIELD:g} % of the "
        f"breaking load (Tsubaki), {found['yield_safety']:.3g} times those peaks",
        f"  none of these has {', '.join(found['left_out'])}",
    ]
    if found["joint_area"] is not None:
        lines.append(
            f"bearing: {1e-6 * found['pressure']:.4g} N/mm^2 at work on {1e6 * found['joint_area']:.4g} mm^2, "
            f"{area}, {1e-6 * found['peak_pressure']:.4g} at those peaks"
        )
    return lines


def _step_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on the time step and its limits."""
    step, limit, largest = values["step"], values["step_limit"], values["automatic_step"]
    silent = all(of["kind"] == "silent" for of in values.get("chains", {"": values}).values())
    single = "single pins" if silent else "single rollers"
    double = "not stable" if 2.0 * step >= limit else f"{2.0 * step / largest:.2f} of the largest, and stable"
    return [
        f'step: {step:.4g} s; the largest that keeps 1 % in means and losses is {largest:.4g} s ("auto")',
        f"  with it the largest forces on {single}, and what single contacts dissipate, keep 5 to 8 %",
        f"  half of that, {0.5 * largest:.4g} s, keeps 1 % in the largest tension, too, and takes twice as long",
        f"  double the step is {double}: no step from {limit:.4g} s on is, because of {values['stiffest_part']}",
    ]


def _driver_lines(found: dict[str, Any]) -> list[str]:
    """Report line on a driver that motors and loads turn."""
    if found["prescribed"]:
        return []
    gains, start = found["acceleration"], f'speed: "{found["name"]}" has {found["start"]:.4g} rad/s at the start'
    if gains < 0.0:
        return [f"{start}, which counts as work, and slows down by {-gains:.4g} rad/s^2"]
    end = f"where the run ends, and gains {gains:.4g} rad/s^2" if gains else "where motors and loads balance"
    return [f"{start} and {found['speed']:.4g} rad/s at work, {end}"]


def _joint_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on joints, outer links and play that are set."""
    lines = []
    if "joint" in values:
        joint = values["joint"]
        at_rest = "" if joint["static_friction"] is None else f", {joint['static_friction']:g} at rest"
        pin = f"pins of {1e3 * joint['pin_radius']:.4g} mm radius, factor {joint['factor']:.4g}"
        lines.append(f"joints: friction {joint['friction']:g}{at_rest}, {pin}")
    if "outer" in values:
        outer = values["outer"]
        stretched = f"{100.0 * outer['elongation']:.3g} % longer than the pitch"
        lines.append(f"outer links: {stretched}, {outer['stiffness']:.4g} N/m, {outer['damping']:.4g} N s/m")
    if "play" in values:
        lines.append(f"play: {1e3 * values['play']:.4g} mm a link")
    return lines


def _sprocket_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on sprockets."""
    silent = values["kind"] == "silent"
    angle = "gap angle" if silent else "seat angle"
    table = table_lines(
        ("sprocket", "teeth", "pitch radius", "tip radius", "wrap", angle, "contact stiffness"),
        [
            (
                s["name"],
                str(s["teeth"]),
                f"{s['pitch_radius']:.5f} m",
                f"{s['tip_radius']:.5f} m",
                f"{math.degrees(s['wrap']):.2f} deg",
                f"{math.degrees(math.pi - s['seat_angle'] if silent else s['seat_angle']):.1f} deg",
                f"{s['contact_stiffness']:.4g} N/m^n",
            )
            for s in values["sprockets"]
            if s["teeth"] > 1
        ],
    )
    rubs = f", friction {values['friction']:g}" if values["friction"] else ""
    part = "link" if silent else "roller"
    teeth = f"teeth: {values['law']}, a free {part} rebounds with {values['rebound']:.3f} of its speed{rubs}"
    return ["", *table, "", teeth]


def _strand_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on strands."""
    table = table_lines(
        ("strand", "length", "links", "standing", "", "at work", "of it m v^2/p", "", "off its line"),
        [
            (
                k["name"],
                f"{k['length']:.4f} m",
                str(k["links"]),
                f"{k['standing_tension']:.4g} N",
                f"{k['standing_frequency']:.3g} Hz",
                f"{k['working_tension']:.4g} N",
                f"{k['centrifugal_tension']:.4g} N",
                f"{k['working_frequency']:.3g} Hz",
                "-" if k["working_displacement"] is None else f"{1e3 * k['working_displacement']:+.3g} mm",
            )
            for k in values["strands"]
        ],
    )
    title = [
        "mean tension and first transverse frequency of each strand: standing, seated and unloaded; at work, all",
        "loads on and the chain moving, no vibration, no friction; off its line: mid-strand, to the left of travel:",
    ]
    if values["tensions_estimated"]:
        title.append(f"ESTIMATES, without seats, mounts and weight: {values['tensions_estimated']}")
    return ["", *title, *table]


def _guide_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on contacts with guides."""
    if not values["guides"]:
        return []
    head: tuple[str, ...] = ("guide-bar", "contact stiffness", "law", "rebound")
    rows: list[tuple[str, ...]] = [
        (g["name"], f"{g['contact_stiffness']:.4g} N/m^n", g["law"], f"{g['rebound']:.3f}") for g in values["guides"]
    ]
    if any(g["friction"] for g in values["guides"]):
        head = (*head, "friction")
        rows = [(*row, f"{g['friction']:g}") for row, g in zip(rows, values["guides"], strict=True)]
    return ["", *table_lines(head, rows)]


def _touch_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on guides that the chain lies on."""
    rows: list[tuple[str, ...]] = [
        (
            g["name"],
            touch["strand"],
            "{:.1f} to {:.1f} of {:.1f} mm".format(*(1e3 * x for x in (*touch["places"], g["face_length"]))),
            f"{math.degrees(touch['wrap']):.2f} deg",
            f"{touch['load']:.4g} N/m",
            f"{touch['force']:.4g} N",
        )
        for g in values["guides"]
        if (touch := g["touch"]) is not None
    ]
    if not rows:
        return []
    title = "what the chain lies on at work, and how it loads it (T - m v^2/p over the radius; in all):"
    return ["", title, *table_lines(("guide", "strand", "touched", "wrapped", "load", "force"), rows)]


def _cell_texts(values: list[float | None], text: str) -> tuple[str, ...]:
    """Texts of values for a report's table, "-" for None."""
    return tuple("-" if value is None else text.format(value + 0.0) for value in values)


def _arm_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on arms and tensioners."""
    lines: list[str] = []
    if values["arms"]:
        rows = [
            (
                a["name"],
                *_cell_texts([_degrees(a[key]) for key in ("angle", "standing_angle", "working_angle")], "{:+.3f} deg"),
                "-" if a["stops"] is None else "{:.6g} to {:.6g} deg".format(*map(math.degrees, a["stops"])),
                a["on_stop"] or "",
            )
            for a in values["arms"]
        ]
        lines += ["", *table_lines(("arm", "at assembly", "standing", "at work", "stops", "on its stop"), rows)]
    if values["tensioners"]:
        rows = [
            (
                t["name"],
                t["on"],
                *_cell_texts(
                    [_thousandths(t[key]) for key in ("extension", "standing_extension", "working_extension")],
                    "{:+.3f} mm",
                ),
                "-" if t["static_pressure"] is None else f"{1e-5 * t['static_pressure']:.4g} bar",
                *_cell_texts([t["working_force"] if t["working_force"] is not None else t["force"]], "{:.4g} N"),
            )
            for t in values["tensioners"]
        ]
        head = ("tensioner", "on", "at assembly", "standing", "at work", "static pressure", "static force")
        lines += ["", *table_lines(head, rows)]
    return lines


def _thousandths(value: float | None) -> float | None:
    """A value in thousandths of its unit; None stays."""
    return None if value is None else 1e3 * value


def _degrees(value: float | None) -> float | None:
    """An angle [rad] in degrees; None stays."""
    return None if value is None else math.degrees(value)


def _train_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on shafts, gears, couplings and valves."""
    lines: list[str] = []
    if "shafts" in values:
        rows = [
            (
                s["name"],
                ", ".join(s["with"]) or "-",
                *_cell_texts([s["speed"]], "{:.4g} rad/s"),
                *_cell_texts([s["inertia"]], "{:.4g} kg m^2"),
                *_cell_texts([s["motor_at_rest"], s["motor_at_work"]], "{:.4g} N m"),
            )
            for s in values["shafts"]
        ]
        lines += [
            "",
            *table_lines(("shaft", "as one with", "at work", "inertia seen", "motor at rest", "at work"), rows),
        ]
    if "gears" in values:
        rows = [
            (g["name"], " and ".join(g["between"]), "{} to {}".format(*g["teeth"]), f"{g['ratio']:+.6g}")
            for g in values["gears"]
        ]
        lines += ["", *table_lines(("gears", "between", "teeth", "second over first"), rows)]
    if "couplings" in values:
        rows = [
            (
                c["name"],
                " and ".join(c["between"]) + (", one way" if c["freewheel"] else ""),
                f"{c['frequency']:.4g} Hz",
                f"{c['damping_ratio']:.3g}",
                f"{1e3 * c['lash']:.4g} mrad",
                ", ".join(f"{ratio:.4g}" if ratio else "open" for ratio in c["ratios"] or (1.0,)),
                *_cell_texts([c["clutch"]], "{:.4g} N m"),
                *_cell_texts([_thousandths(c["working_twist"])], "{:+.4g} mrad"),
                *_cell_texts([c["working_torque"]], "{:+.4g} N m"),
            )
            for c in values["couplings"]
        ]
        head = ("coupling", "between", "own frequency", "damping ratio", "lash", "ratio", "clutch",
                "twist at work", "torque at work")  # fmt: skip
        lines += ["", *table_lines(head, rows)]
    lines += _valve_lines(values)
    return lines


def _valve_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on valves."""
    rows: list[tuple[str, ...]] = [
        (
            v["name"],
            v["on"],
            str(v["count"]),
            f"{1e3 * v['lift']:.4g} mm",
            f"{v['spring_force']:.4g} N",
            f"{v['float_speed']:.4g} rad/s",
            *_cell_texts([v["driver_float_speed"]], "{:.4g} rad/s"),
        )
        for v in values.get("valves", ())
    ]
    head = ("valves", "on", "count", "lift", "spring at most", "lift off above", "of the driver")
    return ["", *table_lines(head, rows)] if rows else []


def _mount_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on mounts of sprockets."""
    if not values["mounts"]:
        return []
    table = table_lines(
        ("sprocket", "mount", "moving mass", "own frequency", "at work, x and y", "wheel's centrifugal force"),
        [
            (
                m["name"],
                m["kind"],
                f"{m['mass']:.4g} kg" if m["mass"] else "-",
                ", ".join(f"{f:.4g} Hz" for f in m["frequencies"]) or "-",
                "-"
                if m["working_travel"] is None
                else "{:+.3g}, {:+.3g} mm".format(*(round(1e3 * x, 3) + 0.0 for x in m["working_travel"])),  # no -0
                f"{m['wheel_force']:.4g} N" if m["wheel_force"] else "-",
            )
            for m in values["mounts"]
        ],
    )
    return ["", "moving centers and balance wheels; frequencies of the mount without the chain:", *table]


def report(values: dict[str, Any]) -> str:
    """Report of `check` on a drive's derived quantities, for a terminal."""
    if "chains" in values:
        return "\n".join([*_temperature_lines(values), *_text_of_chains(values)])
    return "\n".join([*_temperature_lines(values), *_chain_lines(values), *_step_lines(values)])


def _temperature_lines(values: dict[str, Any]) -> list[str]:
    """Report line on the temperature, if set."""
    if "temperature" not in values:
        return []
    given = values["temperature"]
    grown = ", ".join(f"{of} {100.0 * given[of]:+.3f} %" for of in Expansion.model_fields)
    oils = "".join(f", oil of {name} {1e6 * oil:.4g} mm^2/s" for name, oil in given["viscosity"].items())
    return [f"temperature: {given['temperature']:g} degrees C, {grown} against {REFERENCE:g}{oils}; all below is there"]


def _text_of_chains(values: dict[str, Any]) -> list[str]:
    """Report lines on several chains."""
    lines: list[str] = []
    for name, chain in values["chains"].items():
        lines += [f'=== chain "{name}"', *_chain_lines(chain), ""]
    rows: list[tuple[str, ...]] = [
        (s["name"], ", ".join(s["sprockets"]) or "-", f"{s['ratio']:.6g}", f"{s['speed']:.5g} rad/s")
        for s in values["shafts"]
    ]
    lines += ["=== all chains", *table_lines(("shaft", "sprockets", "over the driver", "speed"), rows)] if rows else []
    return [*lines, *_valve_lines(values), *_step_lines(values)]


def check_findings(drive: Drive) -> list[str]:
    """Lines `LAYOUT` and `LOOK AT` of `check` for a drive, or the line that refuses it."""
    try:
        return finding_lines(derived_quantities(drive))
    except DriveError as error:
        return [str(error)]


def finding_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on layout faults and advice."""
    if "chains" in values:
        each = values["chains"].items()
        return [f'chain "{name}": {line}' for name, chain in each for line in finding_lines(chain)]
    return [
        *(f"LAYOUT: {finding}" for finding in values["layout"]),
        *(f"LOOK AT {finding}" for finding in values["advice"]),
    ]


def fit_and_findings(values: dict[str, Any]) -> list[str]:
    """Report lines on the chain's fit, layout faults and advice."""
    if "chains" in values:
        each = values["chains"].items()
        return [f'chain "{name}": {line}' for name, chain in each for line in fit_and_findings(chain)]
    state = "taut" if values["strain"] >= 0.0 else "slack"
    return [
        f"fit: {state}, strain {values['strain']:+.3e}, preload {values['preload']:.4g} N at assembly, "
        f"{values['standing_preload']:.4g} N once seated",
        *finding_lines(values),
    ]


def _chain_lines(values: dict[str, Any]) -> list[str]:
    """Report lines on a chain, and what it runs over."""
    worn = f", worn by {100.0 * values['elongation']:.3g} %" if abs(values["elongation"]) > 1e-12 else ""
    part = "link" if values["kind"] == "silent" else "roller"
    return [
        f"chain: {values['links']} links of {1e3 * values['pitch']:g} mm{worn}, "
        f"{values['roller_mass']:.4g} kg a {part}, {values['chain_speed']:.4g} m/s",
        *_driver_lines(values["driver"]),
        *_size_lines(values),
        *_joint_lines(values),
        *fit_and_findings(values),
        *_sprocket_lines(values),
        *_strand_lines(values),
        *strand_lines(values["sag"], values["critical_speeds"]),
        *_guide_lines(values),
        *_touch_lines(values),
        *_arm_lines(values),
        *_train_lines(values),
        *_mount_lines(values),
        "",
        f"tooth-passing frequency: {values['tooth_passing_frequency']:.4g} Hz",
    ]
