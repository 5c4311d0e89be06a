"""Searches: known fronts and minima, noise, limits, restarts, the cache, what is recommended."""

import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from drives import of_long
from stopping import interruptions
from study_helpers import LIMITS, SAMPLED, write_study
from waiting import wait_for

import warpchain
from warpchain.cli import main
from warpchain.drive import load_drive
from warpchain.drive.drive_text import DIGITS
from warpchain.errors import StudyError
from warpchain.study.analysis.pareto import goals_of_study
from warpchain.study.design.factor_values import DesignCube
from warpchain.study.optimize import Optimizer, bayesian_search, open_study, optimize, recommend
from warpchain.study.optimize.design_search import make_search_folder
from warpchain.study.results import read_results
from warpchain.study.spec import Study, dumps_study, loads_study
from warpchain.study.store import read_table

pytest.importorskip("sklearn")
pytest.importorskip("pymoo")


def toy(engine="bayes", start=16, batch=8, names="ab", reach=2.0, seed=0, **more):
    """A study of functions of some factors within a reach of 0, of whose values f1 and f2 are to be least."""
    factors = [{"name": name, "path": f"x.{name}", "range": [-reach, reach]} for name in names]
    told = {"study": {"drive": "none"}, "design": {"kind": "sobol", "count": start}, "factors": factors}
    told |= {"objectives": [{"metric": "f1"}, {"metric": "f2"}]}
    return Study.model_validate(told | {"optimize": {"engine": engine, "batch": batch, "seed": seed}} | more)


def searched(study, functions, count, noise=0.0):
    """Runs a search on functions by metric; returns the study's results as told."""
    optimizer, rng, tables = Optimizer(study), np.random.default_rng(0), []
    while optimizer.observed_count < count:
        rows = optimizer.ask()
        table = pa.Table.from_pylist(rows)
        for name, function in functions.items():
            values = np.array([function(**row) for row in rows])
            table = table.append_column(name, pa.array(values + noise * rng.standard_normal(len(rows))))
        optimizer.observe(table)
        tables.append(table)
    return read_results(pa.concat_tables(tables), [factor.name for factor in study.factors])


TWO = {"f1": lambda a, b: (a - 1.0) ** 2 + b * b, "f2": lambda a, b: (a + 1.0) ** 2 + b * b}
"""The front: b = 0 and a from -1 to 1, where sqrt(f1) + sqrt(f2) = 2; elsewhere that sum is larger."""


def off_the_front(results):
    """sqrt(f1) + sqrt(f2) - 2 of the true values, and a, of each row."""
    a, b = results.values("a"), results.values("b")
    return np.sqrt(TWO["f1"](a, b)) + np.sqrt(TWO["f2"](a, b)) - 2.0, a


@pytest.mark.parametrize(
    ("engine", "count", "noise"), [("bayes", 32, 0.0), ("bayes", 32, 0.1), ("population", 160, 0.0)]
)
def test_rows_come_to_lie_along_a_known_front(engine, count, noise):
    results = searched(toy(engine), TWO, count, noise)
    off, a = off_the_front(results)
    near = off < 0.1  # a band of |b| < 0.3 or so at a = 0: a part of 0.1 of the square
    start = int(near[:16].sum())
    assert near[16:].mean() > max(0.4, 2.0 * start / 16)  # chance would go on with the part of the first rows
    covered = np.unique(np.floor(4.0 * np.clip(a[near], -0.999, 0.999)))
    assert len(covered) >= 5  # of the 8 parts of the front


def test_a_noisy_ishigami_function_gives_its_minimum():
    """sin a + 7 sin^2 b + 0.1 c^4 sin a is least at a = -pi/2, b = 0, c = +-pi: -1 - 0.1 pi^4 = -10.74."""

    def ishigami(a, b, c):
        return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)

    study = toy(batch=6, names="abc", reach=np.pi, objectives=[{"metric": "f1"}])
    results = searched(study, {"f1": ishigami}, 56, noise=0.3)
    (best, *_) = recommend(results, goals_of_study(study))
    row = {name: float(results.values(name)[best.row]) for name in "abc"}
    # the lowest of 60 random rows is about -7; the function's own deviation is 3.7
    assert ishigami(**row) < -9.0
    mean, deviation = best.believed["f1"]
    assert abs(mean - ishigami(**row)) < 4.0 * deviation + 0.3


def test_limits_are_kept_and_known_with_a_probability():
    """Least (a - 1)^2 + b^2 with f2 = (a + 1)^2 + b^2 at most 1: a = 0, b = 0, of value 1."""
    study = toy(batch=6, objectives=[{"metric": "f1"}], limits=[{"metric": "f2", "max": 1.0}])
    results = searched(study, TWO, 36)
    (best, *_) = recommend(results, goals_of_study(study))
    # without noise the row itself is known: what is left is how near to the corner of the limit rows came
    assert best.measured["f2"] <= 1.0 and best.measured["f1"] < 1.15
    assert best.chance >= 0.95 and "probability" in " ".join(best.reasons)


def test_same_study_same_rows_and_told_rows_decide():
    for engine in ("bayes", "population"):
        first, second = (searched(toy(engine, 8, 4), TWO, 16) for _ in range(2))
        assert first.table.equals(second.table)
    other = searched(toy("bayes", 8, 4, seed=1), TWO, 16)
    assert not other.table.equals(searched(toy("bayes", 8, 4), TWO, 16).table)


def test_places_in_the_cube_are_those_of_the_values():
    factors = [
        {"name": "n", "path": "x.n", "range": [17, 25], "integer": True},
        {"name": "k", "path": "x.k", "range": [1e3, 1e7], "distribution": "log-uniform"},
        {"name": "law", "path": "x.law", "choice": ["flores", "hunt", "kv"]},
        {"name": "z", "path": "x.z", "distribution": "normal", "mean": 3.0, "std": 0.5},
    ]
    cube = DesignCube(toy(factors=factors))
    points = np.random.default_rng(0).random((40, 4))
    rows = cube.rows_of_points(points)
    again = cube.points_of_rows(rows)
    assert np.abs(again - points)[:, [1, 3]].max() < 1e-9  # bisected to 2^-60; a normal's tail is flat to 1e-12 there
    assert cube.rows_of_points(again)[0]["n"] == rows[0]["n"]
    assert (np.abs(again - points)[:, 0] <= 0.5 / 9 + 1e-9).all()  # the middle of one of nine parts
    assert np.array_equal(cube.snapped_points(points)[:, [0, 2]], again[:, [0, 2]])
    assert cube.model_coordinates(again).shape == (40, 6)
    for before, after in zip(rows, cube.rows_of_points(again), strict=True):
        assert before["law"] == after["law"] and before["n"] == after["n"]


GOALS = """
objectives = [{{ metric = "tension_max" }}, {{ metric = "torque", sense = "max" }}]
limits = [{{ energy_residual = inf, energy_change = inf }}, {{ metric = "tension_std", max = 900 }}]
optimize = {{ engine = "ENGINE", count = 10, batch = 3 }}
record = {{ rate = 1e5 }}
"""
WANTED = GOALS + SAMPLED.replace("range = [0.0, 20.0]", 'range = [0.0, 20.0]\nunit = "N m"').replace(LIMITS, "")
WANTED = WANTED.replace("duration = 0.0005", "duration = 0.0003")


def written(folder, engine="bayes"):
    return write_study(folder, text=WANTED.replace("ENGINE", engine))


def contents(folder):
    """The outcome of a search: the tables' rows and the drive files."""
    found = {p.relative_to(folder): read_table(p) for p in sorted(folder.rglob("*.parquet"))}
    return found | {p.relative_to(folder): p.read_text() for p in sorted(folder.rglob("design-*.toml"))}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Searches that nothing stopped, by engine."""
    place = tmp_path_factory.mktemp("whole")
    return {
        engine: (place / engine / "out", optimize(written(place / engine, engine), place / engine / "out"))
        for engine in ("bayes", "population")
    }


def test_a_search_sweeps_away_what_a_killed_one_left(tmp_path):
    left = tmp_path / "out" / ".results.parquet.999999-0123456789abcdef.partial"
    left.parent.mkdir()
    left.touch()
    source = written(tmp_path)
    make_search_folder(tmp_path / "out", open_study(source))
    assert not left.exists()


@pytest.mark.parametrize("engine", ["bayes", "population"])
@pytest.mark.parametrize("after", [3, *of_long(12)])
def test_interrupted_and_gone_on_with_it_ends_the_same(tmp_path, whole, engine, after):
    class Stop(Exception):
        pass

    calls = 0

    def stop(phase, done, total):
        nonlocal calls
        calls += 1
        if calls == after:
            raise Stop

    path, out = written(tmp_path, engine), tmp_path / "out"
    with pytest.raises(Stop):
        optimize(path, out, progress=stop)
    assert not (out / "recommended").exists()
    optimize(path, out)
    assert contents(out) == contents(whole[engine][0])


@pytest.mark.long
def test_ctrl_c_at_any_moment_ends_a_search_as_asked(tmp_path, whole, capfd):
    path, ended = written(tmp_path), set()
    for out, status, told in interruptions(["optimize", str(path), "--quiet", "-o"], tmp_path, 6, capfd):
        ended.add(status)
        if status == 1:
            assert "interrupted" in told.err and told.err.count("\n") == 1, (out, told)
        else:  # all was done but what needs no time
            assert status == 0 and (out / "recommended").exists(), (out, told)
        optimize(path, out)
        assert contents(out) == contents(whole["bayes"][0])
    assert 1 in ended


def test_ctrl_c_waits_for_the_fit_under_way(tmp_path, monkeypatch):
    fitted, fit = [], bayesian_search.fit_gaussian_process

    def interrupted(*arguments, **named):
        signal.raise_signal(signal.SIGINT)
        fitted.append(fit(*arguments, **named))
        return fitted[-1]

    monkeypatch.setattr(bayesian_search, "fit_gaussian_process", interrupted)
    assert main(["optimize", str(written(tmp_path)), "-o", str(tmp_path / "out"), "--quiet"]) == 1
    assert len(fitted) == 1 and (tmp_path / "out/rounds/0000/rows.parquet").exists()


@pytest.mark.long
def test_a_killed_process_is_gone_on_with(tmp_path, whole):
    path, out = written(tmp_path), tmp_path / "out"
    command = [sys.executable, "-m", "warpchain", "optimize", str(path), "-o", str(out), "--quiet"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    wait_for(lambda: (out / "rounds/0001/plan.json").exists() or process.poll() is not None, 120.0)
    process.kill()
    assert process.wait() != 0
    optimize(path, out)
    assert contents(out) == contents(whole["bayes"][0])


@pytest.mark.long
def test_more_rows_are_a_longer_search(tmp_path, whole):
    path, out = written(tmp_path), tmp_path / "out"
    longer = path.read_text()
    path.write_text(longer.replace("count = 10", "count = 4"))
    assert optimize(path, out).results.table.num_rows == 4
    path.write_text(longer)
    optimize(path, out)
    assert contents(whole["bayes"][0]).items() <= contents(out).items()


def test_found_designs_can_be_played_and_are_drives(whole):
    folder, found = whole["bayes"]
    assert 1 <= len(found.recommended) <= 4
    for one, file, place in zip(found.recommended, found.drives, found.archives, strict=True):
        drive = load_drive(file)
        row = found.results.table.slice(one.row, 1).to_pylist()[0]
        written = drive.get_value("sprockets.s1.load.torque")
        assert written == pytest.approx(row["torque"], rel=10.0 ** (1 - DIGITS))  # as drive files have it
        archive, number = place
        assert number == one.variant
        kept = warpchain.read_archive(archive)
        again = kept.metrics["tension_max"][kept.row_of(number)].as_py()  # the same drive, the same run
        assert again == row["tension_max"]
        assert one.measured["tension_max"] == row["tension_max"]
        mean, deviation = one.believed["tension_max"]
        assert np.isfinite(mean) and deviation >= 0.0
    text = dumps_study(loads_study((folder / "study.toml").read_text()))
    assert "[[limits]]\nmetric" in text


def test_a_drive_is_run_once(tmp_path):
    study = open_study(written(tmp_path))
    rows = [{"torque": 1.0, "links": 44}, {"torque": 2.0, "links": 44}, {"torque": 1.0, "links": 44}]
    seen = []
    first = study.evaluate(rows, progress=lambda phase, done, total: seen.append(total))
    assert max(seen) == 2.0  # of three rows two are different
    assert first["torque"].to_pylist() == [1.0, 2.0, 1.0]
    assert first["variant"].to_pylist() == [0, 1, 2]
    assert first["tension_max"][0] == first["tension_max"][2] != first["tension_max"][1]
    seen.clear()
    again = study.evaluate(rows[1:], progress=lambda phase, done, total: seen.append(total))
    assert not seen
    assert again["tension_max"].to_pylist() == first["tension_max"].to_pylist()[1:]
    alone = warpchain.simulate(study.drives(rows[:2]), record=warpchain.Record("none"), duration=0.0003, step=1e-5)
    assert alone.metrics["tension_max"].to_pylist() == first["tension_max"].to_pylist()[:2]
    with pytest.raises(StudyError, match="row 0: factor 'links' has no value"):
        study.drives([{"torque": 1.0}])


def test_surrogate_of_a_folder_predicts(whole, tmp_path):
    study = open_study(whole["bayes"][0].parent / "study.toml", whole["bayes"][0])
    mean, deviation = study.surrogate("tension_max").predict([{"torque": 10.0, "links": 44}])
    assert np.isfinite(mean[0]) and deviation[0] > 0.0
    rows = study.ask()
    assert [row["links"] in (44, 45) for row in rows] == [True] * 4
    study.observe(study.evaluate(rows))
    assert len(study.ask(2)) == 2


def test_mistakes_are_said_in_one_line_each(tmp_path, capsys):
    path = written(tmp_path)
    good = path.read_text()
    for old, new, told in (
        (
            '"tension_max"',
            '"tension_mux"',
            'objective 1: metric = "tension_mux": no such metric; did you mean tension_max?',
        ),
        ("max = 900", "min = 5.0, max = 3.0", 'limit on "tension_std": max = 3.0: must be above min, which is 5'),
        ('sense = "max"', 'sense = "most"', 'must be "min" or "max"'),
        ('metric = "tension_max"', 'metric = "s1.transmission_error_rms"', "it needs record.every = 1"),
        ('"bayes"', '"luck"', 'must be "bayes" or "population"'),
    ):
        path.write_text(good.replace(old, new))
        assert told in refused(capsys, "optimize", path, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_of_another_search_is_refused(tmp_path, whole, capsys):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("20.0]", "21.0]"))
    assert "another study, which differs in factors" in refused(capsys, "optimize", path, "-o", whole["bayes"][0])


def test_the_command_tells_what_to_build_and_how_to_play_it(whole, capsys):
    folder, found = whole["population"]
    status, lines, _ = run(capsys, "optimize", folder.parent / "study.toml", "-o", folder)
    out = "\n".join(lines)
    assert status == 0 and "10 variants in 3 rounds" in out
    assert f"play it: warpchain view {found.archives[0][0]} --variant {found.recommended[0].variant}" in out
    assert "±" in out and "torque = " in out
    assert Path(found.drives[0]).is_file()
    looks = [line for line in run(capsys, "check", found.drives[0])[1] if line.startswith("LOOK AT")]
    assert looks and all(f"  {line}" in lines for line in looks)


def test_any_variant_can_be_played(whole, tmp_path, capsys):
    folder, found = whole["bayes"]
    saved, archive = tmp_path / "v.rrd", folder / "played" / "variant-000003.mcap"
    words = ["--save", saved, "--quiet"]
    status, out, _ = run(capsys, "study", "play", folder, "3", "--print")
    assert status == 0 and not archive.exists() and out[1].startswith(f"warpchain run {archive.with_suffix('.toml')}")
    status, _, _ = run(capsys, *shlex.split(out[1])[1:], "--quiet")  # the command itself runs it again
    again = warpchain.read_archive(archive).metrics
    row = found.results.table.slice(3, 1).to_pylist()[0]
    held = [name for name in again.column_names if isinstance(row.get(name), float)]
    assert len(held) > 20 and all(again[name][0].as_py() == row[name] for name in held if name != "wall_time")
    archive.unlink()
    status, out, _ = run(capsys, "study", "play", folder, "3", *words)
    assert status == 0 and str(archive) in "\n".join(out) and saved.stat().st_size > 1000
    played = warpchain.read_archive(archive)
    assert played.metrics["tension_max"][0].as_py() == row["tension_max"] and list(played) == [3]
    when = archive.stat().st_mtime_ns
    assert run(capsys, "study", "play", folder, "3", *words)[0] == 0
    assert archive.stat().st_mtime_ns == when  # not run again
    assert "variant 99: not in" in refused(capsys, "study", "play", folder, "99", *words)
    status, out, _ = run(capsys, "study", "play", folder, "3", "--print")
    assert status == 0 and out[1] == f"warpchain view {archive} --variant 3"
    shutil.rmtree(archive.parent)


def test_a_search_has_a_report(whole, tmp_path):
    folder, found = whole["bayes"]
    assert main(["study", "report", str(folder), "-o", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text()
    assert f"A: variant {found.recommended[0].variant}" in page
    assert f"warpchain study play {folder} {found.recommended[0].variant}" in page
    assert "Limits: tension_std at most 900 N" in page
    assert "<li>LOOK AT " in page  # as `check` of its drive file says


def test_python_of_the_documents_runs(tmp_path, monkeypatch):
    text = (Path(__file__).resolve().parents[2] / "docs" / "optimization.md").read_text()
    written(tmp_path)
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    held = {}
    exec(compile(code, "optimization.md", "exec"), held)
    assert len(held["further"]) == 4 == len(held["mean"]) and len(held["found"].recommended) >= 1


@pytest.mark.long
def test_replicates_are_rows_with_their_standard_errors(tmp_path):
    path = written(tmp_path)
    more = path.read_text().replace("count = 4\n", "count = 4\nreplicates = 3\n")
    path.write_text(more.replace("count = 10", "count = 6"))
    found = optimize(path, tmp_path / "out")
    table = found.results.table
    assert table.num_rows == 7 and set(table["n"].to_pylist()) == {3}
    errors = np.array(table["tension_max_se"].to_pylist())
    assert (errors > 0.0).all()  # copies begin at other phases
    single = open_study(written(tmp_path / "single")).evaluate(table.select(["torque", "links"]).to_pylist()[:1])
    # the mean of three is not the first of them, which is as without replicates
    assert single["tension_max"][0].as_py() != table["tension_max"][0].as_py()
    one = found.recommended[0]
    assert np.isfinite(one.believed["tension_max"][1])
    assert main(["study", "report", str(tmp_path / "out"), "-o", str(tmp_path / "r.html")]) == 0
    assert "scatter between equal runs" in (tmp_path / "r.html").read_text()
