"""Every column of a study's table is a factor, a metric, or bookkeeping."""

from study_helpers import STUDY, write_study

from warpchain import run_study
from warpchain.results.metric_columns import column_of
from warpchain.study.results import BOOKKEEPING, read_results
from warpchain.study.spec.factor import TAKEN

MORE = """
[adjust]
sprocket = "s1"
direction = [1.0, 0.0]
links = "even"
strain = 1e-4
[record]
variants = [0]
rate = 5e4
worst = { metric = "tension_max", count = 1 }
[fatigue]
exponent = 5
range = 100
"""


def test_every_column_of_a_table_is_of_one_kind(tmp_path):
    """A study that does all it can: adjusts, settles, records, records the worst, counts fatigue."""
    text = STUDY.replace('"links"', '"damping"').replace("chain.links", "chain.damping").replace("44, 45", "10.0, 20.0")
    outcome = run_study(write_study(tmp_path, MORE, points=2, text=text), tmp_path / "out", workers=1)
    results = read_results(outcome.table)
    names = results.table.column_names
    aside = {name for name in names if (column := column_of(name)) and column.aside}
    kinds = [set(results.factors), set(results.metrics), set(BOOKKEEPING) & set(names), aside]
    assert set().union(*kinds) == set(results.table.column_names)
    assert sum(map(len, kinds)) == results.table.num_columns  # none is of two kinds
    assert set(BOOKKEEPING) - kinds[2] == {"diverged", "diverged_time"}  # the status says it; none diverged


def test_no_factor_can_be_called_like_bookkeeping():
    assert set(BOOKKEEPING) <= TAKEN
