"""Small valid bundles made without torch: the correction is a fixed multiple of the last sample and of the time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from fmucorrect.bundle import Info, seal
from fmucorrect.signals import Channel

CHANNELS = tuple(
    Channel(name, unit="mm", quantity="displacement", simulation=name) for name in ("FW", "FB", "RW", "RB")
)
WIDE = (-1e9, -1e9, 1e9, 1e9)


def make(
    path: Path,
    channels: tuple[Channel, ...] = CHANNELS,
    rows: int = 40,
    step_ns: int = 1_000_000,
    gain: float = -0.25,
    last_speed: float = 500.0,
    parameters: Mapping[str, float] = MappingProxyType({}),
    declared: bool = True,
) -> Path:
    """A bundle whose correction is `gain` times the sample before the newest, whole up to `last_speed` km/h, then none.
    parameters: start values that it was trained with. declared: whether its conditions had a speed and an excitation."""
    count = len(channels)
    graph = _graph(count, rows, gain, last_speed)
    info = replace(_info("toy", channels, rows, step_ns, last_speed), parameters=dict(parameters))
    if not declared:
        info = replace(info, envelope={}, conditions=({"name": "a road", "speed": 0.0, "start": 0.0},))
    return _sealed(path, graph, info)


def make_seeing(
    path: Path,
    weights: np.ndarray,
    channels: tuple[Channel, ...],
    sees: tuple[Channel, ...],
    rows: int,
    step_ns: int,
    held: tuple[str, ...] = (),
) -> Path:
    """A bundle of format 2 or 3 that sees more than its channels: added is the window's oldest row times weights, (V, J)."""
    count = len(channels)
    constants = {
        "first": np.array(0, np.int64),
        "last": np.array(rows - 1, np.int64),
        "channels": np.arange(count),
        "weights": weights.astype(np.float32),
        "spread": np.full((1, count), 0.1, np.float32),
        "one": np.ones((1, 1), np.float32),
    }
    nodes = [
        helper.make_node("Gather", ["window", "first"], ["oldest"], axis=1),
        helper.make_node("Gather", ["window", "last"], ["row"], axis=1),
        helper.make_node("Gather", ["row", "channels"], ["newest"], axis=1),
        helper.make_node("MatMul", ["oldest", "weights"], ["delta"]),
        helper.make_node("Add", ["newest", "delta"], ["corrected"]),
        helper.make_node("Identity", ["newest"], ["baseline"]),
        helper.make_node("ReduceSum", ["newest", "each"], ["sum"], keepdims=1),
        helper.make_node("Mul", ["sum", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "one"], ["in_envelope"]),
        helper.make_node("Mul", ["in_envelope", "spread"], ["sigma"]),
    ]
    constants |= {"each": np.array([1], np.int64), "zero": np.zeros((1, 1), np.float32)}
    graph = model(nodes, constants, rows, count, columns=len(weights))
    return _sealed(path, graph, replace(_info("seeing", channels, rows, step_ns, 500.0), sees=sees, held=held))


def _info(name: str, channels: tuple[Channel, ...], rows: int, step_ns: int, last_speed: float, state: int = 0) -> Info:
    return Info(
        name=name,
        channels=channels,
        rows=rows,
        step_ns=step_ns,
        uncorrected=(0.3,) * len(channels),
        envelope={"speed": (250.0, 280.0, last_speed, last_speed), "amplitude": WIDE, "frequency": WIDE},
        conditions=({"name": "300", "speed": 300.0, "amplitude": 0.03, "frequency": 2.0},),
        study_hash="0" * 64,
        versions={"fmucorrect": "0"},
        state=state,
    )


def _sealed(path: Path, graph: bytes, info: Info) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(seal(graph, info, golden_pair(graph, info.rows, len(info.seen), info.state)))
    return path


def golden_pair(graph: bytes, rows: int, count: int, state: int = 0) -> dict[str, np.ndarray]:
    """What ONNX Runtime says to a few random rows."""
    rng = np.random.default_rng(1)
    golden = {
        "window": rng.normal(size=(3, rows, count)).astype(np.float32),
        "condition": np.tile(np.array([340.0, 0.03, 2.0], np.float32), (3, 1)),
        "time": np.array([[0.0], [1.0], [2.5]]),
    }
    names = ["corrected", "baseline", "sigma", "in_envelope"]
    if state:
        golden["state"] = rng.normal(size=(3, state)).astype(np.float32)
        names.append("next_state")
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    return golden | dict(zip(names, map(np.asarray, session.run(names, golden)), strict=True))


@dataclass(frozen=True)
class Filter:
    """A bank of linear filters: next_state = state A + last B, corrected = last + next_state C + first D, where last and first
    are rows of the window. A: (S, S), B: (J, S), C: (S, J), D: (J, J)."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @staticmethod
    def random(states: int, channels: int, seed: int = 0) -> Filter:
        """A stable one, which remembers for some tens of samples."""
        rng = np.random.default_rng(seed)
        turned = np.linalg.qr(rng.normal(size=(states, states)))[0]
        shapes = ((channels, states), (states, channels), (channels, channels))
        return Filter(0.95 * turned, *(0.3 * rng.normal(size=shape) for shape in shapes))

    def deltas(self, values: np.ndarray, rows: int) -> np.ndarray:
        """(T, J) in double precision, of (T, J) samples; 0 until the window is full."""
        state, found = np.zeros(len(self.a)), np.zeros(values.shape)
        for i in range(rows - 1, len(values)):
            state = state @ self.a + values[i] @ self.b
            found[i] = state @ self.c + values[i + 1 - rows] @ self.d
        return found


def make_recurrent(
    path: Path,
    bank: Filter,
    channels: tuple[Channel, ...] = CHANNELS,
    rows: int = 3,
    step_ns: int = 1_000_000,
    last_speed: float = 500.0,
) -> Path:
    """A bundle of format 2 that filters; whole up to `last_speed` km/h, then none."""
    count, states = len(channels), len(bank.a)
    graph = _recurrent(bank, count, rows, last_speed)
    return _sealed(path, graph, _info("filter", channels, rows, step_ns, last_speed, states))


def _recurrent(bank: Filter, count: int, rows: int, last_speed: float) -> bytes:
    constants = {
        "first": np.array(0, np.int64),
        "last": np.array(rows - 1, np.int64),
        "zero": np.array([0], np.int64),
        "limit": np.float32(last_speed),
        "spread": np.full((1, count), 0.1, np.float32),
        **{name: getattr(bank, name).astype(np.float32) for name in "abcd"},
    }
    nodes = [
        helper.make_node("Gather", ["window", "last"], ["newest"], axis=1),
        helper.make_node("Gather", ["window", "first"], ["oldest"], axis=1),
        helper.make_node("MatMul", ["state", "a"], ["kept"]),
        helper.make_node("MatMul", ["newest", "b"], ["come"]),
        helper.make_node("Add", ["kept", "come"], ["next_state"]),
        helper.make_node("MatMul", ["next_state", "c"], ["of_state"]),
        helper.make_node("MatMul", ["oldest", "d"], ["of_window"]),
        helper.make_node("Add", ["of_state", "of_window"], ["wanted"]),
        helper.make_node("Gather", ["condition", "zero"], ["speed"], axis=1),
        helper.make_node("LessOrEqual", ["speed", "limit"], ["allowed"]),
        helper.make_node("Cast", ["allowed"], ["in_envelope"], to=TensorProto.FLOAT),
        helper.make_node("Mul", ["wanted", "in_envelope"], ["delta"]),
        helper.make_node("Add", ["newest", "delta"], ["corrected"]),
        helper.make_node("Identity", ["newest"], ["baseline"]),
        helper.make_node("Mul", ["in_envelope", "spread"], ["sigma"]),
    ]
    return model(nodes, constants, rows, count, len(bank.a))


def model(
    nodes: list[Any], constants: dict[str, Any], rows: int, count: int, states: int = 0, columns: int = 0
) -> bytes:
    """A graph with the inputs and outputs of a bundle. columns: of the window, where these are more than the channels."""

    def tensor(name: str, kind: int, *shape: int):
        return helper.make_tensor_value_info(name, kind, ["N", *shape])

    inputs = [
        tensor("window", TensorProto.FLOAT, rows, columns or count),
        tensor("condition", TensorProto.FLOAT, 3),
        tensor("time", TensorProto.DOUBLE, 1),
    ]
    outputs = [tensor(name, TensorProto.FLOAT, count) for name in ("corrected", "baseline", "sigma")]
    outputs.append(tensor("in_envelope", TensorProto.FLOAT, 1))
    if states:
        inputs.append(tensor("state", TensorProto.FLOAT, states))
        outputs.append(tensor("next_state", TensorProto.FLOAT, states))
    made = helper.make_model(
        helper.make_graph(
            nodes,
            "toy",
            inputs,
            outputs,
            [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", 18)],
    )
    made.ir_version = 9
    return made.SerializeToString()


def _graph(count: int, rows: int, gain: float, last_speed: float) -> bytes:
    constants = {
        "before_last": np.array(rows - 2, np.int64),
        "last": np.array(rows - 1, np.int64),
        "zero": np.array([0], np.int64),
        "gain": np.float32(gain),
        "limit": np.float32(last_speed),
        "spread": np.full((1, count), 0.1, np.float32),
    }
    nodes = [
        helper.make_node("Gather", ["window", "last"], ["newest"], axis=1),
        helper.make_node("Gather", ["window", "before_last"], ["older"], axis=1),
        helper.make_node("Gather", ["condition", "zero"], ["speed"], axis=1),
        helper.make_node("LessOrEqual", ["speed", "limit"], ["allowed"]),
        helper.make_node("Cast", ["allowed"], ["in_envelope"], to=TensorProto.FLOAT),
        helper.make_node("Mul", ["older", "gain"], ["wanted"]),
        helper.make_node("Mul", ["wanted", "in_envelope"], ["delta"]),
        helper.make_node("Add", ["newest", "delta"], ["corrected"]),
        helper.make_node("Identity", ["newest"], ["baseline"]),
        helper.make_node("Mul", ["in_envelope", "spread"], ["sigma"]),
    ]
    return model(nodes, constants, rows, count)
