"""The bundle proves itself: what was changed after it was made, or does not keep the contract, is refused."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from fmucorrect import bundle
from fmucorrect.bundle import Info, seal
from fmucorrect.errors import BundleError, SignalError
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper

CHANNELS = (Channel("FW", unit="mm"), Channel("FB", unit="mm"))
INFO = Info("toy", CHANNELS, 3, 1_000_000, (0.5, 0.5), {"speed": (1.0, 2.0, 3.0, 4.0)}, (), "none", {})


def graph(gain: float = 2.0, window: str = "window", outputs: tuple[str, ...] = ("baseline", "sigma")) -> bytes:
    """corrected = gain * last row; everything else constant."""
    nodes = [
        helper.make_node("Gather", [window, "last"], ["row"], axis=1),
        helper.make_node("Mul", ["row", "gain"], ["corrected"]),
        helper.make_node("Identity", ["row"], ["baseline"]),
        helper.make_node("Abs", ["row"], ["sigma"]),
        helper.make_node("ReduceMin", ["condition", "axis"], ["in_envelope"], keepdims=1),
    ]
    constants = {"last": np.int64(2), "gain": np.float32(gain), "axis": np.array([1], np.int64)}
    value = helper.make_tensor_value_info
    model = helper.make_model(
        helper.make_graph(
            nodes,
            "toy",
            [
                value(window, TensorProto.FLOAT, ["N", 3, 2]),
                value("condition", TensorProto.FLOAT, ["N", 3]),
                value("time", TensorProto.DOUBLE, ["N", 1]),
            ],
            [value(name, TensorProto.FLOAT, ["N", 2]) for name in ("corrected", *outputs)]
            + [value("in_envelope", TensorProto.FLOAT, ["N", 1])],
            [numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", 18)],
    )
    model.ir_version = 9
    return model.SerializeToString()


def golden(gain: float = 2.0) -> dict[str, np.ndarray]:
    window = np.arange(12, dtype=np.float32).reshape(2, 3, 2)
    condition = np.ones((2, 3), np.float32)
    return {"window": window, "condition": condition, "time": np.zeros((2, 1)), "corrected": gain * window[:, -1]}


def write(folder: Path, content: bytes) -> Path:
    path = folder / "corrector.onnx"
    path.write_bytes(content)
    return path


def test_round_trip(tmp_path: Path) -> None:
    info = replace(INFO, conditions=({"name": "300", "speed": 300.0},), evaluation={"R2": 0.9})
    model = bundle.load(write(tmp_path, seal(graph(), info, golden())))
    assert model.info == info
    delta = model.start().correct(golden()["window"], np.ones(3, np.float32), np.zeros(2)).delta
    assert np.array_equal(delta, golden()["window"][:, -1])


def test_any_changed_byte_is_noticed(tmp_path: Path) -> None:
    content = seal(graph(), INFO, golden())
    rng = np.random.default_rng(0)
    for position in rng.integers(0, len(content), 60):
        changed = bytearray(content)
        changed[position] ^= 0x10
        with pytest.raises(BundleError):
            bundle.load(write(tmp_path, bytes(changed)))


def test_a_changed_weight_names_the_seal(tmp_path: Path) -> None:
    model = onnx.load_from_string(seal(graph(), INFO, golden()))
    gain = next(item for item in model.graph.initializer if item.name == "gain")
    gain.CopyFrom(numpy_helper.from_array(np.float32(2.1), "gain"))
    with pytest.raises(BundleError, match="seal does not fit"):
        bundle.load(write(tmp_path, model.SerializeToString()))


def test_a_golden_pair_that_does_not_come_out(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="golden pair does not come out"):
        bundle.load(write(tmp_path, seal(graph(), INFO, golden(gain=2.001))))


def test_other_onnx_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="no corrector"):
        bundle.load(write(tmp_path, graph()))
    with pytest.raises(BundleError, match="cannot open"):
        bundle.load(write(tmp_path, b"not onnx"))
    with pytest.raises(BundleError, match="cannot be read"):
        bundle.load(tmp_path / "missing.onnx")


def test_the_contract_is_checked(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="input 'window' is missing"):
        bundle.load(write(tmp_path, seal(graph(window="history"), INFO, golden())))
    with pytest.raises(BundleError, match=r"another type or shape.*\(N, 4, 2\)"):
        bundle.load(write(tmp_path, seal(graph(), replace(INFO, rows=4), golden())))
    with pytest.raises(BundleError, match="outputs are missing: sigma"):
        bundle.load(write(tmp_path, seal(graph(outputs=("baseline",)), INFO, golden())))


def test_formats_of_the_future_and_incomplete_metadata(tmp_path: Path) -> None:
    data = {**INFO.to_json(), "format": 4}
    with pytest.raises(BundleError, match="expected 1, 2 or 3, got 4"):
        Info.from_json(data, "x")
    data = INFO.to_json()
    del data["step_ns"]
    with pytest.raises(BundleError, match="step_ns"):
        Info.from_json(json.loads(json.dumps(data)), "x")
    assert Info.from_json(json.loads(json.dumps(INFO.to_json())), "x") == INFO
    assert asdict(INFO)["rows"] == 3


def test_it_streams_and_refuses_what_does_not_fit(tmp_path: Path) -> None:
    model = bundle.load(write(tmp_path, seal(graph(), INFO, golden())))
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), model)
    stepper.reset(Condition("x", speed=2.0, amplitude=2.0, frequency=2.0))
    values = np.random.default_rng(0).normal(size=(10, 2))
    result = stepper.process(Record(np.arange(10) * 1_000_000, values, CHANNELS))
    assert np.allclose(result.values[2:, 2:4], 2.0 * values[2:], atol=1e-6)
    stepper.reset(Condition("x"))
    with pytest.raises(SignalError, match=r"expected 0\.001 s, got 0\.002 s"):
        stepper.process(Record(np.arange(10) * 2_000_000, values, CHANNELS))
    with pytest.raises(SignalError, match="another unit"):
        CorrectedStepper(ReplayStepper((Channel("FW", unit="m"), CHANNELS[1])), model)
    with pytest.raises(SignalError, match="lacks FB"):
        CorrectedStepper(ReplayStepper(CHANNELS[:1]), model)
