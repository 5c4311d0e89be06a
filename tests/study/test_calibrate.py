"""Calibration: closed forms of the posterior, simulation-based calibration, files of signals, and the command."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from browsing import BESIDE, CUT, browser, no_browser
from command import refused, run
from scipy.stats import chisquare
from study_helpers import write_study

from warpchain import load_drive, simulate
from warpchain.errors import StudyError
from warpchain.results.measured import signal_source, signal_sources, signal_units
from warpchain.results.run import Record
from warpchain.results.signal_features import SignalFeatures
from warpchain.study.analysis.posterior import (
    posterior_directions,
    rank_of_value,
    sample_posterior,
    standardized_residuals,
)
from warpchain.study.optimize.calibrate import NumberEmulators, calibrate
from warpchain.study.report.calibration_page import write_calibration_page
from warpchain.study.store import read_table

MATRIX = np.array(
    [[1.0, 1.0], [0.5, 0.5], [0.2, 0.2]]
)  # tells the sum of two unknowns, and nothing of their difference
ERRORS = np.array([0.3, 0.2, 0.4])
CASES, BELOW = 200, 99


def linear(u):
    return u @ MATRIX.T, np.zeros((len(u), 3))


def test_posterior_of_a_linear_model_is_normal_in_closed_form():
    """Covariance (I + A' E^-1 A)^-1, mean C A' E^-1 y; 4,000 samples know both to some 0.02."""
    values = np.array([1.2, 0.5, 0.1])
    found = sample_posterior(linear, values, ERRORS, 2, 3, enough=4000)
    weighted = MATRIX.T / ERRORS**2
    covariance = np.linalg.inv(np.eye(2) + weighted @ MATRIX)
    assert found.sample_mean == pytest.approx(covariance @ weighted @ values, abs=0.06)
    assert np.cov(found.u, rowvar=False) == pytest.approx(covariance, abs=0.06)
    worst, best = posterior_directions(found.u)
    assert abs(worst.weights) == pytest.approx([np.sqrt(0.5)] * 2, abs=0.05)
    assert worst.weights[0] * worst.weights[1] < 0.0  # one up with the other down is not told
    assert worst.left == pytest.approx(1.0, abs=0.06)
    assert best.left == pytest.approx(np.sqrt(1.0 / (1.0 + 2.0 * (weighted @ MATRIX)[0, 0])), rel=0.1)
    assert np.abs(standardized_residuals(linear, values, ERRORS, found.u)).max() < 1.5
    assert standardized_residuals(linear, values + [0.0, 0.0, 4.0], ERRORS, found.u)[2] > 5.0


def numbers(u):
    """Three numbers of two unknowns, curved and with an interaction."""
    x, y = u.T
    return np.stack([x + 0.5 * y, np.exp(0.3 * x) + 0.2 * y**2, 0.3 * x * y + y], axis=1)


def ranks(model, stated=1.0, cases=CASES):
    """Ranks (cases, 2) of values drawn from the prior among samples of their posteriors, at errors times `stated`."""
    rng, found = np.random.default_rng(1), []
    for case in range(cases):
        true = rng.standard_normal((1, 2))
        values = numbers(true)[0] + ERRORS * rng.standard_normal(3)
        samples = sample_posterior(model, values, stated * ERRORS, 2, case, enough=200).u
        samples = samples[rng.choice(len(samples), BELOW, replace=False)]
        found.append([rank_of_value(samples[:, d], true[0, d]) for d in range(2)])
    return np.array(found)


def uniform(found):
    """p of ranks in ten bins, by chi square; the least of both unknowns."""
    return min(chisquare(np.bincount(column * 10 // (BELOW + 1), minlength=10)).pvalue for column in found.T)


def known(u):
    return numbers(u), np.zeros((len(u), 3))


def emulated(u):
    return processes()(u)


@cache
def processes():
    u = np.random.default_rng(0).standard_normal((60, 2))
    return NumberEmulators(u, numbers(u), ["a", "b", "c"])


@pytest.mark.long
@pytest.mark.parametrize("model", [known, pytest.param(emulated, marks=pytest.mark.thorough)])
def test_ranks_of_true_values_are_uniform_over_200_cases(model):
    """Simulation-based calibration (Talts et al. 2018): of the model itself, and of Gaussian processes of 60 runs.

    p below 0.005 comes of chance in one of 100 tests of two unknowns; the seeds are fixed.
    """
    assert uniform(ranks(model)) > 0.005


@pytest.mark.long
def test_errors_stated_too_small_show_in_the_ranks():
    """Posteriors that are far narrower than they should be leave true values outside: ranks pile up at both ends."""
    assert uniform(ranks(known, stated=0.3, cases=50)) < 1e-6


def test_features_of_a_sine_are_its_closed_form():
    """Mean, deviation a / sqrt 2, amplitude a on a line; in a band a / sqrt 2; white noise s sqrt(band / Nyquist)."""
    time = np.arange(4000) / 2000.0
    values = 3.0 + 2.0 * np.sin(2.0 * np.pi * 40.0 * time)
    values += 0.5 * np.random.default_rng(0).standard_normal(len(time))
    features = SignalFeatures(("mean", "std"), (4.0,), ((20.0, 60.0), (100.0, 500.0), (0.0, 5000.0)))
    assert features.names == ("mean", "std", "order 4", "20 to 60 Hz", "100 to 500 Hz", "0 to 5000 Hz")
    found = features.values_of_signal(time, values, 10.0)
    noise = 0.5 * np.sqrt(0.4)
    expected = [3.0, np.hypot(np.sqrt(2.0), 0.5), 2.0, np.hypot(np.sqrt(2.0), 0.5 * np.sqrt(0.04)), noise]
    assert found[:5] == pytest.approx(expected, rel=0.04)  # noise in 800 lines: 1 / sqrt(2 * 800) = 2.5 %
    assert np.isnan(found[5])  # beyond half the sampling rate
    assert 0.0 < features.standard_errors(time, values, 10.0)[0] < 0.05
    assert np.isnan(features.values_of_signal(time[:4], values[:4], 10.0)).all()


CALIBRATION = """
[study]
drive = "tiny.toml"

[design]
kind = "noise"

[limits]
energy_residual = inf
energy_change = inf

[run]
duration = 0.02
window = [0.01, 0.02]
step = 1e-5

[record]
rate = 20000.0

[[factors]]
name = "torque"
kind = "noise"
path = "sprockets.s1.load.torque"
range = [0.0, 20.0]
unit = "N m"

[[factors]]
name = "gap"
kind = "noise"
path = "contact.sprocket.friction"
distribution = "normal"
mean = 0.1
std = 1e-6

[[measured]]
signal = "s1->s0.tension"
file = "rig.csv"
statistics = ["mean"]
relative_error = 0.01

[[measured]]
metric = "s1->s0.tension_q50"
value = {value}
error = 1.0

[calibrate]
count = 12
batch = 4
rounds = 1
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A calibration's file, what it found, and the run that stands for its rig, of 6 N m."""
    folder = tmp_path_factory.mktemp("calibrate")
    path = write_study(folder, text=CALIBRATION.replace("{value}", "1.0"))
    true = load_drive(folder / "tiny.toml").with_values(
        {"sprockets.s1.load.torque": 6.0, "run.duration": 0.02, "run.step": 1e-5, "run.sample_rate": 20000.0}
    )
    rig = simulate([true], record=Record([0]), window=(0.01, 0.02))
    signal = signal_source(rig[0], "s1->s0.tension")
    late = rig[0].time >= 0.01
    rows = zip(rig[0].time[late], signal.values()[late], strict=True)
    (folder / "rig.csv").write_text("time [s],F [N]\n" + "".join(f"{t:.9g},{f:.9g}\n" for t, f in rows))
    median = rig.metrics["s1->s0.tension_q50"][0].as_py()
    path.write_text(path.read_text().replace("value = 1.0", f"value = {median!r}"))
    return path, calibrate(path, folder / "out"), rig[0]


def test_a_run_that_stands_for_the_rig_gives_its_torque_back(calibrated, capsys):
    """The tight strand carries torque / radius; what has no effect keeps its prior, and a second call runs nothing."""
    path, found, rig = calibrated
    torque, gap = (found.values[name] for name in ("torque", "gap"))
    assert abs(torque.mean() - 6.0) < 3.0 * torque.std()
    assert torque.std() < 0.2 * found.values_before["torque"].std()
    assert gap.std() == pytest.approx(1e-6, rel=0.2)
    assert found.directions[0].left == pytest.approx(1.0, abs=0.2) and found.directions[1].left < 0.2
    assert load_drive(found.drive).get_value("sprockets.s1.load.torque") == pytest.approx(
        torque.mean(), abs=torque.std()
    )
    assert {f"{name}.{unit}" for name, unit in signal_units(load_drive(path.parent / "tiny.toml")).items()} == {
        f"{name}.{of.unit}" for name, of in signal_sources(rig).items()
    }
    said = []
    again = calibrate(path, found.folder, progress=lambda *_: pytest.fail("ran again"), report=said.append)
    assert said[0].endswith(f" runs at first, {len(found.results.status)} in all")
    assert again.values["torque"] == pytest.approx(torque, rel=1e-12)
    status, out, err = run(capsys, "calibrate", path, "-o", found.folder, "--quiet")
    assert (status, err) == (0, [])
    assert "not identified by the measurements: gap up, which keeps" in "\n".join(out)
    page = (found.folder / "calibration.html").read_text()
    for name in ("unknowns", "fit", "signals", "open", "predictions", "course"):
        assert f'<section id="{name}">' in page
    assert re.search(r"gap</td>(<td.*?</td>){1,2}?<td>0\.09999\d+ to 0\.10000\d+</td>", page)
    posterior = read_table(found.folder / "posterior.csv")
    assert posterior.column_names == ["torque", "gap"] and posterior.num_rows == len(torque)


@pytest.mark.viewer
@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_opens_without_errors_and_cuts_no_name_off(calibrated, width):
    """Names of 64 characters beside and above their rows; on a phone nothing ends right of the screen.

    Pictures: two of unknowns, the fit, trace and spectrum, two of what is open, one of the predicted metric.
    """
    found = calibrated[1]
    names = ("left blade", "right blade")
    long = tuple(
        replace(number, name=f"tensioner of the {name}->balance shaft of the front: {k} to 350 Hz")
        for k, (name, number) in enumerate(zip(names, found.numbers, strict=True))
    )
    with browser() as page:
        page.note_faults()
        page.resize(width, 844)
        page.open(write_calibration_page(replace(found, numbers=long)).as_uri())
        assert page.reaches("document.readyState == 'complete' && document.querySelectorAll('svg').length", 8)
        assert page.value("JSON.stringify(faults)") == "[]"
        assert page.value("document.scrollingElement.scrollWidth") == width
        assert page.value(BESIDE) == page.value(CUT) == ""
        drawn = "[...document.querySelectorAll('svg')].every((e) => e.querySelector('polyline, rect, circle, path'))"
        assert page.value(drawn)
        for name in (number.name for number in long):
            assert page.value(f"[...document.querySelectorAll('#fit text')].some((e) => e.textContent == '{name}')")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'signal = "s1->s0.tension"',
            'signal = "s1->s9.tension"',
            'measurement 1: signal = "s1->s9.tension": no such signal',
        ),
        (
            'metric = "s1->s0.tension_q50"',
            'metric = "tension_q51"',
            'measurement 2: metric = "tension_q51": no such metric',
        ),
        ("relative_error = 0.01", "", 'measurement of "s1->s0.tension": error: give either error or relative_error'),
        (
            'statistics = ["mean"]',
            'statistics = ["median"]',
            'measurement of "s1->s0.tension": statistics = ["median"]: must be a list of "mean"',
        ),
        (
            'statistics = ["mean"]',
            "bands = [[2.0, 1.0]]",
            'measurement of "s1->s0.tension": value 1 of bands = [2.0, 1.0]',
        ),
        ("value = {value}", "", 'measurement of "s1->s0.tension_q50": value: missing'),
        ("range = [0.0, 20.0]", "levels = [1.0, 2.0]", "an unknown needs a continuous distribution"),
        ('kind = "noise"\n\n[limits]', 'kind = "noise"\nreplicates = 2\n\n[limits]', "not together with measured"),
        (
            "std = 1e-6",
            "std = 1e-18",
            "factors.1.std: the standard deviation of gap is 0: must be above 1e-10, 1e-09 of its largest value",
        ),
        ("range = [0.0, 20.0]", "range = [5.0, 5.0000000001]", "factors.0.range: the standard deviation of torque is"),
        (
            "range = [0.0, 20.0]",
            'distribution = "empirical"\nsample = [5.0, 5.0000000001]',
            "factors.0.sample: the standard deviation of torque is 5e-11: must be",
        ),
        ("count = 12", "count = 2", "calibrate.count = 2: must be an integer from 8 to 1000"),
        ("count = 12", "count = 1001", "calibrate.count = 1001: must be an integer from 8 to 1000"),
        ('file = "rig.csv"', 'file = "none.csv"', "none.csv: "),
        ('file = "rig.csv"', 'file = "rig.csv"\nunit = "rpm"', "s1->s0.tension is in N; give unit"),
        (
            'file = "rig.csv"',
            'file = "rig.csv"\ndecimal = "x"',
            'measurement of "s1->s0.tension": decimal = "x": must be "." or ","',
        ),
        ('file = "rig.csv"', 'file = "mixed.csv"', "points and commas; give decimal , or ."),
        ('file = "rig.csv"', 'file = "twice.csv"', "'F' names the columns #2, F [N] and #3, F [kN]: give column '#2'"),
    ],
)
def test_mistakes_are_said_in_a_line(tmp_path, capsys, old, new, words):
    (tmp_path / "rig.csv").write_text("time,F\n0,1\n1,1\n")
    (tmp_path / "mixed.csv").write_text("time;F\n0,5;1.249\n1;1\n")
    (tmp_path / "twice.csv").write_text("time,F [N],F [kN]\n0,1,1\n1,1,1\n")
    assert old in CALIBRATION
    path = write_study(tmp_path, text=CALIBRATION.replace(old, new).replace("{value}", "100.0"))
    assert words in refused(capsys, "calibrate", path, "-o", tmp_path / "out")


def test_a_study_without_measurements_is_refused(tmp_path):
    with pytest.raises(StudyError, match="measured: missing"):
        calibrate(write_study(tmp_path), tmp_path / "out")
