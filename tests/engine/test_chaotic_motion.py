"""Statistics of runs: quantiles against every step's tensions, slips, drifts, and errors against copies of a drive."""

import numpy as np
import pytest
from drives import row, two_sprockets

from warpchain import Record, simulate
from warpchain.results import metric_formulas
from warpchain.results.window_statistics import INTERVAL_ERRORS


def chattering(**values):
    return two_sprockets(step=1e-5, restitution=0.8, damping=500.0, speed=40.0, **values)


def test_quantiles_are_those_of_every_step():
    """32 steps apart, against all links at all steps: within 1 % of the value or of the scale, as documented.

    The scale is a tenth of load / radius + (m / p) v^2; beside it 200 looks in place of 6400 are good to 1 % of the
    tension's deviation at the median.
    """
    run = simulate(chattering(duration=0.128), device="cpu", record=Record(rate=1e5))
    [metrics], recorded = run.metrics.to_pylist(), run[0]
    inside = recorded.time >= metrics["window_start"] - 1e-12
    tension = recorded.tension[inside].astype(float)
    assert inside.sum() == 6401
    radius = 0.025 / np.sin(np.pi / 20)
    scale = 0.1 * (300.0 / radius + 1.0 / 0.05 * (40.0 * radius) ** 2)
    deviation = metrics["tension_std"]
    for name, share in (("q001", 0.001), ("q01", 0.01), ("q50", 0.5), ("q99", 0.99), ("q999", 0.999)):
        exact = np.quantile(tension, share)
        # sampling: the shares' own scatter, four times its deviation for independent looks of 60 links
        near = np.quantile(tension, np.clip(share + np.array([-4, 4]) * np.sqrt(share * (1 - share) / 12000), 0, 1))
        allowed = 0.01 * max(abs(exact), scale, deviation) + np.abs(near - exact).max()
        assert abs(metrics[f"tension_{name}"] - exact) < allowed, name
    assert metrics["tension_min"] <= metrics["tension_q001"] <= metrics["tension_q999"] <= metrics["tension_max"]


def slack(span, torque, **values):
    return two_sprockets(
        span=span, torque=torque, speed=20.0, inertia=0.5, duration=0.2, step=1e-5, settle="false", load_ramp=0.05,
        **values,
    )  # fmt: skip


def seats_passed(trajectory, center, teeth, pitch=0.05):
    """Teeth by which the chain's rollers on a sprocket moved against its seats, to the left, from the run's start."""
    radius = 0.5 * pitch / np.sin(np.pi / teeth)
    apart = trajectory.position - np.asarray(center)
    angle = np.arctan2(apart[..., 1], apart[..., 0]) - trajectory.sprocket_angle[:, 1][:, None]
    place = angle * teeth / (2.0 * np.pi) - np.arange(apart.shape[1])
    near = (np.abs(np.hypot(apart[..., 0], apart[..., 1]) - radius) < 0.01) & (apart[..., 0] > 0.5 * radius)
    ends = [np.angle(np.exp(2j * np.pi * place[f][near[f]] / teeth).mean()) for f in (0, -1)]
    return (ends[1] - ends[0]) * teeth / (2.0 * np.pi)


@pytest.mark.parametrize(("span", "slips"), [(19.9, 0), (19.2, 1)])
def test_a_slack_chain_under_load_jumps_teeth(span, slips):
    """A load that comes on while the chain is 8 % of a span too long pulls it over a tooth; a fitting chain holds.

    What is counted is what the recorded rollers did: a whole number of seats, to a twentieth.
    """
    run = simulate(slack(span, 3000.0), device="cpu", record=Record(rate=1000.0), window=(0.0, 0.2))
    [metrics] = run.metrics.to_pylist()
    assert metrics["driven.slips"] == slips and metrics["driver.slips"] == 0
    assert seats_passed(run[0], (span * 0.05, 0.0), 20) == pytest.approx(slips, abs=0.05)


def test_a_ramp_in_the_window_is_not_steady():
    """The driver's speed doubles over the window, and with it the tension's centrifugal part; or it stays."""
    ramped = row(two_sprockets(speed=20.0, ramp=0.2, step=1e-5), window=(0.1, 0.2))
    assert ramped["steady"] is False
    still = row(two_sprockets(speed=20.0, step=1e-5, damping=5000.0), window=(0.1, 0.2))
    assert still["steady"] is True
    assert abs(still["tension_drift"]) < 0.01 * still["tension_mean"] or still["tension_drift_p"] > 0.01


def test_errors_of_a_chaotic_drive():
    """Twelve copies whose loads differ by 1e-4, over 4.2 turns: the mean of each is as near to that of all as it says.

    The scatter of 12 is known to 20 %, their median error to 30, and it comes out at 0.75 of the scatter in windows of
    this length (docs/chaotic-motion.md): so it is between 0.35 of it and twice. By chance more than two are beyond
    their nominal 95 % in 2 % of cases.
    """
    drives = [chattering(span=8.0, links=36, gravity=-9.81, duration=1.6, torque=300.0 + 0.03 * v) for v in range(12)]
    table = simulate(drives, device="cpu", record=Record("none"), window=(0.4, 1.6)).metrics
    for name in ("tension_mean", "driver->driven.tension_mean", "driven->driver.tension_mean"):
        means, errors = table[name].to_numpy(), table[f"{name}_se"].to_numpy()
        assert (np.abs(means - means.mean()) > INTERVAL_ERRORS * errors).sum() <= 2
        assert np.isnan(errors).sum() <= 1  # which then says that it is unknown
        assert 0.35 < np.nanmedian(errors) / means.std(ddof=1) < 2.0


@pytest.mark.parametrize(("turns", "known"), [(3.9, False), (4.0, True)])
def test_errors_of_short_windows_are_unknown(turns, known):
    """Four turns of the chain are the least; one of 60 links takes 60 / 20 turns of the driver."""
    duration = 0.2 + turns * 3.0 * 2.0 * np.pi / 80.0
    found = row(two_sprockets(step=2e-5, speed=80.0), duration=duration, window=(0.2, duration))
    assert ("tension_mean_se" in found) == known


@pytest.mark.parametrize("start", [0.005, 0.00507])
def test_batches_add_up(start, monkeypatch):
    """Whatever step the window begins at, batches stand for all of it: their mean is the window's."""
    found = []

    def note_batches(means, weights):
        """Numbers from `found` in place of standard errors."""
        found.extend(zip(means, np.broadcast_to(weights, means.shape), strict=True))
        return np.arange(len(found) - len(means), len(found), dtype=float)

    monkeypatch.setattr("warpchain.results.metrics.LEAST_CHAIN_TURNS", 0.0)
    monkeypatch.setattr(metric_formulas, "mean_standard_error", note_batches)
    metrics = row(two_sprockets(step=1e-5), duration=0.045, window=(start, 0.045))
    steps = round((0.045 - start) / 1e-5)
    names = [name for name in metrics if name.endswith("_mean_se")]
    assert sorted(metrics[name] for name in names) == list(range(len(found)))
    for name in names:
        means, weights = found[int(metrics[name])]
        assert means.shape == (80,)
        mean = metrics[name.removesuffix("_se")]
        # the window's first and last step count half, which in a batch weighs those beside them the more
        assert np.average(means, weights=weights) == pytest.approx(mean, abs=1e-12 + np.ptp(means) / steps)
