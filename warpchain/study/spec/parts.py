"""The smaller tables of a study file: design, constraints, adjustment, run settings, metrics, recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from warpchain.drive.copies import WAYS
from warpchain.drive.part import BARE, Direction, Part, Positive, Problem, Text, Value, allowed, elements, get, numbers
from warpchain.drive.parts import Step
from warpchain.results.channels import DEFAULT, NAMES
from warpchain.study.spec.factor import Switch, Texts, _plain

SAMPLED = ("latin-hypercube", "sobol", "halton")
KINDS = ("factorial", *SAMPLED, "central-composite", "plackett-burman", "table")
_KINDS_TEXT = "must be " + ", ".join(f'"{kind}"' for kind in KINDS[:-1]) + f' or "{KINDS[-1]}"'

MOST = 100_000_000
Count = Annotated[
    int, Field(strict=True, ge=1, le=MOST), Value(f"must be an integer of at least 1, and at most {MOST}")
]
Copies = Annotated[int, Field(strict=True, ge=1, le=10_000), Value("must be an integer from 1 to 10000")]
Whole = Annotated[int, Field(strict=True, ge=0), Value("must be an integer of at least 0")]
Wholes = Annotated[
    tuple[Annotated[int, Field(strict=True, ge=0)], ...],
    BeforeValidator(_plain),
    Value("must be a list of integers of at least 0"),
]
Window = Annotated[
    tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], Annotated[float, Field(gt=0, allow_inf_nan=False)]],
    BeforeValidator(_plain),
    Value("must be two times [start, end], 0 <= start < end"),
]
Wanted = Annotated[
    Annotated[float, Field(strict=True, allow_inf_nan=False)] | Annotated[str, Field(strict=True, min_length=1)],
    Value("must be a finite number, or an expression of factors"),
]


class Design(Part):
    """How rows are chosen.

    Attributes:
        kind: "factorial" (every combination), "latin-hypercube", "sobol", "halton", "central-composite",
            "plackett-burman" or "table".
        count: number of rows, of the three that sample.
        seed: of the sampling.
        file: the table, CSV or Parquet, relative to the study file; a column for each factor without expression.
        axial: where a central composite design has its axial points: "face" on the ends of the ranges, "inscribed"
            with the corners drawn in, "circumscribed" beyond the ends.
        center: number of center rows of a central composite or Plackett-Burman design.
        replicates: how often each row is run, begun in different ways; None is once.
        replicate_by: "phase" or "nudge" (`warpchain.drive.copies`); None is by phase.
    """

    kind: Annotated[Literal[*KINDS], Value(_KINDS_TEXT)]  # type: ignore[valid-type]
    count: Count | None = None
    seed: Whole | None = None
    file: Text | None = None
    axial: (
        Annotated[
            Literal["face", "inscribed", "circumscribed"], Value('must be "face", "inscribed" or "circumscribed"')
        ]
        | None
    ) = None
    center: Whole | None = None
    replicates: Copies | None = None
    replicate_by: Annotated[Literal[*WAYS], Value('must be "phase" or "nudge"')] | None = None  # type: ignore[valid-type]

    @property
    def copies(self) -> int:
        """How often each row is run."""
        return self.replicates or 1

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        if get(node, "replicate_by") is not None and get(node, "replicates") is None:
            yield Problem(("replicate_by",), get(node, "replicate_by"), "only together with replicates")
        kind = get(node, "kind")
        if kind not in KINDS:
            return
        takes = {
            "count": SAMPLED,
            "seed": SAMPLED,
            "file": ("table",),
            "axial": ("central-composite",),
            "center": ("central-composite", "plackett-burman"),
        }
        for key, kinds in takes.items():
            given = get(node, key)
            if given is not None and kind not in kinds:
                yield Problem((key,), given, f'not with kind "{kind}"')
            elif given is None and kind in kinds and key in ("count", "file"):
                yield Problem((key,), None, f'missing; {allowed(cls, key)}; needed with kind "{kind}"', BARE)


class Constraint(Part):
    """A condition that a row must meet; rows that do not are kept as infeasible.

    Attributes:
        require: a condition on factors, such as "teeth_2 > teeth_1".
    """

    require: Text


class Adjust(Part):
    """What keeps the drive assembled while factors vary, for one strain or preload; at least one of sprocket and links.

    Attributes:
        sprocket: name of the sprocket that moves along a line.
        direction: of that line.
        travel: farthest that it moves either way [m]; None is four pitches.
        links: "even" or "any": the number of links is chosen first, the nearest that fits.
        strain: wanted strain at assembly [-]; or
        preload: wanted tension at assembly [N]; a number, or an expression of factors.
    """

    sprocket: Text | None = None
    direction: Direction | None = None
    travel: Positive | None = None
    links: Annotated[Literal["even", "any"], Value('must be "even" or "any"')] | None = None
    strain: Wanted | None = None
    preload: Wanted | None = None

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        sprocket = get(node, "sprocket")
        if sprocket is None and get(node, "links") is None:
            yield Problem(("sprocket",), None, "missing; give the sprocket that moves, or links, or both", BARE)
        for key in ("direction", "travel"):
            if get(node, key) is not None and sprocket is None:
                yield Problem((key,), get(node, key), "only together with sprocket")
        if sprocket is not None and get(node, "direction") is None:
            yield Problem(("direction",), None, f"missing; {allowed(cls, 'direction')}", BARE)
        strain, preload = get(node, "strain"), get(node, "preload")
        if strain is None and preload is None:
            yield Problem(("preload",), None, f"missing; {allowed(cls, 'preload')}, or give strain instead", BARE)
        if strain is not None and preload is not None:
            yield Problem(("strain",), strain, "not together with preload; give one of the two")
        if numbers(preload) and preload < 0:
            yield Problem(("preload",), preload, "must be at least 0 N")


class RunOptions(Part):
    """How variants are simulated; what is not given is each drive's own.

    Attributes:
        duration: simulated time [s].
        step: time step [s], or "auto".
        precision: "float64" or "float32".
        device: as in `simulate`; None is what is estimated to finish first.
        window: (start, end) over which metrics are taken [s].
        shard: number of variants in a shard; None sizes shards to memory and device.
        keep_states: keep where each run stands at its window's end, so that a longer one goes on from there.
    """

    duration: Positive | None = None
    step: Step | None = None
    precision: Annotated[Literal["float64", "float32"], Value('must be "float64" or "float32"')] = "float64"
    device: Text | None = None
    window: Window | None = None
    shard: Count | None = None
    keep_states: Switch = False

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        window = get(node, "window")
        if isinstance(window, (list, tuple)) and len(window) == 2 and numbers(*window) and window[0] >= window[1]:
            yield Problem(("window",), window, "must be two times [start, end], 0 <= start < end")


class Keep(Part):
    """Which metrics are kept.

    Attributes:
        keep: names of metrics; `*` and `?` stand for any letters, for one letter.
        modes: how many modes of the base drive at rest are followed, the lowest ones; None is none.
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
        worst: those with the most extreme value of a metric, simulated a second time when all are known.
        rate: samples a second of simulated time [Hz]; None is each drive's own.
        channels: of `warpchain.results.channels.NAMES`; those on request only where they are named.
    """

    variants: Wholes = ()
    every: Count | None = None
    worst: Worst | None = None
    rate: Positive | None = None
    channels: Texts = DEFAULT

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        for i, channel in enumerate(elements(node, "channels")):
            if channel not in NAMES:
                yield Problem(("channels", i), channel, f"must be one of {', '.join(NAMES)}")


class Fatigue(Part):
    """The Woehler curve of a link (`warpchain.results.fatigue.Woehler`), for the fatigue of recorded variants.

    Attributes:
        exponent: of the curve.
        range: range of tension that a link endures for `cycles` [N].
        cycles: to failure at that range.
    """

    exponent: Positive
    range: Positive
    cycles: Positive = 1e6
