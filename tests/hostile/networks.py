"""Bundles that a hostile author sealed himself: metadata, golden pair and graph, each with what should not be there."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import copy
import hashlib
import json
import random
from collections.abc import Callable
from typing import Any

import onnx
import trees
from onnx import TensorProto, helper


def parts(bundle: bytes) -> tuple[onnx.ModelProto, dict[str, Any]]:
    """The graph without its metadata, and the metadata."""
    model = onnx.load_from_string(bundle)
    data = next(json.loads(item.value) for item in model.metadata_props if item.key == "fmucorrect")
    del model.metadata_props[:]
    return model, data


def sealed(graph: bytes, text: str) -> bytes:
    """As the project seals, for any metadata."""
    content = graph + _entry("fmucorrect", text)
    return content + _entry("fmucorrect_sha256", hashlib.sha256(content).hexdigest())


def _entry(key: str, value: str) -> bytes:
    def delimited(number: int, body: bytes) -> bytes:
        return _varint(number << 3 | 2) + _varint(len(body)) + body

    return delimited(14, delimited(1, key.encode()) + delimited(2, value.encode("utf-8", "surrogatepass")))


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])


def hostile_metadata(rng: random.Random, bundle: bytes) -> tuple[bytes, str]:
    model, data = parts(bundle)
    if rng.random() < 0.12:
        text, what = rng.choice(
            (("", "empty"), ("null", "null"), ("[]", "a list"), ("{}", "an empty object"), ("{", "half an object"), ("[" * 100_000, "nested deeply"), ('{"format": 1e999}', "a number beyond all"), ('{"format":' + "9" * 5000 + "}", "a number of 5000 digits"), (json.dumps(data) + "x", "more behind it"), ("\x00", "a zero"))
        )  # fmt: skip
    else:
        tree, what = trees.mutated(rng, data)
        text = json.dumps(tree)
    return sealed(model.SerializeToString(), text), f"metadata: {what}"


def hostile_graph(rng: random.Random, bundle: bytes) -> tuple[bytes, str]:
    model, data = parts(bundle)
    change = rng.choice(CHANGES)
    what = change(rng, model)
    return sealed(model.SerializeToString(), json.dumps(data)), f"graph: {what}"


def _initializer(rng: random.Random, model: onnx.ModelProto) -> str:
    tensor = rng.choice(model.graph.initializer)
    kind = rng.randrange(5)
    if kind == 0:
        tensor.dims[:] = rng.choice(([0], [-1], [2**40], [2**62, 2], [1] * 200, []))
    elif kind == 1:
        tensor.data_type = rng.choice((0, 2, 8, 10, 16, 99))
    elif kind == 2:
        tensor.raw_data = rng.choice((b"", b"\0", b"\xff" * 1000, tensor.raw_data[:-1]))
    elif kind == 3:
        tensor.name = rng.choice(("", "window", "x", "corrected", '"; //'))
    else:
        value = rng.choice((float("nan"), float("inf"), 1e38, -1e38))
        tensor.CopyFrom(helper.make_tensor(tensor.name, TensorProto.FLOAT, [1], [value]))
    return f"initializer {tensor.name}: {kind}"


def _external(rng: random.Random, model: onnx.ModelProto) -> str:
    tensor = rng.choice(model.graph.initializer)
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    place = rng.choice(
        ("/etc/passwd", "../in/run.csv", "run.csv", "/dev/zero", "../../../../../../etc/hostname", "x" * 5000, "")
    )
    for key, value in (
        ("location", place),
        ("offset", rng.choice(("0", "-1", "9" * 30))),
        ("length", rng.choice(("4", "1000000000000", "x"))),
    ):
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    return f"external data in {place[:30]!r}"


def _node(rng: random.Random, model: onnx.ModelProto) -> str:
    nodes = model.graph.node
    i = rng.randrange(len(nodes))
    node, kind = nodes[i], rng.randrange(7)
    if kind == 0:
        node.op_type = rng.choice(
            ("Relu", "Identity", "Loop", "If", "Nonsense", "", "Add", "Gather", "RandomNormalLike", "Dropout")
        )
    elif kind == 1:
        node.domain = rng.choice(("com.microsoft", "evil", "ai.onnx.ml", "ai.onnx.training"))
    elif kind == 2:
        del nodes[i]
        return f"node {i} deleted"
    elif kind == 3 and node.input:
        node.input[rng.randrange(len(node.input))] = rng.choice(("", "window", "time", "nowhere", node.output[0]))
    elif kind == 4:
        node.output[0] = rng.choice(("", "corrected", "window", "x" * 10_000, "a\0b"))
    elif kind == 5:
        nodes.append(copy.deepcopy(node))
    else:
        node.attribute.append(helper.make_attribute(rng.choice(("axis", "to", "x")), rng.choice((-5, 2**62, 0, 99))))
    return f"node {i}, {node.op_type}: {kind}"


def _through(model: onnx.ModelProto, nodes: list[Any], last: str) -> None:
    """What gives `corrected` now passes through the nodes first: they take `corrected_before` and give `last`."""
    for node in model.graph.node:
        for i, name in enumerate(node.output):
            if name == "corrected":
                node.output[i] = "corrected_before"
    model.graph.node.extend(nodes)
    model.graph.node.append(helper.make_node("Identity", [last], ["corrected"]))


def _constant(name: str, kind: int, values: list[Any], dims: list[int] | None = None) -> Any:
    return helper.make_node(
        "Constant", [], [name], value=helper.make_tensor(name, kind, [len(values)] if dims is None else dims, values)
    )


def _memory(rng: random.Random, model: onnx.ModelProto) -> str:
    """A tensor of many GB on the way, of which one element is added."""
    size = rng.choice((2**28, 2**30, 2**33, 2**40))
    nodes = [
        _constant("bomb_shape", TensorProto.INT64, [size]),
        helper.make_node("ConstantOfShape", ["bomb_shape"], ["bomb"]),
        helper.make_node("ReduceMax", ["bomb"], ["bomb_max"], keepdims=0),
        helper.make_node("Add", ["corrected_before", "bomb_max"], ["bombed"]),
    ]
    _through(model, nodes, "bombed")
    return f"a tensor of {size} floats"


def _loop(rng: random.Random, model: onnx.ModelProto) -> str:
    """A loop without end."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["on"], ["still_on"]), helper.make_node("Identity", ["value"], ["value_out"])],
        "body",
        [helper.make_tensor_value_info("i", TensorProto.INT64, []), helper.make_tensor_value_info("on", TensorProto.BOOL, []), helper.make_tensor_value_info("value", TensorProto.FLOAT, None)],
        [helper.make_tensor_value_info("still_on", TensorProto.BOOL, []), helper.make_tensor_value_info("value_out", TensorProto.FLOAT, None)],
    )  # fmt: skip
    count = rng.choice((2**62, 10**7, 3))
    nodes = [
        _constant("trips", TensorProto.INT64, [count], []),
        _constant("on_begin", TensorProto.BOOL, [True], []),
        helper.make_node("Loop", ["trips", "on_begin", "corrected_before"], ["looped"], body=body),
    ]
    _through(model, nodes, "looped")
    return f"a loop of {count} turns"


def _deep(rng: random.Random, model: onnx.ModelProto) -> str:
    """`If` in `If` in `If`."""
    depth = rng.choice((3, 12, 24))
    out = helper.make_tensor_value_info("inner0", TensorProto.FLOAT, None)
    graph = helper.make_graph([helper.make_node("Identity", ["corrected_before"], ["inner0"])], "g0", [], [out])
    for i in range(1, depth):
        node = helper.make_node("If", ["yes"], [f"inner{i}"], then_branch=graph, else_branch=helper.make_graph([helper.make_node("Identity", ["corrected_before"], [f"e{i}"])], f"e{i}", [], [helper.make_tensor_value_info(f"e{i}", TensorProto.FLOAT, None)]))  # fmt: skip
        graph = helper.make_graph(
            [node], f"g{i}", [], [helper.make_tensor_value_info(f"inner{i}", TensorProto.FLOAT, None)]
        )
    _through(model, [_constant("yes", TensorProto.BOOL, [True], []), *graph.node], f"inner{depth - 1}")
    return f"If nested {depth} times"


def _chain(rng: random.Random, model: onnx.ModelProto) -> str:
    count = rng.choice((100, 20_000))
    nodes = [
        helper.make_node("Relu", ["corrected_before" if i == 0 else f"chain{i - 1}"], [f"chain{i}"])
        for i in range(count)
    ]
    _through(model, nodes, f"chain{count - 1}")
    return f"{count} nodes in a chain"


def _contract(rng: random.Random, model: onnx.ModelProto) -> str:
    entries = rng.choice((model.graph.input, model.graph.output))
    entry, kind = rng.choice(entries), rng.randrange(4)
    if kind == 0:
        entry.name = rng.choice(("", "x", "window", "corrected"))
    elif kind == 1:
        entry.type.tensor_type.elem_type = rng.choice((0, 1, 7, 8, 11, 99))
    elif kind == 2:
        for dim in entry.type.tensor_type.shape.dim:
            dim.dim_value = rng.choice((0, 1, 2**40, -1))
    else:
        entries.remove(entry)
    return f"contract: {entry.name}, {kind}"


def _model(rng: random.Random, model: onnx.ModelProto) -> str:
    kind = rng.randrange(5)
    if kind == 0:
        model.ir_version = rng.choice((0, 1, 99, 2**40))
    elif kind == 1:
        model.opset_import[0].version = rng.choice((0, 1, 7, 99, 2**40))
    elif kind == 2:
        del model.opset_import[:]
    elif kind == 3:
        model.opset_import.append(helper.make_opsetid("evil", 1))
    else:
        model.graph.name = rng.choice(("", '??/"}; int x;', "x" * 100_000))
    return f"model: {kind}"


CHANGES: tuple[Callable[[random.Random, onnx.ModelProto], str], ...] = (
    _initializer, _initializer, _external, _node, _node, _memory, _loop, _deep, _chain, _contract, _contract, _model,
)  # fmt: skip
