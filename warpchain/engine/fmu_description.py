"""Model description of an FMU (FMI 3.0): variables, units and capabilities as XML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from warpchain.drive import Drive
from warpchain.engine.input_ports import InputPort
from warpchain.engine.output_ports import OutputPort
from warpchain.errors import SimulationError
from warpchain.results.channels import AXIS_LABELS, CHANNEL_BY_NAME
from warpchain.version import installed_version

BASE_UNITS = {
    "s": {"s": 1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}
"""Exponents of SI base units, by unit."""


@dataclass(frozen=True)
class Variable:
    """Variable of an FMU, a number."""

    name: str
    unit: str
    description: str
    start: float | None = None  # of an input


def input_variables(port: InputPort, starts: Sequence[float]) -> list[Variable]:
    """Variables of an FMU's input: one, or a place's x and y."""
    part, _, kind = port.name.rpartition(".")
    text = f"{kind.replace('_', ' ')} of {part}; until it is set the drive has its own"
    names = [f"{port.name}.{axis}" for axis in AXIS_LABELS] if port.kind.is_led else [port.name]
    return [Variable(name, port.kind.unit, text, start) for name, start in zip(names, starts, strict=True)]


def output_variables(port: OutputPort, drive: Drive) -> list[Variable]:
    """Variables of an FMU's output: PART.CHANNEL, or CHANNEL.I of rollers and links."""
    part, _, name = port.name.rpartition(".")
    channel = CHANNEL_BY_NAME[name]
    if part:
        names = [f"{part}.{name}"]
    elif channel.is_of_rollers:
        names = [f"{name}.{i}" for i in range(port.places.shape[1])]
    else:
        names = [f"{each.name}.{name}" for each in getattr(drive, f"{channel.per}s")]
    ends = [f".{of}" for of in channel.components] or [""]
    return [Variable(of + end, channel.unit, channel.description) for of in names for end in ends]


def check_names(variables: Sequence[Variable]) -> None:
    """Raises SimulationError for FMU variables named alike."""
    names = [variable.name for variable in variables]
    for name in names:
        if names.count(name) > 1:
            raise SimulationError(f"outputs: {name!r} is there twice")


def model_description(
    drive: Drive,
    identifiers: tuple[str, str],
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
    step: float,
    interval: int,
) -> bytes:
    """XML model description of an FMU; value references are 0 of time, then inputs', then outputs'.

    Args:
        identifiers: library's name, and instantiation token.
        step: time step h [s].
        interval: default steps between communications.
    """
    library, token = identifiers
    top = ElementTree.Element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": library, "instantiationToken": token,
        "description": f"Roller-chain drive, {drive.links} links, time step {step:g} s",
        "generationTool": f"warpchain {installed_version()}", "variableNamingConvention": "flat",
    })  # fmt: skip
    able = ("canGetAndSetFMUState", "canSerializeFMUState", "canHandleVariableCommunicationStepSize")
    ElementTree.SubElement(
        top,
        "CoSimulation",
        {"modelIdentifier": library, "fixedInternalStepSize": repr(step)} | dict.fromkeys(able, "true"),
    )
    units = ElementTree.SubElement(top, "UnitDefinitions")
    for name in dict.fromkeys(["s", *(variable.unit for variable in (*inputs, *outputs))]):
        unit = ElementTree.SubElement(units, "Unit", {"name": name})
        ElementTree.SubElement(unit, "BaseUnit", {of: str(power) for of, power in BASE_UNITS[name].items()})
    ElementTree.SubElement(ElementTree.SubElement(top, "LogCategories"), "Category", {"name": "logStatusError"})
    experiment = {"startTime": "0", "stopTime": repr(drive.run.duration), "stepSize": repr(interval * step)}
    ElementTree.SubElement(top, "DefaultExperiment", experiment)
    held = ElementTree.SubElement(top, "ModelVariables")
    independent = {"causality": "independent", "unit": "s", "description": "instant that the drive has come to"}
    ElementTree.SubElement(
        held, "Float64", {"name": "time", "valueReference": "0", "variability": "continuous"} | independent
    )
    structure = ElementTree.SubElement(top, "ModelStructure")
    for reference, variable in enumerate((*inputs, *outputs), 1):
        is_input = variable.start is not None
        said = {"name": variable.name, "valueReference": str(reference), "unit": variable.unit}
        said |= {"causality": "input" if is_input else "output", "variability": "continuous"}
        said |= {"description": variable.description} | ({"start": repr(variable.start)} if is_input else {})
        ElementTree.SubElement(held, "Float64", said)
        if not is_input:
            ElementTree.SubElement(structure, "Output", {"valueReference": str(reference)})
    for reference in range(len(inputs) + 1, len(inputs) + len(outputs) + 1):
        ElementTree.SubElement(structure, "InitialUnknown", {"valueReference": str(reference)})
    ElementTree.indent(top)
    return ElementTree.tostring(top, encoding="utf-8", xml_declaration=True)
