"""The drives and studies of scripts: examples with other values, and two equal sprockets."""

import tempfile
from pathlib import Path
from typing import Any

import warpchain.study
from common.cases import SCRIPTS
from warpchain import Drive, load_drive, run_study
from warpchain.drive.examples import drive_path
from warpchain.study.results import Results, read_results

Values = dict[str, Any]
TWO = SCRIPTS / "common" / "two.toml"
SMOOTH: Values = {
    "chain.joint": None,
    "contact.sprocket.friction": None,
    "contact.guide.friction": None,
    "contact.guide.rolling": False,
}
"""The values that take friction from a drive."""


def example_drive(name: str, values: Values | None = None) -> Drive:
    """One of the package's examples, with other values."""
    return load_drive(drive_path(name)).with_values(values or {})


def without_friction(drive: Drive) -> Drive:
    """A drive that is smooth."""
    return drive.with_values({key: value for key, value in SMOOTH.items() if drive.guides or "guide" not in key})


def study_of_example(name: str) -> Results:
    """The results of one of the package's example studies, run now."""
    file = Path(warpchain.study.__file__).parent / "examples" / f"{name}.toml"
    with tempfile.TemporaryDirectory() as folder:
        run_study(file, Path(folder) / "study")
        return read_results(Path(folder) / "study" / "results.parquet")


def two_sprockets(values: Values | None = None) -> Drive:
    """Two equal sprockets, with other values."""
    return load_drive(TWO).with_values(values or {})


def equal_sprocket_values(teeth: int, links: int, pitch: float, slack: float = 0.0) -> Values:
    """Values that give both sprockets so many teeth, and put them apart by the chain's straight strands and `slack`."""
    span = (links - teeth) / 2 * pitch + slack
    return {
        "chain.pitch": pitch,
        "chain.links": links,
        "sprockets.driver.teeth": teeth,
        "sprockets.driven.teeth": teeth,
        "sprockets.driven.center": [span, 0.0],
    }
