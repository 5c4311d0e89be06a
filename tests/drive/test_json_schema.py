"""The JSON schemas of drive and study files take what is allowed, and mark what is not, for editors."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from command import refused
from command import run as command
from drives import example
from jsonschema import Draft202012Validator

from warpchain.drive import Drive, dumps_drive
from warpchain.drive.examples import drive_path, example_names
from warpchain.drive.json_schema import file_schema
from warpchain.study.spec import study_schema

ROOT = Path(__file__).resolve().parents[2] / "warpchain"
DRIVE, STUDY = Draft202012Validator(file_schema(Drive, "drive")), Draft202012Validator(study_schema())


def wrong(validator, values):
    """Paths of what a schema refuses, and why."""
    return ["{}: {}".format(".".join(map(str, e.absolute_path)), e.message) for e in validator.iter_errors(values)]


def test_schemas_are_schemas():
    for validator in (DRIVE, STUDY):
        Draft202012Validator.check_schema(validator.schema)


@pytest.mark.parametrize("name", example_names())
def test_examples_are_taken_as_written_and_as_saved(name):
    text = drive_path(name).read_text()
    assert wrong(DRIVE, tomllib.loads(text)) == []
    assert wrong(DRIVE, tomllib.loads(dumps_drive(example(name)))) == []


@pytest.mark.parametrize("kind", ["drive", "study"])
def test_examples_begin_with_the_schema_beside_them(kind):
    """As Taplo and Even Better TOML read the line; `scripts/docs.py tables --check` says whether it is current."""
    paths = sorted((ROOT / kind / "examples").glob("*.toml"))
    assert paths
    for path in paths:
        first, second, *_ = path.read_text().splitlines()
        assert first == f"#:schema ./{kind}.schema.json" and second.startswith("# "), path
        schema = json.loads((path.parent / first.removeprefix("#:schema ")).read_text())
        assert wrong(Draft202012Validator(schema), tomllib.loads(path.read_text())) == []


def test_studies_and_the_drive_of_the_documents_are_taken():
    for path in (ROOT / "study" / "examples").glob("*.toml"):
        assert wrong(STUDY, tomllib.loads(path.read_text())) == [], path.name
    page = (ROOT.parent / "docs" / "drive-file.md").read_text()
    assert wrong(DRIVE, tomllib.loads(re.search(r"```toml\n(.*?)```", page, re.DOTALL)[1])) == []


@pytest.mark.parametrize(
    ("find", "put", "where"),
    [
        ("teeth = 14", "teeth = 14.5", "sprockets.0.teeth"),
        ("teeth = 14", "teth = 14", "sprockets.0"),
        ("links = 122", 'links = "122 mm"', "chain.links"),
        ('size = "08B"', 'size = "08C"', "chain.size"),
        ('wrap = "cw"', 'wrap = "clockwise"', "sprockets.0.wrap"),
        ('stiffness = "estimate"', 'stiffness = "guess"', "chain.stiffness"),
        ("clearance = 5.0e-5", "clearance = -1.0", "contact.sprocket.clearance"),
    ],
)
def test_mistakes_are_marked_where_they_are(find, put, where):
    text = drive_path("motorcycle").read_text()
    assert find in text
    assert any(line.startswith(f"{where}: ") for line in wrong(DRIVE, tomllib.loads(text.replace(find, put))))


@pytest.mark.parametrize(
    ("find", "put"),
    [
        ("speed = 179.0", 'speed = "1709 rpm"'),
        ("center = [0.0, 0.0]", 'center = ["0 mm", "-1.5e-2 in"]'),
        ("prescribed = { speed = 179.0, ramp_time = 0.05,", 'prescribed = { table = { file = "speed.csv" },'),
        (
            "prescribed = { speed = 179.0, ramp_time = 0.05,",
            'prescribed = { table = { file = "a", columns = { speed = "n" }, units = { speed = "rpm" }, head = 3 },',
        ),
        ('stiffness = "estimate"', "stiffness = 2e7"),
    ],
)
def test_quantities_files_and_words_are_taken(find, put):
    text = drive_path("motorcycle").read_text()
    assert find in text and wrong(DRIVE, tomllib.loads(text.replace(find, put, 1))) == []


def test_every_key_is_described_and_no_other_is_taken():
    for validator in (DRIVE, STUDY):
        for table in (validator.schema, *validator.schema["$defs"].values()):
            assert table["additionalProperties"] is False and table["description"]
            assert all(value["description"] for value in table["properties"].values())
    assert "unloaded length of a link [m]" in DRIVE.schema["$defs"]["Chain"]["properties"]["pitch"]["description"]


def test_limits_of_a_study_are_a_table_or_a_list():
    text = (ROOT / "study" / "examples" / "car-tensioner.toml").read_text()
    values = tomllib.loads(text)
    assert isinstance(values["limits"], list)
    assert wrong(STUDY, values | {"limits": {"slips": 1.0}}) == []
    assert wrong(STUDY, values | {"limits": {"slip": 1.0}}) != [] != wrong(STUDY, values | {"limits": [{"metric": 3}]})
    assert wrong(STUDY, values | {"bounds": []}) != []


def test_adjustments_of_a_study_are_a_table_or_a_list():
    values = tomllib.loads((ROOT / "study" / "examples" / "pitch-elongation.toml").read_text())
    one = values["adjust"]
    assert wrong(STUDY, values | {"adjust": [one | {"chain": "a"}, one | {"chain": "b"}]}) == []
    assert wrong(STUDY, values | {"adjust": [one | {"chains": "a"}]}) != [] != wrong(STUDY, values | {"adjust": 3})


def test_the_command_prints_the_schema(capsys):
    for word, validator in (("drive", DRIVE), ("study", STUDY)):
        status, out, err = command(capsys, "schema", word)
        assert (status, err) == (0, [])
        printed = json.loads("\n".join(out))
        assert printed["title"] == f"warpchain {word} file" and printed["$defs"] == validator.schema["$defs"]
    assert "invalid choice: 'chain'" in refused(capsys, "schema", "chain")
