"""Quantiles from counts, standard errors by batch means, drifts: on samples whose distribution is known."""

import numpy as np
import pytest

from warpchain.engine.window_sums import tension_edges
from warpchain.kernels.statistics import BINS
from warpchain.results.window_statistics import (
    INTERVAL_ERRORS,
    histogram_quantile,
    histogram_share_below,
    is_steady,
    mean_standard_error,
    window_change,
    window_drift,
)

SHARES = (0.001, 0.01, 0.5, 0.99, 0.999)
BATCHES = 80
PARTS = 20


def autoregressive(random, runs, *terms, samples=400):
    """(runs, samples) of x_t = sum a_k x_(t-k) + e_t, after it has forgotten how it began."""
    x = random.normal(size=(runs, 3 * samples))
    for t in range(len(terms), x.shape[1]):
        x[:, t] += sum(a * x[:, t - k] for k, a in enumerate(terms, 1))
    return x[:, -samples:]


def sines(random, runs, noise, **amplitudes):
    """(runs, samples) of sines of these periods in the window, of random phases, and noise."""
    turn = 2.0 * np.pi * np.arange(400) / 400
    phases = 2.0 * np.pi * random.random((len(amplitudes), runs, 1))
    waves = [a * np.sin(float(n[1:]) / 10 * turn + p) for (n, a), p in zip(amplitudes.items(), phases, strict=True)]
    return noise * random.normal(size=(runs, 400)) + sum(waves)


def batch_means(x):
    return x.reshape(len(x), BATCHES, -1).mean(axis=2)


@pytest.mark.parametrize("kind", ["normal", "slack", "peaks"])
def test_quantiles_of_known_samples(kind):
    """Against the sorted samples: within 1 % of the value or of the scale (the bins' own width is 4 % of either)."""
    random, scale = np.random.default_rng(3), 100.0
    x = {
        "normal": random.normal(1000.0, 200.0, 200_000),
        "slack": np.maximum(random.normal(50.0, 300.0, 200_000), -100.0 * random.random(200_000)),
        "peaks": random.exponential(1500.0, 200_000) - 5.0,
    }[kind]
    edges = tension_edges(np.array([scale]))
    counts = np.histogram(np.clip(x, edges[0, 0], np.nextafter(edges[0, -1], 0.0)), edges[0])[0][None]
    for share in SHARES:
        found, exact = histogram_quantile(counts, edges, [x.min()], [x.max()], share)[0], np.quantile(x, share)
        assert abs(found - exact) < 0.01 * max(abs(exact), scale), share


def test_parts_of_a_variant_share_its_edges():
    """Of two parts each of three variants, rows are those of their own edges; a bin that overflowed gives nan."""
    random, edges = np.random.default_rng(5), tension_edges(np.array([50.0, 100.0, 400.0]))
    counts = random.integers(0, 9, (6, int(BINS))) * (random.random((6, int(BINS))) < 0.2)
    counts[4, 100] = -1
    low, high = np.full(6, -2000.0), np.full(6, 5000.0)
    for found in (histogram_quantile, histogram_share_below):
        together = found(counts, edges, low, high, 0.3)
        alone = [found(counts[k : k + 1], edges[k // 2 : k // 2 + 1], low[:1], high[:1], 0.3).item() for k in range(6)]
        np.testing.assert_array_equal(together, alone)
        assert np.isnan(together).tolist() == [k == 4 for k in range(6)]
    total = counts.sum(axis=1)
    below = counts[:, :96].sum(axis=1) / total  # bin 96 begins at no tension
    below[4] = np.nan
    np.testing.assert_array_equal(histogram_share_below(counts, edges, low, high, 0.0), below)


def test_quantiles_do_not_leave_the_range():
    edges = tension_edges(np.array([100.0, 100.0, 100.0]))
    counts = np.zeros((3, int(BINS)), dtype=np.int32)
    counts[0, 120] = 7  # all alike
    counts[1, [0, -1]] = 5  # beyond the bins' ends: evenly from the end bins' inner edges to the extremes
    low, high = np.array([165.0, -1e6, 0.0]), np.array([165.0, 1e6, 0.0])
    found = np.array([histogram_quantile(counts, edges, low, high, share) for share in SHARES])
    assert (found[:, 0] == 165.0).all()
    assert found[0, 1] == pytest.approx(-1e6 + 0.002 * (1e6 + edges[1, 1]))
    assert found[-1, 1] == pytest.approx(1e6 - 0.002 * (1e6 - edges[1, -2]))
    assert np.isnan(found[:, 2]).all()  # nothing was counted


SEQUENCES = {
    "white": lambda random, runs: autoregressive(random, runs),
    "forgets in a fortieth": lambda random, runs: autoregressive(random, runs, np.exp(-1 / 10)),
    "forgets in a tenth": lambda random, runs: autoregressive(random, runs, np.exp(-1 / 40)),
    "forgets in an eighth": lambda random, runs: autoregressive(random, runs, np.exp(-1 / 50)),
    "swings 15 times": lambda random, runs: autoregressive(random, runs, 1.917, -0.97),
    "swings 3 times": lambda random, runs: autoregressive(random, runs, 1.982, -0.985),
    "ripple": lambda random, runs: sines(random, runs, 1.0, p123=1.0, p337=5.0),
    "weak slow ripple": lambda random, runs: sines(random, runs, 1.0, p73=0.2),
}
LONG = ("forgets in a tenth", "forgets in an eighth")
FEW_KNOWN = {"swings 3 times": 0.8, "forgets in an eighth": 0.9}
"""Shares of windows whose error is known, at least; of the others 0.94."""


@pytest.mark.parametrize("kind", SEQUENCES)
def test_errors_cover(kind):
    """Nominal 95 % hold the long-run mean in 92 to 98 % of 4000 windows, known to 0.4 %, by errors of the right size.

    Some are unknown where the lowest ordinates hold little but one swing, by chance.
    """
    x = SEQUENCES[kind](np.random.default_rng(7), 4000)
    mean, error = x.mean(axis=1), mean_standard_error(batch_means(x))
    known = np.isfinite(error)
    assert known.mean() > FEW_KNOWN.get(kind, 0.94)
    assert 0.92 < (np.abs(mean) < INTERVAL_ERRORS * error)[known].mean() < 0.98
    assert 1 / 1.5 < np.median(error[known]) / mean.std() < 1.5


@pytest.mark.parametrize("kind", [kind for kind in SEQUENCES if kind not in LONG])
def test_hardly_any_error_is_far_too_small(kind):
    """A parabola through nine ordinates may fall to nothing at zero by chance, and did so in one of 17 to 38 windows:
    errors below a fifth of the deviation of the means are rarer than one in 100. Where the memory is a tenth of the
    window or more the lowest ordinates are not alike, and their mean does not help."""
    x = SEQUENCES[kind](np.random.default_rng(7), 4000)
    error = mean_standard_error(batch_means(x))
    assert (error < 0.2 * x.mean(axis=1).std()).mean() < 0.01


@pytest.mark.parametrize("periods", ["p123", "p337", "p1213", "p2003"])
def test_a_determinate_signal_is_no_noise(periods):
    """A sine alone leaves in the mean what its last period does not complete, and the error is no more than that.

    The deviation of the batches over the root of their number would be three times as much, and more.
    """
    x = sines(np.random.default_rng(5), 4000, 0.0, **{periods: 1.0})
    means, scatter = batch_means(x), x.mean(axis=1).std()
    error = mean_standard_error(means)
    assert 1 / 1.5 < np.median(error) / scatter < 1.5
    assert (np.abs(x.mean(axis=1)) < INTERVAL_ERRORS * error).all()
    assert np.sqrt((means.var(axis=1, ddof=1) / BATCHES).mean()) / scatter > 3.0


@pytest.mark.parametrize(("periods", "known"), [("p11", 0.0), ("p41", 0.0), ("p4014", 0.0), ("p123", 1.0)])
def test_what_a_slow_sine_makes_of_batches_is_unknown(periods, known):
    """One of 401.4 periods, which each batch cuts at another phase, looks like one of 1.4."""
    x = sines(np.random.default_rng(5), 500, 0.01, **{periods: 3.0})
    assert np.isfinite(mean_standard_error(batch_means(x))).mean() == known


def test_batches_of_unlike_lengths_count_for_what_they_are():
    """A ripple cut at phases as they come, into batches some of which are twice as long as others.

    The sums, not the means, of the batches have little of it at low frequencies: what one lacks the next has.
    """
    random = np.random.default_rng(3)
    ends = np.arange(1, BATCHES) * 50 + random.integers(-20, 21, BATCHES - 1)
    weights = np.diff(np.concatenate([[0], ends, [4000]])).astype(float)
    x = np.sin(2.0 * np.pi * (40.3 * np.arange(4000) / 4000 + random.random((500, 1))))
    means = np.add.reduceat(x, np.concatenate([[0], ends]), axis=1) / weights
    alike = mean_standard_error(x.reshape(500, BATCHES, -1).mean(axis=2))
    assert np.median(mean_standard_error(means, weights) / alike) == pytest.approx(1.0, abs=0.3)
    assert np.median(mean_standard_error(means) / alike) > 2.0


def test_no_scatter_has_no_error():
    still = np.full((1, PARTS), 5.0)
    assert mean_standard_error(still)[0] == 0.0
    change, chance = window_drift(still)
    assert (change[0], chance[0]) == (0.0, 1.0) and is_steady(still)[0]


def test_a_drift_is_told_from_scatter():
    """False alarms come at their nominal rate, a drift of four deviations of the batches' means is found."""
    random, runs = np.random.default_rng(11), 4000
    noise = 100.0 + 5.0 * random.normal(size=(runs, PARTS))
    change, chance = window_drift(noise)
    assert 0.002 < (chance < 0.01).mean() < 0.012  # 1 % less what the correction takes off
    assert abs(change.mean()) < 4 * change.std() / np.sqrt(runs)
    ramp = noise + 20.0 * (np.arange(PARTS) + 0.5) / PARTS
    assert window_drift(ramp)[0].mean() == pytest.approx(20.0, abs=4 * change.std() / np.sqrt(runs))
    assert is_steady(ramp).mean() < 0.05
    assert is_steady(noise).mean() > 0.98


def test_a_ripple_that_the_window_cuts_is_no_change():
    """Means of parts of a line and a sine, exact integrals: the line's change is found beside 1 to 9 periods; a line
    alone is off by up to 6 A / (pi n)."""
    waves, edges = np.array([1.0, 1.3, 2.0, 4.7, 9.0]), np.arange(PARTS + 1) / PARTS
    place, w = (np.arange(PARTS) + 0.5) / PARTS, 2.0 * np.pi * waves[:, None]
    ripple = -np.diff(np.cos(w * edges + 0.2), axis=1) / w * PARTS
    means = 100.0 + 3.0 * place + 30.0 * ripple
    np.testing.assert_allclose(window_change(means, waves), 3.0, rtol=1e-9)
    off = np.abs(window_drift(means)[0] - 3.0)
    assert (off < 1.05 * 6.0 * 30.0 / (np.pi * waves)).all() and off[0] > 30.0
    for none in (0.0, 0.5, 9.5):  # none, not a whole one, or more than the parts resolve: the line alone
        assert (window_change(means, np.full(5, none)) == window_drift(means)[0]).all()


def test_a_small_or_exact_drift():
    place = (np.arange(PARTS) + 0.5) / PARTS
    creeping, ramped = 100.0 + 0.9 * place, 100.0 + 1.2 * place  # 0.9 and 1.2 % of the mean, without any scatter
    assert window_drift(ramped[None])[0][0] == pytest.approx(1.2)
    assert window_drift(ramped[None])[1][0] < 1e-6
    assert is_steady(creeping[None])[0] and not is_steady(ramped[None])[0]
