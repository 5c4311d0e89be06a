"""Shared by the tests of drives: the marine drive, as values to be spoiled, and what errors they make."""

import tomllib
from pathlib import Path

import pytest

import warpchain
from warpchain.drive import Drive
from warpchain.errors import DriveError

MARINE = Path(warpchain.__file__).parent / "drives" / "marine.toml"
STEEL = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3}
POSITIVE = "must be a positive number"
NOT_NEGATIVE = "must be a number of at least 0"


def marine_values():
    """The marine drive as plain values."""
    return tomllib.loads(MARINE.read_text())


def put(values, path, value):
    """Sets (or with None takes away) a value in nested lists and tables."""
    *above, last = path.split("/")
    node = values
    for key in above:
        node = node[int(key)] if isinstance(node, list) else node.setdefault(key, {})
    if value is None:
        del node[last]
    elif isinstance(node, list):
        node[int(last)] = value
    else:
        node[last] = value


def errors_of(values):
    with pytest.raises(DriveError) as caught:
        Drive(**values)
    assert str(caught.value) == "\n".join(caught.value.errors)
    return caught.value.errors
