"""Which of two drives is better over noise: the interval's promise, and `warpchain better` on a small drive."""

import json

import numpy as np
import pytest
from command import refused, run
from scipy.stats import binom, t
from study_helpers import NOISY, STUDY, tiny_drive, write_study

from warpchain.drive import dumps_drive
from warpchain.study.analysis.paired import FEWEST_PAIRS, interval_half_width, mean_difference
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
        told += any(mean_difference(differences[:n], 0.95).shown_sign for n in range(2, PAIRS + 1))
    assert told <= most * REPETITIONS


def blows(probability, size):
    """Noise of 0.3, and rare blows on one side that the rest makes up for in the mean: 0.2 for +10 at 0.02."""
    return lambda rng, shape: (
        0.3 * rng.standard_normal(shape) + size * ((rng.random(shape) < probability) - probability)
    )


HEAVY_TAILED = {
    "normal": DRAWS["normal"][0],
    "exponential": DRAWS["exponential"][0],
    "lognormal": DRAWS["lognormal"][0],
    "student 2": lambda rng, shape: rng.standard_t(2, shape),  # without a variance
    "student 3": lambda rng, shape: rng.standard_t(3, shape),
    "blows of 10 in 1 of 50": blows(0.02, 10.0),
    "blows of 10 in 1 of 20": blows(0.05, 10.0),
    "blows of 10 in 1 of 100": blows(0.01, 10.0),
    "blows of 3 in 1 of 50": blows(0.02, 3.0),
    "blows both ways": lambda rng, shape: blows(0.02, 10.0)(rng, shape) - blows(0.01, 20.0)(rng, shape),
}
"""Differences of mean 0, of which the pairs show little before they have a rare one."""


def looked_at(sequences, event=None):
    """What is sure of sequences, and what their pairs show, looked at after each batch of 8 pairs until it is told."""
    sure, shown = [], []
    for differences in sequences:
        found = [mean_difference(differences[:n], 0.95, event) for n in range(8, sequences.shape[1] + 1, 8)]
        sure.append(next((of for of in found if of.sure_sign), None))
        shown.append(next((of for of in found if of.shown_sign), None))
    return sure, shown


def told(found):
    return sum(of is not None for of in found)


@pytest.mark.parametrize("draw", HEAVY_TAILED.values(), ids=HEAVY_TAILED)
def test_nothing_is_sure_of_equal_means_also_where_rare_pairs_decide_them(draw):
    """At most 5 % of sequences, by the 99 % quantile of a binomial, 23 of 300. Blows are 33 deviations of the rest,
    beyond the 20 that are reckoned with, which the interval's own width makes up for. Differences that show their
    tails, so all but those of few blows, are not said to show a sign either."""
    sequences = draw(np.random.default_rng(11), (300, 160))
    most = binom.ppf(0.99, 300, 0.05)
    sure, shown = looked_at(sequences)
    assert told(sure) <= most
    if draw not in (HEAVY_TAILED[name] for name in HEAVY_TAILED if name.startswith("blows of 10")):
        assert told(shown) <= most
    else:  # before the first blow, they are normal differences with a mean other than 0: what tells is in no pair
        assert told(shown) > 2 * most
        assert all(
            abs(of.mean) < of.missed_probability * 10.0 for of in shown if of is not None
        )  # the blow that the line names


@pytest.mark.parametrize("probability", [0.1, 0.05, 0.02, 0.01, 0.005])
def test_known_size_of_rare_blows_keeps_the_promise_at_any_probability(probability):
    """Looked at to 160 pairs; a blow is missed by all n pairs with (1 - p)^n, and q of eq. (c) is larger then."""
    sequences = blows(probability, 10.0)(np.random.default_rng(12), (300, 160))
    assert told(looked_at(sequences, event=10.0)[0]) <= binom.ppf(0.99, 300, 0.05)


def test_pairs_that_normal_differences_take():
    """What pairs show takes half as many pairs again at most where the interval alone takes some 18 for a mean of one
    deviation; a sure sign takes e q more, of means above four deviations no more than 24 pairs. Medians of 100."""
    rng = np.random.default_rng(13)
    for effect, most_shown, most_sure in ((1.0, 32, 120), (2.0, 16, 56), (5.0, 16, 24)):
        sure, shown = looked_at(effect + rng.standard_normal((100, 160)))
        assert np.median([of.pairs if of else np.inf for of in shown]) <= most_shown
        assert np.median([of.pairs if of else np.inf for of in sure]) <= most_sure


def test_no_rule_is_sure_of_normal_differences_soon_and_right_about_blows():
    """Without a blow, of (1 - p)^n, blows are normal differences of mean p B: who decides these by n pairs with a
    probability P is wrong about blows with P (1 - p)^n. At most 5 % of those leaves P = 0.05 / 0.98^96 = 35 %."""
    rng = np.random.default_rng(14)
    sure, shown = looked_at(0.3 * rng.standard_normal((200, 96)) - 0.2)
    assert told(shown) > 0.9 * 200
    assert told(sure) * 0.98**96 <= 0.05 * 200


def test_events_that_pairs_may_have_missed():
    """Half of 5 %: 1 - q = 0.025^(1/n). A mean of 1 less the half width at 97.5 %, over q, is what may reverse it."""
    of = mean_difference(np.tile([1.1, 0.9], 20), 0.95)
    assert of.missed_probability == pytest.approx(1.0 - 0.025 ** (1.0 / 40.0), rel=1e-12)
    half = interval_half_width(40, of.deviation, 0.0, 0.975)
    assert of.reversing_change == pytest.approx((1.0 - half) / of.missed_probability, rel=1e-12)
    assert of.shown_sign == 1 and of.reckoned == pytest.approx(20.0 * of.deviation) and of.sure_sign == 1
    differences = np.tile([1.1, 0.9], 20)
    for event, sure in ((0.99 * of.reversing_change, 1), (1.01 * of.reversing_change, 0)):
        assert mean_difference(differences, 0.95, event).sure_sign == sure
    assert mean_difference(differences, 0.95, 0.0).reckoned == pytest.approx(0.1)  # the largest that was there


def test_few_pairs_with_half_of_the_scatter_are_heavy_tails():
    """One of 32 off by 10 has 31 / 32 of it: all others are off by 10 / 32. Normal: half is with 1 of 8 pairs."""
    assert mean_difference(np.r_[np.zeros(31), 10.0], 0.95).carriers == 1
    assert mean_difference(np.r_[np.zeros(31), 10.0], 0.95).is_heavy_tailed
    normal = mean_difference(np.random.default_rng(0).standard_normal(8000), 0.95)
    assert normal.carriers == pytest.approx(1000, rel=0.05) and not normal.is_heavy_tailed  # P(z^2 > 2.37) = 0.124


def test_fixed_interval_would_not_keep_that_promise():
    """Student's interval for one look, looked at after every pair, is wrong far more often: the test above can fail."""
    told = 0
    for differences in np.random.default_rng(7).standard_normal((REPETITIONS, PAIRS)):
        n = np.arange(FEWEST_PAIRS, PAIRS + 1)
        mean = np.cumsum(differences)[FEWEST_PAIRS - 1 :] / n
        deviation = np.array([differences[:k].std(ddof=1) for k in n])
        told += (np.abs(mean) > t.ppf(0.975, n - 1) * deviation / np.sqrt(n)).any()
    assert told > 0.15 * REPETITIONS


def test_clear_difference_is_told_soon_and_rightly():
    """A mean of one deviation: eq. (b) needs sqrt(n) > 3.5, and by 50 pairs the estimate is off by 0.14."""
    rng = np.random.default_rng(3)
    for sign in (-1, 1):
        signs = [mean_difference(sign + rng.standard_normal(50), 0.95).shown_sign for _ in range(REPETITIONS)]
        assert signs.count(-sign) == 0 and signs.count(sign) >= 0.98 * REPETITIONS


def test_half_width_is_where_the_likelihood_ratio_reaches_1_over_alpha():
    """Eq. (a) at the ends of eq. (b); which is 1 / alpha there."""
    for n in (8, 30, 200):
        x = n * interval_half_width(n, 1.0, 0.0, 0.95) ** 2 / (n - 1)
        k = 1.0 / (1.0 + n)
        assert np.sqrt(k) * ((1.0 + k * x) / (1.0 + x)) ** (-n / 2) == pytest.approx(20.0, rel=1e-9)
    assert interval_half_width(4, 1.0, 0.0, 0.95) == np.inf  # four normal numbers never tell a sign with 95 %


def test_forecast_of_pairs_is_where_the_sign_becomes_sure():
    """Where the interval at 97.5 % leaves zero by what events shift the mean that a pair in 1 / q may have missed."""
    for event, reckoned in ((0.0, 1.0), (5.0, 5.0)):
        of = mean_difference(np.tile([1.3, -0.7], 10), 0.95, event)
        needed = of.pairs_needed()
        n = np.array([needed - 1, needed])
        before, after = interval_half_width(n, of.deviation, of.skewness, 0.975) + reckoned * (1.0 - 0.025 ** (1.0 / n))
        assert of.shown_sign == 0 and after < of.mean <= before
    assert mean_difference(np.tile([1.0, -1.0], 10), 0.95).pairs_needed() is None


def test_interval_of_skewed_differences_is_wider():
    """By 25 G^2 / n. One of 20 larger: G^2 = (1 - 2 p)^2 / (p q) = 17.05, with a deviation of n - 1 times 0.99^3."""
    of = mean_difference(np.tile([1.0] * 19 + [2.0], 5), 0.95)
    wider = 25.0 * 0.9**2 / (0.05 * 0.95) * 0.99**3 / 100
    assert of.half == pytest.approx(wider * interval_half_width(100, of.deviation, 0.0, 0.95), rel=1e-9)


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
    assert found["difference"] == expected.mean and found["interval"] == [expected.interval_low, expected.interval_high]
    assert found["better"] == ("A" if expected.mean > 0.0 else "B") and expected.shown_sign
    said = [of for of in err if not of.startswith("compiling kernels")]  # where none are kept
    assert said[0].startswith("warpchain: 8 pairs: B less A")
    when = {file: file.stat().st_mtime_ns for file in out.rglob("rows.parquet")}
    status, lines, _ = run(capsys, *line, "--sense", "max", "--quiet")
    other = {"A": "B", "B": "A"}[found["better"]]
    assert status == 0 and any(line.startswith(f"{other} is better (95 % confidence)") for line in lines), lines
    assert any(line.startswith("  16 pairs may miss an event rarer than 1 in 4.9: it reverses") for line in lines)
    known = ("--event", 2.0 * found["event_to_reverse"], "--budget", "32", "--quiet")
    status, lines, _ = run(capsys, *line, *known)
    assert status == 1 and any(
        of.startswith("undecided which is better (95 % confidence); cost: 32 runs of 32") for of in lines
    )
    assert f"  {found['better']} is better as far as these pairs show (95 % confidence)" in lines
    assert any(
        "go on with --budget" in of and of.endswith("or a lower --event if rare events are smaller") for of in lines
    )
    found = json.loads("\n".join(run(capsys, *line, *known, "--json")[1]))
    assert found["better"] is None and found["better_in_what_pairs_show"] in "AB"
    assert found["event_reckoned_with"] == known[1] and found["missed_rarer_than"] == pytest.approx(1 - 0.025**0.0625)
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
    assert [of.run_count for of in said] == [32, 64, 96][: len(said)] and said[0].sure_winner is None
    assert found.sure_winner == ("B" if found.means[1] > found.means[0] else "A")
    assert found.won_pairs(found.sure_winner) == found.found.pairs == found.run_count / 4 >= FEWEST_PAIRS
    assert all((of.run_counts == 2).all() for of in found.results)


def test_budget_ends_it_and_a_larger_one_goes_on(tmp_path, capsys):
    """What only differs in a value that the noise sets does not differ."""
    path, a, b = written(tmp_path, **{"sprockets.s1.load.torque": 7.0})
    line = ("better", path, a, b, "-o", tmp_path / "out", "--metric", "tension_max", "--batch", "4", "--quiet")
    for budget in (16, 32):
        status, lines, _ = run(capsys, *line, "--budget", budget)
        assert status == 1
        cost = f"cost: {budget} runs of {budget}, {budget // 2} pairs"
        assert f"undecided which is better (95 % confidence); {cost}" in lines
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
        ((*metric, "--level", "1"), "--level 1.0: must be a number from 0.5 to below 1", good),
        ((*metric, "--event", "-1"), "--event -1.0: must be a finite number of at least 0", good),
        ((*metric, "--budget", "15"), "--budget 15: must be at least 16", good),
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
