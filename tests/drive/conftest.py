"""Shared by the tests of drives: the marine drive, as data and as values to be spoiled."""

import pytest
from drives import example, marine_values


@pytest.fixture
def marine():
    return example("marine")


@pytest.fixture
def values():
    return marine_values()
