"""`check --json` and `run --json` print one JSON object, in SI units, that the published schema describes."""

import json
import math
import subprocess
import sys

import chains
import pytest
from command import refused
from command import run as command
from drives import example

from warpchain import read_archive, simulate
from warpchain.assembly.summary import derived_quantities, report
from warpchain.cli.json_output import check_values, json_text, run_values
from warpchain.cli.output_schema import described_values, output_schema
from warpchain.model import single_chain
from warpchain.results.run import Record

jsonschema = pytest.importorskip("jsonschema")

RESULT = ("run", "status", "reasons", "losses", "metrics")


def validator():
    return jsonschema.Draft202012Validator(output_schema())


def faults(values):
    """What of an output the schema does not allow; each as its place and the reason's beginning."""
    return [(error.json_path, error.message[:400]) for error in validator().iter_errors(json.loads(json_text(values)))]


def printed(capsys, *words):
    """The exit status and the object that a command prints."""
    status, out, _ = command(capsys, *words)
    return status, json.loads("\n".join(out), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_the_schema_is_one(capsys):
    jsonschema.Draft202012Validator.check_schema(output_schema())
    assert printed(capsys, "schema", "output") == (0, output_schema())


def test_every_number_has_a_unit_and_every_key_a_description():
    """Ratios and counts have "1"; defaults are as drive files have them."""

    def numbers(schema):
        kinds = schema.get("type", ())
        if "number" in kinds or "integer" in kinds:
            yield schema
        for key in ("properties", "$defs"):
            for inner in schema.get(key, {}).values():
                yield from numbers(inner)
        for inner in (schema.get("items"), schema.get("additionalProperties"), *schema.get("anyOf", ())):
            yield from numbers(inner) if isinstance(inner, dict) else ()

    schema = output_schema()
    del schema["properties"]["metrics"]["additionalProperties"]  # the table of metrics has theirs
    found = list(numbers(schema))
    assert len(found) > 150
    assert not [value for value in found if not value.get("unit")]
    for of in (schema, *schema["anyOf"]):
        assert all(text for _, _, text in described_values(of))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", ["marine", "car", "conveyor", "engine", "motorcycle_drivetrain", "v6"])
def test_check_of_examples(capsys, name):
    status, values = printed(capsys, "check", name, "--json")
    assert (status, faults(values)) == (0, [])
    assert (values["format"], values["units"], values["drive"]) == (1, "SI", name)
    assert not [key for key in RESULT if key in values]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("drive", [chains.geared_stages, chains.cushed_stages, chains.motored_stages])
def test_check_of_several_chains(drive):
    assert not faults(check_values(drive(), "stages", {}))


def test_angles_are_radians_where_people_read_degrees():
    drive = example("marine")
    values = derived_quantities(drive)
    seats = [sprocket["seat_angle"] for sprocket in values["sprockets"]]
    assert seats == [single_chain(drive).seat_angle(s) for s in range(3)] and max(seats) < math.pi
    assert f"{math.degrees(seats[0]):.1f} deg" in report(values)


def test_what_the_schema_does_not_know_is_a_fault():
    values = check_values(example("marine"), "marine", {})
    assert not faults(values)
    assert faults(values | {"more": 1.0}) and faults({**values, "strands": [*values["strands"], {"name": "x"}]})
    assert faults({key: value for key, value in values.items() if key != "preload"})
    assert faults(values | {"status": "ok"})  # a run has all of its keys or none
    values["sprockets"][0]["wrap"] = None
    assert faults(values)


def test_numbers_that_are_not_finite_are_null():
    assert json.loads(json_text({"a": [float("nan"), {"b": float("inf")}], "c": 1.0})) == {
        "a": [None, {"b": None}],
        "c": 1.0,
    }


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_run_adds_metrics_status_and_losses(tmp_path, capsys):
    """The metrics are the archive's, the powers of the losses their energies over the window."""
    path = tmp_path / "a.mcap"
    words = ["run", "marine", "-o", path, "--duration", "0.02", "--step", "1e-5", "--json"]
    status, values = printed(capsys, *words)
    assert (status, faults(values)) == (0, [])
    (row,) = read_archive(path).metrics.to_pylist()
    assert values["status"] == row.pop("status") and "; ".join(values["reasons"]) == row.pop("reason")
    assert {"variant": row.pop("variant")} | row == {"variant": 0} | values["metrics"]
    assert values["run"]["archive"] == str(path) and values["run"]["step"] == values["step"] == 1e-5
    joints = values["losses"]["joints"]
    assert joints["energy"] == row["joints.friction"]
    assert joints["power"] == joints["energy"] / (row["window_end"] - row["window_start"])
    assert joints["input_share"] == joints["energy"] / row["input_work"]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_run_without_an_archive(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, values = printed(capsys, "run", "marine", "--duration", "0.002", "--json")
    assert (status, values["run"]["archive"], list(tmp_path.iterdir())) == (0, None, [])
    assert "the following arguments are required: -o/--output" in refused(capsys, "run", "marine")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_run_of_several_chains():
    drive = chains.geared_stages().with_values({"run.duration": 0.002})
    run = simulate(drive, record=Record("none"))
    (row,) = run.metrics.to_pylist()
    values = check_values(drive, "stages", {}) | run_values(drive, row, run.info, None)
    assert not faults(values) and set(values["chains"]) == {chain.name for chain in drive.chains}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_run_that_diverges_is_json_too(capsys):
    """The status is 1, as without --json; what it did not come to is null or left out."""
    mad = ["--set", "contact.sprocket.impact_speed_floor=1e-9", "--set", "sprockets.camshaft.load.viscous=1e12"]
    status, values = printed(capsys, "run", "marine", "--json", "--duration", "0.05", "--step", "2.7e-5", *mad)
    assert (status, faults(values)) == (1, [])
    assert values["status"] == "diverged" and values["reasons"] and values["losses"] == {}


def test_standard_output_has_nothing_else():
    """Not of native code either; progress and warnings are on the other one."""
    words = ["run", "marine", "--duration", "0.002", "--json", "--limit", "resolution=1e9"]
    done = subprocess.run([sys.executable, "-m", "warpchain", *words], capture_output=True, text=True, check=True)
    assert not faults(json.loads(done.stdout)) and json.loads(done.stdout)["status"] == "suspect"
    assert all(line.startswith("warpchain: ") for line in done.stderr.splitlines() if "compiling" not in line)


@pytest.mark.parametrize("words", [["run", "marine", "--step", "1"], ["check", "marine", "--set", "chain.links=2"]])
def test_a_mistake_is_a_line_and_no_json(capsys, words):
    assert refused(capsys, *words, "--json")
