"""Is the generated C the corrector? Compiled for this machine, it is asked what ONNX Runtime is asked.

Asked are the bundle's golden pair, windows like its own, since a guard lets nothing else through, and random windows and
conditions, smooth and rough, inside and outside of the envelope; once for every instruction set that this machine has. A
corrector with a state sees them one after the other, from the state that ONNX Runtime has come to.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Generator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect import units
from fmucorrect.bundle import GOLDEN_TOLERANCE, Bundle
from fmucorrect.errors import WrapError
from fmucorrect.wrapping.compiler import compile_library, host
from fmucorrect.wrapping.network import NetworkSources

TOLERANCE = GOLDEN_TOLERANCE
"""mm, or the channel's unit where that is no length; times the largest response of the envelope, if that is more than 1: as
alike as ONNX Runtime has to be on another machine. What the last digit of its inputs does to ONNX Runtime's own answer (the
largest of `_NUDGES` changes) comes on top, once for each product of matrices that follows on another: each rounds anew, in
another order of its sums, and a filter whose weights are large and of both signs loses digits wherever it is computed."""

_PRODUCTS = ("MatMul", "Gemm", "Conv", "RNN", "GRU", "LSTM")

WAYS = ("baseline", "avx2")
_BATCHES, _BATCH = 50, 20
_NUDGES = 2
_USUAL = {"speed": (0.0, 400.0), "amplitude": (0.0, 0.1), "frequency": (0.0, 10.0)}
_ENDLESS = 1e6
"""A corner of the envelope that far out is none."""


class Answers(NamedTuple):
    """To N windows, in the channels' units; inside: (N, 1); next_state as the network has it."""

    delta: Float32[np.ndarray, "N J"]
    sigma: Float32[np.ndarray, "N J"]
    inside: Float32[np.ndarray, "N 1"]
    next_state: Float32[np.ndarray, "N S"]


class Questions(NamedTuple):
    """right: ONNX Runtime's answers. rounding: by how much these change at most, among windows that belong together, with the
    last digit of windows and states."""

    windows: Float32[np.ndarray, "N W V"]
    conditions: Float32[np.ndarray, "N 3"]
    seconds: Float64[np.ndarray, " N"]
    states: Float32[np.ndarray, "N S"]
    right: Answers
    rounding: Answers


@dataclass(frozen=True)
class Proof:
    """windows: how many were compared, inside: how many of them the corrector did not leave alone.

    errors: the largest deviation for each instruction set, as a share of what is allowed. largest: in mm or the
    channel's unit.
    """

    windows: int
    inside: int
    errors: Mapping[str, float]
    largest: float

    def figures(self) -> dict[str, Any]:
        return asdict(self)


def prove(bundle: Bundle, sources: NetworkSources, work: Path, defined: Mapping[str, units.Unit] = units.NONE) -> Proof:
    """Compiles `sources` in the folder `work` and compares. Raises WrapError where an answer differs by more than
    TOLERANCE (see there), and on machines for which there is no compiler. defined: units of the solver's own."""
    target, _, suffix = host()
    where = str(bundle.path)
    names = sources.write(work)
    (work / "network_probe.c").write_bytes((Path(__file__).parent / "c" / "network_probe.c").read_bytes())
    library = work / f"network_probe{suffix}"
    compile_library(work, [*names, "network_probe.c"], target, library)
    asked = _questions(bundle)
    scale, limits = _limits(bundle, defined)
    carried = TOLERANCE * np.maximum(1.0, np.abs(asked.right.next_state.astype(float)).max(0))
    scales = (scale, scale, np.ones(1), np.ones(len(carried)))
    allowed = (limits, limits, np.full(1, TOLERANCE), carried)
    products = _products_in_a_row(bundle)
    errors: dict[str, float] = {}
    largest = 0.0
    with _loaded(library) as probe:
        for way, name in ((-1, "chosen"), *enumerate(WAYS)):
            answers = _ask(probe, way, asked)
            if answers is None:
                continue
            for i, what in enumerate(Answers._fields):
                error = np.abs(answers[i] - asked.right[i]) * scales[i]
                bound = allowed[i] + products * asked.rounding[i] * scales[i]
                _judge(what, error, bound, name, where)
                errors[name] = max(errors.get(name, 0.0), float((error / bound).max(initial=0.0)))
                if what != "next_state":  # which has no unit
                    largest = max(largest, float(error.max()))
    return Proof(len(asked.windows), int((asked.right.inside > 0).sum()), errors, largest)


def _products_in_a_row(bundle: Bundle) -> int:
    """Of the longest way through the graph, those with weights."""
    import onnx

    graph = onnx.load_model_from_string(bundle.path.read_bytes()).graph
    count = {item.name: 0 for item in (*graph.input, *graph.initializer)}
    for node in graph.node:
        most = max((count.get(name, 0) for name in node.input), default=0)
        count |= dict.fromkeys(node.output, most + (node.op_type in _PRODUCTS))
    return max(count.values())


def _judge(
    what: str, error: Float64[np.ndarray, "N D"], bound: Float64[np.ndarray, "N D"], way: str, where: str
) -> None:
    wrong = ~(error <= bound)  # NaN is no agreement
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise WrapError(
            f"the generated C ({way}) is not the corrector: {what} {column + 1} differs from ONNX Runtime's",
            where=where,
            expected=f"at most {bound[row, column]:.3g}",
            got=f"{error[row, column]:.3g} in {wrong.any(1).sum()} of {len(error)} windows, this one for example",
            remedy="Please report this; the network must not be used as C.",
        )


def _limits(
    bundle: Bundle, defined: Mapping[str, units.Unit]
) -> tuple[Float64[np.ndarray, " J"], Float64[np.ndarray, " J"]]:
    """What deviations are multiplied by to be in mm where they are lengths, and what they may then be."""
    parsed = [units.explained(c.unit, f"channel {c.name!r}", defined) for c in bundle.channels]
    metre = units.parse("mm")
    scale = np.array([unit.factor / metre.factor if unit.dimension == metre.dimension else 1.0 for unit in parsed])
    responses = np.abs(_ranges(bundle)[: len(scale)]).max(1) * scale
    return scale, TOLERANCE * np.maximum(1.0, responses)


def _ranges(bundle: Bundle) -> Float64[np.ndarray, "V 2"]:
    """Inner corners of the responses; ten times the uncorrected deviation where there are none. Of what else is seen the range
    in the golden pair."""
    pairs = zip(bundle.channels, bundle.uncorrected.tolist(), strict=True)
    channels = [_inner(bundle, f"response {c.name}", (-10.0 * rms, 10.0 * rms)) for c, rms in pairs]
    others = bundle.golden["window"][:, :, len(channels) :].astype(np.float64)
    return np.array([*channels, *zip(others.min((0, 1)), others.max((0, 1)), strict=True)])


def _inner(bundle: Bundle, name: str, otherwise: tuple[float, float]) -> tuple[float, float]:
    corners = bundle.info.envelope.get(name, (-np.inf, -np.inf, np.inf, np.inf))
    low, high = (c if abs(c) < _ENDLESS else other for c, other in zip(corners[1:3], otherwise, strict=True))
    return low, high


def _questions(bundle: Bundle) -> Questions:
    rng = np.random.default_rng(20250101)
    parts = [_golden(bundle)]
    ranges = _ranges(bundle)
    conditions = np.array([_inner(bundle, name, usual) for name, usual in _USUAL.items()])
    for i in range(_BATCHES):
        windows = _windows(rng, bundle.rows, ranges, 3.0 if i % 5 == 4 else 1.0)
        condition = _inside(rng, conditions, 1.5 if i % 5 == 3 else 1.0).astype(np.float32)
        seconds = np.where(rng.random(_BATCH) < 0.1, -1.0, 10.0 ** rng.uniform(-3.0, 6.0, _BATCH))
        seconds[0] = 0.0
        parts.append(_answered(bundle, windows, condition, seconds))
        parts.append(_like_golden(rng, bundle))
    return _joined(parts)


def _answered(
    bundle: Bundle,
    windows: Float32[np.ndarray, "N W V"],
    condition: Float32[np.ndarray, "3"],
    seconds: Float64[np.ndarray, " N"],
    state: Float32[np.ndarray, " S"] | None = None,
) -> Questions:
    """state: of the first window, zeros where nothing is said."""
    run = bundle.start()
    run.state[:] = 0.0 if state is None else state
    rng = np.random.default_rng(7)
    states, answers, roundings = [], [], []
    size = 1 if len(run.state) else len(windows)

    def answer(
        windows: Float32[np.ndarray, "n W V"], before: Float32[np.ndarray, " S"], seconds: np.ndarray
    ) -> Answers:
        run.state[:] = before
        delta, sigma, inside = run.correct(windows, condition, seconds)
        if len(delta) < size:
            raise WrapError("ONNX Runtime gives no finite numbers for windows as they may come", where=str(bundle.path))
        return Answers(delta, sigma, inside[:, None], np.tile(run.state, (size, 1)))

    for i in range(0, len(windows), size):
        before, asked, at = run.state.copy(), windows[i : i + size], seconds[i : i + size]
        states.append(np.tile(before, (size, 1)))
        nudged = [answer(_nudged(rng, asked), _nudged(rng, before), at) for _ in range(_NUDGES)]
        answers.append(right := answer(asked, before, at))
        changes = [[np.abs(a - b) for a, b in zip(other, right, strict=True)] for other in nudged]
        roundings.append(Answers(*(np.max(parts, axis=0) for parts in zip(*changes, strict=True))))
    right, changes = (Answers(*map(np.concatenate, zip(*rows, strict=True))) for rows in (answers, roundings))
    rounding = Answers(*(np.broadcast_to(change.max(axis=0), change.shape) for change in changes))
    return Questions(windows, np.tile(condition, (len(windows), 1)), seconds, np.concatenate(states), right, rounding)


def _nudged(rng: np.random.Generator, x: Float32[np.ndarray, "*n"]) -> Float32[np.ndarray, "*n"]:
    """Each number one up or down in its last digit."""
    return np.nextafter(x, np.where(rng.random(x.shape) < 0.5, -np.inf, np.inf).astype(np.float32))


def _joined(parts: Sequence[Questions]) -> Questions:
    windows, conditions, seconds, states, right, rounding = zip(*parts, strict=True)
    asked = (np.concatenate(windows), np.concatenate(conditions), np.concatenate(seconds), np.concatenate(states))
    return Questions(*asked, *(Answers(*map(np.concatenate, zip(*rows, strict=True))) for rows in (right, rounding)))


def _inside(rng: np.random.Generator, ranges: Float64[np.ndarray, "D 2"], stretch: float) -> Float64[np.ndarray, " D"]:
    middle, half = ranges.mean(1), np.diff(ranges)[:, 0] / 2.0
    return middle + stretch * half * rng.uniform(-1.0, 1.0, len(ranges))


def _windows(
    rng: np.random.Generator, rows: int, ranges: Float64[np.ndarray, "V 2"], stretch: float
) -> Float32[np.ndarray, "N W V"]:
    """Waves and noise in changing shares within `stretch` times the ranges."""
    shape = (_BATCH, rows, len(ranges))
    period = 10.0 ** rng.uniform(0.5, 3.0, (_BATCH, 1, len(ranges)))
    turn = rng.uniform(0.0, 2.0 * np.pi, period.shape)
    waves = np.sin(2.0 * np.pi * np.arange(rows)[None, :, None] / period + turn)
    share = rng.random((_BATCH, 1, 1)) ** 2
    unit = (1.0 - share) * waves + share * rng.uniform(-1.0, 1.0, shape)
    size = stretch * rng.random((_BATCH, 1, len(ranges)))
    return (ranges.mean(1) + size * np.diff(ranges)[:, 0] / 2.0 * unit).astype(np.float32)


def _golden(bundle: Bundle) -> Questions:
    """The golden pair. Its `corrected` takes the place of ONNX Runtime's."""
    arrays = bundle.golden
    windows, conditions, seconds = arrays["window"], arrays["condition"], arrays["time"][:, 0]
    states = arrays.get("state", np.zeros((len(windows), 0), np.float32))
    rows = [
        _answered(bundle, windows[i : i + 1], condition, seconds[i : i + 1], states[i])
        for i, condition in enumerate(conditions)
    ]
    golden = _joined(rows)
    return golden._replace(
        right=golden.right._replace(delta=arrays["corrected"] - windows[:, -1, : len(bundle.channels)])
    )


def _like_golden(rng: np.random.Generator, bundle: Bundle) -> Questions:
    """Windows of the golden pair, up to a fifth larger or smaller, from its first state."""
    arrays = bundle.golden
    picked = rng.integers(len(arrays["window"]), size=_BATCH)
    size = rng.uniform(0.8, 1.2, (_BATCH, 1, 1)).astype(np.float32)
    state = arrays["state"][picked[0]] if "state" in arrays else None
    return _answered(bundle, size * arrays["window"][picked], arrays["condition"][0], arrays["time"][picked, 0], state)


@contextlib.contextmanager
def _loaded(library: Path) -> Generator[Any]:
    """Its function `probe`. The library is closed again, so that the folder can be removed."""
    import _ctypes

    try:
        opened = ctypes.CDLL(str(library.resolve()))
    except OSError as error:
        raise WrapError(f"the compiled network cannot be loaded on this machine: {error}") from error
    try:
        yield opened.probe
    finally:
        close: Any = getattr(_ctypes, "FreeLibrary" if sys.platform == "win32" else "dlclose")
        close(opened._handle)


def _ask(probe: Any, way: int, asked: Questions) -> Answers | None:
    """The answers of one way of computing; None where this processor lacks what it needs."""
    count, channels = asked.right.delta.shape
    inputs = [np.ascontiguousarray(array) for array in asked[:3]]
    states = np.ascontiguousarray(asked.states)
    outputs = [np.full((count, n), np.nan, np.float32) for n in (channels, channels, channels, 1)]
    next_states = np.full_like(states, np.nan)
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*inputs, *outputs, states, next_states)]
    if not probe(ctypes.c_int(way), ctypes.c_int(count), *pointers):
        return None
    corrected, _, sigma, inside = outputs
    return Answers(corrected - asked.windows[:, -1, :channels], sigma, inside, next_states)
