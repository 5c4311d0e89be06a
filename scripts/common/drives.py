"""The drives of scripts: examples with other values, and two equal sprockets."""

from typing import Any

from common.cases import SCRIPTS
from warpchain import Drive, load_drive
from warpchain.drive.examples import drive_path

Values = dict[str, Any]
TWO = SCRIPTS / "common" / "two.toml"


def example(name: str, values: Values | None = None) -> Drive:
    """One of the package's examples, with other values."""
    return load_drive(drive_path(name)).with_values(values or {})


def pair(values: Values | None = None) -> Drive:
    """Two equal sprockets, with other values."""
    return load_drive(TWO).with_values(values or {})


def equal(teeth: int, links: int, pitch: float, slack: float = 0.0) -> Values:
    """Values that give both sprockets so many teeth, and put them apart by the chain's straight strands and `slack`."""
    span = (links - teeth) / 2 * pitch + slack
    return {
        "chain.pitch": pitch,
        "chain.links": links,
        "sprockets.driver.teeth": teeth,
        "sprockets.driven.teeth": teeth,
        "sprockets.driven.center": [span, 0.0],
    }
