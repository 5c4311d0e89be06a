"""Variants of a study, simulated together: a drive out of each row, one call of `simulate`, what becomes of each.

A row that gives no drive, and a drive that cannot be assembled or stepped, fails alone, with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.assembly import assemble
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive
from warpchain.drive.changes import Changes
from warpchain.drive.copies import copies_of
from warpchain.engine.progress import look_for_stop
from warpchain.engine.simulation import MEMORY
from warpchain.errors import DriveError, SimulationError, StudyError, WarpchainError
from warpchain.results.run import RunInfo, Trajectory
from warpchain.study.reasons import reason_of
from warpchain.study.run.adjust import adjusted_all
from warpchain.study.run.places import placed
from warpchain.study.spec import Study

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.archive.options import ArchiveOptions
    from warpchain.engine.states import Kept

Report = Callable[[float], None]
"""Called with the part of the shard's work that is done, 0 to 1."""


@dataclass
class Variant:
    """A row on its way: what it is made of, and what becomes of it.

    Its metrics are a row of the table that `simulate` gave, and those of the base drive's modes beside.
    """

    row: dict[str, Any]
    drive: Drive | None = None
    reason: str | None = None
    copy: int = 0
    adjusted: dict[str, Any] = field(default_factory=dict)
    measured: tuple[pa.Table, int] | None = None
    modes: dict[str, Any] = field(default_factory=dict)
    recorded: bool = False
    trajectory: Trajectory | None = None
    info: RunInfo | None = None
    archive: tuple[str, int] | None = None
    begin: Kept | None = None
    kept: Kept | None = None
    gone_on: bool = False

    def fail(self, error: WarpchainError) -> None:
        """Makes it infeasible."""
        self.drive, self.reason = None, reason_of(error)

    @property
    def status(self) -> str:
        """As it is judged, or "infeasible" where it gave no metrics."""
        return "infeasible" if self.measured is None else str(self._told("status"))

    def outcome(self) -> str | None:
        """Why it is not ok, None where it is."""
        return self.reason if self.measured is None else self._told("reason") or None

    def _told(self, column: str) -> Any:
        assert self.measured is not None  # asked for only then
        table, row = self.measured
        return table[column][row].as_py()

    @property
    def metrics(self) -> dict[str, Any]:
        """Its metrics by name; none of a row that gave none."""
        if self.measured is None:
            return {}
        table, row = self.measured
        values = table.slice(row, 1).to_pylist()[0]
        return {name: value for name, value in values.items() if value is not None} | self.modes


def simulate_variants(
    study: Study, base: Drive, variants: Sequence[Variant], archive: Path, options: Mapping[str, Any], report: Report
) -> None:
    """Makes the variants' drives, simulates them, and archives those to be recorded.

    Recorded variants are simulated with the others and held until the end, if they find room in half of the memory;
    else in a call of their own, which writes while it runs.

    Args:
        study: what to do.
        base: the base drive.
        variants: the rows; they are filled.
        archive: file of the recorded variants.
        options: `memory`, `workers` and `archive_options` of `simulate`.
        report: called as the work goes on.

    Raises:
        SimulationError: a refusal that meets every variant.
        ArchiveError: the archive cannot be written.
        KeyboardInterrupt: the user stopped it.
    """
    on = [variant for variant in variants if variant.begin is not None]
    if on and len(on) < len(variants):  # a GPU takes those that go on by themselves
        anew = [variant for variant in variants if variant.begin is None]
        share = len(anew) / len(variants)
        simulate_variants(study, base, anew, archive, options, lambda part: report(share * part))
        simulate_variants(study, base, on, archive, options, lambda part: report(share + (1.0 - share) * part))
        return
    _build_all(study, base, variants)
    if _held(study, variants, options.get("memory", MEMORY)):
        _simulate(study, variants, None, options, report)
        _archive(variants, archive, options.get("archive_options"))
        _follow_modes(study, base, variants)
        return
    streamed = [variant for variant in variants if variant.recorded]
    plain = [variant for variant in variants if not variant.recorded]
    share = len(plain) / len(variants)
    _simulate(study, plain, None, options, lambda part: report(share * part))
    _simulate(study, streamed, archive, options, lambda part: report(share + (1.0 - share) * part))
    _follow_modes(study, base, variants)


def _follow_modes(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Adds the base drive's modes to the metrics of the variants, where the study asks for them."""
    if study.metrics.modes is None:
        return
    from warpchain.modal.metrics import base_modes, mode_metrics

    wanted = base_modes(base, study.metrics.modes)
    for variant in variants:
        look_for_stop()
        if variant.drive is not None and variant.measured is not None:
            variant.modes = mode_metrics(wanted, variant.drive)


def _build_all(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes the drives of all rows, each once, and the copies that are run of them."""
    made: dict[int, Variant] = {}
    for variant in variants:
        made.setdefault(variant.row["variant"], variant)
    build(study, base, list(made.values()))
    for variant in variants:
        first = made[variant.row["variant"]]
        variant.drive, variant.reason, variant.adjusted = first.drive, first.reason, first.adjusted
    feasible = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    numbers = [variant.copy for variant, _ in feasible]
    copies = copies_of([drive for _, drive in feasible], numbers, study.design.replicate_by or "phase")
    for (variant, _), drive in zip(feasible, copies, strict=True):
        variant.drive = drive


def build(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes rows' drives, adjusted together; a row that gives none says why."""
    changes = Changes(base) if len(variants) > 1 else None
    for number, variant in enumerate(variants):
        if number % 64 == 0:
            look_for_stop()
        if variant.reason is not None:
            continue
        try:
            variant.drive = placed(study, base, variant.row, changes)
        except (DriveError, StudyError) as error:
            variant.fail(error)
    if study.adjust is None:
        return
    whole = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    rows = [variant.row for variant, _ in whole]
    outcomes = adjusted_all([drive for _, drive in whole], study.adjust, rows)
    for (variant, _), outcome in zip(whole, outcomes, strict=True):
        if isinstance(outcome, WarpchainError):
            variant.fail(outcome)
        else:
            variant.drive, variant.adjusted = outcome


def try_out(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes rows' drives; one that cannot be assembled or stepped says why."""
    build(study, base, variants)
    for variant in variants:
        if variant.drive is not None:
            _try_alone(study, variant)


def _simulate(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: Report
) -> None:
    """Simulates the variants that have a drive; those that are refused fail alone.

    A drive that cannot be assembled or stepped ends the whole call, so then each is looked at. What else is refused is
    halved until it is known which variants are to blame; a refusal that meets every variant is the study's own.
    """
    feasible = [variant for variant in variants if variant.drive is not None]
    refused = _attempt(study, feasible, archive, options, report)
    if isinstance(refused, DriveError):
        for variant in feasible:
            _try_alone(study, variant)
        feasible = [variant for variant in feasible if variant.drive is not None]
        refused = _attempt(study, feasible, archive, options, report)
    if refused is None:
        return
    if archive is not None:
        raise refused
    blamed: list[tuple[Variant, WarpchainError]] = []
    groups = [(feasible, refused)]
    while groups:
        group, error = groups.pop()
        if len(group) == 1:
            blamed.append((group[0], error))
            continue
        for half in (group[: len(group) // 2], group[len(group) // 2 :]):
            again = _attempt(study, half, None, options, report)
            if again is not None:
                groups.append((half, again))
    if len(blamed) == len(feasible) and isinstance(refused, SimulationError):
        raise refused
    for variant, error in blamed:
        variant.fail(error)


def _try_alone(study: Study, variant: Variant) -> None:
    """Finds out whether a drive can be assembled and stepped."""
    assert variant.drive is not None  # as chosen
    try:
        resolve_step(variant.drive, study.run.step)
        assemble(variant.drive)
    except DriveError as error:
        variant.fail(error)


def _attempt(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: Report
) -> WarpchainError | None:
    """Simulates variants in one call; returns a refusal of a drive, of the settings or of the machine's memory."""
    from warpchain.engine.simulation import simulate
    from warpchain.engine.states import States
    from warpchain.results.run import Record

    def tell(phase: str, done: float, total: float) -> None:
        if phase == "simulating":
            report(done / total)

    if not variants:
        return None
    recorded = [i for i, variant in enumerate(variants) if variant.recorded]
    if archive is not None:
        options = {**options, "archive_options": _numbered(variants, options.get("archive_options"))}
    states = None
    if study.run.keep_states or any(variant.begin is not None for variant in variants):
        states = States(study.run.keep_states, [variant.begin for variant in variants])
    try:
        run = simulate(
            [variant.drive for variant in variants if variant.drive is not None],
            device=study.run.device,
            precision=study.run.precision,
            duration=study.run.duration,
            step=study.run.step,
            record=Record(recorded, study.record.rate, study.record.channels),
            window=study.run.window,
            progress=tell,
            archive=archive,
            overwrite=True,
            limits=study.limits,
            states=states,
            **options,
        )
    except (DriveError, SimulationError) as error:
        return error
    if run.info.ended != "complete":
        if archive is not None:
            archive.unlink(missing_ok=True)
        raise KeyboardInterrupt
    metrics = run.metrics.combine_chunks()
    for i, variant in enumerate(variants):
        variant.measured = metrics, i
        if states is not None:
            variant.kept, variant.gone_on = states.kept[i], states.used[i]
        if archive is not None:
            variant.archive = (archive.name, variant.row["variant"])
        elif variant.recorded:
            variant.trajectory, variant.info = run[i], run.info
    return None


def _held(study: Study, variants: Sequence[Variant], memory: int) -> bool:
    """Whether the trajectories of the recorded variants find room in half of the memory."""
    from warpchain.engine.simulation import schedules_of
    from warpchain.results.channels import frame_of, frame_width
    from warpchain.results.run import Record

    record, frame, size = Record(rate=study.record.rate), frame_of(study.record.channels), 0
    for variant in variants:
        if variant.recorded and variant.drive is not None:
            try:
                (schedule,) = schedules_of(
                    [variant.drive], study.run.duration, study.run.step, record, study.run.window
                )
            except (DriveError, SimulationError):
                continue  # it is said when it is simulated
            size += 8 * schedule.frames * frame_width(variant.drive, frame)
    return 2 * size <= memory


def _numbered(variants: Sequence[Variant], options: ArchiveOptions | None) -> ArchiveOptions:
    """How an archive is written that calls its variants by their numbers in the study."""
    from warpchain.archive.options import ArchiveOptions

    return replace(options or ArchiveOptions(), numbers=[variant.row["variant"] for variant in variants])


def _archive(variants: Sequence[Variant], path: Path, options: ArchiveOptions | None) -> None:
    """Writes the trajectories that are held, as an archive of their variants alone, by their numbers in the study."""
    from warpchain.archive import write_archive
    from warpchain.results.metrics import table_of
    from warpchain.results.run import Run

    held = [variant for variant in variants if variant.trajectory is not None]
    if not held:
        return
    drives = tuple(variant.drive for variant in held if variant.drive is not None)
    metrics = table_of([variant.metrics for variant in held])
    trajectories = {i: v.trajectory for i, v in enumerate(held) if v.trajectory is not None}
    assert held[0].info is not None  # comes with the trajectory
    write_archive(Run(drives, metrics, trajectories, held[0].info), path, True, _numbered(held, options))
    for variant in held:
        variant.archive, variant.trajectory = (path.name, variant.row["variant"]), None
