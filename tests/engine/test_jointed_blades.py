"""A blade of two segments, arms on arms with a torsion spring between them: balance, settling, energy, pictures."""

import math

import numpy as np
import pytest
from drives import LOWER, UPPER, assert_alone_as_in_a_crowd, errors_of, example, jointed_blade

from warpchain import Record, assemble, read_archive, simulate
from warpchain.assembly.arm_balance import chain_path, path_tension
from warpchain.assembly.path import path_at
from warpchain.drive import Drive
from warpchain.model import Model, single_chain
from warpchain.results.outlines import guide_arm_tensioner_parts, pose_at_frame
from warpchain.view.rerun import view


def blade(**changed):
    return Drive(**jointed_blade()).with_values(changed)


def length(drive, angles):
    """Of the line of the chain with arms at angles [m]."""
    path = path_at(single_chain(drive), angles)
    strands = np.linalg.norm(path.strand_end - path.strand_start, axis=1)
    along = [
        free if string is None else sum(piece.length for piece in string.pieces)
        for free, string in zip(strands, path.strings, strict=True)
    ]
    return sum(along) + float(path.wrap_angle @ path.radius)


def test_the_chain_moves_no_arm_from_its_balance():
    # virtual work: T dL / d angle of each arm, its lower one with it, is its spring's moment; without weight
    drive = blade(**{"run.gravity": [0.0, 0.0]})
    path, d = chain_path(single_chain(drive)), 1e-5
    angles, pull = path.arm_angle.tolist(), path_tension(single_chain(drive), path)
    for a, arm in enumerate(drive.arms):
        up, down = ([*angles[:a], angles[a] + x, *angles[a + 1 :]] for x in (d, -d))
        slope = (length(drive, up) - length(drive, down)) / (2.0 * d)
        moment = arm.stiffness * (angles[a] - arm.free_angle_rad)
        assert abs(moment) > 0.1
        assert moment == pytest.approx(-pull * slope, rel=1e-5)


def test_settling_agrees_with_the_balance(device):
    # to 0.6 degrees, as a single arm's: settling has rollers on seats and faces, balance a taut string
    drive = blade()
    laid = assemble(drive)
    run = simulate(drive.with_values({"sprockets.crank.prescribed.speed": 0.0}), duration=1e-4, record=Record(rate=1e5))
    upper, lower = np.asarray(run[0].arm_angle)[0]
    assert upper == pytest.approx(laid.arm_angle[0], abs=1e-2)
    assert lower - upper == pytest.approx(laid.arm_angle[1], abs=1e-2)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_energy_of_a_drive_with_a_jointed_blade(precision, device):
    # as of one arm with a blade 4e-4 at "auto", which is twice this step, and it falls with its square
    row = simulate(
        blade(**{"run.step": 1.6e-6}), duration=0.04, window=(0.01, 0.04), record=Record("none"), precision=precision
    ).metrics
    row = row.to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < (1.5e-4 if precision == "float64" else 1e-3)
    assert row["upper.damping_loss"] > 0.0 and row["lower.damping_loss"] > 0.0
    assert row["lower blade.dissipated"] > 0.0


def test_the_same_bits_alone_and_in_a_crowd(device):
    drives = [blade(**{"arms.lower.stiffness": k}) for k in (7.0, 8.0, 9.0)]
    assert_alone_as_in_a_crowd(drives, ("position", "arm_angle"), record=Record(rate=5000.0), duration=3e-3)


def test_archive_and_pictures_hold_the_joint(tmp_path):
    drive = blade()
    run = simulate(drive, record=Record(rate=5000.0), duration=4e-3, archive=tmp_path / "a.mcap")
    back = read_archive(tmp_path / "a.mcap")[0]
    assert back.drive == drive and (np.asarray(back.arm_angle) == np.asarray(run[0].arm_angle)).all()
    last = len(back.time) - 1
    upper, lower = back.arm_angle[last]
    drawn = np.subtract(LOWER["pivot"], UPPER["pivot"])
    c, s = math.cos(upper), math.sin(upper)
    joint = UPPER["pivot"] + np.array([[c, -s], [s, c]]) @ drawn
    lines = [
        part.points
        for part in guide_arm_tensioner_parts(single_chain(drive), pose_at_frame(back, last))
        if part.name == "lower"
    ]
    assert lines[0][0] == pytest.approx(joint, abs=1e-9)
    # the faces of both segments are where the rollers that press on them are
    for line in (
        part.points
        for part in guide_arm_tensioner_parts(single_chain(drive), pose_at_frame(back, last))
        if part.kind == "guide"
    ):
        gaps = np.linalg.norm(np.asarray(back.position[last])[:, None] - line[None], axis=2)
        assert gaps.min() < 1.2 * drive.chain.roller_radius + single_chain(drive).guide_offset(0)
    view(run, save=tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"arm": "lower"}, 'arms.lower.arm = "lower": hangs on itself; one of the arms must stand on the ground'),
        ({"arm": "uper"}, 'arms.lower.arm = "uper": must be the name of an arm; did you mean upper?'),
        (
            {"pivot_table": {"time": [0.0, 0.1], "x": [0.0, 1e-3]}},
            "arms.lower.pivot_table: not together with arm, which leads the pivot",
        ),
    ],
)
def test_arms_that_hang_wrongly_are_refused(changed, error):
    found = jointed_blade()
    found["arms"][1] = LOWER | changed
    assert errors_of(found) == (error,)


def test_rows_and_circles_of_arms_are_refused():
    found = jointed_blade()
    found["arms"] = [UPPER, LOWER, LOWER | {"name": "third", "arm": "lower"}]
    assert errors_of(found) == (
        'arms.third.arm = "lower": hangs on "upper" itself; at most two arms may stand in a row',
    )
    found["arms"] = [UPPER | {"arm": "lower"}, LOWER]
    text = "hangs on itself; one of the arms must stand on the ground"
    assert errors_of(found) == (f'arms.upper.arm = "lower": {text}', f'arms.lower.arm = "upper": {text}')


def test_a_tensioner_does_not_push_an_arm_on_an_arm():
    found = jointed_blade()
    push = {"name": "push", "on": "lower", "at": [-0.055, 0.1], "direction": [1.0, 0.0], "kind": "spring"}
    found["tensioners"] = [push | {"spring": {"stiffness": 100.0}}]
    assert errors_of(found) == ('tensioners.push.on = "lower": must not hang on another arm, as it does on "upper"',)


def test_a_row_of_arms_is_of_one_chain():
    drive = example("v6")
    more = LOWER | {"name": "more", "arm": "left arm", "pivot": [-0.09, 0.2], "center": [-0.1, 0.22]}
    wider = drive.with_values({"arms": [*(arm.model_dump(exclude_none=True) for arm in drive.arms), more]})
    chains = {chain.name: [arm.name for arm in chain.arms] for chain in Model(wider).chains}
    assert chains["left"] == ["left arm", "more"] and "more" not in chains["primary"]
    guide = next(guide for guide in drive.guides if guide.arm == "right arm")
    found = wider.model_dump(exclude_none=True)
    found["guides"] = [*found["guides"], guide.model_dump(exclude_none=True) | {"name": "astray", "arm": "more"}]
    text = 'must be "left", as of the other guides and sprockets on the arm "left arm"'
    assert errors_of(found) == (f'guides.astray.chain = "right": {text}',)
