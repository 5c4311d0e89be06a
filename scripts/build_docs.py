"""Builds the site of the documents: tutorials, how-to pages, the model, and the reference made from the code.

    python scripts/build_docs.py [FOLDER]      # default out/site; needs the extra `docs`, no network

Any warning ends it: a link to nowhere, a page that no menu shows, a name that is not there. The pages are those of
docs/, README, CONTRIBUTING and CHANGELOG, notebooks as they were stored, and `docs_reference.py`'s. Those of
docs/notes/ are built, but no menu shows them.
"""

import argparse
import base64
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import docs_reference

ROOT = Path(__file__).resolve().parents[1]
GROUPS = {
    "How to": ("check", "fit", "studies", "analysis", "judged-runs", "playback", "interchange", "modes"),
    "The model": ("model", "teeth", "moving-sprockets", "wear"),
    "Reference": ("drive-file", "catalogue", "examples", "metrics", "archive", "formats"),
    "The project": ("performance", "reliability", "contributing", "changelog"),
}
"""Which page stands where in the menu; pages that are not named are how-to pages."""
TUTORIALS = ("first-drive", "first-study", "first-optimization")
QUIET = {"NO_MKDOCS_2_WARNING": "1"}
"""Of what the theme says about its own future."""
REFERENCE = ("drive-keys", "study-keys", "metrics", "commands")


def sources(folder: Path) -> None:
    """Lays all pages into a folder."""
    shutil.copytree(ROOT / "docs", folder, ignore=shutil.ignore_patterns("*.ipynb"))
    for name in ("README", "CONTRIBUTING", "CHANGELOG"):
        text = (ROOT / f"{name}.md").read_text()
        text = re.sub(r"(\]\(|src=\")docs/", r"\1", text).replace("](CONTRIBUTING.md)", "](contributing.md)")
        text = text.replace("](CHANGELOG.md)", "](changelog.md)").replace("](README.md)", "](index.md)")
        (folder / ("index.md" if name == "README" else f"{name.lower()}.md")).write_text(text)
    for path in folder.glob("*.md"):
        text = path.read_text()
        path.write_text(
            text.replace("](../CONTRIBUTING.md", "](contributing.md").replace("](../README.md", "](index.md")
        )
    for book in sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")):
        (folder / "tutorials" / f"{book.stem}.md").write_text(notebook(book, folder / "tutorials"))
    for name, text in docs_reference.pages().items():
        path = folder / "reference" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")


def notebook(path: Path, folder: Path) -> str:
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
                lines += [f'<div class="shown">{"".join(data["text/html"])}</div>', ""]
            elif "image/png" in data:
                pictures += 1
                name = f"{path.stem}-{pictures}.png"
                (folder / name).write_bytes(base64.b64decode("".join(data["image/png"])))
                lines += [f"![what the cell shows]({name})", ""]
            else:
                said = "".join(output.get("text", data.get("text/plain", "")))
                lines += ["```text", said.rstrip(), "```", ""]
    return "\n".join(lines)


def menu(folder: Path) -> list[Any]:
    """The site's menu of whatever pages are there."""
    left = {path.stem for path in folder.glob("*.md")} - {"index"}
    found: list[Any] = [{"warpchain": "index.md"}]
    found.append({"Tutorials": _ordered(folder, "tutorials", TUTORIALS)})
    groups = {title: [name for name in names if name in left] for title, names in GROUPS.items()}
    groups["How to"] += sorted(left - {name for names in groups.values() for name in names})
    for title, names in groups.items():
        entries: list[Any] = [f"{name}.md" for name in names]
        if title == "Reference":
            entries = _ordered(folder, "reference", REFERENCE) + entries
            entries.append({"Python": _ordered(folder, "reference/python", ("warpchain",))})
        found.append({title: entries})
    return found


def _ordered(folder: Path, below: str, first: tuple[str, ...]) -> list[str]:
    names = sorted(path.stem for path in (folder / below).glob("*.md"))
    ordered = [name for name in first if name in names] + [name for name in names if name not in first]
    return [f"{below}/{name}.md" for name in ordered]


def settings(folder: Path, site: Path) -> dict[str, Any]:
    """What mkdocs is told. Fonts are the reader's own: the site asks no other machine for anything."""
    docstrings = {
        "docstring_style": "google",
        "docstring_options": {"warnings": False},
        "show_root_heading": True,
        "show_root_full_path": True,
        "show_source": False,
        "members_order": "source",
        "filters": ["!^_"],
        "heading_level": 2,
        "show_signature_annotations": False,
        "show_if_no_docstring": False,
        "summary": False,
    }
    return {
        "site_name": "warpchain",
        "docs_dir": str(folder),
        "site_dir": str(site),
        "use_directory_urls": False,
        "theme": {
            "name": "material",
            "font": False,
            "features": ["navigation.sections", "navigation.top", "content.code.copy", "search.suggest"],
            "palette": [
                {"media": "(prefers-color-scheme: light)", "scheme": "default", "primary": "blue grey"},
                {"media": "(prefers-color-scheme: dark)", "scheme": "slate", "primary": "blue grey"},
            ],
        },
        "plugins": [
            "search",
            {"mkdocstrings": {"handlers": {"python": {"paths": [str(ROOT)], "options": docstrings}}}},
        ],
        "markdown_extensions": [
            "tables",
            "attr_list",
            "md_in_html",
            {"toc": {"permalink": True, "toc_depth": 3}},
            {"pymdownx.highlight": {"use_pygments": True}},
            "pymdownx.superfences",
        ],
        "validation": {"nav": {"omitted_files": "warn"}, "links": {"anchors": "warn", "not_found": "warn"}},
        "nav": menu(folder),
        "not_in_nav": "/notes/",
    }


def build(site: Path) -> subprocess.CompletedProcess:
    """Builds the site; what mkdocs says is in the result."""
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "docs"
        sources(folder)
        config = Path(work) / "mkdocs.yml"
        config.write_text(json.dumps(settings(folder, site.resolve())))  # JSON is YAML
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", str(config)]
        return subprocess.run(command, cwd=work, capture_output=True, text=True, env=os.environ | QUIET)


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", nargs="?", type=Path, default=Path("out/site"), help="default out/site")
    return made


def main() -> None:
    """Builds the site and tells where it is."""
    folder = parser().parse_args().folder
    done = build(folder)
    print(done.stdout + done.stderr, end="")
    if done.returncode == 0:
        print(folder / "index.html")
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
