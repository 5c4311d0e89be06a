"""Table `noise` of a study file, and names of statistics of metrics over it: "mean(M)", "std(M)", "q95(M)"."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from warpchain.drive.schema import BARE, Part, Problem, Value, are_numbers, node_list, node_value, plain_sequence
from warpchain.errors import StudyError
from warpchain.study.results import NOISE
from warpchain.study.spec.expression import parse_expression
from warpchain.study.spec.factor import Texts, WholeNumber, value_source_of

if TYPE_CHECKING:
    from pathlib import Path

    from warpchain.study.spec.factor import Factor

_STATISTIC_PATTERN = re.compile(r"(mean|std|q(\d{1,2}(?:\.\d+)?))\((.+)\)")
_RankRow = Annotated[tuple[Annotated[float, Field(strict=True, ge=-1.0, le=1.0)], ...], BeforeValidator(plain_sequence)]
RankMatrix = Annotated[
    tuple[_RankRow, ...], BeforeValidator(plain_sequence), Value("must be a list of lists of numbers from -1 to 1")
]
LEAST_EIGENVALUE = 1e-9


@dataclass(frozen=True)
class Statistic:
    """Statistic of a metric over noise."""

    word: str  # "mean", "std", or a quantile as written, such as "q95"
    metric: str
    level: float | None = None  # probability of a quantile [-]


def statistic_from_name(name: str) -> Statistic | None:
    """Statistic of a name such as "q95(M)", or None."""
    found = _STATISTIC_PATTERN.fullmatch(name)
    if found is None or (found[2] is not None and float(found[2]) == 0.0):
        return None
    return Statistic(found[1], found[3], None if found[2] is None else float(found[2]) / 100.0)


def metric_from_name(name: str) -> str:
    """Metric in a name such as "q95(M)" or "M"."""
    found = statistic_from_name(name)
    return name if found is None else found.metric


class Noise(Part):
    """The noise that designs are compared over: the same rows for each.

    Attributes:
        count: rows of noise; each design is run with all of them.
        seed: seed of their sampling.
        correlated: noise factors whose ranks correlate, a group of these by its name.
        ranks: rank correlations of these (Spearman's), a symmetric matrix with 1 on its diagonal.
        keep: share of the noise in which limits on metrics must be kept.
    """

    count: Annotated[int, Field(strict=True, ge=4, le=100_000), Value("must be an integer from 4 to 100000")] = 32
    seed: WholeNumber = 0
    correlated: Texts = ()
    ranks: RankMatrix = ()
    keep: Annotated[float, Field(strict=True, gt=0.0, lt=1.0), Value("must be a number between 0 and 1")] = 0.95

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of rank correlations in the table `noise`."""
        names, ranks = node_list(node, "correlated"), node_list(node, "ranks")
        if not names and not ranks:
            return
        if len(names) < 2 or len(set(names)) < len(names):
            yield Problem(("correlated",), list(names), "must be at least 2 different noise factors or groups of these")
        elif not _is_correlation_matrix(ranks, len(names)):
            text = f"must be a symmetric matrix of {len(names)} rows with 1 on its diagonal"
            yield Problem(("ranks",), None, text, BARE)
        elif (why := _copula_complaint(names, np.array(ranks, dtype=float))) is not None:
            yield Problem(("ranks",), None, why, BARE)


def _copula_complaint(names: Sequence[Any], ranks: Any) -> str | None:
    """Complaint if no Gaussian copula has these rank correlations."""
    for i, j in itertools.combinations(range(len(names)), 2):
        if abs(ranks[i, j]) == 1.0:
            how = "give their factors the same group" if ranks[i, j] > 0.0 else "make one an expression of the other"
            return f"{names[i]} and {names[j]}, correlated by {ranks[i, j]:g}, are one random variable: {how}"
    if _least_eigenvalue(normal_from_rank_correlation(ranks)) > LEAST_EIGENVALUE:
        return None
    if _least_eigenvalue(ranks) <= LEAST_EIGENVALUE:
        return (
            f"no factors can be correlated so: the matrix is not positive definite (eigenvalue "
            f"{_least_eigenvalue(ranks):.2g})"
        )
    apart = ranks - np.eye(len(ranks))
    part = next(
        k
        for k in range(99, -1, -1)
        if _least_eigenvalue(normal_from_rank_correlation(np.eye(len(ranks)) + 0.01 * k * apart)) > LEAST_EIGENVALUE
    )
    return (
        "the matrix is positive definite, but not 2 sin(pi r / 6) of its numbers r, by which normal variables must "
        f"correlate for such ranks (eigenvalue {_least_eigenvalue(normal_from_rank_correlation(ranks)):.2g}): "
        f"take at most "
        f"{0.01 * part:.2g} times what is off the diagonal"
    )


def _least_eigenvalue(matrix: Any) -> float:
    """Least eigenvalue of a symmetric matrix."""
    return float(np.linalg.eigvalsh(matrix).min())


def _is_correlation_matrix(ranks: Any, size: int) -> bool:
    """Whether lists are a correlation matrix of this size."""
    if len(ranks) != size or any(
        not isinstance(r, (list, tuple)) or len(r) != size or not are_numbers(*r) for r in ranks
    ):
        return False
    matrix = np.array(ranks, dtype=float)
    return bool((matrix == matrix.T).all() and (np.diag(matrix) == 1.0).all() and (np.abs(matrix) <= 1.0).all())


def normal_from_rank_correlation(ranks: Any) -> Any:
    """Correlation of normals from that of ranks (Pearson 1907)."""
    return 2.0 * np.sin(np.pi * ranks / 6.0)


def noise_factor_names(node: Any) -> tuple[str, ...]:
    """Names of noise factors and their dependents."""
    found = [
        str(node_value(factor, "name")) for factor in node_list(node, "factors") if node_value(factor, "kind") == NOISE
    ]
    tied = {
        str(node_value(factor, "name")): _expression_names(node_value(factor, "expression"))
        for factor in node_list(node, "factors")
        if value_source_of(factor) == "expression"
    }
    count = -1
    while found and count != len(found):
        count = len(found)
        found += [name for name, needs in tied.items() if name not in found and set(needs) & set(found)]
    return tuple(found)


def _expression_names(text: Any) -> tuple[str, ...]:
    """Names of factors in an expression's text."""
    try:
        return parse_expression(text).names if isinstance(text, str) else ()
    except StudyError:
        return ()  # its own rule says so


def noise_table_rules(node: Any) -> Iterator[Problem]:
    """Problems of a study's noise with its other tables."""
    factors, noise = node_list(node, "factors"), noise_factor_names(node)
    own = [str(node_value(f, "name")) for f in factors if node_value(f, "kind") == NOISE]
    if node_value(node, "noise") is not None and not noise:
        yield Problem(("noise",), None, 'needs at least one factor of kind "noise"', BARE)
    free = [node_value(factor, "name") for factor in factors if value_source_of(factor) != "expression"]
    if node_value(node_value(node, "design"), "kind") == NOISE and len(own) < len(free):
        other = next(name for name in free if name not in own)
        yield Problem(
            ("design", "kind"), NOISE, f"is of studies whose factors are all noise; {other} is a design factor"
        )
    groups: dict[str, Any] = {}
    for i, factor in enumerate(factors):
        group = node_value(factor, "group")
        if isinstance(group, str) and groups.setdefault(group, node_value(factor, "kind") == NOISE) != (
            node_value(factor, "kind") == NOISE
        ):
            yield Problem(("factors", i, "group"), group, "factors of a group must be of one kind")
    yield from _correlation_rules(node, [f for f in factors if node_value(f, "kind") == NOISE])
    for i, constraint in enumerate(node_list(node, "constraints")):
        reached = [name for name in _expression_names(node_value(constraint, "require")) if name in noise]
        if reached:
            text = f"{reached[0]} is noise, which nobody can choose: constrain design factors"
            yield Problem(("constraints", i, "require"), node_value(constraint, "require"), text)
    for key in ("objectives", "bounds"):
        for i, entry in enumerate(node_list(node, key)):
            metric = node_value(entry, "metric")
            if metric in noise:
                yield Problem((key, i, "metric"), metric, "is noise, which nobody can choose")
            elif isinstance(metric, str) and statistic_from_name(metric) is not None and not noise:
                yield Problem((key, i, "metric"), metric, 'is a statistic over noise: needs a factor of kind "noise"')


def _correlation_rules(node: Any, factors: list[Any]) -> Iterator[Problem]:
    """Problems of names in `noise.correlated`."""
    groups = {str(node_value(f, "name")): node_value(f, "group") for f in factors}
    free = [name for name, group in groups.items() if group is None]
    known = list(dict.fromkeys(name if group is None else str(group) for name, group in groups.items()))
    for name in node_list(node_value(node, "noise"), "correlated"):
        text = None
        if name in free and name in groups.values():
            text = f"{name} is a noise factor and a group of others: rename one"
        elif name not in known:
            is_ = "is not a noise factor or a group of these"
            is_ = f"is of the group {groups[name]}, which varies as one" if groups.get(name) else is_
            text = f"{name} {is_}; allowed are {', '.join(known)}"
        if text is not None:
            yield Problem(("noise", "correlated"), name, text)


def factor_with_sample(factor: Factor, folder: Path) -> Factor:
    """Empirical factor with the sample read from its file."""
    from warpchain.study.store import read_table

    if factor.file is None or factor.column is None:
        return factor
    path = folder / factor.file
    table = read_table(path, bounded=True)
    if factor.column not in table.column_names:
        raise StudyError(f"{path}: no column {factor.column}; it has {', '.join(table.column_names)}")
    values = table[factor.column].to_pylist()
    if len(values) < 2 or not are_numbers(*values) or not np.isfinite(values).all():
        raise StudyError(f"{path}: column {factor.column}: must hold at least 2 numbers, all finite")
    return factor.model_copy(update={"sample": tuple(values), "file": None, "column": None})
