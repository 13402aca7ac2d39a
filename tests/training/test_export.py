"""torch = ONNX; the phase stays exact; outside the envelope and in new motions it fades, to what it is said to fade to."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from closed_form import SMALL

from fmucorrect import bundle
from fmucorrect.pairs import pair
from fmucorrect.study import Study
from fmucorrect.training.data import samples
from fmucorrect.training.deployed import phase_features
from fmucorrect.training.export import graph
from fmucorrect.training.protocol import Trained, train
from fmucorrect.training.results import save

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="module")
def with_phase(study: Study) -> Trained:
    return train(study, replace(SMALL, corrector=replace(SMALL.corrector, phase=True, epochs=(5,))))


NAMES = ["corrected", "baseline", "sigma", "in_envelope"]


def random_inputs(count: int, rows: int, channels: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "window": rng.normal(size=(count, rows, channels)).astype(np.float32).cumsum(axis=1, dtype=np.float32) * 0.1,
        "condition": np.stack([rng.uniform(250, 420, count), np.full(count, 0.03), np.full(count, 2.0)], 1).astype(
            np.float32
        ),
        "time": rng.uniform(-5.0, 1e6, size=(count, 1)),
    }


def motions(study: Study, factor: float = 1.0) -> np.ndarray:
    """Windows of a condition of development, in motion."""
    return np.float32(factor) * samples(pair(study, study.condition("340")), SMALL.window).windows[1500:3500:2]


def onnx_outputs(content: bytes, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    return session.run(NAMES, inputs)


@pytest.mark.parametrize("name", ["trained", "with_phase"])
def test_torch_equals_onnx_to_a_nanometre(name: str, study: Study, request: pytest.FixtureRequest) -> None:
    trained: Trained = request.getfixturevalue(name)
    inputs = random_inputs(2000, SMALL.window, 2)
    factors = np.linspace(0.8, 1.2, 1000, dtype=np.float32)[:, None, None]
    inputs["window"][::2] = factors * motions(study)  # known motions, and such that are not quite
    with torch.no_grad():
        expected = trained.corrector(*(torch.from_numpy(value) for value in inputs.values()))
    got = onnx_outputs(graph(trained.corrector, SMALL.window, 2, 2), inputs)
    for name, b in zip(NAMES, got, strict=True):
        assert np.abs(getattr(expected, name).numpy() - b).max() <= 1e-6
    assert len(np.unique(got[3])) > 10  # inside, outside and between were all there


def test_rows_and_batches_agree(trained: Trained, tmp_path: Path) -> None:
    model = bundle.load(save(trained, tmp_path))
    inputs = random_inputs(3 * bundle.CHUNK // 2, SMALL.window, 2)
    many = model.start().correct(inputs["window"], inputs["condition"][0], inputs["time"][:, 0])
    run = model.start()
    run.condition[:] = inputs["condition"][:1]
    for i in range(0, len(inputs["window"]), 97):
        run.window.array[:], run.seconds[:] = inputs["window"][i], inputs["time"][i]
        assert run.step()
        assert np.abs(run.answer.delta[0] - many.delta[i]).max() <= 1e-6
        assert np.abs(run.answer.sigma[0] - many.sigma[i]).max() <= 1e-6


def test_outside_the_envelope_nothing_is_added(trained: Trained, tmp_path: Path) -> None:
    model = bundle.load(save(trained, tmp_path))
    windows = random_inputs(50, SMALL.window, 2)["window"]
    far = model.start().correct(windows, np.array([500.0, 0.03, 2.0], np.float32), np.zeros(50))
    assert not far.delta.any()
    assert not far.inside.any()
    assert np.allclose(far.sigma, model.uncorrected)
    wrong_frequency = model.start().correct(windows, np.array([330.0, 0.03, 3.0], np.float32), np.zeros(50))
    assert not wrong_frequency.delta.any()


def test_what_moved_otherwise_in_development_is_outside(trained: Trained, study: Study, tmp_path: Path) -> None:
    model, condition = bundle.load(save(trained, tmp_path)), np.array([330.0, 0.03, 2.0], np.float32)
    known = model.start().correct(motions(study), condition, np.zeros(1000))
    assert (known.inside == 1.0).all()
    assert known.delta.any()
    half = model.start().correct(motions(study, 0.5), condition, np.zeros(1000))
    assert (half.inside < 1.0).all()
    strange = model.start().correct(motions(study)[:, ::-1], condition, np.zeros(1000))
    assert np.mean(strange.inside == 0.0) > 0.9
    assert np.allclose(strange.sigma[strange.inside == 0.0], model.uncorrected)


def test_in_a_new_motion_a_linear_filter_is_left(trained: Trained, study: Study, tmp_path: Path) -> None:
    """Of any size, and nothing of it under another declared condition."""
    model, fallback = bundle.load(save(trained, tmp_path)), trained.fallback
    assert fallback is not None
    for windows in (motions(study)[:, ::-1], motions(study, -3.0), motions(study, 100.0)):
        new = model.start().correct(windows, np.array([330.0, 0.03, 2.0], np.float32), np.zeros(1000))
        outside = new.inside == 0.0
        assert np.mean(outside) > 0.5
        linear = windows.reshape(1000, -1) @ fallback.weights + fallback.offset
        assert np.abs(new.delta - linear)[outside].max() <= 1e-5 * np.abs(windows).max()
        assert np.abs(linear).max() > 0.0
        for condition in ([500.0, 0.03, 2.0], [330.0, 0.03, 3.0]):
            declared = model.start().correct(windows, np.array(condition, np.float32), np.zeros(1000))
            assert not declared.delta.any()


@pytest.mark.parametrize("frequency", [2.0, 1.3, 0.7, 7.9999])
def test_phase_is_exact_after_a_million_seconds(frequency: float) -> None:
    cycles = round(1e6 * frequency)
    parts = np.array([0.0, 0.125, 0.25, 0.4, 0.75])
    time = torch.tensor((cycles + parts) / frequency)[:, None]
    condition = torch.tensor([[300.0, 0.03, frequency]]).repeat(len(parts), 1)
    got = phase_features(condition, time).numpy()
    expected = np.stack([np.sin(2 * np.pi * parts), np.cos(2 * np.pi * parts)], 1)
    assert np.abs(got - expected).max() < 2e-6 * max(frequency, 1.0)


def test_phase_in_the_graph_after_a_million_seconds(with_phase: Trained) -> None:
    inputs = random_inputs(200, SMALL.window, 2)
    inputs["condition"][:, 2] = 1.3
    inputs["condition"][:, 0] = 330.0
    content = graph(with_phase.corrector, SMALL.window, 2, 2)
    inputs["time"] = np.arange(200)[:, None] * 1e-3
    early = onnx_outputs(content, inputs)[0]
    inputs["time"] = inputs["time"] + 1_300_000 / 1.3
    late = onnx_outputs(content, inputs)[0]
    assert np.abs(early - late).max() < 1e-5


def test_the_shipped_models_equal_their_torch_arithmetic() -> None:
    """The golden pair was computed by torch when the model was made; load() replays it, to 1e-5 of the largest value."""
    shipped = sorted((ROOT / "exported_models").glob("*/corrector.onnx"))
    assert shipped
    for path in shipped:
        assert bundle.load(path).info.channels[0].unit == "mm"
