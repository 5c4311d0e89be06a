"""The engineering report of a run as an HTML page."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.argument_checks import check_arguments
from warpchain.assembly.frequencies import excited_orders
from warpchain.drive import Drive, dumps_drive
from warpchain.drive.body_ties import rotation_owners
from warpchain.drive.plugins import short_plugin_words
from warpchain.errors import ArchiveError, SimulationError
from warpchain.files import refusals_as_errors, write_text_file
from warpchain.results.chains import chain_metrics_row, chain_trajectories
from warpchain.results.engineering_report import EngineeringReport, Wear, metrics_window
from warpchain.results.judgement import OK
from warpchain.results.losses import friction_power_over_speed
from warpchain.results.metric_columns import title_of_metric
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.view import html
from warpchain.view.figures import chain_figures, part_figures, shaft_figures, sweep
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.figures.figure_style import driver_speed_text, run_line, strand_label
from warpchain.view.recorded_variants import recorded_variant
from warpchain.view.report import report_tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]


def figure_html(figure: Figure | None, words: str) -> str:
    """HTML of a report's figure, "" for None."""
    return "" if figure is None else html.zoomed_picture_html(figure, words)


Chains = Mapping[str, tuple[EngineeringReport, Row]]
"""Reports of chains with rows of metrics, by name, "" of an only one."""


def summary_section(chains: Chains, row: Row) -> html.PageSection:
    """Section in short of a run's report: validity, key numbers."""
    status = row.get("status") or "unknown"
    boxes = [("" if status == "unknown" else status, status, "status")]
    for name, words in (("tension_mean", "mean tension"), ("tension_max", "largest tension")):
        held = {chain: own[name] for chain, (_, own) in chains.items() if own.get(name) is not None}
        if held:
            chain = max(held, key=lambda one: held[one])
            boxes.append(("", report_tables.quantity_text(held[chain], "N"), f"{words}, {chain}".rstrip(", ")))
    if row.get("efficiency"):  # of a drive with a load
        boxes.append(("", f"{100.0 * row['efficiency']:.2f} %", "efficiency"))
    least = _least_jump_margins(chains)
    if least:
        chain = min(least, key=lambda one: least[one])
        words = f"least margin to tooth jump, {chain}".rstrip(", ")
        boxes.append(("", report_tables.climb_share_text(least[chain]), words))
    why = html.bullets_html([f"{status}: {row['reason']}"]) if row.get("reason") else ""
    note = "" if status == OK else html.paragraph_html("Do not use these numbers: the run is not valid (reason above).")
    return html.page_section("summary", "In short", html.key_numbers_html(boxes), why, note)


def _least_jump_margins(chains: Chains) -> dict[str, float]:
    """Least margin to tooth jump over the climb, by chain."""
    margins = {
        chain: [value for name, value in found.metrics().items() if name.endswith(".jump_margin_relative")]
        for chain, (found, _) in chains.items()
    }
    return {chain: min(values) for chain, values in margins.items() if values}


def drive_section(chains: Chains, whole: Trajectory, row: Row, info: RunInfo) -> html.PageSection:
    """Section of a run's report on the whole drive: window, sums over chains, picture."""
    found = next(iter(chains.values()))[0]
    window = f"window of the metrics: {found.start:.4g} to {found.end:.4g} s, {len(found.part.time)} frames"
    step = "" if info.step is None else f", step {report_tables.quantity_text(info.step, 's')}"
    ran = f"warpchain {info.version} on {info.device}, {info.precision}{step}, {info.ended}"
    lines = [run_line(whole), window, *_energy_lines(row), ran]
    table = report_tables.chains_table(chains, _least_jump_margins(chains)) if len(chains) > 1 else ""
    losses = report_tables.losses_table(whole.drive, row)
    picture = figure_html(drive_figure(whole), "the whole drive with forces on the chain")
    return html.page_section("drive", "The run and the drive", html.bullets_html(lines), table, losses, picture)


def _energy_lines(row: Row) -> list[str]:
    """Line of a report on what the energy balance misses, if known."""
    missed = row.get("energy_residual_relative")
    words = title_of_metric("energy_residual_relative")
    return [] if missed is None else [f"energy balance: {100.0 * missed:.2g} % ({words})"]


def tension_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on the chain: tension, displacement, spectra, contact angles."""
    yield html.paragraph_html(
        "Each row of the picture is the maximum tension of every link in a time bin; spectra are of the latter "
        "half, over orders of the driver's revolution."
    )
    yield figure_html(chain_figures.tension_waterfall_figure(found.whole), "tension of all links over time")
    yield figure_html(chain_figures.strand_displacement_figure(found.whole), "transverse displacement of each strand")
    yield figure_html(chain_figures.order_spectrum_figure(found.whole), "order spectra")
    yield figure_html(chain_figures.contact_angle_figure(found.whole), "contact force against angle on the sprockets")


def hub_force_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section on hub forces."""
    exact = all(row.get(f"{sprocket.name}.hub_force_max") is not None for sprocket in found.model.sprockets)
    yield html.paragraph_html(
        "Force of the chain on each shaft. The table is of "
        + ("every step of the window, tooth friction included" if exact else "the frames")
        + "; the picture has the force at each frame, without tooth friction, and its mean as an arrow."
    )
    yield report_tables.hub_force_table(found, row)
    yield figure_html(shaft_figures.hub_force_figure(found), "hub forces as hodographs")


def timing_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on shafts' phase errors."""
    name = found.model.sprockets[found.model.driver].name
    yield html.paragraph_html(
        f"Where each shaft stands against where {name} and the teeth put it, from where it stood when the recording "
        f"began, in degrees of {name}; below 0 where it lags. Amplitudes are of the window's last whole cycles of two "
        "revolutions."
    )
    yield report_tables.phase_error_table(found)
    yield figure_html(shaft_figures.phase_error_figure(found), "phase errors over time")
    yield figure_html(shaft_figures.phase_error_order_figure(found), "phase errors by order")


def cycle_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on the driver's working cycle."""
    figure = shaft_figures.driver_cycle_figure(found)
    if figure is None:
        raise SimulationError("The window has no whole cycle of two revolutions at about one speed.")
    yield figure_html(figure, "means and envelopes over two turns of the driver")


def order_cut_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on orders in a run-up."""
    cut = sweep.run_up_cuts(found)
    if not cut:
        raise SimulationError(
            f"The recording has no {sweep.FEWEST_BLOCKS} blocks of {sweep.BLOCK_TURNS:g} revolutions over speeds that "
            f"differ by {100.0 * (sweep.LEAST_RISE - 1.0):.0f} %: orders over one speed are in the spectra above."
        )
    yield html.paragraph_html("Amplitudes of orders of the driver against its speed, over the whole recording.")
    for title, (unit, of) in cut.items():
        yield html.heading_html(title.capitalize())
        yield figure_html(sweep.order_cuts_figure(found.model, title, unit, of), f"order cuts of the {title}")


def guide_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section on guides."""
    yield html.paragraph_html(
        "Mean normal force per length of the face, the largest force of one roller there, and force times sliding "
        "speed per length. Over the width of the contact these are a pressure and the p v of bearing tables; friction "
        "turns the share mu of p v into heat."
    )
    yield report_tables.guide_load_table(found, found.metrics(), row)
    for g, guide in enumerate(found.model.guides):
        picture = figure_html(part_figures.guide_load_figure(found, g), f"load of {guide.name} over its length")
        yield html.folded_html(f"{guide.name}: load over its length", picture)


def friction_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section on friction power."""
    figure = part_figures.friction_power_figure(found)
    if figure is None:
        raise SimulationError("Nothing rubs in this drive.")
    yield report_tables.friction_power_table(found, row)
    yield figure_html(figure, "friction power by group")


def safety_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section on tooth jump, slack strands and untouched guides."""
    climbing = "pins" if found.model.chain.is_silent else "rollers"
    yield html.paragraph_html(
        f"What {climbing} inside the wraps still had to climb to where the flanks end (100 % in a seat, 0 % where the "
        "chain jumps), and for how long strands carry no tension in their middles and guides are not touched."
    )
    metrics = found.metrics()
    rows = [[name, report_tables.climb_share_text(metrics[f"{name}.jump_margin_relative"]),
             report_tables.quantity_text(metrics[f"{name}.jump_margin"], "m"), str(row.get(f"{name}.slips", ""))]
            for name in (sprocket.name for sprocket in found.model.sprockets)
            if f"{name}.jump_margin" in metrics]  # fmt: skip
    yield html.table_html(["sprocket", "least margin over the climb", "least margin", "teeth jumped"], rows)
    idle = [[strand_label(name), "no tension in its middle", f"{100.0 * metrics[f'{name}.slack_time']:.2f} %"]
            for name in found.model.strand_names if f"{name}.slack_time" in metrics]  # fmt: skip
    idle += [[guide.name, "not touched", f"{100.0 * metrics[f'{guide.name}.off_time']:.2f} %"]
             for guide in found.model.guides if f"{guide.name}.off_time" in metrics]  # fmt: skip
    yield html.table_html(["part", "is", "share of time"], idle)
    yield figure_html(shaft_figures.jump_margin_figure(found), "margin to tooth jump over time")


def wear_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on joints' wear."""
    if found.joint_wear is None:
        raise SimulationError("The joints have no pin radius: give chain.size or chain.joint.pin_radius.")
    metrics = found.metrics()
    rows = [
        ["sliding speed of a joint", report_tables.quantity_text(metrics["joints.sliding_speed"], "m/s")],
        ["force times sliding speed", report_tables.quantity_text(metrics["joints.loaded_sliding"], "W")],
        ["friction power of a joint", report_tables.quantity_text(metrics["joints.friction_each"], "W")],
    ]
    law = found.wear_law
    if found.elongation_rate is not None and found.joint_area is not None and found.elongation_rate > 0.0:
        hours = 0.01 / (3600.0 * found.elongation_rate)
        rows += [
            ["Archard's coefficient k", f"{law.coefficient:.3g} m\u00b2/N"],
            ["bearing area of a joint", f"{1e6 * found.joint_area:.4g} mm\u00b2"],
            ["elongation in 1,000 hours", f"{3.6e8 * found.elongation_rate:.3g} %"],
            ["hours to 1 %", html.engineering_number(hours, 3)],
        ]
    yield html.paragraph_html(
        "Means of all joints over the window. The forecast is proportional to k, which lubrication and surfaces change "
        "a hundredfold: 2e-16 m\u00b2/N is an oiled industrial chain's, hardened pins in engine oil have some 4e-18. "
        "Calibrate it by a measured chain (docs/wear.md)."
    )
    if found.joint_area is None:
        yield html.paragraph_html("No forecast: neither a size of chain nor a bearing area is given.", muted=True)
    yield html.table_html(["of a joint", "value"], rows)
    yield figure_html(part_figures.joint_wear_figure(found), "loaded sliding of every joint")


def body_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section on arms, tensioners, shafts, couplings and valves."""
    for kind, of in part_figures.BODY_LISTS.items():
        channels = part_figures.body_channels(found.part, kind)
        for k, part in enumerate(getattr(found.model, of)):
            if channels and part.name not in found.alike:
                yield html.heading_html(part.name)
                yield report_tables.body_motion_table(found, channels, k)
                yield (
                    html.paragraph_html(line)
                    if kind == "tensioner" and (line := report_tables.check_valve_text(found, k))
                    else ""
                )
                yield figure_html(part_figures.body_figure(found, kind, k), f"what {part.name} does")
    names = [part.name for of in part_figures.BODY_LISTS.values() for part in getattr(found.model, of)]
    tables = report_tables.metric_tables(found.model, row, found.alike)
    for name in names:
        if name in tables:
            yield html.heading_html(f"{name}, over the window at every step")
            yield tables[name]


def probe_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of a report's section on probes."""
    for probe in found.model.probes:
        yield html.heading_html(probe.name)
        radius = probe.radius or found.model.chain.pitch
        place = f"({probe.at[0]:g}, {probe.at[1]:g}) m"
        yield html.paragraph_html(
            f"The link that passes {place} within {report_tables.quantity_text(radius, 'm')}.", muted=True
        )
        yield figure_html(part_figures.probe_figure(found, probe.name), f"what {probe.name} sees")


def metric_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of a report's section with all metrics."""
    yield html.paragraph_html(
        "Over the window at every step, and of the frames in it; docs/metrics.md says how each is formed."
    )
    for name, rows in report_tables.metric_tables(found.model, {**row, **found.metrics()}, found.alike).items():
        yield html.folded_html(strand_label(name), rows)


SectionParts = Callable[[EngineeringReport, Row], Iterator[str]]
RUN_SECTIONS: tuple[tuple[str, str, SectionParts, Callable[[EngineeringReport], bool]], ...] = (
    ("tension", "Chain", tension_parts, lambda found: True),
    ("hubs", "Hub forces", hub_force_parts, lambda found: True),
    ("timing", "Timing", timing_parts, lambda found: True),
    ("cycle", "Cycle of two turns", cycle_parts, lambda found: bool(excited_orders(found.model))),
    ("speed", "Orders over speed", order_cut_parts, lambda found: True),
    ("guides", "Guides", guide_parts, lambda found: bool(found.model.guides)),
    (
        "bodies",
        "Arms, tensioners, shafts",
        body_parts,
        lambda found: any(getattr(found.model, of) for of in part_figures.BODY_LISTS.values()),
    ),
    ("friction", "Friction", friction_parts, lambda found: True),
    ("safety", "Tooth jump, slack", safety_parts, lambda found: True),
    ("wear", "Wear", wear_parts, lambda found: True),
    ("probes", "Probes", probe_parts, lambda found: bool(found.model.probes)),
    ("metrics", "All metrics", metric_parts, lambda found: True),
)
"""Sections of a report: anchor, title, HTML function, whether a drive has it."""


def variants_friction_html(run: Run) -> str:
    """HTML figure of friction power over a run's variants' speeds, or ""."""
    known = friction_power_over_speed(run) if len(run.drives) > 2 else None
    return (
        ""
        if known is None
        else figure_html(part_figures.variants_friction_figure(run.drives[0], *known), "friction power over speed")
    )


def run_sections(found: EngineeringReport, row: Row, run: Run) -> list[html.PageSection]:
    """Folded sections of a report on one chain, and on those that cannot be formed."""
    sections, absent = [], []
    for name, title, parts, has in RUN_SECTIONS:
        if not has(found):
            continue
        made: list[str] = []
        try:
            made.extend(parts(found, row))
        except SimulationError as error:
            made += [html.paragraph_html(str(error), muted=True)] if made else []
            if not made:
                absent.append(f"{title}: {error}")
        if name == "friction" and (picture := variants_friction_html(run)):
            made += [html.heading_html("All variants of the run"), picture]
        sections.append(html.page_section(name, title, *made, folded=True))
    shown = [section for section in sections if not section.is_empty]
    left = html.page_section("absent", "Left out", html.bullets_html(absent) if absent else "", folded=True)
    return [*shown[:-1], *([] if left.is_empty else [left]), *shown[-1:]]


def chain_section(name: str, found: EngineeringReport, row: Row, run: Run) -> html.PageSection:
    """Folded section of a report on one of several chains."""
    boxes = [
        ("", report_tables.quantity_text(row[metric], "N"), words)
        for metric, words in (("tension_mean", "mean tension"), ("tension_max", "largest tension"))
        if row.get(metric) is not None
    ]
    inside = [
        section._replace(name=f"{name} {section.name}", title=f"{name}: {section.title}").section_html()
        for section in run_sections(found, row, run)
    ]
    about = html.paragraph_html(run_line(found.whole))
    return html.page_section(name, name, about, html.key_numbers_html(boxes), *inside, folded=True)


def run_heading(found: EngineeringReport) -> str:
    """Heading of a run's report: driver and mean speed."""
    return f"Chain drive, {driver_speed_text(found.whole)}"


def run_report_html(
    source: Run | str | Path, variant: int | None = None, title: str | None = None, wear: Wear | None = None
) -> str:
    """HTML of a recorded variant's engineering report; see `report`."""
    chosen = recorded_variant(source, variant)
    row, run = chosen.run.metrics.to_pylist()[chosen.run.row_of(chosen.index)], chosen.run
    alike = rotation_owners(chosen.trajectory.drive)
    chains = {
        name: (EngineeringReport(part, *metrics_window(row, part), wear, alike), chain_metrics_row(row, name))
        for name, part in chain_trajectories(chosen.trajectory).items()
    }
    first, first_row = next(iter(chains.values()))
    if len(chains) > 1:
        rest = [chain_section(name, *of, run) for name, of in chains.items()]
    else:
        rest = run_sections(first, first_row, run)
    sections = [summary_section(chains, row), drive_section(chains, chosen.trajectory, row, run.info), *rest]
    about = _about_lines(source, chosen.trajectory.drive, run.info)
    if len(run.drives) > 1:
        about.insert(0, f"variant {chosen.index} of {len(run.drives)}")
    return html.page_html(title or run_heading(first), sections, about=about)


def _about_lines(source: Run | str | Path, drive: Drive, info: RunInfo) -> list[str]:
    """Lines on what a report is about: file, digest, date."""
    digest = hashlib.sha256(dumps_drive(drive).encode()).hexdigest()[:DIGEST_LETTERS]
    lines = [f"drive {digest} (SHA-256 of its values)", _date_text(info.created)]
    if not isinstance(source, Run):
        with Path(source).open("rb") as file:
            whole = hashlib.file_digest(file, "sha256").hexdigest()
        lines.insert(0, f"{Path(source).name} (SHA-256 {whole[:DIGEST_LETTERS]})")
    lines += [] if info.plugins is None else [f"with plug-ins: {short_plugin_words(info.plugins)}"]
    return [line for line in lines if line]


def _date_text(iso: str) -> str:
    """Text of an ISO 8601 UTC time in a report, or ""."""
    return f"{iso[:10]} {iso[11:16]} UTC" if iso else ""


DIGEST_LETTERS = 16


@check_arguments(SimulationError)
def report(
    source: Run | str | Path,
    path: str | Path,
    variant: int | None = None,
    title: str | None = None,
    wear: Wear | None = None,
) -> Path:
    """Writes the engineering report of a recorded run as one HTML page; returns its path.

    Args:
        source: a run, or an archive's path.
        path: the page's; one of that name is replaced.
        variant: None is the first recorded.
        title: heading of the page; None says what was run.
        wear: how the joints wear.

    Raises:
        ArchiveError: an archive that cannot be read, or a page that cannot be written.
        SimulationError: a variant that was not recorded, or a channel without which no drive can be drawn.
    """
    text = run_report_html(source, variant, title, wear)
    target = Path(path)
    with refusals_as_errors(target, ArchiveError):
        write_text_file(target, text)
    return target
