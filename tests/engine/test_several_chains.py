"""Runs of drives with several chains, against closed forms and against drives of one chain."""

import math
from types import SimpleNamespace

import chains
import numpy as np
import pytest
import warp as wp
from blocks import LIGHT, pack_for
from drives import assert_alone_as_in_a_crowd, example, two_sprockets

from warpchain import Limits, Record, loads_drive, simulate
from warpchain.assembly.timestep import step_limit
from warpchain.engine import gpu_kernels
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.gpu import gpu_refusal
from warpchain.engine.pack import pack
from warpchain.engine.settling import SETTLE_TOLERANCE, settle_variants
from warpchain.errors import DriveError, SuspectWarning
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.chains import chain_trajectories
from warpchain.results.schedule import Schedule

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
BALANCE = ("input_work", "output_work", "energy_change", "links.dissipated", "efficiency")


@pytest.fixture(scope="module")
def side_by_side():
    """One chain of twice everything, and two equal ones, between the same shafts."""
    return simulate([chains.side_by_side(count, duration=0.03, step=2.5e-6) for count in (0, 2)], device="cpu")


def test_two_equal_chains_are_one_of_twice_the_mass_stiffness_and_contact(side_by_side):
    """To the bit: twice a number is exact, and so is the sum of two equal ones."""
    one, two = side_by_side[0], side_by_side[1]
    for half in (slice(0, 60), slice(60, 120)):
        np.testing.assert_array_equal(two.position[:, half], one.position)
        np.testing.assert_array_equal(2.0 * two.tension[:, half], one.tension)
    np.testing.assert_array_equal(two.sprocket_angle[:, ::2][:, :1], one.sprocket_angle[:, :1])
    rows = side_by_side.metrics.to_pylist()
    for name in BALANCE:  # sums over two chains are rounded otherwise
        assert rows[1][name] == pytest.approx(rows[0][name], rel=1e-9), name


def test_two_equal_chains_on_a_light_shaft_are_one_of_twice_the_mass_stiffness_and_contact():
    """To round-off: a shaft lighter than its rollers answers the dampers of all chains on it together."""
    drives = [chains.side_by_side(count, duration=0.01, step=2.5e-6) for count in (0, 2)]
    one, two = simulate([of.with_values({"sprockets.b0.inertia": 0.05}) for of in drives], device="cpu").values()
    for half in (slice(0, 60), slice(60, 120)):
        np.testing.assert_allclose(two.position[:, half], one.position, atol=1e-12)


def test_shares_of_a_shaft_count_once_in_the_step_limit():
    """omega^2 of a shaft adds up what all its chains' teeth push with, over the inertia of all of it."""
    assert step_limit(chains.side_by_side(2)) == pytest.approx(step_limit(chains.side_by_side(0)), rel=1e-14)


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def turning(request):
    """Two stages, braked in proportion to speed: at rest in itself after some 1 / 25 s."""
    drive = chains.two_stages(duration=1.0).with_values({"sprockets.out.load": {"viscous": 100.0}})
    run = simulate(drive, device=request.param, window=(0.5, 1.0), record=Record(variants="none"))
    return drive, run.metrics.to_pylist()[0]


def test_two_stages_turn_in_the_ratio_of_their_teeth(turning):
    """z1 z3 / (z2 z4) in the mean; what teeth do within a pitch, over the 5 rad of the window, is below 1e-3."""
    _, row = turning
    assert row["out.speed_mean"] == pytest.approx(10.0 * (20 * 18) / (30 * 36), rel=1e-3)
    assert row["mid out.speed_mean"] == row["mid in.speed_mean"]


def test_a_load_pulls_both_chains(turning):
    """dT2 = M / R4, dT1 = dT2 R3 / R2; links pull at R cos(pi / z) to R, (pi / z)^2 / 6 = 0.5 % nearer in the mean."""
    drive, row = turning
    pitch = {"first": 0.05, "second": 0.04}
    radius = {s.name: pitch[s.chain] / (2.0 * math.sin(math.pi / s.teeth)) for s in drive.sprockets}
    moment = 100.0 * row["out.speed_mean"]
    second = row["second.out->mid out.tension_mean"] - row["second.mid out->out.tension_mean"]
    first = row["first.mid in->crank.tension_mean"] - row["first.crank->mid in.tension_mean"]
    assert second == pytest.approx(moment / radius["out"], rel=0.01)
    assert first == pytest.approx(second * radius["mid out"] / radius["mid in"], rel=0.01)


def test_the_energy_balance_is_of_all_chains(turning):
    """Leapfrog's residual is of the order of (omega h)^2, as with one chain."""
    _, row = turning
    assert abs(row["energy_residual_relative"]) < 1e-5
    assert row["links.dissipated"] == row["first.links.dissipated"] + row["second.links.dissipated"]


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.thorough)])
def test_a_variant_alone_is_the_same_in_a_crowd(precision):
    others = [example(name).with_values({"run.duration": 0.002}) for name in ("engine", "marine")]
    drives = [chains.two_stages(duration=0.01), two_sprockets(duration=0.01), chains.side_by_side(2, duration=0.01)]
    drives += others
    assert_alone_as_in_a_crowd(drives, device="cpu", precision=precision)


@pytest.mark.parametrize("values", [{}, LIGHT], ids=["usual", "light"])
@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_unjoined_chains_with_sprockets_on_arms_are_each_as_alone(values):
    """Bitwise."""
    few = {"run.duration": 5e-3, "run.settle": False}
    drive = example("swing_idler").with_values(few | values)
    alone, both = (simulate(of, device="cpu", record=Record([0]))[0] for of in (drive, chains.twice(drive)))
    for part in chain_trajectories(both).values():
        for channel in ("position", "sprocket_speed", "sprocket_center", "arm_angle"):
            np.testing.assert_array_equal(getattr(part, channel), getattr(alone, channel))


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_a_train_beside_several_chains_is_the_same_as_alone():
    """Bitwise, though the kernel of several chains steps it."""
    train, arm, several = (example(name) for name in ("conveyor", "swing_idler", "v6"))
    mine = [drive.with_values({"run.duration": 0.01}) for drive in (train, arm)]
    alone = simulate(mine, device="cpu")
    crowd = simulate([several.with_values({"run.duration": 1e-3}), *mine], device="cpu")
    for v in range(2):
        row, other = alone.metrics.to_pylist()[v], crowd.metrics.to_pylist()[1 + v]
        assert {name: other[name] for name in row if name != "variant"} == {k: row[k] for k in row if k != "variant"}


@pytest.mark.long
def test_float32_follows_float64():
    """Within 1e-3 of the largest tension, as long as contacts begin at the same steps."""
    drive = chains.two_stages(duration=0.002)
    full, single = (simulate(drive, device="cpu", precision=p)[0] for p in ("float64", "float32"))
    np.testing.assert_allclose(single.tension, full.tension, atol=1e-3 * np.abs(full.tension).max())


def test_stages_agree_with_leapfrog():
    """They differ by leapfrog's error with dampers, of first order: a quarter of it at a quarter of the step."""

    def end(integrator, step):
        drive = chains.two_stages(duration=2e-3, step=step).with_values({"run.integrator": integrator})
        return simulate(drive, device="cpu")[0].position[-1]

    exact = end("rk4", 1e-6)
    coarse, fine = (np.abs(end("leapfrog", step) - exact).max() for step in (4e-6, 1e-6))
    assert fine == pytest.approx(0.25 * coarse, rel=0.1)


def test_bodies_of_a_shaft_stay_together():
    """All take the same acceleration at each step: angles differ by what they began with, and round-off."""
    run = simulate(chains.two_stages(duration=0.05), device="cpu")[0]
    turned = run.sprocket_angle - run.sprocket_angle[0]
    np.testing.assert_array_equal(run.sprocket_speed[:, 1], run.sprocket_speed[:, 2])
    np.testing.assert_allclose(turned[:, 1], turned[:, 2], atol=1e-13)


def test_light_shafts_run_at_large_steps(device):
    """A shaft lighter than the rollers on it answers the dampers of both chains."""
    light = {"sprockets.mid in.inertia": 1e-3, "sprockets.mid out.inertia": 1e-3, "run.step": "auto"}
    drive = chains.two_stages(duration=0.2).with_values(light)
    row = simulate(drive, device=device, record=Record(variants="none")).metrics.to_pylist()[0]
    assert not row["diverged"] and abs(row["energy_residual_relative"]) < 1e-2


def test_settled_chains_begin_at_rest(device):
    drive = chains.two_stages(duration=0.005, settle="true", gravity=-9.81)
    row = simulate(drive, device=device, record=Record(variants="none")).metrics.to_pylist()[0]
    for name in ("first", "second"):
        assert row[f"{name}.settle_steps"] > 0 and row[f"{name}.settle_residual"] < 1e-3


def test_only_where_a_chain_is_slack_does_settling_go_by_rounding():
    """Tensioners leave three chains of v6 one way to lie; of the fourth, within the tolerance, there are many.

    1e-10 m: round-off of some thousand steps of relaxation; 1e-4 m: a hundredth of a pitch.
    """
    drive = example("v6")
    rows = ChainRows([drive], stacks_of_drives([drive]))
    first, second = (pack(rows.models, [Schedule(1e-6, 1, 0, 1, 0)] * 4, rows.stacks) for _ in range(2))
    second.rollers *= 1.0 + 1e-16 * np.random.default_rng(1).standard_normal(len(second.rollers))
    for packed in (first, second):
        rows.couple_chains(packed)
        found = settle_variants(
            packed, rows.models, "cpu", 1, 100_000, lambda futures, _: [f.result() for f in futures] or True
        )
        assert (found["residual"] < SETTLE_TOLERANCE).all()
    apart = [np.abs(one - other).max() for one, other in zip(rollers_of(first), rollers_of(second), strict=True)]
    assert max(apart[:3]) < 1e-10
    assert 1e-10 < apart[3] < 1e-4


def rollers_of(packed):
    """Coordinates of the rollers of each row."""
    return [packed.roller_rows(r)[:2] for r in range(packed.variants)]


def test_channels_of_a_chain_are_parts_of_the_drives():
    whole = simulate(chains.two_stages(duration=0.005), device="cpu")[0]
    first, second = chain_trajectories(whole).values()
    np.testing.assert_array_equal(whole.position, np.concatenate([first.position, second.position], axis=1))
    np.testing.assert_array_equal(whole.sprocket_speed[:, 2:], second.sprocket_speed)
    assert first.parts.links == 66 and second.parts.links == 68


def test_copies_by_phase_turn_all_chains():
    drive = chains.two_stages(duration=0.01)
    run = simulate(drive, device="cpu", replicates=2)
    turned = run[1].sprocket_angle[0] - run[0].sprocket_angle[0]
    pitches = 2.0 * math.pi / np.array([sprocket.teeth for sprocket in drive.sprockets])
    teeth = np.abs(turned) / pitches
    assert teeth[:2] == pytest.approx(0.5, abs=1e-3)  # half a tooth of the driver, and of what its chain turns
    share = 0.5 * 18 / 30  # of a tooth of the second chain's
    assert np.minimum(teeth[2:], 1.0 - teeth[2:]) == pytest.approx(share, abs=1e-3)


def test_judged_by_the_breaking_load_of_each_chain():
    whole = chains.two_stages(duration=0.01)
    second = {key: getattr(whole.chains[1], key) for key in ("pitch", "roller_radius", "stiffness", "roller_mass")}
    drive = whole.with_values({f"chains.second.{key}": value for key, value in {"size": "08B", **second}.items()})
    with pytest.warns(SuspectWarning, match="second: largest tension"):
        simulate(drive, device="cpu", limits=Limits(breaking_load=1e-3))


def test_chains_of_one_plane_that_cross_are_refused():
    """A second pair of sprockets across the first, driven by itself."""
    text = (
        chains.chain("a", 60) + chains.chain("b", 60)
        + "".join(
            chains.sprocket(f"{c}{k}", 20, at, c, more="prescribed = { speed = 1.0 }" if k == 0 else "inertia = 1.0")
            for c, places in (("a", ((0.0, 0.0), (1.0, 0.0))), ("b", ((0.5, -0.5), (0.5, 0.5))))
            for k, at in enumerate(places)
        )
        + chains.CONTACT + chains.run(duration=0.001)
    )  # fmt: skip
    with pytest.raises(DriveError, match=r'^variant 0: chains "a" and "b" cross near \[.*\] m in one plane'):
        simulate(loads_drive(text), device="cpu")
    behind = text.replace('name = "b"\n', 'name = "b"\nplane = "behind"\n', 1)
    assert simulate(loads_drive(behind), device="cpu").metrics.num_rows == 1


def test_a_chain_that_does_not_fit_names_its_variant():
    good = chains.two_stages(duration=0.001)
    bad = good.with_values({"chains.second.links": 90})
    with pytest.raises(DriveError, match=r"^variant 1: "):
        simulate([good, bad], device="cpu")


def packed_for(drives, steps=100):
    return pack_for(drives, [Schedule(1e-6, steps, 0, steps, 0) for _ in drives], "float64")


def test_a_gpu_takes_as_much_of_all_chains_as_of_one():
    packed = packed_for([two_sprockets(), chains.two_stages()])
    assert gpu_refusal(packed) is None
    packed.drives["sprockets"][1:] = 16
    assert (
        gpu_refusal(packed, np.array([3, 4]))
        == 'variant 4: 32 sprockets and guide-bars: a GPU takes up to 31; use device="cpu"'
    )
    packed.drives["rollers"][1:] = 9000
    assert gpu_refusal(packed) == 'variant 1: links of all chains: 18000: a GPU takes up to 16384; use device="cpu"'


def test_on_a_gpu_chains_are_stepped_together_and_settle_each_by_itself(monkeypatch):
    """Two stages and a drive of one chain: a kernel each for the steps; all three chains have two sprockets."""
    gpu = SimpleNamespace(sm_count=132, max_shared_memory_per_block=232_448)
    array = lambda values, **_: values  # noqa: E731
    monkeypatch.setattr(gpu_kernels, "wp", SimpleNamespace(get_device=lambda _: gpu, array=array, int32=None))
    kernels = gpu_kernels.GpuKernels(packed_for([two_sprockets(), chains.two_stages(), chains.two_stages()]), "cuda:0")
    steps = {bucket.kind.parts.chains: bucket for bucket in kernels.buckets_of_kernel("advance")}
    assert steps.keys() == {1, 2}
    assert steps[1].order.tolist() == [0] and steps[2].order.tolist() == [1, 3]
    assert steps[2].kind.shape.room >= 66 + 68 and steps[2].kind.parts.sprockets == 4
    alone = kernels.buckets_of_kernel("relax")
    assert sorted(row for bucket in alone for row in bucket.order.tolist()) == [0, 1, 2, 3, 4]
    assert {bucket.kind.parts.sprockets for bucket in alone} == {2}


@pytest.mark.gpu
@pytest.mark.parametrize(("precision", "within"), [("float64", 1e-9), ("float32", 3e-4)])
def test_a_gpu_takes_the_steps_of_the_cpu(precision, within):
    """As long as round-off, which contacts amplify, has not come far: 400 steps and 200."""
    if not wp.is_cpu_available():
        pytest.skip("needs Warp's compiler for the CPU")
    few = {"run.duration": 4e-4, "run.step": 1e-6, "run.settle": False}
    drives = [example("v6").with_values(few), chains.two_stages(duration=1e-3)]
    cpu, gpu = (simulate(drives, device=device, precision=precision) for device in ("cpu", "cuda:0"))
    for v in range(len(drives)):
        np.testing.assert_allclose(gpu[v].position, cpu[v].position, atol=within)
        np.testing.assert_allclose(gpu[v].sprocket_angle, cpu[v].sprocket_angle, atol=within)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_variant_alone_on_a_gpu_is_the_same_in_a_crowd(precision):
    """Bitwise, with as many of a kind on a multiprocessor."""
    v6 = example("v6").with_values({"run.duration": 0.002})
    drives = [chains.two_stages(duration=0.005), two_sprockets(duration=0.005), v6]
    assert_alone_as_in_a_crowd(drives, device="cuda:0", precision=precision)


@pytest.mark.gpu
def test_two_equal_chains_on_a_gpu_are_one_of_twice_the_mass_stiffness_and_contact():
    """To round-off, which contacts amplify: moments of two chains are added up in another order."""
    drives = [chains.side_by_side(count, duration=0.002, step=2.5e-6) for count in (0, 2)]
    one, two = simulate(drives, device="cuda:0").values()
    for half in (slice(0, 60), slice(60, 120)):
        np.testing.assert_allclose(two.position[:, half], one.position, atol=1e-9)
