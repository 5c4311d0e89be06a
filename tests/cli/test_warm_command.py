"""`warpchain warm` compiles what the first run would wait for, and says what it found."""

import contextlib
import re

import pytest
from command import refused, run
from drives import example

from warpchain import Record, simulate
from warpchain.cli.warm_command import MOST_LINKS, WARMED_EXAMPLES
from warpchain.drive.examples import example_names
from warpchain.engine import compilation
from warpchain.engine.cpu import CAPACITIES, SPARE_VALUES
from warpchain.progress import COMPILING


class Found(Exception):
    """Ends a run where it would load its kernels."""


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_three_examples_have_the_kernels_of_all_but_long_chains(monkeypatch):
    """On the CPU, whether a run records or not; chains that a longer scratch row holds have kernels of their own."""

    @contextlib.contextmanager
    def load(modules, report):
        raise Found(*(module.name for module in modules))
        yield

    monkeypatch.setattr(compilation, "load_cpu_kernels", load)

    def kernels(name, kept):
        with pytest.raises(Found) as found:
            simulate(example(name), duration=0.001, device="cpu", record=Record(kept))
        return set(found.value.args)

    assert CAPACITIES[0] - SPARE_VALUES - 1 == MOST_LINKS
    warmed = set.union(*(kernels(name, "none") for name in WARMED_EXAMPLES))
    for name in example_names():
        is_long = max(chain.links for chain in example(name).each_chain) > MOST_LINKS
        assert (kernels(name, "all") <= warmed) != is_long, name


def test_it_says_what_it_compiled(capsys, monkeypatch):
    """A drive whose kernels a load reports as lacking was compiled, one whose kernels are there was not."""
    status, out, _ = run(capsys, "warm", "marine", "--quiet")
    assert status == 0 and "some 10 s" in out[0] and len(out) == 2
    status, out, _ = run(capsys, "warm", "marine", "--quiet")
    assert (status, out[1]) == (0, "marine: there already")
    whole = compilation.load_cpu_kernels

    @contextlib.contextmanager
    def load(modules, report):
        report(COMPILING, 0, 2)
        with whole(modules, report):
            yield

    monkeypatch.setattr(compilation, "load_cpu_kernels", load)
    _, out, _ = run(capsys, "warm", "marine", "--quiet")
    assert re.fullmatch(r"marine: compiled in \d+ s", out[1])


def test_what_cannot_run_is_refused(capsys):
    assert "nowhere.toml: cannot be read" in refused(capsys, "warm", "nowhere.toml")
    status, _, err = run(capsys, "warm", "marine", "--device", "gpu")
    assert status == 2 and "--device gpu" in err[0]
