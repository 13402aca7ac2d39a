"""Where a force is missing: for each joint, the share of the residual that a free force there explains, and its history.

The response of all channels to a short force pulse at the joint, simulated along the condition, is inverted. With H that
response, a residual is taken for R = H F + E, the force F Gaussian with an even spectrum up to some frequency, the error E
white, of the highest marginal likelihood (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 5;
each frequency by itself as in Whittle 1953). A force that could explain one channel only by contradicting another is small
that way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from queue import SimpleQueue
from types import MappingProxyType

import numpy as np
from jaxtyping import Complex128, Float64

from fmucorrect.discovery.model import Model, simulate
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.simulator import LawAt, Simulator
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.trials import Trial
from fmucorrect.errors import FmuError
from fmucorrect.study import Joint
from fmucorrect.wrapping.laws import Wire
from fmucorrect.wrapping.places import places

_NONE: Mapping[str, float] = MappingProxyType({})

WHEN = 0.25  # where in a condition the pulse comes
EARLY = 0.05  # the same after the excitation begins, where the pulse's response lasts too long
TRIES = 6  # pulses, where one leaves no trace, or the solver gives up
OFFSET = 3.0  # largest offset of a sensor that is taken off its residual, in units of its noise
SURE = 5.0  # standard deviations of the noise's energy that a residual has to stand above to be shared out wholly


BINS, HUMS = 2, 0.5
"""Lines of a spectrum to each side of the strongest, under a Hann window, that are one frequency; share of a force's energy in
them from which it is of that frequency."""


@dataclass(frozen=True)
class Located:
    """joint. share: of the residual's energy above the noise that a free force there explains, 0 to 1, all conditions
    together. forces: (N,) N or N.m, one a condition, positive where it opposes a positive displacement."""

    joint: Joint
    share: float
    forces: tuple[Float64[np.ndarray, " _"], ...]


def hum(found: Located, step: float) -> tuple[float, float] | None:
    """Hz and N or N.m of the one frequency that most of a located force is of, at every condition; None where it is no such
    force. What turns by itself keeps no phase with a log, so that no law of one phase is it. step: s."""
    heard: list[tuple[float, float, float]] = []
    for force in found.forces:
        moved = force - force.mean()
        power = np.abs(np.fft.rfft(moved * np.hanning(len(moved)))) ** 2
        k = int(power[BINS:].argmax()) + BINS
        share = float(power[k - BINS : k + BINS + 1].sum() / max(float(power.sum()), 1e-300))
        if share < HUMS:
            return None
        heard.append((k / (len(moved) * step), float(np.sqrt(2.0 * share) * moved.std()), BINS / (len(moved) * step)))
    if not heard:
        return None
    frequency = float(np.median([f for f, _, _ in heard]))
    if any(abs(f - frequency) > width for f, _, width in heard):
        return None
    return frequency, float(np.median([size for _, size, _ in heard]))


class Pushed(Simulator):
    """The simulator of a condition that also pushes at `joints`, while `push` says so: joints, and (T,) N or N.m in a law's
    sense at each of them."""

    push: tuple[tuple[Joint, ...], np.ndarray] | None = None

    def __init__(self, problem: Problem, trial: Trial, joints: Sequence[Joint]) -> None:
        assert problem.library is not None
        seconds = (trial.rows.stop - 1) * problem.study.simulation.step_size
        extra = [joint.force for joint in joints]
        super().__init__(
            problem.study, trial.condition, problem.library, seconds, problem.substeps, extra, problem.budget
        )
        self._problem, self.trial = problem, trial

    def run(
        self, laws: Sequence[LawAt] = (), parameters: Mapping[str, float] = _NONE, inputs: np.ndarray | None = None
    ) -> Float64[np.ndarray, "T J"]:
        if self.push is not None:
            names, given = self.inputs
            inputs = np.array(given if inputs is None else inputs)
            joints, force = self.push
            wires = [Wire("", joint.name, joint.force, "", "", "", "", joint.sign, False) for joint in joints]
            for joint, place in zip(joints, places(self.description, wires), strict=True):
                inputs[:, names.index(joint.force)] += place.factor * force
        return super().run(laws, parameters, inputs)

    def response(self, model: Model) -> Float64[np.ndarray, "T J"] | None:
        """With a model's terms, at all rows; None where the solver gives up."""
        try:
            return simulate(self._problem.study, self, self.trial.condition, model, self._problem.tolerated)
        except FmuError:
            return None


def located(
    problem: Problem, model: Model, residuals: Sequence[Float64[np.ndarray, "_ J"]], joints: Sequence[Joint]
) -> list[Located]:
    """What a free force at each of `joints` explains of `residuals` (measured less the response of `model`, one a condition,
    in the channels' units), in the order of `joints`. Terms at the joint itself are left out of the response to a push. Zeros
    are the forces where the joint leaves no trace, or where the simulation is a record."""
    sizes = [1.0] * len(joints)
    pairs = zip(problem.trials, residuals, strict=True)
    parts = [_condition(problem, model, trial, residual, joints, sizes) for trial, residual in pairs]
    return [
        Located(joint, share([part[i] for part in parts]), tuple(part[i].force for part in parts))
        for i, joint in enumerate(joints)
    ]


def share(parts: Sequence[Inverted]) -> float:
    """Of the residual's energy above the noise, 0 to 1."""
    before, after = sum(one.before for one in parts), sum(max(one.after, 0.0) for one in parts)
    least = SURE * float(np.sqrt(2.0 * sum(one.rows for one in parts)))
    return float(np.clip((before - after) / max(before, least, 1e-300), 0.0, 1.0))


def _condition(
    problem: Problem, model: Model, trial: Trial, residual: np.ndarray, joints: Sequence[Joint], sizes: list[float]
) -> list[Inverted]:
    """Every joint along one condition. sizes: of the push at each, kept up to date."""
    x = evidence(trial, residual, problem.study.simulation.step_size)
    if problem.library is None or problem.study.fmu is None or trial.condition.simulated is not None or not joints:
        return [invert(trial, x, None) for _ in joints]
    workers = min(problem.workers, len(joints))
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(Pushed(problem, trial, joints))) for _ in range(workers)]
        base = opened[0].response(model)
        items: SimpleQueue[Pushed] = SimpleQueue()
        for item in opened:
            items.put(item)

        def one(i: int) -> Inverted:
            item = items.get()
            try:
                without = bare(model, joints[i : i + 1])
                at = base if without is model else item.response(without)
                kernel, sizes[i] = answer(item, without, (joints[i],), at, residual, sizes[i])
            finally:
                items.put(item)
            return invert(trial, x, kernel)

        with ThreadPoolExecutor(workers) as pool:
            return list(pool.map(one, range(len(joints))))


def bare(model: Model, joints: Sequence[Joint]) -> Model:
    """The model without what pushes at the same inputs as these joints; itself where nothing does."""
    inputs = {joint.force for joint in joints}
    pushing = [term for term in model.terms if isinstance(term, ForceTerm) and inputs & {j.force for j in term.joints}]
    return replace(model, terms=tuple(term for term in model.terms if term not in pushing)) if pushing else model


def _means(trial: Trial, y: Float64[np.ndarray, "N J"]) -> Float64[np.ndarray, "J M"]:
    """Means over blocks in units of their noise."""
    size, count = block(trial), len(y) // block(trial)
    sigma = np.where(trial.sigma > 1e-200, trial.sigma, np.inf)  # a channel that shows nothing at all
    means = y[: count * size].reshape(count, size, -1).mean(1) / (sigma / np.sqrt(trial.samples(size)))
    return np.ascontiguousarray(means.T)


def evidence(trial: Trial, residual: Float64[np.ndarray, "N J"], step: float) -> Float64[np.ndarray, "J M"]:
    """A condition's residual as means over blocks, in units of their noise. What the sensors show in the quiet interval, or
    on average, is taken off as far as an offset of theirs may be so large; more is the doing of a force."""
    low, high = (max(round(t / step) - trial.rows.start, 0) for t in trial.condition.quiet or (0.0, 0.0))
    mean = residual[low:high].mean(0) if len(residual[low:high]) >= 64 else residual.mean(0)
    return np.nan_to_num(_means(trial, residual - np.clip(mean, -OFFSET * trial.sigma, OFFSET * trial.sigma)))


def answer(
    item: Pushed, model: Model, joints: tuple[Joint, ...], base: np.ndarray | None, residual: np.ndarray, size: float
) -> tuple[Float64[np.ndarray, "J K"] | None, float]:
    """What a unit of force in one value of the history, at each of `joints`, adds to the means over blocks, from the block
    before that value on; and the size of push that it was taken from. None where the joint leaves no trace. Where it lasts
    (dry friction that holds or slips by chance), it is that of the model without forces.

    base: the response of `model` at all rows. residual: (N, J), for its size alone. A value acts as a
    raised cosine, one block to either side, so that values of all blocks together make a smooth history.
    """
    if base is None:
        return None, size
    trial = item.trial
    natural = 0.01 * (base[trial.rows].std(0) + np.sqrt(np.mean(residual**2, axis=0)))
    natural = np.where(natural > 0.0, natural, 1e300 if natural.any() else 1.0)
    length = block(trial)
    begin, early = (max(1, round(share * (len(residual) // length))) for share in (WHEN, EARLY))
    early += max(int(np.searchsorted(item.times, trial.condition.start)) - trial.rows.start, 0) // length
    shape = np.cos(0.5 * np.pi * np.arange(1 - length, length) / length) ** 2
    for _ in range(TRIES):
        row = trial.rows.start + begin * length
        force = np.zeros(len(item.times))
        force[row + 1 - length : row + length] = size * shape[: len(force) - row - 1 + length]
        item.push = joints, force
        y = item.response(model)
        item.push = None
        change = (np.full_like(base, np.inf) if y is None else y - base)[row - length : trial.rows.stop]
        reached = float((np.abs(change) / natural).max())
        if not 0.01 < reached < 10.0:
            size *= 1e-3 if reached == np.inf else 1e4 if reached < 1e-7 else 1.0 / reached
            continue
        kernel = _means(trial, change) / size
        if lasts(kernel):
            if begin > early:
                begin = early
                continue
            plain = replace(model, terms=tuple(term for term in model.terms if not isinstance(term, ForceTerm)))
            if plain != model:
                return answer(item, plain, joints, item.response(plain), residual, size)
        return kernel, size
    return None, size


ROWS = 4096  # values of the force history a condition, at most; it is smooth between them
DECAYED = 0.02  # share of its largest that the response may still have at the end
FILLS = 12  # how often what lies before and after the measurement is filled with what the force makes of it
MOST = 2  # differences over time, at most, of what a push moves for good: a body without a spring stays or goes on


@dataclass(frozen=True)
class Inverted:
    """force: (N,) N or N.m. before, after: energy of the residual above the noise, in units of the noise's variance, without
    and with the force. rows: values of all channels that it was taken from."""

    force: Float64[np.ndarray, " N"]
    before: float
    after: float
    rows: int


def block(trial: Trial) -> int:
    """Samples from one value of the force history to the next."""
    return max(1, -(-len(trial.measured) // ROWS))


def lasts(kernel: Float64[np.ndarray, "J K"]) -> bool:
    """Whether a response has not ended where it was cut off."""
    return beyond(kernel, 0) > DECAYED


def beyond(kernel: Float64[np.ndarray, "J K"], order: int) -> float:
    """How far the last tenth of a response lies from what it would be if that many differences over time had ended before, as
    a share of its largest: from nothing, from where a body came to rest, from how it went on."""
    tail = max(kernel.shape[1] // 10, 1)
    ended = _differenced(kernel, order)
    ended[:, -tail:] = 0.0
    for _ in range(order):
        ended = np.cumsum(ended, axis=1)
    return float(np.abs(kernel - ended)[:, -tail:].max() / (np.abs(kernel).max() or 1.0))


def invert(trial: Trial, x: Float64[np.ndarray, "J M"], kernel: Float64[np.ndarray, "J K"] | None) -> Inverted:
    """The force history that explains `x`, as evidence() gives it, through `kernel`, as answer() gives it.

    On a ring of time, where that has a closed form a frequency; what is moved for good is differenced over time until it ends,
    and the error with it, whose spectrum is then `noise`; what rings on stays as it is: differences of that do not end, they
    are only small beside those of the push. What comes before and after `x` is filled again and again
    with what the force makes of it (expectation maximisation), and no force acts after the end.
    """
    count = x.shape[1]
    before = float(np.sum(x**2)) - x.size
    peak = 0.0 if kernel is None else float(np.abs(kernel).max())
    if kernel is None or not 0.0 < peak < np.inf:
        return Inverted(np.zeros(len(trial.measured)), before, before, x.size)
    size = 1 << (2 * count + 1).bit_length()
    lasting = [max(beyond(kernel, order), DECAYED) for order in range(MOST + 1)]
    order, noise = lasting.index(min(lasting)), np.ones(size // 2 + 1)
    kernel, y = _differenced(kernel, order), _differenced(x, order)
    for _ in range(order):
        noise = noise * np.abs(1.0 - np.exp(-2j * np.pi * np.arange(len(noise)) / size)) ** 2 + 2.0 / count
    peak = float(np.abs(kernel).max())
    ring = np.zeros((len(x), size))
    ring[:, : kernel.shape[1]] = kernel / peak
    H = np.fft.rfft(np.roll(ring, -1, axis=1))
    q = np.sum(np.abs(H) ** 2, axis=0) / noise
    weights = np.full(len(q), 2.0 * count / size)  # of each frequency in all, were the ring as short as x
    weights[[0, -1]] /= 2.0
    ratio = _ratio(y, H, q, weights, noise)

    back = ratio * np.conj(H) / noise / (1.0 + ratio * q)
    ring, spectrum = _ring(y, size), np.zeros(len(q), dtype=np.complex128)
    for _ in range(FILLS):
        ring[:, :count] = y
        values = np.fft.irfft(np.sum(back * np.fft.rfft(ring), axis=0), size)
        values[count : (count + size) // 2] = 0.0
        spectrum = np.fft.rfft(values)
        ring = np.fft.irfft(H * spectrum, size)
    rest = y - ring[:, :count]
    for _ in range(order):
        rest = np.cumsum(rest, axis=1)
    fitted = float(np.sum(weights * ratio * q / (1.0 + ratio * q)))
    after = float(np.sum(rest**2)) - max(x.size - fitted, 0.0)
    force = _smooth(np.fft.irfft(spectrum, size)[:count] / peak, block(trial), len(trial.measured))
    return Inverted(force, before, after, x.size)


def _differenced(y: Float64[np.ndarray, "J M"], order: int) -> Float64[np.ndarray, "J M"]:
    for _ in range(order):
        y = np.diff(y, prepend=0.0)
    return y.copy()


def _ring(x: Float64[np.ndarray, "J M"], size: int) -> Float64[np.ndarray, "J R"]:
    """x with something smooth behind its end and before its beginning: itself turned about its ends, and faded out."""
    count = x.shape[1]
    reach = min(count - 1, (size - count) // 2)
    fade = np.cos(0.5 * np.pi * np.arange(1, reach + 1) / (reach + 1)) ** 2
    turned = np.pad(x, ((0, 0), (reach, reach)), mode="reflect", reflect_type="odd")
    turned *= np.concatenate([fade[::-1], np.ones(count), fade])
    return np.roll(np.pad(turned, ((0, 0), (0, size - turned.shape[1]))), -reach, axis=1)


def _ratio(
    x: Float64[np.ndarray, "J M"],
    H: Complex128[np.ndarray, "J f"],
    q: np.ndarray,
    weights: np.ndarray,
    noise: np.ndarray,
) -> Float64[np.ndarray, " f"]:
    """Variance of the force over that of the error at each frequency, of highest marginal likelihood: even up to some
    frequency and falling with its square above, as that of a force with jumps does. The error's is at least the noise's."""
    middle = (np.arange(x.shape[1]) + 0.5) / x.shape[1]
    window = np.sin(0.5 * np.pi * np.minimum(20.0 * np.minimum(middle, 1.0 - middle), 1.0)) ** 2
    R = np.fft.rfft(x * window / np.sqrt(np.sum(window**2)), 2 * (len(q) - 1))
    total = float(np.sum(weights * np.sum(np.abs(R) ** 2, axis=0) / noise))
    along = weights * np.abs(np.sum(np.conj(H) * R, axis=0) / noise) ** 2
    place = np.arange(len(q)) / len(q)

    def at(row: tuple[float, float]) -> np.ndarray:
        return np.exp(row[0]) / (1.0 + (place / np.exp(row[1])) ** 2)

    def cost(row: tuple[float, float]) -> float:
        ratio = at(row)
        v = 1.0 + ratio * q
        left = max(total - float(np.sum(along * ratio / v)), 0.0)
        s2 = max(left / x.size, 1.0)
        return float(np.sum(weights * np.log(v))) + x.size * float(np.log(s2)) + left / s2

    levels = np.log(10.0) * np.arange(-6.0, 16.0) - np.log(q.max())
    corners = np.log(2.0) * np.arange(-9.0, 3.0, 2.0)
    best = min(((float(level), float(corner)) for level in levels for corner in corners), key=cost)
    for finer in (0.5, 0.25):
        near = (-finer, 0.0, finer)
        best = min(((best[0] + 2.3 * a, best[1] + 1.4 * b) for a in near for b in near), key=cost)
    return at(best)


def _smooth(values: Float64[np.ndarray, " M"], length: int, rows: int) -> Float64[np.ndarray, " N"]:
    """The history at all rows: raised cosines around the values."""
    place = np.arange(rows) / length
    part = place - np.floor(place)
    return np.interp(place - part + np.sin(0.5 * np.pi * part) ** 2, np.arange(len(values)), values)
