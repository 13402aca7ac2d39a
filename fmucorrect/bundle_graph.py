"""What an ONNX file holds, looked at before ONNX Runtime opens it: nothing outside of the file, and nothing without end.

A corrector is straight arithmetic on its window. Every operator of the ONNX standard is allowed but for those with graphs
inside (Loop, Scan, If, SequenceMap: how long they run, the data decide, and they cannot be written as C for a controller)
and those that draw random numbers (a correction would not be the same twice). Operators of other domains, functions and
files beside the model are refused: what they do, this file does not say.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from fmucorrect.errors import BundleError

LARGEST = 256 << 20
"""Bytes of a file; a corrector of the kind that is trained here has 200 kB."""
NODES, VALUES = 20_000, 200_000
"""At most, of nodes, and of inputs, outputs and constants of the graph."""
READ = 256 << 20
"""Numbers that all nodes together may take from constants: ONNX Runtime keeps a faster form of them for each node."""
_DOMAINS = ("", "ai.onnx", "ai.onnx.ml")
_CONTROL = frozenset(("If", "Loop", "Scan", "SequenceMap"))
_RANDOM = frozenset(
    ("Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike")
)
_WORD = re.compile(r"[A-Za-z0-9_ ,.>-]{0,200}")
"""Attributes are words of the standard (modes, equations of Einsum) and become comments in generated C."""
_STRING = 8
"""TensorProto.STRING"""

# the fields of onnx.proto that are looked at; all others are left unread
_MESSAGES: Mapping[str, Mapping[str, tuple[int, str]]] = {
    "Model": {"graph": (7, "Graph"), "opset": (8, "Opset*"), "metadata": (14, "Entry*"), "training": (20, "bytes*")}
    | {"functions": (25, "bytes*")},
    "Opset": {"domain": (1, "bytes")},
    "Entry": {"key": (1, "bytes"), "value": (2, "bytes")},
    "Graph": {"node": (1, "Node*"), "initializer": (5, "Tensor*"), "sparse": (15, "Sparse*")}
    | {"input": (11, "bytes*"), "output": (12, "bytes*")},
    "Node": {"input": (1, "bytes*"), "operator": (4, "bytes"), "attribute": (5, "Attribute*"), "domain": (7, "bytes")},
    "Attribute": {"name": (1, "bytes"), "text": (4, "bytes"), "tensor": (5, "Tensor"), "graph": (6, "bytes")}
    | {"texts": (9, "bytes*"), "tensors": (10, "Tensor*"), "graphs": (11, "bytes*")}
    | {"sparse": (22, "Sparse"), "sparses": (23, "Sparse*"), "reference": (21, "bytes")},
    "Tensor": {
        "dims": (1, "int64*"),
        "type": (2, "int32"),
        "name": (8, "bytes"),
        "outside": (13, "bytes*"),
        "location": (14, "int32"),
    },
    "Sparse": {"values": (1, "Tensor"), "indices": (2, "Tensor"), "dims": (3, "int64*")},
}


def _model() -> Any:
    """The class of a model with these fields."""
    kinds = descriptor_pb2.FieldDescriptorProto
    scalars = {"bytes": kinds.TYPE_BYTES, "int64": kinds.TYPE_INT64, "int32": kinds.TYPE_INT32}
    file = descriptor_pb2.FileDescriptorProto(name="fmucorrect/bundle_graph.proto", package="onnxfile", syntax="proto2")
    for name, rows in _MESSAGES.items():
        message = file.message_type.add(name=name)
        for key, (number, kind) in rows.items():
            label = kinds.LABEL_REPEATED if kind.endswith("*") else kinds.LABEL_OPTIONAL
            entry = message.field.add(name=key, number=number, label=label)
            kind = kind.rstrip("*")
            if kind in scalars:
                entry.type = scalars[kind]
            else:
                entry.type, entry.type_name = kinds.TYPE_MESSAGE, f".onnxfile.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("onnxfile.Model"))


_Model = _model()


def metadata(content: bytes, where: str) -> dict[str, str]:
    """The model's metadata_props. Raises BundleError where the file is no ONNX model, or holds more than arithmetic."""
    if len(content) > LARGEST:
        raise BundleError("the file is too large", where=where, expected=f"at most {LARGEST} bytes", got=len(content))
    try:
        model = _Model.FromString(content)
    except DecodeError as error:
        raise BundleError("ONNX Runtime cannot open it: this is no ONNX file", where=where) from error
    problem = next(_problems(model, len(content)), None)
    if problem is not None:
        raise BundleError(
            f"the network {problem}", where=where, remedy="Export it as plain ONNX operators, weights inside."
        )
    found: dict[str, str] = {}
    for entry in model.metadata:
        try:
            key, value = entry.key.decode(), entry.value.decode()
        except UnicodeDecodeError as error:
            raise BundleError(f"the metadata is no text: {error.reason}", where=where) from error
        if key in found:
            raise BundleError(f"the metadata has {key[:100]!a} twice", where=where)
        found[key] = value
    return found


def _problems(model: Any, size: int) -> Iterator[str]:
    graph = model.graph
    if model.functions or model.training:
        yield "brings functions or a training of its own"
    for item in (*model.opset, *graph.node):
        if (domain := _text(item.domain)) not in _DOMAINS:
            yield f"uses operators of the domain {domain[:100]!a}, which this program does not know"
    if len(graph.node) > NODES or len(graph.initializer) + len(graph.input) + len(graph.output) > VALUES:
        yield f"has more than {NODES} nodes or {VALUES} values"
    for node in graph.node:
        operator = _text(node.operator)
        if not re.fullmatch(r"[A-Za-z0-9_]{1,100}", operator):
            yield f"has an operator {operator[:100]!a}"
        if operator in _RANDOM:
            yield f"draws random numbers ({operator})"
        if operator in _CONTROL or any(a.HasField("graph") or a.graphs for a in node.attribute):
            yield f"has a graph inside ({operator}): how long it runs, its data decide"
        for attribute in node.attribute:
            for word in (attribute.name, attribute.text, *attribute.texts, attribute.reference):
                if not _WORD.fullmatch(_text(word)):
                    yield f"has an attribute of {operator} that is no word of ONNX: {_text(word)[:100]!a}"
    for tensor in _tensors(graph):
        if tensor.outside or tensor.location:
            yield "has weights in another file"
        if tensor.type == _STRING:
            yield "holds texts"
        if min(tensor.dims, default=0) < 0 or math.prod(tensor.dims) > 2 * size:  # four bits are the smallest number
            yield f"declares a constant of {list(tensor.dims)[:8]} numbers, more than the file can hold"
    sizes = {tensor.name: math.prod(tensor.dims) for tensor in graph.initializer}
    read = sum(sizes.get(name, 0) for node in graph.node for name in node.input)
    if read > READ:
        yield f"reads {read} numbers of constants, more than {READ}"
    for sparse in _sparse(graph):
        if min(sparse.dims, default=0) < 0 or math.prod(sparse.dims) > LARGEST:
            yield f"declares a sparse constant of {list(sparse.dims)[:8]} numbers"


def _sparse(graph: Any) -> Iterator[Any]:
    yield from graph.sparse
    for attribute in (attribute for node in graph.node for attribute in node.attribute):
        yield from attribute.sparses
        if attribute.HasField("sparse"):
            yield attribute.sparse


def _tensors(graph: Any) -> Iterator[Any]:
    """Every constant, wherever it stands."""
    yield from graph.initializer
    for attribute in (attribute for node in graph.node for attribute in node.attribute):
        yield from attribute.tensors
        if attribute.HasField("tensor"):
            yield attribute.tensor
    for sparse in _sparse(graph):
        yield from (sparse.values, sparse.indices)


def _text(content: bytes) -> str:
    return content.decode("utf-8", errors="replace")
