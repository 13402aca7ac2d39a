"""Correctors with a state: whatever way the samples come, the answer is the same to the bit, and it is the filter's."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import bundles
import numpy as np
import onnx
import pytest
from bundles import CHANNELS, Filter, make_recurrent
from hypothesis import given
from hypothesis import strategies as st
from onnx import helper

from fmucorrect import bundle
from fmucorrect.bundle import Bundle, Info, seal
from fmucorrect.errors import BundleError, SignalError
from fmucorrect.signals import Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status, finished_rows

ROWS, STATES, COUNT, STEP_NS = 3, 6, 60, 1_000_000
CONDITION = Condition("inside", speed=300.0, amplitude=0.03, frequency=2.0)
BANK = Filter.random(STATES, len(CHANNELS))
VALUES = np.random.default_rng(5).normal(size=(COUNT, len(CHANNELS)))
LOG = Record(np.arange(COUNT, dtype=np.int64) * STEP_NS, VALUES, CHANNELS)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_recurrent(tmp_path_factory.mktemp("recurrent") / "filter.onnx", BANK, rows=ROWS)


@pytest.fixture(scope="module")
def model(path: Path) -> Bundle:
    return bundle.load(path)


def stepper_of(model: Bundle) -> CorrectedStepper:
    stepper = CorrectedStepper(ReplayStepper(CHANNELS), model)
    stepper.reset(CONDITION)
    return stepper


def stepped(stepper: CorrectedStepper, first: int = 0, end: int = COUNT) -> np.ndarray:
    """corrected, sigma and status of rows of LOG."""
    steps = [stepper.step(int(LOG.t_ns[i]), VALUES[i]) for i in range(first, end)]
    return np.array([[*step.corrected, *step.sigma, step.status] for step in steps])


def processed(stepper: CorrectedStepper, first: int = 0, end: int = COUNT) -> np.ndarray:
    return stepper.process(LOG.rows(first, end)).values[:, len(CHANNELS) :]


def test_the_correction_is_the_filters(model: Bundle) -> None:
    got = stepped(stepper_of(model))
    wanted = VALUES + BANK.deltas(VALUES, ROWS)
    assert np.abs(got[:, : len(CHANNELS)] - wanted).max() < 1e-5
    assert np.abs(wanted[ROWS - 1 :] - VALUES[ROWS - 1 :]).max() > 0.5
    assert list(got[:, -1]) == [Status.WARMUP] * (ROWS - 1) + [Status.OK] * (COUNT - ROWS + 1)


def test_an_exponential_smoother_remembers_the_first_full_window(tmp_path: Path) -> None:
    """corrected = what an average that begins at zero has come to."""
    keep, one = 0.9, np.eye(1)
    channels = CHANNELS[:1]
    smoother = Filter(keep * one, (1 - keep) * one, one, 0.0 * one)
    model = bundle.load(make_recurrent(tmp_path / "smoother.onnx", smoother, channels, rows=1))
    stepper = CorrectedStepper(ReplayStepper(channels), model)
    stepper.reset(CONDITION)
    count = 200
    record = Record(np.arange(count, dtype=np.int64) * STEP_NS, np.ones((count, 1)), channels)
    got = stepper.process(record)["FW_corrected"]
    assert np.abs(got - (2.0 - keep ** np.arange(1, count + 1))).max() < 1e-6


@given(data=st.data())
def test_chunks_of_any_size_and_single_steps_give_the_same_bits(model: Bundle, data: st.DataObject) -> None:
    expected = processed(stepper_of(model))
    assert np.array_equal(stepped(stepper_of(model)), expected)
    stepper, parts, seen = stepper_of(model), [], 0
    while seen < COUNT:
        more = data.draw(st.integers(1, COUNT - seen))
        parts.append(data.draw(st.sampled_from((stepped, processed)))(stepper, seen, seen + more))
        seen += more
    assert np.array_equal(np.concatenate(parts), expected)


@given(sizes=st.lists(st.integers(1, 20), min_size=1, max_size=12))
def test_stream_gives_the_same_bits(model: Bundle, sizes: list[int]) -> None:
    ends = np.minimum(np.cumsum([0, *sizes, COUNT]), COUNT).tolist()
    records = [LOG.rows(a, b) for a, b in pairwise(ends) if b > a]
    results = stepper_of(model).stream(records)
    got = np.concatenate([result.values[:, len(CHANNELS) :] for result in results])
    assert np.array_equal(got, processed(stepper_of(model)))


@pytest.mark.parametrize("way", [stepped, processed])
def test_reset_forgets(model: Bundle, way: Callable[..., np.ndarray]) -> None:
    stepper = stepper_of(model)
    expected = way(stepper)
    for seen in (1, ROWS, ROWS + 1, COUNT):
        stepper.reset(CONDITION)
        way(stepper, 0, seen)
        stepper.reset(CONDITION)
        assert np.array_equal(way(stepper), expected)


def test_steppers_on_one_bundle_do_not_disturb_each_other(model: Bundle) -> None:
    expected = stepped(stepper_of(model))
    a, b = stepper_of(model), stepper_of(model)
    parts = []
    for i in range(COUNT):
        parts.append(stepped(a, i, i + 1))
        b.step(int(LOG.t_ns[i]), -VALUES[i])
    assert np.array_equal(np.concatenate(parts), expected)


def test_threads_on_one_bundle_do_not_disturb_each_other(model: Bundle) -> None:
    expected = processed(stepper_of(model))
    with ThreadPoolExecutor(4) as pool:
        for got in pool.map(lambda _: processed(stepper_of(model)), range(16)):
            assert np.array_equal(got, expected)


def test_outside_it_fades_while_the_state_goes_on(model: Bundle) -> None:
    stepper = stepper_of(model)
    stepper.reset(Condition("fast", speed=600.0))
    got = processed(stepper)
    assert np.array_equal(got[:, : len(CHANNELS)], VALUES)
    assert set(got[ROWS - 1 :, -1]) == {Status.OUTSIDE}


@pytest.mark.parametrize("way", [stepped, processed])
@pytest.mark.parametrize(
    ("shown", "named"), [(True, "the correction of channel 'FW'"), (False, "number 0 of the corrector's state")]
)
def test_what_becomes_infinite_is_named_with_its_time(
    tmp_path: Path, way: Callable[..., np.ndarray], shown: bool, named: str
) -> None:
    """A state that grows a million times at each sample, seen in the correction or hidden from it."""
    one = np.eye(len(CHANNELS))
    bank = Filter(1e6 * one, one, (1e30 if shown else 1.0) * one, 0.0 * one)
    path = make_recurrent(tmp_path / "grows.onnx", bank, rows=ROWS)
    if not shown:
        graph = onnx.load_from_string(parts(path)[0])
        next(node for node in graph.graph.node if node.output[0] == "of_state").input[0] = "come"
        content = graph.SerializeToString()
        golden = bundles.golden_pair(content, ROWS, len(CHANNELS), len(CHANNELS))
        path.write_bytes(seal(content, bundle.load(path).info, golden))
    stepper = stepper_of(bundle.load(path))
    with pytest.raises(SignalError, match=rf"{named}.* is -?(inf|nan) at t = 0\.\d+ s, expected finite") as caught:
        way(stepper)
    at = round(float(str(caught.value).split("t = ")[1].split(" s")[0]) / 1e-3)
    assert at > ROWS
    if way is processed:
        rows = finished_rows(caught.value)
        assert rows is not None
        assert len(rows) == at
        assert np.isfinite(rows.values).all()
    stepper.reset(CONDITION)
    assert np.isfinite(way(stepper, 0, at)).all()


def test_a_correction_that_is_not_finite_is_an_error_without_a_state_too(tmp_path: Path) -> None:
    model = bundle.load(bundles.make(tmp_path / "toy.onnx", rows=3, gain=1e30))
    values = VALUES.copy()
    values[7] = 1e20
    record = Record(LOG.t_ns, values, CHANNELS)
    stepper = stepper_of(model)
    with pytest.raises(SignalError, match=r"correction of channel 'FW' is inf at t = 0\.008 s") as caught:
        stepper.process(record)
    rows = finished_rows(caught.value)
    assert rows is not None
    assert len(rows) == 8
    stepper.reset(CONDITION)
    for i in range(8):
        stepper.step(int(LOG.t_ns[i]), values[i])
    with pytest.raises(SignalError, match=r"correction of channel 'FW' is inf at t = 0\.008 s"):
        stepper.step(int(LOG.t_ns[8]), values[8])


def parts(path: Path) -> tuple[bytes, dict]:
    """Graph and metadata of a bundle."""
    made = onnx.load(path)
    data = json.loads({entry.key: entry.value for entry in made.metadata_props}["fmucorrect"])
    del made.metadata_props[:]
    return made.SerializeToString(), data


def test_what_the_file_says(path: Path, model: Bundle, tmp_path: Path) -> None:
    _, data = parts(path)
    assert (data["format"], data["state"]) == (2, STATES)
    assert {"state", "next_state"} <= set(data["golden"])
    assert Info.from_json(data, "x") == model.info
    _, plain = parts(bundles.make(tmp_path / "toy.onnx"))
    assert plain["format"] == 1
    assert "state" not in plain


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.update(state=STATES + 1), "golden.state|input 'state' has another"),
        (lambda data: data.update(state=0), "state.*cannot be used"),
        (lambda data: data.update(state=10**6), "state.*cannot be used.*4096"),
        (lambda data: data.update(state=True), "state.*cannot be used"),
        (lambda data: data.pop("state"), "state.*cannot be used"),
        (lambda data: data.update(format=1), "further inputs.*state"),
        (lambda data: data.update(format=4), "another format.*1, 2 or 3"),
        (lambda data: data["golden"].pop("next_state"), "golden.next_state.*cannot be used"),
        (lambda data: data["golden"].pop("state"), "golden.state.*cannot be used"),
        (
            lambda data: data["golden"].update(next_state=data["golden"]["state"]),
            "golden pair does not come out.*next_state",
        ),
    ],
)
def test_metadata_that_does_not_fit_the_graph(
    path: Path, tmp_path: Path, change: Callable[[dict], object], message: str
) -> None:
    graph, data = parts(path)
    change(data)
    (tmp_path / "x.onnx").write_bytes(bundle.sealed(graph, json.dumps(data)))
    with pytest.raises(BundleError, match=message):
        bundle.load(tmp_path / "x.onnx")


def test_a_graph_without_the_state_that_is_promised(tmp_path: Path, model: Bundle) -> None:
    toy = onnx.load(bundles.make(tmp_path / "toy.onnx", rows=ROWS))
    del toy.metadata_props[:]
    (tmp_path / "x.onnx").write_bytes(seal(toy.SerializeToString(), model.info, model.golden))
    with pytest.raises(BundleError, match="input 'state' is missing"):
        bundle.load(tmp_path / "x.onnx")


def test_a_next_state_of_another_size(path: Path, tmp_path: Path) -> None:
    graph, data = parts(path)
    made = onnx.load_from_string(graph)
    next(node for node in made.graph.node if node.output[0] == "next_state").output[0] = "whole"
    made.graph.node.append(helper.make_node("Concat", ["whole", "whole"], ["next_state"], axis=1))
    for node in made.graph.node:
        if node.op_type == "MatMul" and node.input[0] == "next_state":
            node.input[0] = "whole"
    made.graph.node.sort(key=lambda node: node.output[0] == "next_state")
    made.graph.output[-1].type.tensor_type.shape.dim[1].dim_value = 2 * STATES
    (tmp_path / "x.onnx").write_bytes(bundle.sealed(made.SerializeToString(), json.dumps(data)))
    with pytest.raises(BundleError, match="output 'next_state' has another shape"):
        bundle.load(tmp_path / "x.onnx")
