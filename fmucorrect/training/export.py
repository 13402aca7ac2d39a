"""The trained chain as one ONNX graph: the arithmetic of networks.Corrector, node by node, and nothing else."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from onnx import TensorProto, checker, helper, numpy_helper

from fmucorrect.bundle import Info, seal
from fmucorrect.training.networks import FREQUENCY_STEPS, Corrector

OPSET = 18
IR_VERSION = 9


def to_bundle(
    corrector: Corrector, info: Info, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray
) -> bytes:
    """The content of a bundle file. windows (N, W, J), condition (3,), seconds (N,): a few real ones, the golden input."""
    golden: dict[str, np.ndarray] = {
        "window": np.ascontiguousarray(windows, np.float32),
        "condition": np.tile(condition.astype(np.float32), (len(windows), 1)),
        "time": np.ascontiguousarray(seconds[:, None], np.float64),
    }
    with torch.no_grad():
        outputs = corrector(*(torch.from_numpy(golden[name]) for name in ("window", "condition", "time")))
    golden |= {name: values.numpy() for name, values in outputs._asdict().items()}
    return seal(graph(corrector, info.rows, len(info.channels)), info, golden)


def graph(corrector: Corrector, rows: int, channels: int) -> bytes:
    """The serialised ONNX model, without metadata. Few nodes, since each costs about 0.2 us a step in ONNX Runtime."""
    nodes: list[Any] = []

    def add(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    weights = {name: tensor.numpy() for name, tensor in corrector.tensors().items()}
    constants: dict[str, np.ndarray] = {}
    parts = [add("Flatten", ["window"], "history", axis=1), "condition"]
    if corrector.phase:
        parts.append(_phase(add, constants))
    x = add("Concat", parts, "x", axis=1)
    hidden = add("Tanh", [add("Gemm", [x, "A", "a"], "hidden_0")], "tanh_0")
    bases = add("Gemm", [hidden, "B", "b"], "bases")
    add("MatMul", [bases, "S"], "baseline")
    for i in range(1, corrector.layers + 1):
        hidden = add("Tanh", [add("Gemm", [hidden, f"C{i}", f"c{i}"], f"hidden_{i}")], f"tanh_{i}")
    outside = add("Relu", [add("Gemm", [x, "R", "r"], "ramps")], "outside")
    inside = add("Relu", [add("Gemm", [outside, "v", "one"], "share")], "in_envelope")
    responses = add("Gemm", [hidden, "D", bases], "responses")
    response = add("MatMul", [responses, "S"], "response")
    delta = add("Mul", [inside, add("Gemm", [outside, "minus_Q", response], "lead")], "delta")
    add("Gemm", [outside, "Q", delta], "corrected")
    band = add("Gemm", [add("Abs", [responses], "deviations"), "T", "t"], "band")
    add("Add", [add("Mul", [inside, band], "faded_band"), "s_u"], "sigma")

    def tensor(name: str, kind: int, *shape: int) -> Any:
        return helper.make_tensor_value_info(name, kind, ["N", *shape])

    model = helper.make_model(
        helper.make_graph(
            nodes,
            "fmucorrect",
            [
                tensor("window", TensorProto.FLOAT, rows, channels),
                tensor("condition", TensorProto.FLOAT, 3),
                tensor("time", TensorProto.DOUBLE, 1),
            ],
            [tensor(name, TensorProto.FLOAT, channels) for name in ("corrected", "baseline", "sigma")]
            + [tensor("in_envelope", TensorProto.FLOAT, 1)],
            [numpy_helper.from_array(np.asarray(value), name) for name, value in {**weights, **constants}.items()],
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        producer_name="fmucorrect",
    )
    model.ir_version = IR_VERSION
    checker.check_model(model, full_check=True)
    return model.SerializeToString()


def _phase(add: Any, constants: dict[str, np.ndarray]) -> str:
    """networks.phase_features: cycles = round(1e4 f) / 1e4 t, in double."""
    constants["steps"] = np.array(FREQUENCY_STEPS)
    constants["turn"] = np.array(2.0 * math.pi)
    constants["start"] = np.array(0.0)
    constants["two"] = np.array([2], np.int64)
    frequency = add(
        "Cast", [add("Gather", ["condition", "two"], "frequency", axis=1)], "frequency_64", to=TensorProto.DOUBLE
    )
    steps = add("Round", [add("Mul", [frequency, "steps"], "frequency_steps")], "frequency_rounded")
    cycles = add("Mul", [add("Div", [steps, "steps"], "frequency_exact"), "time"], "cycles")
    part = add("Sub", [cycles, add("Floor", [cycles], "whole")], "part")
    angle = add("Cast", [add("Mul", [part, "turn"], "angle_64")], "angle", to=TensorProto.FLOAT)
    waves = add("Concat", [add("Sin", [angle], "sine"), add("Cos", [angle], "cosine")], "waves", axis=1)
    begun = add("Cast", [add("GreaterOrEqual", ["time", "start"], "begun")], "gate", to=TensorProto.FLOAT)
    return add("Mul", [waves, begun], "phase")
