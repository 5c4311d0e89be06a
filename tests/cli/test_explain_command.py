"""`warpchain explain`: names and lines of errors are explained by the registries that they come from."""

import pytest
from command import refused, run

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


def test_a_name_of_nothing(capsys):
    assert "'tenson_max' names no metric, key of a file or limit; did you mean tension_max?" in refused(
        capsys, "explain", "tenson_max"
    )
