"""The command `warpchain mcp`: tools for an assistant, by the Model Context Protocol on standard input and output.

A tool is a command of the command line, its arguments the command's. Each call is a process of its own, so that the
server outlives a call that fails.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.commands import DONE, WRONG
from warpchain.cli.shared_options import add_command
from warpchain.errors import WarpchainError

if TYPE_CHECKING:
    from mcp.types import CallToolResult, Tool

Parsers = Mapping[str, argparse.ArgumentParser]

TOOLS = {
    "new": ("new",),
    "check": ("check",),
    "draw": ("draw",),
    "run": ("run",),
    "report": ("report",),
    "study": ("study", "run"),
    "study_report": ("study", "report"),
    "explain": ("explain",),
}
"""Words of the command behind each tool."""
OUTPUTS = {"output", "table"}  # arguments that name what to write
HIDDEN = {"help", "quiet", "watch", "shard", "scheduler", "plugin"}  # set here, or wait, reach others, run code
INSTRUCTIONS = (
    "warpchain simulates roller-chain drives; all numbers are in SI units. A DRIVE is a file or an example's name. "
    "Make one with new, look at it with check and draw, then run it; a run's report is a page for people. Any value of "
    "a drive can be changed by set, such as sprockets.driven.load.torque=800. Act on the LOOK AT lines of check, and "
    "rely on no run whose status is suspect. explain says what a metric, key or line of an error or of check means."
)


def add_mcp_command(commands: Any) -> None:
    """Adds `warpchain mcp` to the command line, whose other commands are its tools."""

    def mcp_command(arguments: argparse.Namespace) -> int:
        """Body of `warpchain mcp`: serves an assistant."""
        return serve_assistant(commands.choices, arguments.write)

    text = "give an assistant tools over the Model Context Protocol, on standard input and output (docs/assistants.md)"
    parser = add_command(commands, "mcp", mcp_command, text, "warpchain mcp --write drives")
    text = "folder that all its outputs must be in, and that it starts in; without it, it writes nothing"
    parser.add_argument("--write", metavar="FOLDER", type=Path, help=text)


def serve_assistant(commands: Parsers, write: Path | None) -> int:
    """Serves an assistant on standard input and output; returns the exit status.

    Args:
        commands: parsers of the command line's commands.
        write: folder that all outputs must be in and that relative paths start from; None writes nothing.

    Raises:
        WarpchainError: without the extra mcp; OSError for a folder that cannot be made.
    """
    from warpchain.extras import require_extra

    require_extra("mcp", "mcp", WarpchainError)
    import anyio
    from mcp.server import Server
    from mcp.server.stdio import stdio_server
    from mcp.types import CallToolResult, ListToolsResult, TextContent

    from warpchain.version import installed_version

    if write is not None:
        write.mkdir(parents=True, exist_ok=True)
    parsers = {name: _command_parser(commands, words) for name, words in TOOLS.items()}

    async def list_tools(*_: Any) -> ListToolsResult:
        """MCP tools for the assistant, with the schemas of their arguments."""
        return ListToolsResult(tools=[_described_tool(name, of, write is None) for name, of in parsers.items()])

    async def call_tool(_: Any, asked: Any) -> CallToolResult:
        """Result of an MCP tool's call, an error in the command line's words."""
        try:
            if asked.name not in parsers:
                raise WarpchainError(f"{asked.name}: no such tool; allowed are {', '.join(parsers)}")
            return await _call_command(asked.name, parsers[asked.name], asked.arguments or {}, write)
        except (WarpchainError, OSError, ValueError) as error:  # also a word that no process can be given
            return CallToolResult(content=[TextContent(text=f"warpchain: error: {error}")], is_error=True)

    async def serve_until_end() -> None:
        """Serves the assistant until standard input ends."""
        given: Any = {"instructions": INSTRUCTIONS, "on_list_tools": list_tools, "on_call_tool": call_tool}
        server: Server[Any] = Server("warpchain", version=installed_version(), **given)
        async with stdio_server() as (received, sent):
            await server.run(received, sent, server.create_initialization_options())

    anyio.run(serve_until_end)
    return DONE


def _command_parser(commands: Parsers, words: tuple[str, ...]) -> argparse.ArgumentParser:
    """Parser of an MCP tool's command, or of one below it."""
    parser = commands[words[0]]
    for word in words[1:]:
        parser = next(action.choices[word] for action in parser._actions if isinstance(action.choices, dict))
    return parser


def _described_tool(name: str, parser: argparse.ArgumentParser, read_only: bool) -> Tool:
    """MCP tool with its command's help and the schema of its arguments."""
    from mcp.types import Tool, ToolAnnotations

    said, schema = f"{parser.description}\n{parser.epilog}", arguments_schema(parser)
    if name == "draw":  # which shows the picture, whether a file is asked for or not
        schema["required"].remove("output")
    hints = ToolAnnotations(read_only_hint=read_only, open_world_hint=False)
    return Tool(name=name, description=said, input_schema=schema, annotations=hints)


def _shown_actions(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Arguments of a command that its MCP tool has, by name."""
    return {action.dest: action for action in parser._actions if action.dest not in HIDDEN}


def arguments_schema(parser: argparse.ArgumentParser) -> dict[str, Any]:
    """JSON schema of an MCP tool's arguments, from its command's parser."""
    properties, required = dict[str, Any](), list[str]()
    for dest, action in _shown_actions(parser).items():
        kind: dict[str, Any] = {"type": "string" if action.type in (None, Path) else ["number", "string"]}
        if action.choices is not None:
            kind = {"enum": list(action.choices)}
        if action.nargs == 0:
            kind = {"type": "boolean"}
        elif action.nargs is not None or isinstance(action, argparse._AppendAction):
            kind = {"type": "array", "items": kind}
        properties[dest] = kind | {"description": (action.help or str(action.metavar)).replace("%%", "%")}
        required += [dest] if action.required else []
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def command_words(parser: argparse.ArgumentParser, values: Mapping[str, Any]) -> list[str]:
    """Words of an MCP tool's command line; raises WarpchainError for unknown or hidden options."""
    actions, options, places = _shown_actions(parser), list[str](), list[str]()
    for name, value in values.items():
        if name not in actions:
            raise WarpchainError(f"{name}: no argument of this tool; allowed are {', '.join(actions)}")
        action, words = actions[name], [str(word) for word in (value if isinstance(value, list) else [value])]
        if not action.option_strings:
            places += words
        elif action.nargs == 0:
            options += [action.option_strings[-1]] if value is True else []
        elif isinstance(action.nargs, int | str):
            if found := [word for word in words if re.match(r"-(?![\d.])", word)]:
                raise WarpchainError(f"{name}: {found[0]!r} is read as an option")
            options += [action.option_strings[-1], *words]
        else:
            options += [f"{action.option_strings[-1]}={word}" for word in words]
    return [*options, "--", *places]


def _refuse_outputs_outside(name: str, arguments: Mapping[str, Any], write: Path | None) -> None:
    """Raises WarpchainError for an MCP tool's outputs outside the folder to write."""
    for key in OUTPUTS & set(arguments):
        if write is None:
            raise WarpchainError(f"{name}: writes nothing here; start it as: warpchain mcp --write FOLDER")
        path = arguments[key]
        if not isinstance(path, str) or not (write / path).resolve().is_relative_to(write.resolve()):
            raise WarpchainError(f"{name}: {key} {path}: must be inside {write.resolve()}")


async def _call_command(
    name: str, parser: argparse.ArgumentParser, arguments: Mapping[str, Any], write: Path | None
) -> CallToolResult:
    """Result of an MCP tool's command: lines, and the picture of draw; raises WarpchainError."""
    from base64 import b64encode
    from subprocess import DEVNULL
    from tempfile import TemporaryDirectory

    import anyio
    from mcp.types import CallToolResult, ImageContent, TextContent

    _refuse_outputs_outside(name, arguments, write)
    with TemporaryDirectory() as folder:
        picture = Path(folder) / "drive.png"
        shown: dict[str, dict[str, Any]] = {"draw": {"output": picture}, "run": {"json": True}}
        given = dict(arguments) if "output" in arguments else {**shown.get(name, {}), **arguments}
        quiet = ["--quiet"] if "--quiet" in parser._option_string_actions else []
        command = [sys.executable, "-m", "warpchain", *TOOLS[name], *quiet, *command_words(parser, given)]
        run = await anyio.run_process(command, stdin=DEVNULL, check=False, cwd=write)
        said = [text.decode().replace(f"{picture}\n", "").strip() for text in (run.stdout, run.stderr)]
        content: list[Any] = [TextContent(text=text) for text in said if text]
        if picture.exists():
            content.append(ImageContent(data=b64encode(picture.read_bytes()).decode(), mime_type="image/png"))
    return CallToolResult(content=content, is_error=run.returncode == WRONG or run.returncode < 0)
