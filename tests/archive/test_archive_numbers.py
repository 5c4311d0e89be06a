"""Archives that call variants by numbers of their own, as those of studies do."""

import numpy as np
import pytest
from archives import assert_same
from mcap.reader import make_reader
from study_helpers import tiny_drive

from warpchain import ArchiveOptions, Record, read_archive, simulate, write_archive
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.engineering_report import handed_in

NUMBERS = (40, 7, 123456)
DRIVES = [tiny_drive().with_values({"sprockets.s1.load.torque": torque}) for torque in (0.1, 0.2, 0.3)]
RECORD = Record((0, 2), rate=1e5)


@pytest.fixture
def path(tmp_path):
    """The first and the last of three variants, in an archive that was written while the run went on."""
    path = tmp_path / "numbered.mcap"
    options = ArchiveOptions(numbers=NUMBERS)
    run = simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD, archive=path, archive_options=options)
    assert list(run) == [40, 123456]
    return path


def test_topics_drives_metrics_and_trajectories_have_the_numbers(path):
    with path.open("rb") as file:
        reader = make_reader(file)
        named = {channel.topic for channel in reader.get_summary().channels.values()}
        attached = {attachment.name for attachment in reader.iter_attachments()}
    assert {topic.split("/")[2] for topic in named} == {"00040", "123456"}
    assert {"drives/00040.toml", "drives/00007.toml", "drives/123456.toml"} <= attached
    archive = read_archive(path)
    plain = simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD)
    assert list(archive) == [40, 123456] and tuple(archive.numbers) == NUMBERS
    assert archive.metrics["variant"].to_pylist() == list(NUMBERS)
    assert [archive.row_of(v) for v in NUMBERS] == [0, 1, 2] and list(plain.numbers) == [0, 1, 2]
    assert archive.drives == plain.drives == tuple(DRIVES)
    for number, v in ((40, 0), (123456, 2)):
        assert archive[number].drive == DRIVES[v]
        np.testing.assert_array_equal(archive[number].position, plain[v].position)
        assert archive.read(number, channels=["tension"]).tension.shape == plain[v].tension.shape
        assert handed_in(archive, number).metrics() == handed_in(plain, v).metrics()
    with pytest.raises(SimulationError, match=r"variant 7 was not recorded \(recorded: 40, 123456\)"):
        archive[7]


def test_they_are_kept_when_it_is_written_again_and_recovered(path, tmp_path):
    archive = read_archive(path)
    assert_same(read_archive(write_archive(archive, tmp_path / "again.mcap")), archive)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-300])
    recover_archive(cut, tmp_path / "whole.mcap")
    whole = read_archive(tmp_path / "whole.mcap")
    assert list(whole) == [40, 123456] and tuple(whole.numbers) == NUMBERS
    assert whole.metrics["variant"].to_pylist() == list(NUMBERS)
    np.testing.assert_array_equal(whole[123456].position, archive[123456].position)


@pytest.mark.parametrize(
    ("numbers", "line"),
    [
        ((1, 1, 2), "allowed are different whole numbers"),
        ((0, -1, 2), "allowed are different"),
        ((5, 6), "there are 2 for 3"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(tmp_path, numbers, line):
    with pytest.raises(ArchiveError, match=f"numbers: {line}"):
        options = ArchiveOptions(numbers=numbers)
        simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD, archive=tmp_path / "a.mcap", archive_options=options)
    assert not list(tmp_path.glob("*.mcap"))
