"""The description of a wrapped FMU in the solver's own version of FMI."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest
from descriptions import ALL, AWKWARD_2, AWKWARD_3, CHANNELS, by_name, inner, validated, wrapped

from fmucorrect.errors import WrapError
from fmucorrect.signals import Channel
from fmucorrect.wrapping import description_structure
from fmucorrect.wrapping.added import STATUS, Added, variables
from fmucorrect.wrapping.description import Capabilities

EVERYTHING = Added(CHANNELS, ("y",), {"speed": 80.0, "amplitude": 0.02, "frequency": 2.0, "start": 1.0}, True)
NAMES = [
    *("FW_corrected", "RW_corrected", "FW_sigma", "RW_sigma", "corrector_status", "correction_enabled"),
    *("corrector_speed", "corrector_amplitude", "corrector_frequency", "corrector_start", "effects_enabled"),
]


def added_to(name: str) -> Added:
    """Reads two outputs of one of this repository's FMUs."""
    root = ET.fromstring(inner(name))
    outputs = [v.get("name", "") for v in root.iterfind("ModelVariables/*") if v.get("causality") == "output"]
    return Added(CHANNELS, tuple(outputs[:2]), {"start": 1.5}, True)


@pytest.mark.parametrize("name", ["roller_rig", "oscillator", "wheelset", "cooperrider"])
@pytest.mark.parametrize("solver", [2, 3])
@pytest.mark.parametrize("fmi", [2, 3])
def test_own_fmus_stay_valid_in_every_combination(name: str, solver: int, fmi: int) -> None:
    name += "_fmi3" if solver == 3 else ""
    model = validated(wrapped(inner(name), fmi, added_to(name)))
    before, after = by_name(validated(inner(name))), by_name(model)
    assert set(after) == set(before) | {n for n in NAMES if n[10:] not in ("speed", "amplitude", "frequency")}
    for variable in before.values():
        same = after[variable.name]
        for key in ("causality", "variability", "initial", "unit", "start", "min", "max", "nominal", "description"):
            assert getattr(same, key) == getattr(variable, key), (variable.name, key)
        assert (same.derivative and same.derivative.name) == (variable.derivative and variable.derivative.name)


@pytest.mark.parametrize(("xml", "fmi"), [(AWKWARD_2, 2), (AWKWARD_3, 3)])
def test_what_the_solver_says_stays(xml: str, fmi: int) -> None:
    description = wrapped(xml, fmi, EVERYTHING)
    validated(description, structure=fmi == 2)  # fmpy expects aliases of outputs among the initial unknowns of FMI 3
    kept = xml.replace(' reinit="true"', "")  # which is of model exchange
    before, after = ET.fromstring(kept), ET.fromstring(description.xml)
    for tag in ("UnitDefinitions", "TypeDefinitions", "LogCategories", "ModelVariables"):
        old, new = before.find(tag), after.find(tag)
        for a, b in zip(old if old is not None else (), new, strict=False):
            assert _plain(a) == _plain(b)
    for tag in ("DefaultExperiment", "VendorAnnotations", "Annotations"):
        old, new = before.find(tag), after.find(tag)
        assert (old is None) == (new is None)
        if old is not None:
            assert _plain(old) == _plain(new)
    listed = [v.get("name") for v in after.iterfind("ModelVariables/*")][-len(NAMES) :]
    assert listed == NAMES
    assert after.get("author") == before.get("author")
    assert after.get("fmiVersion") == before.get("fmiVersion")
    assert (after.get("modelName"), after.get("generationTool")) == ("Outer", "test")
    assert after.get("guid" if fmi == 2 else "instantiationToken") == "{new}"
    assert {"generationDateAndTime", "numberOfEventIndicators"}.isdisjoint(after.attrib)
    assert "xmlns:tool=" in description.xml.decode() or "xmlns:v=" in description.xml.decode()
    assert not description.wired
    assert not description.left_out


def _plain(element: ET.Element) -> str:
    """Without what ET.indent may change, but for annotations, which must stay to the letter."""
    if element.tag in ("VendorAnnotations", "Annotations"):
        element.tail = None
        return ET.canonicalize(ET.tostring(element))
    copy = ET.fromstring(ET.tostring(element))
    for item in copy.iter():
        if item.tag not in ("Annotations", "Annotation", "Tool"):
            item.text = (item.text or "").strip()
        item.tail = (item.tail or "").strip()
    return ET.canonicalize(ET.tostring(copy))


def test_annotations_stay_to_the_letter() -> None:
    text = wrapped(AWKWARD_2, 2, EVERYTHING).xml.decode()
    assert '<tool:a x="1"> keep  <b />\n this</tool:a>' in text


@pytest.mark.parametrize(("xml", "fmi"), [(AWKWARD_2, 2), (AWKWARD_3, 3)])
def test_the_interface_says_what_the_wrapper_can(xml: str, fmi: int) -> None:
    root = ET.fromstring(wrapped(xml, fmi, EVERYTHING).xml)
    assert root.find("ModelExchange") is None
    assert root.find("ScheduledExecution") is None
    said = root.find("CoSimulation")
    assert said is not None
    if fmi == 2:
        expected = {
            "modelIdentifier": "outer",
            "canHandleVariableCommunicationStepSize": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "false",
        }
        assert [file.get("name") for file in said.iterfind("SourceFiles/File")] == ["wrapper.c", "network.c"]
    else:
        flags = ("hasEventMode", "mightReturnEarlyFromDoStep", "providesEvaluateDiscreteStates", "canGetAndSetFMUState")
        expected = dict.fromkeys((*flags, "canSerializeFMUState"), "true")
        expected |= {"modelIdentifier": "outer", "fixedInternalStepSize": "0.25", "{http://vendor.example/1}own": "1"}
        assert said.findtext("Annotations/Annotation") == "note"
    assert said.attrib == expected


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("solver", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("found", [(False, False), (True, False), (True, True), (False, True)])
def test_state_is_offered_where_both_can(fmi: int, solver: tuple[bool, bool], found: tuple[bool, bool]) -> None:
    xml = inner("oscillator" if fmi == 2 else "oscillator_fmi3").decode()
    for flag, on in zip(("canGetAndSetFMU[sS]tate", "canSerializeFMU[sS]tate"), solver, strict=True):
        xml = re.sub(f'({flag})="true"', rf'\1="{"true" if on else "false"}"', xml)
    slave = validated(wrapped(xml, fmi, added_to("oscillator"), Capabilities(*found))).coSimulation
    assert slave is not None
    assert slave.canGetAndSetFMUstate == (solver[0] and found[0])
    assert slave.canSerializeFMUstate == (solver[1] and all(found))


def test_only_capabilities_change_between_two_tellings() -> None:
    before, after = (wrapped(AWKWARD_3, 3, EVERYTHING, c).xml.decode() for c in (Capabilities(), ALL))
    assert re.sub('(FMUState)="false"', r'\1="true"', before) == after
    assert wrapped(AWKWARD_3, 3, EVERYTHING).xml.decode() == after


def test_value_references_lie_above_the_solvers_or_in_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = AWKWARD_2.replace("4294967290", "33")
    assert wrapped(plain, 2, EVERYTHING).base == 34
    gap = wrapped(AWKWARD_2, 2, EVERYTHING)
    assert gap.base == 14  # 0 to 13 are used here and there
    references = {v.name: v.valueReference for v in validated(gap).modelVariables}
    assert [references[name] for name in NAMES] == list(range(14, 14 + 11))
    monkeypatch.setattr(description_structure, "_LARGEST", 20)
    with pytest.raises(WrapError, match="11 value references in a row"):
        wrapped(AWKWARD_2.replace("4294967290", "14"), 2, EVERYTHING)


def test_a_place_stays_empty_where_the_solver_knows_the_condition() -> None:
    added = Added(CHANNELS, ("y",), {"frequency": 2.0}, False)
    assert [(v.name, v.offset) for v in variables(added)][-2:] == [
        ("correction_enabled", 5),
        ("corrector_frequency", 8),
    ]
    assert added.size == 11


@pytest.mark.parametrize("fmi", [2, 3])
def test_effects_alone_add_their_switch(fmi: int) -> None:
    name = "oscillator" if fmi == 2 else "oscillator_fmi3"
    description = wrapped(inner(name), fmi, Added(effects=True))
    before, after = validated(inner(name)), validated(description)
    assert [v.name for v in after.modelVariables][len(before.modelVariables) :] == ["effects_enabled"]
    assert after.modelVariables[-1].valueReference == description.base + 6
    assert not after.typeDefinitions
    bare = re.sub(
        "<Outputs>.*?</InitialUnknowns>|<(Output|ContinuousState|InitialUnknown).*?/>",
        "",
        inner(name).decode(),
        flags=re.S,
    )
    structure = ET.fromstring(wrapped(bare, fmi, Added(effects=True)).xml).find("ModelStructure")
    assert structure is not None
    assert not len(structure)


@pytest.mark.parametrize(("xml", "fmi"), [(AWKWARD_2, 2), (AWKWARD_3, 3)])
def test_the_status_is_an_enumeration(xml: str, fmi: int) -> None:
    status = by_name(validated(wrapped(xml, fmi, EVERYTHING), structure=False))["corrector_status"]
    assert status.declaredType is not None
    assert status.declaredType.name == ("CorrectorStatus2" if fmi == 2 else "CorrectorStatus")
    items = [(item.name, item.value) for item in status.declaredType.items]
    assert items == [(name, str(value)) for value, name in enumerate(STATUS)]
    assert all(item.description for item in status.declaredType.items)


def test_units_of_other_meaning_get_another_name() -> None:
    model = validated(wrapped(AWKWARD_2, 2, EVERYTHING))
    found = by_name(model)
    assert found["FW_corrected"].unit == "mm_corrector"  # the solver's mm is a metre
    assert found["RW_sigma"].unit == "m/s2"
    assert found["corrector_speed"].unit == "km/h"  # the same but for rounding
    assert found["corrector_amplitude"].unit == "deg"  # without a definition, the name counts
    units = {unit.name: unit.baseUnit for unit in model.unitDefinitions}
    assert (units["mm_corrector"].m, units["mm_corrector"].factor) == (1, 0.001)
    assert (units["m/s2"].m, units["m/s2"].s, units["m/s2"].factor) == (1, -2, 1.0)
    assert [unit.name for unit in model.unitDefinitions].count("km/h") == 1


@pytest.mark.parametrize(
    ("base", "same"),
    [
        ('factor="0.017453292519943295" rad="1"', True),
        ('factor="0.017453292519943295"', True),  # radians count as 1 for some
        ('factor="0.0175"', False),
        ('factor="0.017453292519943295" offset="1"', False),
        ('factor="0.017453292519943295" mol="1"', False),
    ],
)
def test_units_are_compared_by_meaning(base: str, same: bool) -> None:
    xml = AWKWARD_2.replace('<Unit name="deg"/>', f'<Unit name="deg"><BaseUnit {base}/></Unit>')
    unit = by_name(validated(wrapped(xml, 2, EVERYTHING)))["corrector_amplitude"].unit
    assert unit == ("deg" if same else "deg_corrector")


def test_a_channel_without_unit_or_of_an_unknown_one() -> None:
    added = Added((Channel("a", ""), Channel("b", "1"), Channel("c", "furlong")), ("y",))
    model = validated(wrapped(AWKWARD_2, 2, added))
    assert [by_name(model)[f"{name}_corrected"].unit for name in "abc"] == [None, "1", "furlong"]


@pytest.mark.parametrize("fmi", [2, 3])
def test_taken_names_are_refused(fmi: int) -> None:
    name = "oscillator" if fmi == 2 else "oscillator_fmi3"
    once = wrapped(inner(name), fmi, added_to(name))
    with pytest.raises(WrapError, match=r"FW_corrected, RW_corrected.*most likely .* wrapped.*simulation tool"):
        wrapped(once.xml, fmi, added_to(name))
    xml = AWKWARD_3.replace('<Alias name="p_also"/>', '<Alias name="p_also_corrected"/>')
    with pytest.raises(WrapError, match="p_also_corrected"):
        wrapped(xml, 3, Added((Channel("p_also", "m"),), ("y",)))


def test_dependencies_are_those_of_the_sources() -> None:
    both = Added(CHANNELS, ("y", "gear"), {"speed": 1.0}, True)  # a channel and a condition read from a parameter
    model = validated(wrapped(AWKWARD_2, 2, both))
    assert _knowns(model.outputs) == {"u", "x"}  # FMI 2 counts no parameters here
    assert _knowns(model.initialUnknowns) == {"u", "count", "gear", "correction_enabled", "corrector_speed"}
    model = validated(wrapped(AWKWARD_3, 3, Added(CHANNELS, ("y_also", "long"), {"speed": 1.0})), structure=False)
    own = {"correction_enabled", "corrector_speed", "t", "long"}
    assert _knowns(model.outputs) == {"u", "p", "blob", *own}
    assert _knowns(model.initialUnknowns) == {"u", "p", *own}


@pytest.mark.parametrize("sources", [("y", "z"), ("x",), ("y", "nowhere"), ()])
def test_dependencies_are_not_said_where_the_solver_does_not(sources: tuple[str, ...]) -> None:
    model = validated(wrapped(AWKWARD_2, 2, Added(CHANNELS, sources)))
    assert _knowns(model.outputs) is None
    if sources != ("x",):  # which is known in the beginning
        assert _knowns(model.initialUnknowns) is None


def _knowns(unknowns: list) -> set[str] | None:
    """What all added outputs depend on."""
    found = {unknown.variable.name: unknown.dependencies for unknown in unknowns}
    lists = [found[name] for name in NAMES[:5]]
    assert all(one == lists[0] for one in lists)
    return None if lists[0] is None else {variable.name for variable in lists[0]}


def test_start_values_that_the_wrapper_gives() -> None:
    starts = {"x": 2.0, "gear": -2.0, "on": 0.0, "u": 0.25}
    found = by_name(validated(wrapped(AWKWARD_2, 2, Added(CHANNELS, ("y",), {}, False, starts))))
    assert [found[name].start for name in starts] == ["2.0", "-2", "false", "0.25"]
    found = by_name(validated(wrapped(AWKWARD_2, 3, Added(CHANNELS, ("y",), {}, False, starts))))
    assert [found[name].start for name in starts] == ["2.0", "-2", "false", "0.25"]


def test_channels_that_are_no_structured_names_make_the_names_flat() -> None:
    for name, structured in (("bogie.y[2].front", True), ("'a b'.c", False), ("a b", False), ("der(x)", False)):
        description = wrapped(AWKWARD_2, 2, Added((Channel(name, "m"),), ("y",)))
        model = validated(description)
        assert model.variableNamingConvention == ("structured" if structured else "flat") or name == "'a b'.c"
        assert bool(description.left_out) == (model.variableNamingConvention == "flat")


@pytest.mark.parametrize(
    ("names", "apart_from", "fed"),
    [
        (["y"], (), True),
        (["y_also"], ("u", "blob"), False),  # what is left are a parameter and time
        (["y"], ("u",), True),
        (["sampled"], (), True),  # a clock is an input, too
        (["a[1]"], (), False),
        (["gear"], (), True),  # it says nothing of it
        (["x"], (), True),
        (["a[1]", "gear"], (), True),
        (["p"], (), False),
        ([], (), False),
    ],
)
def test_which_outputs_an_input_may_reach_at_once(names: list[str], apart_from: tuple[str, ...], fed: bool) -> None:
    assert description_structure.fed_through(ET.fromstring(AWKWARD_3), names, apart_from) == fed
