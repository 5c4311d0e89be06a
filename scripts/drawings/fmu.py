"""Pictures of the page on FMUs: the run of its script, and a drum outside the drive beside one inside."""

import argparse
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from benches.fmu import started_slave
from common.cases import ROOT, Line, case
from common.drives import example_drive
from matplotlib.figure import Figure
from numpy.typing import NDArray

from warpchain import Drive, export_fmu, stepping

PAGE = ROOT / "docs" / "fmu.md"
DURATION, POINTS = 0.4, 100
PIECES = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
"""Communication steps [s]."""
FORWARD = -1.0
"""Sign of a speed forward: the conveyor turns clockwise."""


def results_of_page(folder: Path) -> dict[str, Any]:
    """Names that the page's script leaves behind."""
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    before = Path.cwd()
    os.chdir(folder)
    try:
        exec(compile(code, PAGE.name, "exec"), names)
    finally:
        os.chdir(before)
    return names


def drive_without_drum() -> tuple[Drive, Drive]:
    """The conveyor with a coupling without play, and the same without coupling and drum."""
    whole = example_drive("conveyor").with_values({"couplings.coupling.lash": 0.0})
    rest = tuple(shaft for shaft in whole.shafts if shaft.name != "drum")
    return whole, whole.model_copy(update={"shafts": rest, "couplings": ()})


def speeds_outside(path: Path, folder: Path, drive: Drive, piece: float) -> NDArray[np.float64]:
    """Speeds (POINTS,) of the drum outside, moved by an integrator of its own between communication steps [rad/s]."""
    from fmpy import read_model_description

    slave, _, _ = started_slave(path, folder)
    number = {each.name: each.valueReference for each in read_model_description(str(path)).modelVariables}
    seen = [number["driven.sprocket_angle"], number["driven.sprocket_speed"]]
    drum, coupling = drive.shafts[-1], drive.couplings[0]
    stiffness, damping, load = coupling.stiffness, coupling.damping, drum.load
    assert load is not None
    (first, speed), phi, omega, found, fine = slave.getFloat64(seen), 0.0, 0.0, [], 40
    angle = first
    for n in range(round(DURATION / piece)):
        moment = stiffness * (angle - first - phi) + damping * (speed - omega)
        slave.setFloat64([number["driven.load_torque"]], [FORWARD * moment])
        for k in range(fine):  # the sprocket goes on at its speed meanwhile
            ahead = (k + 0.5) * piece / fine
            twist, u = angle + speed * ahead - first - phi, min((n * piece + ahead) / load.ramp_time, 1.0)
            against = u * u * (3.0 - 2.0 * u) * (load.torque + load.viscous * FORWARD * omega)
            moved = stiffness * twist + damping * (speed - omega) - FORWARD * against
            omega += piece / fine * moved / drum.inertia
            phi += piece / fine * omega
        slave.doStep(n * piece, piece)
        angle, speed = slave.getFloat64(seen)
        found.append(omega)
    slave.freeInstance()
    every = round(DURATION / POINTS / piece)
    return np.array(found[every - 1 :: every])


def drum_errors(folder: Path) -> tuple[NDArray[np.float64], list[float]]:
    """Speeds (POINTS,) of the drum inside, and the largest differences of one outside, for `PIECES` [rad/s]."""
    whole, rest = drive_without_drum()
    with stepping(whole, outputs=["drum.shaft_speed"], device="cpu", duration=DURATION) as run:
        inside = []
        for _ in range(POINTS):
            run.advance(DURATION / POINTS)
            inside.append(run.get("drum.shaft_speed"))
    path = export_fmu(
        rest, folder / "rest.fmu", inputs=["driven.load_torque"], outputs=["sprocket_angle", "sprocket_speed"]
    )
    errors = [
        float(np.abs(speeds_outside(path, folder / f"{k}", whole, piece) - inside).max())
        for k, piece in enumerate(PIECES)
    ]
    return np.array(inside), errors


def fmu_figure(names: dict[str, Any], errors: list[float]) -> Figure:
    """Speed and torque of the page's run over time, and the error of a drum outside over the communication step."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    result = names["result"]
    left.plot(result["time"], np.abs(result["motor.shaft_speed"]), color="tab:blue")
    left.set(xlabel="time [s]", ylabel="speed of the motor [rad/s]")
    middle.plot(result["time"], np.abs(result["coupling.coupling_torque"]) / 1e3, color="tab:orange", lw=0.8)
    middle.set(xlabel="time [s]", ylabel="torque of the coupling [kN m]")
    right.loglog(1e3 * np.array(PIECES), errors, "o-", color="tab:green", label="drum outside")
    right.loglog(1e3 * np.array(PIECES), errors[-1] * np.array(PIECES) / PIECES[-1], color="0.6", label="first order")
    right.set_xticks([1e3 * piece for piece in PIECES], labels=[f"{1e3 * piece:g}" for piece in PIECES], minor=False)
    right.minorticks_off()
    right.set(xlabel="communication step [ms]", ylabel="error of the drum's speed [rad/s]")
    right.legend(frameon=False)
    return figure


@case()
def fmu(asked: argparse.Namespace) -> Iterator[Line]:
    """The conveyor as an FMU by the script of docs/fmu.md, and its drum outside of it.

    python scripts/figures.py fmu

    Needs the extra fmu.
    """
    with tempfile.TemporaryDirectory() as place:
        names = results_of_page(Path(place))
        inside, errors = drum_errors(Path(place))
    yield {"fmu": fmu_figure(names, errors)}
    yield f"largest speed of the drum: {np.abs(inside).max():.3f} rad/s"
    for piece, error in zip(PIECES, errors, strict=True):
        yield f"communication step {1e3 * piece:g} ms: error {error:.4g} rad/s"
