"""The bundle: one ONNX file that holds a corrector, what it was trained on, and a golden pair that proves it.

Inputs `window` float32 (N, W, J), oldest row first, in the channels' units; `condition` float32 (N, 3): speed km/h,
amplitude deg, frequency Hz; `time` float64 (N, 1): s since the excitation began. Outputs `corrected`, `baseline` and
`sigma` float32 (N, J) in the channels' units, `in_envelope` float32 (N, 1) in [0, 1]; further outputs may follow.
`metadata_props["fmucorrect"]` is JSON (see Info); `metadata_props["fmucorrect_sha256"]`, the last field of the file, seals
everything before it.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect.errors import BundleError
from fmucorrect.signals import Channel
from fmucorrect.stepper import Correction

if TYPE_CHECKING:
    import onnxruntime

FORMAT = 1
CHUNK = 4096
"""Windows that are copied and computed at once; larger chunks leave the cache."""

OUTPUTS = ("corrected", "sigma", "in_envelope")
_GOLDEN_TOLERANCE = 1e-5


@dataclass(frozen=True)
class Info:
    """What a bundle says of itself.

    rows: W. step_ns: sample time. uncorrected: (J,) rms of measurement minus simulation in development, in the channels'
    units: sigma while there is no correction. envelope: for `speed`, `amplitude`, `frequency` and `response <channel>` the
    four corners outer low, inner low, inner high, outer high: inside the inner ones the correction is whole, beyond the
    outer ones it is nothing. conditions: those trained on, with the FMU start values of each. parameters: FMU start values
    of all of them, in the FMU's own units. evaluation: figures, for people.
    """

    name: str
    channels: tuple[Channel, ...]
    rows: int
    step_ns: int
    uncorrected: tuple[float, ...]
    envelope: Mapping[str, tuple[float, float, float, float]]
    conditions: tuple[Mapping[str, Any], ...]
    study_hash: str
    versions: Mapping[str, str]
    evaluation: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        return {"format": FORMAT, **asdict(self)}

    @staticmethod
    def from_json(data: Mapping[str, Any], where: str) -> Info:
        """Raises BundleError where the format is another one or a key is missing."""
        if data.get("format") != FORMAT:
            raise BundleError("bundle of another format", where=where, expected=FORMAT, got=data.get("format"))
        try:
            return Info(
                name=data["name"],
                channels=tuple(Channel(**channel) for channel in data["channels"]),
                rows=data["rows"],
                step_ns=data["step_ns"],
                uncorrected=tuple(data["uncorrected"]),
                envelope={key: tuple(corners) for key, corners in data["envelope"].items()},
                conditions=tuple(data["conditions"]),
                study_hash=data["study_hash"],
                versions=data["versions"],
                evaluation=data["evaluation"],
                parameters=data.get("parameters", {}),
            )
        except (KeyError, TypeError) as error:
            raise BundleError(f"the metadata is incomplete: {error}", where=where) from error


def seal(graph: bytes, info: Info, golden: Mapping[str, np.ndarray]) -> bytes:
    """A serialised ONNX model without metadata, made a bundle. golden: the three inputs and `corrected`, few rows.

    ONNX is protobuf: fields that are appended belong to the same message, so that the graph's bytes stay as they are.
    """
    packed = {name: _pack(array) for name, array in golden.items()}
    content = graph + _metadata("fmucorrect", json.dumps({**info.to_json(), "golden": packed}))
    return content + _metadata("fmucorrect_sha256", hashlib.sha256(content).hexdigest())


@final
class Bundle:
    """An opened bundle; a stepper.Corrector. Immutable, shared by any number of steppers and threads."""

    def __init__(self, session: onnxruntime.InferenceSession, info: Info, path: Path) -> None:
        self._session, self.info, self.path = session, info, path
        self._uncorrected = np.array(info.uncorrected, np.float32)

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self.info.channels

    @property
    def rows(self) -> int:
        return self.info.rows

    @property
    def step_ns(self) -> int:
        return self.info.step_ns

    @property
    def uncorrected(self) -> Float32[np.ndarray, " J"]:
        return self._uncorrected

    def correct(
        self,
        windows: Float32[np.ndarray, "N W J"],
        condition: Float32[np.ndarray, "3"],
        seconds: Float64[np.ndarray, " N"],
    ) -> Correction:
        count, rows, channels = windows.shape
        delta, sigma = np.empty((count, channels), np.float32), np.empty((count, channels), np.float32)
        inside = np.empty(count, np.float32)
        block = np.empty((min(count, CHUNK), rows, channels), np.float32)
        conditions = np.tile(condition, (len(block), 1))
        for start in range(0, count, CHUNK):
            part = slice(start, min(start + CHUNK, count))
            size = part.stop - start
            block[:size] = windows[part]
            feed = {"window": block[:size], "condition": conditions[:size], "time": seconds[part, None]}
            corrected, sigma[part], envelope = _arrays(self._session.run(OUTPUTS, feed))
            np.subtract(corrected, block[:size, -1], out=delta[part])
            inside[part] = envelope[:, 0]
        return Correction(delta, sigma, inside)

    def bind(
        self,
        window: Float32[np.ndarray, "1 W J"],
        condition: Float32[np.ndarray, "1 3"],
        seconds: Float64[np.ndarray, "1 1"],
    ) -> tuple[Callable[[], object], Correction]:
        from onnxruntime import OrtValue

        binding = self._session.io_binding()
        shared = {"window": window, "condition": condition, "time": seconds}
        for name, array in shared.items():
            binding.bind_ortvalue_input(name, OrtValue.ortvalue_from_numpy(array))
        channels = window.shape[2]
        corrected, sigma, inside = (np.zeros((1, n), np.float32) for n in (channels, channels, 1))
        for name, array in zip(OUTPUTS, (corrected, sigma, inside), strict=True):
            binding.bind_ortvalue_output(name, OrtValue.ortvalue_from_numpy(array))
        delta, last = np.zeros_like(corrected), window[:, -1]
        run, subtract = self._session.run_with_iobinding, np.subtract

        def correct() -> None:
            run(binding)
            subtract(corrected, last, delta)

        return correct, Correction(delta, sigma, inside[0])


def load(path: str | Path) -> Bundle:
    """Open and prove a bundle: its seal, its inputs and outputs, and its golden pair, replayed here and now.

    Raises BundleError that says which of these failed.
    """
    import onnxruntime

    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BundleError(f"cannot be read: {error.strerror}", where=str(path)) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own errors have no common base but Exception
        raise BundleError(f"ONNX Runtime cannot open it: {error}", where=str(path)) from error
    metadata = session.get_modelmeta().custom_metadata_map
    if "fmucorrect" not in metadata:
        raise BundleError(
            "this ONNX file is no corrector", where=str(path), remedy="Make one with `fmucorrect train` (see tools/)."
        )
    last = _metadata("fmucorrect_sha256", metadata.get("fmucorrect_sha256", ""))
    digest = hashlib.sha256(content.removesuffix(last)).hexdigest()
    if metadata.get("fmucorrect_sha256") != digest:
        raise BundleError(
            "the seal does not fit: the file was changed after it was made", where=str(path), remedy="Export it again."
        )
    data = json.loads(metadata["fmucorrect"])
    bundle = Bundle(session, Info.from_json(data, str(path)), path)
    _check_contract(session, bundle)
    _replay(session, {name: _unpack(entry) for name, entry in data["golden"].items()}, str(path))
    return bundle


def _check_contract(session: onnxruntime.InferenceSession, bundle: Bundle) -> None:
    rows, channels = bundle.rows, len(bundle.channels)
    expected = {"window": ("float", [rows, channels]), "condition": ("float", [3]), "time": ("double", [1])}
    found = {item.name: (item.type, list(item.shape)) for item in session.get_inputs()}
    for name, (kind, shape) in expected.items():
        if name not in found:
            raise BundleError(f"input {name!r} is missing", where=str(bundle.path), got=sorted(found))
        if found[name][0] != f"tensor({kind})" or found[name][1][1:] != shape:
            raise BundleError(
                f"input {name!r} has another type or shape",
                where=str(bundle.path),
                expected=f"{kind} (N, {', '.join(map(str, shape))})",
                got=found[name],
            )
    names = {item.name for item in session.get_outputs()}
    missing = {"corrected", "baseline", "sigma", "in_envelope"} - names
    if missing:
        raise BundleError(
            f"outputs are missing: {', '.join(sorted(missing))}", where=str(bundle.path), got=sorted(names)
        )


def _replay(session: onnxruntime.InferenceSession, golden: dict[str, np.ndarray], where: str) -> None:
    expected = golden.pop("corrected")
    got = _arrays(session.run(["corrected"], golden))[0]
    error = float(np.abs(got - expected).max()) / max(float(np.abs(expected).max()), 1e-9)
    if not error <= _GOLDEN_TOLERANCE:
        raise BundleError(
            "the golden pair does not come out on this machine",
            where=where,
            expected=f"within {_GOLDEN_TOLERANCE:g} of the largest value",
            got=f"{error:.3g}",
            remedy="Another ONNX Runtime may help; do not use this one with this file.",
        )


def _arrays(outputs: Any) -> list[np.ndarray]:
    """ONNX Runtime's answer, which its stubs take for anything that an ONNX value may be."""
    return outputs


def _pack(array: np.ndarray) -> dict[str, Any]:
    contiguous = np.ascontiguousarray(array)
    return {
        "dtype": contiguous.dtype.str,
        "shape": list(contiguous.shape),
        "base64": base64.b64encode(contiguous.tobytes()).decode(),
    }


def _unpack(entry: Mapping[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(entry["base64"]), entry["dtype"]).reshape(entry["shape"])


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
