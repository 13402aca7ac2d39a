"""The corrector's ONNX graph made ready for C: one row, the outputs of the contract, and few products with zeros.

Members of an ensemble stand side by side in one matrix, as blocks between zeros; ONNX Runtime is faster with them than
with many small nodes, C is not. A product with a constant matrix becomes products with its blocks: the same products,
but for those with zero, and added up in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from jaxtyping import Float32
from onnx import helper, numpy_helper, shape_inference

from fmucorrect.bundle_metadata import NEXT_STATE, OUTPUTS, STATE
from fmucorrect.errors import WrapError

INPUTS = ("window", "condition", "time")

_NARROW = 16
"""Columns that are not worth a product of their own: one vector of the widest instruction set."""
_GAP = 8
"""Zero rows that are cheaper multiplied than left out."""
_WORTH = 256
"""Products that must be saved for zeros to be left out, and at least a quarter of them."""
_WIDE = 96
"""Columns whose sums the 16 registers of AVX2 hold at once: such a block is read from front to end."""


@dataclass(frozen=True)
class Block:
    """Columns of a matrix, and the ranges of rows in which they are not zero; both [first, end)."""

    columns: tuple[int, int]
    rows: tuple[tuple[int, int], ...]

    @property
    def products(self) -> int:
        return sum(end - first for first, end in self.rows) * (self.columns[1] - self.columns[0])


def prepare(content: bytes, where: str) -> onnx.ModelProto:
    """The model in `content` for one row at a time, without its metadata. Raises WrapError if it is no corrector's."""
    model = onnx.load_model_from_string(content)
    graph = model.graph
    constants = {item.name for item in graph.initializer}
    inputs = {item.name: item for item in graph.input if item.name not in constants}
    outputs = {item.name: item for item in graph.output}
    recurrent = STATE in inputs
    read, said = ((*INPUTS, STATE), (*OUTPUTS, NEXT_STATE)) if recurrent else (INPUTS, OUTPUTS)
    if set(inputs) != set(read) or not set(said) <= set(outputs):
        raise WrapError(
            "the graph has other inputs or outputs than a corrector",
            where=where,
            expected=f"{', '.join(read)} to {', '.join(said)}",
            got=f"{', '.join(inputs)} to {', '.join(outputs)}",
        )
    rows, seen = (axis.dim_value for axis in inputs["window"].type.tensor_type.shape.dim[1:])
    channels = outputs["corrected"].type.tensor_type.shape.dim[1].dim_value
    shapes = {"window": [1, rows, seen], "condition": [1, 3], "time": [1, 1], "in_envelope": [1, 1]}
    if recurrent:
        shapes[STATE] = shapes[NEXT_STATE] = [1, inputs[STATE].type.tensor_type.shape.dim[1].dim_value]
    for names, field in ((read, graph.input), (said, graph.output)):
        del field[:]
        for name in names:
            kind = onnx.TensorProto.DOUBLE if name == "time" else onnx.TensorProto.FLOAT
            field.append(helper.make_tensor_value_info(name, kind, shapes.get(name, [1, channels])))
    del graph.value_info[:], model.metadata_props[:]
    for text in ("doc_string", "producer_name", "producer_version", "domain"):
        model.ClearField(text)
    _replace_nodes(graph, _needed(graph))
    _rename(graph)
    _divide_products(model)
    return model


def _rename(graph: onnx.GraphProto) -> None:
    """Every value but the inputs and outputs is called `v1`, `v2`, ..., and no node has a name or a text: emx-onnx-cgen writes
    them into comments as they are, and whoever made the file chose them."""
    names = {"": ""} | {item.name: item.name for item in (*graph.input, *graph.output)}

    def name(old: str) -> str:
        return names.setdefault(old, f"v{len(names)}")

    graph.name, graph.doc_string = "network", ""
    for item in graph.initializer:
        item.name, item.doc_string = name(item.name), ""
    for node in graph.node:
        node.name = node.doc_string = node.overload = ""
        del node.metadata_props[:]
        node.input[:] = map(name, node.input)
        node.output[:] = map(name, node.output)


def _needed(graph: onnx.GraphProto) -> list[onnx.NodeProto]:
    """The nodes that the outputs depend on; ONNX lists nodes in the order of computation."""
    wanted = {item.name for item in graph.output}
    nodes: list[onnx.NodeProto] = []
    for node in reversed(graph.node):
        if wanted & set(node.output):
            nodes.append(node)
            wanted |= set(node.input)
    return nodes[::-1]


def _replace_nodes(graph: onnx.GraphProto, nodes: list[onnx.NodeProto]) -> None:
    copies = [onnx.NodeProto.FromString(node.SerializeToString()) for node in nodes]
    del graph.node[:]
    graph.node.extend(copies)


def _divide_products(model: onnx.ModelProto) -> None:
    constants = {item.name: item for item in model.graph.initializer}
    shapes = _shapes(model)
    nodes: list[onnx.NodeProto] = []
    for number, node in enumerate(model.graph.node):
        new = None
        if node.op_type in ("MatMul", "Gemm") and node.domain in ("", "ai.onnx") and node.input[1] in constants:
            new = _Product.of(node, f"blocks_{number}", shapes, constants)
        nodes += [node] if new is None else new.nodes(model.graph)
    _replace_nodes(model.graph, nodes)


def _shapes(model: onnx.ModelProto) -> dict[str, list[int]]:
    graph = shape_inference.infer_shapes(model).graph
    return {
        item.name: [axis.dim_value for axis in item.type.tensor_type.shape.dim]
        for item in (*graph.value_info, *graph.input, *graph.output)
    }


@dataclass(frozen=True)
class _Product:
    """output = x weights + bias. bias: the name of a tensor (1, n), or values (n,), or nothing."""

    name: str
    x: str
    weights: Float32[np.ndarray, "k n"]
    bias: str | Float32[np.ndarray, " n"] | None
    output: str

    @staticmethod
    def of(
        node: Any, name: str, shapes: dict[str, list[int]], constants: dict[str, onnx.TensorProto]
    ) -> _Product | None:
        """What `node` computes, or None where it is more than that."""
        attributes = {item.name: helper.get_attribute_value(item) for item in node.attribute}
        weights = numpy_helper.to_array(constants[node.input[1]])
        if weights.dtype != np.float32 or weights.ndim != 2:
            return None
        if attributes.pop("transB", 0):
            weights = weights.T
        rows, columns = weights.shape
        plain = attributes.items() <= {"transA": 0, "alpha": 1.0, "beta": 1.0}.items()
        if not plain or shapes.get(node.input[0]) != [1, rows]:
            return None
        bias: str | np.ndarray | None = None
        added = node.input[2] if len(node.input) > 2 else ""
        if added in constants:
            bias = numpy_helper.to_array(constants[added]).reshape(-1)
            if bias.shape != (columns,):
                return None
        elif added:
            bias = added
            if shapes.get(added) != [1, columns]:
                return None
        return _Product(name, node.input[0], weights, bias, node.output[0])

    def nodes(self, graph: onnx.GraphProto) -> list[onnx.NodeProto]:
        """Its nodes; their constants go to `graph`."""
        height, width = self.weights.shape
        blocks = divide(self.weights)
        if isinstance(self.bias, str) and len(blocks) > 1:
            blocks = [Block((0, width), ((0, height),))]
        made: list[onnx.NodeProto] = []

        def constant(array: np.ndarray) -> str:
            name = f"{self.name}_{len(graph.initializer)}"
            graph.initializer.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
            return name

        def add(kind: str, inputs: list[str], output: str | None = None, **attributes: Any) -> str:
            output = output or f"{self.name}_{len(graph.initializer)}_{len(made)}"
            made.append(helper.make_node(kind, inputs, [output], **attributes))
            return output

        def part(name: str, first: int, end: int) -> str:
            if (first, end) == (0, height):
                return name
            return add("Slice", [name, *(constant(np.array([value])) for value in (first, end, 1))])

        columns: list[str] = []
        for block in blocks:
            first, end = block.columns
            sums = self.bias if isinstance(self.bias, str) or self.bias is None else constant(self.bias[first:end])
            for i, (top, bottom) in enumerate(block.rows):
                last = len(blocks) == 1 and i == len(block.rows) - 1
                inputs = [part(self.x, top, bottom), constant(self.weights[top:bottom, first:end])]
                sums = add("Gemm", inputs + ([sums] if sums else []), self.output if last else None)
            columns.append(sums or "")
        if len(columns) > 1:
            add("Concat", columns, self.output, axis=1)
        return made


def divide(weights: Float32[np.ndarray, "k n"]) -> list[Block]:
    """Blocks, left to right, that hold all of `weights` that is not zero. Zeros are left out where that is worth it."""
    height, width = weights.shape
    used = weights != 0
    apart = [j for j in range(1, width) if not (used[:, :j].any(1) & used[:, j:].any(1)).any()]
    blocks: list[Block] = []
    first = 0
    for end in (*apart, width):
        if end == width or (end - first >= _NARROW and width - end >= _NARROW):
            blocks.append(Block((first, end), _runs(np.flatnonzero(used[:, first:end].any(1)).tolist(), height)))
            first = end
    saved = height * width - sum(block.products for block in blocks)
    if saved < max(_WORTH, height * width // 4):
        blocks = [Block((0, width), ((0, height),))]
    return [
        Block((first, min(first + _WIDE, block.columns[1])), block.rows)
        for block in blocks
        for first in range(*block.columns, _WIDE)
    ]


def _runs(rows: Sequence[int], height: int) -> tuple[tuple[int, int], ...]:
    """Ranges that hold `rows`, which ascend. At least one, since an empty sum is no node."""
    runs: list[tuple[int, int]] = []
    for row in rows:
        if runs and row - runs[-1][1] < _GAP:
            runs[-1] = (runs[-1][0], row + 1)
        else:
            runs.append((0 if row < _GAP else row, row + 1))
    if runs and height - runs[-1][1] < _GAP:
        runs[-1] = (runs[-1][0], height)
    return tuple(runs) or ((0, 1),)
