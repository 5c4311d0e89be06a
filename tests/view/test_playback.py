"""Recordings: thinned out without losing peaks, columns as Rerun builds them, variants compared, the ensemble shown."""

import dataclasses

import chains
import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from command import refused
from command import run as command
from drives import STARTING, example, timing, two_sprockets
from hypothesis import given
from hypothesis import strategies as st
from silent_chains import pulled_silent_drive

from warpchain import Record, Trajectory, simulate, write_archive
from warpchain.errors import SimulationError
from warpchain.model import single_chain
from warpchain.results.plate_outlines import plate_outlines
from warpchain.results.signals import peak_frames, peaks_over_time
from warpchain.results.tension_colors import tension_colors
from warpchain.view.palette import (
    CURVE_PALETTE,
    curve_colors,
    packed_tension_colors,
    tension_color_steps,
    tension_color_table,
    tension_scale_top,
    variant_shades,
)
from warpchain.view.recorded_variants import compared_variants, legend_titles, recorded_variant, varied_inputs
from warpchain.view.rerun.chart import BACKGROUND_COLOR, WIDE_CHART
from warpchain.view.rerun.drive_scene import PLATE_ARC_POINTS, log_drive
from warpchain.view.rerun.run_playback import log_recording, playback_seconds, time_panel
from warpchain.view.rerun.signal_charts import curve_axis_range, log_curves, log_tension_image, recorded_curves
from warpchain.view.rerun.streams import line_strip_array, list_array, vector_array


class Spy:
    """A recording stream that keeps what it is given."""

    def __init__(self):
        self.static, self.columns = {}, {}

    def log(self, path, *components, static=False):
        self.static.setdefault(path, []).extend(components)

    def send_columns(self, path, indexes, columns, strict=None):
        (time,) = indexes
        self.columns[path] = time.as_arrow_array(), {str(c.component_descriptor()): c.as_arrow_array() for c in columns}


@pytest.fixture(scope="module")
def run():
    drive = two_sprockets(duration=0.02, step=1e-5)
    variants = [drive.with_values({"sprockets.driven.load.torque": torque}) for torque in (200.0, 300.0, 400.0)]
    return simulate(variants, record=Record(variants=[0, 2]), limits=STARTING)


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=300), st.integers(1, 40))
def test_thinned_series_keep_their_extremes_within_the_budget(values, buckets):
    values = np.array(values)
    frames = peak_frames(values, buckets)
    assert (np.diff(frames) > 0).all()
    assert len(frames) <= max(2 * buckets, min(len(values), 2 * buckets))
    if np.isfinite(values).any():
        assert np.nanmax(values[frames]) == np.nanmax(values)
        assert np.nanmin(values[frames]) == np.nanmin(values)
    # every spell's own extremes, not those of the whole alone
    if len(values) > 2 * buckets:
        for spell in np.split(np.arange(len(values)), (np.arange(1, buckets) * len(values)) // buckets):
            if np.isfinite(values[spell]).any():
                assert np.nanmax(values[spell]) == np.nanmax(values[np.intersect1d(spell, frames)])


def test_images_keep_each_links_peak():
    tension = np.random.default_rng(1).normal(size=(1003, 7))
    first, peaks = peaks_over_time(tension, 100)
    assert peaks.shape == (100, 7)
    np.testing.assert_array_equal(peaks.max(axis=0), tension.max(axis=0))
    np.testing.assert_array_equal(peaks[3], tension[first[3] : first[4]].max(axis=0))


def test_columns_are_those_of_rerun_itself():
    rng = np.random.default_rng(1)
    points, colors = rng.normal(size=(4, 3, 2)).astype(np.float32), np.arange(48, dtype=np.uint8).reshape(12, 4)
    theirs = {str(c.component_descriptor()): c.as_arrow_array() for c in [
        *rr.Points2D.columns(positions=points.reshape(-1, 2), colors=colors).partition([3] * 4),
        *rr.LineStrips2D.columns(strips=points).partition([1] * 4),
    ]}  # fmt: skip
    packed = (colors.astype(np.uint32) << np.array([24, 16, 8, 0], np.uint32)).sum(axis=1, dtype=np.uint32)
    ours = {
        "Points2D:positions": list_array(vector_array(points), 3, 4),
        "Points2D:colors": list_array(pa.array(packed), 3, 4),
        "LineStrips2D:strips": list_array(line_strip_array(points), 1, 4),
    }
    assert ours.keys() == theirs.keys()
    for name, column in ours.items():
        assert column.type == theirs[name].type, name
        assert column.to_pylist() == theirs[name].to_pylist(), name
    lengths = np.array([0, 2, 1])
    assert [len(row) for row in list_array(pa.array([1, 2, 3]), lengths).to_pylist()] == [0, 2, 1]


def test_color_steps_are_the_scale_of_the_archive():
    tension = np.array([-5.0, 0.0, 31.0, 62.5, 99.0, 1e9, np.nan])
    shown = packed_tension_colors(tension_color_steps(tension, 100.0)).astype(">u4").view(np.uint8).reshape(-1, 4)
    # 256 steps over four spans of at most 195 counts a channel: half a step is 1.5 counts, rounded
    np.testing.assert_allclose(shown[:-1].astype(int), tension_colors(tension[:-1], 100.0).astype(int), atol=2)


def test_curves_within_the_budget_keep_the_tension_peak(run):
    trajectory = run[0]
    tension = trajectory.tension.copy()
    tension[37, 5] = 1e6  # one frame's peak, at a frame that even thinning would leave out
    spiked = Trajectory(trajectory.drive, trajectory.time, **trajectory.channels() | {"tension": tension})
    spy = Spy()
    log_curves(spy, "a", spiked, 20, {})
    time, columns = spy.columns["/a/curves/tension/largest"]
    values = columns["Scalars:scalars"].values.to_numpy()
    assert len(values) <= 40 < len(trajectory.time)
    assert values.max() == 1e6
    assert time.to_numpy().astype(float)[values.argmax()] * 1e-9 == pytest.approx(trajectory.time[37], abs=1e-9)
    log_tension_image(spy, "a", spiked, spiked, 20, 1e6)
    (image,) = [c for c in spy.static["/a/tension\\ image/image"] if isinstance(c, rr.Image)]
    pixels = np.asarray(image.buffer.as_arrow_array().to_pylist()[0], np.uint8).reshape(60, 20, 3)
    red = tension_colors(np.array([1.0]), 1.0)[0, :3]
    assert (pixels == red).all(axis=2).sum() == 1
    # link 5 of 60 is the sixth row from below, frame 37 of 401 in spell 1 of 20
    np.testing.assert_array_equal(pixels[60 - 1 - 5, 1], red)


def test_a_moving_sprockets_name_goes_with_its_center(run):
    """The name stands at the origin of the entity that each frame carries to the sprocket's center, y turned around."""
    trajectory = run[0]
    center = trajectory.sprocket_center + np.sin(trajectory.time)[:, None, None]
    moved = Trajectory(trajectory.drive, trajectory.time, **trajectory.channels() | {"sprocket_center": center})
    spy = Spy()
    log_drive(spy, "a", moved, 1.0)
    path = "/a/drive/sprockets/driven"
    _, columns = spy.columns[path]
    places = np.array(columns["Transform3D:translation"].values.to_pylist())
    np.testing.assert_allclose(places[:, :2], center[:, 1] * [1.0, -1.0], rtol=1e-6, atol=1e-7)
    (label,) = spy.static[f"{path}/name"]
    assert label.labels.as_arrow_array().to_pylist() == ["driven"]
    assert label.positions.as_arrow_array().to_pylist() == [[0.0, 0.0]]
    assert f"{path}/name" not in spy.columns


def test_arms_turn_and_plungers_come_out():
    """Arm and blade turn about the pivot by minus the angle (y is turned around); the plunger moves by its extension
    along its direction, its housing stands."""
    drive = timing()
    time, still = np.array([0.0, 1.0]), np.zeros((2, drive.chain.links, 2)) + np.arange(drive.chain.links)[:, None]
    angle, out = np.array([[0.0], [0.02]]), np.array([[0.0], [1e-3]])
    bodies = {"sprocket_angle": np.zeros((2, 3)), "sprocket_center": np.zeros((2, 3, 2))}
    forces = {"sprocket_force": np.zeros(still.shape[:2]), "guide_force": np.zeros(still.shape[:2])}
    spy, tension = Spy(), np.ones(still.shape[:2])
    moved = {"arm_angle": angle, "tensioner_extension": out}
    log_drive(spy, "a", Trajectory(drive, time, position=still, tension=tension, **bodies, **forces, **moved), 1.0)
    for path in ("arms/arm", "guides/blade"):
        _, columns = spy.columns[f"/a/drive/{path}"]
        turn = np.array(columns["Transform3D:quaternion"].values.to_pylist())
        assert 2.0 * np.arctan2(turn[:, 2], turn[:, 3]) == pytest.approx(-angle[:, 0], abs=1e-7)
        place = np.array(columns["Transform3D:translation"].values.to_pylist())[:, :2]
        assert place == pytest.approx(np.tile(np.array(drive.arms[0].pivot) * [1.0, -1.0], (2, 1)), rel=1e-6)
    path = f"/a/drive/tensioners/{drive.tensioners[0].name}"
    place = np.array(spy.columns[f"{path}/plunger"][1]["Transform3D:translation"].values.to_pylist())[:, :2]
    along = np.array(drive.tensioners[0].direction) / np.hypot(*drive.tensioners[0].direction)
    assert place == pytest.approx(out * along * [1.0, -1.0], abs=1e-9)
    assert f"{path}/housing" in spy.static and f"{path}/housing" not in spy.columns


def test_a_silent_chain_has_a_strip_for_each_plate_and_pins_of_their_size():
    trajectory = simulate(pulled_silent_drive(), device="cpu", limits=STARTING)[0].at(slice(0, 2))
    spy = Spy()
    log_drive(spy, "a", trajectory, 1000.0)
    _, columns = spy.columns["/a/drive/chain"]
    strips = columns["LineStrips2D:strips"].to_pylist()
    outlines = plate_outlines(trajectory.model, np.asarray(trajectory.position, dtype=float), PLATE_ARC_POINTS)
    np.testing.assert_allclose(strips, outlines * [1.0, -1.0], rtol=1e-6, atol=1e-7)  # float32
    (pins,) = (one for one in spy.static["/a/drive/rollers"] if one.radii is not None)
    assert pins.radii.as_arrow_array().to_pylist() == pytest.approx([0.15 * 9.525e-3], rel=1e-6)


def test_every_group_of_curves_has_a_view(run):
    from warpchain.view.rerun.signal_charts import CURVE_GROUPS

    others = {"friction", "coupling", "twist", "valves", "arm", "push", "extension", "pressure"}
    assert {group for group, _, _ in recorded_curves(run[0])} == set(CURVE_GROUPS) - others
    power = np.arange(1.0, 5.0) * np.ones((len(run[0].time), 4))
    rubbing = dataclasses.replace(run[0], joint_friction_power=power)
    (total,) = (values for group, _, values in recorded_curves(rubbing) if group == "friction")
    np.testing.assert_array_equal(total, 10.0)


def test_variants_to_compare(run, tmp_path):
    path = write_archive(run, tmp_path / "a.mcap")
    other = write_archive(simulate(two_sprockets(duration=0.001)), tmp_path / "b.mcap")
    for variant, others, labels in (
        (None, [], ["variant 0"]),
        (2, [], ["variant 2"]),
        (None, ["2", 0], ["variant 0", "variant 2"]),
        (None, [str(other)], ["a 0", "b"]),
        (2, [str(other), f"{path}:0"], ["a 2", "b", "a 0"]),
        (0, [run], ["a 0", "run 2 0"]),
    ):
        assert [one.label for one in compared_variants(path, variant, others)] == labels
    with pytest.raises(SimulationError, match="variant 1 was not recorded"):
        compared_variants(path, None, ["1"])


def test_inputs_that_vary(run):
    ((name, values),) = varied_inputs(run).items()
    assert (name, values.tolist()) == ("sprockets.driven.load.torque", [200.0, 300.0, 400.0])


def curve_names(spy):
    """Names in the legends of all curves that were logged."""
    styles = [parts[0] for path, parts in spy.static.items() if "/curves/" in path]
    return {style.names.as_arrow_array().to_pylist()[0] for style in styles}


def test_legends_name_variants_only_beside_others(run):
    """Of one variant curves have their own names, of several chains these before them; of two variants theirs."""
    spy = Spy()
    log_recording(spy, compared_variants(run, None, []))
    assert {"largest", "driver"} <= curve_names(spy) and not any("variant" in name for name in curve_names(spy))
    one = compared_variants(run, None, ["2"])
    spy = Spy()
    log_recording(spy, one)
    assert {"variant 0: largest", "variant 2: largest"} <= curve_names(spy)
    chains = [dataclasses.replace(one[0], label=f"variant 0 {name}", chain=name) for name in ("first", "second")]
    assert legend_titles(chains) == ["first", "second"] and legend_titles(one) == ["variant 0", "variant 2"]


def test_comparison_and_ensemble_are_logged(run):
    spy = Spy()
    shown = compared_variants(run, None, ["2"])
    log_recording(spy, shown)
    for label in ("variant\\ 0", "variant\\ 2"):
        assert f"/{label}/drive/rollers" in spy.columns
        assert f"/overlaid/{label}" in spy.columns
    scatters = {path.split("/")[3] for path in spy.static if path.startswith("/ensemble/sprockets.driven.load.torque")}
    assert any("tension_max" in name for name in scatters)
    assert len(scatters) == 4


def test_the_image_of_tension_has_a_bar_of_its_colors(run):
    """Red at the top, blue at the foot, and ticks where their values are on it, a square to the right of the image."""
    spy = Spy()
    log_tension_image(spy, "a", run[0], run[0], 100, 2000.0)
    scale, image, *_ = spy.static["/a/tension\\ image/color\\ bar"]
    table = tension_color_table()
    width, height = (
        image.format.as_arrow_array()[0].as_py()["width"],
        image.format.as_arrow_array()[0].as_py()["height"],
    )
    pixels = np.frombuffer(bytes(image.buffer.as_arrow_array()[0].as_py()), np.uint8).reshape(height, width, 3)
    np.testing.assert_array_equal(pixels[:, 0], table[::-1, :3])
    (left, top, _), (across, down, _) = (part.as_arrow_array()[0].as_py() for part in (scale.translation, scale.scale))
    assert top == 0.0 and down * height == pytest.approx(1.0) and left > WIDE_CHART and across < 0.1
    ticks = spy.static["/a/tension\\ image/color\\ ticks"][0]
    words = ticks.labels.as_arrow_array().to_pylist()
    heights = [1.0 - y - 0.035 for _, y in ticks.positions.as_arrow_array().to_pylist()]
    np.testing.assert_allclose(heights, [float(word) / 2000.0 for word in words], atol=1e-6)
    assert words[0] == "0" and words[-1] == "2000"


def test_sprockets_about_one_center_have_one_label():
    """The pictures of the whole drive have that of both, and not their own; each chain's alone keeps its own."""
    run, spy = simulate(chains.two_stages(duration=0.01), device="cpu"), Spy()
    blueprint = log_recording(spy, compared_variants(run, None, []))
    label, *_ = spy.static["/shafts/mid\\ in"]
    assert label.labels.as_arrow_array().to_pylist() == ["mid in\nmid out"]
    assert [path for path in spy.static if path.startswith("/shafts/")] == ["/shafts/mid\\ in"]
    for chain, name in (("first", "mid\\ in"), ("second", "mid\\ out")):
        assert f"/variant\\ 0\\ {chain}/drive/sprockets/{name}/name" in spy.static
    drive, alone, overlaid = (
        [part.contents for part in tab.contents if isinstance(part, rr.blueprint.Spatial2DView)]
        for tab in blueprint.root_container.contents[:3]
    )
    for (contents,) in (drive, overlaid):
        assert "+ /shafts/**" in contents
        assert "- /variant\\ 0\\ first/drive/sprockets/mid\\ in/name" in contents
    assert len(alone) == 2 and not any("/shafts" in str(contents) for contents in alone)


def test_refusals_in_one_line(run, tmp_path, capsys):
    path = write_archive(run, tmp_path / "a.mcap")
    for words, reason in (
        (["--frames", "1"], "--frames 1: allowed is a whole number of at least 2"),
        (["--tab", "nothing"], "tab 'nothing': allowed are drive, tension along the chain"),
        (["--compare", "1"], "variant 1 was not recorded (recorded: 0, 2)"),
        (["--compare", tmp_path / "no.mcap"], "no.mcap: cannot be read"),
    ):
        assert reason in refused(capsys, "view", path, "--save", tmp_path / "a.rrd", *words)
    status, _, err = command(capsys, "view", path, "--web", "--bind", "192.0.2.1")  # of documentation, nobody's
    assert status == 2 and "--bind 192.0.2.1: this machine cannot listen there" in err[0]
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_frames_are_thinned_out_as_told(run):
    spy, one = Spy(), recorded_variant(run, None)
    log_recording(spy, [one], frames=50)
    assert max(len(time) for time, _ in spy.columns.values()) <= 100  # a smallest and a largest value a frame
    for name in ("chain", "rollers", "sprockets/driver", "sprocket\\ forces"):
        time, _ = spy.columns[f"/variant\\ 0/drive/{name}"]
        shown = time.to_numpy().astype(float) * 1e-9
        assert len(shown) == 50
        assert (shown[0], shown[-1]) == pytest.approx((0.0, one.trajectory.time[-1]))


def spun(drive, seconds, turns, **channels):
    """A recording of 201 frames in which the driver turns so far, the rest as the channels say."""
    time = np.linspace(0.0, seconds, 201)
    angle = np.outer(2.0 * np.pi * turns * time / seconds, [s.sign for s in drive.sprockets])
    return Trajectory(drive, time, sprocket_angle=angle, **channels)


@pytest.mark.parametrize(
    "seconds, turns, played",
    [(0.2, 10.0, 20.0), (0.2, 1.0, 5.0), (2.0, 3.0, 6.0), (60.0, 1000.0, 30.0), (0.2, np.nan, 5.0)],
)
def test_playback_runs_at_two_seconds_a_revolution_and_over_again(seconds, turns, played):
    trajectory = spun(two_sprockets(), seconds, turns)
    assert playback_seconds(trajectory) == pytest.approx(played)
    panel = time_panel([spun(two_sprockets(), 0.5 * seconds, 1.0), trajectory])
    # two digits of the speed are kept
    assert panel.playback_speed == pytest.approx(seconds / played, rel=0.05)
    assert (panel.loop_mode, panel.play_state, panel.timeline) == ("all", "playing", "sim_time")


def test_neither_a_start_nor_an_impact_sets_the_scale_of_tension():
    drive = two_sprockets()
    tension = np.full((201, 60), 1000.0)
    tension[:90] = 90e3  # a ramp that is over before the latter half
    tension[150, 7] = 5e6  # an impact: one of 6060 values there, less than a thousandth
    recording = Trajectory(drive, np.linspace(0.0, 1.0, 201), tension=tension)
    assert tension_scale_top([recording]) == pytest.approx(1000.0)
    louder = dataclasses.replace(recording, tension=2.0 * tension)
    assert tension_scale_top([recording, louder]) == pytest.approx(2000.0)
    assert tension_scale_top([recording], 42e3) == 42e3
    assert tension_scale_top([recording], "42e3") == 42e3
    engine = example("engine")
    assert tension_scale_top([dataclasses.replace(recording, drive=engine)], "breaking") == 8900.0  # 06B of ISO 606
    refused = {"breaking": "needs a chain by its size", "red": "allowed are a tension above 0", -1: "-1"}
    for wanted, text in refused.items():
        with pytest.raises(SimulationError, match=text):
            tension_scale_top([recording], wanted)


def test_each_sprocket_and_guide_bar_has_its_own_contact_force():
    """Every roller on a pitch circle presses that sprocket; one on the face presses the bar."""
    drive = example("marine")
    position = np.zeros((2, 162, 2)) + 50.0
    center = np.tile([s.center for s in drive.sprockets], (2, 1, 1))
    force, guide = np.zeros((2, 162)), np.zeros((2, 162))
    for s in range(3):
        position[:, 10 * s : 10 * s + 2] = center[0, s] + [single_chain(drive).pitch_radius(s), 0.0]
        force[:, 10 * s : 10 * s + 2] = [[100.0 * (s + 1), 50.0], [0.0, 70.0 * (s + 1)]]
    position[:, 40] = np.mean([drive.guides[0].start, drive.guides[0].end], axis=0)
    guide[:, 40] = 30.0, 0.0
    held = {"position": position, "sprocket_center": center, "sprocket_force": force, "guide_force": guide}
    held |= {"sprocket_angle": spun(drive, 1.0, 1.0).sprocket_angle[:2], "tension": np.ones((2, 162))}
    recording = Trajectory(drive, np.array([0.0, 1.0]), **held)
    shown = {name: values.tolist() for group, name, values in recorded_curves(recording) if group == "contact"}
    assert shown == {
        "crankshaft": [100.0, 70.0],
        "tightener": [200.0, 140.0],
        "camshaft": [300.0, 210.0],
        "tight strand": [30.0, 0.0],
    }


def test_a_ramp_does_not_set_the_axis_of_the_speed_ratio():
    drive = two_sprockets()
    speed = np.linspace(0.0, 10.0, 201)[:, None].repeat(2, axis=1)
    speed[1, 1] = 15.0  # the driven sprocket springs back while the driver has hardly begun: 300 times its speed
    speed[100:, 1] *= 1.0 + 0.01 * np.cos(np.arange(101))
    recording = spun(drive, 1.0, 5.0, sprocket_speed=speed)
    low, high = curve_axis_range([recording], "ratio")
    # the ripple of a hundredth and a tenth of its range beside it on each side
    assert (low, high) == pytest.approx((0.988, 1.012), abs=2e-4)
    assert curve_axis_range([recording], "tension") is None


def test_one_color_a_thing_on_every_tab():
    drive = example("engine")
    colors = curve_colors(drive)
    names = [part.name for part in (*drive.sprockets, *drive.guides)] + list(drive.strand_names)
    assert len({colors[name] for name in names}) == len(names) == 11
    run = simulate(two_sprockets(duration=0.005))
    spy = Spy()
    log_recording(spy, [recorded_variant(run, None)])
    seen = {}
    for path, parts in spy.static.items():
        if "/curves/" in path:
            (style,) = parts
            seen.setdefault(path.rsplit("/")[-1], set()).add(style.colors.as_arrow_array().to_pylist()[0])
    assert {"driver", "driven", "largest"} <= seen.keys()
    assert all(len(found) == 1 for found in seen.values())
    assert len(set.union(*seen.values())) == len(seen)
    # its spoke and its name in the drive view, too
    path = "/variant\\ 0/drive/sprockets/driven"
    (outline, *_), (label, *_) = spy.static[path], spy.static[f"{path}/name"]
    drawn = {outline.colors.as_arrow_array().to_pylist()[1], *label.colors.as_arrow_array().to_pylist()}
    assert drawn == seen["driven"]


def luminance(color):
    """Relative luminance of sRGB (WCAG 2.1)."""
    share = np.array(color) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def test_curves_are_readable_on_dark_ground():
    """Contrast of at least 4.5 to 1, which WCAG asks of text; shades of one variant are told apart."""
    ground = luminance(BACKGROUND_COLOR) + 0.05
    for color in CURVE_PALETTE:
        for shade in variant_shades(color):
            assert (luminance(shade) + 0.05) / ground > 4.5
        apart = [
            np.linalg.norm(np.subtract(a, b))
            for i, a in enumerate(variant_shades(color))
            for b in variant_shades(color)[:i]
        ]
        assert min(apart) > 15.0
    apart = [np.linalg.norm(np.subtract(a, b)) for i, a in enumerate(CURVE_PALETTE) for b in CURVE_PALETTE[:i]]
    assert min(apart) > 40.0


def test_no_thing_has_a_color_of_the_tension_scale():
    """Nor one that looks like it: farther than what `test_viewer.py` takes for it, 14 counts of a channel."""
    scale = tension_colors(np.arange(256.0), 255.0)[:, :3].astype(int)
    for color in CURVE_PALETTE:
        assert np.abs(scale - np.array(color)).max(axis=1).min() > 20
