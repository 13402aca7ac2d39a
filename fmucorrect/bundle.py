"""The bundle: one ONNX file that holds a corrector, what it was trained on, and a golden pair that proves it.

Inputs `window` float32 (N, W, V), oldest row first, the channels in their units and then what else it sees (V = J where
that is nothing); `condition` float32 (N, 3): speed km/h,
amplitude deg, frequency Hz; `time` float64 (N, 1): s since the excitation began. Outputs `corrected`, `baseline` and
`sigma` float32 (N, J) in the channels' units, `in_envelope` float32 (N, 1) in [0, 1]; further outputs may follow.
`metadata_props["fmucorrect"]` is JSON (bundle_metadata.py); `metadata_props["fmucorrect_sha256"]`, the last field of the
file, seals everything before it.

Format 2, for what sees more than the channels (the metadata name it, `sees`), or remembers more than a window: then there is
one more input `state` and one more output `next_state`, float32 (N, S). The state is zero at first; it moves on at the first
sample whose window is full, and once at each one after.

Format 3, for what sees inputs of the solver as they were held until a row's time (the metadata name them, `held`): a host's
inputs at a time t stand beside the outputs of the next sample, which follow from them. Where the metadata name none, they stand
beside the outputs at t.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect import bundle_graph, bundle_metadata
from fmucorrect.brief import brief_of
from fmucorrect.bundle_metadata import Info as Info
from fmucorrect.errors import BundleError, require_path
from fmucorrect.signals import Channel
from fmucorrect.stepper import Correction, Window

if TYPE_CHECKING:
    import onnxruntime

CHUNK = 4096
"""Windows that are copied and computed at once; larger chunks leave the cache."""

OUTPUTS = ("corrected", "sigma", "in_envelope")
GOLDEN_TOLERANCE = 1e-5
"""Of the largest value: single precision loses a tenth of it in sums of a network."""
_RESPONSES = ("corrected", "baseline", "sigma")
"""Outputs in the channels' units. A small sigma is a difference of large responses, and exact to what these are."""
MEMORY = 1 << 30
"""Bytes that the first replay of a golden pair may take: a few rows, through a network of at most bundle_graph.LARGEST."""
LONGEST = 20.0
"""s that it may take; the shipped correctors take a thousandth of that."""


def seal(graph: bytes, info: Info, golden: Mapping[str, np.ndarray]) -> bytes:
    """A serialised ONNX model without metadata, made a bundle. golden: all inputs and all outputs of the contract, few rows.

    ONNX is protobuf: fields that are appended belong to the same message, so that the graph's bytes stay as they are.
    """
    packed = {name: _pack(array) for name, array in golden.items()}
    return sealed(graph, json.dumps({**info.to_json(), "golden": packed}))


def sealed(graph: bytes, text: str) -> bytes:
    """The same with metadata as text."""
    content = graph + _metadata("fmucorrect", text)
    return content + _metadata("fmucorrect_sha256", hashlib.sha256(content).hexdigest())


def completed(graph: bytes, info: Info, inputs: Mapping[str, np.ndarray], where: str) -> bytes:
    """seal() with the golden pair that ONNX Runtime makes of `inputs` here. Raises BundleError where the graph does not keep
    the contract, or says what is not finite."""
    session = _kept(graph, info, where)
    said = dict(zip(info.outputs, _run(session, list(info.outputs), inputs, where), strict=True))
    wrong = [name for name, values in said.items() if not np.isfinite(values).all()]
    if wrong:
        raise BundleError(f"output {wrong[0]!r} is not finite for inputs from the study", where=where)
    return seal(graph, info, {**inputs, **said})


def states(graph: bytes, info: Info, inputs: Mapping[str, np.ndarray], where: str) -> Float32[np.ndarray, "N S"]:
    """What the graph has come to before each row of `inputs` (without a state), from zeros on. Raises BundleError as
    `completed`."""
    session = _kept(graph, info, where)
    found = np.zeros((len(inputs["window"]), info.state), np.float32)
    for i in range(len(found) - 1):
        row = {name: values[i : i + 1] for name, values in inputs.items()}
        found[i + 1 : i + 2] = _run(session, ["next_state"], {**row, "state": found[i : i + 1]}, where)[0]
    return found


def _kept(graph: bytes, info: Info, where: str) -> onnxruntime.InferenceSession:
    """Of a graph without metadata. Raises BundleError where it does not keep the contract."""
    bundle_graph.metadata(graph, where)
    session = _session(graph, where)
    _check_contract(session, info, where)
    return session


@final
class Bundle:
    """An opened bundle; a stepper.Corrector. Immutable, shared by any number of steppers and threads. golden: the pair that
    proves it, inputs and outputs by name."""

    def __init__(
        self, session: onnxruntime.InferenceSession, info: Info, path: Path, golden: Mapping[str, np.ndarray]
    ) -> None:
        self._session, self.info, self.path, self.golden = session, info, path, golden
        self._uncorrected = np.array(info.uncorrected, np.float32)

    def __repr__(self) -> str:
        return brief_of(self, "path", "channels", "sees", "rows", "step_ns")

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self.info.channels

    @property
    def sees(self) -> tuple[Channel, ...]:
        return self.info.sees

    @property
    def held(self) -> tuple[str, ...]:
        return self.info.held

    @property
    def rows(self) -> int:
        return self.info.rows

    @property
    def step_ns(self) -> int:
        return self.info.step_ns

    @property
    def uncorrected(self) -> Float32[np.ndarray, " J"]:
        return self._uncorrected

    def start(self) -> Run:
        return Run(self._session, self.info, str(self.path))

    def unlike(self, given: Mapping[str, float], defaults: Mapping[str, float]) -> list[str]:
        return self.info.unlike(given, defaults)


@final
class Run:
    """A stepper.CorrectorRun. ONNX Runtime reads and writes arrays that stay where they are; the state goes to and fro between
    two of them."""

    def __init__(self, session: onnxruntime.InferenceSession, info: Info, where: str) -> None:
        self._session, self._where, self._recurrent = session, where, info.state > 0
        self._count = count = len(info.channels)
        self.window = Window(info.rows, len(info.seen))
        self.condition, self.seconds = np.zeros((1, 3), np.float32), np.zeros((1, 1))
        self._said = np.zeros(2 * count + 1, np.float32)  # corrected, sigma, in_envelope
        self._corrected, self._last = self._said[None, :count], self.window.array[:, -1, :count]
        self.answer = Correction(np.zeros((1, count), np.float32), self._said[None, count:-1], self._said[-1:])
        self._states = np.zeros((2, 1, info.state), np.float32)
        self._turn = 0  # of the two, the one that is the state now
        self._bindings = self._bind(0), self._bind(1)
        # whether each number is finite: looking for a zero byte takes a tenth of numpy's all()
        self._flags = flags = bytearray(len(self._said) + info.state)
        whether = np.frombuffer(flags, bool)
        self._finite = whether[: len(self._said)], whether[len(self._said) :]

    def _bind(self, turn: int) -> onnxruntime.IOBinding:
        OrtValue, binding = _runtime().OrtValue, self._session.io_binding()
        inputs = {"window": self.window.array, "condition": self.condition, "time": self.seconds}
        outputs = {"corrected": self._corrected, "sigma": self.answer.sigma, "in_envelope": self.answer.inside[None]}
        if self._recurrent:
            inputs["state"], outputs["next_state"] = self._states[turn], self._states[1 - turn]
        for name, array in inputs.items():
            binding.bind_ortvalue_input(name, OrtValue.ortvalue_from_numpy(array))
        for name, array in outputs.items():
            binding.bind_ortvalue_output(name, OrtValue.ortvalue_from_numpy(array))
        return binding

    @property
    def state(self) -> Float32[np.ndarray, " S"]:
        return self._states[self._turn, 0]

    def reset(self) -> None:
        self.window.clear()
        self._states[:] = 0.0

    def step(self) -> bool:
        self._session.run_with_iobinding(self._bindings[self._turn])
        np.subtract(self._corrected, self._last, self.answer.delta)
        np.isfinite(self._said, self._finite[0])
        if self._recurrent:
            self._turn = turn = 1 - self._turn
            np.isfinite(self._states[turn, 0], self._finite[1])
        return 0 not in self._flags

    def correct(
        self,
        windows: Float32[np.ndarray, "N W V"],
        condition: Float32[np.ndarray, "3"],
        seconds: Float64[np.ndarray, " N"],
    ) -> Correction:
        said = (self._in_turn if self._recurrent else self._at_once)(windows, condition, seconds)
        delta = said[:, : self._count] - windows[: len(said), -1, : self._count]
        sound = len(said)
        if not np.isfinite(said).all() or not np.isfinite(self.state).all():
            wrong = np.flatnonzero(~np.isfinite(said).all(1))
            sound = int(wrong[0]) if len(wrong) else sound - 1
            self._said[:], self.answer.delta[0] = said[sound], delta[sound]
        return Correction(delta[:sound], said[:sound, self._count : -1], said[:sound, -1])

    def _in_turn(self, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        """What step() would find in self._said, row by row: the state of one is needed for the next. Ends after the first that
        is not finite, or whose state is not."""
        said = np.empty((len(windows), len(self._said)), np.float32)
        window, second = self.window.array[0], self.seconds[0]
        (mine, finite), states, turn = self._finite, self._states[:, 0], self._turn
        compute, bindings, one, flags = self._session.run_with_iobinding, self._bindings, self._said, self._flags
        self.condition[0] = condition
        done = 0
        for row in range(len(windows)):
            window[:] = windows[row]
            second[0] = seconds[row]
            compute(bindings[turn])
            said[row] = one
            done, turn = row + 1, 1 - turn
            np.isfinite(states[turn], finite)
            np.isfinite(one, mine)
            if 0 in flags:
                break
        self._turn = turn
        return said[:done]

    def _at_once(self, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        """The same in as few calls as there is room for in the cache."""
        count, channels = len(windows), self._count
        said = np.empty((count, len(self._said)), np.float32)
        block = np.empty((min(count, CHUNK), *windows.shape[1:]), np.float32)
        conditions = np.tile(condition, (len(block), 1))
        for start in range(0, count, CHUNK):
            part = said[start : start + CHUNK]
            size = len(part)
            block[:size] = windows[start : start + size]
            feed = {"window": block[:size], "condition": conditions[:size], "time": seconds[start : start + size, None]}
            answers = _run(self._session, OUTPUTS, feed, self._where)
            part[:, :channels], part[:, channels:-1], part[:, -1:] = answers
        return said


def load(path: str | Path) -> Bundle:
    """Open and prove a bundle: its seal, its metadata, its inputs and outputs, and its golden pair, replayed here and now.

    The file may be anybody's. ONNX Runtime gets it when it is known to hold nothing but arithmetic (bundle_graph.py), and
    first in a session of bounded memory and time. Raises BundleError that says what failed.
    """
    require_path("an ONNX bundle", path)
    path, where = Path(path), str(path)
    try:
        with path.open("rb") as file:
            content = file.read(bundle_graph.LARGEST + 1)
    except OSError as error:
        raise BundleError(f"cannot be read: {error.strerror}", where=where) from error
    entries = bundle_graph.metadata(content, where)
    if "fmucorrect" not in entries:
        raise BundleError(
            "this ONNX file is no corrector", where=where, remedy="Make one with `fmucorrect train` (see tools/)."
        )
    last = _metadata("fmucorrect_sha256", entries.get("fmucorrect_sha256", ""))
    digest = hashlib.sha256(content.removesuffix(last)).hexdigest()
    if entries.get("fmucorrect_sha256") != digest:
        raise BundleError(
            "the seal does not fit: the file was changed after it was made", where=where, remedy="Export it again."
        )
    data = bundle_metadata.parse(entries["fmucorrect"], where)
    info = Info.from_json(data, where)
    trial = _session(content, where, trial=True)
    _check_contract(trial, info, where)
    golden = bundle_metadata.golden(data, info, where)
    _replay(trial, info, golden, where)
    session = _session(content, where)
    _replay(session, info, golden, where)
    return Bundle(session, info, path, golden)


def _session(content: bytes, where: str, trial: bool = False) -> onnxruntime.InferenceSession:
    """trial: all memory comes from where it is bounded, and none is spent on faster forms of the weights. Never is anything
    computed beforehand, where nothing could end it."""
    runtime = _runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4 if trial else 3
    options.add_session_config_entry("session.load_model_format", "ONNX")  # and not what else its bytes might be
    if trial:
        options.graph_optimization_level = runtime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_session_config_entry("session.use_env_allocators", "1")
        options.add_session_config_entry("session.disable_prepacking", "1")
    try:
        made = runtime.InferenceSession(
            content,
            options,
            providers=["CPUExecutionProvider"],
            disabled_optimizers=["ConstantFolding"],
            enable_fallback=0,  # which would print, and try the same once more
        )
        for item in (*made.get_inputs(), *made.get_outputs()):
            _ = item.name, item.type, item.shape  # raises for what is no text
        return made
    except Exception as error:  # onnxruntime's own errors have no common base but Exception
        raise BundleError(f"ONNX Runtime cannot open it: {error}", where=where) from error


@cache
def _runtime() -> Any:
    """ONNX Runtime, which is imported here alone: it is told before that it may not tell its makers that it runs (its file
    Privacy.md). What bounds the memory of trials, a process can say once."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    import onnxruntime

    native: Any = import_module("onnxruntime.capi._pybind_state")
    onnxruntime.disable_telemetry_events()
    place = native.OrtMemoryInfo("Cpu", native.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, native.OrtMemType.DEFAULT)
    arena = {
        "max_mem": MEMORY,
        "arena_extend_strategy": 1,
        "initial_chunk_size_bytes": -1,
        "max_dead_bytes_per_chunk": -1,
    }
    onnxruntime.create_and_register_allocator(place, onnxruntime.OrtArenaCfg(arena))
    return onnxruntime


def _check_contract(session: onnxruntime.InferenceSession, info: Info, where: str) -> None:
    found = {item.name: (item.type, list(item.shape)) for item in session.get_inputs()}
    for name, row in info.inputs.items():
        kind = "double" if name == "time" else "float"
        if name not in found:
            raise BundleError(f"input {name!r} is missing", where=where, got=sorted(found))
        if found[name][0] != f"tensor({kind})" or found[name][1][1:] != list(row):
            raise BundleError(
                f"input {name!r} has another type or shape",
                where=where,
                expected=f"{kind} (N, {', '.join(map(str, row))})",
                got=found[name],
            )
    others = sorted(set(found) - set(info.inputs))
    if others:
        raise BundleError("it has further inputs, which nobody feeds", where=where, got=others)
    outputs = {item.name: item.type for item in session.get_outputs()}
    missing = set(info.outputs) - set(outputs)
    if missing:
        raise BundleError(f"outputs are missing: {', '.join(sorted(missing))}", where=where, got=sorted(outputs))
    wrong = [name for name in info.outputs if outputs[name] != "tensor(float)"]
    if wrong:
        raise BundleError(f"output {wrong[0]!r} has another type", where=where, expected="float", got=outputs[wrong[0]])


def _replay(session: onnxruntime.InferenceSession, info: Info, golden: Mapping[str, np.ndarray], where: str) -> None:
    """All outputs that the golden pair holds, of all its rows at once and of the first alone; the others in their shapes."""
    outputs = [item.name for item in session.get_outputs()]
    options = _runtime().RunOptions()
    options.log_severity_level = 4
    clock = threading.Timer(LONGEST, setattr, (options, "terminate", True))
    clock.start()
    try:
        for count in dict.fromkeys((1, len(golden["time"]))):
            feed = {name: golden[name][:count] for name in info.inputs}
            answers = dict(zip(outputs, _run(session, outputs, feed, where, options), strict=True))
            for name, row in info.outputs.items():
                got, shape = answers[name], (count, *row)
                if got.shape != shape:
                    raise BundleError(f"output {name!r} has another shape", where=where, expected=shape, got=got.shape)
                if name not in golden:
                    continue
                expected = golden[name]
                alike = [golden[other] for other in _RESPONSES if other in golden] if name in _RESPONSES else [expected]
                largest = max(float(np.abs(values).max()) for values in alike)
                error = float(np.abs(got - expected[:count]).max()) / max(largest, 1e-9)
                if not error <= GOLDEN_TOLERANCE:
                    raise BundleError(
                        f"the golden pair does not come out on this machine: {name!r}",
                        where=where,
                        expected=f"within {GOLDEN_TOLERANCE:g} of the largest value",
                        got=f"{error:.3g}",
                        remedy="Another ONNX Runtime may help; do not use this one with this file.",
                    )
    finally:
        clock.cancel()


def _run(
    session: onnxruntime.InferenceSession,
    names: Sequence[str] | None,
    feed: Mapping[str, np.ndarray],
    where: str,
    options: onnxruntime.RunOptions | None = None,
) -> list[np.ndarray]:
    """What the network says. Raises BundleError."""
    try:
        return session.run(names, feed, options)  # type: ignore[return-value]
    except Exception as error:  # onnxruntime's own errors have no common base but Exception
        late = options is not None and options.terminate
        what = f"takes more than {LONGEST:g} s" if late else f"could not be computed: {error}"
        raise BundleError(f"the network {what}", where=where) from error


def _pack(array: np.ndarray) -> dict[str, Any]:
    contiguous = np.ascontiguousarray(array)
    return {
        "dtype": contiguous.dtype.str,
        "shape": list(contiguous.shape),
        "base64": base64.b64encode(contiguous.tobytes()).decode(),
    }


def _metadata(key: str, value: str) -> bytes:
    """One StringStringEntryProto as field 14 (metadata_props) of a ModelProto."""

    def delimited(number: int, body: bytes) -> bytes:
        return _varint(number << 3 | 2) + _varint(len(body)) + body

    return delimited(14, delimited(1, key.encode()) + delimited(2, value.encode()))


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])
