"""Tables of a study file for calibrations: measurements on a rig, and settings. The unknowns are the noise factors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from warpchain.drive.schema import (
    BARE,
    Finite,
    NonNegative,
    Part,
    Positive,
    Problem,
    Text,
    Value,
    are_numbers,
    node_list,
    node_value,
    plain_sequence,
)
from warpchain.results.measured_file import SIGNAL_STATISTICS
from warpchain.study.results import NOISE
from warpchain.study.spec.factor import DISTRIBUTION_KEYS, Texts, WholeNumber, value_source_of
from warpchain.study.spec.study_tables import metric_unit

_STATISTICS_HELP = "must be a list of " + ", ".join(f'"{name}"' for name in SIGNAL_STATISTICS)
_Band = Annotated[
    tuple[Annotated[float, Field(ge=0.0)], Annotated[float, Field(gt=0.0)]], BeforeValidator(plain_sequence)
]
_BANDS_HELP = "must be a list of bands [low, high] in Hz, 0 <= low < high"


class Measurement(Part):
    """Value of a metric, or a signal, that was measured on a rig.

    Attributes:
        metric: name of the metric that was measured.
        value: measured value, in the metric's unit.
        signal: name of a signal that was measured, as for `warpchain import --as`: "cam->crank.tension".
        file: file with the signal, text such as CSV, MAT (.mat), MDF (.mf4, .mdf) or TDMS, relative to the study file.
        column, time: its columns, variables or channels; see `results.measured_columns.MeasuredColumns`.
        unit, time_unit: their units; None takes what the file says, else SI.
        decimal: "." or ",", in text.
        head: line of the names, in text.
        statistics: statistics of the signal that count, such as "mean", "std", "largest".
        orders: orders of the driver's revolution, whose amplitudes count.
        bands: bands of frequency, low and high end [Hz], whose root mean squares count.
        error: standard deviation of the measurement, in SI.
        relative_error: standard deviation in parts of the value, instead.
    """

    _quantities: ClassVar[frozenset[str]] = frozenset({"value", "error"})

    metric: Text | None = None
    value: Finite | None = None
    signal: Text | None = None
    file: Text | None = None
    column: Text | None = None
    time: Text | None = None
    unit: Text | None = None
    time_unit: Text | None = None
    decimal: Annotated[Literal[".", ","], Value('must be "." or ","')] | None = None
    head: Annotated[int, Field(strict=True, ge=1), Value("must be the number of a line, 1 or more")] | None = None
    statistics: Annotated[
        tuple[Literal[*SIGNAL_STATISTICS], ...], BeforeValidator(plain_sequence), Value(_STATISTICS_HELP)  # type: ignore[valid-type]
    ] = ()
    orders: Annotated[
        tuple[Annotated[float, Field(gt=0.0)], ...],
        BeforeValidator(plain_sequence),
        Value("must be a list of positive numbers"),
    ] = ()
    bands: Annotated[tuple[_Band, ...], BeforeValidator(plain_sequence), Value(_BANDS_HELP)] = ()
    error: Positive | None = None
    relative_error: Positive | None = None

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        """Unit of a number in a measurement's key."""
        if key == "bands":
            return "Hz"
        return metric_unit(node_value(values, "metric")) if key in cls._quantities else ""

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a measurement's keys."""
        if (node_value(node, "metric") is None) == (node_value(node, "signal") is None):
            yield Problem(("metric",), node_value(node, "metric"), "give metric and value, or signal and file", BARE)
            return
        of_signal = ("file", "column", "time", "unit", "time_unit", "decimal", "head", "statistics", "orders", "bands")
        needed, other = ("file", ("value",)) if node_value(node, "signal") is not None else ("value", of_signal)
        if node_value(node, needed) is None:
            yield Problem((needed,), None, "missing", BARE)
        for key in other:
            if node_value(node, key):
                yield Problem(
                    (key,), node_value(node, key), f"not together with {'signal' if needed == 'file' else 'metric'}"
                )
        if needed == "file" and not any(node_list(node, key) for key in ("statistics", "orders", "bands")):
            yield Problem(("statistics",), None, "missing; give statistics, orders or bands of the signal", BARE)
        if (node_value(node, "error") is None) == (node_value(node, "relative_error") is None):
            yield Problem(("error",), node_value(node, "error"), "give either error or relative_error", BARE)
        for i, band in enumerate(node_list(node, "bands")):
            if isinstance(band, (list, tuple)) and len(band) == 2 and are_numbers(*band) and band[0] >= band[1]:
                yield Problem(("bands", i), band, "must be [low, high], low below high")


class Calibrate(Part):
    """Settings of `warpchain calibrate`.

    Attributes:
        count: runs of the first round, spread over the priors.
        batch: runs of each further round, drawn from the posterior so far.
        rounds: further rounds.
        predict: metrics predicted by prior and posterior; none takes those measured.
        model_error: standard deviation of what the model itself misses, in parts of each value.
        seed: seed of everything that is drawn.
    """

    count: Annotated[int, Field(strict=True, ge=8, le=1000), Value("must be an integer from 8 to 1000")] = 48
    batch: Annotated[int, Field(strict=True, ge=4, le=1000), Value("must be an integer from 4 to 1000")] = 16
    rounds: Annotated[int, Field(strict=True, ge=1, le=20), Value("must be an integer from 1 to 20")] = 2
    predict: Texts = ()
    model_error: NonNegative = 0.0
    seed: WholeNumber = 0


def calibration_rules(node: Any) -> Iterator[Problem]:
    """Problems of a study's measurements and of its unknowns."""
    measured = node_list(node, "measured")
    if node_value(node, "calibrate") is not None and not measured:
        yield Problem(("measured",), None, "missing; calibrate needs at least one measured value or signal", BARE)
    if not measured:
        return
    unknowns = [
        (i, factor) for i, factor in enumerate(node_list(node, "factors")) if node_value(factor, "kind") == NOISE
    ]
    if not unknowns:
        yield Problem(("factors",), None, 'none is of kind "noise": measurements need an unknown to explain them', BARE)
    for i, factor in unknowns:
        form = value_source_of(factor)
        if form is not None and (form not in DISTRIBUTION_KEYS or node_value(factor, "integer") is True):
            yield Problem(("factors", i, "distribution"), form, "an unknown needs a continuous distribution")
    if node_value(node_value(node, "design"), "replicates") is not None:
        text = "not together with measured: how far runs scatter is found without replicates"
        yield Problem(("design", "replicates"), node_value(node_value(node, "design"), "replicates"), text)
