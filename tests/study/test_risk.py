"""Probabilities of failure: closed forms within their stated intervals, and `warpchain risk` on a small drive."""

import numpy as np
import pytest
from command import refused, run
from scipy.stats import norm
from study_helpers import LIMITS, NOISY, write_study

import warpchain
from warpchain.errors import StudyError
from warpchain.study.analysis.failure_probability import design_points, importance_sampling, subset_simulation
from warpchain.study.optimize import open_study
from warpchain.study.store import read_table

DIMENSIONS = 5
REPETITIONS = 100


def linear(beta):
    """g = beta - a u, |a| = 1: fails with the probability of a standard normal below -beta."""
    return lambda u: beta - u.sum(axis=1) / np.sqrt(u.shape[1])


def four_branches(u):
    """The series system of four branches (Waarts 2000), k = 3 and 6."""
    x, y = u.T
    along, across = (x + y) / np.sqrt(2.0), 0.1 * (x - y) ** 2
    return np.min(
        [3.0 + across - along, 3.0 + across + along, x - y + 6.0 / np.sqrt(2.0), y - x + 6.0 / np.sqrt(2.0)], 0
    )


def of_four_branches():
    """Its probability: the integral over x along (x + y) / sqrt 2, in closed form across, by quadrature."""
    t = np.linspace(-9.0, 9.0, 200_001)  # (x - y) / sqrt 2
    kept = norm.cdf(3.0 + 0.2 * t**2) - norm.cdf(-3.0 - 0.2 * t**2)
    return 1.0 - np.trapezoid(np.where(np.abs(t) < 3.0, kept, 0.0) * norm.pdf(t), t)


CASES = [(linear(-norm.ppf(10.0**-k)), DIMENSIONS, 10.0**-k, 1) for k in range(2, 7)]
CASES.append((four_branches, 2, of_four_branches(), 4))


@pytest.mark.parametrize(("margin", "dimensions", "true", "ways"), CASES, ids=["2", "3", "4", "5", "6", "branches"])
def test_intervals_hold_the_closed_form_in_95_of_100_repetitions(margin, dimensions, true, ways):
    """Intervals of 95 %, counted; and neither wide: importance sampling is known to a quarter either way."""
    counts, widths, found, middle = np.zeros(2), [], [], []
    for seed in range(REPETITIONS):
        subset = subset_simulation(margin, dimensions, 200, 8, seed)
        points, _ = design_points(margin, subset.failed)
        sampled = importance_sampling(margin, points, 1000, seed)
        counts += [of.low <= true <= of.high for of in (subset, sampled)]
        widths.append(sampled.high / sampled.low)
        found.append(len(points))
        middle.append(subset.probability / true)
        assert (margin(subset.failed) <= 0.0).all()
    assert counts.min() >= 95, counts
    assert np.median(widths) < 1.6
    assert np.median(found) == ways
    # levels that scatter together leave a bias of the order of the variance of a repetition (Au and Beck 2001, eq. 29),
    # which at 1e-6 is about P^2 with 200 samples a level
    assert 0.9 < np.mean(middle) < 1.4


def test_design_point_is_that_of_a_plane():
    """Nearest of beta - a u = 0: beta a, at distance beta; steps stop a hundredth beyond at most, where it fails."""
    margin = linear(3.7190)
    subset = subset_simulation(margin, 4, 200, 8, 1)
    ((point,), evaluations) = design_points(margin, subset.failed)
    assert np.linalg.norm(point) == pytest.approx(3.7190, rel=0.01)
    assert np.abs(point - 3.7190 / 2.0).max() < 0.1 and evaluations < 100


def test_what_cannot_fail_is_said():
    with pytest.raises(StudyError, match="its probability is below 1e-12"):
        subset_simulation(lambda u: np.full(len(u), 1.0), 2, 50, 3, 0)


TINY = NOISY.replace(LIMITS, "")
HEAD = """
limits = [{{ energy_residual = inf, energy_change = inf }}, {{ metric = "{metric}", max = {most} }}]
risk = {{ count = 50, repeats = 3, samples = 100 }}
record = {{ rate = 1e5 }}
"""


def written(folder, metric, most):
    path = write_study(folder, shard=1000)
    path.write_text(HEAD.format(metric=metric, most=most) + TINY.format(shard=1000))
    return path


def test_drive_that_breaks_a_limit_over_a_torque(tmp_path, capsys):
    """The metric over the torque on a grid tells where it crosses the limit; the torque is normal."""
    metric = "tension_std"
    bench = open_study(written(tmp_path, metric, 1e9))
    grid = np.linspace(0.0, 12.0, 97)
    values = np.array(bench.evaluate([{"torque": float(torque)} for torque in grid])[metric].to_pylist())
    fine = np.linspace(0.0, 12.0, 20_001)
    between = np.interp(fine, grid, values)
    order = np.argsort(between)
    share = np.cumsum(norm.pdf(fine[order], 5.0, 1.0))
    most = float(between[order][np.searchsorted(share, 0.97 * share[-1])])  # some 3 % are beyond
    beyond = between > most
    true = float(np.trapezoid(np.where(beyond, norm.pdf(fine, 5.0, 1.0), 0.0), fine))
    path, out = written(tmp_path, metric, repr(most)), tmp_path / "out"
    status, lines, _ = run(capsys, "risk", path, "-o", out, "--quiet")
    assert status == 0, lines
    for way in ("subset simulation", "importance sampling"):
        (line,) = [line for line in lines if line.startswith("P(") and way in line]
        low, high = (float(word) for word in line.split(", ")[1].split(" with")[0].split(" to "))
        assert 0.9 * low <= true <= 1.1 * high, (line, true)  # printed with two digits
    (played,) = [line.split("view ")[1] for line in lines if "play it" in line]
    archive, _, number = played.split()
    run_again = warpchain.read_archive(archive)
    assert run_again.metrics[metric][0].as_py() > most
    row = read_table(out / "results.parquet").slice(int(number), 1).to_pylist()[0]
    assert row[metric] == run_again.metrics[metric][0].as_py()
    when = {file: file.stat().st_mtime_ns for file in out.rglob("rows.parquet")}
    status, again, _ = run(capsys, "risk", path, "-o", out, "--quiet")
    assert status == 0 and again == lines
    assert when == {file: file.stat().st_mtime_ns for file in out.rglob("rows.parquet")}  # nothing was run again


def test_mistakes_are_said_in_one_line(tmp_path, capsys):
    path = written(tmp_path, "tension_max", 1e9)
    good = path.read_text()
    for old, new, told in (
        ('{ metric = "tension_max", max = 1000000000.0 }', "{ slips = 1.0 }", "limits: none is on a metric"),
        ("count = 50", "count = 55", "risk.count = 55: must be a multiple of 10, at least 50"),
        ('kind = "noise"\ndistribution', "distribution", 'design.kind = "noise": is of studies whose factors'),
    ):
        assert old in good, old
        path.write_text(good.replace(old, new))
        assert told in refused(capsys, "risk", path, "-o", tmp_path / "out")
