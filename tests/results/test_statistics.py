"""Quantiles from counts, standard errors by batch means, drifts: on samples whose distribution is known."""

import numpy as np
import pytest

from warpchain.engine.outcomes import tension_edges
from warpchain.kernels.statistics import BINS
from warpchain.results.batch_means import drift, quantile, standard_error, steady

SHARES = (0.001, 0.01, 0.5, 0.99, 0.999)
BATCHES = 20


def ar1(random, runs, samples, phi):
    """(runs, samples) of x_t = phi x_(t-1) + e_t, variance one, from its own distribution."""
    noise = random.normal(size=(runs, samples)) * np.sqrt(1.0 - phi * phi)
    x = np.empty((runs, samples))
    x[:, 0] = random.normal(size=runs)
    for t in range(1, samples):
        x[:, t] = phi * x[:, t - 1] + noise[:, t]
    return x


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
        found, exact = quantile(counts, edges, [x.min()], [x.max()], share)[0], np.quantile(x, share)
        assert abs(found - exact) < 0.01 * max(abs(exact), scale), share


def test_quantiles_do_not_leave_the_range():
    edges = tension_edges(np.array([100.0, 100.0, 100.0]))
    counts = np.zeros((3, int(BINS)), dtype=np.int32)
    counts[0, 120] = 7  # all alike
    counts[1, [0, -1]] = 5  # beyond the bins' ends: evenly from the end bins' inner edges to the extremes
    low, high = np.array([165.0, -1e6, 0.0]), np.array([165.0, 1e6, 0.0])
    found = np.array([quantile(counts, edges, low, high, share) for share in SHARES])
    assert (found[:, 0] == 165.0).all()
    assert found[0, 1] == pytest.approx(-1e6 + 0.002 * (1e6 + edges[1, 1]))
    assert found[-1, 1] == pytest.approx(1e6 - 0.002 * (1e6 - edges[1, -2]))
    assert np.isnan(found[:, 2]).all()  # nothing was counted


@pytest.mark.parametrize("phi", [0.0, 0.9, 0.99])
def test_standard_error_of_an_autoregressive_sequence(phi):
    """1000 runs of x_t = phi x_(t-1) + e_t: the mean reported error over the mean's own scatter is 1.

    The scatter of 1000 is known to 2 %. At phi = 0.99 batches of 200 are correlated (time constant 100 samples): the
    spectrum has fallen to 0.72 of S(0) at the fourth ordinate, to 0.87 on the average, its root to 0.93.
    """
    x = ar1(np.random.default_rng(7), 1000, 4000, phi)
    scatter, error = x.mean(axis=1).std(), standard_error(batch_means(x))
    exact = 0.93 if phi == 0.99 else 1.0
    assert np.sqrt((error * error).mean()) / scatter == pytest.approx(exact, rel=0.07)
    assert error.std() / error.mean() == pytest.approx(0.25, abs=0.03)  # of a root of chi-square / 8


def test_an_oscillation_averages_out():
    """Noise and a sine of 7.3 periods, of which A sin(7.3 pi) / (7.3 pi) at most is left over in the mean.

    The error counts what of it leaks to the lowest frequencies, less than twice the scatter; the deviation of the
    batches over the root of their number would be more than four times the scatter.
    """
    random = np.random.default_rng(5)
    phase = 2.0 * np.pi * random.random((1000, 1))
    x = random.normal(size=(1000, 4000)) + 2.0 * np.sin(2.0 * np.pi * 7.3 * np.arange(4000) / 4000 + phase)
    means, scatter = batch_means(x), x.mean(axis=1).std()
    assert 0.7 < np.sqrt((standard_error(means) ** 2).mean()) / scatter < 2.0
    assert np.sqrt((means.var(axis=1, ddof=1) / BATCHES).mean()) / scatter > 4.0


def test_no_scatter_has_no_error():
    still = np.full((1, BATCHES), 5.0)
    assert standard_error(still)[0] == 0.0
    change, chance = drift(still)
    assert (change[0], chance[0]) == (0.0, 1.0) and steady(still)[0]


def test_a_drift_is_told_from_scatter():
    """False alarms come at their nominal rate, a drift of four deviations of the batches' means is found."""
    random, runs = np.random.default_rng(11), 4000
    noise = 100.0 + 5.0 * random.normal(size=(runs, BATCHES))
    change, chance = drift(noise)
    assert 0.002 < (chance < 0.01).mean() < 0.012  # 1 % less what the correction takes off
    assert abs(change.mean()) < 4 * change.std() / np.sqrt(runs)
    ramp = noise + 20.0 * (np.arange(BATCHES) + 0.5) / BATCHES
    assert drift(ramp)[0].mean() == pytest.approx(20.0, abs=4 * change.std() / np.sqrt(runs))
    assert steady(ramp).mean() < 0.05
    assert steady(noise).mean() > 0.98


def test_a_small_or_exact_drift():
    place = (np.arange(BATCHES) + 0.5) / BATCHES
    creeping, ramped = 100.0 + 0.9 * place, 100.0 + 1.2 * place  # 0.9 and 1.2 % of the mean, without any scatter
    assert drift(ramped[None])[0][0] == pytest.approx(1.2)
    assert drift(ramped[None])[1][0] < 1e-6
    assert steady(creeping[None])[0] and not steady(ramped[None])[0]
