"""Timing chains of engines: a row of docs/validation.md."""

from collections.abc import Iterator

import numpy as np
from common.cases import Line

from drawings.car import at_speed, crank_degrees, later
from drawings.closed_forms import Row
from warpchain import Record, simulate
from warpchain.results.rotation import order_amplitudes, turns_of

SPEEDS = (1000, 2000, 3000, 4000, 5000, 6000)
ORDERS = (2.0, 4.0, 6.0, 8.0)


def engines() -> Iterator[Line]:
    """Largest link load, and how far the camshafts lag, of the example `car` over speed."""
    run = simulate([at_speed(rpm) for rpm in SPEEDS], record=Record(rate=1e4, channels=("sprocket_angle",)))
    largest = np.array([row["tension_max"] for row in run.metrics.to_pylist()])
    lags = [[crank_degrees(trajectory, s) for s in (1, 2)] for trajectory in run.values()]
    torsion = np.array([[np.ptp(lag) for lag in both] for both in lags])
    sizes = []
    for trajectory, both in zip(run.values(), lags, strict=True):
        found = [order_amplitudes(turns_of(trajectory)[later(trajectory)], lag, ORDERS) for lag in both]
        sizes.append(np.max([size for size in found if size is not None], axis=0))
    orders = ", ".join(f"{order:g}: {size:.3f}" for order, size in zip(ORDERS, np.max(sizes, axis=0), strict=True))
    yield Row(
        name="timing chains of three engines",
        gives=f"{largest.min():.0f} to {largest.max():.0f} N; camshafts swing by {torsion.min():.2f} to "
        f"{torsion.max():.2f} degrees; largest amplitudes of orders {orders} degrees",
    )
