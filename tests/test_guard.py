"""The guard of speed: what it marks, and what it does about a commit that is none."""

import sys

import pytest
from loading import load_script


@pytest.fixture
def guard():
    return load_script("bench_guard")


def test_cases_below_the_limit_are_marked(guard):
    before = {"loop": 100.0, "metrics": 100.0, "assembly": 10.0}
    after = {"loop": 97.0, "metrics": 96.9, "assembly": 20.0}
    marks = [line.endswith("slower") for line in guard.table(before, after, 0.97)]
    assert marks == [False, False, True, False]  # the first line is the head


def test_the_status_says_whether_a_case_is_slower(guard, monkeypatch, tmp_path, capsys):
    from contextlib import contextmanager

    @contextmanager
    def checkout(folder, name, commit):
        yield tmp_path / name

    monkeypatch.setattr(guard, "checkout", checkout)
    monkeypatch.setattr(guard, "drives_of", lambda tree: {})
    asked = []

    def rates(tree, drives, steps, assembled):
        asked.append(tree.name)
        return {"loop": 100.0 if tree.name == "a" else speed * len(asked)}

    monkeypatch.setattr(guard, "rates", rates)
    monkeypatch.setattr(sys, "argv", ["bench_guard.py", "main", "HEAD", "--rounds", "2"])
    for speed, status in ((10.0, 1), (20.0, 0)):  # the best of B is its last, the sixth: 60 and 120
        asked.clear()
        assert guard.main() == status
        assert asked == ["a", "b"] * 3  # once to compile, then in turns
        assert f"{speed * 6:9.1f}" in capsys.readouterr().out


def test_a_commit_that_is_none_is_told_in_one_line(guard, tmp_path):
    refused = pytest.raises(SystemExit, match=r"^no-such-commit: .*invalid reference: no-such-commit$")
    with refused, guard.checkout(tmp_path, "a", "no-such-commit"):
        pass
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("rates", "taken"),
    [([], 0.0), ([3.0], 3.0), ([2.0, 4.0], 4.0), ([5.0, 900.0, 4.0], 5.0), ([1.0, 3.0, 2.0, 4.0], 3.0)],
)
def test_a_clock_that_once_jumps_makes_no_best(guard, rates, taken):
    assert guard.best_but_one(rates) == taken
