"""fc.seal: a network that knows nothing of this project becomes a bundle that is proved, streamed and wrapped like ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bundles
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

import fmucorrect as fc
from fmucorrect.errors import BundleError, OutputError
from fmucorrect.screening import screen
from fmucorrect.sealing import evaluate
from fmucorrect.stepper import Status
from fmucorrect.study import Study
from fmucorrect.wrapping import network, proof

ROWS = 4


def foreign(
    nodes: list[Any], constants: dict[str, Any], inputs: dict[str, list], outputs: dict[str, list]
) -> onnx.ModelProto:
    """A model as another exporter may write it: a batch of its own name, only what it needs."""

    def values(shapes: dict[str, list]) -> list[Any]:
        return [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", *shape]) for name, shape in shapes.items()
        ]

    initializers = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "main_graph", values(inputs), values(outputs), initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], producer_name="somebody")
    model.ir_version = 8
    return model


def regression(gain: float, count: int) -> onnx.ModelProto:
    """A linear regression on the flat window, as skl2onnx would write one: the last row times gain."""
    weights = np.zeros((ROWS * count, count), np.float32)
    weights[-count:] = gain * np.eye(count)
    nodes = [
        helper.make_node("Flatten", ["window"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "coef"], ["product"]),
        helper.make_node("Add", ["product", "intercept"], ["corrected"]),
    ]
    constants = {"coef": weights, "intercept": np.zeros(count, np.float32)}
    return foreign(nodes, constants, {"window": [ROWS, count]}, {"corrected": [count]})


def gru(count: int, hidden: int = 5) -> onnx.ModelProto:
    """torch's GRU, as it is exported: (sequence, batch, features), and a linear layer behind it."""
    rng = np.random.default_rng(0)
    nodes = [
        helper.make_node("Gather", ["window", "newest"], ["row"], axis=1),
        helper.make_node("Unsqueeze", ["row", "first"], ["sequence"]),
        helper.make_node("Unsqueeze", ["state", "first"], ["before"]),
        helper.make_node(
            "GRU",
            ["sequence", "W", "R", "B", "", "before"],
            ["all", "after"],
            hidden_size=hidden,
            linear_before_reset=1,
        ),
        helper.make_node("Squeeze", ["after", "first"], ["next_state"]),
        helper.make_node("Gemm", ["next_state", "out", "bias"], ["more"]),
        helper.make_node("Add", ["row", "more"], ["corrected"]),
    ]
    shapes = {"W": (1, 3 * hidden, count), "R": (1, 3 * hidden, hidden), "B": (1, 6 * hidden), "out": (hidden, count)}
    constants = {name: (0.3 * rng.normal(size=shape)).astype(np.float32) for name, shape in shapes.items()}
    constants |= {"newest": np.int64(0), "first": np.array([0]), "bias": np.zeros(count, np.float32)}
    read, said = {"window": [1, count], "state": [hidden]}, {"corrected": [count], "next_state": [hidden]}
    return foreign(nodes, constants, read, said)


def test_what_it_does_not_say_comes_from_the_study(study: Study, tmp_path: Path) -> None:
    count = len(study.channels)
    onnx.save(regression(0.9, count), tmp_path / "theirs.onnx")
    model = fc.seal(tmp_path / "theirs.onnx", study, tmp_path / "corrector.onnx")
    info = model.info
    assert (info.rows, info.step_ns, info.study_hash, info.state) == (ROWS, study.simulation.step_ns, study.hash, 0)
    assert [condition["name"] for condition in info.conditions] == [condition.name for condition in study.development]
    left = []
    for pair in screen(study).pairs:
        result = evaluate(pair, model)
        rows = result.scored
        assert set(result.status[rows]) == {Status.OK}
        assert np.abs(result.corrected[rows] - 0.9 * result.simulated[rows]).max() < 1e-5
        left.append((result.measured - 0.9 * result.simulated)[rows])
        sigma = result.sigma[rows]
    assert np.allclose(sigma, np.sqrt(np.mean(np.concatenate(left) ** 2, axis=0)), rtol=1e-4)


def test_it_fades_to_the_simulation_outside(study: Study, tmp_path: Path) -> None:
    count = len(study.channels)
    model = fc.seal(regression(0.9, count), study, tmp_path / "corrector.onnx")
    low, high = model.info.envelope["speed"][2:]
    windows = np.full((3, ROWS, count), 1e-3, np.float32)
    features = np.array(study.development[0].features, np.float32)
    shares = []
    for speed in (low, (low + high) / 2.0, high + 1.0):
        features[0] = speed
        delta, sigma, inside = model.start().correct(windows, features, np.zeros(3))
        shares.append(float(inside[0]))
        assert np.allclose(delta, -0.1 * inside[0] * windows[:, -1], atol=1e-7)
    assert np.allclose(shares, [1.0, 0.5, 0.0], atol=1e-3)
    assert np.allclose(sigma, model.uncorrected)


def test_a_gru_with_its_state(study: Study, tmp_path: Path) -> None:
    """Row by row what its equations give, from a state of zeros."""
    count = len(study.channels)
    theirs = gru(count)
    model = fc.seal(theirs, study, tmp_path / "corrector.onnx")
    assert model.info.state == 5
    pair = screen(study).pairs[0]
    result = evaluate(pair, model)
    weights = {item.name: numpy_helper.to_array(item).astype(float) for item in theirs.graph.initializer}
    w, r, b = weights["W"][0], weights["R"][0], weights["B"][0]
    state, wanted = np.zeros(5), []
    for row in pair.simulated.values[:, :count]:
        of_row, of_state = w @ row + b[:15], r @ state + b[15:]
        z, reset = (1.0 / (1.0 + np.exp(-(of_row + of_state)[part])) for part in (slice(0, 5), slice(5, 10)))
        state = (1.0 - z) * np.tanh(of_row[10:] + reset * of_state[10:]) + z * state
        wanted.append(row + state @ weights["out"])
    assert np.abs(result.corrected - np.array(wanted)[pair.rows]).max() < 1e-4


def test_a_gru_becomes_c(study: Study, tmp_path: Path) -> None:
    for package in ("ziglang", "emx_onnx_cgen"):
        pytest.importorskip(package)
    model = fc.seal(gru(len(study.channels)), study, tmp_path / "corrector.onnx")
    held = proof.prove(model, network.sources(model.path), tmp_path / "proof")
    assert held.largest <= 1e-5
    assert held.inside > 100


def test_a_whole_bundles_network_is_taken_as_it_is(study: Study, tmp_path: Path) -> None:
    """All four outputs: nothing is added."""
    channels = tuple(study.channels)
    path = bundles.make(tmp_path / "ours.onnx", channels, rows=ROWS)
    model = fc.seal(path, study, tmp_path / "sealed.onnx")
    windows = np.random.default_rng(0).normal(size=(5, ROWS, len(channels))).astype(np.float32)
    ask = (windows, np.array([300.0, 0.03, 2.0], np.float32), np.zeros(5))
    for a, b in zip(fc.load_bundle(path).start().correct(*ask), model.start().correct(*ask), strict=True):
        assert np.array_equal(a, b)
    assert model.info.envelope == {}


def test_what_was_sealed_is_sealed_again(study: Study, tmp_path: Path) -> None:
    first = fc.seal(regression(0.9, len(study.channels)), study, tmp_path / "corrector.onnx")
    again = fc.seal(first.path, study, tmp_path / "again.onnx")
    assert again.info.evaluation == first.info.evaluation
    assert {*first.info.evaluation} == {"NRMSE in development", "NRMSE in development, simulated"}


def test_nothing_that_is_read_is_written_over(study: Study, tmp_path: Path) -> None:
    """Not the network, not what the study reads; and a bundle is known by its ending."""
    theirs = tmp_path / "theirs.onnx"
    onnx.save(regression(0.9, len(study.channels)), theirs)
    record = tmp_path / "record.onnx"
    record.write_bytes(b"measured")
    held = replace(study, conditions=(replace(study.conditions[0], measurement=record), *study.conditions[1:]))
    for path, message in (
        (theirs, "the network"),
        (record, "measurement of"),
        (tmp_path / "run.csv", "a bundle is written"),
    ):
        before = path.read_bytes() if path.exists() else None
        with pytest.raises(OutputError, match=message):
            fc.seal(theirs, held, path)
        assert (path.read_bytes() if path.exists() else None) == before


def test_what_somebody_else_wrote_stays_and_a_harmful_network_is_told(
    study: Study, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    count, path = len(study.channels), tmp_path / "mine.onnx"
    path.write_text("notes", encoding="utf-8")
    with pytest.raises(OutputError, match="there already"):
        fc.seal(regression(0.9, count), study, path)
    trained = bundles.make(tmp_path / "trained.onnx", tuple(study.channels), rows=ROWS)
    with pytest.raises(OutputError, match="there already"):
        fc.seal(regression(0.9, count), study, trained)
    assert path.read_text(encoding="utf-8") == "notes"
    caplog.clear()
    fc.seal(regression(9.0, count), study, path, overwrite=True)
    assert "worse than the simulation at" in caplog.text
    caplog.clear()
    fc.seal(regression(1.0, count), study, path)  # what was sealed may be sealed again
    assert "worse" not in caplog.text


def test_what_is_no_corrector_is_refused(study: Study, tmp_path: Path) -> None:
    count = len(study.channels)
    (tmp_path / "x.onnx").write_text("no network")
    cases = [(tmp_path / "x.onnx", "cannot open"), (regression(1.0, count + 1), "'window' has another shape")]
    named = regression(1.0, count)
    named.graph.input[0].name = named.graph.node[0].input[0] = "history"
    cases.append((named, "other inputs or outputs.*got history to corrected"))
    half = gru(count)
    del half.graph.output[1]
    cases.append((half, "out as 'next_state'"))
    wide, double = regression(1.0, count), regression(1.0, count)
    wide.graph.output[0].type.tensor_type.shape.dim[1].dim_value = count + 1
    double.graph.input[0].type.tensor_type.elem_type = TensorProto.DOUBLE
    cases += [(wide, "'corrected' has another shape"), (double, "another kind, expected float32, got double")]
    for model, message in cases:
        with pytest.raises(BundleError, match=message):
            fc.seal(model, study, tmp_path / "corrector.onnx")
    assert not (tmp_path / "corrector.onnx").exists()
