"""The network alone as an FMU: what would be the solver's model description, with the channels as inputs."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from fmucorrect import units
from fmucorrect.bundle import Info
from fmucorrect.fmu import Variable
from fmucorrect.signals import NANOSECONDS
from fmucorrect.wrapping import description_xml
from fmucorrect.wrapping.conversion import TIME, Wired
from fmucorrect.wrapping.wiring import Source, Wiring

STATE_2 = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
STATE_3 = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
BASE = ("kg", "m", "s", "A", "K", "rad")


def wiring(info: Info, fmi: int) -> Wiring:
    """What the corrector sees, the channels first, are the inputs, in order; all conditions that it has are tunables that begin
    where training was."""
    kind = "Real" if fmi == 2 else "Float64"
    seen = tuple(
        Source(
            Variable(channel.name, kind, "input", unit=channel.unit, reference=j, start="0"),
            1.0,
            channel.name in info.held,
        )
        for j, channel in enumerate(info.seen)
    )
    tunables = {key: _middle([float(c.get(key, 0.0)) for c in info.conditions]) for key in info.features}
    return Wiring(seen, {}, tunables, {})


def wired(wiring: Wiring, fmi: int) -> tuple[Wired, ...]:
    """Inputs by value reference; in FMI 3.0 the time behind them."""
    rows = tuple(Wired(0, source.variable.reference) for source in wiring.seen)
    return rows if fmi == 2 else (*rows, Wired(TIME, 0))


def model_description(info: Info, fmi: int) -> bytes:
    """The description of an FMU that has nothing but the channels as inputs."""
    root = ET.Element("fmiModelDescription", {"fmiVersion": "2.0" if fmi == 2 else "3.0", "modelName": info.name})
    root.set("guid" if fmi == 2 else "instantiationToken", "")
    root.set("variableNamingConvention", "structured")
    fixed = {"canHandleVariableCommunicationStepSize": "false", "modelIdentifier": "network"}
    ET.SubElement(root, "CoSimulation", fixed | (STATE_2 if fmi == 2 else STATE_3))
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(channel.unit for channel in info.seen if channel.unit):
        unit = units.parse(name)
        base = {symbol: str(power) for symbol, power in zip(BASE, unit.dimension, strict=True) if power}
        factor = {} if unit.factor == 1.0 else {"factor": repr(unit.factor)}
        ET.SubElement(ET.SubElement(definitions, "Unit", {"name": name}), "BaseUnit", base | factor)
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0", "stepSize": repr(info.step_ns / NANOSECONDS)})
    variables = ET.SubElement(root, "ModelVariables")
    if fmi == 3:
        independent = {"name": "time", "valueReference": str(len(info.seen)), "causality": "independent"}
        ET.SubElement(variables, "Float64", independent | {"variability": "continuous", "unit": "s"})
        if all(channel.unit != "s" for channel in info.seen):
            ET.SubElement(ET.SubElement(definitions, "Unit", {"name": "s"}), "BaseUnit", {"s": "1"})
    for j, channel in enumerate(info.seen):
        common = {"name": channel.name, "valueReference": str(j), "causality": "input", "variability": "continuous"}
        text = " ".join(part for part in (channel.quantity, channel.axis, channel.positive) if part)
        if text:
            common["description"] = f"simulated {text}"
        value = {"start": "0"} | ({"unit": channel.unit} if channel.unit else {})
        if fmi == 2:
            ET.SubElement(ET.SubElement(variables, "ScalarVariable", common), "Real", value)
        else:
            ET.SubElement(variables, "Float64", common | value)
    ET.SubElement(root, "ModelStructure")
    return description_xml.write(root)


def _middle(values: list[float]) -> float:
    return sorted(values)[len(values) // 2] if values else 0.0
