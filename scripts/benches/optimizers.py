"""Engines for costly searches."""

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from common.cases import Line, case, case_option

from warpchain.study.optimize import Optimizer, goals_of_study, recommend
from warpchain.study.results import read_results
from warpchain.study.spec import Study, loads_study

START, BATCH, ROWS = 16, 8, 56
Array = Any
"""Numbers by row and column."""


def front_objectives(x: Array) -> Array:
    """Two squared distances, whose Pareto front is b = 0, a from -1 to 1."""
    return np.stack([(x[:, 0] - 1.0) ** 2 + x[:, 1] ** 2, (x[:, 0] + 1.0) ** 2 + x[:, 1] ** 2], axis=1)


def ishigami_function(x: Array) -> Array:
    """Ishigami's function; least -1 - pi^4 / 10 = -10.74 at (-pi/2, 0, +-pi)."""
    a, b, c = x.T
    return (np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))[:, None]


def front_volume(costs: Array) -> float:
    """Area that rows beat, up to the reference."""
    from pymoo.indicators.hv import HV

    return float(HV(ref_point=np.array([4.0, 4.0]))(costs))


def optimizer_study(names: str, ends: float, metrics: dict[str, float | None], seed: int) -> Study:
    """A study of factors from -ends to ends: of metrics with a number that is a limit, of others an objective."""
    text = f'[study]\ndrive = "none"\n[design]\nkind = "sobol"\ncount = {START}\nseed = {seed}\n'
    for name in names:
        text += f'[[factors]]\nname = "{name}"\npath = "x.{name}"\nrange = [{-ends}, {ends}]\n'
    for metric, limit in metrics.items():
        text += f'[[{"objectives" if limit is None else "limits"}]]\nmetric = "{metric}"\n'
        text += "" if limit is None else f"max = {limit}\n"
    return loads_study(text + f"[optimize]\nbatch = {BATCH}\nseed = {seed}\n")


def search_by_bayes(study: Study, function: Callable[[Array], Array], noise: float, seed: int) -> tuple[Array, Array]:
    """All rows and the recommended one of a search by warpchain's own optimizer."""
    import pyarrow as pa

    optimizer, rng, tables = Optimizer(study), np.random.default_rng(seed), []
    names = [factor.name for factor in study.factors]
    while optimizer.observed_count < ROWS:
        rows = optimizer.ask()
        values = function(np.array([[row[name] for name in names] for row in rows]))
        values = values + noise * rng.standard_normal(values.shape)
        table = pa.Table.from_pylist(rows)
        for metric, column in zip(optimizer.goals.named_metrics, values.T, strict=True):
            table = table.append_column(metric, pa.array(column))
        optimizer.observe(table)
        tables.append(table)
    results = read_results(pa.concat_tables(tables), names)
    best = recommend(results, goals_of_study(study))[0]
    x = np.stack([results.values(name) for name in names], axis=1)
    return x, x[best.row]


def search_by_egobox(study: Study, function: Callable[[Array], Array], noise: float, seed: int) -> tuple[Array, Array]:
    """All rows and the recommended one of a search by egobox: EHVI for two objectives, LogEI with limits for one."""
    import egobox as egx

    rng, names = np.random.default_rng(seed), [factor.name for factor in study.factors]
    first = np.array([[row[name] for name in names] for row in Optimizer(study).ask()])
    limits = np.array([0.0] * len(study.objectives) + [bound.max for bound in study.bounds])

    def noisy_values(x: Array) -> Array:
        """Values less limits at designs x, with noise."""
        values = function(np.asarray(x)) - limits
        return values + noise * rng.standard_normal(values.shape)

    ends = [list(factor.range or ()) for factor in study.factors]
    common = {"n_cstr": len(study.bounds), "x_doe": first, "y_doe": noisy_values(first), "seed": seed}
    rounds = (ROWS - START) // BATCH
    if len(study.objectives) > 1:
        search = egx.Belfegor(ends, n_obj=2, moo_config=egx.MooConfig(batch=BATCH), **common)
    else:
        search = egx.Egor(ends, qei_config=egx.QEiConfig(batch=BATCH), **common)
    found = search.minimize(noisy_values, max_iters=rounds)
    return np.asarray(found.result.x_doe), np.asarray(found.result.x_opt)


ENGINES = {"bayes": search_by_bayes, "egobox": search_by_egobox}


def front_score(x: Array, best: Array) -> float:
    """Part of the front's volume that rows beat [-]."""
    whole = front_objectives(np.stack([np.linspace(-1, 1, 2001), np.zeros(2001)], axis=1))
    return front_volume(front_objectives(x)) / front_volume(whole)


def corner_score(x: Array, best: Array) -> float:
    """First square at the recommended row, 9 where it oversteps the limit by more than 0.1; 1 is least."""
    (values,) = front_objectives(best[None])
    return float(values[0]) if values[1] < 1.1 else 9.0


def ishigami_score(x: Array, best: Array) -> float:
    """The function at the recommended row; -10.74 is least."""
    return float(ishigami_function(best[None])[0, 0])


TWO = ("ab", 2.0, {"f1": None, "f2": None}, front_objectives)
JOBS: dict[str, tuple[Any, float, Callable[[Array, Array], float]]] = {
    "front, exact": (TWO, 0.0, front_score),
    "front, noise 0.1": (TWO, 0.1, front_score),
    "limit, noise 0.1": (("ab", 2.0, {"f1": None, "f2": 1.0}, front_objectives), 0.1, corner_score),
    "Ishigami, noise 0.5": (("abc", np.pi, {"f1": None}, ishigami_function), 0.5, ishigami_score),
}


@case(case_option("seeds", metavar="SEEDS", nargs="?", type=int, default=3, help="runs of each (default 3)"))
def optimizers(asked: argparse.Namespace) -> Iterator[Line]:
    """Engines for costly searches side by side, on functions with known answers.

    python scripts/bench.py optimizers 3

    `bayes` is warpchain's; egobox is compared where it is installed (pip install egobox). Each has the same 16 first
    rows and goes on in batches of 8.
    """
    yield ("job", "engine", "median", "worst", "s")
    for job, ((names, ends, metrics, function), noise, score) in JOBS.items():
        for engine, run in ENGINES.items():
            scores, begin = [], time.perf_counter()
            try:
                for seed in range(1, asked.seeds + 1):
                    scores.append(score(*run(optimizer_study(names, ends, metrics, seed), function, noise, seed)))
            except ImportError as error:
                yield (job, engine, error, "", "")
                continue
            worst = min(scores) if score is front_score else max(scores)
            yield (job, engine, float(np.median(scores)), worst, (time.perf_counter() - begin) / asked.seeds)
