"""The report in a browser: opened without a network, brushed, filtered, pointed at, printed."""

import base64
import io
import json
import time

import numpy as np
import pyarrow as pa
import pypdfium2 as pdfium
import pytest
from browsing import BESIDE, CUT, browser, no_browser
from PIL import Image
from waiting import wait_for

from warpchain.study.report import study_report_html
from warpchain.study.report.decision_sections import ReportGoals
from warpchain.study.results import read_results
from warpchain.study.spec.study_tables import Bound, Objective

pytestmark = [
    pytest.mark.viewer,
    pytest.mark.skipif(no_browser() is not None, reason=str(no_browser())),
]

ROWS = 400


def study():
    rng = np.random.default_rng(2)
    torque, x = rng.uniform(6e3, 14e3, ROWS), rng.uniform(1.1, 1.3, ROWS)
    status = np.where(np.arange(ROWS) % 50 == 0, "suspect", "ok")
    return pa.table(
        {
            "variant": np.arange(ROWS),
            "torque": torque,
            "x": x,
            "law": rng.choice(["flores", "hunt"], ROWS),
            "tension_max": 3.0 * torque + 100.0 * rng.standard_normal(ROWS),
            "contact_energy_per_revolution": 50.0 - 20.0 * x - 1e-3 * torque,
            "status": status,
            "reason": np.where(status == "ok", "", "energy_residual 0.2 above 0.05"),
            "archive": [f"shards/{k:05d}.mcap" if k % 10 == 1 else None for k in range(ROWS)],
            "archive_variant": [0 if k % 10 == 1 else None for k in range(ROWS)],
        }
    )


class Opened:
    """A page in the browser."""

    def __init__(self, browser):
        self.browser = browser

    def call(self, method, **values):
        return self.browser.call(method, self.browser._session, **values)

    def value(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def unfold(self):
        """Opens all that is folded but lists of controls."""
        self.value("document.querySelectorAll('section > details, details.fold').forEach((d) => { d.open = true; })")

    def settled(self):
        """Waits until what was asked for is drawn."""
        time.sleep(0.3)
        drawn = "new Promise(f => requestAnimationFrame(() => requestAnimationFrame(f)))"
        self.call("Runtime.evaluate", expression=drawn, awaitPromise=True)

    def clear(self):
        """Takes all limits away."""
        self.value("document.querySelector('#clear').click()")
        self.settled()

    def limit_tension(self, most):
        """Types the largest tension [kN] that is wanted."""
        typed = 'document.querySelector(\'input[data-column="tension_max"][data-end="at most"]\')'
        self.value(f"(() => {{ const i = {typed}; i.value = '{most}'; i.onchange(); }})()")
        self.settled()

    def box(self, name):
        """Left, top, width and height of an element that is scrolled to."""
        found = f"const e = document.querySelector({json.dumps(name)}); e.scrollIntoView({{block: 'center'}});"
        box = "const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height];"
        return self.value(f"(() => {{ {found} {box} }})()")

    def drag(self, start, end):
        mouse = {"button": "left", "buttons": 1, "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], **mouse)
        for part in (0.3, 0.7, 1.0):
            x, y = (a + part * (b - a) for a, b in zip(start, end, strict=True))
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **mouse)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)
        self.settled()

    def picture(self):
        data = self.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "r.html"
    objectives = (Objective(metric="tension_max"), Objective(metric="contact_energy_per_revolution"))
    wanted = ReportGoals(objectives, (Bound(metric="tension_max", max=40e3),), "out/study")
    file.write_text(study_report_html(read_results(study(), ["torque", "x", "law"]), "Brushed", wanted=wanted))
    with browser() as page:
        opened = Opened(page)
        opened.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)
        opened.call("Network.enable")
        off = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        opened.call("Network.emulateNetworkConditions", **off)
        opened.browser.open(file.as_uri())
        wait_for(lambda: opened.value("window.warpchain && document.readyState") == "complete")
        opened.folded_height = opened.value("document.documentElement.scrollHeight")
        opened.unfold()
        yield opened


def kept(high_tension=40e3):
    table = study()
    tension = np.array(table["tension_max"])
    return (np.array(table["status"]) == "ok") & (tension <= high_tension)


def test_the_page_opens_short_with_the_decision_first(page):
    """At most 6,000 px before anything is opened; designs, then why, then folded parts; as many links as fit."""
    assert page.folded_height <= 6000
    assert (
        page.value("[...document.querySelectorAll('section')].slice(0, 2).map((s) => s.id).join()") == "designs,summary"
    )
    assert page.value("document.querySelectorAll('nav a').length") <= 12
    plain = (
        "[...document.querySelectorAll('#summary .counts div')].filter((d) => d.querySelector('b').textContent === '0')"
    )
    assert page.value(f"{plain}.every((d) => d.className === '')") is True


def test_a_link_opens_the_part_that_it_leads_to(page):
    page.value("document.querySelector('#correlation > details').open = false")
    page.value("document.querySelector('nav a[href=\"#correlation\"]').click()")
    page.settled()
    assert page.value("document.querySelector('#correlation > details').open") is True


def test_the_page_is_dark_where_that_is_preferred(page):
    """Ground, words of drawings and canvases' ink: read as the browser computes and draws them."""
    ink = "document.querySelector('svg text:not(.cell):not(.axis)')"
    told = f"[getComputedStyle(document.body).backgroundColor, getComputedStyle({ink}).fill].join('; ')"
    seen = {}
    for scheme in ("light", "dark"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        page.call("Emulation.setEmulatedMedia", features=features)
        page.settled()
        page.box("#parallel")
        page.settled()
        seen[scheme] = page.value(told), page.picture().mean()
    page.call("Emulation.setEmulatedMedia", features=[])
    page.settled()
    assert seen["light"][0] == "rgb(246, 247, 249); rgb(51, 71, 91)"
    assert seen["dark"][0] == "rgb(17, 23, 29); rgb(211, 220, 228)"
    assert seen["light"][1] > 200 and seen["dark"][1] < 80


def test_limits_of_the_study_are_set_and_can_be_let_go(page):
    assert page.value("warpchain.kept()") == int(kept().sum())
    assert page.value("document.querySelectorAll('svg').length") >= 12
    assert page.value("document.querySelector('#tally').textContent") == f"{int(kept().sum())} of {ROWS} variants"
    page.clear()
    assert page.value("warpchain.kept()") == ROWS


def test_a_brush_on_an_axis_keeps_its_range(page):
    page.clear()
    left, top, width, height = page.box("#parallel")
    # axes are at 60 .. 1060 of 1120, ranges at 56 .. 300 of 330 (5 % of the range beyond either end)
    boxes = "[...document.querySelectorAll('.limits input[type=checkbox]')]"
    names = page.value(f"{boxes}.map(e => e.nextSibling.textContent)")
    place = names.index("torque")
    x = left + width * (60 + place * 1000 / (len(names) - 1)) / 1120
    up, down = (top + height * y / 330 for y in (56, 178))
    page.drag((x, up), (x, down))
    low, high = page.value("warpchain.filters()")["torque"]
    torque = np.array(study()["torque"])
    pad = 0.05 * np.ptp(torque)
    middle = 0.5 * (torque.min() + torque.max())
    assert low == pytest.approx(middle, abs=0.01 * np.ptp(torque))  # a pixel is 0.4 % of the range
    assert high == pytest.approx(torque.max() + pad, abs=0.01 * np.ptp(torque))
    assert page.value("warpchain.kept()") == int(((torque >= low) & (torque <= high)).sum())
    page.drag((x, up + 20), (x, up + 20))  # a click lets go
    assert page.value("warpchain.kept()") == ROWS


def test_a_box_in_the_scatter_matrix_keeps_two_ranges(page):
    page.clear()
    left, top, width, height = page.box("#matrix canvas:not(.ticks)")
    page.drag((left + 0.2 * width, top + 0.2 * height), (left + 0.7 * width, top + 0.8 * height))
    filters = page.value("warpchain.filters()")
    assert len(filters) == 2
    assert 0 < page.value("warpchain.kept()") < ROWS
    page.clear()


def test_the_scatter_matrix_has_ticks(page):
    """Upright ones beside each row, level ones below each column, where the page's axes of those columns have them."""
    assert page.value("document.querySelectorAll('#matrix canvas.ticks').length") == 10
    told = page.value("[...document.querySelectorAll('#matrix canvas.ticks')].map(e => e.getAttribute('aria-label'))")
    assert sorted(told[:5]) == sorted(told[5:]) and len(set(told)) == 5
    ticks = dict(words.split(": ") for words in told)
    assert ticks["law"] == "flores, hunt"
    assert ticks["tension_max"] == "20, 25, 30, 35, 40"  # kN, of 18 to 42
    ink = "c => new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer).some(v => v)"
    assert page.value(f"[...document.querySelectorAll('#matrix canvas.ticks')].every({ink})")


def test_a_typed_limit_filters(page):
    page.limit_tension(30)
    assert page.value("warpchain.kept()") == int(kept(high_tension=30e3).sum())
    page.clear()


def test_pointing_at_a_dot_tells_its_variant_and_the_command(page):
    left, top, width, height = page.box("#front-scatter")
    found = None
    for y in np.linspace(0.2, 0.8, 13):
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + 0.5 * width, y=top + y * height)
        if page.value("document.querySelector('#tip').style.display") == "block":
            found = page.value("document.querySelector('#tip').innerText")
            break
    assert found is not None
    number = int(found.split()[1])
    recorded, other = f"view out/study/shards/{number:05d}.mcap --variant 0", f"study play out/study {number}"
    assert f"warpchain {recorded if number % 10 == 1 else other}" in found
    assert "tension_max = " in found and " kN" in found


def test_each_row_of_a_table_has_its_command_and_a_button_that_copies_it(page):
    page.clear()
    page.value("navigator.clipboard.writeText = (words) => { window.copied = words; return Promise.resolve(); }")
    found = page.value(
        "JSON.stringify([...document.querySelectorAll('table.rows, #chosen')].map((t) => [...t.rows].slice(1)"
        ".map((r) => [r.querySelector('td.n').textContent, r.querySelector('td.play code').textContent.trim()])))"
    )
    tables = json.loads(found)
    assert len(tables) >= 4  # designs, front, chosen, ends of the metrics
    for number, command in (row for table in tables for row in table):
        recorded, other = f"view out/study/shards/{int(number):05d}.mcap --variant 0", f"study play out/study {number}"
        assert command == f"warpchain {recorded if int(number) % 10 == 1 else other}"
    page.value("document.querySelector('table.rows td.play button').click()")
    page.settled()
    assert page.value("window.copied") == tables[0][0][1]
    assert page.value("document.querySelector('table.rows td.play button').textContent") == "copied"
    assert page.value("document.querySelectorAll('#chosen td.play button').length") == 15
    page.value("document.querySelector('#more').click()")
    page.settled()
    assert page.value("document.querySelectorAll('#chosen td.play button').length") == 65
    assert page.value("document.querySelectorAll('.design p button').length") >= 1


def test_the_front_is_that_of_the_variants_that_are_kept(page):
    from warpchain.study.analysis.pareto import pareto_front

    page.clear()
    senses = {"tension_max": "min", "contact_energy_per_revolution": "min"}
    front = pareto_front(read_results(study(), ["torque", "x", "law"]), senses)
    # the page has five digits of each value: two that differ less are one
    assert abs(page.value("warpchain.front()") - len(front)) <= 2


def test_it_is_drawn(page):
    page.box("#parallel")
    page.settled()
    pixels = page.picture()
    colored = (np.ptp(pixels, axis=2) > 40).sum()
    assert colored > 5000  # lines of 400 variants; a page without them has some hundred pixels of links


def test_in_print_it_is_a_report_to_hand_on(page):
    """A4 landscape; tables whole and with their heads on every page, charts with their headings, no controls."""
    page.clear()
    page.limit_tension(30)
    data = base64.b64decode(page.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])
    document = pdfium.PdfDocument(data)
    assert all(sheet.get_size() == pytest.approx((841.9, 595.3), abs=1.0) for sheet in document)
    texts = [sheet.get_textpage().get_text_range().split("\r\n") for sheet in document]
    assert 8 <= len(texts) <= 20
    lines = [line.strip() for text in texts for line in text]
    headings = {"Recommended designs", "Pareto front", "Explore the variants", "The chosen variants", "Correlation"}
    assert headings < set(lines)
    for control in ("clear all", "copy", "axes and limits", "save the chosen as CSV", "color by", "across", "up"):
        assert not any(line == control or line.startswith(f"{control} ") for line in lines)
    assert not any("Draw along an axis" in line for line in lines)
    assert "Kept: tension_max at most 30 kN. Red dots are on their Pareto front." in lines
    assert "Play one: warpchain study play out/study VARIANT" in lines
    for text in texts:  # no text squeezed letter under letter, and no heading left alone at a page's end
        assert sum(len(line.strip()) == 1 and line.strip().isalpha() for line in text) < 20
        assert text[-1].strip() not in headings | {"Effects and interactions", "tension_max"}
    for sheet in document:  # no sheet without ink
        assert (np.asarray(sheet.render(scale=0.5).to_pil().convert("L")) < 200).mean() > 0.002
    page.clear()
    assert page.value("getComputedStyle(document.querySelector('#tip')).display") == "none"


LONG = [f"tensioner {part} of the upper blade" for part in ("preload", "stiffness", "indentation", "friction")]


@pytest.mark.long
def test_on_a_phone_nothing_is_beside_the_screen(page, tmp_path):
    """200 rows, 12 factors, 390 px wide: no word of text ends right of the screen, nor in a box that would scroll."""
    random = np.random.default_rng(5)
    names = [*LONG, "law", *(f"factor {k}" for k in range(7))]
    table = {name: random.random(200) for name in names} | {"law": random.choice(["lankarani", "kelvin-voigt"], 200)}
    status = np.where(np.arange(200) % 20 == 0, "suspect", "ok")
    reason = np.where(
        status == "ok", "", "energy_residual 0.2 above 0.05: run.step below 1e-06 s would resolve the contacts"
    )
    table |= {"contact_energy_per_revolution": table["factor 1"] + table["factor 2"], "tension_max": table["factor 3"]}
    table |= {"variant": np.arange(200), "status": status, "reason": reason}
    objectives = (Objective(metric="tension_max"), Objective(metric="contact_energy_per_revolution"))
    wanted = ReportGoals(objectives, (), "out/a-study-with-a-long-name", page="report")
    file = tmp_path / "phone.html"
    notes = {"run": "duration = 0.12, window = [0.06, 0.12]"}
    metrics = ("tension_max", "contact_energy_per_revolution")
    file.write_text(
        study_report_html(read_results(pa.table(table), names), "Phone", metrics, notes=notes, wanted=wanted)
    )
    try:
        page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
        page.value("delete window.warpchain")
        page.browser.open(file.as_uri())
        wait_for(
            lambda: page.value("document.title + (window.warpchain ? document.readyState : '')") == "Phonecomplete"
        )
        page.unfold()
        page.settled()
        assert page.value("document.querySelectorAll('#chosen tr').length") == 16  # a head, and the first 15
        assert page.value("document.scrollingElement.scrollWidth") == 390
        assert page.value(BESIDE) == page.value(CUT) == ""
        assert page.value("getComputedStyle(document.querySelector('#front td'), '::before').content") == '"variant"'
        assert page.value("document.querySelector('#parallel').getBoundingClientRect().width") > 300
        heat = "document.querySelector('#correlation svg')"  # as large as on a desk, in a box that scrolls
        assert page.value(f"{heat}.getBoundingClientRect().width == {heat}.getAttribute('width')")
        assert page.value(f"{heat}.closest('figure').getBoundingClientRect().width") < 390
        rules = "const all = document.styleSheets[0], of = (k) => all.cssRules[k].conditionText || '';"
        phone = "for (let k = all.cssRules.length - 1; k >= 0; k--) if (of(k).includes('max-width')) all.deleteRule(k);"
        page.value(f"(() => {{ {rules} {phone} }})()")
        assert page.value(BESIDE) != ""  # as on a desk, cells are beside the screen
    finally:
        page.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)
