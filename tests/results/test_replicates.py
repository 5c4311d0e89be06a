"""Copies taken together: means and errors against numpy, judgement by the worst, and what `simulate` makes of them."""

import numpy as np
import pyarrow as pa
import pytest
from drives import example, two_sprockets

from warpchain import Record, read_archive, simulate
from warpchain.results.replicate_metrics import summarize_copies

TABLE = {
    "drive": [0, 0, 0, 1, 1, 2, 2],
    "replicate": [0, 1, 2, 0, 1, 0, 1],
    "status": ["ok", "ok", "ok", "ok", "suspect", "diverged", "diverged"],
    "reason": ["", "", "", "", "slipped", "at 1 s", "at 2 s"],
    "x": [1.0, 2.0, 6.0, 5.0, 100.0, None, None],
    "hits": [1, 2, 3, 4, 5, None, None],
    "x_se": [0.1] * 7,
    "steady": [True, False, True, True, True, None, None],
    "only": [None, 4.0, 6.0, 1.0, 2.0, None, None],
}


def test_means_and_errors_are_those_of_their_definition():
    first, second, third = summarize_copies(pa.table(TABLE), "drive").to_pylist()
    assert (first["x"], first["n"]) == (3.0, 3)
    assert first["x_se"] == pytest.approx(np.std([1.0, 2.0, 6.0], ddof=1) / np.sqrt(3.0), rel=1e-15)
    assert (first["hits"], first["steady"]) == (2.0, pytest.approx(2.0 / 3.0))
    # a metric that a copy lacks is the mean of the others
    assert (first["only"], first["only_se"]) == (5.0, pytest.approx(1.0))
    # the worst copy judges the drive, and what is suspect is in no mean
    assert (second["status"], second["reason"]) == ("suspect", "replicate 1 of 2: slipped")
    assert (second["x"], second["x_se"], second["n"]) == (5.0, None, 1)
    assert (third["status"], third["reason"]) == ("diverged", "at 1 s")  # as all copies did
    assert (third["x"], third["n"]) == (None, 0)


def test_a_drives_means_do_not_hang_on_the_others():
    random = np.random.default_rng(1)
    values = random.standard_normal(30) * 1e3
    table = pa.table({"drive": np.arange(30) // 10, "replicate": np.arange(30) % 10, "status": ["ok"] * 30,
                      "reason": [""] * 30, "y": values})  # fmt: skip
    whole = summarize_copies(table, "drive").to_pylist()
    alone = [summarize_copies(table.slice(10 * d, 10), "drive").to_pylist()[0] for d in range(3)]
    uneven = summarize_copies(table.slice(0, 17), "drive").to_pylist()
    assert whole == alone
    assert uneven[0] == whole[0]


@pytest.mark.parametrize("by", ["build", "phase", "perturbation"])
def test_copies_ride_along_and_are_the_runs_of_their_drives_bitwise(by):
    drive = two_sprockets(duration=0.02)
    slow = drive.with_values({"sprockets.driver.prescribed.speed": 8.0})
    run = simulate([drive, slow], record=Record([5]), replicates=3, replicate_by=by)
    assert run.replicates == 3
    assert run.metrics["drive"].to_pylist() == [0, 0, 0, 1, 1, 1]
    assert run.metrics["replicate"].to_pylist() == [0, 1, 2, 0, 1, 2]
    assert len(set(run.metrics["tension_max"].to_pylist())) == 6
    alone = simulate(run.drives[4], record=Record("none")).metrics.to_pylist()[0]
    mine = {name: value for name, value in run.metrics.to_pylist()[4].items() if name in alone or value is not None}
    assert {**mine, "variant": 0} == {**alone, "drive": 1, "replicate": 1}
    assert run[5].drive is run.drives[5]
    rows = run.summary.to_pylist()
    tension = np.array(run.metrics["tension_max"].to_pylist()).reshape(2, 3)
    assert [row["tension_max"] for row in rows] == pytest.approx(tension.mean(axis=1), rel=1e-15)
    errors = tension.std(axis=1, ddof=1) / np.sqrt(3.0)
    assert [row["tension_max_se"] for row in rows] == pytest.approx(errors, rel=1e-12)
    assert "tension_mean_se_se" not in run.summary.column_names


def test_a_perturbation_is_small_at_first_and_of_its_seed():
    """Displaced by 1e-9 pitches with standard deviation: the first frames differ by that, at most some six times."""
    drive = two_sprockets(duration=0.002)
    perturbed = drive.with_values({"run.perturbation": 7})
    run = simulate([drive, perturbed, perturbed], record=Record(rate=2e5))
    apart = np.abs(run[1].position[0] - run[0].position[0]) / drive.chain.pitch
    assert 1e-10 < apart.max() < 6e-9
    assert np.array_equal(run[1].position, run[2].position)


def test_runs_without_copies_have_a_summary_without_errors_and_archives_keep_them(tmp_path):
    drive = two_sprockets(duration=0.004)
    run = simulate(drive, record=Record("none"))
    assert "drive" not in run.metrics.column_names
    (row,) = run.summary.to_pylist()
    assert (row["n"], row["tension_max_se"]) == (1, None)
    assert row["tension_max"] == run.metrics["tension_max"][0].as_py()
    several = simulate(drive, archive=tmp_path / "a.mcap", replicates=2)
    assert read_archive(tmp_path / "a.mcap").summary.equals(several.summary)


def test_builds_lay_their_rollers_anywhere_in_the_tooth_gaps():
    """Off where they are assembled by an even draw from a disc of the clearance: at most that, on average two thirds.

    The mean distance of 80 rollers is off by sqrt(1/18 / 80) = 0.026 of the clearance; 4 of these are allowed.
    """
    drive = two_sprockets(duration=0.002).with_values({"run.settle": False})
    clearance = drive.contact.sprocket.clearance
    apart = drive.with_values({"run.seating": 7})
    run = simulate([drive, apart, apart.with_values({"run.seating": 8})], record=Record(rate=2e5))
    first, other = (np.hypot(*(run[k].position[0] - run[0].position[0]).T) for k in (1, 2))
    assert first.max() <= clearance * (1.0 + 1e-9)
    assert first.mean() == pytest.approx(2.0 / 3.0 * clearance, abs=0.11 * clearance)
    assert not np.isclose(first, other).any()


def test_builds_differ_by_what_turning_the_whole_machine_does():
    """A machine that is drawn turned, gravity and all, is the same one, and settles to within the same tolerance on
    another way. What that makes of the largest tension is within the scatter between builds (3 standard deviations,
    and half of one at least), and far above what copies 1e-9 pitches apart tell."""
    drive = example("industrial").with_values({"run.duration": 0.4})

    def turned(angle):
        across = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        centers = {f"sprockets.{s.name}.center": (across @ s.center).tolist() for s in drive.sprockets}
        return drive.with_values({**centers, "run.gravity": (across @ drive.run.gravity).tolist()})

    def tensions(*drives, **settings):
        return np.array(simulate(drives, record=Record("none"), **settings).metrics["tension_max"].to_pylist())

    whole = tensions(drive, turned(0.3), turned(1.0), turned(2.5))
    builds, copies = (tensions(drive, replicates=6, replicate_by=by) for by in ("build", "perturbation"))
    between = builds.std(ddof=1)
    assert np.abs(whole - builds.mean()).max() < 3.0 * between
    assert whole.std(ddof=1) > 0.03 * between and whole.std(ddof=1) > 3.0 * copies.std(ddof=1)
