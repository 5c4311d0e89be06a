"""Keeping a drive assembled: the solved place or number of links has the wanted strain, or says why there is none."""

import math

import pytest
from command import refused, run
from drives import example
from layouts import PITCH, Placed, drive_of
from study_helpers import LIMITS, STUDY, write_study

from warpchain.assembly import assemble
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.fitting import nearest_links
from warpchain.errors import StudyError, WarpchainError
from warpchain.model import single_chain
from warpchain.study.run.row_drives import adjusted_drives
from warpchain.study.spec.study_tables import Adjust


def pair(span, teeth=12):
    """Two equal sprockets: half of each is wrapped, each strand has span / (pitch (1 + strain)) links."""
    return drive_of([Placed(teeth, (0.0, 0.0)), Placed(teeth, (span, 0.0))], 44)


def adjusted(drive, adjust, row):
    (found,) = adjusted_drives([drive], [adjust], [row])
    if isinstance(found, Exception):
        raise found
    return found


@pytest.mark.parametrize("strain", [0.0, 2e-3, -0.02, 0.04])
def test_place_of_a_pair_is_the_closed_form(strain):
    # 2 span = (44 - 12) pitch (1 + strain): seats lie on the pitch circles, strands from seat to seat
    adjust = Adjust(sprocket="s1", direction=(3.0, 0.0), strain=strain, travel=PITCH)
    drive, done = adjusted(pair(0.2), adjust, {})
    assert drive.sprockets[1].center[0] == pytest.approx(16 * PITCH * (1.0 + strain), abs=1e-9)
    assert done["adjusted_travel"] == pytest.approx(16 * PITCH * (1.0 + strain) - 0.2, abs=1e-9)
    assert drive.sprockets[1].center[1] == 0.0
    assert assemble(drive).strain == pytest.approx(strain, abs=1e-9)


@pytest.mark.parametrize("teeth", [19, 24, 25, 30, 33, 41])
def test_marine_tightener_takes_other_wheels(teeth):
    base = example("marine")
    force = base.chain.stiffness * base.chain.pitch
    drive = base.with_values({"sprockets.tightener.teeth": teeth})
    adjust = Adjust(sprocket="tightener", direction=(1.0, -0.2), links="even", preload="2 * half")
    moved, done = adjusted(drive, adjust, {"half": 2500.0})
    assert assemble(moved).strain * force == pytest.approx(5000.0, rel=1e-3)  # 1e-9 of strain are 0.2 N
    assert moved.chain.links == done["adjusted_links"] and moved.chain.links % 2 == 0
    assert abs(done["adjusted_travel"]) <= 4 * base.chain.pitch


@pytest.mark.parametrize(
    ("span", "odd", "strain", "links"),
    [
        *((16.2, odd, 0.0, 44) for odd in (True, False)),
        *((16.4, odd, 0.0, links) for odd, links in ((True, 45), (False, 44))),
        (16.9, False, 0.0, 46),
        (16.4, True, 0.05, 43),  # (44.8 - 12) / (1 + 0.05) = 31.2 free links: 43 are nearer than 44
    ],
)
def test_number_of_links_is_the_nearest_for_the_wanted_strain(span, odd, strain, links):
    assert nearest_links(chain_path(single_chain(pair(span * PITCH))), strain, odd)[0] == links


def test_what_cannot_be_reached_is_told_with_what_can():
    adjust = Adjust(sprocket="s1", direction=(1.0, 0.0), strain=0.02, travel=0.001)
    with pytest.raises(StudyError) as caught:
        adjusted(pair(0.2), adjust, {})
    # strains of 2 span / (32 pitch) - 1 at both ends of the travel
    low, high = (2 * (0.2 + d) / (32 * PITCH) - 1 for d in (-0.001, 0.001))
    assert str(caught.value) == (
        'adjust: sprocket "s1": no place along [1.0, 0.0] within 0.001 m gives strain 0.02; '
        f"it can have {low:.4g} to {high:.4g}, moved by -0.001 to +0.001 m"
    )
    with pytest.raises(StudyError, match=r"within 0.001 m .* nowhere on the line does a chain of 44 links fit"):
        adjusted(pair(0.2, teeth=200), adjust, {})


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        ({"strain": "1 / x"}, 'adjust.strain = "1 / x": division by zero'),
        ({"strain": 0.2}, "adjust.strain = 0.2: a strain of 0.2; allowed is within 0.05"),
        ({"preload": "x - 1"}, "adjust.preload = -1: a strain of -7.87402e-06; allowed is within 0.05"),
        ({"preload": "x > 0"}, 'adjust.preload = "x > 0": false is not a finite number'),
    ],
)
def test_a_wanted_strain_without_sense_is_told(asked, text):
    with pytest.raises(StudyError) as caught:
        adjusted(pair(0.2), Adjust(links="any", **asked), {"x": 0})
    assert str(caught.value) == text


def test_strain_of_a_preload_is_preload_over_stiffness_and_pitch():
    drive, _ = adjusted(pair(0.2), Adjust(sprocket="s1", direction=(1.0, 0.0), preload=127.0), {})
    assert assemble(drive).strain == pytest.approx(127.0 / (1e7 * PITCH), abs=1e-9)
    assert math.isclose(drive.sprockets[1].center[0], 16 * PITCH * 1.001, abs_tol=1e-9)


def test_what_was_adjusted_is_shown_and_can_be_limited(tmp_path, capsys):
    """Strands of (links - 12) / 2 pitches of 12.7 mm without strain: 203.2 mm of 44 links, 209.55 of 45, drawn 200."""
    more = '[adjust]\nsprocket = "s1"\ndirection = [1.0, 0.0]\nstrain = 0.0\n[[objectives]]\nmetric = "tension_max"\n'
    text = STUDY.replace(LIMITS, f'{LIMITS}[[limits]]\nmetric = "adjusted_travel"\nmin = "5 mm"\n').replace(
        LIMITS, f"[[limits]]{LIMITS.removeprefix('[limits]')}"
    )
    path, out, page = write_study(tmp_path, more, 2, text=text), tmp_path / "out", tmp_path / "page.html"
    assert run(capsys, "study", "run", path, "-o", out)[0] == 0
    assert run(capsys, "study", "report", out, "-o", page)[0] == 0
    assert "[adjust] chose adjusted_travel 9.5" in page.read_text()
    assert "adjusted_travel at least 5 mm" in page.read_text()
    links = write_study(
        tmp_path, more, 2, text=text.replace("adjusted_travel", "adjusted_links").replace('"5 mm"', "5")
    )
    assert '"adjusted_links": no such metric' in refused(capsys, "study", "run", links, "-o", tmp_path / "links")


@pytest.mark.parametrize("links", [None, "even", "any"])
def test_rows_adjusted_together_are_adjusted_as_if_alone(links):
    """Rows of all outcomes: first or second number of links, none within the travel, a wish without a value."""
    adjust = Adjust(sprocket="s1", direction=(1.0, 0.0), strain="x / y", travel=0.4 * PITCH, links=links)
    drives = [pair((16.0 + 0.15 * v) * PITCH) for v in range(10)] + [pair(1e-3)]
    rows = [{"x": 1e-4 * v, "y": float(v != 4)} for v in range(11)]
    together = adjusted_drives(drives, [adjust], rows)
    for drive, row, found in zip(drives, rows, together, strict=True):
        if isinstance(found, WarpchainError):
            with pytest.raises(type(found)) as caught:
                adjusted(drive, adjust, row)
            assert str(caught.value) == str(found)
        else:
            assert found == adjusted(drive, adjust, row)
    assert 2 <= sum(isinstance(found, WarpchainError) for found in together) < 9
