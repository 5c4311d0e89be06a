"""The page of a run: what it says of a drive whose answers are known, that it needs nothing else, how it looks."""

import hashlib
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from browsing import browser, no_browser
from command import run as command
from drives import STARTING, two_sprockets
from PIL import Image
from view.html_page import Page

import warpchain
from warpchain import Record, Wear, simulate
from warpchain.errors import SimulationError
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.losses import friction_power_over_speed
from warpchain.view.figures.sweep import run_up_cuts, run_up_orders
from warpchain.view.report import report_tables, run_report_html
from warpchain.view.report.run_report import run_sections

CONTACT = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e8, "friction": 0.1}
RUBBING = {
    "run.settle": False,
    "chain.joint": {"friction": 0.1, "pin_radius": 0.006},
    "contact.guide": CONTACT,
    "contact.sprocket.friction": 0.05,
    "guides": ({"name": "bar", "start": (0.7, 0.1455), "end": (0.3, 0.1455), "end_radius": 0.05},),
    "probes": ({"name": "mid", "at": (0.5, 0.16)},),
}


@pytest.fixture(scope="module")
def run():
    drive = two_sprockets(speed=30.0, duration=0.6, ramp=0.05, load_ramp=0.05, viscous=5.0, step=1e-5)
    return simulate(drive.with_values(RUBBING), device="cpu", window=(0.1, 0.6), record=Record(rate=5000.0))


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "page.html"
    assert warpchain.report(run, path, title="My <drive>", wear=Wear(1e-15, 1e-4)) == path
    return path.read_text()


def test_the_page_needs_nothing_else(page):
    found = Page(page)
    assert "<script" not in page and all(link.startswith(("data:", "#")) for link in found.links)
    assert sum(link.startswith("data:image/svg+xml;base64,") for link in found.links) >= 12
    assert found.ids == [
        "summary", "drive", "tension", "hubs", "timing", "guides", "friction", "safety", "wear", "probes", "absent",
        "metrics",
    ]  # fmt: skip
    assert "Orders over speed: The recording has no" in page  # a run at one speed: said, in place of an empty section
    assert page.count("<nav>") == 1 and sum(link.startswith("#") for link in found.links) <= 12
    assert re.search(r"drive [0-9a-f]{16} \(SHA-256 of its values\)</span> <span>\d{4}-\d\d-\d\d \d\d:\d\d UTC", page)
    assert "driver&nbsp;\u2192&nbsp;driven" in page and " \u2192 " not in page


@pytest.mark.long
def test_a_cycle_of_turns_is_of_drives_where_something_repeats(run):
    """A drive without harmonics has none; where the load swings with the turns, the section and its link are there."""
    swinging = run.drives[0].with_values({"sprockets.driven.load.harmonics": [{"order": 1.0, "amplitude": 50.0}]})
    found = EngineeringReport(run[0], 0.1, 0.6)
    names = [section.name for section in run_sections(found, {}, run)]
    assert "cycle" not in names and all(section.folded for section in run_sections(found, {}, run))
    again = [
        section.name for section in run_sections(EngineeringReport(replace(run[0], drive=swinging), 0.1, 0.6), {}, run)
    ]
    assert again == [*names[:3], "cycle", *names[3:]]


def test_the_page_tells_the_metrics_in_units_of_engineers(run, page):
    row = run.metrics.to_pylist()[0]
    assert f">{1e-3 * row['tension_max']:.4g} kN<" in page
    # every metric with a value stands in a table with its unit; standard errors beside their means
    words = re.sub(r"<wbr>|&gt;", lambda m: {"<wbr>": "", "&gt;": ">"}[m[0]], page)
    for name in ("tension_mean", "driver.hub_force_x_mean", "bar.friction", "bar.pv_max", "driven.phase_mean",
                 "driver->driven.slack_time", "mid.tension_mean", "elongation_per_hour"):  # fmt: skip
        assert f"<td>{name}</td>" in words, name
    assert "tension_mean_se" not in words and ">unknown<" in words  # a short window
    assert "nan" not in re.sub(r"base64,[^\"]*", "", words)


def test_friction_in_the_frames_is_that_of_every_step(run):
    row, found = run.metrics.to_pylist()[0], EngineeringReport(run[0], 0.1, 0.6)
    inside = run[0].time >= 0.1
    # 2,500 frames of 50,000 steps; teeth rub in short bursts
    for name, tolerance in (("joints", 0.02), ("bar", 0.02), ("driver", 0.2), ("driven", 0.2)):
        assert found.friction_power[name][inside].mean() == pytest.approx(
            row[f"{name}.friction"] / 0.5, rel=tolerance
        ), name


def test_wear_of_a_chain_that_goes_around_two_sprockets(run):
    # each joint bends by 2 pi / z and back on either sprocket, four times a round, besides what the strands sway
    found = EngineeringReport(run[0], 0.1, 0.6, Wear(1e-15, 1e-4))
    drive = run.drives[0]
    turned = run[0].sprocket_angle[-1, 0] - run[0].sprocket_angle[run[0].time >= 0.1][0, 0]
    rounds = turned / (2.0 * np.pi) * 20 / drive.chain.links
    least = 0.006 * rounds * 4 * 2.0 * np.pi / 20
    distance = found.joint_wear.distance.mean()
    assert 0.98 * least < distance < 3.0 * least  # this chain's strands sway much
    # elongation of Archard's law from what the metrics say
    metrics = found.metrics()
    rate = metrics["joints.loaded_sliding"] * 1e-15 / (1e-4 * 0.05) * 3600.0
    assert metrics["elongation_per_hour"] == pytest.approx(rate, rel=1e-9)
    # the friction that the kernels add up is mu kappa of the same
    row = run.metrics.to_pylist()[0]
    work = row["joints.friction"] / 0.5 / drive.chain.links
    assert metrics["joints.friction_each"] == pytest.approx(work, rel=0.03)


def test_a_page_by_the_command_line(run, page, tmp_path, capsys):
    warpchain.write_archive(run, tmp_path / "run.mcap")
    words = ["--title", "My <drive>", "--wear-coefficient", "1e-15", "--bearing-area", "1e-4"]
    done = command(capsys, "report", tmp_path / "run.mcap", "-o", tmp_path / "a.html", *words)
    assert done == (0, [str(tmp_path / "a.html")], [])
    assert "<h1>My &lt;drive&gt;</h1>" in page
    archive = hashlib.sha256((tmp_path / "run.mcap").read_bytes()).hexdigest()[:16]
    text = (tmp_path / "a.html").read_text().replace(f"<span>run.mcap (SHA-256 {archive})</span> ", "")
    assert text == page  # of the archive as of the run


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--variant", "3"], "variant 3 was not recorded (recorded: 0)"),
        (["--wear-coefficient", "0"], "wear.coefficient = 0.0: must be a finite number above 0"),
        (["--bearing-area=-1"], "wear.bearing_area = -1.0: must be a finite number above 0"),
    ],
)
def test_mistakes_take_a_line(run, tmp_path, capsys, words, line):
    warpchain.write_archive(run, tmp_path / "run.mcap")
    done = command(capsys, "report", tmp_path / "run.mcap", "-o", tmp_path / "a.html", *words)
    assert done == (2, [], [f"warpchain: error: {line}"])
    assert not (tmp_path / "a.html").exists()


def test_a_page_is_not_named_as_another_kind_of_file(tmp_path, capsys):
    for words in (["report", tmp_path / "run.mcap"], ["study", "report", tmp_path]):
        status, out, (line,) = command(capsys, *words, "-o", tmp_path / "a.pdf")
        assert (status, out) == (2, [])
        assert f"argument -o/--output: '{tmp_path / 'a.pdf'}': must end in .html, .htm" in line


def test_what_was_not_recorded_is_said_in_its_place():
    drive = two_sprockets(duration=0.05)
    needed = ("position", "tension", "sprocket_force", "guide_force", "sprocket_angle", "sprocket_center")
    run = simulate(drive, device="cpu", record=Record(rate=5000.0, channels=needed))
    page = run_report_html(run)
    assert Page(page).ids[-1] == "metrics"
    assert "Nothing rubs in this drive." in page and "no pin radius" in page
    with pytest.raises(SimulationError, match="recorded without position"):
        run_report_html(simulate(drive, device="cpu", record=Record(channels=["tension"])))


@pytest.mark.long
def test_friction_over_the_speeds_of_variants(run):
    base = run.drives[0]
    drives = [base.with_values({"sprockets.driver.prescribed.speed": speed, "run.duration": 0.2})
              for speed in (30.0, 10.0, 20.0)]  # fmt: skip
    swept = simulate(drives, device="cpu", record=Record(variants=[0], rate=2000.0), limits=STARTING)
    speed, groups = friction_power_over_speed(swept)
    np.testing.assert_allclose(speed, [10.0, 20.0, 30.0], rtol=1e-6)
    assert list(groups) == ["joints", "guides", "teeth"]
    rows = swept.metrics.to_pylist()
    each = [rows[v]["joints.friction"] / (rows[v]["window_end"] - rows[v]["window_start"]) for v in (1, 2, 0)]
    np.testing.assert_allclose(groups["joints"], each, rtol=1e-12)
    assert "All variants of the run" in run_report_html(swept)
    assert friction_power_over_speed(run) is None
    elsewhere = {"prescribed": base.sprockets[0].prescribed, "load": None}
    led = {f"sprockets.driven.{key}": value for key, value in elsewhere.items()}
    other = base.with_values(led | {"sprockets.driver.prescribed": None, "sprockets.driver.inertia": 2.0})
    assert friction_power_over_speed(replace(swept, drives=[*swept.drives[:2], other])) is None


def test_a_run_up_is_cut_by_orders():
    drive = two_sprockets(duration=1.6, load_ramp=0.02, viscous=5.0, step=2e-5).with_values(
        {
            "sprockets.driver.prescribed": {
                "table": {"time": [0.0, 0.1, 1.6], "speed": [60.0, 60.0, 160.0]},
                "harmonics": [{"order": 2.0, "amplitude": 0.01}],
            }
        }
    )
    assert run_up_orders(drive) == [0.5, 2.0, 4.0, 20.0]  # what is excited, two that are usual, tooth passing
    found = run_up_cuts(EngineeringReport(simulate(drive, device="cpu", record=Record(rate=5000.0))[0]))
    unit, speeds = found["speed of the shaft"]
    cuts = speeds["driver"]
    assert unit == "rad/s" and len(cuts.speed) >= 6
    at = list(cuts.orders).index(2.0)
    # the driver's speed sways by a hundredth at order 2: the mean of a block, over which the speed rises
    np.testing.assert_allclose(cuts.amplitude[:, at], 0.01 * cuts.speed, rtol=0.03)


@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
def test_the_page_in_a_browser(page, tmp_path):
    """Short as it opens, nothing beside the screen, figures at full size at a click, dark where that is preferred."""
    (tmp_path / "page.html").write_text(page)
    with browser() as shown:
        for width in (1280, 390):
            shown.resize(width, 900)
            shown.open((tmp_path / "page.html").as_uri())
            assert shown.reaches("document.readyState", "complete")
            assert shown.value("document.documentElement.scrollHeight") <= 6000
            shown.value(
                "document.querySelectorAll('section > details:not(.figure)').forEach((part) => { part.open = true; })"
            )
            assert shown.value("document.scrollingElement.scrollWidth") == width
            assert shown.value("[...document.querySelectorAll('section')].every((s) => s.innerText.length > 20)")
        image = "document.querySelector('details.figure img').getBoundingClientRect().width"
        assert shown.value(image) == 640  # legible, and the box scrolls
        assert shown.value("document.querySelector('details.figure summary').getBoundingClientRect().width") < 390
        shown.value("document.querySelectorAll('#metrics details').forEach((part) => { part.open = true; })")
        table = "document.querySelector('#metrics table')"
        assert shown.value(f"{table}.getBoundingClientRect().width") > 390
        assert shown.value(f"{table}.parentElement.getBoundingClientRect().width") < 390
        assert shown.value("document.scrollingElement.scrollWidth") == 390
        name = f"{table}.querySelector('td').getBoundingClientRect()"
        assert shown.value(f"{name}.width") < 160
        shown.value(f"{table}.parentElement.scrollLeft = 100")
        assert shown.value(f"{name}.left >= {table}.parentElement.getBoundingClientRect().left")  # names stay
        shown.value("document.querySelector('details.figure summary').click()")
        assert shown.value(image) == float(re.search(r'width="(\d+)"', page)[1]) > 390
        assert shown.value("document.scrollingElement.scrollWidth") == 390
        shown.value("document.querySelector('details.figure summary').click()")
        assert shown.value(image) == 640
        grounds = []
        for scheme in ("light", "dark"):
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            shown.call("Emulation.setEmulatedMedia", shown._session, features=features)
            shown.value("scrollTo(0, document.querySelector('#drive').offsetTop + 300)")
            shown.value("new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(f)))")
            shown.capture(tmp_path / "page.png")
            grounds.append(np.asarray(Image.open(tmp_path / "page.png").convert("L")))
        # most of the screen, figure and page alike, is nearly white, then nearly black; words are on it in the other
        assert (grounds[0] > 240).mean() > 0.6 and (grounds[0] < 60).mean() > 0.002
        assert (grounds[1] < 60).mean() > 0.6 and (grounds[1] > 200).mean() > 0.002


def test_only_motions_cover_a_distance_and_each_value_has_its_own_prefix():
    """A moment that swings by 2 N m has no distance in a second; 1.049 W beside 2 kW stays 1.049 W."""
    time = np.linspace(0.0, 1.0, 101)
    swing = np.sin(20.0 * time)[:, None]
    found = SimpleNamespace(part=SimpleNamespace(time=time), whole=SimpleNamespace(time=time), start=0.0, end=1.0)
    page = report_tables.body_motion_table(found, {"moment": ("N m", swing), "angle": ("rad", swing)}, 0)
    moment, angle = (line for line in page.split("<tr>") if "moment" in line or "angle" in line)
    assert "\u2013" in moment and "\u2013" not in angle
    found.friction_power = {"small": np.full(101, 1.049), "large": np.full(101, 2e3)}
    page = report_tables.friction_power_table(found, {})
    assert "1.049 W" in page and "2 kW" in page


def test_a_margin_is_at_most_the_whole_climb():
    """A roller that its contact lets sink below the seat still has all of the climb before it: 100 %, not 103 %."""
    assert [report_tables.climb_share_text(margin) for margin in (1.03, 0.4567, 0.0)] == ["100 %", "45.7 %", "0 %"]
