"""Tables of a study that were changed on the disk: told in one line, never taken for results."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from study_helpers import STUDY, write_study

from warpchain.errors import StudyError, WarpchainError
from warpchain.files import WholeFile
from warpchain.study.results import read_results
from warpchain.study.run import merge_study, run_study, study_status
from warpchain.study.run.recordings import recorded_trajectories
from warpchain.study.run.study_folder import open_folder
from warpchain.study.store import read_table, table_digest, write_table


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study file and its folder, whose shards are done."""
    home = tmp_path_factory.mktemp("study")
    source = write_study(home, "[record]\nevery = 5\n", points=3)
    run_study(source, home / "out")
    return source, home / "out"


@pytest.fixture
def folder(study, tmp_path):
    """A copy of the folder, to be damaged."""
    return shutil.copytree(study[1], tmp_path / "out")


def flips(path, count, seed):
    """The file with one bit flipped, again and again."""
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    for offset in rng.choice(len(data), min(count, len(data)), replace=False):
        damaged = bytearray(data)
        damaged[offset] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        yield
    path.write_bytes(data)


@pytest.mark.parametrize("name", ["shards/00001.parquet", "results.parquet", "design.parquet"])
def test_a_flipped_bit_of_a_table_is_told_or_means_nothing(folder, name):
    path, opened = folder / name, open_folder(folder)
    whole = read_table(path)
    read = {"results.parquet": lambda: read_table(path), "design.parquet": opened.read_design}
    told = 0
    for _ in flips(path, 300, 1):
        try:
            table = read.get(name, lambda: opened.read_shard(1))()
        except StudyError as error:
            assert "\n" not in str(error)
            told += 1
        else:
            assert table.equals(whole, check_metadata=True)
    assert told > 100  # much of the footer repeats what else is there, such as statistics
    assert read_table(path).equals(whole)


@pytest.mark.parametrize("name", ["plan.json", "study.toml", "drive.toml"])
def test_a_flipped_bit_of_what_a_study_stands_on_is_told(folder, name):
    opened = open_folder(folder)
    for _ in flips(folder / name, 100, 2):
        with pytest.raises(StudyError, match=name.replace(".", r"\.")) as caught:
            open_folder(folder)
        assert "\n" not in str(caught.value)
    assert open_folder(folder) == opened


def test_a_copied_shard_does_not_count_twice(folder):
    shutil.copy(folder / "shards" / "00000.parquet", folder / "shards" / "00001.parquet")
    with pytest.raises(StudyError, match=r"00001\.parquet: is another table, of shard '00000'.*; remove it"):
        merge_study(folder)
    with pytest.raises(StudyError, match="is another table"):
        study_status(folder)


def test_a_copied_archive_of_a_shard_is_told(folder):
    """Of the variants that were recorded, 0 and 5, each is in another shard: either archive alone would be read."""
    archives = sorted((folder / "shards").glob("*.mcap"))
    assert [path.name for path in archives] == ["00000.mcap", "00002.mcap"]
    results = read_results(folder / "results.parquet")
    own = {variant: one.position for variant, one in recorded_trajectories(results, folder).items()}
    assert sorted(own) == [0, 5] and study_status(folder).table == folder / "results.parquet"
    shutil.copy(*archives)
    for read in (lambda: merge_study(folder), lambda: recorded_trajectories(results, folder)):
        with pytest.raises(StudyError, match=r"00002\.mcap: is the archive of another shard"):
            read()
    archives[1].unlink()  # as from a cluster that keeps its recordings
    merge_study(folder)


@pytest.mark.parametrize("name", ["00000.mcap", "00001.parquet"])
def test_an_archive_or_a_shard_of_another_study_is_told(folder, tmp_path, name):
    shorter = STUDY.replace("duration = 0.0005", "duration = 0.0004")
    source = write_study(tmp_path / "other", "[record]\nevery = 5\n", points=3, text=shorter)
    run_study(source, tmp_path / "other" / "out")
    shutil.copy(tmp_path / "other" / "out" / "shards" / name, folder / "shards" / name)
    with pytest.raises(StudyError, match="or of another study"):
        merge_study(folder)


def test_a_damaged_shard_that_is_removed_is_simulated_anew(study, folder):
    source, whole = study
    path = folder / "shards" / "00002.parquet"
    path.write_bytes(path.read_bytes()[:-40])
    for go_on in (lambda: run_study(source, folder), lambda: merge_study(folder)):
        with pytest.raises(StudyError, match=r"00002\.parquet: not a table") as caught:
            go_on()
        assert "\n" not in str(caught.value)
    path.unlink()
    run_study(source, folder)
    for file in whole.rglob("*.parquet"):
        assert (folder / file.relative_to(whole)).read_bytes() == file.read_bytes()


def test_a_folder_of_an_earlier_version_goes_on(study, folder):
    """Its plan has no digests, its tables no notes and no checksums of pages."""
    source, whole = study
    plan = json.loads((folder / "plan.json").read_text())
    for path in folder.rglob("*.parquet"):
        parquet.write_table(read_table(path), path)
    del plan["digests"], plan["digest"]
    (folder / "plan.json").write_text(json.dumps(plan))
    (folder / "shards" / "00001.parquet").unlink()
    run_study(source, folder)
    assert read_table(folder / "results.parquet").equals(read_table(whole / "results.parquet"))


def test_a_table_that_a_user_changed_under_another_name_is_read(study, tmp_path):
    table = parquet.read_table(study[1] / "results.parquet")
    assert b"warpchain" in table.schema.metadata
    parquet.write_table(table.slice(0, 4), tmp_path / "some.parquet")
    assert read_results(tmp_path / "some.parquet").table.num_rows == 4


def test_a_damaged_copy_of_a_table_is_told_under_any_name(folder, tmp_path):
    table = parquet.read_table(folder / "results.parquet")
    other = table.rename_columns(["Variant", *table.column_names[1:]]).replace_schema_metadata(table.schema.metadata)
    parquet.write_table(other, tmp_path / "copy.parquet")
    with pytest.raises(StudyError, match=r"copy\.parquet: is damaged \(its digest is wrong\); copy it again"):
        read_table(tmp_path / "copy.parquet")
    for own in (table.slice(1), table.drop_columns(["variant"])):  # of another shape is somebody's own
        parquet.write_table(own, tmp_path / "own.parquet")
        assert read_table(tmp_path / "own.parquet").shape == own.shape


def test_a_digest_is_of_what_a_table_says_not_of_how_it_lies():
    one = pa.table({"a": pa.array([1.0, None, 3.0]), "b": pa.array(["x", None, "z"]), "c": [True, None, False]})
    other = pa.concat_tables([one.slice(0, 1), one.slice(1)])
    hidden = pa.table([pa.Array.from_buffers(pa.float64(), 3, [one["a"].chunk(0).buffers()[0], pa.py_buffer(
        np.array([1.0, 7.0, 3.0]))]), *one.columns[1:]], names=["a", "b", "c"])  # fmt: skip
    assert table_digest(one) == table_digest(other) == table_digest(hidden)
    different = [
        one.set_column(0, "a", pa.array([1.0, None, 4.0])),
        one.set_column(0, "a", pa.array([1.0, 0.0, 3.0])),
        one.set_column(1, "b", pa.array(["x", "", "z"])),
        one.rename_columns(["a", "b", "d"]),
        one.cast(pa.schema([("a", pa.float32()), ("b", pa.string()), ("c", pa.bool_())])),
        one.slice(0, 2),
    ]
    assert len({table_digest(table) for table in (one, *different)}) == 1 + len(different)


WRITING = """
import sys, time
from pathlib import Path
from warpchain.files import WholeFile
files = [WholeFile(Path(sys.argv[1]) / "00009.mcap", hidden=False), WholeFile(Path(sys.argv[1]) / "00009.parquet")]
print("writing", flush=True)
time.sleep(600)
"""


def test_finishing_sweeps_what_was_left_and_nothing_that_is_being_written(study, folder):
    left = [folder / "shards" / name for name in ("00000.mcap.123.partial", ".00000.parquet.1-2.partial")]
    left += [folder / "shards" / "00001.mcap.7-0123456789abcdef.partial", folder / ".results.parquet.lock"]
    for file in left:
        file.write_text("left")
    mine = WholeFile(folder / "shards" / "mine.parquet")
    with subprocess.Popen([sys.executable, "-c", WRITING, str(folder / "shards")], stdout=-1) as process:
        assert process.stdout.readline() == b"writing\n"
        merge_study(folder)
        assert not any(file.exists() for file in left)
        others = [file.name for file in (folder / "shards").iterdir() if "00009" in file.name]
        process.kill()
    assert mine.partial.exists()
    assert len(others) == 4  # two files and their locks
    mine.drop()
    merge_study(folder)
    assert not [file for file in (folder / "shards").iterdir() if "00009" in file.name]


def test_a_table_of_a_study_is_written_with_checksums_of_its_pages(tmp_path):
    """Damage in the values alone, which Parquet would otherwise read back as other values."""
    table = pa.table({"a": np.random.default_rng(0).random(10_000)})
    write_table(tmp_path / "a.parquet", table)
    data = bytearray((tmp_path / "a.parquet").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "a.parquet").write_bytes(data)
    with pytest.raises(WarpchainError, match=r"a\.parquet: "):
        read_table(tmp_path / "a.parquet", ["a"])
