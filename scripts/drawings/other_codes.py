"""The same simple drive in other codes: results of docs/validation.md, which need the extra `codes`."""

import math
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from common.cases import Line
from common.drives import equal_sprocket_values, two_sprockets
from numpy.typing import NDArray

from drawings.closed_forms import ValidationRow
from drawings.modes import top_speed
from warpchain import Drive, Record, simulate
from warpchain.assembly.assembly import assemble
from warpchain.assembly.timestep import resolve_step
from warpchain.model import Model
from warpchain.results.run import require_channels

Array = NDArray[np.float64]
VALUES = equal_sprocket_values(20, 61, 0.05, slack=0.002) | {
    "chain.stiffness": 1e7,
    "chain.damping": 1000.0,
    "contact.sprocket.stiffness": 1e8,
    "sprockets.driven.load": {"torque": 150.0, "viscous": 15.0},
    "run.gravity": [0.0, 0.0],
    "run.settle": True,
    "run.step": "auto",
    "run.duration": 1.0,
    "run.sample_rate": 1000.0,
}
WINDOW = 0.5
"""Part of a run of which means are taken, its latter."""
CLEARANCE = 1e-4
"""Of a roller between teeth, as in the drive file [m]."""
HEAVY = 1e9
"""Inertia of a driver that nothing slows down [kg m^2]."""
STEP = 5e-5
"""Of the other codes [s]."""
CONTACT = (2e8, 4000.0)
"""Of a sphere in Exudyn: stiffness [N/m], two in series having that of the drive's contact, and damping [N s/m]."""


class CodeResult(NamedTuple):
    """Results of one code on the simple drive.

    Attributes:
        tension: (F, 2) of the links in the middle of both strands [N].
        ratio: (F,) the driven sprocket's speed over the driver's.
        step: [s].
        cost: CPU time for a second of the drive [s].
    """

    tension: Array
    ratio: Array
    step: float
    cost: float


class CodeFrames:
    """Frames of the latter part of a run."""

    def __init__(self, drive: Drive, step: float) -> None:
        self.drive, self.step, self.begun = drive, step, time.process_time()
        self.tension: list[Array] = []
        self.ratio: list[float] = []

    def add(self, position: Array, driven: float) -> None:
        """Positions of the rollers (N, 2) [m], and the driven sprocket's speed [rad/s]."""
        chain = self.drive.chain
        link, middle = np.roll(position, -1, axis=0) - position, 0.5 * (np.roll(position, -1, axis=0) + position)
        tension = chain.stiffness * (np.hypot(*link.T) - chain.pitch)
        apart = np.abs(middle[:, 0] - 0.5 * self.drive.sprockets[1].center[0])
        sides = [np.argmin(np.where(side * middle[:, 1] > 0.0, apart, np.inf)) for side in (1.0, -1.0)]
        self.tension.append(tension[sides])
        self.ratio.append(driven / top_speed(self.drive))

    def result(self) -> CodeResult:
        """The latter part of them."""
        cost = (time.process_time() - self.begun) / self.drive.run.duration
        first = int(WINDOW * len(self.ratio))
        return CodeResult(np.array(self.tension[first:]), np.array(self.ratio[first:]), self.step, cost)


def run_warpchain(drive: Drive) -> CodeResult:
    """The drive here, on one core."""
    simulate(drive, device="cpu", record=Record("none"), duration=0.001)  # compiles
    frames = CodeFrames(drive, resolve_step(drive))
    trajectory = simulate(drive, device="cpu", record=Record(channels=("position", "sprocket_speed")))[0]
    for position, speed in zip(*require_channels(trajectory, "position", "sprocket_speed"), strict=True):
        frames.add(np.asarray(position, float), float(speed[1]))
    return frames.result()


def sprocket_spheres(drive: Drive) -> Iterator[tuple[float, float, float]]:
    """Places on a sprocket and radii [m] of a hub that carries the rollers and of teeth that fill the gaps between."""
    radius, count, roller = Model(drive).chain.pitch_radius(0), drive.sprockets[0].teeth, drive.chain.roller_radius
    yield 0.0, 0.0, radius - roller
    tooth = 2.0 * radius * math.sin(math.pi / (2 * count)) - roller - CLEARANCE
    for angle in (np.arange(count) + 0.5) * math.tau / count:
        yield radius * math.cos(angle), radius * math.sin(angle), tooth


def run_mujoco(drive: Drive) -> CodeResult:
    """In MuJoCo: rollers that slide along x and y, links as tendons, each sprocket a disk with round teeth."""
    import mujoco

    assembly, chain = assemble(drive), drive.chain
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = STEP, [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    contact: dict[str, Any] = {"condim": 1, "solref": [4.0 * STEP, 1.0], "solimp": [0.99, 0.999, 1e-4, 0.5, 2.0]}
    roller, wheel = {"contype": 1, "conaffinity": 2}, {"contype": 2, "conaffinity": 1}
    sphere, slide, hinge = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for k, (x, y) in enumerate(assembly.position):
        body = spec.worldbody.add_body(pos=[x, y, 0.0])
        for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
            body.add_joint(type=slide, axis=axis)
        body.add_geom(type=sphere, size=[chain.roller_radius, 0, 0], mass=chain.roller_mass, **roller, **contact)
        body.add_site(name=f"{k}")
    for s, sprocket in enumerate(drive.sprockets):
        turned = 0.5 * float(assembly.sprocket_angle[s])
        body = spec.worldbody.add_body(pos=[*sprocket.center, 0.0], quat=[math.cos(turned), 0, 0, math.sin(turned)])
        viscous = sprocket.load.viscous if sprocket.load else 0.0
        inertia = {"armature": sprocket.inertia or HEAVY, "damping": [viscous, 0, 0]}
        body.add_joint(name=f"turn{s}", type=hinge, axis=[0.0, 0.0, 1.0], **inertia)
        for x, y, radius in sprocket_spheres(drive):
            body.add_geom(type=sphere, pos=[x, y, 0.0], size=[radius, 0, 0], mass=1e-6, **wheel, **contact)
    for k in range(chain.links):
        tendon = spec.add_tendon(stiffness=[chain.stiffness, 0, 0], damping=[chain.damping, 0, 0])
        tendon.springlength = [chain.pitch, chain.pitch]
        for end in (k, (k + 1) % chain.links):
            tendon.wrap_site(f"{end}")
    model = spec.compile()
    data, turns = mujoco.MjData(model), 2 * chain.links + np.arange(2)
    data.qvel[: 2 * chain.links] = assembly.velocity.ravel()
    data.qvel[turns] = assembly.sprocket_speed
    load = drive.sprockets[1].load
    assert load is not None
    data.qfrc_applied[turns[1]] = -load.torque * np.sign(assembly.sprocket_speed[1])
    frames, start = CodeFrames(drive, STEP), assembly.position.ravel()
    every = round(1.0 / (drive.run.sample_rate * STEP))
    for step in range(round(drive.run.duration / STEP)):
        mujoco.mj_step(model, data)
        if step % every == 0:
            place = (start + data.qpos[: 2 * chain.links]).reshape(-1, 2)
            frames.add(place, abs(float(data.qvel[turns[1]])))
    return frames.result()


def run_exudyn(drive: Drive) -> CodeResult:
    """In Exudyn: point masses, links as springs with dampers, each sprocket a body that turns, with round teeth."""
    import exudyn
    from exudyn import itemInterface as items

    assembly, chain, load = assemble(drive), drive.chain, drive.sprockets[1].load
    assert load is not None
    system = exudyn.SystemContainer().AddSystem()
    contact = system.AddGeneralContact()
    contact.verboseMode = 0
    contact.SetFrictionPairings(np.zeros((1, 1)))
    contact.SetSearchTreeCellSize([60, 30, 1])
    contact.SetSearchTreeBox([-0.3, -0.3, -0.1], [1.4, 0.3, 0.1])
    markers, turns = [], []
    for place, velocity in zip(assembly.position, assembly.velocity, strict=True):
        node = system.AddNode(items.NodePoint2D(referenceCoordinates=place, initialVelocities=velocity))
        system.AddObject(items.MassPoint2D(nodeNumber=node, mass=chain.roller_mass))
        markers.append(system.AddMarker(items.MarkerNodePosition(nodeNumber=node)))
        contact.AddSphereWithMarker(markers[-1], chain.roller_radius, *CONTACT, 0)
    for ends in zip(markers, markers[1:] + markers[:1], strict=True):
        spring = {"referenceLength": chain.pitch, "stiffness": chain.stiffness, "damping": chain.damping}
        system.AddObject(items.ObjectConnectorSpringDamper(markerNumbers=list(ends), **spring))
    for s, sprocket in enumerate(drive.sprockets):
        cosine, sine = math.cos(assembly.sprocket_angle[s]), math.sin(assembly.sprocket_angle[s])
        node = system.AddNode(
            items.Node1D(
                referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[assembly.sprocket_speed[s]]
            )
        )
        body = system.AddObject(
            items.ObjectRotationalMass1D(
                nodeNumber=node,
                inertia=sprocket.inertia or HEAVY,
                referencePosition=[*sprocket.center, 0.0],
                referenceRotation=[[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]],
            )
        )
        for x, y, radius in sprocket_spheres(drive):
            marker = system.AddMarker(items.MarkerBodyPosition(bodyNumber=body, localPosition=[x, y, 0.0]))
            contact.AddSphereWithMarker(marker, radius, *CONTACT, 0)
        turns.append(system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)))
    ground = system.AddNode(items.NodePointGround())
    held = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    system.AddObject(items.CoordinateSpringDamper(markerNumbers=[held, turns[1]], damping=load.viscous))
    torque = -load.torque * float(np.sign(assembly.sprocket_speed[1]))
    system.AddLoad(items.LoadCoordinate(markerNumber=turns[1], load=torque))
    frames, start = CodeFrames(drive, STEP), assembly.position.ravel()

    def record_frame(of: Any, *_: Any) -> list[float]:
        """Adds rollers' places and the speed to the frames."""
        place = start + of.systemData.GetODE2Coordinates()[: 2 * chain.links]
        frames.add(place.reshape(-1, 2), abs(float(of.systemData.GetODE2Coordinates_t()[-1])))
        return [0.0]

    system.AddSensor(items.SensorUserFunction(sensorUserFunction=record_frame, writeToFile=False))
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(drive.run.duration / STEP)
    settings.timeIntegration.endTime = drive.run.duration
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1.0 / drive.run.sample_rate
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.VelocityVerlet)
    return frames.result()


OTHERS: dict[str, tuple[str, Callable[[Drive], CodeResult]]] = {
    "MuJoCo": ("mujoco", run_mujoco),
    "Exudyn": ("exudyn", run_exudyn),
}
"""Other codes: their package and the drive in them."""


def result_text(result: CodeResult) -> str:
    """A result in words."""
    tight, slack = result.tension.T
    return (
        f"{tight.mean():.0f} ± {tight.std():.0f} and {slack.mean():.0f} ± {slack.std():.0f} N, ratio "
        f"{result.ratio.mean():.4f}, {result.ratio.min():.3f} to {result.ratio.max():.3f}; {result.cost:.2g} s of CPU, "
        f"steps of {1e6 * result.step:.0f} us"
    )


def other_codes() -> Iterator[Line]:
    """A simple drive in warpchain, MuJoCo and Exudyn: results side by side."""
    drive = two_sprockets(VALUES)
    own = run_warpchain(drive)
    ours = own.tension.mean(axis=0)
    for name, (package, made) in OTHERS.items():
        other = made(drive)
        theirs = other.tension.mean(axis=0)
        pulls = [float(pull[0] - pull[1]) for pull in (ours, theirs)]
        yield ValidationRow(
            name=f"other codes: {name}",
            source=f"{name} {version(package)}, the drive built in `scripts/drawings/other_codes.py`",
            states=f"tight and slack link: {result_text(other)}",
            gives=result_text(own),
            differs=f"{ours[0] - theirs[0]:+.0f} and {ours[1] - theirs[1]:+.0f} N, tight less slack "
            f"{100.0 * (pulls[0] / pulls[1] - 1.0):+.1f} %, ratio {own.ratio.mean() - other.ratio.mean():+.4f}",
        )
