"""Fits of drives with several chains, each as a drive of its own."""

import chains
import pytest
from drives import example

from warpchain.assembly.assembly import assemble_chain
from warpchain.assembly.fitting import fit_angle, fit_links, fit_position
from warpchain.cli import main
from warpchain.drive import load_drive, save_drive
from warpchain.errors import DriveError
from warpchain.model import Model


def strains(drive):
    return [assemble_chain(chain).strain for chain in Model(drive).chains]


def test_a_sprocket_moves_until_its_chain_has_a_strain():
    drive = chains.two_stages()
    x, y = drive.sprockets[3].center
    off = drive.with_values({"sprockets.out.center": [x - 0.003, y]})
    fitted = fit_position(off, "out", (1.0, 0.0), strain=strains(drive)[1])
    assert fitted.sprockets[3].center[0] == pytest.approx(x, abs=1e-8)
    assert strains(fitted)[0] == strains(drive)[0]
    tension = drive.chains[1].mean_stiffness * drive.chains[1].pitch
    taut = fit_position(off, "out", (1.0, 0.0), preload=1e-3 * tension)
    assert strains(taut)[1] == pytest.approx(1e-3, abs=1e-8)


def test_a_sprocket_takes_along_what_is_on_its_shaft():
    drive = chains.two_stages()
    fitted = fit_position(drive, "mid in", (1.0, 0.0), strain=1e-3)
    moved = fitted.sprockets[1].center[0] - drive.sprockets[1].center[0]
    assert moved > 1e-4
    assert fitted.sprockets[2].center == fitted.sprockets[1].center
    assert strains(fitted)[0] == pytest.approx(1e-3, abs=1e-8)
    assert strains(fitted)[1] < strains(drive)[1]


def test_each_chain_has_its_links():
    drive = chains.two_stages()
    wrong = drive.with_values({"chains.first.links": 60, "chains.second.links": 80})
    once = fit_links(wrong, chain="second")
    assert [chain.links for chain in once.chains] == [60, 68]
    assert fit_links(once, chain="first") == drive
    with pytest.raises(DriveError, match=r"^chain: must be named, as there are several; allowed are first, second$"):
        fit_links(drive)
    with pytest.raises(DriveError, match=r'^chain "third": no such name; allowed are first, second$'):
        fit_links(drive, chain="third")
    with pytest.raises(DriveError, match=r"^chains\.second\.links: no even number of links fits"):
        x, y = drive.sprockets[3].center
        fit_links(drive.with_values({"sprockets.out.center": [x - 0.43, y], "chains.second.links": 40}), chain="second")


def test_an_arm_of_one_of_the_chains_of_v6_comes_to_its_angle():
    drive = example("v6")
    fitted = fit_angle(drive, "left cam", (0.0, 1.0), {"left arm": -0.5}, travel=0.005)
    assert fitted.sprockets[3].center != drive.sprockets[3].center
    (left,) = (chain for chain in Model(fitted).chains if chain.name == "left")
    assert assemble_chain(left).arm_angle[0] == pytest.approx(-0.5 * 0.017453292519943295, abs=1e-6)


def test_what_gears_and_couplings_turn_stays_as_it_is():
    """Beside two chains of one shaft, which has gears: the wheel of one of them moves, a rotor on its coupling."""
    drive = example("balance_shafts")
    assert fit_links(drive.with_values({"chains.pump.links": 60}), chain="pump") == drive
    fitted = fit_position(drive, "pump wheel", (0.3, -1.0), strain=1e-3)
    assert strains(fitted) == pytest.approx([strains(drive)[0], 1e-3], abs=1e-8)
    assert (fitted.shafts, fitted.gears, fitted.couplings) == (drive.shafts, drive.gears, drive.couplings)
    assert fitted.sprockets[:3] == drive.sprockets[:3]


def test_the_command_names_the_chain(tmp_path, capsys):
    path = tmp_path / "two.toml"
    save_drive(chains.two_stages().with_values({"chains.second.links": 80}), path)
    path.write_text("# two stages\n" + path.read_text())
    assert main(["fit", str(path), "--links"]) == 2
    assert "--chain: must be given, as there are several chains; allowed are first, second" in capsys.readouterr().err
    moving = ["--sprocket", "out", "--along", "1,0", "--strain", "0"]
    assert main(["fit", str(path), "--links", "--chain", "first", *moving]) == 2
    assert '--chain first: "out" is of the chain "second"' in capsys.readouterr().err
    assert main(["fit", str(path), "--links", "--chain", "first"]) == 0  # which fits; the other does not
    out = capsys.readouterr().out
    assert "first: fit: taut" in out and "LOOK AT second: " in out
    assert main(["fit", str(path), "--links", "--chain", "second"]) == 0
    assert "chains.second.links = 68 (was 80)" in capsys.readouterr().out
    assert path.read_text().startswith("# two stages\n")
    assert load_drive(path) == chains.two_stages()
