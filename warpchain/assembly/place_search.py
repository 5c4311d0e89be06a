"""Search along lines for sprocket places with a wanted strain, sag, arm angle or wrap."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_paths
from warpchain.assembly.assembly import Assembly, assemble_stack, assembled_strains
from warpchain.assembly.path import MAX_STRAIN, ChainPath, allowed_results
from warpchain.model.stacks import pick_variants, stacks_of_drives

if TYPE_CHECKING:
    from warpchain.model import ChainModel

_PLACES = 4000  # most places tried along the line
_ENOUGH = 1e-10  # strain that the secant method may miss
_EXACT = 1e-7  # strain that a solution may miss; more is a jump where a roller changes seats
_SECANTS = 12
_HALVINGS = 200

Array = NDArray[np.float64]


class ReachedState(NamedTuple):
    """State that a place search reaches; NaN where no chain can be drawn or assembled.

    Attributes:
        strain: of the strands' links [-].
        chord: (2,) of the goal's strand, from seat to seat [m].
        angle: of the goal's arm [rad].
        wrap: of the goal's sprocket [rad].
    """

    strain: float = math.nan
    chord: tuple[float, float] = (math.nan, math.nan)
    angle: float = math.nan
    wrap: float = math.nan


NOWHERE = ReachedState()


@dataclass(frozen=True)
class PlacementGoal:
    """Goal of a place search.

    Attributes:
        text, unit: in words.
        over: excess of strain, or what counts as such.
        amount: what is reached, in the unit.
        strand, arm, around: whose chord, angle or wrap counts.
        sags: whether it matters where rollers stand.
    """

    text: str
    unit: str
    over: Callable[[ReachedState], float]
    amount: Callable[[ReachedState], float]
    strand: int = 0
    arm: int | None = None
    around: int | None = None
    sags: bool = False


class _PlaceQuestion(NamedTuple):
    """Place along the line [m] whose path or assembled state a search asks for."""

    along: float
    assembled: bool


Steps = Generator[_PlaceQuestion, ReachedState, Any]


class PlaceSearch:
    """Search for a sprocket's nearest place along a line that satisfies a goal.

    Args:
        line: unit vector (2,).
        travel: farthest either way [m]; None is wherever the chain could go round.
    """

    def __init__(
        self, model: ChainModel, index: int, line: tuple[float, float], goal: PlacementGoal, travel: float | None = None
    ) -> None:
        self.model, self.index, self.line, self.goal, self.travel = model, index, line, goal, travel
        self.origin = model.sprockets[index].center
        others = [s.center for i, s in enumerate(model.sprockets) if i != index]
        nearest = min(math.dist(self.origin, center) for center in others)
        around = nearest + 0.5 * model.chain.links * model.chain.pitch  # beyond it no chain of that length goes round
        self.reach = around if travel is None else travel
        self.step = max(0.25 * model.chain.pitch, 2.0 * self.reach / _PLACES)
        self.seen: list[tuple[float, ReachedState]] = []
        self.jumped = False  # over what is wanted, where rollers find other seats

    def center(self, place: float) -> tuple[float, float]:
        """Sprocket center at a place along the line [m]."""
        return self.origin[0] + place * self.line[0], self.origin[1] + place * self.line[1]

    def steps(self) -> Steps:
        """Place search as a generator: yields questions, is sent states, returns a place [m] or None."""
        ends = dict.fromkeys((-1.0, 1.0), (0.0, (yield from self._nominal_excess(0.0))))
        for chain in range(math.ceil(self.reach / self.step)):
            found = []
            for side, (inner, before) in ends.items():
                outer = side * min((chain + 1) * self.step, self.reach)
                after = yield from self._nominal_excess(outer)
                if before * after <= 0.0:
                    near = 1e-4 if self.goal.around is None else 1e-12
                    place = yield from _root_steps(
                        self._nominal_excess, (inner, before), (outer, after), near * self.step
                    )
                    found.append(place)
                ends[side] = outer, after
            for place in sorted((place for place in found if math.isfinite(place)), key=abs):
                exact = place if self.goal.around is not None else (yield from self._refined_place(place))
                if exact is not None:
                    return exact
        return None

    def _nominal_excess(self, place: float) -> Steps:
        """Excess over the search's goal by the path alone; NaN without a path."""
        reached = yield _PlaceQuestion(place, False)
        if not math.isfinite(reached.strain):
            return math.nan
        if (self.goal.arm, self.goal.around) != (None, None) or abs(reached.strain) <= MAX_STRAIN:
            self.seen.append((place, reached))
        return self.goal.over(reached)

    def _assembled_excess(self, place: float) -> Steps:
        """Excess over the search's goal of the assembled chain; NaN where none assembles."""
        return self.goal.over((yield _PlaceQuestion(place, True)))

    def _refined_place(self, place: float) -> Steps:
        """Place nearby at which the assembled chain satisfies the goal [m], or None."""
        exact = yield from self._secant_place(place)
        half = self.step / 32.0
        while exact is None and half <= 2.0 * self.model.chain.pitch:
            low, high = place - half, place + half
            below, above = (yield from self._assembled_excess(low)), (yield from self._assembled_excess(high))
            if below * above <= 0.0:
                exact = yield from _root_steps(self._assembled_excess, (low, below), (high, above), 1e-15)
                if not abs((yield from self._assembled_excess(exact))) <= _EXACT:
                    self.jumped = True
                    return None
            half *= 2.0
        return exact if exact is not None and abs(exact) <= self.reach else None

    def _secant_place(self, place: float) -> Steps:
        """Place nearby at which the assembled chain satisfies the goal [m], by secants, or None."""
        first, step = place, 1e-5 * self.model.chain.pitch
        before = yield from self._assembled_excess(place)
        for _ in range(_SECANTS):
            if abs(before) <= _ENOUGH:
                return place
            after = yield from self._assembled_excess(place + step)
            if not math.isfinite(after - before) or after == before:
                return None
            place, step, before = place + step, -after * step / (after - before), after
            if abs(place + step - first) > 2.0 * self.model.chain.pitch:
                return None
        return None

    def failure(self) -> str:
        """Error message of a place search in vain: what can be reached, and where."""
        name, direction = self.model.sprockets[self.index].name, [round(x, 6) for x in self.line]
        within = "" if self.travel is None else f" within {self.travel:g} m"
        text = f'sprocket "{name}": no place along {direction}{within} gives {self.goal.text}'
        if not self.seen:
            links, size = self.model.chain.links, 100.0 * MAX_STRAIN
            return f"{text}; nowhere on the line does a chain of {links} links fit within {size:g} % strain"
        places = [place for place, _ in self.seen]
        values = [self.goal.amount(reached) for _, reached in self.seen]
        unit, jump = self.goal.unit, ", but jumps over that" if self.jumped else ""
        return (
            f"{text}; it can have {min(values):.4g} to {max(values):.4g}{unit}, moved by {min(places):+.4g} to "
            f"{max(places):+.4g} m{jump}"
        )


def _root_steps(
    function: Callable[[float], Steps], low: tuple[float, float], high: tuple[float, float], enough: float
) -> Steps:
    """Place at which a search's function changes sign, to `enough` [m]; NaN without values in between.

    By Chandrupatla's method, Advances in Engineering Software 28 (1997) 145-149.

    Args:
        low, high: places with the function's values.
    """
    (a, at_a), (b, at_b) = low, high
    share = 0.5 if at_a == at_b else at_a / (at_a - at_b)
    for _ in range(_HALVINGS):
        place = a + share * (b - a)
        here = yield from function(place)
        if not math.isfinite(here):
            return math.nan
        (c, at_c) = (a, at_a)
        if (here > 0.0) != (at_a > 0.0):
            (c, at_c), (b, at_b) = (b, at_b), (a, at_a)
        a, at_a = place, here
        nearest = a if abs(at_a) <= abs(at_b) else b
        least = (0.5 * enough + 2e-16 * abs(nearest)) / abs(b - a) if a != b else 1.0
        if 0.0 in (at_a, at_b) or least > 0.5:
            return nearest
        along, rise = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        share = 0.5
        if rise**2 < along and (1.0 - rise) ** 2 < 1.0 - along:
            share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        share = min(max(share, least), 1.0 - least)
    return a


# ------------------------------------------------------------------------------------------------------- together


def run_searches(searches: Sequence[PlaceSearch]) -> list[float | None]:
    """Places that searches of drives find [m]; None for those in vain."""
    found: list[float | None] = [None] * len(searches)
    for stack in stacks_of_drives([search.model for search in searches]):
        members = stack.members.tolist()
        for v, place in zip(members, _StackSearch(stack.one, [searches[v] for v in members]).run(), strict=True):
            found[v] = place
    return found


class _StackSearch:
    """Place searches of a stack's variants, run together."""

    def __init__(self, model: ChainModel, searches: Sequence[PlaceSearch]) -> None:
        self.model, self.searches = model, searches

    def run(self) -> list[float | None]:
        """Places that a stack's searches find [m]; None for those in vain."""
        found: list[float | None] = [None] * len(self.searches)
        work = [search.steps() for search in self.searches]
        asked = {v: next(steps) for v, steps in enumerate(work)}
        while asked:
            for assembled in (False, True):
                rows = [v for v, place in asked.items() if place.assembled is assembled]
                if not rows:
                    continue
                answers = self._states_at_places(rows, [asked[v].along for v in rows], assembled)
                for v, reached in zip(rows, answers, strict=True):
                    try:
                        asked[v] = work[v].send(reached)
                    except StopIteration as end:
                        found[v] = end.value
                        del asked[v]
        return found

    def _states_at_places(self, rows: list[int], places: list[float], assembled: bool) -> list[ReachedState]:
        """States of some variants with their sprockets at places along the line."""
        goals = [self.searches[v].goal for v in rows]
        centers = [self.searches[v].center(place) for v, place in zip(rows, places, strict=True)]
        model, center = self.model, centers[0]
        if len(rows) < len(self.searches):
            model = pick_variants(model, np.array(rows))
        if len(rows) > 1:
            center = tuple(np.array(centers).T)  # of a stack
        answers = [NOWHERE] * len(rows)
        moved = _drive_with_center(model, self.searches[0].index, center)
        for members, states in allowed_results(moved, len(rows), _states_function(goals, assembled)):
            for v, reached in zip(
                members.tolist(), states.reached_by_goals([goals[v] for v in members.tolist()]), strict=True
            ):
                answers[v] = reached
        return answers


def _drive_with_center(model: ChainModel, index: int, center: tuple[float, float]) -> ChainModel:
    """Chain model or stack with sprocket `index` elsewhere, unchecked."""
    sprockets = list(model.sprockets)
    sprockets[index] = sprockets[index].model_copy(update={"center": center})
    return replace(model, sprockets=tuple(sprockets))


def _states_function(goals: Sequence[PlacementGoal], assembled: bool) -> Callable[[ChainModel], _States]:
    """Search's function of a stack to states: of paths, or of chains as goals need."""
    if not assembled:
        return _path_states
    return _placed_states if any(goal.sags for goal in goals) else _seat_states


@dataclass(frozen=True)
class _States:
    """Strains (V,), strand chords (V, S, 2), arm angles (V, A) and wraps (V, S) of a stack."""

    strain: Array
    chord: Array
    arms: Array
    wrap: Array

    def reached_by_goals(self, goals: Sequence[PlacementGoal]) -> list[ReachedState]:
        """State of each variant that a search reaches, as its goal takes it."""
        chords = self.chord[np.arange(len(goals)), [goal.strand for goal in goals]].tolist()
        angles = [math.nan if goal.arm is None else float(self.arms[v, goal.arm]) for v, goal in enumerate(goals)]
        wraps = [math.nan if goal.around is None else float(self.wrap[v, goal.around]) for v, goal in enumerate(goals)]
        return [
            ReachedState(strain, (x, y), angle, wrap)
            for strain, (x, y), angle, wrap in zip(self.strain.tolist(), chords, angles, wraps, strict=True)
        ]


def _path_states(model: ChainModel) -> _States:
    """States of a stack by its chain paths alone."""
    path = chain_paths(model)
    return _straight_states(path, path.nominal_strain)  # type: ignore[arg-type]  # (V,)


def _seat_states(model: ChainModel) -> _States:
    """States of a stack with its chains seated, without rollers of strands."""
    return _straight_states(*assembled_strains(model))


def _straight_states(path: ChainPath, strain: Array) -> _States:
    """States of a stack with strains (V,), its strands' chords on the path."""
    return _States(strain, path.strand_end - path.strand_start, path.arm_angle, path.wrap_angle)


def _placed_states(model: ChainModel) -> _States:
    """States of a stack with its chains assembled."""
    state = assemble_stack(model)
    wrap = state.path.wrap_angle
    return _States(state.strain, strand_chords(state), state.arm_angle, wrap)  # type: ignore[arg-type]  # (V,)


def strand_chords(state: Assembly) -> Array:
    """Chords of a stack's strands from seat to seat (V, S, 2) [m]."""
    count = state.position.shape[1]
    first, last = state.strand_first, (state.strand_first + state.strand_links) % count
    begin, end = (np.take_along_axis(state.position, places[..., None], axis=1) for places in (first, last))
    return np.asarray(end - begin)
