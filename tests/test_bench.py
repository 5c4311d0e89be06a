"""The benchmarks' drives, rows and runner."""

import shutil
import sys
import time
import types
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import warp as wp
from drives import example, of_long
from loading import load_script
from matplotlib.figure import Figure

from warpchain import assemble
from warpchain.assembly.assembly import assemble_chain
from warpchain.assembly.timestep import resolve_step
from warpchain.engine.pack import pack
from warpchain.errors import WarpchainError
from warpchain.model import Model
from warpchain.results.schedule import Schedule


@pytest.fixture
def drives():
    return load_script("benches.drives")


def test_the_kinds_are_224_and_can_be_assembled(drives):
    kinds = drives.two_sprocket_kinds()
    assert len({(drive.chain.links, drive.sprockets[0].teeth) for drive in kinds}) == len(kinds) == 224
    chosen = [kinds[0], kinds[15], kinds[-16], kinds[-1]]
    packed = pack(chosen, [Schedule(1e-6, 10, 0, 10, 0)] * len(chosen))
    # all hang alike: the wrap is half of each sprocket, so that the slack of 0.4 mm is the same
    assert max(assembly.strain for assembly in packed.assemblies) < 1e-3


@pytest.mark.parametrize("name", ["two", "marine", "smooth", "car", "harmonics", "industrial", "engine"])
def test_designs_differ_in_every_range_by_all_of_it_and_can_be_assembled(drives, name):
    drive, ranges = drives.drive_by_name(name), drives.RANGES[name]
    many = drives.varied_designs(drive, name, 40)
    pack(many, [Schedule(1e-6, 10, 0, 10, 0)] * len(many))
    assert len(ranges) >= 4
    for path, to in ranges.items():
        own, values = drive.get_value(path), [each.get_value(path) for each in many]
        low, high = to(own, 0.0), to(own, 1.0)
        assert low <= min(values) <= low + 0.2 * (high - low) < high - 0.2 * (high - low) <= max(values) <= high
        assert high - low >= 0.1 * own or "tightener" in path  # the chain allows of places less
    if name == "marine":
        steps = [resolve_step(each) for each in many]
        assert max(steps) > 1.7 * min(steps)


def test_less_is_measured_quickly():
    gpu = load_script("benches.gpu")
    for name in gpu.PARTS:
        quick, every = gpu.part_rows(name, True), gpu.part_rows(name, False)
        assert quick and set(quick) <= set(every)
    assert {row[2] for row in gpu.part_rows("table", True)} == {1, 1056, 16896}
    assert {row[0] for row in gpu.part_rows("rollers", True)} == {118, 510, 1022, 4000}


@pytest.mark.parametrize("rounds", [1, 2])
def test_whole_runs_are_measured_with_metrics_of_the_second_half_and_without(monkeypatch, rounds):
    """Seconds 8, 10, then 9, 8.5 in turns: the best without metrics is 8, with them 10 or 8.5."""
    gpu, asked, seconds = load_script("benches.gpu"), [], iter([8.0, 10.0, 9.0, 8.5])

    def timed(drives, **options):
        asked.append((len(drives), options["window"], options["precision"]))
        return types.SimpleNamespace(info=types.SimpleNamespace(wall_time=next(seconds))), 11.0

    monkeypatch.setattr(gpu, "timed_run", timed)
    monkeypatch.setattr(gpu, "varied_designs", lambda drive, name, count: [drive] * count)
    row = gpu.runs("smooth", "float32", gpu.BenchEffort(2000, rounds, ""))
    step = resolve_step(example("marine"))
    last = (2.0 - step, 2.0)  # its last step
    assert asked == [(16896, last, "float32"), (16896, None, "float32")] * rounds
    best = 10.0 if rounds == 1 else 8.5
    rate = 16896 * 162 * 2.0 / step / 1e9
    assert row == pytest.approx((2.0, 8.0, best, 8.0 / best, rate / 8.0, rate / best))


def test_windows_are_joined_batch_by_batch():
    """Two windows of 4 batches, of 3 means of 2 copies: the first two batches are the first of the whole."""
    values = np.arange(2 * 3 * 2 * 4, dtype=float).reshape(2, 3, 2, 4)
    whole = load_script("benches.coverage").joined_windows(values, 2)
    assert whole.shape == (1, 3, 2, 4)
    assert whole[0, 1, 0].tolist() == [*values[0, 1, 0].reshape(2, 2).mean(1), *values[1, 1, 0].reshape(2, 2).mean(1)]


def test_calls_are_timed_and_functions_put_back():
    owner = types.SimpleNamespace(wait=lambda seconds, more=0.0: time.sleep(seconds + more) or "waited", left=len)
    wait = owner.wait
    with load_script("common.timing").function_times(time.thread_time, (owner, "wait"), (owner, "left")) as found:
        assert owner.wait(0.02, more=0.01) == "waited" and owner.left("abc") == 3
    assert len(found) == 2 and 0.03 > found[0] >= 0.0  # it slept
    assert owner.wait is wait and owner.left is len


@pytest.fixture
def cases():
    return load_script("common.cases")


def test_without_a_case_they_are_listed(cases, monkeypatch, capsys):
    @cases.case(cases.case_option("--count", type=int, default=2))
    def some_rows(asked):
        """Some rows."""
        yield "text"
        yield ("name", "value")
        yield from (("x", 1.23456) for _ in range(asked.count))

    @cases.case()
    def refused(asked):
        """One that is refused."""
        raise WarpchainError("no such device")
        yield ""

    held = {one.run.__name__: one for one in (some_rows, refused)}
    for words, said in (
        ([], "Some rows."),
        (["some_rows", "--count", "1"], "machine\ntext\n| name | value |\n|---|---|\n| x | 1.235 |\n"),
    ):
        monkeypatch.setattr(sys, "argv", ["bench.py", *words])
        cases.run_case("words", held, lambda: ["machine"])
        assert said in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["bench.py", "refused"])
    with pytest.raises(SystemExit, match=r"^no such device$"):
        cases.run_case("words", held)


def test_figures_are_saved_where_they_are_asked_for(cases, tmp_path, capsys):
    cases.print_lines([{"empty": Figure()}], tmp_path)
    assert capsys.readouterr().out == f"{tmp_path / 'empty.png'}\n" and (tmp_path / "empty.png").exists()


LIGHTER = {"sprockets.intake cam.inertia": 3e-5, "arms.arm.inertia": 1.8e-3}
KINDS = [("two", {}), ("smooth", {}), ("marine", {}), ("car", {}), ("car", LIGHTER)]


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(("name", "values"), KINDS)
def test_the_c_program_takes_the_same_steps(name, values, drives, tmp_path):
    """Both do the same operations on places of up to some meters, whose rounding is 4e-16 m, in another order, and
    contacts add up some of it: 1e-14 m is found after 500 steps. Without friction of the joints, or of teeth and
    guides, without the oil's flow, or without the speed of an arm's guide, 1e-5 to 2e-4 m are found, without the static
    part of a guide's friction 1e-6 m, without what contacts' dampers did in the step before 1e-9 to 2e-5 m, without the
    mean over a step 8e-10 to 3e-7 m. In `LIGHTER` camshaft and arm are light."""
    cpu, reference = load_script("benches.cpu"), load_script("benches.reference")
    drive = drives.without_valves(name).with_values(values)
    assert cpu.c_program_distance(drive, reference.c_program(tmp_path), 500) < 1e-12


def test_the_c_program_refuses_what_it_does_not_know(drives):
    cpu = load_script("benches.cpu")
    with pytest.raises(SystemExit, match=r"^the C program takes no drive with stages$"):
        cpu.c_program_distance(drives.drive_by_name("rk4"), Path("none"), 1)
    with pytest.raises(SystemExit, match="mounts"):
        cpu.c_program_distance(drives.drive_by_name("engine"), Path("none"), 1)


@pytest.mark.parametrize(("name", "values"), KINDS)
def test_the_cuda_program_is_compiled_for_the_parts_that_its_input_has(name, values, drives):
    """The first numbers of the input are those of parts."""
    reference = load_script("benches.reference")
    packed = reference.packed_variant(drives.without_valves(name).with_values(values))
    compiled = {precision: reference.cuda_constants(packed, precision) for precision in ("float64", "float32")}
    assert compiled["float64"].pop("real") == "double" and compiled["float32"].pop("real") == "float"
    assert compiled["float64"] == compiled["float32"]
    *parts, rubs = compiled["float64"].values()
    assert parts == np.frombuffer(reference.variant_layout(packed))[:6].tolist()
    assert rubs == (name in ("marine", "car"))


@pytest.mark.skipif(shutil.which("nvcc") is None, reason="no compiler of CUDA C++")
@pytest.mark.parametrize(
    ("name", "values", "precision"),
    [("smooth", {}, "float32"), ("car", {}, "float32"), *of_long(*((*kind, "float64") for kind in KINDS))],
)
def test_the_cuda_program_takes_the_same_steps(name, values, precision, drives, tmp_path):
    """It compiles, and where a GPU can run it, it is as near to the engine as the C program; it only adds up moments in
    another order. Plain float32 rounds places of some meters by 2e-7 m: 4e-5 m are found after 500 steps."""
    cpu, reference = load_script("benches.cpu"), load_script("benches.reference")
    drive = drives.without_valves(name).with_values(values)
    program = reference.cuda_program(drive, precision, tmp_path)
    assert program.exists()
    if wp.is_cuda_available():
        assert cpu.c_program_distance(drive, program, 500) < (1e-12 if precision == "float64" else 1e-3)


def test_car_and_whole_runs_stand_beside_the_cuda_program(monkeypatch):
    """Of 20,000 steps, ours take 2 s and the program's 3 s: 100 and 150 us a step. The program knows no valves."""
    gpu, asked = load_script("benches.gpu"), []

    def cuda_seconds(drive, precision, steps, variants, folder):
        asked.append((precision, steps, variants))
        return 150e-6 * steps

    def timed(many, **options):
        metrics = pa.table({"tension_mean": [1.0, 3.0], "diverged": [False, True]})
        return types.SimpleNamespace(metrics=metrics, info=types.SimpleNamespace(wall_time=8.0)), 10.0

    monkeypatch.setattr(gpu, "cuda_seconds", cuda_seconds)
    monkeypatch.setattr(gpu, "time_loop_seconds", lambda *words: (2.0 if words[5] is False else 4.0, 0.0))
    monkeypatch.setattr(gpu, "timed_run", timed)
    step = resolve_step(gpu.drive_by_name("harmonics"))
    finer = gpu.drive_by_name("harmonics").with_values({"run.step": 0.5 * step})
    monkeypatch.setattr(gpu, "varied_designs", lambda drive, name, count: [drive, finer] * (count // 2))
    effort = gpu.BenchEffort(2000, 1, "")
    assert gpu.car("harmonics", "float32", 1056, effort) == pytest.approx((150.0, 100.0, 1.5, 200.0))
    assert gpu.row_with_dashes(gpu.car("valves", "float32", 1056, effort)) == ("-", 100.0, "-", 200.0)
    steps = 1.5 * 0.2 / step  # in the mean
    assert gpu.headline("harmonics", "float64", effort) == pytest.approx((10.0, 2.0, 150e-6 * steps, 1, 2.0, 2.0))
    assert asked == [("float32", 20_000, 1056), ("float64", 2000, 10_000)]


def test_rows_have_a_dash_for_what_was_not_measured():
    assert load_script("benches.gpu").row_with_dashes(("car", 1.5, float("nan"), 3)) == ("car", 1.5, "-", 3)


def test_one_chain_has_as_many_rollers_and_partners_as_three():
    """And as many rollers on its sprockets: halves of 6 with 14 teeth, and 42 of 20 teeth on a star of as long
    strands; ends of strands are within one roller of each."""
    chains = load_script("benches.chains")
    three, one = chains.chains_in_a_row(None), chains.chain_around_a_star(None)
    assert three.links == one.links == 180
    assert len(three.sprockets) == len(one.sprockets) == 6
    assemblies = [assemble_chain(part) for part in Model(three).chains], [assemble(one)]
    strains = [assembly.strain for of in assemblies for assembly in of]
    assert strains == pytest.approx([1e-3] * 4, abs=1e-4)
    strands = [sum(len(a.strand_links) for a in of) for of in assemblies]
    links = [sum(int(a.strand_links.sum()) for a in of) for of in assemblies]
    assert strands == [6, 6]
    assert abs(links[0] - links[1]) <= 6


def test_growth_is_a_fixed_part_and_one_for_each(monkeypatch):
    """Steps of 2 us and 3 ns a roller of each variant: half is fixed at 2000 / 3 rollers, and at 2000 / (3 * 118) = 5.6
    variants; per roller-step the figure falls from 3 + 2000 / 50 ns to 3 + 2000 / 2000."""
    growth = load_script("benches.growth")
    monkeypatch.setattr(growth, "step_rate", lambda links, variants, *_: 1.0 / (2e-6 + 3e-9 * links * variants))
    asked = types.SimpleNamespace(
        lengths=growth.LENGTHS, variants=growth.VARIANTS, rounds=2, precision="float64", device="cpu"
    )
    *lines, figures = growth.growth.run(asked)
    rows = {line[0]: line for line in lines if isinstance(line, tuple)}
    assert rows[2000] == (2000, "8.000", "4.000")
    assert rows[4096] == (4096, "1451.984", "3.004")
    said = [line for line in lines if isinstance(line, str)]
    assert said[0] == "2.000 us and 3.000 ns for each; half is fixed at 666.7 rollers\n"
    assert said[1] == "2.000 us and 354.000 ns for each; half is fixed at 5.6 variants\n"
    by_rollers, by_variants = figures["growth-cpu"].axes
    assert by_rollers.lines[0].get_ydata() == pytest.approx([3.0 + 2000.0 / n for n in growth.LENGTHS])
    assert by_variants.lines[0].get_ydata() == pytest.approx([3.0 + 2000.0 / 118 / n for n in growth.VARIANTS])
