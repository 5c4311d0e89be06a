"""`warpchain study plan`: rows, infeasible share, cost and precision, held against what the study then comes to."""

import math
import time

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from pyarrow import parquet
from scipy import stats
from study_helpers import STUDY, write_study

from warpchain.errors import StudyError
from warpchain.study.forecast import Forecast, RunCost, forecast_lines, forecast_study
from warpchain.study.run import run_study

SEVERAL = STUDY.replace('kind = "factorial"', 'kind = "factorial"\nreplicates = 3')
TIGHT = '[[constraints]]\nrequire = "torque < 0.9"\n'


def test_rows_and_what_is_infeasible_are_those_of_the_study(tmp_path):
    text = SEVERAL.replace("levels = [44, 45]", "levels = [44, 45, 60]")  # 60 links are too many
    source = write_study(tmp_path, TIGHT, points=4, shard=7, text=text)
    plan = forecast_study(source, calibrate=False)
    assert (plan.rows, plan.copies, plan.run_count, plan.shards) == (12, 3, 36, 6)
    assert (plan.ruled_out, plan.built, plan.refused) == (3, 9, 3)
    assert plan.infeasible_interval == (0.5, 0.5) == (plan.infeasible_share, 0.5)  # all were built
    assert plan.reasons[0] == ("constraint torque < 0.9 is not met", 3)
    outcome = run_study(source, tmp_path / "out")
    assert outcome.counts["infeasible"] == plan.infeasible_share * plan.run_count
    # 18 runs of 50 steps and 44 or 45 links
    assert plan.cost.work == pytest.approx(18 * 50 * 44.5)
    assert not plan.cost.measured
    assert not (tmp_path / "plan").exists() and plan.precision == ()


def test_a_share_of_rows_that_were_looked_at_has_its_interval():
    """Clopper and Pearson: the ends are where as many or more, as many or fewer have a probability of 2.5 %."""
    cost = RunCost(1e6, 1e6, 0.0, 1.0, False)
    plan = Forecast(1000, 1, 100, 200, 10, (), cost, 1, 0)
    assert plan.infeasible_share == pytest.approx((100 + 0.05 * 900) / 1000)
    low, high = ((1000 * end - 100) / 900 for end in plan.infeasible_interval)
    assert stats.binom.sf(9, 200, low) == pytest.approx(0.025, abs=1e-9)
    assert stats.binom.cdf(10, 200, high) == pytest.approx(0.025, abs=1e-9)
    assert plan.relative_precision is None
    several = Forecast(20, 4, 0, 20, 0, (), cost, 1, 0)
    assert several.relative_precision == pytest.approx(stats.t.ppf(0.975, 60) / 2.0)


def test_the_cost_is_about_what_the_study_takes(tmp_path):
    source = write_study(tmp_path, points=8, shard=100, text=STUDY.replace("duration = 0.0005", "duration = 0.5"))
    begin = time.perf_counter()
    plan = forecast_study(source, workers=1)
    planned = time.perf_counter() - begin
    begin = time.perf_counter()
    run_study(source, tmp_path / "out", workers=1)
    took = time.perf_counter() - begin
    assert plan.cost.measured
    # 50,000 steps a run; other processes share the machine, and its clock goes up and down
    assert took / 4.0 < plan.cost.seconds < 4.0 * took
    assert planned < took


def table_of(path, deviation=2.0, window=0.2):
    """An earlier study of 25 rows of 5 runs."""
    random = np.random.default_rng(1)
    runs = np.arange(25.0)[:, None] + deviation * random.standard_normal((25, 5))
    held = {"tension_mean": runs, "tension_max": 10.0 * runs}
    columns = {"x": np.arange(25.0), "n": [5] * 25, "window_start": [window] * 25, "window_end": [2 * window] * 25}
    for name, values in held.items():
        columns |= {name: values.mean(axis=1), f"{name}_se": values.std(axis=1, ddof=1) / math.sqrt(5.0)}
    roles = {"x": "factor", **dict.fromkeys(held, "metric"), **{f"{name}_se": "error" for name in held}}
    fields = [pa.field(name, pa.array(values).type, metadata={"role": roles.get(name, "")})
              for name, values in columns.items()]  # fmt: skip
    table = pa.Table.from_arrays([pa.array(values) for values in columns.values()], schema=pa.schema(fields))
    parquet.write_table(table, path)
    return path


def test_an_earlier_study_tells_the_precision(tmp_path, capsys):
    source = write_study(tmp_path, points=2, text=SEVERAL)
    like = table_of(tmp_path / "results.parquet")
    plan = forecast_study(source, like=like, calibrate=False)
    assert {error.metric for error in plan.precision} == {"tension_mean", "tension_max"}
    error = next(error for error in plan.precision if error.metric == "tension_mean")
    assert error.low < 2.0 < error.high
    lines = forecast_lines(plan, {"tension_mean": error.interval(12), "tension_max": 10.0 * error.interval(12)})
    assert lines[-2].endswith(": 12 replicates, or 3 and a window of 0.8 s (the earlier one had 0.2 s)")
    assert lines[-1].endswith(": 12 replicates")  # a largest value grows with the window
    words = ("study", "plan", source, "--stored", "--like", tmp_path)
    status, out, err = run(capsys, *words, "--precision", f"tension_mean={error.interval(12)}")
    assert (status, err, out[-1]) == (0, [], lines[-2])
    assert out[0] == "rows: 4, each run 3 times: 12 runs in 6 shards"
    assert out[1] == "infeasible: 0 %: 0 rows by constraints, and 0 of 4 rows that were built"


def test_refusals(tmp_path, capsys):
    source = write_study(tmp_path, points=2)
    assert "needs --like" in refused(capsys, "study", "plan", source, "--stored", "--precision", "tension_mean=1")
    for word in ("tension_mean", "tension_mean=0", "=3"):
        assert "must be METRIC=VALUE" in refused(capsys, "study", "plan", source, "--precision", word)
    run_study(source, tmp_path / "out")
    with pytest.raises(StudyError, match="no row was run several times"):
        forecast_study(source, like=tmp_path / "out", calibrate=False)
