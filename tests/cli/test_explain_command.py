"""`warpchain explain`: names and lines of errors are explained by the registries that they come from."""

import re
from pathlib import Path

import pytest
from command import refused, run

from warpchain import assembly
from warpchain.cli.explain_command import FINDINGS, _table_schemas
from warpchain.results.judgement import LIMIT_RULES
from warpchain.results.metric_columns import COLUMN_BY_NAME


@pytest.mark.parametrize("name", ["tension_max", "efficiency", "joints.friction", "status"])
def test_metrics_by_name_and_by_part(capsys, name):
    column = COLUMN_BY_NAME[name]
    line = f"[{column.unit}]: {column.title}"
    assert f"metric {name} {line}" in run(capsys, "explain", name)[1]
    assert f"metric left.{name} {line}" in run(capsys, "explain", f"left.{name}")[1]


def test_keys_of_each_kind_of_table(capsys):
    _, out, _ = run(capsys, "explain", "links")
    assert out[0].startswith("key links of Chain, NamedChain: number of links")
    assert any(line.startswith("key links of Adjust: ") for line in out)  # of study files


def test_the_line_of_an_error_names_its_key(capsys):
    line = refused(capsys, "check", "marine", "--set", "chain.links=2")
    status, out, _ = run(capsys, "explain", line)
    assert status == 0 and out[0].startswith("key links of Chain, NamedChain: ")


@pytest.mark.parametrize("rule", LIMIT_RULES, ids=lambda rule: rule.key)
def test_limits_by_name_and_by_reason(capsys, rule):
    assert f"limit {rule.key}: {rule.advice}" in run(capsys, "explain", rule.key)[1]
    reason = rule.reason_text("left", 3.0, 1.0)
    assert f"limit {rule.key}: {rule.advice}" in run(capsys, "explain", f"status: suspect: {reason}")[1]


@pytest.mark.parametrize("name", ["adjusted_travel", "left.adjusted_links"])
def test_columns_of_adjustments(capsys, name):
    (line,) = run(capsys, "explain", name)[1]
    assert line.startswith(f"column {name}: ") and "[adjust]" in line


def test_lines_of_check_by_words_that_they_have(capsys):
    """Each of the words stands in the texts that `check` prints, whatever lines of code these are split over."""
    sources = "".join(path.read_text() for path in Path(assembly.__file__).parent.glob("*.py"))
    text = re.sub(r'"\s*f?"', "", sources)
    assert [words for words in FINDINGS if words not in text] == []
    (line,) = [line for line in run(capsys, "check", "marine")[1] if line.startswith("LOOK AT")]
    status, out, _ = run(capsys, "explain", line)
    assert status == 0 and out[0] == f"finding 'LOOK AT': {FINDINGS['LOOK AT']}"
    assert f"finding 'teeth in mesh': {FINDINGS['teeth in mesh']}" in out


def test_schemas_are_built_once(capsys):
    _table_schemas.cache_clear()
    run(capsys, "explain", "chain.links sprockets.teeth")
    assert _table_schemas.cache_info().misses == 1


def test_a_name_of_nothing(capsys):
    assert "'tenson_max' names no metric, key of a file, limit or finding; did you mean tension_max?" in refused(
        capsys, "explain", "tenson_max"
    )
