"""`warpchain study grow`: a study that is doubled until its main effects are known, and what it refuses."""

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from pyarrow import parquet
from study_helpers import SAMPLED, write_study

from warpchain.errors import StudyError
from warpchain.study.analysis import main_effects
from warpchain.study.grow_until import Until, largest_effect_error
from warpchain.study.results import read_results
from warpchain.study.run import run_study


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("se(mean effects) < 1 %", 'must be such as "se(main effects) < 1 %"'),
        ("se(main effects) < -1 %", "must be such as"),
        ("se(main effects) < 1e %", "must be such as"),
        ("se(main effects) < 5", "a value without % needs a metric"),
    ],
)
def test_conditions_that_are_none_are_refused(text, told):
    with pytest.raises(StudyError) as caught:
        Until.of(text)
    assert told in str(caught.value) and "\n" not in str(caught.value)


def test_condition_is_read():
    assert Until.of("se(main effects)<1%") == Until(None, 0.01, True)
    assert Until.of("se( main effects of s1.force_max ) < 2.5e3") == Until("s1.force_max", 2500.0, False)


def test_error_is_that_of_the_closed_form():
    """Means of n / 2 values of deviation s: s / sqrt(n / 2); s of 2000 is known to 1.6 %, taken as 10 %."""
    rng = np.random.default_rng(0)
    y = 10.0 + rng.standard_normal(4000)
    table = pa.table({"a": np.arange(4000) % 2.0, "y": y, "status": ["ok"] * 4000})
    error, metric, factor = largest_effect_error(read_results(table, ["a"], ["y"]), ("y",), relative=True)
    assert (metric, factor) == ("y", "a") and error == pytest.approx(0.1 / np.sqrt(2000), rel=0.1)
    absolute, *_ = largest_effect_error(read_results(table, ["a"], ["y"]), ("y",), relative=False)
    assert absolute == pytest.approx(error * y.mean())
    with pytest.raises(StudyError, match="no variant is ok"):
        largest_effect_error(
            read_results(table.set_column(2, "status", pa.array(["diverged"] * 4000)), ["a"]), ("y",), True
        )


def test_study_grows_until_its_effects_are_known(tmp_path, capsys):
    source, out = write_study(tmp_path, text=SAMPLED, shard=64), tmp_path / "out"
    run_study(source, out)
    condition = "se(main effects of tension_max) < 9 %"
    status, lines, _ = run(capsys, "study", "grow", out, "--until", condition, "--most", "256")
    grown = read_results(out / "results.parquet")
    rows = grown.table.num_rows
    assert status == 0 and lines[0].startswith("4 variants: largest standard error of main effects unknown")
    assert rows > 8 and f"design.count is {rows} now" in lines[-1]
    mean = abs(float(grown.values("tension_max").mean()))
    assert max(float(effect.errors.max()) for effect in main_effects(grown, "tension_max")) < 0.09 * mean
    half = read_results(
        grown.table.slice(0, rows // 2)
    )  # points of a sequence: what was there before the last doubling
    assert max(float(effect.errors.max()) for effect in main_effects(half, "tension_max")) > 0.08 * mean
    # the same table as a study of that count has
    source.write_text(source.read_text().replace("count = 4", f"count = {rows}"))
    again = run_study(source, tmp_path / "again").table
    drop = [name for name in grown.table.column_names if name.startswith("archive")]
    assert parquet.read_table(again).drop_columns(drop).equals(grown.table.drop_columns(drop))
    status, lines, _ = run(capsys, "study", "grow", out, "--until", condition)
    assert status == 0 and len(lines) == 2  # known already: nothing is run


def test_budget_ends_it_and_other_designs_are_refused(tmp_path, capsys):
    source, out = write_study(tmp_path, text=SAMPLED, shard=64), tmp_path / "out"
    run_study(source, out)
    status, lines, _ = run(capsys, "study", "grow", out, "--until", "se(main effects) < 1e-9 %", "--most", "8")
    assert status == 1 and "not reached" in lines[-2] and parquet.read_table(out / "results.parquet").num_rows == 8
    assert "'tension_mix': not in the table" in refused(
        capsys, "study", "grow", out, "--until", "se(main effects of tension_mix) < 1 %"
    )
    fixed = write_study(tmp_path / "b", shard=64)
    run_study(fixed, tmp_path / "b/out")
    assert 'design.kind = "factorial" does not grow' in refused(
        capsys, "study", "grow", tmp_path / "b/out", "--until", "se(main effects) < 1 %"
    )
