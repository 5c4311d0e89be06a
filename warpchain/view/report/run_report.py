"""The engineering report of a run as an HTML page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.argument_checks import check_arguments
from warpchain.assembly.frequencies import excited_orders
from warpchain.drive.body_ties import rotation_owners
from warpchain.errors import ArchiveError, SimulationError
from warpchain.files import refusals_as_errors, write_text_file
from warpchain.results.chains import chain_metrics_row, chain_trajectories
from warpchain.results.engineering_report import EngineeringReport, Wear, metrics_window
from warpchain.results.judgement import OK
from warpchain.results.losses import friction_power_over_speed
from warpchain.results.run import Run, RunInfo
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
    """A report's figure as HTML; "" for None."""
    return "" if figure is None else html.picture_html(figure, words)


def summary_section(found: EngineeringReport, row: Row, info: RunInfo) -> html.PageSection:
    """The report's section of status, key numbers, settings and picture."""
    status = row.get("status") or "unknown"
    boxes = [("" if status == "unknown" else status, status, "status")]
    metrics = found.metrics()
    for name, unit, words in (
        ("tension_mean", "N", "mean tension"),
        ("tension_max", "N", "largest tension"),
        ("efficiency", "%", "efficiency"),
    ):
        if row.get(name) is not None:
            value = f"{100.0 * row[name]:.2f} %" if unit == "%" else report_tables.quantity_text(row[name], unit)
            boxes.append(("", value, words))
    least = [value for name, value in metrics.items() if name.endswith(".jump_margin_relative")]
    if least:
        boxes.append(("", report_tables.climb_share_text(min(least)), "least margin to tooth jump"))
    cells = "".join(
        f'<div class="{kind}"><b>{html.escape(value)}</b>{html.escape(words)}</div>' for kind, value, words in boxes
    )
    window = f"window of the metrics: {found.start:g} to {found.end:g} s, {len(found.part.time)} frames"
    lines = [run_line(found.whole), window]
    if row.get("reason"):
        lines.insert(0, f"{status}: {row['reason']}")
    step = "" if info.step is None else f", step {report_tables.quantity_text(info.step, 's')}"
    lines.append(f"warpchain {info.version} on {info.device}, {info.precision}{step}, {info.created}, {info.ended}")
    note = "" if status == OK else html.paragraph_html("Do not use these numbers: the run is not valid (reason above).")
    picture = figure_html(drive_figure(found.whole), "the drive with forces on the chain")
    return html.page_section(
        "summary", "In short", f'<div class="counts">{cells}</div>', html.bullets_html(lines), note, picture
    )


def tension_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of the report's section on the chain: tension, displacement, spectra, contact angles."""
    yield html.paragraph_html(
        "Each row of the picture is the maximum tension of every link in a time bin; spectra are of the latter "
        "half, over orders of the driver's revolution."
    )
    yield figure_html(chain_figures.tension_waterfall_figure(found.whole), "tension of all links over time")
    yield figure_html(chain_figures.strand_displacement_figure(found.whole), "transverse displacement of each strand")
    yield figure_html(chain_figures.order_spectrum_figure(found.whole), "order spectra")
    yield figure_html(chain_figures.contact_angle_figure(found.whole), "contact force against angle on the sprockets")


def hub_force_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of the report's section on hub forces."""
    exact = all(row.get(f"{sprocket.name}.hub_force_max") is not None for sprocket in found.model.sprockets)
    yield html.paragraph_html(
        "Force of the chain on each shaft. The table is of "
        + ("every step of the window, tooth friction included" if exact else "the frames")
        + "; the picture has the force at each frame, without tooth friction, and its mean as an arrow."
    )
    yield report_tables.hub_force_table(found, row)
    yield figure_html(shaft_figures.hub_force_figure(found), "hub forces as hodographs")


def timing_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of the report's section on timing: shafts' phase errors."""
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
    """HTML of the report's section on the driver's cycle of two turns."""
    figure = shaft_figures.driver_cycle_figure(found)
    yield figure_html(figure, "means and envelopes over two turns of the driver")
    if figure is None:
        yield html.paragraph_html("The window has no whole cycle of two revolutions at about one speed.", muted=True)


def order_cut_parts(found: EngineeringReport, _: Row) -> Iterator[str]:
    """HTML of the report's section on orders over a run-up's speeds."""
    cut = sweep.run_up_cuts(found)
    if not cut:
        yield html.paragraph_html(
            f"The recording has no {sweep.FEWEST_BLOCKS} blocks of {sweep.BLOCK_TURNS:g} revolutions over speeds that "
            f"differ by {100.0 * (sweep.LEAST_RISE - 1.0):.0f} %: orders over one speed are in the spectra above.",
            muted=True,
        )
        return
    yield html.paragraph_html("Amplitudes of orders of the driver against its speed, over the whole recording.")
    for title, (unit, of) in cut.items():
        yield html.heading_html(title.capitalize())
        yield figure_html(sweep.order_cuts_figure(found.model, title, unit, of), f"order cuts of the {title}")


def guide_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of the report's section on guides."""
    yield html.paragraph_html(
        "Mean normal force per length of the face, the largest force of one roller there, and force times sliding "
        "speed per length. Over the width of the contact these are a pressure and the p v of bearing tables; friction "
        "turns the share mu of p v into heat."
    )
    yield report_tables.guide_load_table(found, found.metrics(), row)
    for g, guide in enumerate(found.model.guides):
        yield html.heading_html(guide.name)
        yield figure_html(part_figures.guide_load_figure(found, g), f"load of {guide.name} over its length")


def friction_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of the report's section on friction power."""
    figure = part_figures.friction_power_figure(found)
    if figure is None:
        yield html.paragraph_html("Nothing rubs in this drive.", muted=True)
        return
    yield report_tables.friction_power_table(found, row)
    yield figure_html(figure, "friction power by group")


def safety_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of the report's section on tooth jump, slack strands and untouched guides."""
    yield html.paragraph_html(
        "What rollers inside the wraps still had to climb to where the flanks end (100 % in a seat, 0 % where the "
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
    """HTML of the report's section on wear of the joints."""
    if found.joint_wear is None:
        yield html.paragraph_html(
            "The joints have no pin radius: give chain.size or chain.joint.pin_radius.", muted=True
        )
        return
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
    """HTML of the report's section on arms, tensioners, shafts, couplings and valves."""
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
    """HTML of the report's section on probes."""
    for probe in found.model.probes:
        yield html.heading_html(probe.name)
        radius = probe.radius or found.model.chain.pitch
        place = f"({probe.at[0]:g}, {probe.at[1]:g}) m"
        yield html.paragraph_html(
            f"The link that passes {place} within {report_tables.quantity_text(radius, 'm')}.", muted=True
        )
        yield figure_html(part_figures.probe_figure(found, probe.name), f"what {probe.name} sees")


def metric_parts(found: EngineeringReport, row: Row) -> Iterator[str]:
    """HTML of the report's section with all metrics."""
    yield html.paragraph_html(
        "Over the window at every step, and of the frames in it; docs/metrics.md says how each is formed."
    )
    for name, rows in report_tables.metric_tables(found.model, {**row, **found.metrics()}, found.alike).items():
        yield html.heading_html(strand_label(name))
        yield rows


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
"""Sections of a run's report: anchor, title, HTML function, whether a drive has it."""


def variants_friction_html(run: Run) -> str:
    """HTML figure of friction power over speeds of a run's variants, or ""."""
    known = friction_power_over_speed(run) if len(run.drives) > 2 else None
    return (
        ""
        if known is None
        else figure_html(part_figures.variants_friction_figure(run.drives[0], *known), "friction power over speed")
    )


def run_sections(found: EngineeringReport, row: Row, run: Run) -> Iterator[html.PageSection]:
    """Sections of a run's report, one by one, missing channels named."""
    yield summary_section(found, row, run.info)
    for name, title, parts, has in RUN_SECTIONS:
        if not has(found):
            continue
        made: list[str] = []
        try:
            made.extend(parts(found, row))
        except SimulationError as error:
            made.append(html.paragraph_html(str(error), muted=True))
        if name == "friction" and (picture := variants_friction_html(run)):
            made += [html.heading_html("All variants of the run"), picture]
        yield html.page_section(name, title, *made)


def run_heading(found: EngineeringReport) -> str:
    """Heading of a run's report: the driver and its mean speed."""
    return f"Chain drive, {driver_speed_text(found.whole)}"


def run_report_html(
    source: Run | str | Path, variant: int | None = None, title: str | None = None, wear: Wear | None = None
) -> str:
    """The engineering report of a recorded variant as HTML; see `report`."""
    chosen = recorded_variant(source, variant)
    row = chosen.run.metrics.to_pylist()[chosen.run.row_of(chosen.index)]
    made: list[html.PageSection] = []
    chains, alike = chain_trajectories(chosen.trajectory), rotation_owners(chosen.trajectory.drive)
    for name, trajectory in chains.items():
        found = EngineeringReport(trajectory, *metrics_window(row, trajectory), wear, alike)
        own = list(run_sections(found, chain_metrics_row(row, name), chosen.run))
        made += [s._replace(name=f"{name} {s.name}", title=f"{name}: {s.title}") for s in own] if name else own
        title = title or run_heading(found)
    return html.page_html(title or "", made)


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
