"""Shared by the tests of drives: the marine drive, as data and as values to be spoiled."""

import pytest
from drives import MARINE, marine_values

from warpchain.drive import load_drive


@pytest.fixture
def marine():
    return load_drive(MARINE)


@pytest.fixture
def values():
    return marine_values()
