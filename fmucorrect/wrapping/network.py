"""A corrector's network as C: emx-onnx-cgen writes the graph and the weights, c/network*.{c,h} make them fast.

The graph is compiled once for each instruction set (c/network_way.h) and calls c/network_lanes.h for products with
matrices and for tanh. The files need no compiler flags of their own: -O2, with or without -ffp-contract=off.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import re
import shutil
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from fmucorrect.errors import MissingExtra, WrapError
from fmucorrect.workfolder import WorkFolder
from fmucorrect.wrapping.compiler import Sources, linkage

if TYPE_CHECKING:
    import onnx

_HERE = Path(__file__).parent
_HAND_WRITTEN = (
    *("network.c", "network.h", "network_baseline.c", "network_avx2.c"),
    *("network_way.h", "network_lanes.h", "network_machine.h"),
)


@dataclass(frozen=True)
class NetworkSources(Sources):
    """rows, seen: the window's shape. channels: numbers of each answer. state: numbers that go from sample to sample."""

    rows: int
    channels: int
    seen: int
    state: int = 0


def sources(path: str | Path) -> NetworkSources:
    """The network of the bundle at `path` as C11. The same bundle gives the same bytes.

    Raises WrapError where the graph has an operator that cannot be written as C, and names it; MissingExtra.
    """
    for module, package in (("onnx", "onnx"), ("emx_onnx_cgen", "emx-onnx-cgen")):
        if importlib.util.find_spec(module) is None:
            raise MissingExtra(package, "wrap")
    from fmucorrect.wrapping import graph

    try:
        model = graph.prepare(Path(path).read_bytes(), str(path))
        shape = model.graph.input[0].type.tensor_type.shape.dim
        rows, seen = shape[1].dim_value, shape[2].dim_value
        channels = model.graph.output[0].type.tensor_type.shape.dim[1].dim_value
        states = [i.type.tensor_type.shape.dim[1].dim_value for i in model.graph.input if i.name == graph.STATE]
        state = states[0] if states else 0
        text, data = _generate(model, str(path))
    except WrapError:
        raise
    except (
        Exception
    ) as error:  # neither onnx nor emx-onnx-cgen has a base for what it raises at a graph that is not usual
        raise WrapError(
            f"the network cannot be written as C: {type(error).__name__}: {error}",
            where=str(path),
            remedy="Export the corrector with other operators, or use it from Python.",
        ) from error
    sizes = {"ROWS": rows, "SEEN": seen, "CHANNELS": channels, "STATE": state}
    size = "".join(f"#define NETWORK_{name} {value}\n" for name, value in sizes.items())
    files = linkage() | {name: (_HERE / "c" / name).read_bytes() for name in _HAND_WRITTEN}
    weights = "".join(f"#define {name} OWN({name})\n" for name in dict.fromkeys(_WEIGHT_NAME.findall(data)))
    files["network_size.h"] = (
        f"/* Sizes of window and state, and the weights' names (names.h). */\n{size}{weights}".encode()
    )
    files["network_graph.h"] = f"/* The graph, node by node: compiled for each instruction set. */\n{text}".encode()
    files["network_data.c"] = f"/* The weights. */\n{_DATA}{data}".encode()
    return NetworkSources(files, rows, channels, seen, state)


_DATA = '#include "network.h"\n#include "network_machine.h"\n#define EMX_UNUSED NETWORK_ALIGNED\n\n'
_LOADER = re.compile(r"^_Bool network_graph_load\(.*?^}\n", re.MULTILINE | re.DOTALL)
_WEIGHT = re.compile(r"\bweight(?=\d+_)")
_WEIGHT_NAME = re.compile(r"\bnetwork_weight\d+_\w+(?=\[)")
_HEADER = re.compile(r"\A\s*/\*.*?\*/\s*", re.DOTALL)


def _generate(model: onnx.ModelProto, where: str) -> tuple[str, str]:
    """The graph and the weights, without emx-onnx-cgen's comment at the top and its loader of weight files."""
    from emx_onnx_cgen.errors import CompilerError

    try:
        text, data = _compiled(model.SerializeToString(deterministic=True))
    except (CompilerError, NotImplementedError, KeyError, ValueError) as error:
        named = [f"{node.op_type} that makes {', '.join(node.output)!r}" for node in _blamed(model, str(error))]
        raise WrapError(
            f"the network cannot be written as C: {error}{'; node ' if named else ''}{', '.join(named)}",
            where=where,
            remedy="Export the corrector with other operators, or use it from Python.",
        ) from error
    text, data = (_WEIGHT.sub("network_weight", _HEADER.sub("", part)) for part in (text, data))
    return _LOADER.sub("", text).replace("\nvoid network_graph(", "\nstatic void network_graph("), data


@lru_cache(maxsize=4)  # each time anew emx-onnx-cgen compiles all of its 170 templates: half of what a wrap takes
def _compiled(model: bytes) -> tuple[str, str]:
    """What emx-onnx-cgen writes of a graph, with our own product of matrices."""
    import onnx
    from emx_onnx_cgen.compiler import Compiler, CompilerOptions

    with WorkFolder() as folder:
        templates = folder.path / "templates"
        with importlib.resources.as_file(importlib.resources.files("emx_onnx_cgen") / "templates") as original:
            shutil.copytree(original, templates)
        (templates / "gemm_op.c.j2").rename(templates / "emx_gemm_op.c.j2")
        shutil.copy(_HERE / "templates" / "gemm_op.c.j2", templates)
        options = CompilerOptions(
            template_dir=templates,
            model_name="network_graph",
            model_checksum="",
            large_weight_threshold=0,
            large_temp_threshold_bytes=0,
        )
        return Compiler(options).compile_with_data_file(onnx.load_model_from_string(model))


def _blamed(model: onnx.ModelProto, message: str) -> list[onnx.NodeProto]:
    """The nodes whose operator `message` says is not supported; other messages name the node themselves."""
    match = re.match(r"Unsupported op \S*\.(\w+)$", message)
    return [node for node in model.graph.node if match and node.op_type == match.group(1)]
