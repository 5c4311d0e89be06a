"""Tooth profiles, and chains that wear on them."""

import argparse
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case
from common.drives import Values, equal_sprocket_values, two_sprockets
from matplotlib.axes import Axes

from warpchain import Drive, Record, simulate
from warpchain.drive.stiffness import contact_rebound
from warpchain.drive.tooth_shape import half_gap_outline
from warpchain.model import Model
from warpchain.results.nearest_parts import engaged_sprockets, sprocket_normals
from warpchain.results.outlines import tooth_outline, turn_points
from warpchain.results.signals import order_spectrum, strand_tension
from warpchain.view.figures.figure_style import panel_column, panel_grid

TEETH, PITCH, ROLLER = 19, 25.4e-3, 7.94e-3
ISO: Values = {"contact.sprocket.profile": "iso606", "contact.sprocket.clearance": None}
PROFILES: dict[str, Values] = {
    "circular": {"contact.sprocket.clearance": 0.01 * ROLLER},  # the seat of ISO 606's minimum gap
    "iso606, minimum gap": ISO | {"contact.sprocket.gap": "minimum"},
    "iso606, maximum gap": ISO | {"contact.sprocket.gap": "maximum"},
}
RUNS = 10
BEGIN, END = 0.2, 1.2  # s: what comes before is the start
COLORS = ("#4477aa", "#ee6677", "#228833")


def profile_drive(profile: str, values: Values | None = None, elongation: float = 0.0, slack: float = 1e-4) -> Drive:
    """A 16B chain on two sprockets of 19 teeth with one of the profiles, as far apart as keeps a longer chain taut."""
    common: Values = {
        "chain.roller_mass": None,
        "chain.mass_per_length": 2.7,
        "chain.stiffness": 2e7,
        "chain.damping": 60.0,
        "chain.roller_radius": ROLLER,
        "sprockets.driver.prescribed.speed": 60.0,
        "sprockets.driven.inertia": 0.3,
        "sprockets.driven.load": {"torque": 120.0, "viscous": 0.2},
        "contact.sprocket.seat_angle": None,
        "contact.sprocket.law": "flores",
        "contact.sprocket.restitution": 0.4,
        "contact.sprocket.restitution_means": "rebound",
        "contact.sprocket.impact_speed_floor": 0.05,
        "run": {"duration": END, "step": 2.5e-6, "sample_rate": 1000.0, "gravity": [0.0, 0.0]},
        "sprockets.driven.center": [29.5 * PITCH * (1.0 + elongation) * (1.0 + slack), 0.0],
    }
    return two_sprockets(equal_sprocket_values(TEETH, 78, PITCH) | common | PROFILES[profile]).with_values(values or {})


def radial_places(trajectory: Any, s: int) -> np.ndarray:
    """Places of rollers from the center of sprocket s (F, N, 2) [m]."""
    return trajectory.position - trajectory.sprocket_center[:, None, s]


def means_over_pitches(trajectory: Any, s: int, values: np.ndarray, edges: np.ndarray, rollers: slice) -> Any:
    """Pitches since a roller's arrival on sprocket s, and the mean of values (F, N) there."""
    arm = radial_places(trajectory, s)[:, rollers]
    on = ((engaged_sprockets(trajectory) == s) & (trajectory.time > BEGIN)[:, None])[:, rollers]
    # the driver is wrapped from its highest to its lowest point, the driven sprocket from its lowest to its highest
    start = (0.5 if s == 0 else -0.5) * math.pi
    angle = np.arctan2(arm[..., 1], arm[..., 0])[on] - start
    pitches = (np.mod(angle, 2.0 * math.pi) if s == 0 else angle) / (2.0 * math.pi / TEETH)
    total, _ = np.histogram(pitches, edges, weights=values[:, rollers][on])
    count, _ = np.histogram(pitches, edges)
    return 0.5 * (edges[:-1] + edges[1:]), total / np.maximum(count, 1)


def approach_speeds(trajectory: Any, s: int) -> np.ndarray:
    """Speed along the tooth's normal with which each roller that arrives on sprocket s first touches it [m/s].

    Normal and speed are those of the frame before.
    """
    on = engaged_sprockets(trajectory) == s
    met = []
    for frame, roller in np.argwhere(~on[:-1] & on[1:]):
        touching = np.flatnonzero(trajectory.sprocket_force[frame + 1 :, roller] > 0.0)
        if trajectory.time[frame] > BEGIN and touching.size:
            met.append((frame + touching[0], roller))
    frames, rollers = np.array(met, dtype=np.intp).reshape(-1, 2).T
    arm = radial_places(trajectory, s)[frames, rollers]
    surface = trajectory.sprocket_speed[frames, s, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    normals = sprocket_normals(trajectory, s, frames, rollers)
    return ((surface - trajectory.velocity[frames, rollers]) * normals).sum(axis=1)


def seated_tension_ratios(profile: str) -> tuple[np.ndarray, float]:
    """Tension around the locked driver over its largest [-], and the expected ratio of neighbors."""
    values = {"chain.damping": 2e3, "sprockets.driver.prescribed.speed": 0.0, "sprockets.driven.load.viscous": 20.0}
    values |= {"contact.sprocket.impact_speed_floor": 0.5, "contact.sprocket.stiffness": 2e9}
    slow = profile_drive(profile, values | {"run.step": 1.5e-6, "run.duration": 1.0})
    trajectory: Any = simulate(slow, record=Record(rate=100.0))[0]
    phi = Model(slow).chain.tooth(0).pressure_angle(TEETH)
    force, tension = trajectory.sprocket_force[-1], trajectory.tension[-1]
    on = engaged_sprockets(trajectory)[-1] == 0
    loaded = np.flatnonzero(on & (force > 0.005 * force.max()))
    pairs = np.sort(np.stack([tension[loaded - 1], tension[loaded]], axis=1), axis=1)[:, ::-1]
    pairs = pairs[np.argsort(-pairs[:, 0])][1:6]  # the first roller's other link belongs to the strand
    values_there = np.concatenate([pairs[:1, 0], pairs[:, 1]])
    return values_there / values_there[0], math.sin(phi) / math.sin(phi + 2.0 * math.pi / TEETH)


def contact_losses(row: dict[str, Any]) -> float:
    """Power that contacts take [W]."""
    return float((row["driver.dissipated"] + row["driven.dissipated"]) / (END - BEGIN))


def repeated_quantities(profile: str) -> tuple[dict[str, list[float]], np.ndarray, list[np.ndarray]]:
    """Quantities of each run with loads a millionth apart, all approach speeds, and mean forces over pitches."""
    loads = [{"sprockets.driven.load.torque": 120.0 * (1 + 1e-6 * k)} for k in range(RUNS)]
    found: dict[str, list[float]] = {}
    speeds, forces, mass = [], [], profile_drive(profile).chain.mass
    for load in loads:  # one after the other: a recording takes a gigabyte
        run = simulate(profile_drive(profile, load), record=Record(rate=20e3), window=(BEGIN, END))
        (row,), trajectory = run.metrics.to_pylist(), run[0]
        speeds.append(np.concatenate([approach_speeds(trajectory, s) for s in (0, 1)]))
        edges = np.arange(-0.5, TEETH / 2 + 1.0, 0.1)
        where, force = means_over_pitches(trajectory, 1, trajectory.channels()["sprocket_force"], edges, slice(None))
        forces.append(force)
        rebound = contact_rebound(trajectory.drive.contact.sprocket)
        quantities = {
            "tight strand [N]": row["driven->driver.tension_mean"],
            "slack strand [N]": row["driver->driven.tension_mean"],
            "largest contact force [N]": max(row["driver.force_max"], row["driven.force_max"]),
            "approach speed, mean [m/s]": speeds[-1].mean(),
            "impulse of an arrival [N s]": mass * (1.0 + rebound) * speeds[-1].mean(),
            "losses in contacts [W]": contact_losses(row),
        }
        for name, value in quantities.items():
            found.setdefault(name, []).append(value)
    return found, np.concatenate(speeds), [where, np.mean(forces, axis=0)]


@case()
def profiles(asked: argparse.Namespace) -> Iterator[Line]:
    """Straight flanks against the two tooth gaps of ISO 606 on one drive: shape, forces, engagement, seated tension.

    python scripts/figures.py profiles

    A 16B chain on two sprockets of 19 teeth pulls 1.7 kN at 4.6 m/s; then the same chain is pulled off a locked
    sprocket slowly, and the tension around the wrap is held against T_(i+1) / T_i = sin(phi) / sin(phi + 2 pi / z). The
    motion is chaotic: each profile runs ten times with loads a millionth apart, and means are given with the standard
    error that their scatter leaves.
    """
    figure, (shape, force, approach, decay) = panel_grid(4, 2, 5.5, 4.0)
    for name, color in zip(PROFILES, COLORS, strict=True):
        one = Model(profile_drive(name)).chain
        yield (f"{name}, pressure angle", f"{math.degrees(one.tooth(0).pressure_angle(TEETH)):.1f} deg")
        found, speeds, over = repeated_quantities(name)
        for quantity, values in found.items():
            yield (quantity, f"{np.mean(values):.4g} +- {np.std(values, ddof=1) / math.sqrt(RUNS):.2g}")
        half = half_gap_outline(one.tooth(0), TEETH, one.pitch_radius(0), 40)
        outline = 1e3 * np.vstack([half[::-1] * [1.0, -1.0], half[1:]])
        shape.plot(outline[:, 1], outline[:, 0], color=color, label=name)
        force.plot(*over, color=color)
        approach.hist(speeds, bins=np.linspace(0.0, 2.5, 26), histtype="step", color=color, linewidth=1.5)
        ratios, expected = seated_tension_ratios(name)
        place = np.arange(len(ratios))
        decay.semilogy(place, ratios, "o", color=color)
        decay.semilogy(place, expected**place, "--", color=color, linewidth=1.0)
        yield ("seated chain, T(i+1)/T(i)", f"{np.round(ratios[1:] / ratios[:-1], 3)}, expected {expected:.3f}")
    turn, radius = np.linspace(0.0, 2.0 * math.pi, 100), 1e3 * one.pitch_radius(0)
    shape.plot(1e3 * ROLLER * np.sin(turn), radius + 1e3 * ROLLER * np.cos(turn), color="0.6", linewidth=0.8)
    shape.set(xlabel="across the gap [mm]", ylabel="from the center [mm]", title="tooth gap, with its roller")
    shape.set_aspect("equal")
    shape.legend(fontsize=8, loc="center")
    force.set(xlabel="pitches since arrival", ylabel="mean contact force [N]", title="on the driven sprocket")
    approach.set(xlabel="approach speed along the normal [m/s]", ylabel="rollers", title="rollers that arrive")
    decay.set(xlabel="link around the wrap", ylabel="tension over the largest", title="seated, closed form dashed")
    decay.set_ylim(5e-3, 1.5)
    yield {"profiles": figure}


ELONGATIONS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03)  # of the chain; its outer links have twice that
LINK = 40  # the one that is worn alone, an outer one
SHOWN = "iso606, maximum gap"


def climbed_radius(trajectory: Any, rollers: slice) -> Any:
    """Pitches since arrival on the driver, and there the rollers' mean radius over the pitch radius, less one [%]."""
    off = np.hypot(*np.moveaxis(radial_places(trajectory, 0), -1, 0)) / trajectory.model.pitch_radius(0) - 1.0
    return means_over_pitches(trajectory, 0, 100.0 * off, np.arange(0.5, TEETH / 2 - 0.4, 0.25), rollers)


def draw_worn_driver(axes: Axes, trajectory: Any) -> None:
    """The driver with its chain at the end of the run."""
    teeth = turn_points(tooth_outline(trajectory.model, 0), (0.0, 0.0), trajectory.sprocket_angle[-1, 0])
    axes.fill(*(1e3 * teeth).T, color="0.85", ec="0.4", linewidth=0.8)
    rollers, radius = 1e3 * trajectory.position[-1], 1e3 * trajectory.drive.chain.roller_radius
    turn = np.linspace(0.0, 2.0 * math.pi, 60)
    for x, y in rollers[rollers[:, 0] < 60.0]:
        axes.plot(x + radius * np.cos(turn), y + radius * np.sin(turn), color=COLORS[0], linewidth=1.0)
    circle = 1e3 * trajectory.model.pitch_radius(0)
    axes.plot(circle * np.cos(turn), circle * np.sin(turn), ":", color="0.3", linewidth=0.8)
    axes.plot(*np.vstack([rollers, rollers[:1]]).T, color=COLORS[1], linewidth=0.8)
    axes.set(xlim=(-100, 60), ylim=(-95, 95), xlabel="[mm]", title=f"{SHOWN}, {100 * ELONGATIONS[-1]:g} % longer")
    axes.set_aspect("equal")


@case()
def wear(asked: argparse.Namespace) -> Iterator[Line]:
    """A chain that wears: rollers climb the flanks as outer links lengthen, on the drive of `profiles`.

    python scripts/figures.py wear

    Wear lengthens outer links only, by twice what the chain grows on the whole. The driven sprocket moves out with it,
    as a tensioner would have it. Radial places are means over a second of running, taken by the pitches since a roller
    came to the driver.
    """
    cases = [(name, e) for name in PROFILES for e in ELONGATIONS]
    drives = [profile_drive(name, {"chain.outer": {"elongation": 2.0 * e}}, e) for name, e in cases]
    drives.append(profile_drive(SHOWN, {"chain.worn_links": [{"link": LINK, "elongation": 0.03}]}))
    run = simulate(drives, record=Record(rate=2e3), window=(BEGIN, END))
    rows = run.metrics.to_pylist()
    figure, (place, climb, picture, single) = panel_grid(4, 2, 5.5, 4.25)
    yield ("profile", "elongation [%]", "climb, outer / inner link follows [%]", "tension [N]", "losses [W]", "status")
    heights = np.empty((len(cases), 2))
    for v, (name, e) in enumerate(cases):
        for first, style in enumerate(("-", "--")):
            where, off = climbed_radius(run[v], slice(first, None, 2))
            heights[v, first] = off.max()
            if name == SHOWN:
                label = None if first else f"{100 * e:g} %"
                place.plot(where, off, style, color=f"C{ELONGATIONS.index(e)}", label=label)
        climbs = " / ".join(f"{height:.2f}" for height in heights[v])
        tension = f"{rows[v]['tension_mean']:.0f}, most {rows[v]['tension_max']:.0f}"
        yield (name, 100 * e, climbs, tension, contact_losses(rows[v]), rows[v]["status"])
    percent = 100.0 * np.array(ELONGATIONS)
    for name, color, mine in zip(PROFILES, COLORS, np.split(heights, len(PROFILES)), strict=True):
        climb.plot(percent, mine[:, 0], "o-", color=color, label=f"{name}: an outer link follows")
        climb.plot(percent, mine[:, 1], "o--", color=color, mfc="white", label=f"{name}: an inner one")
    climb.plot(percent, percent, ":", color="0.4", label="an outer and an inner link on every two teeth")
    for k, label in enumerate(("the roller before", "its first roller", "its second roller", "the roller after")):
        where, off = climbed_radius(run[len(cases)], slice(LINK - 1 + k, LINK + k))
        single.plot(where, off, label=label)
        yield f"one link longer by 3 %: {label} up to {off.max():.2f} %"
    draw_worn_driver(picture, run[cases.index((SHOWN, ELONGATIONS[-1]))])
    places = {"xlabel": "pitches since arrival on the driver", "ylabel": "off the pitch circle [%]"}
    place.set(title=f"{SHOWN}; dashed: an inner link follows", **places)
    climb.set(title="highest rollers on the driver, mean", **places | {"xlabel": "elongation of the chain [%]"})
    single.set(title=f"{SHOWN}, one link 3 % longer", **places)
    for axes in (place, climb, single):
        axes.legend(fontsize=8)
    yield {"wear": figure}


WORN: dict[str, tuple[float, Values]] = {
    "new chain": (0.0, {}),
    "all links 0.75 % longer": (0.0075, {"chain.elongation": 0.0075}),
    "outer links 1.5 % longer": (0.0075, {"chain.outer": {"elongation": 0.015}}),
}
JOINT = {"friction": 0.1, "pin_radius": 4.14e-3}  # of a 16B


@case()
def wear_spectrum(asked: argparse.Namespace) -> Iterator[Line]:
    """Spectra of a drive whose chain is new, has outer links alone longer, and has all links longer alike.

    python scripts/figures.py wear-spectrum

    The drive of `profiles` (19 teeth, 60 rad/s) with friction in its joints, so that it runs quietly. Both
    worn chains are 0.75 % longer as a whole. Spectra are of the later half of 2 s, over orders of the driver's tooth
    passing.
    """
    record = Record(rate=1e4, channels=("position", "tension", "sprocket_angle", "sprocket_speed", "sprocket_center"))
    rubs = {"chain.joint": JOINT, "run.duration": 2.0}
    drives = [profile_drive("iso606, minimum gap", rubs | values, longer, 3e-4) for longer, values in WORN.values()]
    run = simulate(drives, record=record)
    figure, axes = panel_column(2, 7.0, "", None)
    orders = [f"{what}, order {order}" for what in ("tight strand [N]", "driven speed [%]") for order in ("1/2", "1")]
    yield ("chain", *orders, "status")
    for v, (name, color) in enumerate(zip(WORN, ("0.55", *COLORS), strict=False)):
        speed: Any = run[v].channels()["sprocket_speed"][:, 1]
        found = []
        signals = (strand_tension(run[v], 1), 100.0 * speed / speed[len(speed) // 2 :].mean())
        for axis, values in zip(axes, signals, strict=True):
            spectrum: Any = order_spectrum(run[v], values)
            order, size = spectrum[0] / TEETH, spectrum[1]
            axis.semilogy(order, size, color=color, lw=1.1, label=name)
            found += [float(size[np.abs(order - at) < 0.02].max()) for at in (0.5, 1.0)]
        yield (name, *found, run.metrics["status"][v].as_py())
    for axis, label in zip(axes, ("tight strand's tension [N]", "driven speed over its mean [%]"), strict=True):
        low, high = axis.get_ylim()
        axis.set(ylabel=label, xlim=(0.0, 2.6), ylim=(max(low, 1e-5 * high), high))
    axes[0].legend(loc="upper right", fontsize=9)
    axes[1].set(xlabel="order of the tooth passing (1 is z, 1/2 is z/2 of a revolution)")
    yield {"wear-spectrum": figure}
