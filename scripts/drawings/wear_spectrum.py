"""The spectrum of a worn chain."""

import argparse
from pathlib import Path

import numpy as np
from common.cases import case, option
from numpy.typing import NDArray

from drawings.profiles import COLORS, PITCH, PROFILES, TEETH, drive
from warpchain import Drive, Record, Trajectory, simulate
from warpchain.results.signals import order_spectrum, strand_tension

ELONGATION = 0.0075  # of the chain as a whole
DURATION = 2.0  # s
CASES: dict[str, tuple[float, dict[str, object]]] = {
    "new chain": (0.0, {}),
    "all links 0.75 % longer": (ELONGATION, {"chain.elongation": ELONGATION}),
    "outer links 1.5 % longer": (ELONGATION, {"chain.outer": {"elongation": 2.0 * ELONGATION}}),
}
JOINT = {"friction": 0.1, "pin_radius": 4.14e-3}  # of a 16B
TIGHT = 1  # driven -> driver


def worn(elongation: float, wear: dict[str, object]) -> Drive:
    """The drive with a chain longer by `elongation`, its sprockets as far apart as keeps it taut."""
    span = 29.5 * PITCH * (1.0 + elongation) * (1.0 + 3e-4)
    return drive(PROFILES["iso606, minimum gap"]).with_values(
        {"sprockets.driven.center": [span, 0.0], "run.duration": DURATION, "chain.joint": JOINT, **wear}
    )


def spectra(trajectory: Trajectory) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Tooth orders, and amplitudes: of the tight strand's tension [N], of the driven shaft's speed over its mean."""
    assert trajectory.sprocket_speed is not None
    speed = trajectory.sprocket_speed[:, 1]
    found = []
    for values in (strand_tension(trajectory, TIGHT), speed / speed[len(speed) // 2 :].mean()):
        spectrum = order_spectrum(trajectory, values)
        assert spectrum is not None
        found.append((spectrum[0] / TEETH, spectrum[1]))
    return found


def at(order: float, spectrum: tuple[NDArray[np.float64], NDArray[np.float64]]) -> float:
    """The largest amplitude within 2 % of a tooth of an order."""
    orders, amplitude = spectrum
    return float(amplitude[np.abs(orders - order) < 0.02].max())


@case(option("picture", nargs="?", type=Path, help="where to save the figure; default: nowhere"))
def wear_spectrum(asked: argparse.Namespace) -> None:
    """What wear does to a drive's spectrum: outer links alone longer, against all links longer alike, and a new chain.

    python scripts/figures.py wear-spectrum [docs/images/wear-spectrum.png]

    The drive of `profiles` (19 teeth, 60 rad/s) with friction in its joints, so that it runs quietly. Both
    worn chains are 0.75 % longer as a whole. Spectra are of the later half of 2 s, over orders of the driver's tooth
    passing.
    """
    target = asked.picture
    from matplotlib.figure import Figure

    record = Record(rate=1e4, channels=("position", "tension", "sprocket_angle", "sprocket_speed", "sprocket_center"))
    run = simulate([worn(*case) for case in CASES.values()], record=record)
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    print("chain                       tight strand, order 1/2 / 1 [N]   driven speed, order 1/2 / 1 [%]   status")
    for v, (name, color) in enumerate(zip(CASES, ("0.55", *COLORS), strict=False)):
        tension, speed = spectra(run[v])
        print(
            f"{name:26s} {at(0.5, tension):16.1f} / {at(1.0, tension):.1f} {100 * at(0.5, speed):24.3f} / "
            f"{100 * at(1.0, speed):.3f} {run.metrics['status'][v].as_py():>18s}"
        )
        for axis, (orders, amplitude), scale in zip(axes, (tension, speed), (1.0, 100.0), strict=True):
            axis.semilogy(orders, scale * amplitude, color=color, lw=1.1, label=name)
    for axis, label in zip(axes, ("tight strand's tension [N]", "driven speed over its mean [%]"), strict=True):
        low, high = axis.get_ylim()
        axis.set(ylabel=label, xlim=(0.0, 2.6), ylim=(max(low, 1e-5 * high), high))
        axis.grid(alpha=0.3)
    axes[0].legend(loc="upper right", fontsize=9)
    axes[1].set(xlabel="order of the tooth passing (1 is z, 1/2 is z/2 of a revolution)")
    if target is not None:
        figure.savefig(target, dpi=110)
