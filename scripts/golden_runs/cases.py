"""The cases of `golden.py`: what each runs and gives."""

import contextlib
import io
import re
import shutil
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common.drives import TWO, example_drive, two_sprockets
from mcap.reader import make_reader
from pyarrow import parquet

import warpchain
from golden_runs import blocks as golden_blocks
from golden_runs.drives import ARCHIVES, DESIGNS, LAWS, LOAD, MOUNTS, PROFILES, STUDY, TABLES, WORN, run_on_one_core
from warpchain import ArchiveOptions, Record, Run
from warpchain.assembly.fitting import fit_links, fit_position
from warpchain.assembly.summary import derived_quantities
from warpchain.assembly.timestep import automatic_step, resolve_step, step_limit
from warpchain.cli import main as command_line
from warpchain.drive.examples import example_names
from warpchain.model import Model
from warpchain.results import fatigue, nearest_parts, objectives, outlines, signals, strand_passing

VOLATILE = ("created", "wall_time", "set", "version", "versions", "digest", "run")
"""Values of an archive's metadata that are not what the project computes, or hang on one that is not.

The digest of a record is over its set's random name; `run` repeats the record at the file's start, digest and all.
"""


# ------------------------------------------------------------------------------------------------ the CPU kernel


def run_example(name: str, _: Path) -> Run:
    """2000 steps of an example, from its settled state."""
    drive = example_drive(name)
    length = 2000 * resolve_step(drive)
    return run_on_one_core(drive, duration=length, window=(0.25 * length, length), record=Record(rate=50.0 / length))


def run_silent_chains(_: Path) -> dict[str, Run]:
    """Silent chains on wheels and guides, one of them to full torque and back, in both precisions."""
    drives = [example_drive(name) for name in ("silent_timing", "transfer_case")]
    return {
        precision: run_on_one_core(drives, precision=precision, duration=0.004, window=(0.001, 0.004))
        for precision in ("float64", "float32")
    }


def run_laws(_: Path) -> Run:
    """Every law with every exponent and profile, and one restitution that means the rebound."""
    drives = [two_sprockets({"contact.sprocket.restitution_means": "rebound"})]
    for law, exponent in LAWS:
        values = {"contact.sprocket.law": law, "contact.sprocket.exponent": exponent}
        values |= {"contact.sprocket.stiffness": 1e10} if exponent > 1.0 else {}
        drives += [two_sprockets(values | profile) for profile in PROFILES.values()]
    return run_on_one_core(drives)


def run_guides(_: Path) -> Run:
    """A guide-bar with every law, from common values and from its own."""
    every: list[dict[str, Any]] = [{"contact.guide.law": law, "contact.guide.exponent": n} for law, n in LAWS]
    every += [{"guides.0.contact": {"law": "flores", "stiffness": 1e7, "restitution": 0.2}}]
    drives = [example_drive("marine", values | {"run.settle": False}) for values in every]
    return run_on_one_core(drives, duration=0.01, window=(0.002, 0.01))


def run_mounts(_: Path) -> Run:
    """Every mount and balance wheels, settled and not."""
    return run_on_one_core(
        [two_sprockets(values | {"run.settle": settle}) for values in MOUNTS for settle in (True, False)]
    )


def run_integrators(_: Path) -> dict[str, Run]:
    """Both integrators in both precisions, on fixed and moving sprockets, and on a guide-bar."""
    drives = []
    for integrator in ({"run.integrator": "leapfrog"}, {"run.integrator": "rk4"}):
        drives += [two_sprockets(values | integrator) for values in ({}, WORN, PROFILES["minimum"], *MOUNTS)]
        drives.append(example_drive("marine", integrator | {"run.settle": False}))
    return {
        precision: run_on_one_core(drives, precision=precision, duration=0.005) for precision in ("float64", "float32")
    }


def run_mixed_drives(_: Path) -> Run:
    """Drives of different links and sprockets in one ensemble, some recorded, a few channels."""
    others = [example_drive(name, {"run.settle": False}) for name in ("marine_no_guides", "motorcycle", "engine")]
    larger = {"sprockets.driver.teeth": 24, "sprockets.driven.teeth": 24, "chain.links": 64}
    drives = [two_sprockets(), *others, two_sprockets(larger | WORN)]
    return run_on_one_core(drives, duration=1e-3, record=Record([0, 2, 4], 2e4, ("position", "tension", "guide_force")))


def run_diverging(_: Path) -> Run:
    """A variant that an absurd load tears apart, beside one that is sound."""
    mad = {
        "contact.sprocket.impact_speed_floor": 1e-9,
        f"{LOAD}.torque": 5e7,
        f"{LOAD}.viscous": 1e8,
        "run.duration": 0.02,
    }
    return run_on_one_core([two_sprockets(mad), two_sprockets({"run.duration": 0.02})])


# ------------------------------------------------------------------------------------- what is made of drives and runs


def setup_quantities(folder: Path) -> dict[str, Any]:
    """Everything before a run: derived quantities, assembly, limits, outlines, fits, and `warpchain check`."""
    found: dict[str, Any] = {}
    names = [name for name in example_names() if not example_drive(name).chains]
    drives = {name: example_drive(name) for name in names} | {
        "worn": two_sprockets(WORN),
        "iso": two_sprockets(PROFILES["maximum"]),
    }
    for name, drive in drives.items():
        found[name] = {"assembly": warpchain.assemble(drive), "derived": derived_quantities(drive)}
        found[name]["steps"] = [step_limit(drive), automatic_step(drive)]
        found[name]["teeth"] = [outlines.tooth_outline(Model(drive).chain, s) for s in range(len(drive.sprockets))]
        found[name]["guides"] = [outlines.guide_outline(Model(drive).chain, g) for g in range(len(drive.guides))]
        found[name]["file"] = warpchain.dumps_drive(drive)
    found["check"] = {name: command_output("check", name) for name in example_names()}
    fits: dict[str, dict[str, Any]] = {"sag": {"sag": 0.01}, "preload": {"preload": 500.0}, "strain": {"strain": 1e-4}}
    found["fit"] = {
        n: warpchain.dumps_drive(fit_position(two_sprockets(), "driven", [1.0, 0.0], **w)) for n, w in fits.items()
    }
    found["fit"]["links"] = warpchain.dumps_drive(fit_links(two_sprockets({"chain.links": 70})))
    with contextlib.chdir(folder):
        words = ("--sprocket", "conveyor", "--along", "1,0", "--sag", "0.02", "--strand", "motor->conveyor")
        found["fit"]["said"] = command_output("fit", "industrial", *words, "-o", "fit.toml")
        found["fit"]["file"] = Path("fit.toml").read_bytes()
    return found


def read_quantities(_: Path) -> dict[str, Any]:
    """Quantities read off a recorded run: signals, scene, fatigue, objectives, tables."""
    recorded = run_on_one_core(example_drive("marine", {"run.settle": False}), duration=0.4, record=Record(rate=2000.0))
    one, tension = recorded[0], recorded[0].tension
    assert tension is not None
    numbers, strands, woehler = range(1, 3), range(3), fatigue.Woehler(5.0, 1e4)
    found: dict[str, Any] = {"metrics": recorded.metrics, "latter": signals.latter_half_frames(one).start}
    found["round"] = signals.last_round_frames(one).start
    found["strand"] = [signals.strand_tension(one, k) for k in strands]
    found["ratio"] = [signals.speed_ratio_to_driver(one, s) for s in numbers]
    found["error"] = [signals.transmission_error(one, s) for s in numbers]
    found["frequency"] = [signals.strand_transverse_frequency(one, k) for k in strands]
    found["guide"] = signals.guide_forces_and_rollers(one)
    found["contact"] = [signals.contact_angles(one, s) for s in range(3)]
    found["spectrum"] = signals.amplitude_spectrum(tension[:, 0].astype(float), 5e-4)
    found["orders"] = signals.order_spectrum(one, found["strand"][0])
    found["peaks"] = [signals.peak_frames(tension[:, 0], 50), *signals.peaks_over_time(tension, 50)]
    found["passing"] = [strand_passing.passing_link(one, k) for k in strands]
    found["arrows"], found["nearest"] = nearest_parts.contact_force_vectors(one), nearest_parts.engaged_sprockets(one)
    found["damage"] = fatigue.miner_damage(tension, woehler)
    found["equivalent"] = fatigue.equivalent_range(tension, 5.0, 3.0)
    found["cycles"] = fatigue.count_links(tension[:, :3])
    found["impulses"] = [objectives.engagement_impulses(one, s) for s in range(3)]
    found["objectives"] = objectives.add_objectives(recorded, woehler)
    return found | {"arrow": run_on_one_core(two_sprockets(), duration=5e-4)[0].to_arrow()}


def archive_messages(folder: Path) -> dict[str, Any]:
    """Archives message by message, in every form, written while running and after, read back and exported."""
    drives = [
        two_sprockets(),
        example_drive("engine", {"run.settle": False}),
        two_sprockets(MOUNTS[0] | {"run.duration": 0.005}),
    ]
    found: dict[str, Any] = {}
    for name, options in ARCHIVES.items():
        path, chosen = folder / f"{name}.mcap", ArchiveOptions(encoders=1, **options)
        run_on_one_core(drives, duration=0.002, record=Record([0, 1, 2], 1e4), archive=path, archive_options=chosen)
        back = warpchain.read_archive(path)
        found[name] = {"back": back, "files": [archive_content(file) for file in back.files]}
    short = run_on_one_core(drives[0], duration=0.001, precision="float32")
    found["after"] = archive_content(warpchain.write_archive(short, folder / "after.mcap"))
    with contextlib.chdir(folder):
        found["said"] = command_output("export", "none.mcap", "-o", "run.npz", "--variant", "1")
        with np.load("run.npz") as exported:
            found["export"] = dict(exported)
    return found


def archive_content(path: Path) -> dict[str, Any]:
    """An archive file's schemas, messages by topic, attachments and metadata."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        kept = [vars(schema) for schema in summary.schemas.values()] + [vars(c) for c in summary.channels.values()]
        sizes = [(c.compression, c.uncompressed_size, c.compressed_size) for c in summary.chunk_indexes]
        topics: dict[str, list[Any]] = {}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            topics.setdefault(channel.topic, []).append(message)
        attached = {each.name: vars(each) for each in reader.iter_attachments()}
        noted = [(each.name, each.metadata) for each in reader.iter_metadata()]
    facts = [(name, {key: "-" if key in VOLATILE else words for key, words in held.items()}) for name, held in noted]
    stamps = ("log_time", "publish_time", "sequence", "channel_id")
    messages = {
        topic: {"data": b"".join(m.data for m in some), "size": np.array([len(m.data) for m in some])}
        | {name: np.array([getattr(m, name) for m in some]) for name in stamps}
        for topic, some in topics.items()
    }
    return {"kept": kept, "chunks": sizes, "attached": attached, "metadata": facts, "messages": messages}


def run_golden_study(folder: Path) -> dict[str, Any]:
    """Studies from file to table and report, with constraint, adjustment, recorded and worst variants, fatigue."""
    shutil.copy(TWO, folder / "pair.toml")
    found: dict[str, Any] = {}
    for name, design in DESIGNS.items():
        out = folder / name
        points = ", points = 3" if name == "factorial" else ""
        (folder / "study.toml").write_text(STUDY.format(design=design, points=points))
        outcome = warpchain.run_study(folder / "study.toml", out, workers=1)
        table = parquet.read_table(out / "results.parquet")
        kept = sorted(out.glob("**/*.mcap"))
        found[name] = {"table": table, "counts": outcome.counts}
        found[name]["recorded"] = {path.stem: warpchain.read_archive(path) for path in kept}
    with contextlib.chdir(folder):
        found["said"] = command_output("study", "report", "factorial", "-o", "report.html")
        found["page"] = re.sub(r'"data:image[^"]*"', '""', Path("report.html").read_text())
    return found


def command_output(*words: str) -> str:
    """Status and output of a command of `warpchain`."""
    said = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        warnings.simplefilter("always")
        status = command_line(list(words))
    return f"{status}\n{said.getvalue()}"


CASES: dict[str, Callable[[Path], Any]] = {
    "setup": setup_quantities,
    **{
        name: partial(run_example, name)
        for name in ("marine", "engine", "industrial", "motorcycle", "swing_idler", "v6")
    },
    "silent": run_silent_chains,
    "laws": run_laws,
    "guides": run_guides,
    "mounts": run_mounts,
    "tables": lambda _: run_on_one_core([two_sprockets(values) for values in TABLES]),
    "worn": lambda _: run_on_one_core(
        [two_sprockets(WORN), two_sprockets(WORN | PROFILES["minimum"] | {"run.settle": True})]
    ),
    "integrators": run_integrators,
    "mixed": run_mixed_drives,
    "diverging": run_diverging,
    "blocks-guides": golden_blocks.guide_blocks,
    "blocks-moving": golden_blocks.moving_body_blocks,
    "blocks-rk4": golden_blocks.rk4_blocks,
    "blocks-settle": golden_blocks.settling_blocks,
    "readings": read_quantities,
    "archives": archive_messages,
    "study": run_golden_study,
}
