"""A wrapper that speaks another version of FMI than the solver: descriptions, and the table for the C core."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from descriptions import AWKWARD_2, AWKWARD_3, CHANNELS, by_name, inner, validated, wrapped

from fmucorrect.errors import WrapError
from fmucorrect.wrapping import wiring
from fmucorrect.wrapping.added import Added
from fmucorrect.wrapping.conversion import KINDS, TIME, Wired

HEADER = Path(wiring.__file__).parent / "c/wrapper.h"
ADDED = Added(CHANNELS, ("y",), {"speed": 1.0}, True)
HUGE = 4294967290


def test_kinds_are_those_of_the_c_core() -> None:
    text = HEADER.read_text(encoding="utf-8")
    for fmi in (2, 3):
        names = re.search(rf"enum \{{([^}}]*STRING_{fmi}\s*)\}}", text)
        assert names is not None
        numbers = {name.strip(): number for number, name in enumerate(names[1].split(","))}
        for kind, number in KINDS[fmi].items():
            c_name = {"Enumeration": "INTEGER" if fmi == 2 else "INT64"}.get(kind, kind.upper())
            assert numbers[f"{c_name}_{fmi}"] == number
    assert f"TIME_KIND = {TIME}" in text


def test_the_table_of_an_fmi_2_solver() -> None:
    description = wrapped(AWKWARD_2, 3, ADDED)
    rows = {
        **{
            "y": Wired(0, HUGE),
            "y_too": Wired(0, HUGE),
            "u": Wired(0, 7),
            "u_mirror": Wired(0, 7),
            "gear": Wired(1, 7),
        },
        **{"count": Wired(1, 7), "on": Wired(2, 7), "file": Wired(3, 7), "x": Wired(0, 3), "der(x)": Wired(0, 0)},
        **{"z": Wired(1, 9), "k": Wired(0, 12), "pi": Wired(0, 13), "time": Wired(TIME, 0)},
    }
    assert description.wired == tuple(rows.values())
    assert description.base == len(rows)
    found = by_name(validated(description))
    assert {name: found[name].valueReference for name in rows} == {name: i for i, name in enumerate(rows)}
    assert found["FW_corrected"].valueReference == len(rows)
    assert not description.left_out


def test_variables_of_fmi_2_as_of_fmi_3() -> None:
    found = by_name(validated(wrapped(AWKWARD_2, 3, ADDED)))
    types = {"y": "Float64", "gear": "Enumeration", "count": "Int32", "on": "Boolean", "file": "String", "z": "Int32"}
    assert {name: found[name].type for name in types} == types
    starts = {"u": "0.5", "gear": "1", "count": "3", "on": "true", "file": 'a&b "c"', "x": "1", "pi": "3.1", "y": None}
    assert {name: found[name].start for name in starts} == starts
    assert (found["y_too"].causality, found["y_too"].alias) == ("output", None)  # an output of its own
    assert found["u_second"].alias is found["u_mirror"]
    assert (found["u_second"].description, found["u_second"].displayUnit) == ("same", "mm")
    assert found["der(x)"].derivative is found["x"]
    assert (found["x"].unbounded, found["count"].min, found["gear"].declaredType.name) == (True, "0", "Gear")
    assert [item.value for item in found["gear"].declaredType.items] == ["1", "-2"]
    assert (found["time"].causality, found["time"].type) == ("independent", "Float64")


def test_structure_of_fmi_2_as_of_fmi_3() -> None:
    model = validated(wrapped(AWKWARD_2, 3, ADDED))
    outputs = {unknown.variable.name: unknown for unknown in model.outputs}
    assert [v.name for v in outputs["y"].dependencies] == ["u", "x"]
    assert outputs["y"].dependenciesKind == ["dependent", "constant"]
    assert [v.name for v in outputs["FW_sigma"].dependencies] == [
        "u",
        "x",
        "time",
        "correction_enabled",
        "corrector_speed",
    ]
    assert [(u.variable.name, u.dependencies) for u in model.derivatives] == [("der(x)", [])]
    assert [u.variable.name for u in model.initialUnknowns][:5] == ["y", "y_too", "der(x)", "z", "k"]
    assert outputs["z"].dependencies is None


def test_an_independent_variable_is_taken_where_there_is_one() -> None:
    description = wrapped(inner("oscillator"), 3, Added(CHANNELS, ("mass1.x", "mass2.x")))
    assert all(row.kind != TIME for row in description.wired)
    assert [row.reference for row in description.wired] == list(range(67))
    taken = AWKWARD_2.replace('name="pi"', 'name="time"')
    assert by_name(validated(wrapped(taken, 3, ADDED)))["time_"].causality == "independent"


@pytest.mark.parametrize("name", ["oscillator", "roller_rig"])
def test_both_directions_give_what_this_repository_writes(name: str) -> None:
    for solver, other in ((name, f"{name}_fmi3"), (f"{name}_fmi3", name)):
        fmi = 3 if other.endswith("3") else 2
        ours = ET.fromstring(wrapped(inner(solver), fmi, Added()).xml)
        theirs = ET.fromstring(inner(other))
        for tag in ("ModelVariables", "ModelStructure", "UnitDefinitions", "DefaultExperiment"):
            old, new = theirs.find(tag), ours.find(tag)
            assert old is not None
            assert new is not None
            assert [_flat(child) for child in new] == [_flat(child) for child in old]


def _flat(element: ET.Element) -> tuple[object, ...]:
    return element.tag, dict(element.attrib), [_flat(child) for child in element]


def test_the_table_of_an_fmi_3_solver() -> None:
    description = wrapped(AWKWARD_3, 2, ADDED)
    expected = [Wired(9, HUGE), Wired(0, 8), *(Wired(0, 5, 6, i) for i in range(6)), Wired(1, 6)]
    expected += [*(Wired(0, 10, 2, i) for i in range(2)), *(Wired(0, 11, 2, i) for i in range(2)), Wired(8, 12)]
    expected += [Wired(3, 13), *(Wired(10, 14, 2, i) for i in range(2)), *(Wired(11, 15, 2, i) for i in range(2))]
    expected += [Wired(8, 16), Wired(0, 20), Wired(0, 21), Wired(0, 22, 2, 0), Wired(0, 22, 2, 1)]
    assert description.wired == tuple(expected)
    assert description.base == len(expected)
    found = by_name(validated(description))
    assert [found[f"u[{i},{j}]"].valueReference for i in (1, 2) for j in (1, 2, 3)] == list(range(2, 8))
    assert found["FW_corrected"].valueReference == len(expected)


def test_variables_of_fmi_3_as_of_fmi_2() -> None:
    found = by_name(validated(wrapped(AWKWARD_3, 2, ADDED)))
    starts = {f"u[{1 + i // 3},{1 + i % 3}]": str(i + 1) for i in range(6)}
    starts |= {"x[1]": "7", "x[2]": "7", "on[1]": "true", "on[2]": "false", "words[1]": "a b", "words[2]": ""}
    starts |= {"long": "-5", "small": "255", "p": "2", "c": "4", "a[1,1]": "1", "a[1,2]": "2", "n": "3"}
    assert {name: found[name].start for name in starts} == starts
    assert (found["n"].causality, found["n"].variability) == ("local", "constant")
    assert (found["t"].causality, found["t"].variability) == ("independent", "continuous")
    assert (found["on[1]"].variability, found["small"].variability, found["gear"].variability) == (
        *("fixed", "discrete", "discrete"),
    )
    assert [v.type for v in map(found.__getitem__, ("y", "long", "on[1]", "words[1]", "gear"))] == [
        *("Real", "Integer", "Boolean", "String", "Enumeration"),
    ]
    for alias, main in (("u_also[2,1]", "u[2,1]"), ("y_also", "y"), ("p_also", "p"), ("c_also", "c")):
        assert found[alias].valueReference == found[main].valueReference
        assert found[alias].causality == "local"
    assert (found["u_also[2,1]"].displayUnit, found["y_also"].displayUnit) == ("mm", None)
    assert found["der(x[2])"].derivative is found["x[2]"]
    assert (found["y"].declaredType.unit, found["long"].declaredType.min, found["long"].declaredType.max) == (
        *("m", None, "7"),
    )
    assert not {"blob", "tick", "sampled"} & set(found)


def test_structure_of_fmi_3_as_of_fmi_2() -> None:
    model = validated(wrapped(AWKWARD_3, 2, ADDED))
    outputs = {unknown.variable.name: unknown for unknown in model.outputs}
    elements = [f"u[{i},{j}]" for i in (1, 2) for j in (1, 2, 3)]
    assert [v.name for v in outputs["y"].dependencies] == ["t", *elements]  # in order; neither p nor what is left out
    assert outputs["y"].dependenciesKind == ["dependent", *["constant"] * 6]
    assert [v.name for v in outputs["a[1,2]"].dependencies] == ["der(x[1])", "der(x[2])"]
    assert [u.variable.name for u in model.derivatives] == ["der(x[1])", "der(x[2])"]
    initial = {unknown.variable.name: unknown.dependencies for unknown in model.initialUnknowns}
    assert list(initial)[:4] == ["y", "der(x[1])", "der(x[2])", "gear"]  # in the variables' order
    assert [v.name for v in initial["y"]] == [*elements, "p"]
    assert initial["gear"] == []
    assert initial["der(x[1])"] is None


def test_what_is_left_out_is_said() -> None:
    said = wrapped(AWKWARD_3, 2, ADDED).left_out
    for words in (
        ["blob", "binary"],
        ["tick", "a clock"],
        ["sampled", "governed by a clock"],
        ["n:", "structural"],
        ["long:", "32 bits"],
        ["1/m", "inverse"],
        ["'b'", "'Gear'"],
        ["'w'", "of y"],
    ):
        assert sum(all(word in line for word in words) for line in said) == 1, (words, said)
    assert len(said) == 8


def test_the_interface_in_the_other_version() -> None:
    for xml, fmi in ((AWKWARD_2, 3), (AWKWARD_3, 2)):
        interface = ET.fromstring(wrapped(xml, fmi, ADDED).xml).find("CoSimulation")
        assert interface is not None
        if fmi == 3:
            expected = {"canHandleVariableCommunicationStepSize": "true", "canSerializeFMUState": "false"}
            # a solver of FMI 2 that discards the rest of a step makes it end early
            expected |= {"canGetAndSetFMUState": "true", "mightReturnEarlyFromDoStep": "true"}
        else:
            expected = {"canNotUseMemoryManagementFunctions": "true", "canSerializeFMUstate": "true"}
            expected["canGetAndSetFMUstate"] = "true"
        assert interface.attrib == {"modelIdentifier": "outer", **expected}


def test_annotations_in_the_other_version() -> None:
    text = wrapped(AWKWARD_2, 3, ADDED).xml.decode()
    assert '<Annotation type="T"><tool:a x="1"> keep  <b />\n this</tool:a></Annotation>' in text
    assert '<Annotations><Annotation type="T"><tool:pick /></Annotation></Annotations>' in text
    text = wrapped(AWKWARD_3, 2, ADDED).xml.decode()
    assert '<VendorAnnotations><Tool name="v"><v:deep><v:er /> mixed </v:deep></Tool></VendorAnnotations>' in text


@pytest.mark.parametrize("value", ["2147483648", "-2147483649"])
def test_start_values_beyond_32_bits_are_refused(value: str) -> None:
    with pytest.raises(WrapError, match=rf"'long' begins at {value}.*Wrap it as FMI 3.0"):
        wrapped(AWKWARD_3.replace('start="-5"', f'start="{value}"'), 2, ADDED)
    edge = AWKWARD_3.replace('start="-5"', 'start="-2147483648"')
    assert by_name(validated(wrapped(edge, 2, ADDED)))["long"].start == "-2147483648"


def test_start_values_must_fit_their_array() -> None:
    with pytest.raises(WrapError, match="'u' has 5 start values, expected one, or one for each of its 6 elements"):
        wrapped(AWKWARD_3.replace('start="1 2 3 4 5 6"', 'start="1 2 3 4 5"'), 2, ADDED)


def test_names_of_elements_stay_unique() -> None:
    xml = AWKWARD_3.replace('name="p"', 'name="x[1]"').replace('name="structured"', "").replace("structured", "flat")
    found = by_name(validated(wrapped(xml, 2, ADDED)))
    assert {"x[1]", "x[1]_", "x[2]", "der(x[1])"} <= set(found)
    assert found["x[1]"].causality == "parameter"


def test_higher_derivatives_keep_their_order() -> None:
    xml = AWKWARD_3.replace('name="der(x)"', 'name="der(x,2)"')
    assert {"der(x[1],2)", "der(x[2],2)"} <= set(by_name(validated(wrapped(xml, 2, ADDED))))
