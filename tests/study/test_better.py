"""Which of two drives is better over noise: the interval's promise, and `warpchain better` on a small drive."""

import json

import numpy as np
import pytest
from command import refused, run
from scipy.stats import t
from study_helpers import NOISY, STUDY, tiny_drive, write_study

from warpchain.drive import dumps_drive
from warpchain.study.analysis.paired import LEAST, half_width, mean_difference
from warpchain.study.optimize.better import Comparison, find_better
from warpchain.study.store import read_table

REPETITIONS = 400
PAIRS = 100
DRAWS = {
    "normal": (lambda rng, shape: rng.standard_normal(shape), 0.05),
    "laplace": (lambda rng, shape: rng.laplace(size=shape), 0.05),
    "uniform": (lambda rng, shape: rng.uniform(-1.0, 1.0, shape), 0.05),
    "gumbel": (lambda rng, shape: rng.gumbel(size=shape) - np.euler_gamma, 0.05),  # skewness 1.1
    "exponential": (lambda rng, shape: rng.exponential(size=shape) - 1.0, 0.08),  # skewness 2
    "lognormal": (lambda rng, shape: rng.lognormal(size=shape) - np.exp(0.5), 0.15),  # skewness 6.2
}
"""Differences of mean 0, and the share of sequences in which a sign may be told: 5 % but where skewness is large."""


@pytest.mark.parametrize(("draw", "most"), DRAWS.values(), ids=DRAWS)
def test_equal_drives_are_told_apart_in_5_of_100_cases_at_most(draw, most):
    """Looked at after every pair, up to 100. Expected of normal ones are some 2 %, as eq. (a) has no end."""
    told = 0
    for differences in draw(np.random.default_rng(7), (REPETITIONS, PAIRS)):
        told += any(mean_difference(differences[:n], 0.95).sign for n in range(2, PAIRS + 1))
    assert told <= most * REPETITIONS


def test_fixed_interval_would_not_keep_that_promise():
    """Student's interval for one look, looked at after every pair, is wrong far more often: the test above can fail."""
    told = 0
    for differences in np.random.default_rng(7).standard_normal((REPETITIONS, PAIRS)):
        n = np.arange(LEAST, PAIRS + 1)
        mean = np.cumsum(differences)[LEAST - 1 :] / n
        deviation = np.array([differences[:k].std(ddof=1) for k in n])
        told += (np.abs(mean) > t.ppf(0.975, n - 1) * deviation / np.sqrt(n)).any()
    assert told > 0.15 * REPETITIONS


def test_clear_difference_is_told_soon_and_rightly():
    """A mean of one deviation: eq. (b) needs sqrt(n) > 3.5, and by 50 pairs the estimate is off by 0.14."""
    rng = np.random.default_rng(3)
    for sign in (-1, 1):
        signs = [mean_difference(sign + rng.standard_normal(50), 0.95).sign for _ in range(REPETITIONS)]
        assert signs.count(-sign) == 0 and signs.count(sign) >= 0.98 * REPETITIONS


def test_half_width_is_where_the_likelihood_ratio_reaches_1_over_alpha():
    """Eq. (a) at the ends of eq. (b); which is 1 / alpha there."""
    for n in (8, 30, 200):
        x = n * half_width(n, 1.0, 0.0, 0.95) ** 2 / (n - 1)
        k = 1.0 / (1.0 + n)
        assert np.sqrt(k) * ((1.0 + k * x) / (1.0 + x)) ** (-n / 2) == pytest.approx(20.0, rel=1e-9)
    assert half_width(4, 1.0, 0.0, 0.95) == np.inf  # four normal numbers never tell a sign with 95 %


def test_forecast_of_pairs_is_where_the_interval_leaves_zero():
    of = mean_difference(np.tile([1.3, -0.7], 10), 0.95)
    needed = of.pairs_needed()
    before, after = half_width(np.array([needed - 1, needed]), of.deviation, of.skewness, 0.95)
    assert of.sign == 0 and after < of.mean <= before
    assert mean_difference(np.tile([1.0, -1.0], 10), 0.95).pairs_needed() is None


def test_interval_of_skewed_differences_is_wider():
    """By 25 G^2 / n. One of 20 larger: G^2 = (1 - 2 p)^2 / (p q) = 17.05, with a deviation of n - 1 times 0.99^3."""
    of = mean_difference(np.tile([1.0] * 19 + [2.0], 5), 0.95)
    wider = 25.0 * 0.9**2 / (0.05 * 0.95) * 0.99**3 / 100
    assert of.half == pytest.approx(wider * half_width(100, of.deviation, 0.0, 0.95), rel=1e-9)


def written(folder, **changes):
    """The study, and the drive as it is and with other values."""
    path = write_study(folder, shard=1000, text=NOISY)
    other = folder / "other.toml"
    other.write_text(dumps_drive(tiny_drive().with_values(changes or {"chain.stiffness": 1.1e7})))
    return path, folder / "tiny.toml", other


def pairs_of(out, metric):
    a, b = (read_table(out / name / "results.parquet") for name in "AB")
    assert a["torque"] == b["torque"]  # common noise
    return np.array(a[metric]), np.array(b[metric])


def test_two_stiffnesses_are_told_apart(tmp_path, capsys):
    """By what the tables of both hold; and of the same runs, the other is better where more is."""
    path, a, b = written(tmp_path)
    out, metric = tmp_path / "out", "tension_max"
    line = ("better", path, a, b, "-o", out, "--metric", metric, "--batch", "8")
    status, lines, err = run(capsys, *line, "--json")
    assert status == 0, err
    found = json.loads("\n".join(lines))
    first, second = pairs_of(out, metric)
    expected = mean_difference(second - first, 0.95)
    assert found["pairs"] == len(first) == 16 and found["runs"] == 32
    assert found["difference"] == expected.mean and found["interval"] == [expected.low, expected.high]
    assert found["better"] == ("A" if expected.mean > 0.0 else "B") and expected.sign
    assert err[0].startswith("warpchain: 8 pairs: B less A")
    when = {file: file.stat().st_mtime_ns for file in out.rglob("rows.parquet")}
    status, lines, _ = run(capsys, *line, "--sense", "max", "--quiet")
    other = {"A": "B", "B": "A"}[found["better"]]
    assert status == 0 and any(line.startswith(f"{other} is better, surely: 95 %") for line in lines), lines
    assert when == {file: file.stat().st_mtime_ns for file in out.rglob("rows.parquet")}  # nothing was run again
    assert run(capsys, *line[:3], a, *line[4:])[2] == [f"warpchain: error: {a} and {a}: are the same drive"]


def test_metric_and_sense_are_those_of_the_objective_and_replicates_count(tmp_path):
    """Means of two runs, begun in the same two ways; a batch of 8 pairs is 2 drives x 2 runs x 8."""
    path, a, b = written(tmp_path)
    text = path.read_text().replace('kind = "noise"', 'kind = "noise"\nreplicates = 2', 1)
    path.write_text(text + '[[objectives]]\nmetric = "mean(tension_max)"\nsense = "max"\n')
    said = []
    found = find_better(path, (a, b), tmp_path / "out", Comparison(budget=100), report=said.append)
    assert (found.metric, found.sense) == ("tension_max", "max")
    assert [of.runs for of in said] == [32, 64, 96][: len(said)] and said[0].better is None
    assert found.better == ("B" if found.means[1] > found.means[0] else "A")
    assert found.won(found.better) == found.found.pairs == found.runs / 4 >= LEAST
    assert all((of.counts == 2).all() for of in found.results)


def test_budget_ends_it_and_a_larger_one_goes_on(tmp_path, capsys):
    """What only differs in a value that the noise sets does not differ."""
    path, a, b = written(tmp_path, **{"sprockets.s1.load.torque": 7.0})
    line = ("better", path, a, b, "-o", tmp_path / "out", "--metric", "tension_max", "--batch", "4", "--quiet")
    for budget in (16, 32):
        status, lines, _ = run(capsys, *line, "--budget", budget)
        assert status == 1
        assert any(line == f"not sure which is better; cost: {budget} runs of {budget}, {budget // 2} pairs"
                   for line in lines), lines  # fmt: skip
        assert any("no pair differs: the noise sets" in line for line in lines)
    first, second = pairs_of(tmp_path / "out", "tension_max")
    assert len(first) == 16 and (first == second).all()


def test_runs_that_are_not_ok_are_left_out_and_said(tmp_path, capsys):
    """A limit that half of A's runs break, and none of B's: their pairs count neither way."""
    path, a, b = written(tmp_path)
    line = ("better", path, b, a, "--metric", "tension_max", "--budget", "64", "--batch", "32", "--quiet", "-o")
    assert run(capsys, *line, tmp_path / "all")[0] == 0
    residuals = read_table(tmp_path / "all" / "A" / "results.parquet")["energy_residual_relative"].to_pylist()
    good = path.read_text()
    path.write_text(good.replace("energy_residual = inf", f"energy_residual = {float(np.median(np.abs(residuals)))!r}"))
    status, lines, _ = run(capsys, *line, tmp_path / "half")
    (left_out,) = [line for line in lines if "as the run of A is not ok" in line]
    assert left_out.startswith("16 pairs are left out") and "energy" in left_out
    assert any("where both runs are ok" in line for line in lines)
    path.write_text(good.replace("energy_residual = inf", "energy_residual = 1e-30"))
    assert "tension_max: 0 of 32 pairs have both runs ok: " in refused(capsys, *line, tmp_path / "none")


DESIGN = """
[[factors]]
name = "design"
levels = [1, 2]
"""


def test_mistakes_are_said_in_one_line(tmp_path, capsys):
    path, a, b = written(tmp_path)
    good = path.read_text()
    mixed = good.replace('kind = "noise"', 'kind = "factorial"', 1) + DESIGN
    metric = ("--metric", "tension_max")
    cases = (
        ((), "metric: missing; needed where the study has 0 objectives", good),
        (("--metric", "tension_mx"), "no such metric; ", good),
        (("--metric", "q95(tension_max)"), "is a statistic over noise", good),
        ((*metric, "--level", "1"), "level = 1.0: must be a number from 0.5 to below 1", good),
        ((*metric, "--budget", "15"), "budget = 15: must be at least 16", good),
        (metric, "none is noise", STUDY.format(points=2, shard=1000)),
        (metric, "metrics.keep of the study leaves it out", good + '[metrics]\nkeep = ["tension_mean"]\n'),
        (metric, f"{a}: factor design has no place", mixed + '[[constraints]]\nrequire = "design > 0"\n'),
        (
            metric,
            f"{a}: factor design has no value that leaves",
            mixed + 'paths = ["chain.links", "chain.stiffness"]\n',
        ),
    )
    for options, told, study in cases:
        path.write_text(study)
        assert told in refused(capsys, "better", path, a, b, "-o", tmp_path / "out", "--quiet", *options)
    path.write_text(good)
    for drive, told in ((tmp_path / "none.toml", "none.toml"), ("engin", "did you mean")):
        assert told in refused(capsys, "better", path, a, drive, "-o", tmp_path / "out", *metric)
    assert not (tmp_path / "out").exists()
