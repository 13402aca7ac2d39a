"""Small valid bundles made without torch: the correction is a fixed multiple of the last sample and of the time."""

from __future__ import annotations

from pathlib import Path

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
) -> Path:
    """A bundle whose correction is `gain` times the sample before the newest, whole up to `last_speed` km/h, then none."""
    count = len(channels)
    graph = _graph(count, rows, gain, last_speed)
    rng = np.random.default_rng(1)
    golden = {
        "window": rng.normal(size=(3, rows, count)).astype(np.float32),
        "condition": np.tile(np.array([340.0, 0.03, 2.0], np.float32), (3, 1)),
        "time": np.array([[0.0], [1.0], [2.5]]),
    }
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    names = ["corrected", "baseline", "sigma", "in_envelope"]
    golden |= dict(zip(names, map(np.asarray, session.run(names, golden)), strict=True))
    info = Info(
        name="toy",
        channels=channels,
        rows=rows,
        step_ns=step_ns,
        uncorrected=(0.3,) * count,
        envelope={"speed": (250.0, 280.0, last_speed, last_speed), "amplitude": WIDE, "frequency": WIDE},
        conditions=({"name": "300", "speed": 300.0, "amplitude": 0.03, "frequency": 2.0},),
        study_hash="0" * 64,
        versions={"fmucorrect": "0"},
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(seal(graph, info, golden))
    return path


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
        helper.make_node("Identity", ["time"], ["clock"]),
    ]

    def tensor(name: str, kind: int, *shape: int):
        return helper.make_tensor_value_info(name, kind, ["N", *shape])

    model = helper.make_model(
        helper.make_graph(
            nodes,
            "toy",
            [
                tensor("window", TensorProto.FLOAT, rows, count),
                tensor("condition", TensorProto.FLOAT, 3),
                tensor("time", TensorProto.DOUBLE, 1),
            ],
            [tensor(name, TensorProto.FLOAT, count) for name in ("corrected", "baseline", "sigma")]
            + [tensor("in_envelope", TensorProto.FLOAT, 1), tensor("clock", TensorProto.DOUBLE, 1)],
            [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", 18)],
    )
    model.ir_version = 9
    return model.SerializeToString()
