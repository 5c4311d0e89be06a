"""Float32 beside float64 where bodies are moved in pairs: arms, tensioners, rk4, one on a sprocket, an engine."""

import numpy as np
import pytest
from blocks import pushed_slider
from drives import timing, two_sprockets
from fired import fired

from warpchain import Record, simulate

RK4 = {"run.integrator": "rk4"}

DRIVES = {
    "arm": timing,
    "arm, rk4": lambda: timing().with_values(RK4),
    "rk4": lambda: two_sprockets().with_values(RK4),
    "engine": lambda: fired(**{"run.step": 2.5e-6}),
    "pushed": lambda: pushed_slider()[0],  # which does not touch it at its center
}


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("name", DRIVES)
def test_float32_gives_the_tensions_and_metrics_of_float64(name):
    drive = DRIVES[name]()
    record = Record(rate=0.05 / drive.run.step)
    steps = 4000
    exact, rounded = (
        simulate(drive, precision=precision, duration=steps * drive.run.step, record=record)
        for precision in ("float64", "float32")
    )
    # what the package promises of float32: the tension within 0.1 % of its mean over a while, metrics within 1 %
    tension = [np.asarray(run[0].tension, dtype=float).mean() for run in (exact, rounded)]
    assert tension[1] == pytest.approx(tension[0], rel=1e-3)
    first, second = (run.metrics.to_pylist()[0] for run in (exact, rounded))
    means = [key for key in first if key.endswith(("tension_mean", "angle_mean", "force_mean", "pressure_mean"))]
    assert len(means) >= 2
    for key in means:
        assert second[key] == pytest.approx(first[key], rel=1e-2, abs=1e-6), key
    for name in ("leaked", "supplied"):
        for key in (key for key in first if key.endswith(name)):
            assert second[key] == pytest.approx(first[key], rel=1e-2), key
    residual = [abs(metrics["energy_residual_relative"]) for metrics in (first, second)]
    assert residual[1] <= 2.0 * residual[0] + 2e-6
