"""The site: it builds without a warning, asks no other machine for anything, and opens in a browser."""

import re
from pathlib import Path

import pytest
from browsing import browser, no_browser
from drives import of_long
from loading import load_script

from warpchain.drive import Drive
from warpchain.results.metric_columns import COLUMN_BY_NAME
from warpchain.study.spec import Study

ROOT = Path(__file__).resolve().parent.parent
TAKEN_IN = "# A page\n- of its own\n\nWords:\n\n- one\n  more\n- two\n\n```\n- code\n```\n\nWords:\n- taken in\n"
reference = load_script("pages.reference")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    for needed in ("zensical", "mkdocstrings"):
        pytest.importorskip(needed)
    folder = tmp_path_factory.mktemp("site")
    done = load_script("pages.site").build_site(folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.parametrize("top", [Drive, Study])
def test_every_key_of_a_file_is_described(top):
    rows = [(kind.__name__, row) for kind in reference.file_sections(top) for row in reference.key_rows(kind)]
    assert rows and not [(kind, row[0]) for kind, row in rows if not row[3]]


@pytest.mark.parametrize("top", [Drive, Study])
def test_keys_are_described_by_whole_phrases(top):
    """Not by the rest of a line that only its neighbors make whole."""
    fragment = re.compile(r"\[|(of|by|in|at|to|as|about|without|along|that|for)\b|.*; or$")
    rows = [(kind.__name__, row) for kind in reference.file_sections(top) for row in reference.key_rows(kind)]
    assert [(kind, row[0], row[3]) for kind, row in rows if fragment.match(row[3])] == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (TAKEN_IN, "a.md: a list without a blank line: - taken in"),
        ("# A page\n\n![of what](gone.png)\n", "a.md: a picture that is not there: gone.png"),
        ("# A page\n", "the menu: a page that is not there: gone.md"),
        ("# A page\n\n[to](gone.md)\n", "page does not exist"),
        ("# A page\n\n[to](#gone)\n", "anchor does not exist"),
        ("# A page\n\n::: warpchain.errors.gone\n", "warpchain.errors.gone"),
    ],
    ids=["list", "picture", "menu", "link", "anchor", "name"],
)
def test_a_fault_of_a_page_ends_the_build(tmp_path, monkeypatch, text, fault):
    """Those of this project's own rules, and those of Zensical's strict mode."""
    site = load_script("pages.site")
    monkeypatch.setattr(site, "lay_sources", lambda folder: (folder.mkdir(), (folder / "a.md").write_text(text)))
    monkeypatch.setattr(site, "site_menu", lambda folder: ["gone.md"] if "menu" in fault else ["a.md"])
    done = site.build_site(tmp_path / "site")
    assert done.returncode == 1 and fault in done.stdout + done.stderr
    assert not (tmp_path / "site").exists()


def test_keys_are_found_however_deep():
    held = reference.file_sections(Drive)
    places = {kind.__name__: paths for kind, paths in held.items()}
    assert places["Chain"] == ["[chain]"]
    assert places["Harmonic"] == ["[[sprockets.prescribed.harmonics]]", "[[sprockets.load.harmonics]]"]
    rows = {row[0]: row for kind in held for row in reference.key_rows(kind) if kind.__name__ == "RunSettings"}
    assert rows["`integrator`"][2] == "`leapfrog`"
    assert rows["`duration`"][1:3] == ("a positive number", "needed")
    assert "time step [s]" in rows["`step`"][3]
    defaults = {row[0]: row[2] for kind in held for row in reference.key_rows(kind) if kind.__name__ == "Chain"}
    assert (defaults["`pitch`"], defaults["`links`"]) == ("needed without `size`", "needed")


def test_documents_have_every_metric_and_the_reference_every_command():
    held, documents = reference.reference_pages(), "".join(path.read_text() for path in (ROOT / "docs").glob("*.md"))
    for name in COLUMN_BY_NAME:
        assert re.search(rf"`[A-Za-z.]*{re.escape(name)}`", documents), name
    for command in ("check", "run", "import", "study report"):
        assert f"## warpchain {command}\n" in held["commands.md"]


def test_every_page_is_in_the_menu(site):
    """A page of docs that no group names is a how-to page."""
    index = (site / "index.html").read_text()
    for path in (ROOT / "docs").glob("*.md"):
        assert f'href="./{path.stem}.html"' in index, path.name  # the README's own links are without ./


def test_every_page_is_there_as_plain_text_and_listed(site):
    """Each with a sentence on it that ends; what the builder makes of docstrings is HTML alone."""
    text = (site / "llms.txt").read_text()
    assert text.startswith("# warpchain\n\n> warpchain computes ")
    listed = re.findall(r"^- \[[^\]]+\]\(([^)]+)\): (.+)$", text, re.MULTILINE)
    names = {name for name, _ in listed}
    assert {f"{path.stem}.md" for path in (ROOT / "docs").glob("*.md")} < names
    assert {"contributing.md", "tutorials/first-drive.md", "reference/commands.md"} < names
    for name, said in listed:
        page = (site / name).read_text()
        assert page.count("\n") > 5 and ":::" not in page and said.endswith("."), name
        assert not [
            to
            for to in re.findall(r"\]\((?!https?:|#)([^)#]+)", page)
            if not (site / name).parent.joinpath(to).exists()
        ]


@pytest.mark.parametrize(("folder", "kind"), [("drives", "drive"), ("studies", "study")])
def test_examples_are_beside_their_schema(site, folder, kind):
    examples = ROOT / "warpchain" / kind / "examples"
    published = {path.name for path in (site / folder).iterdir()}
    assert published == {path.name for path in examples.iterdir() if path.suffix in (".toml", ".json")}
    assert f"{kind}.schema.json" in published
    if kind == "drive":
        assert 'href="drives/car.toml"' in (site / "examples.html").read_text()


def test_the_site_asks_no_other_machine_for_anything(site):
    for path in site.rglob("*.html"):
        text = path.read_text()
        # pictures, scripts and styles are the site's own; links that a reader follows may go anywhere
        assert not re.findall(r'<(?:script|img|iframe)[^>]*\bsrc="(?:https?:)?//[^"]*"', text), path
        assert not re.findall(r'<link[^>]*rel="(?:stylesheet|preconnect)"[^>]*href="(?:https?:)?//[^"]*"', text), path
    for path in site.rglob("*.css"):
        assert not re.findall(r"url\(['\"]?(?:https?:)?//", path.read_text()), path


@pytest.mark.viewer
@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
def test_the_site_opens_in_a_browser(site):
    """Title, a table of keys, the signature of `simulate`, and the tutorial's pictures, as a reader has them."""
    looks = {
        "index.html": ("document.querySelector('h1').firstChild.textContent", "warpchain"),
        "reference/drive-keys.html": ("document.querySelectorAll('table').length > 15", True),
        "reference/python/warpchain.html": (
            "document.body.innerText.includes('warpchain.engine.simulation.simulate')",
            True,
        ),
        "tutorials/first-drive.html": (
            "[...document.images].filter(i => i.complete && i.naturalWidth > 300).length > 4 "
            "&& document.querySelectorAll('.shown table').length > 2",
            True,
        ),
    }
    with browser() as page:
        for path, (expression, value) in looks.items():
            page.open((site / path).as_uri())
            assert page.reaches(expression, value), path


@pytest.mark.viewer
@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
@pytest.mark.parametrize("width", [390, *of_long(1280)])
def test_no_page_scrolls_sideways(site, width):
    """On a phone and on a small laptop; tables, code and pictures scroll within the page."""
    ready = "location.pathname.endsWith('{}') && document.readyState == 'complete'"
    fits = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
    with browser() as page:
        page.resize(width, 844)
        for path in sorted(site.rglob("*.html")):
            page.open(path.as_uri())
            # the theme's script wraps tables after the page is there
            assert page.reaches(f"{ready.format(path.name)} && {fits}", True, 10.0), path


@pytest.mark.viewer
@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
def test_a_page_that_scrolls_sideways_would_be_found(tmp_path):
    wide = tmp_path / "wide.html"
    wide.write_text('<meta name="viewport" content="width=device-width"><div style="width: 391px">a</div>')
    with browser() as page:
        page.resize(390, 844)
        page.open(wide.as_uri())
        assert page.reaches("document.readyState == 'complete' && document.body.innerText == 'a'", True)
        assert page.reaches("document.documentElement.scrollWidth > document.documentElement.clientWidth", True)
