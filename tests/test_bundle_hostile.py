"""A bundle that somebody else sealed, who may mean harm: it loads and is what it says, or it is refused in one error."""

import copy
import json
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bundles
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from fmucorrect import bundle
from fmucorrect.bundle import sealed
from fmucorrect.errors import BundleError

QUICK = 250
"""Random changes tried here."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, dict[str, Any]]:
    """The graph of a small bundle, and its metadata."""
    path = bundles.make(tmp_path_factory.mktemp("bundle") / "toy.onnx", rows=4)
    model = onnx.load(path)
    data = json.loads({entry.key: entry.value for entry in model.metadata_props}["fmucorrect"])
    del model.metadata_props[:]
    return model.SerializeToString(), data


def outcome(folder: Path, content: bytes) -> str:
    """ "loads", or the error."""
    path = folder / "hostile.onnx"
    path.write_bytes(content)
    begun = time.monotonic()
    try:
        model = bundle.load(path)
        windows = np.zeros((2, model.rows, len(model.channels)), np.float32)
        model.start().correct(windows, np.zeros(3, np.float32), np.zeros(2))
    except BundleError as error:
        return str(error)
    finally:
        assert time.monotonic() - begun < 2.0 * bundle.LONGEST + 10.0
    return "loads"


def places(item: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where anything stands in a tree."""
    inner = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
    return [at, *(place for key, entry in inner for place in places(entry, (*at, key)))]


ODD: list[Any] = [
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2**31,
        2**63,
        10**30,
        10**400,
        0.5,
        -0.0,
        1e308,
        "",
        "x",
        "\ud800",
        "\0",
        "x" * 5000,
    ),
    *(
        [],
        {},
        [1],
        [[]],
        {"x": 1},
        [None] * 3,
        [1e308] * 4,
        ["a", "b"],
        [4, 3, 2, 1],
        {"shape": [1]},
        "<f4",
        "|O",
        "AAAA",
    ),
]


def mutated(data: dict[str, Any], dice: random.Random) -> dict[str, Any]:
    """One to three changes anywhere in the tree."""
    data = copy.deepcopy(data)
    for _ in range(dice.randint(1, 3)):
        place = dice.choice(places(data)[1:])
        owner = data
        for key in place[:-1]:
            owner = owner[key]
        match dice.randrange(4):
            case 0:
                del owner[place[-1]]
            case 1:
                owner[place[-1]] = dice.choice(places_values(data))
            case 2 if isinstance(owner, dict):
                owner[dice.choice(["x", "format", "response FW", "parameters", "golden", "\n"])] = dice.choice(ODD)
            case _:
                owner[place[-1]] = copy.deepcopy(dice.choice(ODD))
        if len(places(data)) < 2:
            break
    return data


def places_values(data: Any) -> list[Any]:
    """Copies of what stands somewhere."""
    found = []
    for place in places(data)[1:]:
        item = data
        for key in place:
            item = item[key]
        found.append(copy.deepcopy(item))
    return found


def flipped(graph: bytes, dice: random.Random) -> bytes:
    changed = bytearray(graph)
    for _ in range(dice.randint(1, 6)):
        place = dice.randrange(len(changed))
        match dice.randrange(3):
            case 0:
                changed[place] = dice.randrange(256)
            case 1:
                del changed[place : place + dice.randint(1, 8)]
            case _:
                changed[place:place] = changed[dice.randrange(len(changed)) :][: dice.randint(1, 40)]
    return bytes(changed)


def campaign(made: tuple[bytes, dict[str, Any]], folder: Path, count: int, seed: int = 0) -> dict[str, int]:
    """Random changes of metadata and graph, sealed again; how many loaded."""
    dice = random.Random(seed)
    graph, data = made
    told = {"loads": 0, "refused": 0}
    for _ in range(count):
        text, changed = json.dumps(data), graph
        if dice.random() < 0.7:
            text = json.dumps(mutated(data, dice))
        else:
            changed = flipped(graph, dice)
        said = outcome(folder, sealed(changed, text))
        told["loads" if said == "loads" else "refused"] += 1
    return told


def test_random_changes_are_refused_in_one_error_or_load(made: tuple[bytes, dict[str, Any]], tmp_path: Path) -> None:
    told = campaign(made, tmp_path, QUICK)
    assert told["loads"] >= QUICK // 50
    assert told["refused"] >= QUICK // 2


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[" * 5_000, "no JSON"),
        ('{"format": ' * 500 + "1" + "}" * 500, r"16 levels|no JSON"),
        ('{"format": NaN}', "NaN"),
        ('{"format": 1, "format": 1}', "twice"),
        ("[1]", "no table"),
        ("{}", "another format"),
        ('{"format": true}', "another format"),
        ('{"format": ' + "9" * 5_000 + "}", "no JSON|another format"),
        ("not json", "no JSON"),
    ],
)
def test_metadata_that_is_no_json(made: tuple[bytes, dict[str, Any]], text: str, match: str, tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=match):
        raise BundleError(outcome(tmp_path, sealed(made[0], text)))


def changed(at: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        *inner, last = at.split("/")
        for key in inner:
            data = data[int(key)] if isinstance(data, list) else data[key]
        data[int(last) if isinstance(data, list) else last] = value

    return change


@pytest.mark.parametrize(
    ("at", "value"),
    [
        *(("rows", value) for value in (0, -1, 2.0, "4", True, 10**9, None)),
        *(("step_ns", value) for value in (0, 1.5, 10**15)),
        *(("name", value) for value in ("", 1, "x" * 2000, "\ud800")),
        *(("channels", value) for value in ([], {}, [1], None)),
        *(("channels/0/name", value) for value in ("", "FB", 3, "a\0")),
        *(("channels/0/noise", value) for value in (-1.0, "1", 1e308)),
        *(("channels/0/measurement_sign", value) for value in (0, 1.0, True)),
        ("channels/0/colour", "red"),
        *(("uncorrected", value) for value in ([1.0], 1.0, [None] * 4, [-1.0] * 4, [1e60] * 4)),
        *(("envelope/speed", value) for value in ([1, 2, 3], [4, 3, 2, 1], ["a"] * 4, [10**400] * 4)),
        ("envelope/colour", [1, 2, 3, 4]),
        *(("conditions/0", value) for value in ({"speed": "fast"}, [], {"parameters": {"v": "1"}}, {"speed": True})),
        *(("parameters", value) for value in ({"v": None}, [], {"v": [1]})),
        *(("versions", value) for value in ({"v": None}, [])),
        ("golden/time/shape", [10**12, 1]),
        ("golden/window/shape", [3, 4, 10**12]),
        *(("golden/window/dtype", value) for value in ("<f8", "|O", None)),
        *(("golden/window/base64", value) for value in ("AAAA", 7)),
        ("golden/surprise", {"dtype": "<f4", "shape": [1], "base64": "AAAA"}),
    ],
)
def test_metadata_of_another_type_or_size(
    made: tuple[bytes, dict[str, Any]], at: str, value: Any, tmp_path: Path
) -> None:
    data = copy.deepcopy(made[1])
    changed(at, value)(data)
    said = outcome(tmp_path, sealed(made[0], json.dumps(data)))
    assert "cannot be used" in said
    assert at.split("/")[0] in said


def graph_with(made: tuple[bytes, dict[str, Any]], change: Callable[[onnx.ModelProto], None]) -> bytes:
    model = onnx.load_from_string(made[0])
    change(model)
    return sealed(model.SerializeToString(), json.dumps(made[1]))


def _node(kind: str, **attributes: Any) -> Callable[[onnx.ModelProto], None]:
    def change(model: onnx.ModelProto) -> None:
        domain = attributes.pop("domain", "")
        model.graph.node.append(helper.make_node(kind, ["window"], ["unused"], domain=domain, **attributes))

    return change


def _outside(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer[0]
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


def _outside_in_an_attribute(model: onnx.ModelProto) -> None:
    tensor = numpy_helper.from_array(np.zeros(2, np.float32), "t")
    tensor.external_data.add(key="location", value="/etc/passwd")
    _node("Constant", value=tensor)(model)


def _outside_in_a_sparse_one(model: onnx.ModelProto) -> None:
    sparse = model.graph.sparse_initializer.add(dims=[4])
    sparse.values.data_location = TensorProto.EXTERNAL


_INNER = helper.make_graph([], "inner", [], [])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (_outside, "weights in another file"),
        (_outside_in_an_attribute, "weights in another file"),
        (_outside_in_a_sparse_one, "weights in another file"),
        (_node("Loop", body=_INNER), "graph inside"),
        (_node("If", then_branch=_INNER, else_branch=_INNER), "graph inside"),
        (_node("Scan"), "graph inside"),
        (_node("Relu", body=_INNER), "graph inside"),
        (_node("Mine", domain="com.me"), "operators of the domain 'com.me'"),
        (_node("RandomNormalLike"), "random"),
        (_node("Relu", mode="*/ int x; /*"), "no word of ONNX"),
        (_node("Relu", **{"*/ int x; /*": 1}), "no word of ONNX"),
        (lambda model: model.opset_import.append(helper.make_opsetid("com.me", 1)), "operators of the domain"),
        (lambda model: model.functions.add(name="f"), "functions"),
        (lambda model: model.graph.initializer[0].dims.extend([10**6, 10**6]), "more than the file can hold"),
        (lambda model: model.graph.input.add(name="more").CopyFrom(_more()), "further inputs|cannot open"),
        (lambda model: model.metadata_props.add(key="fmucorrect", value="{}"), "twice|seal"),
    ],
)
def test_graphs_that_hold_more_than_arithmetic(
    made: tuple[bytes, dict[str, Any]], change: Callable[[onnx.ModelProto], None], match: str, tmp_path: Path
) -> None:
    with pytest.raises(BundleError, match=match):
        raise BundleError(outcome(tmp_path, graph_with(made, change)))


def _more() -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info("more", TensorProto.FLOAT, ["N", 1])


def _huge(model: onnx.ModelProto) -> None:
    """Constants that double forty times."""
    for i in range(40):
        before = f"double_{i - 1}" if i else "gain_1"
        model.graph.node.append(helper.make_node("Concat", [before, before], [f"double_{i}"], axis=0))
    model.graph.initializer.append(numpy_helper.from_array(np.ones(1000, np.float32), "gain_1"))


def _filled(model: onnx.ModelProto) -> None:
    model.graph.initializer.append(numpy_helper.from_array(np.array([1_000_000, 1_000_000]), "size"))
    model.graph.node.append(helper.make_node("ConstantOfShape", ["size"], ["much"]))


@pytest.mark.parametrize("change", [_huge, _filled])
def test_memory_without_end_is_refused(
    made: tuple[bytes, dict[str, Any]], change: Callable[[onnx.ModelProto], None], tmp_path: Path
) -> None:
    resource = pytest.importorskip("resource")
    said = outcome(tmp_path, graph_with(made, change))
    assert "could not be computed" in said or "takes more than" in said
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 3 * bundle.MEMORY >> 10


def test_time_without_end_is_refused(
    made: tuple[bytes, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(model: onnx.ModelProto) -> None:
        model.graph.initializer.append(numpy_helper.from_array(np.ones((800, 800), np.float32), "m0"))
        for i in range(3000):
            model.graph.node.append(helper.make_node("MatMul", [f"m{i}"] * 2, [f"m{i + 1}"]))

    monkeypatch.setattr(bundle, "LONGEST", 1.0)
    assert "takes more than 1 s" in outcome(tmp_path, graph_with(made, slow))


@pytest.mark.parametrize("name", ["corrected", "baseline", "sigma", "in_envelope"])
def test_the_golden_pair_proves_every_output(made: tuple[bytes, dict[str, Any]], name: str, tmp_path: Path) -> None:
    data = copy.deepcopy(made[1])
    width = 1 if name == "in_envelope" else 4
    data["golden"][name] = bundle._pack(np.full((3, width), 0.7, np.float32))
    assert f"the golden pair does not come out on this machine: '{name}'" in outcome(
        tmp_path, sealed(made[0], json.dumps(data))
    )


def test_a_bundle_whose_golden_pair_has_one_output_still_loads(
    made: tuple[bytes, dict[str, Any]], tmp_path: Path
) -> None:
    data = copy.deepcopy(made[1])
    for name in ("baseline", "sigma", "in_envelope"):
        del data["golden"][name]
    assert outcome(tmp_path, sealed(made[0], json.dumps(data))) == "loads"
