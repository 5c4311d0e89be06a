"""Smaller tables of a study file: design, constraints, run settings, metrics, recording, objectives, limits.

In files, `limits` is a table, or a list: entries with `metric` are limits on metrics (`Study.bounds`), the others that
table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from warpchain.drive.quantities import converted_number, equivalent_units, match_quantity, unit_from_text
from warpchain.drive.replicates import FORMER_WAYS, MOST_COPIES, REPLICATE_WAYS
from warpchain.drive.run_settings import Step
from warpchain.drive.schema import (
    BARE,
    Direction,
    Finite,
    Part,
    Positive,
    Problem,
    Text,
    Value,
    allowed_text,
    are_numbers,
    node_list,
    node_value,
    plain_sequence,
)
from warpchain.results.channels import CHANNEL_NAMES, DEFAULT_CHANNELS
from warpchain.results.metric_columns import unit_of_metric
from warpchain.study.results import ADJUSTMENT_COLUMNS
from warpchain.study.spec.factor import Switch, Texts, WholeNumber
from warpchain.study.spec.noise_table import metric_from_name

SAMPLED_DESIGNS = ("latin-hypercube", "sobol", "halton")
DESIGN_KINDS = ("factorial", *SAMPLED_DESIGNS, "central-composite", "plackett-burman", "table", "noise")
_KINDS_HELP = "must be " + ", ".join(f'"{kind}"' for kind in DESIGN_KINDS[:-1]) + f' or "{DESIGN_KINDS[-1]}"'

MOST_COUNT = 100_000_000
Count = Annotated[
    int, Field(strict=True, ge=1, le=MOST_COUNT), Value(f"must be an integer of at least 1, and at most {MOST_COUNT}")
]
ReplicateCount = Annotated[
    int, Field(strict=True, ge=1, le=MOST_COPIES), Value(f"must be an integer from 1 to {MOST_COPIES}")
]
WholeNumbers = Annotated[
    tuple[Annotated[int, Field(strict=True, ge=0)], ...],
    BeforeValidator(plain_sequence),
    Value("must be a list of integers of at least 0"),
]
ReplicateBy = Annotated[Literal[*REPLICATE_WAYS, *FORMER_WAYS], Value('must be "build", "phase" or "perturbation"')]  # type: ignore[valid-type]
Window = Annotated[
    tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], Annotated[float, Field(gt=0, allow_inf_nan=False)]],
    BeforeValidator(plain_sequence),
    Value("must be two times [start, end], 0 <= start < end"),
]
NumberOrExpression = Annotated[
    Annotated[float, Field(strict=True, allow_inf_nan=False)] | Annotated[str, Field(strict=True, min_length=1)],
    Value("must be a finite number, or an expression of factors"),
]
SEARCH_ENGINES = ("bayes", "population")
_UpToMillion = Annotated[int, Field(strict=True, ge=1, le=1_000_000), Value("must be an integer from 1 to 1000000")]


def metric_unit(name: Any) -> str:
    """Unit of a metric or its statistic, or ""."""
    if not isinstance(name, str):
        return ""
    metric = metric_from_name(name)
    found = ADJUSTMENT_COLUMNS.get(metric.rpartition(".")[2]) or unit_of_metric(metric)
    return "-" if found == "1" else found if unit_from_text(found) else ""


class Design(Part):
    """Choice of rows.

    Attributes:
        kind: "factorial" (every combination), "latin-hypercube", "sobol", "halton", "central-composite",
            "plackett-burman", "table", or "noise": the drive as it is, where all factors are noise.
        count: number of rows that the three that sample take.
        seed: seed of the sampling.
        file: the table, CSV or Parquet, relative to the study file; a column for each factor without expression.
        axial: where a central composite design has its axial points: "face" on the ends of the ranges, "inscribed"
            with the corners drawn in, "circumscribed" beyond the ends.
        center: number of center rows of a central composite or Plackett-Burman design.
        replicates: how often each row is run, begun in different ways; None is once.
        replicate_by: "build", "phase" or "perturbation" (`warpchain.drive.replicates`); None is "build".
        today: also run the base drive as it is, today's design, for pages to show beside the others.
    """

    kind: Annotated[Literal[*DESIGN_KINDS], Value(_KINDS_HELP)]  # type: ignore[valid-type]
    count: Count | None = None
    seed: WholeNumber | None = None
    file: Text | None = None
    axial: (
        Annotated[
            Literal["face", "inscribed", "circumscribed"], Value('must be "face", "inscribed" or "circumscribed"')
        ]
        | None
    ) = None
    center: WholeNumber | None = None
    replicates: ReplicateCount | None = None
    replicate_by: ReplicateBy | None = None
    today: Switch | None = None

    @property
    def copies(self) -> int:
        """Number of runs of each design row."""
        return self.replicates or 1

    @property
    def replicate_way(self) -> str:
        """Way in which a row's replicates differ."""
        return self.replicate_by or REPLICATE_WAYS[0]

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a design's keys with its kind."""
        if node_value(node, "replicate_by") is not None and node_value(node, "replicates") is None:
            yield Problem(("replicate_by",), node_value(node, "replicate_by"), "only together with replicates")
        kind = node_value(node, "kind")
        if kind not in DESIGN_KINDS:
            return
        if node_value(node, "today") and kind == "noise":
            yield Problem(("today",), True, 'not with kind "noise", whose rows are all of the drive as it is')
        takes = {
            "count": SAMPLED_DESIGNS,
            "seed": SAMPLED_DESIGNS,
            "file": ("table",),
            "axial": ("central-composite",),
            "center": ("central-composite", "plackett-burman"),
        }
        for key, kinds in takes.items():
            given = node_value(node, key)
            if given is not None and kind not in kinds:
                yield Problem((key,), given, f'not with kind "{kind}"')
            elif given is None and kind in kinds and key in ("count", "file"):
                yield Problem((key,), None, f'missing; {allowed_text(cls, key)}; needed with kind "{kind}"', BARE)


class Constraint(Part):
    """A condition that a row must satisfy; others are kept as infeasible.

    Attributes:
        require: a condition on factors, such as "teeth_2 > teeth_1".
    """

    require: Text


_CONDITION_MARKS = re.compile(r"(<=|>=|==|!=|<|>|\band\b|\bor\b|\bnot\b|[()])")
_COMPARISON_MARKS = ("<=", ">=", "==", "!=", "<", ">")


def condition_without_units(text: str, units: Mapping[str, str]) -> tuple[str, str]:
    """Condition in plain numbers, and a complaint or ""."""
    words = _CONDITION_MARKS.split(text)
    for k in range(0, len(words), 2):
        match = match_quantity(words[k].strip())
        if match is None or unit_from_text(match[2]) is None or (match[2].startswith("%") and match[2] != "%"):
            continue  # 90 % m is a remainder
        beside = [
            words[j + (j - k)] for j in (k - 1, k + 1) if 0 < j < len(words) - 1 and words[j] in _COMPARISON_MARKS
        ]
        wanted = {units.get(word.strip(), "") for word in beside}
        if len(wanted) != 1 or "" in wanted:
            return text, f"{words[k].strip()} must be compared with a factor alone, whose values have a unit"
        found = converted_number(words[k].strip(), *wanted)
        if found is None:
            return text, f"{words[k].strip()} must have a unit that fits: {', '.join(equivalent_units(*wanted))}"
        if not math.isfinite(found):
            return text, f"{words[k].strip()} must be a finite number of {', '.join(wanted)}"
        words[k] = f" {found!r} "
    return "".join(words).strip(), ""


class Adjust(Part):
    """Adjustment of a sprocket, the links, or both, that keeps the drive assembled, for a strain or preload.

    Attributes:
        sprocket: name of the sprocket that moves along a line.
        direction: direction of that line.
        travel: farthest that it moves either way [m]; None is four pitches.
        links: "even" or "any": the number of links is chosen first, the nearest that fits.
        chain: name of the adjusted chain, where there are several; None is the sprocket's, where no other is adjusted.
        strain: wanted strain at assembly [-]; this or preload.
        preload: wanted tension at assembly [N]; a number, or an expression of factors.
    """

    sprocket: Text | None = None
    direction: Direction | None = None
    travel: Positive | None = None
    links: Annotated[Literal["even", "any"], Value('must be "even" or "any"')] | None = None
    chain: Text | None = None
    strain: NumberOrExpression | None = None
    preload: NumberOrExpression | None = None

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of an adjustment's keys."""
        sprocket = node_value(node, "sprocket")
        if sprocket is None and node_value(node, "links") is None:
            yield Problem(("sprocket",), None, "missing; give the sprocket that moves, or links, or both", BARE)
        for key in ("direction", "travel"):
            if node_value(node, key) is not None and sprocket is None:
                yield Problem((key,), node_value(node, key), "only together with sprocket")
        if sprocket is not None and node_value(node, "direction") is None:
            yield Problem(("direction",), None, f"missing; {allowed_text(cls, 'direction')}", BARE)
        strain, preload = node_value(node, "strain"), node_value(node, "preload")
        if strain is None and preload is None:
            yield Problem(("preload",), None, f"missing; {allowed_text(cls, 'preload')}, or give strain instead", BARE)
        if strain is not None and preload is not None:
            yield Problem(("strain",), strain, "not together with preload; give one of the two")
        if are_numbers(preload) and preload < 0:
            yield Problem(("preload",), preload, "must be at least 0 N")


def named_adjustments(adjusts: Sequence[Adjust]) -> list[tuple[str, str, Adjust]]:
    """Key path, column prefix and adjustment, for each."""
    if len(adjusts) == 1:
        return [("adjust", "", adjusts[0])]
    return [(f"adjust.{adjust.chain}", f"{adjust.chain}.", adjust) for adjust in adjusts]


def adjustment_columns(adjusts: Sequence[Adjust]) -> list[str]:
    """Names of the columns that adjustments add to results."""
    count, travel = ADJUSTMENT_COLUMNS
    asked = [(before, adjust.links, adjust.sprocket) for _, before, adjust in named_adjustments(adjusts)]
    return [
        before + name
        for before, *values in asked
        for name, value in zip((count, travel), values, strict=True)
        if value is not None
    ]


def adjustment_rules(node: Any) -> Iterator[Problem]:
    """Problems of the chains that adjustments name."""
    adjusts = node_list(node, "adjust")
    chains: list[Any] = []
    for k, adjust in enumerate(adjusts if len(adjusts) > 1 else ()):
        chain = node_value(adjust, "chain")
        if chain is None:
            yield Problem(
                ("adjust", k, "chain"), None, "missing; each of several adjustments must name a chain of its own", BARE
            )
        elif chain in chains:
            yield Problem(("adjust", k, "chain"), chain, f"is that of adjustment {chains.index(chain) + 1} already")
        chains.append(chain)


class RunOptions(Part):
    """Run settings of variants; those not given are each drive's own.

    Attributes:
        duration: simulated time [s].
        step: time step [s], or "auto".
        start: whether runs are starts, as `run.start` of a drive.
        precision: "float64" or "float32".
        device: the device as in `simulate`; None is what is estimated to finish first.
        window: (start, end) over which metrics are taken [s].
        shard: number of variants in a shard; None sizes shards to memory and device.
        keep_states: keep the state of each run at its window's end, so that a longer one goes on from it.
    """

    duration: Positive | None = None
    step: Step | None = None
    start: Switch | None = None
    precision: Annotated[Literal["float64", "float32"], Value('must be "float64" or "float32"')] = "float64"
    device: Text | None = None
    window: Window | None = None
    shard: Count | None = None
    keep_states: Switch = False

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of the run's window."""
        window = node_value(node, "window")
        if isinstance(window, (list, tuple)) and len(window) == 2 and are_numbers(*window) and window[0] >= window[1]:
            yield Problem(("window",), window, "must be two times [start, end], 0 <= start < end")


class Keep(Part):
    """Which metrics are kept.

    Attributes:
        keep: names of metrics; `*` and `?` match any letters, one letter.
        modes: how many of the base drive's lowest modes at rest are followed; None is none.
    """

    keep: Annotated[Texts, Field(min_length=1)] = ("*",)
    modes: Count | None = None


class Worst(Part):
    """The variants with the most extreme value of a metric.

    Attributes:
        metric: its name.
        count: how many variants.
        side: "largest" or "smallest".
    """

    metric: Text
    count: Count
    side: Annotated[Literal["largest", "smallest"], Value('must be "largest" or "smallest"')] = "largest"


class Recording(Part):
    """Which variants are recorded in full, in archives.

    Attributes:
        variants: their numbers.
        every: every k-th, from 0.
        worst: those with the most extreme value of a metric, simulated again when all are known.
        rate: samples a second of simulated time [Hz]; None is each drive's own.
        channels: names of `warpchain.results.channels.CHANNEL_NAMES`; those on request only where named.
    """

    variants: WholeNumbers = ()
    every: Count | None = None
    worst: Worst | None = None
    rate: Positive | None = None
    channels: Texts = DEFAULT_CHANNELS

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of names of recorded channels."""
        for i, channel in enumerate(node_list(node, "channels")):
            if channel not in CHANNEL_NAMES:
                yield Problem(("channels", i), channel, f"must be one of {', '.join(CHANNEL_NAMES)}")


class Fatigue(Part):
    """The Woehler curve of a link (`warpchain.results.fatigue.Woehler`), for the fatigue of recorded variants.

    Attributes:
        exponent: exponent of the curve.
        range: range of tension that a link endures for `cycles` [N].
        cycles: cycles to failure at that range.
    """

    exponent: Positive
    range: Positive
    cycles: Positive = 1e6


class Objective(Part):
    """An objective: a metric or factor that should be small or large.

    Attributes:
        metric: a metric, or a factor.
        sense: "min" or "max".
    """

    metric: Text
    sense: Annotated[Literal["min", "max"], Value('must be "min" or "max"')] = "min"


class Bound(Part):
    """A limit on a metric; at least one of both ends.

    Attributes:
        metric: a metric, or `adjusted_links` or `adjusted_travel` of what `adjust` chooses.
        min, max: least and largest value, in its unit.
    """

    _quantities: ClassVar[frozenset[str]] = frozenset({"min", "max"})

    metric: Text
    min: Finite | None = None
    max: Finite | None = None

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        """Unit of a limit's numbers, that of the metric."""
        return metric_unit(node_value(values, "metric")) if key in cls._quantities else ""

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a limit's ends."""
        low, high = node_value(node, "min"), node_value(node, "max")
        if low is None and high is None:
            yield Problem(("max",), None, "missing; must be a finite number; give max, min or both", BARE)
        if are_numbers(low, high) and low >= high:
            yield Problem(("max",), high, f"must be above min, which is {low:g}")


class Search(Part):
    """Settings of the search of `warpchain optimize`.

    Attributes:
        engine: "bayes", few costly runs, or "population", many at once.
        count: rows in all, those of the design among them; the last round is run whole.
        batch: rows of a round, or of a generation.
        seed: seed of everything that is drawn.
        recommend: most designs that are recommended.
    """

    engine: Annotated[Literal[*SEARCH_ENGINES], Value('must be "bayes" or "population"')] = "bayes"  # type: ignore[valid-type]
    count: _UpToMillion = 64
    batch: _UpToMillion = 8
    seed: WholeNumber = 0
    recommend: _UpToMillion = 4


class Risk(Part):
    """Settings of `warpchain risk`.

    Attributes:
        count: runs of a level of subset simulation, in each repetition.
        repeats: independent repetitions.
        samples: runs of importance sampling.
        seed: seed of everything that is drawn.
    """

    count: Annotated[
        int,
        Field(strict=True, ge=50, le=1_000_000, multiple_of=10),
        Value("must be a multiple of 10 from 50 to 1000000"),
    ] = 200
    repeats: Annotated[int, Field(strict=True, ge=3, le=1000), Value("must be an integer from 3 to 1000")] = 8
    samples: Annotated[int, Field(strict=True, ge=50, le=1_000_000), Value("must be an integer from 50 to 1000000")] = (
        1000
    )
    seed: WholeNumber = 0


_BOUND_KEYS = ("metric", "min", "max")
_METRIC_LISTS = {"objectives": "objectives", "bounds": "limits"}


def _is_bound_entry(entry: Any) -> bool:
    """Whether an entry of `limits` is on a metric."""
    return not isinstance(entry, Mapping) or any(key in entry for key in _BOUND_KEYS)


def fields_from_file(values: Any) -> Any:
    """Fields of a `Study` from a study file's values."""
    if not isinstance(values, Mapping):
        return values
    adjust = values.get("adjust", ())
    if adjust is None or isinstance(adjust, Mapping | Adjust):
        values = {**values, "adjust": () if adjust is None else (adjust,)}
    limits = values.get("limits")
    if not isinstance(limits, (list, tuple)):
        return values
    judged: dict[str, Any] = {}
    for entry in limits:
        if not _is_bound_entry(entry):
            judged |= entry
    return {**values, "bounds": tuple(entry for entry in limits if _is_bound_entry(entry)), "limits": judged}


def file_from_fields(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a study file from a `Study`'s fields."""
    if len(values.get("adjust", ())) == 1:
        values = {**values, "adjust": values["adjust"][0]}
    if not values.get("bounds"):
        return values
    rest = {key: value for key, value in values.items() if key != "bounds"}
    judged = values.get("limits") or {}
    return rest | {"limits": (*values["bounds"], *((judged,) if judged else ()))}


def objective_rules(node: Any) -> Iterator[Problem]:
    """Problems of a study's objectives and limits."""
    for key in _METRIC_LISTS:
        names: set[str] = set()
        for i, entry in enumerate(node_list(node, key)):
            name = node_value(entry, "metric")
            if not isinstance(name, str):
                continue  # its own rule says so
            if name in names:
                yield Problem((key, i, "metric"), name, f"must be unique among {_METRIC_LISTS[key]}")
            names.add(name)
    if node_value(node, "optimize") is not None and not node_list(node, "objectives"):
        yield Problem(("optimize",), None, "needs at least one entry of objectives", BARE)
