"""The site of the documents: tutorials, how-to pages, the model, and the reference made from the code."""

import argparse
import base64
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomlkit
from common.cases import ROOT, SCRIPTS, Line, case, case_option

from pages import reference
from pages.plain_pages import lay_plain_pages

GROUPS = {
    "Your drive": ("drive-file", "check", "fit", "catalogue", "selection", "examples", "glossary"),
    "Parts of a drive": (
        "shafts",
        "valve-trains",
        "several-chains",
        "open-chains",
        "silent-chains",
        "conveyors",
        "moving-sprockets",
        "guides-and-tensioners",
        "tensioners",
        "teeth",
        "wear",
        "temperature",
    ),
    "Examples at length": ("car", "car-published", "swing-idler", "motorcycle", "derailleur"),
    "Studies and decisions": (
        "studies",
        "running-studies",
        "analysis",
        "optimization",
        "better",
        "risk",
        "calibration",
        "jump",
        "judged-runs",
    ),
    "Playback and archive": (
        "playback",
        "report",
        "modes",
        "modes-validation",
        "scripts",
        "assistants",
        "stepping",
        "fmu",
        "plugins",
        "interchange",
        "archive",
        "formats",
    ),
    "Model and limits": (
        "other-programs",
        "friction",
        "validation",
        "validation-published",
        "model",
        "contact-forces",
        "solving",
        "chaotic-motion",
        "steps",
        "devices",
        "performance",
        "reliability",
    ),
    "Reference": ("metrics",),
    "The project": ("contributing", "architecture", "kernels"),
}
"""Pages by their place in the menu; those that are not named are of the model."""
EXAMPLES = {"drives": "warpchain/drive/examples", "studies": "warpchain/study/examples"}
"""Folders of the site with the examples' files, and where they are in the repository."""


def lay_sources(folder: Path) -> None:
    """Lays all pages into a folder, and the examples' files, each beside the schema that its first line names."""
    shutil.copytree(ROOT / "docs", folder, ignore=shutil.ignore_patterns("*.ipynb"))
    for kind in EXAMPLES:
        shutil.copytree(ROOT / EXAMPLES[kind], folder / kind, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    shutil.copyfile(SCRIPTS / "pages" / "site.css", folder / "site.css")
    for name in ("README", "CONTRIBUTING"):
        text = (ROOT / f"{name}.md").read_text()
        text = re.sub(r"(\]\(|src=\")docs/", r"\1", text).replace("](CONTRIBUTING.md)", "](contributing.md)")
        text = text.replace("](README.md)", "](index.md)")
        (folder / ("index.md" if name == "README" else f"{name.lower()}.md")).write_text(text)
    for path in folder.glob("*.md"):
        text = path.read_text()
        for kind, home in EXAMPLES.items():
            text = text.replace(f"](../{home}/", f"]({kind}/")
        path.write_text(
            text.replace("](../CONTRIBUTING.md", "](contributing.md").replace("](../README.md", "](index.md")
        )
    for book in sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")):
        (folder / "tutorials" / f"{book.stem}.md").write_text(notebook_page(book, folder / "tutorials"))
    for name, text in reference.reference_pages().items():
        path = folder / "reference" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")


def notebook_page(path: Path, folder: Path) -> str:
    """A notebook as a page, with what its cells show; pictures go into the folder."""
    lines, pictures = [], 0
    for cell in json.loads(path.read_text())["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines += [text, ""]
            continue
        lines += ["```python", text, "```", ""]
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "text/html" in data:
                lines += [f'<div class="shown" style="overflow-x: auto">{"".join(data["text/html"])}</div>', ""]
            elif "image/png" in data:
                pictures += 1
                name = f"{path.stem}-{pictures}.png"
                (folder / name).write_bytes(base64.b64decode("".join(data["image/png"])))
                lines += [f"![what the cell shows]({name})", ""]
            else:
                said = "".join(output.get("text", data.get("text/plain", "")))
                lines += ["```text", said.rstrip(), "```", ""]
    return "\n".join(lines)


def site_menu(folder: Path) -> list[Any]:
    """The site's menu of whatever pages are there."""

    def pages_below(place: str, *first: str) -> list[str]:
        """Pages of a folder, the `first` ones before the others."""
        names = sorted(
            (path.stem for path in (folder / place).glob("*.md")), key=lambda name: (name not in first, name)
        )
        return [f"{place}/{name}.md" for name in [*first, *(name for name in names if name not in first)]]

    known = {name for names in GROUPS.values() for name in names} | {"index"}
    groups: dict[str, list[Any]] = {title: [f"{name}.md" for name in names] for title, names in GROUPS.items()}
    groups["Model and limits"] += sorted(path.name for path in folder.glob("*.md") if path.stem not in known)
    groups["Reference"] = pages_below("reference", "drive-keys", "study-keys", "commands") + groups["Reference"]
    groups["Reference"].append({"Python": pages_below("reference/python", "warpchain")})
    tutorials = pages_below(
        "tutorials", "install", "first-drive", "own-drive", "first-study", "first-optimization", "decision"
    )
    return [{"warpchain": "index.md"}, {"Tutorials": tutorials}, *({title: held} for title, held in groups.items())]


ITEM = re.compile(r"(?:[-*+]|\d+[.)]) ")


def swallowed_items(text: str) -> Iterator[str]:
    """First items of lists that a page's paragraph takes in, as no blank line stands between."""
    fenced, before = False, ""
    for line in text.split("\n"):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        paragraph = before.strip() and not before.startswith((" ", "#")) and not ITEM.match(before)
        if not fenced and paragraph and ITEM.match(line):
            yield line
        before = line


def site_faults(folder: Path) -> Iterator[str]:
    """Faults that Zensical's strict mode does not find: lists in paragraphs; missing pictures and pages of the menu."""
    for path in sorted(folder.rglob("*.md")):
        text, page = path.read_text(), path.relative_to(folder)
        yield from (f"{page}: a list without a blank line: {line}" for line in swallowed_items(text))
        for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
            if not (path.parent / picture).exists():
                yield f"{page}: a picture that is not there: {picture}"
    for page in re.findall(r'"([^"]+\.md)"', json.dumps(site_menu(folder))):
        if not (folder / page).exists():
            yield f"the menu: a page that is not there: {page}"


def build_site(site: Path) -> subprocess.CompletedProcess:
    """Builds the site; the output of Zensical is in the result, or what keeps it from being built."""
    with tempfile.TemporaryDirectory() as work:
        folder, config = Path(work) / "docs", Path(work) / "zensical.toml"
        lay_sources(folder)
        if found := list(site_faults(folder)):
            return subprocess.CompletedProcess([], 1, "\n".join(found), "")
        settings = tomllib.loads((SCRIPTS / "pages" / "zensical.toml").read_text())
        settings["project"] |= {
            "nav": site_menu(folder),
            "docs_dir": "docs",
            "site_dir": "site",
        }  # must be within its own
        config.write_text(tomlkit.dumps(settings))
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(config)]
        done = subprocess.run(command, cwd=work, capture_output=True, text=True, env=environment)
        if done.returncode == 0:
            shutil.copytree(Path(work) / "site", site, dirs_exist_ok=True)
            lay_plain_pages(folder, site_menu(folder), site)
        colorless = (re.sub(r"\x1b\[[\d;]*m", "", text) for text in (done.stdout, done.stderr))
        return subprocess.CompletedProcess(command, done.returncode, *colorless)


@case(case_option("folder", nargs="?", type=Path, default=Path("out/site"), help="default out/site"))
def site(asked: argparse.Namespace) -> Iterator[Line]:
    """Builds the site of the documents; needs the extra `docs`, no network.

    python scripts/docs.py site [FOLDER]

    Any warning ends it: a link or a picture that leads nowhere, a name that is not there, a list that a paragraph takes
    in. The pages are those of docs/, README and CONTRIBUTING, notebooks as they were stored, and those of
    `pages/reference.py`. Beside the HTML are the pages as Markdown, which llms.txt lists.
    """
    done = build_site(asked.folder)
    yield done.stdout + done.stderr + str(asked.folder / "index.html")
    raise SystemExit(done.returncode)
