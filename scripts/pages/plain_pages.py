"""The site's pages as plain Markdown beside the HTML, and `llms.txt`, which lists them for language models."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MADE_ELSEWHERE = "reference/python"
"""Folder of pages whose text the site's builder makes of the code."""


def lay_plain_pages(folder: Path, menu: list[Any], site: Path) -> None:
    """Copies the pages of a folder into the site as they are, and writes their list `llms.txt` in the menu's order."""
    pages = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*.md"))}
    for name, path in pages.items():
        if not name.startswith(MADE_ELSEWHERE):
            (site / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, site / name)
    (site / "llms.txt").write_text("\n".join(list_lines(folder, menu)) + "\n")


def list_lines(folder: Path, menu: list[Any]) -> Iterator[str]:
    """Lines of `llms.txt` (llmstxt.org): the first page's summary, then each group of pages with a sentence on each."""
    yield "# warpchain"
    yield ""
    yield f"> {first_sentence((folder / 'index.md').read_text())}"
    for entry in menu:
        for title, held in entry.items():
            if isinstance(held, str):
                continue
            yield ""
            yield f"## {title}"
            yield ""
            for name in held:
                if isinstance(name, str):
                    text = (folder / name).read_text()
                    yield f"- [{page_title(text)}]({name}): {first_sentence(text)}"


def page_title(text: str) -> str:
    """Heading of a page, without marks of code."""
    return re.search(r"^# (.+)$", text, re.MULTILINE)[1].replace("`", "")  # type: ignore[index]


def first_sentence(text: str) -> str:
    """First sentence of a page's first paragraph, links as their words."""
    body = re.sub(r"^(#.*|<!--.*-->)$", "", text, flags=re.MULTILINE).strip()
    words = " ".join(body.split("\n\n")[0].split()).replace("**", "")
    words = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", words)
    return re.split(r"(?<=[.?!]) (?=[A-Z`])", words)[0]
