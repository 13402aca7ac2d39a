"""Writes modelDescription.xml for FMI 2.0 and 3.0 co-simulation, and buildDescription.xml, from a model's variables.

The standards are FMI 2.0.4 and FMI 3.0.2 (Modelica Association). Both descriptions come from the same list, so that
names, units, start values and value references cannot differ between the two.
"""

import xml.etree.ElementTree as ET

from fmu_variables import Model, Variable

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
LOG_CATEGORIES = {
    "logStatusError": "Refused calls and failed steps, always logged",
    "logAll": "What the instance does, logged when the host asks for it",
}


def _element(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """A child element; attributes that are None are left out."""

    def text(value: object) -> str:
        return {True: "true", False: "false"}[value] if isinstance(value, bool) else str(value)

    return ET.SubElement(parent, tag, {key: text(value) for key, value in attributes.items() if value is not None})


def _causality(v: Variable) -> dict[str, str | None]:
    causality = {"tunable": "parameter", "state": "local", "derivative": "local"}.get(v.kind, v.kind)
    variability = {"parameter": "fixed", "tunable": "tunable"}.get(v.kind, "continuous")
    initial = {
        "input": None,
        "independent": None,
        "output": "calculated",
        "local": "calculated",
        "derivative": "calculated",
    }
    return {"causality": causality, "variability": variability, "initial": initial.get(v.kind, "exact")}


def _limits(v: Variable) -> dict[str, object]:
    return {"unit": v.unit.name, "min": v.min, "max": v.max, "nominal": v.nominal, "start": v.start}


def _common_elements(root: ET.Element, model: Model) -> None:
    definitions = _element(root, "UnitDefinitions")
    for unit in {v.unit.name: v.unit for v in model.variables}.values():
        exponents = {name: unit.exponents[name] for name in BASE if unit.exponents.get(name)}
        _element(
            _element(definitions, "Unit", name=unit.name),
            "BaseUnit",
            **exponents,
            factor=unit.factor if unit.factor != 1 else None,
            offset=unit.offset or None,
        )
    categories = _element(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        _element(categories, "Category", name=name, description=description)
    _element(root, "DefaultExperiment", startTime=0.0, stopTime=model.stop_time, stepSize=model.step_size)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _root(model: Model, version: str, **token: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            **token,
            "description": model.description,
            "license": "Apache-2.0",
            "generationTool": "fmucorrect tools/build_fmus.py",
            "variableNamingConvention": "structured",
        },
    )


def description_fmi2(model: Model, token: str, sources: list[str]) -> bytes:
    """modelDescription.xml of FMI 2.0 co-simulation; sources are the C files to compile."""
    root = _root(model, "2.0", guid=token)
    cs = _element(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        needsExecutionTool=False,
        canHandleVariableCommunicationStepSize=True,
        canInterpolateInputs=False,
        maxOutputDerivativeOrder=0,
        canRunAsynchronuously=False,
        canBeInstantiatedOnlyOncePerProcess=False,
        canNotUseMemoryManagementFunctions=True,
        canGetAndSetFMUstate=True,
        canSerializeFMUstate=True,
        providesDirectionalDerivative=True,
    )
    files = _element(cs, "SourceFiles")
    for name in sources:
        _element(files, "File", name=name)
    _common_elements(root, model)
    listed = _element(root, "ModelVariables")
    derivatives = dict(zip(model.of_kind("derivative"), model.of_kind("state"), strict=True))
    for reference, v in enumerate(model.variables):
        scalar = _element(
            listed, "ScalarVariable", name=v.name, valueReference=reference, description=v.description, **_causality(v)
        )
        state = derivatives.get(reference)
        _element(scalar, "Real", **_limits(v), derivative=None if state is None else state + 1)
    structure = _element(root, "ModelStructure")
    for tag, kinds in (
        ("Outputs", ["output"]),
        ("Derivatives", ["derivative"]),
        ("InitialUnknowns", ["output", "derivative"]),
    ):
        references = model.of_kind(*kinds)
        if references:
            group = _element(structure, tag)
            for reference in references:
                _element(group, "Unknown", index=reference + 1)
    return _text(root)


def description_fmi3(model: Model, token: str) -> bytes:
    """modelDescription.xml of FMI 3.0 co-simulation."""
    root = _root(model, "3.0", instantiationToken=token)
    _element(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        needsExecutionTool=False,
        canBeInstantiatedOnlyOncePerProcess=False,
        canGetAndSetFMUState=True,
        canSerializeFMUState=True,
        providesDirectionalDerivatives=True,
        providesAdjointDerivatives=True,
        canHandleVariableCommunicationStepSize=True,
    )
    _common_elements(root, model)
    listed = _element(root, "ModelVariables")
    derivatives = dict(zip(model.of_kind("derivative"), model.of_kind("state"), strict=True))
    for reference, v in enumerate(model.variables):
        _element(
            listed,
            "Float64",
            name=v.name,
            valueReference=reference,
            description=v.description,
            **_causality(v),
            **_limits(v),
            derivative=derivatives.get(reference),
        )
    structure = _element(root, "ModelStructure")
    for tag, kinds in (
        ("Output", ["output"]),
        ("ContinuousStateDerivative", ["derivative"]),
        ("InitialUnknown", ["output", "derivative"]),
    ):
        for reference in model.of_kind(*kinds):
            _element(structure, tag, valueReference=reference)
    return _text(root)


def build_description(model: Model, sources: list[str]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0: how to compile the sources."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = _element(root, "BuildConfiguration", modelIdentifier=model.name)
    files = _element(configuration, "SourceFileSet", language="C11")
    for name in sources:
        _element(files, "SourceFile", name=name)
    return _text(root)
