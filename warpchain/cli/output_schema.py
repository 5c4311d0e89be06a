"""The JSON schema of what `check --json` and `run --json` print.

A number's SI unit is its keyword `unit`, "1" for a ratio or a count. What has a value only in some drives is null, or
left out where the description says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from warpchain.drive.chain import Joint
from warpchain.drive.json_schema import DIALECT
from warpchain.drive.quantities import attribute_descriptions, unit_of_key
from warpchain.drive.thermal import Expansion
from warpchain.results.statuses import STATUSES

FORMAT = 1
"""Format of the output: another number has other keys."""

Schema = dict[str, Any]


def _value_schema(kind: str, text: str, null: bool, **more: Any) -> Schema:
    """JSON schema of an output's value of a type, or null."""
    return {"type": [kind, "null"] if null else kind, "description": text, **more}


def _number_schema(unit: str, text: str, null: bool = False) -> Schema:
    """JSON schema of an output's number with its unit."""
    return _value_schema("number", text, null, unit=unit)


def _count_schema(text: str) -> Schema:
    """JSON schema of an output's whole number from 0 on."""
    return _value_schema("integer", text, False, unit="1", minimum=0)


def _text_schema(text: str, null: bool = False, **more: Any) -> Schema:
    """JSON schema of an output's text."""
    return _value_schema("string", text, null, **more)


def _flag_schema(text: str) -> Schema:
    """JSON schema of an output's true or false."""
    return _value_schema("boolean", text, False)


def _list_schema(text: str, item: Schema, null: bool = False) -> Schema:
    """JSON schema of an output's list of like items."""
    return _value_schema("array", text, null, items=item)


def _table_schema(text: str, values: Schema, null: bool = False, optional: tuple[str, ...] = ()) -> Schema:
    """JSON schema of an output's object with these keys, required but for `optional` ones."""
    required = [key for key in values if key not in optional]
    return _value_schema("object", text, null, properties=values, required=required, additionalProperties=False)


def _mapping_schema(text: str, item: Schema) -> Schema:
    """JSON schema of an output's object whose keys are names."""
    return _value_schema("object", text, False, additionalProperties=item)


_NAME = _text_schema("its name")
_BETWEEN = _list_schema("names of the two shafts", _text_schema("a name"))

_SPROCKET = {
    "name": _NAME,
    "teeth": _count_schema("number of teeth"),
    "pitch_radius": _number_schema("m", "of the polygon of seated rollers"),
    "riding_radius": _number_schema("m", "at which the chain leaves and arrives"),
    "tip_radius": _number_schema("m", "of the teeth's tips"),
    "seat_angle": _number_schema("rad", "arc of a tooth's seat"),
    "wrap": _number_schema("rad", "angle over which the chain is on it"),
    "contact_stiffness": _number_schema("N/m^n", "of a roller on a tooth"),
    "catches": _flag_schema("whether the chain can come off it and catch again"),
}
_STRAND = {
    "name": _text_schema("from which sprocket to which"),
    "length": _number_schema("m", "straight or around guides, at assembly"),
    "links": _count_schema("its links"),
    "standing_tension": _number_schema("N", "mean at rest, seated and unloaded"),
    "standing_frequency": _number_schema("Hz", "first transverse frequency at rest"),
    "working_tension": _number_schema(
        "N",
        "mean at the driver's speed at work with all loads on, centrifugal part included, and what inertias ask for "
        "where it still speeds up",
    ),
    "centrifugal_tension": _number_schema("N", "m v^2/p, which presses no roller on its seat"),
    "working_frequency": _number_schema(
        "Hz", "f = (c^2 - v^2)/(2 L c), c = sqrt(T p/m): of a string of length L that moves at speed v"
    ),
    "free_lengths": _list_schema(
        "its straight parts that lie on no guide, in order; frequencies are those of the longest",
        _number_schema("m", "a length"),
    ),
    "working_displacement": _number_schema(
        "m",
        "of the chain at mid-strand, positive to the left of its travel: sag, and the effect of guide-bars and "
        "tensioners; as the metric `STRAND.displacement_mean`; null without a steady state",
        null=True,
    ),
}
_GUIDE = {
    "name": _NAME,
    "contact_stiffness": _number_schema("N/m^n", "of a roller on its face"),
    "law": _text_schema("contact law"),
    "rebound": _number_schema("1", "speed of a free roller after an impact over that before"),
    "friction": _number_schema("1", "coefficient of sliding friction"),
    "face_length": _number_schema("m", "of its face without the rounded ends"),
    "touch": _table_schema(
        "where its strand's path bends around it at work; null where it does not",
        {
            "strand": _text_schema("which strand"),
            "places": _list_schema("from, to along the face", _number_schema("m", "a place")),
            "wrap": _number_schema("rad", "angle by which the path bends"),
            "load": _number_schema("N/m", "(T - m v^2/p)/R', the largest of its arcs"),
            "force": _number_schema("N", "total force"),
        },
        null=True,
    ),
}
_ARM = {
    "name": _NAME,
    "angle": _number_schema("rad", "at assembly, from the drawing"),
    "standing_angle": _number_schema("rad", "at rest; null without a steady state", null=True),
    "working_angle": _number_schema("rad", "at work; null without a steady state", null=True),
    "stops": _list_schema("lower and upper stop; null without stops", _number_schema("rad", "an angle"), null=True),
    "on_stop": _text_schema(
        "the stop on which it stands at work; null for none", null=True, enum=["lower", "upper", None]
    ),
}
_TENSIONER = {
    "name": _NAME,
    "on": _text_schema("what it pushes"),
    "static_pressure": _number_schema(
        "Pa", "at which the check valve lets in what goes out; null without oil", null=True
    ),
    "extension": _number_schema("m", "position of its body at assembly"),
    "standing_extension": _number_schema("m", "at rest; null without a steady state", null=True),
    "working_extension": _number_schema("m", "at work; null without a steady state", null=True),
    "force": _number_schema("N", "static force at assembly"),
    "standing_force": _number_schema("N", "static force at rest; null without a steady state", null=True),
    "working_force": _number_schema("N", "static force at work; null without a steady state", null=True),
}
_MOUNT = {
    "name": _text_schema("of the sprocket whose center moves"),
    "kind": _text_schema("kind of its mount"),
    "mass": _number_schema("kg", "mass that moves"),
    "frequencies": _list_schema("of the mount without the chain", _number_schema("Hz", "a frequency")),
    "working_travel": _list_schema(
        "x and y from a moving center's stated position to its mean position at work; null without a steady state",
        _number_schema("m", "a coordinate"),
        null=True,
    ),
    "wheel_force": _number_schema("N", "centrifugal force of a balance wheel at work"),
}
_SHAFT = {
    "name": _NAME,
    "with": _list_schema("what turns as one with it", _text_schema("a name")),
    "speed": _number_schema("rad/s", "at work; null of a shaft that nothing turns with a chain", null=True),
    "inertia": _number_schema(
        "kg m^2",
        "referred to the shaft, of all parts that turn as one with it; null where its motion is prescribed",
        null=True,
    ),
    "motor_at_rest": _number_schema("N m", "moment of its motor at rest; null without a motor", null=True),
    "motor_at_work": _number_schema("N m", "moment of its motor at work; null without a motor or a speed", null=True),
}
_GEAR = {
    "name": _NAME,
    "between": _BETWEEN,
    "teeth": _list_schema("of the two wheels", _count_schema("teeth")),
    "ratio": _number_schema("1", "speed of the second shaft over that of the first"),
}
_COUPLING = {
    "name": _NAME,
    "between": _BETWEEN,
    "frequency": _number_schema("Hz", "of the oscillation between the inertias at its two ends, without the chain"),
    "damping_ratio": _number_schema("1", "of that oscillation"),
    "lash": _number_schema("rad", "angle without a moment"),
    "ratios": _list_schema(
        "of a gearbox, in order, 0 for open; null for none", _number_schema("1", "a ratio"), null=True
    ),
    "clutch": _number_schema("N m", "moment that its clutch passes on at most; null without a clutch", null=True),
    "freewheel": _flag_schema("whether it passes on moments one way only"),
    "working_twist": _number_schema(
        "rad",
        "of the first shaft against the second at work, counter-clockwise; null without a steady state",
        null=True,
    ),
    "working_torque": _number_schema("N m", "taken from the first at work; null without a steady state", null=True),
}
_VALVE = {
    "name": _NAME,
    "on": _text_schema("the shaft of its cams"),
    "count": _count_schema("number of valves"),
    "lift": _number_schema("m", "largest lift"),
    "slope": _number_schema("m/rad", "steepest lift by the angle"),
    "spring_force": _number_schema("N", "of a spring at the largest lift"),
    "float_speed": _number_schema("rad/s", "speed of its shaft above which followers lift off"),
    "driver_float_speed": _number_schema("rad/s", "that of the driver; null where nothing ties the two", null=True),
}
_VALVES = _list_schema("left out without valves", _table_schema("a group of valves", _VALVE))
_DRIVER = {
    "name": _NAME,
    "prescribed": _flag_schema("whether its motion is prescribed"),
    "start": _number_schema("rad/s", "speed at the start"),
    "speed": _number_schema("rad/s", "speed at work"),
    "acceleration": _number_schema("rad/s^2", "at work"),
}
_STRENGTH = {
    "working": _number_schema("N", "largest tension of a strand at work"),
    "run_up": _table_schema(
        "where the chain pulls harder on the way to work; null where it does not",
        {
            "tension": _number_schema("N", "largest tension there"),
            "speed": _number_schema("rad/s", "of the driver there"),
            "acceleration": _number_schema("rad/s^2", "of the driver there"),
        },
        null=True,
    ),
    "peak": _number_schema("N", "the larger of both, with the loads at their peaks"),
    "left_out": _list_schema("what none of these contains", _text_schema("a cause")),
    "static_safety": _number_schema("1", "breaking load over the tension at work"),
    "dynamic_safety": _number_schema("1", "breaking load over the peak"),
    "yield_load": _number_schema("N", "tension from which links stay longer"),
    "yield_safety": _number_schema("1", "that over the peak"),
    "joint_area": _number_schema("m^2", "d2 b2 of ISO 606; null where the size has none", null=True),
    "pressure": _number_schema("Pa", "in the joints at work; null without an area", null=True),
    "peak_pressure": _number_schema("Pa", "in the joints at the peak; null without an area", null=True),
}
_RATING = {
    "standard": _text_schema("that rates the size"),
    "power": _number_schema("W", "that the chain passes on at work"),
    "rated_power": _number_schema("W", "for the smaller sprocket at its speed"),
    "use": _number_schema("1", "power over the rated one"),
    "limited_by": _text_schema("what limits the rated power"),
    "teeth": _count_schema("of the smaller sprocket"),
    "speed": _number_schema("rad/s", "of the smaller sprocket"),
    "rated_life": _number_schema("s", "at the rated power"),
    "elongation_limit": _number_schema("1", "elongation at the end of the life"),
    "wear_life": _number_schema(
        "s", "until that elongation by Archard's law at work; null where nothing wears", null=True
    ),
    "lubrication": _text_schema("class of ASME B29.1"),
    "lubrication_limits": _list_schema(
        "speeds of the chain up to which A and B will do", _number_schema("m/s", "a speed")
    ),
    "left_out": _text_schema("what the rating leaves out"),
}
_SAG = {
    "strand": _text_schema("the strand that is slackest at work"),
    "sag": _number_schema("m", "at rest"),
    "length": _number_schema("m", "of the strand"),
    "movement": _number_schema("m", "by hand, to both sides together"),
    "slack": _number_schema("1", "that over the length"),
}
_CRITICAL = {
    "strand": _text_schema('which strand, "" for all'),
    "frequency": _number_schema("Hz", "natural frequency"),
    "teeth_speed": _number_schema("rad/s", "driver's speed at which its teeth have it"),
    "revolution_speed": _number_schema("rad/s", "driver's speed at which its revolutions have it"),
}
_JOINT = {
    key: _number_schema(
        unit_of_key(Joint, key).replace("-", "1") or "1",
        attribute_descriptions(Joint).get(key, key),
        field.default is None,
    )
    for key, field in Joint.model_fields.items()
}
_OUTER = {
    "elongation": _number_schema("1", "pitch over that of inner links, less 1"),
    "stiffness": _number_schema("N/m", "of an outer link"),
    "damping": _number_schema("N s/m", "of an outer link"),
}
_STEP = {
    "step": _number_schema("s", "the step"),
    "step_limit": _number_schema("s", "from which on steps are unstable"),
    "stiffest_part": _text_schema("what sets this limit"),
    "automatic_step": _number_schema("s", "the largest that keeps 1 %"),
}
_CHAIN = {
    "links": _count_schema("number of links"),
    "pitch": _number_schema("m", "without wear"),
    "elongation": _number_schema("1", "mean elongation by wear"),
    "kind": _text_schema("roller or silent"),
    "roller_mass": _number_schema("kg", "mass of the chain over its rollers"),
    "size": _text_schema("of the catalogue; null for none", null=True),
    "breaking_load": _number_schema("N", "of the size; null for none", null=True),
    "driver": _table_schema("the sprocket that drives, at the start and at work", _DRIVER),
    "strength": _table_schema("of a chain with a size, else null", _STRENGTH, null=True),
    "stiffness": _number_schema("N/m", "of a link"),
    "stiffness_is_estimate": _flag_schema("whether that is the catalogue's estimate"),
    "joint": _table_schema("friction in the joints; left out where the file has none", _JOINT),
    "outer": _table_schema("outer links; left out where they are as the inner ones", _OUTER),
    "play": _number_schema("m", "of a link's two joints; left out where it is 0"),
    "chain_speed": _number_schema("m/s", "speed on the driver's pitch circle at work"),
    "mean_chain_speed": _number_schema("m/s", "teeth times pitch a second at work"),
    "rating": _table_schema("null where no standard rates the size", _RATING, null=True),
    "sag": _table_schema("of the slack strand at rest; null on guides and without gravity", _SAG, null=True),
    "critical_speeds": _table_schema(
        "natural frequencies, and the driver's speeds at which something has them; without those that do not exist",
        {
            name: _table_schema(text, _CRITICAL)
            for name, text in (
                ("transverse", "of strands across"),
                ("longitudinal", "of strands lengthwise"),
                ("torsional", "of sprockets against each other"),
            )
        },
        optional=("transverse", "longitudinal", "torsional"),
    ),
    "strain": _number_schema("1", "of the links at assembly, below 0 where the chain is slack"),
    "nominal_strain": _number_schema("1", "that with every roller on its pitch circle"),
    "preload": _number_schema("N", "at assembly: k p times the strain of strands drawn straight from seat to seat"),
    "layout": _list_schema(
        "faults in the positions of the parts; printed as `LAYOUT`",
        _text_schema("a fault"),
    ),
    "advice": _list_schema(
        "the rules of thumb that the drive breaks; printed as `LOOK AT`", _text_schema("what to look at")
    ),
    "sprockets": _list_schema("in the drive's order", _table_schema("a sprocket", _SPROCKET)),
    "standing_preload": _number_schema(
        "N",
        "preload of the drive at rest without loads, as the rollers' seats or a tensioner change it: mean over the "
        "strands' links",
    ),
    "strands": _list_schema("strand k leaves sprocket k", _table_schema("a strand", _STRAND)),
    "tensions_estimated": _text_schema(
        "why no steady state was found: the force left, on which part, and what to do. Tensions are then a quick "
        "estimate without seats, mounts and weight; null where one was",
        null=True,
    ),
    "law": _text_schema("contact law of teeth"),
    "rebound": _number_schema("1", "speed of a free roller after an impact on a tooth over that before"),
    "friction": _number_schema("1", "coefficient of sliding friction on teeth"),
    "guides": _list_schema("in the drive's order", _table_schema("a guide", _GUIDE)),
    "arms": _list_schema("in the drive's order", _table_schema("an arm", _ARM)),
    "tensioners": _list_schema("in the drive's order", _table_schema("a tensioner", _TENSIONER)),
    "shafts": _list_schema("left out without shafts", _table_schema("a shaft", _SHAFT)),
    "gears": _list_schema("left out without gears", _table_schema("a pair of gears", _GEAR)),
    "couplings": _list_schema("left out without couplings", _table_schema("a coupling", _COUPLING)),
    "valves": _VALVES,
    "mounts": _list_schema("sprockets whose centers move", _table_schema("a mount", _MOUNT)),
    "tooth_passing_frequency": _number_schema("Hz", "of the driver's teeth at work"),
    **_STEP,
}
_CHAIN_OPTIONAL = ("joint", "outer", "play", "shafts", "gears", "couplings", "valves")
_SHARED_SHAFT = {
    "name": _NAME,
    "sprockets": _list_schema("on it", _text_schema("a name")),
    "ratio": _number_schema("1", "its speed over the driver's"),
    "speed": _number_schema("rad/s", "at work"),
}
_SEVERAL = {
    "chains": _mapping_schema("each chain by its name, with the loads that it passes on", {"$ref": "#/$defs/chain"}),
    "shafts": _list_schema("shafts of all chains", _table_schema("a shaft", _SHARED_SHAFT)),
    "valves": _VALVES,
    **_STEP,
}
_TEMPERATURE = {
    "temperature": _number_schema("°C", "of the drive"),
    **{of: _number_schema("1", "elongation against 20 °C") for of in Expansion.model_fields},
    "viscosity": _mapping_schema("kinematic, of oils by tensioner", _number_schema("m^2/s", "of the oil")),
}
_LOSS = {
    "energy": _number_schema("J", "dissipated over the window"),
    "power": _number_schema("W", "that over the window's time"),
    "input_share": _number_schema("1", "that energy over the input work; null where none came in", null=True),
}
_RUN = {
    "ended": _text_schema("whether it came to its end", enum=["complete", "interrupted"]),
    "device": _text_schema('where it ran, such as "cpu" or "cuda:0"'),
    "precision": _text_schema("of its numbers", enum=["float64", "float32"]),
    "step": _number_schema("s", "its step"),
    "created": _text_schema("time of its start, UTC, ISO 8601"),
    "wall_time": _number_schema("s", "that it took"),
    "archive": _text_schema("its archive; null without -o", null=True),
}
_HEAD = {
    "format": {"const": FORMAT, "description": "number of this format"},
    "version": _text_schema("of warpchain"),
    "units": {"const": "SI", "description": "of all numbers but `defaults`; temperatures in degrees Celsius"},
    "drive": _text_schema("file or example, as the command line names it"),
    "defaults": _value_schema(
        "object", "values that the drive file leaves out, by key path, as it would state them", False
    ),
    "temperature": _table_schema("left out where the drive has none", _TEMPERATURE),
}
_RESULT = {
    "run": _table_schema("how the run was made", _RUN),
    "status": _text_schema("what the run is judged to be", enum=list(STATUSES)),
    "reasons": _list_schema("why it is not ok", _text_schema("a reason")),
    "losses": _mapping_schema(
        "by group, the largest first; none where the window was not reached", _table_schema("losses of a group", _LOSS)
    ),
    "metrics": _mapping_schema(
        "by name; `warpchain metrics DRIVE --json` has units and words, and the page of metrics", {
            "type": ["number", "boolean", "null"], "description": "null for a quantity that the run lacks"},
    ),
}  # fmt: skip


def output_schema() -> Schema:
    """JSON schema of the output of `check --json` and `run --json`."""
    one, several = (
        _table_schema("of one chain", _CHAIN, optional=_CHAIN_OPTIONAL),
        _table_schema("of several chains", _SEVERAL),
    )
    several["required"].remove("valves")
    open_tables = [{key: value for key, value in of.items() if key != "additionalProperties"} for of in (one, several)]
    return {
        "$schema": DIALECT,
        "title": "warpchain check --json, warpchain run --json",
        "type": "object",
        "properties": _HEAD | _RESULT,
        "required": [key for key in _HEAD if key != "temperature"],
        "dependentRequired": {key: [other for other in _RESULT if other != key] for key in _RESULT},
        "anyOf": open_tables,
        "unevaluatedProperties": False,
        "$defs": {"chain": one},
    }


def described_values(schema: Schema, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Key path, unit and description of each value in a schema, such as `strands[].length`."""
    for key, value in schema.get("properties", {}).items():
        place = f"{path}.{key}" if path else key
        inner = value.get("items") or value.get("additionalProperties") or value
        yield place, inner.get("unit", ""), value["description"]
        within = "[]" if "items" in value else "" if inner is value else ".NAME"
        yield from described_values(inner, place + within)
