"""Tooth profiles."""

import argparse
import math
from pathlib import Path

import numpy as np
from common.cases import case, option

from warpchain import Drive, Record, Trajectory, loads_drive, simulate
from warpchain.drive.stiffness import contact_rebound
from warpchain.drive.tooth_shape import half_gap_outline
from warpchain.results.scene import nearest_sprocket, sprocket_normals

TEETH, PITCH, ROLLER = 19, 25.4e-3, 7.94e-3
PROFILES = {
    "circular": f'profile = "circular"\nclearance = {0.01 * ROLLER}',  # the seat of ISO 606's minimum gap
    "iso606, minimum gap": 'profile = "iso606"\ngap = "minimum"',
    "iso606, maximum gap": 'profile = "iso606"\ngap = "maximum"',
}
RUNS = 10
BEGIN = 0.2  # s: what comes before is the start
COLORS = ("#4477aa", "#ee6677", "#228833")


def drive(profile: str, **changes: float) -> Drive:
    """The drive with one of the profiles; `changes` of the values in the text below."""
    values = {"speed": 60.0, "torque": 120.0, "viscous": 0.2, "damping": 60.0, "floor": 0.05, "e": 0.4} | changes
    return loads_drive(
        """
        [chain]
        pitch = {pitch}
        links = 78
        mass_per_length = 2.7
        stiffness = 2e7
        damping = {damping}
        roller_radius = {roller}
        [[sprockets]]
        name = "driver"
        teeth = {teeth}
        center = [0.0, 0.0]
        wrap = "ccw"
        prescribed = {{ speed = {speed} }}
        [[sprockets]]
        name = "driven"
        teeth = {teeth}
        center = [{span}, 0.0]
        wrap = "ccw"
        inertia = 0.3
        load = {{ torque = {torque}, viscous = {viscous} }}
        [contact.sprocket]
        {profile}
        law = "flores"
        restitution = {e}
        restitution_means = "rebound"
        impact_speed_floor = {floor}
        stiffness = 2e8
        [run]
        duration = 1.2
        step = 2.5e-6
        sample_rate = 1000.0
        gravity = [0.0, 0.0]
        """.format(teeth=TEETH, pitch=PITCH, roller=ROLLER, span=29.5 * PITCH * (1 + 1e-4), profile=profile, **values)
    )


def approach_speeds(trajectory: Trajectory, s: int) -> np.ndarray:
    """Speed along the tooth's normal with which each roller that arrives on sprocket s first meets it [m/s].

    Normal and speed are those of the frame before.
    """
    assert trajectory.position is not None and trajectory.velocity is not None
    assert trajectory.sprocket_center is not None and trajectory.sprocket_speed is not None
    assert trajectory.sprocket_force is not None
    on = nearest_sprocket(trajectory) == s
    met = []
    for frame, roller in np.argwhere(~on[:-1] & on[1:]):
        touching = np.flatnonzero(trajectory.sprocket_force[frame + 1 :, roller] > 0.0)
        if trajectory.time[frame] > BEGIN and touching.size:
            met.append((frame + touching[0], roller))
    frames, rollers = np.array(met, dtype=np.intp).reshape(-1, 2).T
    arm = trajectory.position[frames, rollers] - trajectory.sprocket_center[frames, s]
    surface = trajectory.sprocket_speed[frames, s, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    normals = sprocket_normals(trajectory, s, frames, rollers)
    return ((surface - trajectory.velocity[frames, rollers]) * normals).sum(axis=1)


def around(trajectory: Trajectory, s: int) -> tuple[np.ndarray, np.ndarray]:
    """Pitches travelled since a roller's arrival on sprocket s, and its mean contact force there [N]."""
    assert trajectory.position is not None and trajectory.sprocket_center is not None
    assert trajectory.sprocket_force is not None
    arm = trajectory.position - trajectory.sprocket_center[:, None, s]
    on = (nearest_sprocket(trajectory) == s) & (trajectory.time > BEGIN)[:, None]
    # the driven sprocket is wrapped from its lowest to its highest point
    pitches = (np.arctan2(arm[..., 1], arm[..., 0])[on] + 0.5 * math.pi) / (2.0 * math.pi / TEETH)
    edges = np.arange(-0.5, TEETH / 2 + 1.0, 0.1)
    total, _ = np.histogram(pitches, edges, weights=trajectory.sprocket_force[on])
    count, _ = np.histogram(pitches, edges)
    return 0.5 * (edges[:-1] + edges[1:]), total / np.maximum(count, 1)


def seated(profile: str) -> tuple[np.ndarray, float]:
    """Tension around the locked driver over its largest [-], and the expected ratio of neighbors."""
    slow = drive(profile, speed=0.0, viscous=20.0, damping=2e3, floor=0.5)
    slow = slow.with_values({"contact.sprocket.stiffness": 2e9, "run.step": 1.5e-6, "run.duration": 1.0})
    trajectory = simulate(slow, record=Record(rate=100.0))[0]
    phi = slow.tooth(0).pressure_angle(TEETH)
    assert trajectory.sprocket_force is not None and trajectory.tension is not None
    force, tension = trajectory.sprocket_force[-1], trajectory.tension[-1]
    on = nearest_sprocket(trajectory)[-1] == 0
    loaded = np.flatnonzero(on & (force > 0.005 * force.max()))
    before, after = tension[loaded - 1], tension[loaded]
    pairs = np.sort(np.stack([before, after], axis=1), axis=1)[:, ::-1]
    pairs = pairs[np.argsort(-pairs[:, 0])][1:6]  # the first roller's other link belongs to the strand
    values = np.concatenate([pairs[:1, 0], pairs[:, 1]])
    return values / values[0], math.sin(phi) / math.sin(phi + 2.0 * math.pi / TEETH)


@case(option("picture", nargs="?", type=Path, help="where to save the figure; default: nowhere"))
def profiles(asked: argparse.Namespace) -> None:
    """Straight flanks against the two tooth gaps of ISO 606 on one drive: shape, forces, engagement, seated tension.

    python scripts/figures.py profiles [docs/images/profiles.png]

    A 16B chain on two sprockets of 19 teeth pulls 1.7 kN at 4.6 m/s; then the same chain is pulled off a locked
    sprocket slowly, and the tension around the wrap is held against T_(i+1) / T_i = sin(phi) / sin(phi + 2 pi / z). The
    motion is chaotic: each profile runs ten times with loads a millionth apart, and means are given with the standard
    error that their scatter leaves.
    """
    target = asked.picture
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = list(PROFILES)
    drives = [drive(profile) for profile in PROFILES.values()]
    found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    speeds: dict[str, list[np.ndarray]] = {name: [] for name in names}
    forces: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for k in range(RUNS):
        variants = [one.with_values({"sprockets.driven.load.torque": 120.0 * (1 + 1e-6 * k)}) for one in drives]
        run = simulate(variants, record=Record(variants="all", rate=20e3), window=(BEGIN, 1.2))
        for v, row in enumerate(run.metrics.to_pylist()):
            arriving = np.concatenate([approach_speeds(run[v], s) for s in (0, 1)])
            where, force_there = around(run[v], 1)
            forces[names[v]].append(force_there)
            speeds[names[v]].append(arriving)
            impulse = drives[v].chain.mass * (1.0 + contact_rebound(drives[v].contact.sprocket)) * arriving.mean()
            found[names[v]].append(
                {
                    "tight strand [N]": row["driven->driver.tension_mean"],
                    "slack strand [N]": row["driver->driven.tension_mean"],
                    "largest contact force [N]": max(row["driver.force_max"], row["driven.force_max"]),
                    "approach speed, mean [m/s]": arriving.mean(),
                    "impulse of an arrival [N s]": impulse,
                    "losses in contacts [W]": (row["driver.dissipated"] + row["driven.dissipated"]) / (1.2 - BEGIN),
                }
            )
    figure, ((shape, force), (approach, decay)) = plt.subplots(2, 2, figsize=(11, 8), constrained_layout=True)
    for k, (name, color) in enumerate(zip(PROFILES, COLORS, strict=True)):
        one, tooth = drives[k], drives[k].tooth(0)
        print(f"{name}: pressure angle {math.degrees(tooth.pressure_angle(TEETH)):.1f} degrees")
        for quantity in found[name][0]:
            values = np.array([row[quantity] for row in found[name]])
            print(f"    {quantity:28s} {values.mean():9.4g} +- {values.std(ddof=1) / math.sqrt(RUNS):.2g}")
        half = half_gap_outline(tooth, TEETH, one.pitch_radius(0), 40)
        outline = 1e3 * np.vstack([half[::-1] * [1.0, -1.0], half[1:]])
        shape.plot(outline[:, 1], outline[:, 0], color=color, label=name)
        force.plot(where, np.mean(forces[name], axis=0), color=color)
        approach.hist(
            np.concatenate(speeds[name]), bins=np.linspace(0.0, 2.5, 26), histtype="step", color=color, linewidth=1.5
        )
        ratios, expected = seated(PROFILES[name])
        place = np.arange(len(ratios))
        decay.semilogy(place, ratios, "o", color=color)
        decay.semilogy(place, expected**place, "--", color=color, linewidth=1.0)
        print(f"    seated chain: T(i+1)/T(i) = {np.round(ratios[1:] / ratios[:-1], 3)}, expected {expected:.3f}")
    turn = np.linspace(0.0, 2.0 * math.pi, 100)
    radius = 1e3 * drives[0].pitch_radius(0)
    shape.plot(1e3 * ROLLER * np.sin(turn), radius + 1e3 * ROLLER * np.cos(turn), color="0.6", linewidth=0.8)
    shape.set(xlabel="across the gap [mm]", ylabel="from the center [mm]", title="tooth gap, with its roller")
    shape.set_aspect("equal")
    shape.legend(fontsize=8, loc="center")
    force.set(xlabel="pitches since arrival", ylabel="mean contact force [N]", title="on the driven sprocket")
    approach.set(xlabel="approach speed along the normal [m/s]", ylabel="rollers", title="rollers that arrive")
    decay.set(
        xlabel="link around the wrap", ylabel="tension over the largest", title="seated chain, closed form dashed"
    )
    decay.set_ylim(5e-3, 1.5)
    for axes in (shape, force, approach, decay):
        axes.grid(alpha=0.3)
    if target is not None:
        figure.savefig(target, dpi=110)
