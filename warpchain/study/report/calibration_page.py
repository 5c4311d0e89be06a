"""HTML page of a calibration: priors and posteriors, fit, directions that are not identified, predictions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.results.measured import signal_source
from warpchain.results.signals import amplitude_spectrum
from warpchain.results.units import display_unit_word, distinguishing_decimals, quantity_words
from warpchain.study.analysis.left_out import LeftOut
from warpchain.study.analysis.posterior import UNIDENTIFIED_SHARE, PosteriorDirection
from warpchain.study.analysis.surface import TRUSTED_R2
from warpchain.study.optimize.calibrate import Calibration
from warpchain.study.report.panels import ACCENT, INK, MARK, PALE, Panel, panels_html, report_page_html, rounded_numbers
from warpchain.study.results import Array
from warpchain.study.run.recordings import recorded_trajectories
from warpchain.study.store import write_study_text
from warpchain.view import html

UNEXPLAINED_DEVIATIONS = 3.0
TRACE_POINTS, SPECTRUM_POINTS = 600, 800
LEAST_NAMED_WEIGHT = 0.25


def write_calibration_page(found: Calibration) -> Path:
    """Writes a calibration's HTML page; returns the file."""
    page = found.folder / "calibration.html"
    title = found.study.study.name or found.folder.resolve().name
    rest = [
        _fit_section(found),
        *_signal_sections(found),
        _directions_section(found),
        _predictions_section(found),
        _rounds_section(found),
    ]
    first = [_calibration_summary(found), _unknowns_section(found)]
    sections = [*first, *(section._replace(folded=True) for section in rest if section)]
    write_study_text(page, report_page_html(title, sections, about=[str(found.folder)]))
    return page


def calibration_lines(found: Calibration) -> list[str]:
    """Lines on a calibration's result."""
    runs, ok = len(found.results.status), int(found.results.ok.sum())
    lines = [f"{len(found.numbers)} measured numbers, {len(found.values)} unknowns, {runs} runs, {ok} of them ok"]
    for name in found.values:
        lines.append(f"{name}: {_mean_and_deviation_text(found, name, found.values_before)} a priori, "
                     f"{_mean_and_deviation_text(found, name, found.values)} a posteriori")  # fmt: skip
    return [*lines, *_unidentified_lines(found), *_unexplained_lines(found), *_emulator_trust_lines(found)]


def _mean_and_deviation_text(found: Calibration, name: str, values: dict[str, Array]) -> str:
    """Text of mean and deviation of an unknown's samples."""
    return quantity_words(float(values[name].mean()), _unknown_unit(found, name), float(values[name].std()))


def _unknown_unit(found: Calibration, name: str) -> str:
    """Unit of an unknown of a calibration."""
    return found.results.column_unit(name)


def _direction_text(found: Calibration, of: PosteriorDirection) -> str:
    """Text of a posterior direction, "stiffness up with damping down"."""
    parts = [
        f"{name} {'up' if weight > 0.0 else 'down'}"
        for name, weight in sorted(zip(_dimension_names(found), of.weights, strict=True), key=lambda one: -abs(one[1]))
        if abs(weight) >= LEAST_NAMED_WEIGHT
    ]
    return " with ".join(parts)


def _dimension_names(found: Calibration) -> list[str]:
    """Names of the unknowns that a calibration's dimensions are."""
    from warpchain.study.design.factor_values import design_dimensions

    return [axis.name for axis in design_dimensions(found.study.noise_study)]


def _unidentified_lines(found: Calibration) -> list[str]:
    """Lines on directions that a calibration does not identify."""
    return [
        f"not identified by the measurements: {_direction_text(found, of)}, which keeps "
        f"{100.0 * min(of.left, 1.0):.0f} % of its prior standard deviation"
        for of in found.directions
        if of.left >= UNIDENTIFIED_SHARE
    ]


def _unexplained_lines(found: Calibration) -> list[str]:
    """Lines on measured numbers that a calibration leaves unexplained."""
    return [
        f"not explained: {of.name}, {abs(off):.1f} standard deviations {'above' if off > 0 else 'below'} the expected; "
        "the model lacks something, a prior is too narrow or an error too small"
        for of, off in zip(found.numbers, found.residuals, strict=True)
        if abs(off) > UNEXPLAINED_DEVIATIONS
    ]


def _emulator_trust_lines(found: Calibration) -> list[str]:
    """Lines on trust in a calibration's surrogates."""
    inside, of = found.check_counts
    lines = [
        f"{inside} of {of} numbers of {found.checks} runs drawn from the posterior lie in the surrogates' 95 % bands",
        *LeftOut(found.results).lines(),
    ]
    poor = [
        f"{n.name} ({q:.2f})" for n, q in zip(found.numbers, found.emulated.q2_values, strict=True) if q < TRUSTED_R2
    ]
    if poor:
        lines.append(f"surrogates with a Q\u00b2 below {TRUSTED_R2:g}, which constrain little: {', '.join(poor)}; "
                     "raise calibrate.count, or the length of the window")  # fmt: skip
    return lines


def _calibration_summary(found: Calibration) -> html.PageSection:
    """HTML section with a calibration in short."""
    first, *lines = calibration_lines(found)
    files = (
        f"The drive at the posterior's means: {found.drive.name}. Samples of the unknowns: posterior.csv, which a "
        'noise factor of distribution "empirical" may name.'
    )
    return html.page_section(
        "summary", "In short", html.paragraph_html(f"{first}."), html.bullets_html(lines), html.paragraph_html(files)
    )


def _unknowns_section(found: Calibration) -> html.PageSection:
    """HTML section on a calibration's priors and posteriors."""
    rows, figures = [], []
    for k, name in enumerate(found.values):
        before, after = found.values_before[name], found.values[name]
        word, factor = display_unit_word(_unknown_unit(found, name), float(np.abs(before).max()))
        ends = [factor * np.percentile(values, (5, 95)) for values in (before, after)]
        digits = distinguishing_decimals(ends)
        cells = [f"{html.column_number(low, digits)} to {html.column_number(high, digits)}" for low, high in ends]
        mean, left = html.column_number(factor * float(after.mean()), digits), float(after.std() / before.std())
        rows.append((name, word, *cells, mean, f"{100.0 * left:.0f} %"))
        figures.append(_density_panel(f"{name} [{word}]" if word else name, factor * before, factor * after, k == 0))
    heads = ("unknown", "unit", "90 % prior", "90 % posterior", "posterior mean", "standard deviation left")
    return html.page_section(
        "unknowns",
        "The unknowns",
        html.table_html(heads, rows),
        panels_html(figures, "prior and posterior"),
    )


def _density_panel(label: str, before: Array, after: Array, named: bool) -> Panel:
    """Panel of an unknown's prior and posterior density."""
    low, high = np.percentile(before, (0.5, 99.5))
    low, high = min(low, after.min()), max(high, after.max())
    edges = np.linspace(low, high, 41)
    prior, posterior = (np.histogram(values, edges, density=True)[0] for values in (before, after))
    top = float(1.08 * max(prior.max(), posterior.max()))
    series: list[dict[str, Any]] = [
        {
            "kind": "columns",
            "low_x": rounded_numbers(edges[:-1]),
            "high_x": rounded_numbers(edges[1:]),
            "y": rounded_numbers(posterior),
        },
        {
            "kind": "line",
            "x": rounded_numbers(np.repeat(edges, 2)[1:-1]),
            "y": rounded_numbers(np.repeat(prior, 2)),
            "color": MARK,
        },
    ]
    if named:
        series[0]["label"], series[1]["label"] = "posterior", "prior"
    return {"x": {"label": label}, "y": {"label": "density", "range": [0.0, top]}, "series": series}


def _fit_section(found: Calibration) -> html.PageSection:
    """HTML section on measured numbers beside the calibration's."""
    calibrated = found.runs[len(found.runs) - found.checks]
    models = [found.emulated(u) for u in (found.before, found.after)]
    spans = [(m.mean(axis=0), np.sqrt(v.mean(axis=0) + m.var(axis=0))) for m, v in models]
    rows = []
    for j, of in enumerate(found.numbers):
        cells = [quantity_words(float(mean[j]), of.unit, float(sd[j])) for mean, sd in spans]
        run = quantity_words(float(calibrated[j]), of.unit) if np.isfinite(calibrated[j]) else "\N{EN DASH}"
        measured = quantity_words(of.value, of.unit, of.error)
        rows.append(
            (of.name, measured, *cells, run, round(float(found.residuals[j]), 1) + 0.0, found.emulated.q2_values[j])
        )
    heads = ("number", "measured", "prior", "posterior", "calibrated run", "off [standard deviations]", "Q\u00b2")
    return html.page_section(
        "fit", "Fit of the measured numbers",
        html.paragraph_html("\N{PLUS-MINUS SIGN} is one standard deviation; of the model it holds the scatter of runs. "
                  "Off: measured less expected, in standard deviations of both.", muted=True),
        panels_html(_fit_panel(found, spans), "numbers over what was measured"),
        html.table_html(heads, rows),
    )  # fmt: skip


def _fit_panel(found: Calibration, spans: Sequence[tuple[Array, Array]]) -> list[Panel]:
    """Panels of deviations from measured numbers [%]."""
    values = np.array([of.value for of in found.numbers])
    shown = np.flatnonzero(values)
    if not len(shown):
        return []
    errors, rows = np.array([of.error for of in found.numbers]), np.arange(len(shown))[::-1]
    series: list[dict[str, Any]] = []
    parts = ((values, errors, INK, "measured"), (*spans[0], MARK, "prior"), (*spans[1], ACCENT, "posterior"))
    for k, (mean, deviation, color, label) in enumerate(parts):
        low, middle, high = (
            rounded_numbers(100.0 * ((mean + s * deviation) / values - 1.0)[shown]) for s in (-1.96, 0.0, 1.96)
        )
        at = rounded_numbers(rows - 0.22 * (k - 1))
        series.append({"kind": "spans", "y": at, "low_x": low, "high_x": high, "color": color})
        series.append({"kind": "points", "y": at, "x": middle, "color": color, "size": 3.0, "label": f"{label}, 95 %"})
    words = [found.numbers[j].name for j in shown[::-1]]
    size = {"width": 860, "height": 70 + 36 * len(words)}
    return [{"x": {"label": "off the measured [%]"}, "y": {"words": words}, "series": series, **size}]


def _signal_sections(found: Calibration) -> list[html.PageSection]:
    """HTML sections on signals, measured and simulated."""
    if not found.signals:
        return []
    results = found.results
    last = [row for row in range(len(results.status) - found.checks, len(results.status)) if results.ok[row]]
    played = recorded_trajectories(results, found.folder, [int(results.variants[row]) for row in last])
    windows = [[float(results.values(name)[row]) for name in ("window_start", "window_end")] for row in last]
    figures = []
    for name, measured in found.signals.items():
        word, factor = display_unit_word(measured.unit, float(np.abs(measured.values).max()))
        of_runs = []
        for trajectory, (start, end) in zip(played.values(), windows, strict=True):
            part = (trajectory.time >= start) & (trajectory.time <= end)
            of_runs.append((trajectory.time[part] - start, factor * signal_source(trajectory, name).values()[part]))
        rig = (measured.time - measured.time[0], factor * measured.values)
        figures += _signal_panels(f"{name} [{word}]" if word else name, rig, of_runs)
    return [
        html.page_section(
            "signals", "The signals",
            html.paragraph_html("Blue: runs drawn from the posterior. Red: measured. Instants need not agree, as the "
                      "rig's time has another origin and impacts are chaotic; levels and spectra should.", muted=True),
            panels_html(figures, "measured signals and those of runs"),
        )
    ]  # fmt: skip


def _signal_panels(label: str, rig: tuple[Array, Array], runs: Sequence[tuple[Array, Array]]) -> list[Panel]:
    """Panels of a signal's trace and spectrum, measured and simulated."""
    span = min(float(of[0][-1]) for of in (rig, *runs))
    traces, spectra = [], []
    nyquist = min(0.5 / float(np.diff(of[0]).mean()) for of in (rig, *runs))
    drawn = [*((of, ACCENT, "runs of the posterior") for of in runs[:4]), (rig, MARK, "measured")]
    for k, ((time, values), color, words) in enumerate(drawn):
        named = {"label": words} if k in (0, len(drawn) - 1) else {}
        width = 1.2
        shown = np.flatnonzero(time <= span)
        shown = shown[:: max(1, len(shown) // TRACE_POINTS)]
        traces.append(
            {
                "kind": "line",
                "x": rounded_numbers(time[shown]),
                "y": rounded_numbers(values[shown]),
                "color": color,
                "width": width,
            }
            | named
        )
        even = np.linspace(time[0], time[-1], len(time))
        held = np.isfinite(values)
        lines, size = amplitude_spectrum(np.interp(even, time[held], values[held]), float(even[1] - even[0]))
        lines, size = _thinned_spectrum(lines[1:], size[1:], nyquist)
        spectra.append(
            {"kind": "line", "x": rounded_numbers(lines), "y": rounded_numbers(size), "color": color, "width": width}
            | named
        )
    wide: dict[str, Any] = {"width": 540, "height": 250}
    return [
        {"x": {"label": "time from the window's start [s]"}, "y": {"label": label}, "series": traces, **wide},
        {"x": {"label": "frequency [Hz]"}, "y": {"label": f"amplitude of {label}"}, "series": spectra, **wide},
    ]


def _thinned_spectrum(lines: Array, size: Array, most: float) -> tuple[Array, Array]:
    """Frequencies and amplitudes of a signal's largest lines."""
    lines, size = lines[lines <= most], size[lines <= most]
    wide = max(1, -(-len(lines) // SPECTRUM_POINTS))
    starts = np.arange(0, len(lines), wide)
    return lines[starts], np.maximum.reduceat(size, starts) if len(lines) else size


def _directions_section(found: Calibration) -> html.PageSection:
    """HTML section on posterior directions, least identified first."""
    words = [_direction_text(found, of) for of in found.directions]
    at = np.arange(len(words))[::-1]
    left = [100.0 * of.left for of in found.directions]
    bars = {"kind": "rows", "y": at.tolist(), "x": rounded_numbers(left), "color": ACCENT, "thick": 0.6}
    x = {"label": "standard deviation left [%]", "range": [0.0, max(100.0, 1.05 * max(left))]}
    figure = {"x": x, "y": {"words": words[::-1]}, "series": [bars], "width": 860, "height": 70 + 34 * len(words)}
    lines = _unidentified_lines(found) or ["every direction is identified: half of its variance is gone, or more"]
    return html.page_section(
        "open", "What the measurements cannot tell",
        html.paragraph_html("Combinations of unknowns, the least identified first. Near 100 % only the prior is left: "
                  "another measurement is needed.", muted=True),
        panels_html([figure, *_correlated_pair_panels(found)], "directions of the unknowns"),
        html.bullets_html(lines),
    )  # fmt: skip


def _correlated_pair_panels(found: Calibration) -> list[Panel]:
    """Panels of the two most correlated unknowns' samples."""
    names = list(found.values)
    if len(names) < 2:
        return []
    both = np.abs(np.corrcoef([found.values[name] for name in names])) - np.eye(len(names))
    a, b = sorted(divmod(int(np.argmax(both)), len(names)))
    series, axes = [], []
    for name in (names[a], names[b]):
        word, factor = display_unit_word(_unknown_unit(found, name), float(np.abs(found.values_before[name]).max()))
        axes.append((f"{name} [{word}]" if word else name, factor))
    for values, color, label in ((found.values_before, PALE, "prior"), (found.values, ACCENT, "posterior")):
        x, y = (
            rounded_numbers(factor * values[name][:500])
            for name, (_, factor) in zip((names[a], names[b]), axes, strict=True)
        )
        series.append({"kind": "points", "x": x, "y": y, "color": color, "size": 1.8, "label": label})
    return [{"x": {"label": axes[0][0]}, "y": {"label": axes[1][0]}, "series": series, "width": 400, "height": 320}]


def _predictions_section(found: Calibration) -> html.PageSection | None:
    """HTML section on metrics by prior and posterior."""
    if not found.predictions:
        return None
    rows, figures = [], []
    for k, of in enumerate(found.predictions):
        unit = found.results.column_unit(of.metric)
        cells = []
        for values in (of.before, of.after):
            low, high = (float(end) for end in np.percentile(values, (2.5, 97.5)))
            cells += [
                quantity_words(float(values.mean()), unit),
                f"{quantity_words(low, unit)} to {quantity_words(high, unit)}",
            ]
        rows.append((of.metric, *cells, of.q2))
        word, factor = display_unit_word(unit, float(np.abs(of.before).max()))
        figures.append(
            _density_panel(
                f"{of.metric} [{word}]" if word else of.metric, factor * of.before, factor * of.after, k == 0
            )
        )
    heads = ("metric", "prior mean", "95 % of runs, prior", "posterior mean", "95 % of runs, posterior", "Q\u00b2")
    return html.page_section(
        "predictions", "How predictions change",
        html.paragraph_html("What a run gives, scatter between runs in it.", muted=True),
        panels_html(figures, "predictions by prior and posterior"), html.table_html(heads, rows),
    )  # fmt: skip


def _rounds_section(found: Calibration) -> html.PageSection:
    """HTML section on a calibration's posterior, round by round."""
    axes = _dimension_names(found)
    rows = [
        (f"{k + 1}", *(f"{m:+.2f} \N{PLUS-MINUS SIGN} {s:.2f}" for m, s in zip(mean, deviation, strict=True)))
        for k, (mean, deviation) in enumerate(found.rounds)
    ]
    return html.page_section(
        "course", "How it was found",
        html.paragraph_html("The posterior after each round, in prior standard deviations: where it still moves, raise "
                  "calibrate.rounds.", muted=True),
        html.table_html(("round", *axes), rows),
        html.bullets_html([*_emulator_trust_lines(found), f"{found.independent:.0f} independent samples of the "
                                                          f"posterior"]),
    )  # fmt: skip
