"""The guard of bitwise results: the same tree compares clean, and a changed value does not."""

import ast

import numpy as np
import pytest
from loading import load_script

import warpchain

CASES = ["worn", "tables"]


@pytest.fixture
def golden():
    return load_script("golden")


def test_the_same_tree_is_the_same_and_a_change_is_told(golden, tmp_path, capsys):
    store = ["-o", str(tmp_path), "--only", *CASES]
    assert golden.main(store) == 0
    capsys.readouterr()
    assert golden.main([*store, "--compare"]) == 0
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines()[1:]] == ["same", "same"]
    with np.load(tmp_path / "tables.npz") as stored:
        arrays = dict(stored)
    arrays["run/0/position"][3, 2, 1] = np.nextafter(arrays["run/0/position"][3, 2, 1], 1.0)
    arrays["metrics/columns/old"] = arrays.pop("metrics/columns/tension_mean/value")
    np.savez(tmp_path / "tables.npz", **arrays)
    (tmp_path / "worn.npz").unlink()
    assert golden.main([*store, "--compare"]) == 1
    worn, tables = capsys.readouterr().out.splitlines()[1:]
    assert "missing: " in worn
    assert "run/0/position: 1 of " in tables and "metrics/columns/old is missing" in tables
    assert "added: metrics/columns/tension_mean/value" in tables


def test_what_is_added_is_no_difference(golden, tmp_path, capsys):
    store = ["-o", str(tmp_path), "--only", "tables"]
    assert golden.main(store) == 0
    with np.load(tmp_path / "tables.npz") as stored:
        arrays = dict(stored)
    for name in [name for name in arrays if "/tension_q50" in name]:
        del arrays[name]
    names, facts = ast.literal_eval(arrays["metrics/names"].tobytes().decode())
    for kept, status in (([name for name in names if name != "tension_q50"], 0), (names[::-1], 1)):
        arrays["metrics/names"] = np.frombuffer(repr((kept, facts)).encode(), dtype=np.uint8)
        np.savez(tmp_path / "tables.npz", **arrays)
        capsys.readouterr()
        assert golden.main([*store, "--compare"]) == status
        line = capsys.readouterr().out.splitlines()[-1]
        assert "added: metrics/columns/tension_q50/value" in line
        assert ("  same; " in line) == (status == 0)


def test_bits_count(golden):
    zero = np.zeros(3)
    assert golden.array_difference(zero, zero.copy()) == ""
    assert golden.array_difference(np.full(2, np.nan), np.full(2, np.nan)) == ""
    assert golden.array_difference(zero, -zero) == "3 of 3 values, largest difference 0"
    assert golden.array_difference(zero, zero.astype(np.float32)) == "float32[3] instead of float64[3]"
    assert golden.array_difference(np.zeros(0), np.zeros(0)) == ""
    with pytest.raises(TypeError, match="a/b: object is no array"):
        golden.flat_arrays({"a": {"b": object()}})


def test_two_archives_of_a_run_are_the_same_but_for_their_random_names(golden, tmp_path):
    """Names of sets are random and stand in metadata, whose digests are over them; a changed value still shows."""
    cases = load_script("golden_runs.cases")
    content, pair = cases.archive_content, cases.two_sprockets

    run = warpchain.simulate(pair(), device="cpu", duration=2e-4)
    found = []
    for k, seed in enumerate((1, 1, 2)):
        path = warpchain.write_archive(run, tmp_path / f"{k}.mcap", options=warpchain.ArchiveOptions(seed=seed))
        found.append(golden.flat_arrays(content(path)))
    assert (tmp_path / "0.mcap").read_bytes() != (tmp_path / "1.mcap").read_bytes()

    def differing(one, other):
        return [name for name in one if golden.array_difference(one[name], other[name])]

    assert found[0].keys() == found[1].keys() and differing(found[0], found[1]) == []
    assert len(differing(found[0], found[2])) == 1  # the seed, in the metadata at the start


def test_blocks_rub_where_drives_do(monkeypatch):
    """Kernels of `run_on_blocks` have the friction of contacts and joints that the drives have."""
    blocks, kinds = load_script("golden_runs.blocks"), []

    class Enough(Exception):
        pass

    def stop(kind, *_):
        kinds.append(kind)
        raise Enough

    monkeypatch.setattr(blocks, "block_kernel", stop)
    monkeypatch.setattr(blocks, "block_shapes", lambda drives: blocks.run_on_blocks(drives, True, "float32"))
    with pytest.raises(Enough):
        blocks.guide_blocks(None)
    assert kinds[0].friction == blocks.Friction(contacts=blocks.BY_SPEED, joints=blocks.BY_SPEED)
