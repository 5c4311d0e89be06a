"""A plug-in's contact law: its closed form, its place in kernels of both kinds, and what is refused."""

import math
import re

import numpy as np
import pytest
import warp as wp
from bouncing import KINDS, bounce
from command import refused
from drives import two_sprockets
from own_files import LAW, write_plugin
from ptx import compiled

from warpchain import load_plugin, simulate
from warpchain.drive import dumps_drive
from warpchain.drive.stiffness import rebound_ratio
from warpchain.engine.own_laws import added_laws
from warpchain.engine.pack import pack
from warpchain.errors import DriveError, PluginError
from warpchain.kernels.cpu.advance import advance_kernel
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BlockKind, BlockShape, Parts
from warpchain.results.channels import DEFAULT_FRAME
from warpchain.results.schedule import Schedule

pytestmark = [
    pytest.mark.usefixtures("own_plugins"),
    pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning"),
]
MASS, STIFFNESS, SPEED = 1.0, 2e8, 0.7
SHORT = {"step": 1e-5, "duration": 0.01}


def own_drive(e=0.5, law="approach"):
    """Two sprockets whose contacts have the law."""
    values = {"law": law, "restitution": e, "exponent": 1.0}
    return two_sprockets(mass=MASS, contact=STIFFNESS).with_values(
        {f"contact.sprocket.{key}": value for key, value in values.items()}
    )


def closed_form(e):
    """Comes back with omega x / v0, x where it turned: exp(-zeta arccos(zeta) / sqrt(1 - zeta^2))."""
    zeta = -math.log(e) / math.hypot(math.pi, math.log(e))
    return math.exp(-zeta * math.acos(zeta) / math.sqrt(1.0 - zeta * zeta))


def rebound_on(device, e):
    """Rebound of one free mass against the law, stepped by the kernels' contact at 5e-5 of sqrt(m / K)."""
    row = pack([own_drive(e)], [Schedule(1e-6, 1, 0, 1, 0)]).sprockets[0]["law"]
    law = KINDS.ContactLaw()
    for name in row.dtype.names:
        setattr(law, name, row[name].item())
    law.speed_floor, law.lag, law.yielding = 1e-9, 0.0, 0.0
    out = wp.zeros(3, dtype=wp.float64, device=device)
    kernel = wp.kernel(bounce.func, enable_backward=False, module="unique")
    step = 5e-5 * math.sqrt(MASS / STIFFNESS)
    wp.launch(kernel, dim=1, inputs=[law, MASS, SPEED, step, out], device=device)
    return out.numpy()[0] / SPEED


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_an_own_law_rebounds_by_its_closed_form(tmp_path, device):
    # midpoint steps of 5e-5 of the contact's time: the last step's overshoot is of that order
    load_plugin(write_plugin(tmp_path, LAW))
    for e in (0.3, 0.8):
        assert rebound_ratio(e, "approach") == pytest.approx(closed_form(e), rel=1e-9)
        assert rebound_on(device, e) == pytest.approx(closed_form(e), abs=2e-4)


@pytest.mark.long
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_a_run_with_an_own_law_leaves_the_bits_of_others(tmp_path, device):
    others = [own_drive(law=law) for law in ("flores", "kelvin-voigt")]
    before = simulate(others, device=device, **SHORT)
    load_plugin(write_plugin(tmp_path, LAW))
    run = simulate([*others, own_drive()], device=device, **SHORT)
    for v in range(2):
        np.testing.assert_array_equal(run[v].position, before[v].position)
        assert abs(run[v].position - run[2].position).max() > 1e-9
    assert abs(run.metrics["energy_residual_relative"][2].as_py()) < 2e-2


def test_kernels_are_told_apart_by_the_whole_file_of_a_law(tmp_path):
    plain = advance_kernel(wp.float64, 264, DEFAULT_FRAME, False).module.made_of
    found = set()
    for name, text in (("a.py", LAW), ("b.py", LAW.replace("return type(x)(0.0)", "return type(x)(1e-9)"))):
        load_plugin(write_plugin(tmp_path, text.replace('"approach"', f'"{name[0]}"'), name))
        pack([own_drive(law=name[0])], [Schedule(1e-6, 1, 0, 1, 0)])
        found.add(advance_kernel(wp.float64, 264, DEFAULT_FRAME, False).module.made_of)
    assert len(found | {plain}) == 3
    assert added_laws() == ("a", "b")


@pytest.mark.long
def test_cuda_compiles_an_own_law(tmp_path):
    load_plugin(write_plugin(tmp_path, LAW))
    pack([own_drive()], [Schedule(1e-6, 1, 0, 1, 0)])
    kernel = block_kernel(BlockKind(wp.float64, BlockShape(32, 4), Parts(2, 1)), 4, DEFAULT_FRAME)
    assert ".entry" in compiled(kernel, tmp_path, arch=90)


REFUSED = {
    "two values": (
        "return damping, none_of(elastic), type(elastic)(1.0e30)",
        "return damping, none_of(elastic)",
        "line 2",
    ),
    "another type": ("type(elastic)(1.0e30)", "wp.float32(1.0e30)", "line 2"),
    "a name that is not there": ("return damping, none", "return dampin, none", r"line 30: .*dampin"),
    "no number": ("return damping,", "return damping / (damping - damping),", "it gives nan"),
    "a damper that drives": ("return damping,", "return -elastic,", "must be a damper of at least 0"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_law_that_does_not_fit_is_refused_in_one_line(tmp_path, capsys, what):
    old, new, said = REFUSED[what]
    assert old in LAW
    own, drive = write_plugin(tmp_path, LAW.replace(old, new)), tmp_path / "d.toml"
    plugin_text = dumps_drive(own_drive(law="flores")).replace('"flores"', '"approach"')
    drive.write_text(plugin_text)
    words = ("run", drive, "-o", tmp_path / "a.mcap", "--duration", "1e-4", "--device", "cpu", "--quiet")
    line = refused(capsys, *words, "--plugin", own)
    assert re.search(said, line), line
    assert line.startswith(f"warpchain: error: {own}, line ")


def test_an_unknown_law_names_those_there_are(tmp_path):
    with pytest.raises(DriveError, match=r'law = "approach": must be one of "lankarani-nikravesh", .*"kelvin-voigt"$'):
        own_drive()
    load_plugin(write_plugin(tmp_path, LAW))
    with pytest.raises(DriveError, match=r'"kelvin-voigt", "approach"$'):
        own_drive(law="hertz")


def test_a_rebound_that_never_comes_down_is_refused(tmp_path):
    load_plugin(write_plugin(tmp_path, LAW.replace("root = ", "return 0.9\n    root = ")))
    drive = own_drive().with_values({"contact.sprocket.restitution_means": "rebound"})
    with pytest.raises(PluginError, match=r"contact law 'approach': no factor has a rebound of 0\.5"):
        pack([drive], [Schedule(1e-6, 1, 0, 1, 0)])
