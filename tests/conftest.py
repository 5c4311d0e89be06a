"""Shared by all tests: quiet Warp, and hypothesis without deadlines (the machine may be slow)."""

import signal
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("warpchain", deadline=None, max_examples=50)
settings.load_profile("warpchain")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in a shell's background; commands under test inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the same under nohup


@pytest.fixture(scope="session", autouse=True)
def quiet_warp():
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()


@pytest.fixture
def own_plugins():
    """Registries that plug-ins add to, as they were before once a test has ended."""
    import warp as wp

    from warpchain.drive import laws, own_loads, plugins
    from warpchain.engine import own_laws
    from warpchain.kernels.physics import impact
    from warpchain.results import channels, metric_columns, own_channels, own_metrics

    registries = (laws.LAWS, laws.LAWS_IN_USE, metric_columns.COLUMN_BY_NAME, metric_columns.OWN_COLUMNS)
    registries += (own_metrics.OWN_METRICS, plugins._LOADED, plugins._DIRECT, own_loads.OWN_LOADS)
    registries += (own_channels.OWN_CHANNELS, channels.CHANNEL_BY_NAME, channels.CHANNEL_UNITS)
    held, forces = [dict(of) for of in registries], impact.FORCES
    yield
    for registry, before in zip(registries, held, strict=True):
        registry.clear()
        registry.update(before)
    laws._cached_law_factor.cache_clear()
    if forces != impact.FORCES:
        impact.FORCES = forces
        impact.law_damper = wp.func(impact.law_damper.func)
        own_laws.forget_kernels()


@pytest.fixture
def fibers():
    """Blocks of several threads on the CPU, for one test."""
    import warp as wp

    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    yield
    wp.config.enable_cpu_blocks = before


def _gpus() -> bool:
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    return wp.is_cuda_available()


KERNELS = pytest.StashKey[int]()
"""Modules in Warp's cache before the tests."""


def _cached_kernels() -> int:
    """Number of modules in Warp's cache."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    return len(list(Path(wp.config.kernel_cache_dir).glob("wp_*")))


def pytest_sessionstart(session):
    if not hasattr(session.config, "workerinput"):  # of several processes the one that starts the others
        session.config.stash[KERNELS] = _cached_kernels()


def pytest_terminal_summary(terminalreporter, config):
    """Tells how many kernels the tests have compiled."""
    if KERNELS in config.stash:
        terminalreporter.write_line(f"{_cached_kernels() - config.stash[KERNELS]} kernels compiled")


SLOW = ("kernels", "engine")
"""Folders of tests that compile kernels, for minutes a file."""


def pytest_collection_modifyitems(items):
    """Slow files come first, so that no worker is left with one at the end; without a GPU what needs one is skipped."""
    order = {name: number for number, name in enumerate(SLOW)}
    items.sort(key=lambda item: order.get(item.path.parent.name, len(SLOW)))
    marked = [item for item in items if item.get_closest_marker("gpu")]
    if marked and not _gpus():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="no CUDA device here"))


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request, monkeypatch):
    """Each device in turn as the one that `simulate` takes where none is named; what a GPU cannot run is skipped."""
    from warpchain.engine import devices, gpu

    chosen = devices.devices_by_name

    def forced(wanted, packed):
        if wanted is None and request.param == "cuda" and gpu.gpu_refusal(packed) is not None:
            pytest.skip(str(gpu.gpu_refusal(packed)))
        return chosen(wanted or request.param, packed)

    monkeypatch.setattr(devices, "devices_by_name", forced)
    monkeypatch.setattr(devices, "fastest_devices", lambda gpus, *_: devices.DeviceChoice(tuple(gpus), None))
    return request.param
