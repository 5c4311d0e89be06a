"""The example of the page on plug-ins: a study with an own metric, and an own contact law beside those there are."""

import argparse
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common.cases import ROOT, Line, case
from matplotlib.figure import Figure

from warpchain import load_plugin, run_study
from warpchain.drive.laws import LAWS
from warpchain.drive.stiffness import rebound_ratio
from warpchain.study.results import Results, read_results

PAGE = ROOT / "docs" / "plugins.md"


def write_files_of_page(folder: Path) -> None:
    """Writes the page's blocks that begin with a file's name as these files."""
    for name, text in re.findall(r"^```\w+\n# ([\w.]+)\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        (folder / name).write_text(text)


def own_figure(results: Results) -> Figure:
    """Transmission error over teeth, and rebound over restitution by each law."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    teeth, speed, error = (results.values(name) for name in ("teeth", "speed", "transmission_error"))
    for value, color in zip(np.unique(speed), ("tab:blue", "tab:orange"), strict=True):
        mine = speed == value
        left.semilogy(teeth[mine], error[mine], "o-", color=color, ms=4.0, label=f"{value:g} rad/s")
    left.set(xlabel="teeth of the motor's sprocket", ylabel="transmission error [rad]", xticks=np.unique(teeth))
    restitution = np.linspace(0.02, 1.0, 99)
    for name in LAWS:
        own = name == "approach"
        style = {"color": "black", "lw": 2.0} if own else {"lw": 1.0}
        right.plot(restitution, [rebound_ratio(e, name) for e in restitution], label=name + own * " (own)", **style)
    right.set(xlabel="restitution of the drive file", ylabel="speed after an impact over before")
    for axes in (left, right):
        axes.legend(frameon=False, fontsize="small")
    return figure


@case()
def plugins(asked: argparse.Namespace) -> Iterator[Line]:
    """A study of teeth with an own metric as objective, and rebounds of an own law, by the files of docs/plugins.md.

    python scripts/figures.py plugins
    """
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        write_files_of_page(here)
        for name in ("transmission.py", "approach.py"):
            load_plugin(here / name)
        run_study(here / "even.toml", here / "even")
        results = read_results(here / "even" / "results.parquet")
    yield {"plugins": own_figure(results)}
    yield ("teeth", *map(int, results.values("teeth")))
    yield ("speed [rad/s]", *results.values("speed"))
    yield ("transmission error [rad]", *(f"{x:.2g}" for x in results.values("transmission_error")))
