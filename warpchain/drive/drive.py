"""`Drive`: a whole drive as data, checked as one; its files read and written."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import ModelWrapValidatorHandler, PrivateAttr, model_validator

from warpchain.argument_checks import check_arguments
from warpchain.drive import toml as drive_toml
from warpchain.drive.arms import Arm
from warpchain.drive.body_ties import driving_sprocket
from warpchain.drive.chain import Chain, NamedChain
from warpchain.drive.chain_rules import CHAIN_RULES, PARTS_NAMING_CHAINS, shaft_group_rules
from warpchain.drive.contact_settings import Contact
from warpchain.drive.csv_files import values_with_files
from warpchain.drive.defaults import values_with_defaults
from warpchain.drive.drive_rules import (
    PLACES,
    arm_rules,
    back_rules,
    count_rules,
    face_rules,
    guide_rules,
    load_rules,
    name_rules,
    pivot_rules,
    place_rules,
    profile_rules,
    pump_rules,
    rolling_rules,
    shaft_rules,
    size_rules,
    sprocket_rules,
    tensioner_rules,
    tooth_rules,
    wheel_rules,
)
from warpchain.drive.guides import Guide
from warpchain.drive.paths import changed_part, settable_paths, value_at_path
from warpchain.drive.plate import PLATE_KEYS
from warpchain.drive.run_settings import Probe, RunSettings
from warpchain.drive.schema import Allowed, Part, Problem, Rule, node_list, node_value
from warpchain.drive.shafts import Coupling, Gear, Shaft
from warpchain.drive.sprocket import END_TEETH, Sprocket, strand_names
from warpchain.drive.sprocket_teeth import is_catching, pitch_radius, sprocket_tooth
from warpchain.drive.tensioners import Tensioner
from warpchain.drive.thermal import (
    Expansions,
    Temperature,
    clearance_rules,
    expanded_parts,
    has_other_temperature,
    oil_rules,
)
from warpchain.drive.tooth_shape import Tooth, releasing_seat_angle
from warpchain.drive.train_rules import train_rules
from warpchain.drive.valves import Valves, valve_rules
from warpchain.errors import DriveError, drive_error, warn_caller
from warpchain.files import read_text_file, refusal_reason, write_text_file
from warpchain.notebook_renderer import rendered_html

RULES = (
    count_rules,
    *CHAIN_RULES,
    sprocket_rules,
    name_rules,
    place_rules,
    load_rules,
    shaft_rules,
    guide_rules,
    rolling_rules,
    size_rules,
    profile_rules,
    tooth_rules,
    wheel_rules,
    back_rules,
    face_rules,
    arm_rules,
    pivot_rules,
    tensioner_rules,
    pump_rules,
    train_rules,
    valve_rules,
)
"""Rules between a drive's parts, in the order of errors."""

FACES = ("start", "end", "points", "radius", "arcs", "profile", "end_radius")
PITCHES = ("chain.pitch", "chains.pitch")
NUMBER_RULES = {
    place_rules: {f"{kind}.{key}" for kind, keys in PLACES.items() for key in keys},
    guide_rules: {"guides.contact", "contact"},
    shaft_group_rules: {"chains", "shafts", "sprockets.center", "sprockets.mount"},
    size_rules: {*PITCHES, "chain.roller_radius", "chains.roller_radius", "contact", "guides.contact"},
    pivot_rules: {"sprockets.center", "sprockets.mount", "arms.pivot"},
    profile_rules: {*PITCHES, *(f"guides.{key}" for key in ("offset", "radius", "arcs", "profile", "end_radius"))},
    tooth_rules: {*PITCHES, "sprockets", "chain.roller_radius", "chains.roller_radius"},
    wheel_rules: {*PITCHES, "sprockets.teeth", *(f"{of}.{key}" for of in ("chain", "chains") for key in PLATE_KEYS)},
    back_rules: {*PITCHES, "sprockets.center", *(f"guides.{key}" for key in FACES)},
    face_rules: {*PITCHES, *(f"guides.{key}" for key in FACES)},
    tensioner_rules: {*PITCHES, "sprockets", "guides", "arms", "tensioners"},
    train_rules: {"chains", "sprockets", "shafts", "gears", "couplings"},
}
"""Rules that compare numbers, with these numbers' keys."""


class _NoSingleChain(DriveError, AttributeError):
    """Raised where `chain` of several is read."""


class Drive(Part):
    """A roller-chain drive: immutable, compared and hashed by value.

    Attributes:
        chain: the chain of a drive with one.
        chains: chains of a drive with several.
        sprockets: (S,) in their chain's order.
        guides: (G,) guides.
        arms: (A,) bodies that turn about a pivot.
        tensioners: (T,) of arms, or of sprockets on sliders.
        contact: contact settings.
        run: run settings.
        probes: places where the passing chain is sensed.
        shafts: (H,) that sprockets turn with.
        gears: gear pairs between shafts.
        couplings: springs and dampers with play between shafts.
        temperature: temperature of the drive [degrees C]; None is 20.
        expansion: coefficients of expansion; None is an aluminum block, steel wheels and chain.
        valves: groups of valves that cams lift.

    Raises:
        DriveError: one line for each value that is missing, unknown or not allowed.
    """

    chain: Annotated[Chain, Allowed("must be a table")] = None  # type: ignore[assignment]  # see `__getattr__`
    chains: Annotated[tuple[NamedChain, ...], Allowed("must be a list of chains")] = ()
    sprockets: Annotated[tuple[Sprocket, ...], Allowed("must be a list of at least 2 sprockets")]
    guides: Annotated[tuple[Guide, ...], Allowed("must be a list of guides")] = ()
    arms: Annotated[tuple[Arm, ...], Allowed("must be a list of arms")] = ()
    tensioners: Annotated[tuple[Tensioner, ...], Allowed("must be a list of tensioners")] = ()
    contact: Contact
    run: RunSettings
    probes: Annotated[tuple[Probe, ...], Allowed("must be a list of probes")] = ()
    shafts: Annotated[tuple[Shaft, ...], Allowed("must be a list of shafts")] = ()
    gears: Annotated[tuple[Gear, ...], Allowed("must be a list of gear pairs")] = ()
    couplings: Annotated[tuple[Coupling, ...], Allowed("must be a list of couplings")] = ()
    valves: Annotated[tuple[Valves, ...], Allowed("must be a list of groups of valves")] = ()
    temperature: Temperature | None = None
    expansion: Expansions = None

    _as_read: Drive | None = PrivateAttr(None)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name == "chain":
                self.require_single_chain()
            return super().__getattr__(name)

    def _repr_html_(self) -> str:
        """The drive as HTML for notebooks."""
        return rendered_html(self)

    @property
    def as_read(self) -> Drive:
        """The drive with its file's sizes, at 20 degrees C."""
        return self if self._as_read is None else self._as_read

    def apply_temperature(self) -> None:
        """Replaces sizes and oil by those at the drive's temperature."""
        if has_other_temperature(self):
            as_read = super().model_copy()
            self.__dict__.update(expanded_parts(self))
            self._as_read = as_read

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Unchecked copy of the drive; changed parts remove its temperature."""
        copied = super().model_copy(update=update, deep=deep)
        if self._as_read is not None and update:
            run_alone = update.keys() == {"run"}
            copied._as_read = self._as_read.model_copy(update=update) if run_alone else None
            copied.__dict__["temperature"] = self.temperature if run_alone else None
        return copied

    @check_arguments(DriveError)
    def with_values(self, values: Mapping[str, Any]) -> Self:
        """Changed copy of the drive, checked like a file.

        A value replaces others for the same, as damping damping_ratio; None takes one away.

        Args:
            values: by key path, such as "sprockets.camshaft.load.torque"; elements of a list by name or index.

        Raises:
            DriveError: one line for each unknown path or wrong value.
        """
        copied: Self = changed_part(self.as_read, values)  # type: ignore[assignment]  # of the same class
        return copied

    @check_arguments(DriveError)
    def get_value(self, path: str) -> Any:
        """Value of the drive at a key path; None where not given.

        Raises:
            DriveError: an unknown path.
        """
        return value_at_path(self.as_read, path)

    def paths(self) -> tuple[str, ...]:
        """Key paths that `with_values` can set."""
        return tuple(settable_paths(self))

    def require_single_chain(self) -> None:
        """Raises a DriveError for a drive of several chains."""
        if self.chains:
            names = ", ".join(chain.name for chain in self.chains)
            raise _NoSingleChain(f"chains: there are several, {names}; this takes drives of one chain, [chain]")

    @property
    def links(self) -> int:
        """Number of links of all chains, or their rollers."""
        return sum(chain.rollers for chain in self.each_chain)

    @property
    def each_chain(self) -> tuple[Chain, ...]:
        """The chains of the drive, one or more."""
        return self.chains or (self.chain,)

    @property
    def chain_prefixes(self) -> tuple[str, ...]:
        """Prefixes "CHAIN." of chains' names, "" of a single one."""
        return tuple(f"{chain.name}." for chain in self.chains) or ("",)

    @property
    def sprockets_by_chain(self) -> tuple[tuple[Chain, tuple[Sprocket, ...]], ...]:
        """Each chain of the drive with its sprockets, in order."""
        names = [getattr(chain, "name", None) for chain in self.each_chain]
        around = [tuple(of for of in self.sprockets if of.chain == name) for name in names]
        return tuple(zip(self.each_chain, around, strict=True))

    @property
    def driver(self) -> int:
        """Index of the drive's driving sprocket."""
        return driving_sprocket(self)

    @property
    def strand_names(self) -> tuple[str, ...]:
        """Names (S,) "FROM->TO" of strands; of several chains "CHAIN.FROM->TO"."""
        found: list[str] = []
        for prefix, (_, sprockets) in zip(self.chain_prefixes, self.sprockets_by_chain, strict=True):
            found += (f"{prefix}{name}" for name in strand_names(sprockets))
        return tuple(found)

    @classmethod
    def _source(cls) -> str:
        """Prefix of a drive's error lines: none."""
        return ""

    @classmethod
    def _problem(cls, detail: Any, values: Any) -> Problem:
        """A validator's error as a problem of the drive."""
        problem = super()._problem(detail, values)
        is_list = problem.path == ("chain",) and isinstance(problem.value, list | tuple)
        return problem._replace(text="must be a table; a list of them is chains, [[chains]]") if is_list else problem

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems between the parts of a drive."""
        chain, wrong = node_value(node, "chain"), False
        if isinstance(chain, list | tuple) and not node_list(node, "chains"):  # an error already
            node = dict(node) | {"chain": None, "chains": chain}
        for rule in RULES:
            for problem in rule(node):
                wrong = True
                yield problem
        if not wrong:
            yield from temperature_rules(node)

    @classmethod
    def _number_rules(cls, changed: Mapping[str, Any]) -> Sequence[Rule]:
        """Rules of the drive that changed numbers can break."""
        keys = set(changed)
        for kind, parts in changed.items():
            for key, inner in parts.items() if isinstance(parts, Mapping) else ():
                keys.update(f"{kind}.{name}" for name in (inner if isinstance(key, int) else (key,)))
        return [*(rule for rule, read in NUMBER_RULES.items() if not read.isdisjoint(keys)), temperature_rules]

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """A drive's values with all defaults and a single chain as `chain`."""
        return values_with_defaults(cls._with_single_chain(values))

    @classmethod
    def _with_single_chain(cls, values: Any) -> Any:
        """A drive's values with a single chain as `chain`."""
        chains = node_list(values, "chains")
        if not isinstance(values, Mapping) or len(chains) != 1 or values.get("chain") is not None:
            return values
        if not isinstance(chains[0], Mapping | NamedChain):
            return values
        alone = dict(chains[0])
        name, _ = alone.pop("name", None), alone.pop("plane", None)
        whole = {key: value for key, value in values.items() if key != "chains"} | {"chain": alone}
        for kind in PARTS_NAMING_CHAINS:
            whole[kind] = [_part_without_name(part, "chain", name) for part in node_list(values, kind)]
        return _values_without_names(whole)

    @model_validator(mode="wrap")
    @classmethod
    def _warn(cls, values: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Drive at its temperature, with warnings of what is unusual."""
        drive = handler(values)
        if drive is values:
            return drive
        if drive.chains:
            del drive.__dict__["chain"]
        drive.apply_temperature()
        for chain in drive.each_chain:
            if chain.links % 2 and not chain.is_open:
                of = f"chains.{chain.name}" if isinstance(chain, NamedChain) else "chain"
                warn_caller(f"{of}.links = {chain.links}: an odd number needs an offset link")
        for arm in drive.arms:
            least = arm.mass * arm.center_radius**2
            if arm.inertia < least:
                warn_caller(f"arms.{arm.name}.inertia = {arm.inertia:g}: its mass at its center alone has {least:g}")
        for chain, sprockets in drive.sprockets_by_chain:
            for sprocket in sprockets:
                _warn_if_catching(sprocket, chain, sprocket_tooth(sprocket, chain, drive.contact.sprocket))
        return drive


def temperature_rules(drive: Any) -> Iterator[Problem]:
    """Problems of a drive that arise at its temperature."""
    if not isinstance(drive, Drive) or not has_other_temperature(drive):
        return
    known = list(oil_rules(drive))
    yield from known
    if not known:
        there = drive.model_copy(update=expanded_parts(drive))
        for rule in (clearance_rules, *RULES):
            for problem in rule(there):
                yield problem._replace(text=f"{problem.text}, at {drive.temperature:g} degrees C")


def _warn_if_catching(sprocket: Sprocket, chain: Chain, tooth: Tooth) -> None:
    """Warns of a sprocket whose straight flanks catch rollers."""
    if is_catching(sprocket, chain, tooth):
        limit = math.degrees(releasing_seat_angle(pitch_radius(sprocket, chain), chain.pitch))
        warn_caller(
            f"contact.sprocket.seat_angle = {math.degrees(tooth.seat_angle):g}: the straight flanks of "
            f'"{sprocket.name}" ({sprocket.teeth} teeth) catch the rollers of its strands; '
            f"they let them go below {limit:.1f} degrees"
        )


def _part_without_name(part: Any, key: str, name: Any) -> Any:
    """A part without its chain or shaft of this name."""
    if node_value(part, key) != name:
        return part
    if isinstance(part, Part):
        return part.model_copy(update={key: None})
    return {own: value for own, value in part.items() if own != key} if isinstance(part, Mapping) else part


def _values_without_names(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a single chain's drive without its name."""
    if any(node_list(values, kind) for kind in ("gears", "couplings")):
        return values
    kept = []
    for shaft in node_list(values, "shafts"):
        name, held = node_value(shaft, "name"), (node_value(shaft, key) for key in Shaft.model_fields if key != "name")
        on = sum(node_value(sprocket, "shaft") == name for sprocket in values["sprockets"])
        if on == 1 and all(value is None for value in held):
            values["sprockets"] = [_part_without_name(sprocket, "shaft", name) for sprocket in values["sprockets"]]
        else:
            kept.append(shaft)
    return values | {"shafts": kept}


@check_arguments(DriveError)
def loads_drive(text: str, source: str = "<text>", folder: str | os.PathLike[str] | None = None) -> Drive:
    """Drive of a TOML text.

    Args:
        source: name of the text in error lines.
        folder: of files that it names; None allows none.

    Raises:
        DriveError: one line for each error of the text.
    """
    values = drive_toml.parse_toml(text, source)
    if folder is not None:
        values = values_with_files(values, Path(folder), source)
    try:
        return Drive(**values)
    except DriveError as error:
        raise drive_error(error.errors, source) from None


@check_arguments(DriveError)
def load_drive(path: str | os.PathLike[str]) -> Drive:
    """Drive of a TOML file.

    Raises:
        DriveError: unreadable, or one line for each error.
    """
    return loads_drive(read_drive_text(path), str(path), Path(path).parent)


def read_drive_text(path: str | os.PathLike[str]) -> str:
    """Text of a drive file, unchecked.

    Raises:
        DriveError: unreadable or not UTF-8.
    """
    return read_text_file(path, "TOML", lambda reason: drive_error([reason], str(path)))


@check_arguments(DriveError)
def dumps_drive(drive: Drive) -> str:
    """A drive as TOML text with all defaults."""
    return drive_toml.toml_text(drive_values(drive))


def drive_values(drive: Drive) -> dict[str, Any]:
    """Values of a drive, defaults included, as nested tables."""
    values: dict[str, Any] = _values_without_empty_lists(drive.as_read.model_dump(exclude_none=True))
    for sprocket in values["sprockets"]:
        if sprocket["teeth"] == END_TEETH:
            del sprocket["teeth"]
    for chain in values.get("chains") or [values["chain"]]:
        if chain["kind"] == "silent":
            del chain["roller_radius"]
    return values


def _values_without_empty_lists(value: Any) -> Any:
    """Values of a drive without empty lists."""
    if isinstance(value, dict):
        return {key: _values_without_empty_lists(inner) for key, inner in value.items() if inner != ()}
    return [_values_without_empty_lists(inner) for inner in value] if isinstance(value, tuple) else value


@check_arguments(DriveError)
def save_drive(drive: Drive, path: str | os.PathLike[str]) -> None:
    """Writes a drive file, replacing one at once and whole.

    Raises:
        DriveError: it cannot be written.
    """
    write_drive_text(dumps_drive(drive), path)


def write_drive_text(text: str, path: str | os.PathLike[str]) -> None:
    """Writes a drive file's text; replaces and raises as `save_drive`."""
    try:
        write_text_file(Path(path), text)
    except OSError as error:
        raise drive_error([f"cannot be written: {refusal_reason(error).lower()}"], str(path)) from None
