"""The corrector as one ONNX graph: the arithmetic of deployed.Corrector and its head, node by node, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from onnx import TensorProto, checker, helper, numpy_helper

from fmucorrect.bundle import Info, seal
from fmucorrect.training.deployed import FREQUENCY_STEPS, Corrector
from fmucorrect.training.linear import LinearHead
from fmucorrect.training.networks import OneHead, WindowHead
from fmucorrect.training.recurrent import RecurrentHead

OPSET = 18
IR_VERSION = 9
MEMORY, ANSWERS, LATELY = "memory", ("answer_before", "last_answer_before"), "lately_before"
"""Parts of the state: a bank's, those of a recurrent head's answers, the second with feedback, and the guard's."""
STATES = 0.1
"""Standard deviation of the states in a golden pair; those of a motion are of the order of 1 or less."""


def to_bundle(
    corrector: Corrector,
    info: Info,
    windows: np.ndarray,
    condition: np.ndarray,
    seconds: np.ndarray,
    past: np.ndarray,
    lately: np.ndarray,
) -> bytes:
    """The content of a bundle file. windows (N, W, V), condition (3,), seconds (N,): a few real ones, the golden input; past
    (N, P), lately (N, d): p of the bank and the guard's e before each: with others the guard lets nothing through."""
    golden: dict[str, np.ndarray] = {
        "window": np.ascontiguousarray(windows, np.float32),
        "condition": np.tile(condition.astype(np.float32), (len(windows), 1)),
        "time": np.ascontiguousarray(seconds[:, None], np.float64),
    }
    if corrector.state:
        golden["state"] = np.random.default_rng(0).normal(scale=STATES, size=(len(windows), corrector.state))
        if (bank := corrector.head.bank) is not None:
            golden["state"][:, : past.shape[1]] = bank.state(past, windows[:, -2])
        golden["state"][:, corrector.head.state :] = lately
        golden["state"] = golden["state"].astype(np.float32)
    with torch.no_grad():
        outputs = corrector(*(torch.from_numpy(values) for values in golden.values()))
    golden |= {name: values.numpy() for name, values in outputs._asdict().items() if values is not None}
    return seal(graph(corrector, info.rows, len(info.channels), len(info.seen)), info, golden)


Add = Callable[..., str]
"""Adds a node: kind, inputs, output, attributes; gives the output's name."""


def graph(corrector: Corrector, rows: int, channels: int, columns: int) -> bytes:
    """The serialised ONNX model, without metadata. Few nodes, since each costs about 0.2 us a step in ONNX Runtime."""
    nodes: list[Any] = []

    def add(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    head = corrector.head
    constants: dict[str, np.ndarray] = {}
    parts = [add("Flatten", ["window"], "history", axis=1), "condition"]
    if head.phase:
        parts.append(_phase(add, constants))
    x = add("Concat", parts, "x", axis=1)
    after: list[str] = []
    if corrector.state:
        parts = {MEMORY: head.state}
        if isinstance(head, RecurrentHead):
            parts = dict(zip((MEMORY, *ANSWERS), head.parts, strict=False))  # of one answer the first alone
        if corrector.lately:
            parts[LATELY] = corrector.lately
        constants["parts"] = np.array(list(parts.values()))
        nodes.append(helper.make_node("Split", ["state", "parts"], list(parts), axis=1))
    if isinstance(head, WindowHead | OneHead):
        responses, bases = _window(add, x, head)
    elif isinstance(head, RecurrentHead):
        responses, bases, after = _recurrent(add, x, len(head.parts) - 1)
    else:
        assert isinstance(head, LinearHead)
        responses, bases, after = _linear(add, x, head, constants)
    if head.members:  # of one alone the mean is what it says
        add("MatMul", [bases, "S"], "baseline")
    outside = add("Relu", [add("Gemm", [x, "R", "r"], "ramps")], "outside")
    known = _guard(add, "seen" if head.state else x, constants, corrector.lately > 0) if corrector.guarded else "one"
    if corrector.state:
        add("Concat", [*after, "lately"] if corrector.lately else after, "next_state", axis=1)
    inside = add("Relu", [add("Gemm", [outside, "v", known], "share")], "in_envelope")
    response = add("MatMul", [responses, "S"], "response") if head.members else responses
    lead = add("Gemm", [outside, "minus_Q", response], "lead")
    delta = add("Mul", [inside, lead], "known_delta" if corrector.falls_back else "delta")
    if corrector.falls_back:
        declared = add("Relu", [add("Gemm", [outside, "w", "one"], "declared_share")], "declared")
        added = add("Gemm", ["seen" if head.state else x, "X", "x0"], "filtered_delta")
        new = add("Mul", [add("Sub", [declared, inside], "left"), added], "new_delta")
        delta = add("Add", [delta, new], "delta")
    add("Gemm", [outside, "Q", delta], "corrected")
    band = "own_band"
    if not isinstance(head, OneHead):
        moved = add("Abs", [add("Sub", [responses, "m"], "moved")], "deviations")
        band = add("Gemm", [moved, "T", "t"], "band")
    add("Add", [add("Mul", [inside, band], "faded_band"), "s_u"], "sigma")

    def tensor(name: str, kind: int, *shape: int) -> Any:
        return helper.make_tensor_value_info(name, kind, ["N", *shape])

    used = {name for node in nodes for name in node.input}
    weights = {name: tensor.numpy() for name, tensor in corrector.tensors().items() if name in used}
    state = [tensor("state", TensorProto.FLOAT, corrector.state)] if corrector.state else []
    ended = [tensor("next_state", TensorProto.FLOAT, corrector.state)] if corrector.state else []
    model = helper.make_model(
        helper.make_graph(
            nodes,
            "fmucorrect",
            [
                tensor("window", TensorProto.FLOAT, rows, columns),
                tensor("condition", TensorProto.FLOAT, 3),
                tensor("time", TensorProto.DOUBLE, 1),
                *state,
            ],
            [tensor(name, TensorProto.FLOAT, channels) for name in ("corrected", "baseline", "sigma")]
            + [tensor("in_envelope", TensorProto.FLOAT, 1), *ended],
            [numpy_helper.from_array(np.asarray(value), name) for name, value in {**weights, **constants}.items()],
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        producer_name="fmucorrect",
    )
    model.ir_version = IR_VERSION
    checker.check_model(model, full_check=True)
    return model.SerializeToString()


def _window(add: Add, x: str, head: WindowHead | OneHead) -> tuple[str, str]:
    """networks.WindowHead or OneHead: its responses and bases."""
    one = isinstance(head, OneHead)
    seen = add("Gemm", [x, "P", "p"], "seen") if one else x
    hidden = add("Tanh", [add("Gemm", [seen, "A", "a"], "hidden_0")], "tanh_0")
    bases = add("Gemm", [hidden, "B", "b"], "baseline" if one else "bases")
    for i in range(1, head.layers + 1):
        hidden = add("Tanh", [add("Gemm", [hidden, f"C{i}", f"c{i}"], f"hidden_{i}")], f"tanh_{i}")
    if one:
        add("Gemm", [add("Relu", [add("Gemm", [hidden, "E", "e"], "signed")], "wide"), "F", "f"], "own_band")
    return add("Gemm", [hidden, "D", bases], "responses"), bases


def _linear(add: Add, x: str, head: LinearHead, constants: dict[str, np.ndarray]) -> tuple[str, str, list[str]]:
    """linear.LinearHead: its responses and bases, and what its state comes to."""
    seen, after = (_remembered(add, x), ["past"]) if head.state else (x, [])
    responses = add("Gemm", [seen, "L", "l"], "filtered")
    if head.sloped:
        more = add(
            "Mul", [add("Gemm", ["condition", "c", "d"], "speed"), add("Gemm", [seen, "M", "n"], "slope")], "sloped"
        )
        responses = add("Add", [responses, more], "responses")
    channels, columns = head.last.stop - head.last.start, head.condition.start - head.last.start
    constants["newest"] = np.array(-1, np.int64)
    if channels == columns:
        return responses, add("Gather", ["window", "newest"], "baseline", axis=1), after
    constants["channels"] = np.arange(channels)
    last = add("Gather", ["window", "newest"], "newest_row", axis=1)
    return responses, add("Gather", [last, "channels"], "baseline", axis=1), after


def _remembered(add: Add, x: str) -> str:
    """A step of the bank (bank.py): what is seen, x and its state, which is called `past`."""
    return add("Concat", [x, add("Gemm", [MEMORY, "A", add("Gemm", [x, "G", "g"], "drive")], "past")], "seen", axis=1)


def _recurrent(add: Add, x: str, passes: int) -> tuple[str, str, list[str]]:
    """recurrent.RecurrentHead: its responses and bases, and what the parts of its state come to. passes: answers."""
    seen = _remembered(add, x)
    first = hidden = add("Gemm", [seen, "H", "h"], "hidden_0")
    answers: list[list[str]] = []
    for k, before in enumerate(ANSWERS[:passes]):
        if answers:
            hidden = add("Gemm", [add("Concat", answers[-1], "answer", axis=1), "I", first], "fed_back")
        inner = add("Tanh", [add("Gemm", [add("Tanh", [hidden], f"tanh_{k}"), "K", "k"], f"inner_{k}")], f"wide_{k}")
        missing = add("Gemm", [inner, "U", "o"], f"missing_{k}")
        answers.append([add("Gemm", [before, "B", add("MatMul", [missing, "F"], f"push_{k}")], f"moved_{k}"), missing])
    answered = add("Concat", ["past", *answers[-1]], "answered", axis=1)
    responses = add("Gemm", [answered, "O", add("Gemm", [x, "P", "p"], "direct")], "responses")
    return responses, add("MatMul", [x, "E"], "bases"), ["past", *(part for answer in answers for part in answer)]


def _guard(add: Add, seen: str, constants: dict[str, np.ndarray], lately: bool) -> str:
    """What the guard leaves of a correction, at most 1. lately: whether it looks at what was lately, too."""
    constants["each"] = np.array([1], np.int64)

    def left(values: str, far: str, name: str) -> str:
        """far: square of the values."""
        levels = add("Gemm", [values, f"{name}near", f"{name}level"], f"{name}levels")
        nearest = add("ReduceMax", [levels, "each"], f"{name}nearest")
        return add("Sub", [nearest, far], f"{name}known_share")

    z = add("Gemm", [seen, "Z", "z0"], "motion")
    shares = [left(z, add("ReduceSumSquare", [z, "each"], "far"), "")]
    if lately:
        root = add("Sqrt", [add("Gemm", [LATELY, "a", add("Mul", [z, z], "power")], "lately")], "root")
        shares.append(
            left(add("Sqrt", [root], "strength"), add("MatMul", [root, "lately_far"], "lately_square"), "lately_")
        )
    return add("Min", [*shares, "one"], "known")


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
