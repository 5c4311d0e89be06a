"""The scripts of the page on stepping: a motor under its controller, and 64 drums behind slipping clutches."""

import argparse
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import ROOT, Line, case
from matplotlib.figure import Figure

PAGE = ROOT / "docs" / "stepping.md"


def results_of_page() -> list[dict[str, Any]]:
    """Names that each script of the page leaves behind."""
    found = []
    for code in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        names: dict[str, Any] = {}
        exec(compile(code, PAGE.name, "exec"), names)
        found.append(names)
    return found


def speeds_figure(motor: dict[str, Any], drums: dict[str, Any]) -> Figure:
    """Speeds over time: of the motor and of all drums, wanted and reached."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    time = 1e-3 * np.arange(1, len(motor["speeds"]) + 1)
    left.plot(time, 157.0 * np.minimum(time / 0.3, 1.0), color="0.6", lw=3.0, label="wanted")
    left.plot(time, motor["speeds"], color="tab:blue", label="motor")
    left.set(xlabel="time [s]", ylabel="speed of the motor [rad/s]")
    time = 1e-3 * np.arange(1, len(drums["speeds"]) + 1)
    right.plot(time, 12.0 * np.maximum(time - 0.1, 0.0), color="0.6", lw=3.0, label="wanted")
    right.plot(time, np.array(drums["speeds"]), color="tab:orange", lw=0.5)
    right.plot([], [], color="tab:orange", label="64 drums")
    right.set(xlabel="time [s]", ylabel="speed of the drums [rad/s]")
    for axes in (left, right):
        axes.legend(frameon=False)
    return figure


@case()
def stepping(asked: argparse.Namespace) -> Iterator[Line]:
    """Speeds of a motor under a controller and of 64 drums behind clutches, by the scripts of docs/stepping.md.

    python scripts/figures.py stepping
    """
    motor, drums = results_of_page()
    yield {"stepping": speeds_figure(motor, drums)}
    late = np.array(drums["speeds"])[200:]
    wanted = 12.0 * (1e-3 * np.arange(201, len(drums["speeds"]) + 1) - 0.1)
    yield f"largest deviation of a drum from 0.2 s on: {abs(late - wanted[:, None]).max():.3f} rad/s"
    yield f"largest tension: {max(motor['tensions']):.0f} N"
