"""Shared by all tests: quiet Warp, and hypothesis without deadlines (the machine may be slow)."""

import pytest
from hypothesis import settings

settings.register_profile("warpchain", deadline=None, max_examples=50)
settings.load_profile("warpchain")


@pytest.fixture(scope="session", autouse=True)
def quiet_warp():
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()
