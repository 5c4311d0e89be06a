"""`warpchain mcp` by the SDK's own client: from words to a checked drive, a run, its report; what it refuses."""

import asyncio
import json
import os
import sys

import pytest
from command import refused
from PIL import Image

from warpchain.cli.mcp_server import OUTPUTS, TOOLS

HARMLESS = {
    *("drive", "size", "teeth", "centers", "speed", "torque", "keep_centers", "set", "json", "device", "precision"),
    *(
        "duration",
        "step",
        "window",
        "rate",
        "channels",
        "memory",
        "workers",
        "compression",
        "values",
        "exact_positions",
    ),
    *(
        "split_size",
        "limit",
        "strict",
        "archive",
        "variant",
        "title",
        "wear_coefficient",
        "bearing_area",
        "study",
        "grow",
    ),
    *("factor", "metric", "minimize", "maximize", "recorded", "fatigue", "text"),
    "overwrite",  # of what is inside the folder
}
"""Arguments that only read, compute, or change what a permitted output has."""
NEW = {"output": "drive.toml", "size": "08B", "teeth": [17, 38], "centers": [0, 0, 0.4, 0], "speed": "300rpm"}
SHORT = {"drive": "drive.toml", "set": ["run.settle=false"], "duration": 0.02}


@pytest.fixture
def converse(tmp_path):
    """Function that calls tools of a server in an empty folder, in their order, and gives their results."""
    mcp = pytest.importorskip("mcp")

    def converse(*calls, write=True):
        options = ["--write", str(tmp_path / "made")] if write else []
        server = mcp.StdioServerParameters(
            command=sys.executable,
            args=["-m", "warpchain", "mcp", *options],
            env={key: os.environ[key] for key in ("PYTHONPATH", "WARP_CACHE_PATH") if key in os.environ},
            cwd=tmp_path,
        )

        async def call_all():
            async with mcp.Client(server) as client:
                listed = (await client.list_tools()).tools
                return listed, [await client.call_tool(name, arguments) for name, arguments in calls]

        return asyncio.run(call_all())

    return converse


def lines(result):
    """Lines of a result's text."""
    return result.content[0].text.splitlines()


def error(result):
    """The one line that a call is refused with."""
    assert result.is_error
    (line,) = lines(result)
    assert line.startswith("warpchain: error: ")
    return line


def test_from_words_to_a_checked_drive_and_a_run(converse, tmp_path):
    """The drive is the one asked for: its wheels' speeds are as the teeth; standard output stays the protocol's."""
    listed, (new, check, draw, bare, run, report, explain) = converse(
        ("new", NEW),
        ("check", {"drive": "drive.toml", "json": True}),
        ("draw", {"drive": "drive.toml"}),
        ("run", SHORT),
        ("run", SHORT | {"output": "drive.mcap"}),
        ("report", {"archive": "drive.mcap", "output": "drive.html"}),
        ("explain", {"text": "driven.speed_mean"}),
    )
    assert [tool.name for tool in listed] == list(TOOLS)
    assert [lines(result) for result in (new, check, draw, bare, run, report, explain) if result.is_error] == []
    assert lines(new)[-1].startswith("written: drive.toml")
    checked = json.loads(check.content[0].text)
    assert [sprocket["teeth"] for sprocket in checked["sprockets"]] == [17, 38]
    picture = draw.content[-1]
    assert picture.type == "image" and picture.mime_type == "image/png"
    found = json.loads(bare.content[0].text)
    assert found["run"]["archive"] is None and found["metrics"]["tension_max"] > 0
    assert "archive: drive.mcap; look at it with: warpchain view drive.mcap" in lines(run)
    assert lines(explain) == ["metric driven.speed_mean [rad/s]: mean angular velocity"]
    made = {path.name for path in (tmp_path / "made").iterdir()}
    assert made == {"drive.toml", "drive.schema.json", "drive.mcap", "drive.html"}
    assert [path.name for path in tmp_path.iterdir()] == ["made"]


def test_the_picture_is_asked_for_as_a_file(converse, tmp_path):
    _, (draw,) = converse(("draw", {"drive": "industrial", "output": "drive.png"}))
    assert lines(draw)[-1] == "drive.png"
    assert Image.open(tmp_path / "made" / "drive.png").width > 500


def test_outputs_are_inside_the_folder_or_nowhere(converse, tmp_path):
    """Whatever form a path has: absolute, upward, by a link, a list, or an option among a list's words."""
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "link").symlink_to(tmp_path)
    outside = [str(tmp_path / "new.toml"), "../new.toml", "link/new.toml", [str(tmp_path / "new.toml")]]
    _, found = converse(
        *(("new", NEW | {"output": path}) for path in outside),
        ("new", NEW | {"teeth": [17, 38, f"--output={tmp_path}/new.toml"]}),
        ("study_report", {"study": "made", "output": "a.html", "table": "../a.csv"}),
    )
    for result in found[:4]:
        assert f"must be inside {tmp_path / 'made'}" in error(result)
    assert "is read as an option" in error(found[4])
    assert "table ../a.csv: must be inside" in error(found[5])
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["link", "made"]


def test_without_a_folder_nothing_is_written(converse, tmp_path):
    listed, (new, check, archive) = converse(
        ("new", NEW), ("check", {"drive": "industrial"}), ("run", {"drive": "marine", "output": "a.mcap"}), write=False
    )
    assert all(tool.annotations.read_only_hint for tool in listed)
    for name, result in (("new", new), ("run", archive)):
        assert (
            error(result) == f"warpchain: error: {name}: writes nothing here; start it as: warpchain mcp --write FOLDER"
        )
    assert not check.is_error and not list(tmp_path.iterdir())


def test_errors_are_those_of_the_command_line(converse, capsys):
    calls = {
        ("new", "d.toml", "--size", "08X", "--teeth", "17", "38", "--centers", "0", "0", "0.4", "0"): (
            "new",
            NEW | {"output": "d.toml", "size": "08X"},
        ),
        ("check", "nowhere.toml"): ("check", {"drive": "nowhere.toml"}),
        ("check", "marine", "--set", "chain.links=2"): ("check", {"drive": "marine", "set": ["chain.links=2"]}),
        ("explain", "tenson_max"): ("explain", {"text": "tenson_max"}),
    }
    _, found = converse(*calls.values())
    for words, result in zip(calls, found, strict=True):
        assert error(result) == refused(capsys, *words)


def test_every_argument_was_looked_at(converse):
    """A new option of a command is no tool's before it is here: it might write elsewhere, run code, or wait."""
    listed, _ = converse()
    for tool in listed:
        assert set(tool.input_schema["properties"]) <= HARMLESS | OUTPUTS, tool.name
    _, (result,) = converse(("run", SHORT | {"plugin": "own.py"}))
    assert "plugin: no argument of this tool" in error(result)


def test_unknown_tools_and_arguments(converse):
    _, found = converse(("dance", {}), ("check", {"drvie": "car"}), ("check", {}), ("check", {"drive": "--help"}))
    asked = ("no such tool", "drvie: no argument of this tool", "arguments are required: DRIVE", "neither a drive file")
    for result, text in zip(found, asked, strict=True):
        assert text in error(result)


def test_the_extra_is_asked_for(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcp", None)
    assert "mcp: needs mcp; install it with: pip install" in refused(capsys, "mcp")


def test_a_folder_that_is_a_file(capsys, tmp_path):
    pytest.importorskip("mcp")
    (tmp_path / "file").touch()
    assert str(tmp_path / "file") in refused(capsys, "mcp", "--write", tmp_path / "file")
