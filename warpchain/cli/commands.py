"""Bodies of the commands on one drive or archive: each takes the parsed arguments and returns the exit status."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import wraps
from typing import TYPE_CHECKING, Any

from warpchain.cli.shared_options import CommandBody, drive_of_arguments, value_from_word
from warpchain.errors import WarpchainError

if TYPE_CHECKING:
    from pathlib import Path

    from warpchain.drive import Drive
    from warpchain.results.run import Run

DONE, UNFINISHED, WRONG, NOT_OK = 0, 1, 2, 3
"""Exit statuses: done; diverged, no row ok, or interrupted; a user's mistake; suspect with `run --strict`."""


def resumable_command(kept: str) -> Callable[[CommandBody], CommandBody]:
    """Decorator of a command: starts Warp first, and says on Ctrl-C that running it again goes on.

    `kept` is what is kept then, with its verb.
    """

    def make_resumable(run: CommandBody) -> CommandBody:
        """Command that can be resumed, made of its body."""

        @wraps(run)
        def command(arguments: argparse.Namespace) -> int:
            """Runs the command; returns its exit status, unfinished on Ctrl-C."""
            from warpchain.engine import start_warp

            start_warp(precompiled=False)
            try:
                return run(arguments)
            except KeyboardInterrupt:
                print(f"warpchain: interrupted; {kept} kept: run again to go on", file=sys.stderr)
                return UNFINISHED

        return command

    return make_resumable


def print_lines(lines: Iterable[str]) -> int:
    """Prints a command's lines as they come; returns exit status done."""
    for line in lines:
        print(line, flush=True)
    return DONE


def check_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain check`: prints what follows from a drive before it runs."""
    from warpchain.assembly.summary import derived_quantities, report
    from warpchain.cli.json_output import check_values, json_text

    drive = drive_of_arguments(arguments)
    if arguments.output is not None:  # also of a drive whose number of links does not fit
        from warpchain.cli.draw_command import draw_drive

        draw_drive(drive, arguments.output)
    defaults = _defaults_of_file(arguments)
    if arguments.json:
        return print_lines([json_text(check_values(drive, arguments.drive, defaults))])
    return print_lines([*_default_lines(defaults), report(derived_quantities(drive))])


def _defaults_of_file(arguments: argparse.Namespace) -> dict[str, Any]:
    """Values that a command's drive file leaves out, by key path."""
    from warpchain.drive import read_drive_text, toml
    from warpchain.drive.defaults import default_values
    from warpchain.drive.examples import drive_path

    path = drive_path(arguments.drive)
    found = default_values(toml.parse_toml(read_drive_text(path), str(path)))
    return {".".join(map(str, keys)): value for keys, value in found.items()}


def _default_lines(defaults: dict[str, Any]) -> list[str]:
    """Lines of `warpchain check` on defaults, one a table of the file."""
    from warpchain.argument_checks import number_text
    from warpchain.drive.toml import inline_value

    tables: dict[str, list[str]] = {}
    for path, value in defaults.items():
        table, _, key = path.rpartition(".")
        tables.setdefault(table, []).append(f"{key} = {inline_value(value, number_text)}")
    return [f"default, not in the file: {table}: {', '.join(values)}" for table, values in tables.items()]


def metrics_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain metrics`: lists the metrics of a drive's runs."""
    from warpchain.results.metric_columns import column_of_metric, metric_table_names

    columns = {name: column_of_metric(name) for name in metric_table_names(drive_of_arguments(arguments))}
    rows = [(name, column.unit, column.title) for name, column in columns.items() if column]
    if arguments.json:
        import json

        print(json.dumps([dict(zip(("name", "unit", "title"), row, strict=True)) for row in rows], indent=1))
        return DONE
    wide, short = (max(len(row[k]) for row in rows) for k in (0, 1))
    for name, unit, title in rows:
        print(f"{name:{wide}}  {unit:{short}}  {title}")
    return DONE


def schema_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain schema`: prints the JSON schema of drive files, study files or output."""
    from warpchain.cli.output_schema import output_schema
    from warpchain.drive.json_schema import drive_schema, schema_text
    from warpchain.study.spec import study_schema

    schemas = {"drive": drive_schema, "study": study_schema, "output": output_schema}
    print(schema_text(schemas[arguments.of]()), end="")
    return DONE


def chains_command(_: argparse.Namespace) -> int:
    """Body of `warpchain chains`: lists the catalog of chains."""
    from warpchain.drive.catalogue import catalogue_text

    print(catalogue_text())
    return DONE


def devices_command(_: argparse.Namespace) -> int:
    """Body of `warpchain devices`: lists processor and GPUs."""
    import warp as wp

    from warpchain.engine import start_warp
    from warpchain.engine.devices import processor_name, usable_gpus
    from warpchain.engine.simulation import available_cores

    start_warp(precompiled=False)
    gpus = [f"{gpu}: {wp.get_device(gpu).name}" for gpu in usable_gpus()]
    without = "no NVIDIA GPU that Warp can use: runs take the CPU"
    return print_lines([f"cpu: {processor_name()}, {available_cores()} cores", *(gpus or [without])])


def run_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain run`: simulates a drive, writes its archive, prints a summary."""
    if arguments.output is None and not arguments.json:
        raise WarpchainError("the following arguments are required: -o/--output; see warpchain run --help")
    from warpchain.archive.options import ArchiveOptions
    from warpchain.engine import start_warp
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record
    from warpchain.results.statuses import OK

    options = ArchiveOptions(
        compression=arguments.compression,
        values=arguments.values,
        exact_positions=arguments.exact_positions,
        split_size=arguments.split_size,
    )
    channels = _channels_from_words(arguments.channels)
    record = Record("none" if arguments.output is None else "all", arguments.rate, channels)
    start_warp(precompiled=False)
    drive = drive_of_arguments(arguments)
    run = simulate(
        drive,
        device=arguments.device,
        precision=arguments.precision,
        duration=arguments.duration,
        step=arguments.step,
        window=arguments.window and tuple(arguments.window),
        record=record,
        progress=not arguments.quiet,
        memory=arguments.memory,
        archive=arguments.output,
        archive_options=None if arguments.output is None else options,
        overwrite=arguments.overwrite,
        limits=_limits_from_words(arguments.limit),
    )
    row = run.metrics.to_pylist()[0]
    print_lines(_run_json(drive, run, arguments) if arguments.json else _run_lines(drive, run, arguments.output))
    if row["diverged"] or run.info.ended != "complete":
        return UNFINISHED
    return NOT_OK if arguments.strict and row["status"] != OK else DONE


def _run_lines(drive: Drive, run: Run, archive: Path) -> Iterator[str]:
    """Lines of `warpchain run` on a run and its archive."""
    from warpchain.drive.plugins import short_plugin_words

    yield from _run_summary(drive, run.metrics.to_pylist()[0], run.info.wall_time)
    if run.info.choice:
        yield f"device: {run.info.device}, {run.info.choice}"
    if run.info.plugins is not None:
        yield f"plug-ins: {short_plugin_words(run.info.plugins)}"
    yield from _own_metric_lines(run.metrics.to_pylist()[0])
    yield f"archive: {archive}; look at it with: warpchain view {shlex.quote(str(archive))}"
    if run.info.ended != "complete":
        yield f"interrupted: the archive holds what was recorded until then ({len(run[0].time)} frames)"


def _own_metric_lines(row: dict[str, Any]) -> Iterator[str]:
    """Lines of `warpchain run` on metrics of plug-ins."""
    from warpchain.results.metric_columns import OWN_COLUMNS
    from warpchain.results.units import quantity_words

    for name, column in OWN_COLUMNS.items():
        if row.get(name) is not None:
            yield f"{name}: {quantity_words(row[name], column.unit)}, {column.title}"


def _run_json(drive: Drive, run: Run, arguments: argparse.Namespace) -> Iterator[str]:
    """Text of `run --json`: what `check` says with the options' duration and step, and the run."""
    from warpchain.cli.json_output import check_values, json_text, run_values

    given = {key: value for key in ("duration", "step") if (value := getattr(arguments, key)) is not None}
    drive = drive.with_values({f"run.{key}": value for key, value in given.items()}) if given else drive
    values = check_values(drive, arguments.drive, _defaults_of_file(arguments))
    yield json_text(values | run_values(drive, run.metrics.to_pylist()[0], run.info, arguments.output))


def _channels_from_words(words: list[str]) -> tuple[str, ...]:
    """Channels that words of `run --channels` name, each once; "default" is those not on request."""
    from warpchain.results.channels import CHANNEL_NAMES, DEFAULT_CHANNELS

    for word in words:
        if word not in ("default", *CHANNEL_NAMES):
            raise WarpchainError(f"--channels: {word!r} is unknown; allowed are default, {', '.join(CHANNEL_NAMES)}")
    return tuple(dict.fromkeys(name for word in words for name in (DEFAULT_CHANNELS if word == "default" else (word,))))


def _limits_from_words(words: list[str]) -> Any:
    """Limits that `warpchain run` judges by, from words KEY=VALUE."""
    from warpchain.results.judgement import Limits

    changes = {}
    for word in words:
        key, mark, value = word.partition("=")
        if not mark or not key.strip():
            raise WarpchainError(f"--limit {word}: must be KEY=VALUE, such as energy_residual=0.02")
        changes[key.strip()] = value_from_word(value.strip())
    try:
        return Limits(**changes)
    except WarpchainError as error:
        raise WarpchainError(re.sub(r"^limits: (\S+) = ", r"--limit \1=", str(error), flags=re.MULTILINE)) from None


def _engaged_text(drive: Any, sprocket: Any, contacts: int) -> str:
    """Text of `warpchain run` on rollers, or links' flanks, that a sprocket engaged."""
    from warpchain.drive.parts_by_chain import chain_of_part

    chain = chain_of_part(drive, sprocket)
    is_silent = chain is not None and chain.is_silent
    return f"{round(contacts / 4)} links engaged" if is_silent else f"{contacts} rollers engaged"


def _run_summary(drive: Any, row: dict[str, Any], seconds: float) -> list[str]:
    """Lines of `warpchain run` in short: tension, sprockets, energy, losses, status."""
    from warpchain.results.judgement import START_ENERGY_CHANGE
    from warpchain.results.losses import losses
    from warpchain.results.units import quantity_words

    if row["diverged"]:
        return [row["reason"]]
    if row.get("input_work") is None:
        return [f"{seconds:.1f} s; the window for metrics was not reached"]
    of_start = ", of a start" if drive.run.start else ""
    lines = [f"window {row['window_start']:g} to {row['window_end']:g} s{of_start}; the run took {seconds:.1f} s"]
    for before in drive.chain_prefixes:
        mean, least, most = (row[f"{before}tension_{of}"] for of in ("mean", "min", "max"))
        named = before.replace(".", ": ")
        words = [quantity_words(value, "N") for value in (mean, least, most)]
        lines.append(f"{named}tension: mean {words[0]}, from {words[1]} to {words[2]}")
    for sprocket in drive.sprockets:
        name = sprocket.name
        moment, force = quantity_words(row[f"{name}.moment_mean"], "N m"), quantity_words(row[f"{name}.force_max"], "N")
        if sprocket.is_end:
            lines.append(f"{name}: end of the chain, largest force {force}")
        else:
            lines.append(
                f"{name}: speed {row[f'{name}.speed_mean']:.4g} rad/s, moment {moment}, largest contact force {force}, "
                f"{_engaged_text(drive, sprocket, row[f'{name}.contacts'])}"
            )
        if row.get(f"{name}.travel_max") is not None:
            lines.append(
                f"{name}: center up to {quantity_words(row[f'{name}.travel_max'], 'm')} from its place, "
                f"mean mount force {quantity_words(row[f'{name}.mount_force_mean'], 'N')}"
            )
    residual = row["energy_residual_relative"]
    terms = {"in": row["input_work"], "out": row["output_work"], "lost": sum(losses(drive, row).values())}
    terms |= {"into motion and springs": row["energy_change"]}
    works = ", ".join(f"{word} {quantity_words(value, 'J')}" for word, value in terms.items())
    unsteady = (
        abs(row["energy_change_relative"] or 0.0) > START_ENERGY_CHANGE
    )  # out and lost are of no steady work there
    known = row.get("efficiency") is not None and not unsteady
    efficiency = f", efficiency {100.0 * row['efficiency']:.2f} % (out over out and lost)" if known else ""
    joints = [f"{before}joints.friction" for before in drive.chain_prefixes]
    rubbed = [row[name] for name in joints if row.get(name) is not None]
    rubbing = f", joint friction {quantity_words(sum(rubbed), 'J')}" if rubbed else ""
    lines.append(f"energy: {works}{efficiency}{rubbing}, residual {residual:+.1e}")
    lines += _run_loss_lines(drive, row)
    if row.get("steady") is False:
        change = row.get("tension_drift")
        size = "" if change is None else f" (mean tension changes by {quantity_words(change, 'N')} over the window)"
        lines.append(f"not steady yet{size}: run longer (--duration) before you take its means for those of the drive")
    return [*lines, *_run_status_lines(row)]


def _run_loss_lines(drive: Drive, row: dict[str, Any]) -> list[str]:
    """Line of `warpchain run` on losses by group: power, and share of the input."""
    from warpchain.results.losses import loss_shares
    from warpchain.results.units import quantity_words

    found, works = loss_shares(drive, row), row["input_work"]
    total = sum(loss.energy for loss in found.values())
    if total <= 0.0:
        return []
    shares = [
        f"{group} {quantity_words(loss.power, 'W')}"
        + ("" if loss.input_share is None else f" ({100.0 * loss.input_share:.2g} %)")
        for group, loss in found.items()
        if loss.energy != 0.0
    ]
    part = f", {100.0 * total / works:.3g} % of the input" if works > 0.0 else ""
    power = quantity_words(sum(loss.power for loss in found.values()), "W")
    return [f"losses: {power}{part}: {', '.join(shares)}"]


def _run_status_lines(row: dict[str, Any]) -> list[str]:
    """Lines of `warpchain run` on a run's status and reasons."""
    first, *further = row["reason"].split("; ")
    return [f"status: {row['status']}" + (f": {first}" if first else ""), *(f"  and: {reason}" for reason in further)]


def view_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain view`: shows an archive in Rerun."""
    from warpchain.view.rerun.run_playback import FRAME_BUDGET, view

    view(
        arguments.archive,
        variant=arguments.variant,
        save=arguments.save,
        compare=arguments.compare,
        frames=FRAME_BUDGET if arguments.frames is None else arguments.frames,
        web=arguments.web,
        bind=arguments.bind,
        tab=arguments.tab,
        scale=arguments.scale,
    )
    return DONE


def plot_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain plot`: writes figures of an archive."""
    from warpchain.view.figures.plot import plot_figures, plot_sweep

    if arguments.sweep is not None:
        paths = plot_sweep([arguments.archive, *arguments.sweep], arguments.output, arguments.format)
    else:
        chosen = {"variant": arguments.variant, "only": arguments.only, "roller": arguments.roller}
        paths = plot_figures(
            arguments.archive, arguments.output, kind=arguments.format, scale=arguments.scale, **chosen
        )
    return print_lines(map(str, paths))


def report_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain report`: writes a run's engineering report."""
    from warpchain.model.power_rating import WEAR_COEFFICIENT
    from warpchain.results.engineering_report import Wear
    from warpchain.view.report import report

    given = arguments.wear_coefficient
    wear = Wear(WEAR_COEFFICIENT if given is None else given, arguments.bearing_area)
    print(report(arguments.archive, arguments.output, arguments.variant, arguments.title, wear))
    return DONE


def export_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain export`: writes an archive, or a drive, for other programs."""
    from warpchain.archive.export import export, export_metrics, export_orders

    of_archives = {name: getattr(arguments, name) for name in ("metrics", "orders", "variant")}
    of_drives = {name: getattr(arguments, name) or None for name in ("inputs", "outputs", "step", "set")}
    is_fmu = arguments.output.suffix.lower() == ".fmu"
    for name, value in (of_archives if is_fmu else of_drives).items():
        if value not in (None, False):
            raise WarpchainError(
                f"--{name}: {'only of an archive, not of a drive' if is_fmu else 'only with -o OUT.fmu'}"
            )
    if is_fmu:
        from warpchain.engine.fmu import export_fmu

        ports = {name: getattr(arguments, name) for name in ("inputs", "outputs")}
        print(export_fmu(drive_of_arguments(arguments), arguments.output, step=arguments.step, **ports))
        return DONE
    if arguments.metrics and arguments.orders:
        raise WarpchainError("--orders: not with --metrics")
    if arguments.orders:
        print(export_orders(arguments.drive, arguments.output, arguments.variant))
        return DONE
    if arguments.metrics:
        print(export_metrics(arguments.drive, arguments.output))
        return DONE
    print(export(arguments.drive, arguments.output, variant=arguments.variant))
    return DONE


def cut_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain cut`: writes a piece of an archive as one of its own."""
    from warpchain.archive.cut import cut_archive

    start, end = arguments.time or (None, None)
    if start is not None and start > end:
        raise WarpchainError(f"--time {start:g} {end:g}: must be START END with START at most END")
    frames = cut_archive(
        arguments.archive,
        arguments.output,
        start,
        end,
        arguments.variants,
        overwrite=arguments.overwrite,
        compression=arguments.compression,
    )
    count = len(frames)
    print(f"{arguments.output}: {sum(frames.values())} frames of {count} variant{'s' * (count != 1)}")
    return DONE


def recover_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain recover`: restores a damaged archive."""
    from warpchain.archive.recover import recover_archive

    recovered = recover_archive(arguments.archive, arguments.output, arguments.overwrite)
    print(recovered)
    return DONE if recovered.is_complete else UNFINISHED
