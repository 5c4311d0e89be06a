"""Settings of a drive's run: steps, sampling, initial state; and probes of the chain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from warpchain.drive.schema import Name, Pair, Part, Positive, Problem, Switch, Value, are_numbers, node_value

Integrator = Annotated[Literal["leapfrog", "rk4"], Value('must be "leapfrog" or "rk4"')]
Phase = Annotated[float, Field(strict=True, ge=-0.5, le=0.5), Value("must be a number from -0.5 to 0.5 (teeth)")]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63), Value("must be an integer of at least 0")]
Step = Annotated[
    Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] | Literal["auto"],
    Value('must be a positive number or "auto"'),
]


class RunSettings(Part):
    """Settings of a run.

    Attributes:
        settle: find static equilibrium before the first step.
        start: the run is a start; limits for steady running do not judge it.
        duration: simulated time [s].
        step: time step [s], at most the duration; or "auto".
        integrator: "leapfrog" or "rk4".
        sample_rate: samples of trajectories a second [Hz].
        gravity: acceleration of gravity [m/s^2].
        phase: teeth by which the driver starts turned on [-].
        seating: seed of rollers' initial places within the clearance; None is none.
        perturbation: seed of initial displacements of rollers by some 1e-9 pitches; None is none.
    """

    settle: Switch = True
    start: Switch = False
    duration: Positive
    step: Step
    integrator: Integrator = "leapfrog"
    sample_rate: Positive
    gravity: Pair = (0.0, -9.81)
    phase: Phase | None = None
    seating: Seed | None = None
    perturbation: Seed | None = None

    _renamed: ClassVar[Mapping[str, str]] = {"nudge": "perturbation"}

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problem of a step longer than the run."""
        step, duration = node_value(node, "step"), node_value(node, "duration")
        if are_numbers(step, duration) and step > duration > 0:
            yield Problem(("step",), step, f"must be at most the duration, {duration:g}")


class Probe(Part):
    """A place at which the passing chain is sensed.

    Attributes:
        name: unique among all parts.
        at: place [m].
        radius: distance at which the chain is sensed [m]; None is a pitch.
        chain: chain that it senses, where there are several.
    """

    name: Name
    at: Pair
    radius: Positive | None = None
    chain: Name | None = None
