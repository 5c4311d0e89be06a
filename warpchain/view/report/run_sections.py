"""The page of a run and its sections, each from what was recorded; what a recording lacks is said in its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.arguments import checked
from warpchain.assembly.frequencies import excited_orders
from warpchain.drive.transmission import turn_alike
from warpchain.errors import ArchiveError, SimulationError
from warpchain.files import refusals, write_text
from warpchain.results.chains import chain_row, chain_trajectories
from warpchain.results.engineering_report import HandedIn, Wear, window_of
from warpchain.results.judgement import OK
from warpchain.results.losses import power_over_speed
from warpchain.results.run import Run, RunInfo
from warpchain.view import html
from warpchain.view.chosen import recorded
from warpchain.view.figures import chain_figures, load, shafts, sweep
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.figures.style import about, arrowed, driver_at
from warpchain.view.report import numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]


def pictured(figure: Figure | None, words: str) -> str:
    """A figure in the page; nothing where there is none."""
    return "" if figure is None else html.picture(figure, words)


def summary(found: HandedIn, row: Row, info: RunInfo) -> html.Section:
    """The summary: drive, status, the most wanted numbers, the drive's picture."""
    status = row.get("status") or "unknown"
    boxes = [("" if status == "unknown" else status, status, "status")]
    metrics = found.metrics()
    for name, unit, words in (
        ("tension_mean", "N", "mean tension"),
        ("tension_max", "N", "largest tension"),
        ("efficiency", "%", "efficiency"),
    ):
        if row.get(name) is not None:
            value = f"{100.0 * row[name]:.2f} %" if unit == "%" else numbers.written(row[name], unit)
            boxes.append(("", value, words))
    least = [value for name, value in metrics.items() if name.endswith(".jump_margin_relative")]
    if least:
        boxes.append(("", numbers.climb_share(min(least)), "least margin to tooth jump"))
    cells = "".join(
        f'<div class="{kind}"><b>{html.escape(value)}</b>{html.escape(words)}</div>' for kind, value, words in boxes
    )
    window = f"window of the metrics: {found.start:g} to {found.end:g} s, {len(found.part.time)} frames"
    lines = [about(found.whole), window]
    if row.get("reason"):
        lines.insert(0, f"{status}: {row['reason']}")
    step = "" if info.step is None else f", step {numbers.written(info.step, 's')}"
    lines.append(f"warpchain {info.version} on {info.device}, {info.precision}{step}, {info.created}, {info.ended}")
    note = "" if status == OK else html.text("Do not use these numbers: the run is not valid (reason above).")
    picture = pictured(drive_figure(found.whole), "the drive with forces on the chain")
    return html.section("summary", "In short", f'<div class="counts">{cells}</div>', html.bullets(lines), note, picture)


def tension(found: HandedIn, _: Row) -> Iterator[str]:
    yield html.text(
        "Each row of the picture is the maximum tension of every link in a time bin; spectra are of the latter "
        "half, over orders of the driver's revolution."
    )
    yield pictured(chain_figures.waterfall_figure(found.whole), "tension of all links over time")
    yield pictured(chain_figures.displacement_figure(found.whole), "transverse displacement of each strand")
    yield pictured(chain_figures.spectrum_figure(found.whole), "order spectra")
    yield pictured(chain_figures.angle_figure(found.whole), "contact force against angle on the sprockets")


def hubs(found: HandedIn, row: Row) -> Iterator[str]:
    exact = all(row.get(f"{sprocket.name}.hub_force_max") is not None for sprocket in found.drive.sprockets)
    yield html.text(
        "Force of the chain on each shaft. The table is of "
        + ("every step of the window, tooth friction included" if exact else "the frames")
        + "; the picture has the force at each frame, without tooth friction, and its mean as an arrow."
    )
    yield numbers.hub_table(found, row)
    yield pictured(shafts.hub_figure(found), "hub forces as hodographs")


def timing(found: HandedIn, _: Row) -> Iterator[str]:
    name = found.drive.sprockets[found.drive.driver].name
    yield html.text(
        f"Where each shaft stands against where {name} and the teeth put it, from where it stood when the recording "
        f"began, in degrees of {name}; below 0 where it lags. Amplitudes are of the window's last whole cycles of two "
        "revolutions."
    )
    yield numbers.phase_table(found)
    yield pictured(shafts.phase_figure(found), "phase errors over time")
    yield pictured(shafts.phase_order_figure(found), "phase errors by order")


def cycle(found: HandedIn, _: Row) -> Iterator[str]:
    figure = shafts.cycle_figure(found)
    yield pictured(figure, "means and envelopes over two turns of the driver")
    if figure is None:
        yield html.text("The window has no whole cycle of two revolutions at about one speed.", muted=True)


def over_speed(found: HandedIn, _: Row) -> Iterator[str]:
    cut = sweep.run_up_cuts(found)
    if not cut:
        yield html.text(
            f"The recording has no {sweep.FEWEST} blocks of {sweep.BLOCK:g} revolutions over speeds that differ by "
            f"{100.0 * (sweep.RISE - 1.0):.0f} %: orders over one speed are in the spectra above.",
            muted=True,
        )
        return
    yield html.text("Amplitudes of orders of the driver against its speed, over the whole recording.")
    for title, (unit, of) in cut.items():
        yield html.heading(title.capitalize())
        yield pictured(sweep.cuts_figure(found.drive, title, unit, of), f"order cuts of the {title}")


def guides(found: HandedIn, row: Row) -> Iterator[str]:
    yield html.text(
        "Mean normal force per length of the face, the largest force of one roller there, and force times sliding "
        "speed per length. Over the width of the contact these are a pressure and the p v of bearing tables; friction "
        "turns the share mu of p v into heat."
    )
    yield numbers.guide_table(found, found.metrics(), row)
    for g, guide in enumerate(found.drive.guides):
        yield html.heading(guide.name)
        yield pictured(load.guide_load_figure(found, g), f"load of {guide.name} over its length")


def friction(found: HandedIn, row: Row) -> Iterator[str]:
    figure = load.friction_figure(found)
    if figure is None:
        yield html.text("Nothing rubs in this drive.", muted=True)
        return
    yield numbers.friction_table(found, row)
    yield pictured(figure, "friction power by group")


def safety(found: HandedIn, row: Row) -> Iterator[str]:
    yield html.text(
        "What rollers inside the wraps still had to climb to where the flanks end (100 % in a seat, 0 % where the "
        "chain jumps), and for how long strands carry no tension in their middles and guides are not touched."
    )
    metrics = found.metrics()
    rows = [[name, numbers.climb_share(metrics[f"{name}.jump_margin_relative"]),
             numbers.written(metrics[f"{name}.jump_margin"], "m"), str(row.get(f"{name}.slips", ""))]
            for name in (sprocket.name for sprocket in found.drive.sprockets)
            if f"{name}.jump_margin" in metrics]  # fmt: skip
    yield html.table(["sprocket", "least margin over the climb", "least margin", "teeth jumped"], rows)
    idle = [[arrowed(name), "no tension in its middle", f"{100.0 * metrics[f'{name}.slack_time']:.2f} %"]
            for name in found.drive.strand_names if f"{name}.slack_time" in metrics]  # fmt: skip
    idle += [[guide.name, "not touched", f"{100.0 * metrics[f'{guide.name}.off_time']:.2f} %"]
             for guide in found.drive.guides if f"{guide.name}.off_time" in metrics]  # fmt: skip
    yield html.table(["part", "is", "share of time"], idle)
    yield pictured(shafts.jump_figure(found), "margin to tooth jump over time")


def wear(found: HandedIn, _: Row) -> Iterator[str]:
    if found.wear is None:
        yield html.text("The joints have no pin radius: give chain.size or chain.joint.pin_radius.", muted=True)
        return
    metrics = found.metrics()
    rows = [
        ["sliding speed of a joint", numbers.written(metrics["joints.sliding_speed"], "m/s")],
        ["force times sliding speed", numbers.written(metrics["joints.loaded_sliding"], "W")],
        ["friction power of a joint", numbers.written(metrics["joints.friction_each"], "W")],
    ]
    law = found.wear_law
    if found.elongation is not None and found.area is not None and found.elongation > 0.0:
        hours = 0.01 / (3600.0 * found.elongation)
        rows += [
            ["Archard's coefficient k", f"{law.coefficient:.3g} m\u00b2/N"],
            ["bearing area of a joint", f"{1e6 * found.area:.4g} mm\u00b2"],
            ["elongation in 1,000 hours", f"{3.6e8 * found.elongation:.3g} %"],
            ["hours to 1 %", html.number(hours, 3)],
        ]
    yield html.text(
        "Means of all joints over the window. The forecast is proportional to k, which lubrication and surfaces change "
        "a hundredfold: 2e-16 m\u00b2/N is an oiled industrial chain's, hardened pins in engine oil have some 4e-18. "
        "Calibrate it by a measured chain (docs/wear.md)."
    )
    if found.area is None:
        yield html.text("No forecast: neither a size of chain nor a bearing area is given.", muted=True)
    yield html.table(["of a joint", "value"], rows)
    yield pictured(load.wear_figure(found), "loaded sliding of every joint")


def bodies(found: HandedIn, row: Row) -> Iterator[str]:
    """Arms, tensioners, shafts, couplings, valves: every channel recorded of them, and how it moves in the window."""
    for kind, of in load.BODIES.items():
        channels = load.channels_of(found.part, kind)
        for k, part in enumerate(getattr(found.drive, of)):
            if channels and part.name not in found.alike:
                yield html.heading(part.name)
                yield numbers.stroke_table(found, channels, k)
                yield html.text(line) if kind == "tensioner" and (line := numbers.valve_line(found, k)) else ""
                yield pictured(load.body_figure(found, kind, k), f"what {part.name} does")
    names = [part.name for of in load.BODIES.values() for part in getattr(found.drive, of)]
    tables = numbers.metric_tables(found.drive, row, found.alike)
    for name in names:
        if name in tables:
            yield html.heading(f"{name}, over the window at every step")
            yield tables[name]


def probes(found: HandedIn, _: Row) -> Iterator[str]:
    for probe in found.drive.probes:
        yield html.heading(probe.name)
        radius = probe.radius or found.drive.chain.pitch
        place = f"({probe.at[0]:g}, {probe.at[1]:g}) m"
        yield html.text(f"The link that passes {place} within {numbers.written(radius, 'm')}.", muted=True)
        yield pictured(load.probe_figure(found, probe.name), f"what {probe.name} sees")


def every_metric(found: HandedIn, row: Row) -> Iterator[str]:
    yield html.text("Over the window at every step, and of the frames in it; docs/metrics.md says how each is formed.")
    for name, rows in numbers.metric_tables(found.drive, {**row, **found.metrics()}, found.alike).items():
        yield html.heading(arrowed(name))
        yield rows


Parts = Callable[[HandedIn, Row], Iterator[str]]
SECTIONS: tuple[tuple[str, str, Parts, Callable[[HandedIn], bool]], ...] = (
    ("tension", "Chain", tension, lambda found: True),
    ("hubs", "Hub forces", hubs, lambda found: True),
    ("timing", "Timing", timing, lambda found: True),
    ("cycle", "Cycle of two turns", cycle, lambda found: bool(excited_orders(found.drive))),
    ("speed", "Orders over speed", over_speed, lambda found: True),
    ("guides", "Guides", guides, lambda found: bool(found.drive.guides)),
    (
        "bodies",
        "Arms, tensioners, shafts",
        bodies,
        lambda found: any(getattr(found.drive, of) for of in load.BODIES.values()),
    ),
    ("friction", "Friction", friction, lambda found: True),
    ("safety", "Tooth jump, slack", safety, lambda found: True),
    ("wear", "Wear", wear, lambda found: True),
    ("probes", "Probes", probes, lambda found: bool(found.drive.probes)),
    ("metrics", "All metrics", every_metric, lambda found: True),
)
"""The page's sections after the summary: anchor, title, what they are made of, whether a drive has them."""


def over_variants(run: Run) -> str:
    """Friction power over the speeds of a run's variants; nothing where they have fewer than three."""
    known = power_over_speed(run) if len(run.drives) > 2 else None
    return "" if known is None else pictured(load.variants_figure(run.drives[0], *known), "friction power over speed")


def sections(found: HandedIn, row: Row, run: Run) -> Iterator[html.Section]:
    """The page's sections, one by one; one whose channels were not recorded names those that are missing."""
    yield summary(found, row, run.info)
    for name, title, parts, has in SECTIONS:
        if not has(found):
            continue
        made: list[str] = []
        try:
            made.extend(parts(found, row))
        except SimulationError as error:
            made.append(html.text(str(error), muted=True))
        if name == "friction" and (picture := over_variants(run)):
            made += [html.heading("All variants of the run"), picture]
        yield html.section(name, title, *made)


def heading(found: HandedIn) -> str:
    """Heading of the page: the driver and its mean speed in the window."""
    return f"Chain drive, {driver_at(found.whole)}"


def report_html(
    source: Run | str | Path, variant: int | None = None, title: str | None = None, wear: Wear | None = None
) -> str:
    """The page of a recorded variant, as text; `report` has the arguments."""
    chosen = recorded(source, variant)
    row = chosen.run.metrics.to_pylist()[chosen.run.row_of(chosen.index)]
    made: list[html.Section] = []
    chains, alike = chain_trajectories(chosen.trajectory), turn_alike(chosen.trajectory.drive)
    for name, trajectory in chains.items():
        found = HandedIn(trajectory, *window_of(row, trajectory), wear, alike)
        own = list(sections(found, chain_row(row, name), chosen.run))
        made += [s._replace(name=f"{name} {s.name}", title=f"{name}: {s.title}") for s in own] if name else own
        title = title or heading(found)
    return html.page(title or "", made)


@checked(SimulationError)
def report(
    source: Run | str | Path,
    path: str | Path,
    variant: int | None = None,
    title: str | None = None,
    wear: Wear | None = None,
) -> Path:
    """Writes the engineering report of a recorded run as one HTML page that needs nothing else.

    Args:
        source: a run, or an archive's path.
        path: the page's; one of that name is replaced.
        variant: which variant; None is the first recorded.
        title: heading of the page; None says what was run.
        wear: how the joints wear; None takes the defaults.

    Returns:
        The page's path.

    Raises:
        ArchiveError: an archive that cannot be read, or a page that cannot be written.
        SimulationError: a variant that was not recorded, or a channel without which no drive can be drawn.
    """
    text = report_html(source, variant, title, wear)
    target = Path(path)
    with refusals(target, ArchiveError):
        write_text(target, text)
    return target
