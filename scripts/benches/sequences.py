"""Signs of mean differences that are looked at again and again: how many are wrong, and how many pairs they take."""

import argparse
from collections.abc import Iterator, Mapping

import numpy as np
from common.cases import Line, case, case_option, table_head

from warpchain.study.analysis.paired import FEWEST_PAIRS, mean_difference
from warpchain.study.results import Array

LEVEL, BATCH = 0.95, 8
BLOW = 10.0
"""Change of a difference by a rare event; the noise beside it has a deviation of 0.3."""


def rare_blow_differences(random: np.random.Generator, shape: tuple[int, int], probability: float) -> Array:
    """Differences of mean 0 (sequences, pairs): what rare blows add, the rest lacks."""
    return 0.3 * random.standard_normal(shape) + BLOW * ((random.random(shape) < probability) - probability)


def equal_mean_differences(random: np.random.Generator, shape: tuple[int, int]) -> Mapping[str, Array]:
    """Differences of mean 0 (sequences, pairs), by name."""
    return {
        "normal": random.standard_normal(shape),
        "Laplace": random.laplace(size=shape),
        "uniform": random.uniform(-1.0, 1.0, shape),
        "Gumbel": random.gumbel(size=shape) - np.euler_gamma,
        "exponential": random.exponential(size=shape) - 1.0,
        "lognormal": random.lognormal(size=shape) - np.exp(0.5),
        "Student, 2 degrees": random.standard_t(2, shape),
        "Student, 3 degrees": random.standard_t(3, shape),
        "blows, 1 in 10": rare_blow_differences(random, shape, 0.1),
        "blows, 1 in 20": rare_blow_differences(random, shape, 0.05),
        "blows, 1 in 50": rare_blow_differences(random, shape, 0.02),
        "blows, 1 in 200": rare_blow_differences(random, shape, 0.005),
    }


def pairs_until_sign(differences: Array, what: str, event: float | None = None) -> float:
    """Pairs after which the mean first has a sign, looked at after each batch; infinite where it never has."""
    for count in range(BATCH * -(-FEWEST_PAIRS // BATCH), len(differences) + 1, BATCH):
        if getattr(mean_difference(differences[:count], LEVEL, event), what):
            return count
    return np.inf


@case(case_option("--sequences", type=int, default=400), case_option("--pairs", type=int, default=200))
def sequences(asked: argparse.Namespace) -> Iterator[Line]:
    """Signs of equal means that are looked at after each batch of 8 pairs, and the pairs that a sign takes.

    python scripts/bench.py sequences

    Sequences with a sign: that which the pairs show, that which is sure, and that which is sure where the size of the
    rare events is known. Then the median number of pairs of normal differences, by their mean in deviations.
    """
    random = np.random.default_rng(7)
    yield table_head("differences | shown | decided | decided, blows of 10 known")
    for name, drawn in equal_mean_differences(random, (asked.sequences, asked.pairs)).items():
        ways = [("sign", None), ("sure", None), *([("sure", BLOW)] if name.startswith("blows") else [])]
        counts = (sum(np.isfinite(pairs_until_sign(one, *way)) for one in drawn) for way in ways)
        yield (name, *(int(count) for count in counts), *([""] * (3 - len(ways))))
    yield ""
    for effect in (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0):
        drawn = effect + random.standard_normal((asked.sequences, 2 * asked.pairs))
        shown, sure = (np.median([pairs_until_sign(one, way) for one in drawn]) for way in ("sign", "sure"))
        yield f"normal, a mean of {effect:g} deviations: shown after {shown:g} pairs, decided after {sure:g}"
