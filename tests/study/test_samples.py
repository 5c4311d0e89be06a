"""Rows of a search crowd where it looked: what pages tell of the factors is of the rows of its design."""

import numpy as np
import pyarrow as pa
import pytest

from warpchain.study.analysis import main_effects
from warpchain.study.report import study_report_html
from warpchain.study.results import ROUND_COLUMN, read_results


def searched():
    """A design of 16 rows, in which a and b explain 0.8 and 0.2 of y = 2 a + b, and 200 rows that crowd about a = 0.5,
    where b explains nearly all."""
    rng = np.random.default_rng(0)
    grid = np.array([(a, b) for a in (0.0, 0.25, 0.75, 1.0) for b in (0.0, 0.25, 0.75, 1.0)])
    crowd = np.stack([0.5 + 0.005 * rng.standard_normal(200), rng.random(200)], axis=1)
    a, b = np.vstack([grid, crowd]).T
    factor = {"role": "factor"}
    fields = [
        pa.field("a", pa.float64(), metadata=factor),
        pa.field("b", pa.float64(), metadata=factor),
        pa.field("tension_max", pa.float64(), metadata={"role": "metric", "unit": "N"}),
        pa.field(ROUND_COLUMN, pa.int64()),
    ]
    columns = [a, b, 2.0 * a + b, np.repeat([0, 1], [len(grid), len(crowd)])]
    return read_results(pa.Table.from_arrays([pa.array(column) for column in columns], schema=pa.schema(fields)))


def test_effects_of_a_search_are_those_of_its_design():
    """Variances of 2 a and b are 4 to 1 over the design; over all rows b would explain most."""
    results = searched()
    of_design = {effect.factor: effect.explained for effect in main_effects(results.sampled_rows(), "tension_max")}
    assert of_design == {"a": pytest.approx(0.8), "b": pytest.approx(0.2)}
    of_all = {effect.factor: effect.explained for effect in main_effects(results, "tension_max")}
    assert of_all["b"] > of_all["a"]


def test_page_of_a_search_says_which_rows_its_effects_are_of():
    text = study_report_html(searched())
    assert "a matters most, with 75 % of the variance" in text
    assert "are of the 16 variants of the search&#x27;s design. The other 200 crowd" in text
