"""What simulated and measured signals alone can say: each channel's residual as a short sum of shapes of its response.

For studies without an FMU to run: where and what shape, held out and with its doubt, no effect at a joint. Terms are
chosen forward by BIC (extended by the number of shapes tried; only independent samples count), and a term stays only
where it also lowers the error of conditions that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from fmucorrect import metrics
from fmucorrect.discovery.orders import one_tone
from fmucorrect.discovery.selection import Columns, Fit, select
from fmucorrect.discovery.where import Residual
from fmucorrect.errors import SignalError
from fmucorrect.signals import Channel

Series = Float64[np.ndarray, " T"]

ROUNDS = 6
"""Of shifting the response in time until a lag is exact."""

ONE_TONE = "the response is nearly one tone: gain and lag stand for any linear difference at that frequency"
NO_SENSOR = "too different for lag and shapes of the response to mean anything: this asks for a model"

_SHAPES: Mapping[str, tuple[str, str]] = {  # unit ({u}: the channel's, {d}: the displacement's), words
    "gain": ("1", "it is {value:.4g} times the simulation"),
    "offset": ("{u}", "it stands {value:.3g} {unit} off"),
    "lag": ("s", "it comes {size:.3g} s {side}"),
    "rate": ("s", "a part grows with the velocity, {value:.3g} s of it"),
    "drift": ("{u}/s", "it drifts by {value:.3g} {unit}"),
    "clock": ("1", "it comes {side} and {side}, by {size:.3g} s a second"),
    "cubic": ("1/{u}2", "a part grows with the third power of the response"),
    "rectification": ("1", "its two directions differ: a part follows the response's magnitude"),
    "quadratic": ("1/{u}", "a part grows with the response squared, with its sign"),
    "hysteresis": ("{u}", "a part of {value:.3g} {unit} follows the velocity's sign, as dry friction can leave it"),
    "saturation": ("{u}", "beyond {value:.3g} {unit} it follows the simulation by {kept:.2f}, not {whole:.2f}"),
}
_FORCES: Mapping[str, tuple[str, str]] = {
    "preload": ("{u}", "it stands {value:.3g} {unit} off"),
    "stiffness": ("{u}/{d}", "a part grows with the displacement, {value:.4g} {unit}"),
    "damping": ("{u}.s/{d}", "a part grows with the velocity, {value:.4g} {unit}"),
    "cubic": ("{u}/{d}3", "a part grows with the displacement's third power"),
    "rectification": ("{u}/{d}", "its two directions differ: a part follows the displacement's magnitude"),
    "quadratic": ("{u}.s2/{d}2", "a part grows with the velocity squared, with its sign"),
    "friction": ("{u}", "a part of {value:.3g} {unit} follows the velocity's sign"),
    "stop": ("{d}", "beyond {value:.3g} {unit} it grows by a further {slope:.4g} {u}/{d}"),
}


@dataclass(frozen=True)
class Term:
    """One shape. words: what it says. value, std: in unit. share: of the channel's residual energy, lost without it."""

    name: str
    words: str
    value: float
    std: float
    unit: str
    share: float


@dataclass(frozen=True)
class OutputMap:
    """Of one channel. held_out: NRMSE in % before and after by condition, the map fitted to the others (to the other
    quarters where there is one condition only), None where the measurement does not vary. explained: share of the
    residual's energy above the noise, held out. doubt: what the data cannot tell."""

    channel: str
    terms: tuple[Term, ...]
    held_out: Mapping[str, tuple[float | None, float | None]]
    explained: float
    doubt: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """For the report's notes."""
        if not self.terms:
            return f"{self.channel}: no shape of the response explains the residual."
        words = "; ".join(term.words for term in self.terms)
        return f"{self.channel}: {words}. This takes away {self.explained:.0%} of the residual's energy, held out."

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {**asdict(self), "held_out": {name: list(pair) for name, pair in self.held_out.items()}}


def output_maps(
    residuals: Sequence[Residual], channels: Sequence[Channel], moves: Sequence[Series] = (), unit: str = ""
) -> list[OutputMap]:
    """One map a channel, of its own simulated response; [] where there is no residual. moves: the displacement that is
    prescribed, where there is one (in `unit`), a series a condition: forces are told by it."""
    if not residuals:
        return []
    return [
        force_map(residuals, channel, j, moves, unit)
        if moves and channel.quantity == "force"
        else _channel_map(residuals, j, channel)
        for j, channel in enumerate(channels)
    ]


def force_map(
    residuals: Sequence[Residual],
    channel: Channel,
    column: int,
    displacements: Sequence[Series],
    unit: str,
    velocities: Sequence[Series] = (),
) -> OutputMap:
    """Where `channel` (a `column` of the residuals) is a force and the motion is prescribed: the force that is missing,
    by displacement (in `unit`) and velocity (unit/s; differentiated where not given), a series a condition.

    Raises SignalError where there is no residual or a series does not fit its condition.
    """
    shapes = [item.t.shape for item in residuals]
    if not residuals or any(
        [d.shape for d in given] != shapes for given in (displacements, velocities or displacements)
    ):
        raise SignalError(
            "displacements or velocities do not fit the conditions",
            expected=[len(item.t) for item in residuals] or "one or more conditions",
            got=[len(d) for d in displacements],
        )
    moves = velocities or [np.gradient(d, item.step) for item, d in zip(residuals, displacements, strict=True)]
    columns: Columns = {
        "preload": [np.ones_like(d) for d in displacements],
        "stiffness": [*displacements],
        "damping": [*moves],
        "cubic": [d**3 for d in displacements],
        "rectification": [np.abs(d) for d in displacements],
        "quadratic": [v * np.abs(v) for v in moves],
        "friction": _signs(moves),
    }

    def stop(limit: float) -> list[np.ndarray]:
        return [d - d.clip(-limit, limit) for d in displacements]

    fit = select(columns, [item.values[:, column] for item in residuals], "stop", stop, _largest(displacements))
    return _finished(channel, column, _terms(fit, _FORCES, channel.unit, unit), fit, residuals, ())


def _channel_map(residuals: Sequence[Residual], j: int, channel: Channel) -> OutputMap:
    from scipy.interpolate import CubicSpline

    splines = [CubicSpline(item.t, item.response[:, j]) for item in residuals]
    since = [item.t - item.t[0] for item in residuals]
    doubt = (ONE_TONE,) if all(one_tone(item.response[:, j]) for item in residuals) else ()

    def fitted(lag: float, clock: float, gain: float, like: bool = True) -> tuple[Fit, float]:
        """The fit about a lag and a clock's error, and the longest lag that is one: an eighth of the typical period.

        like: whether the two are enough alike for more than a linear map.
        """
        late = [
            (item.t - lag - clock * s).clip(item.t[0], item.t[-1]) for item, s in zip(residuals, since, strict=True)
        ]
        y = [np.asarray(spline(t)) for spline, t in zip(splines, late, strict=True)]
        dy = [np.asarray(spline(t, 1)) for spline, t in zip(splines, late, strict=True)]
        columns: Columns = {"gain": y, "offset": [np.ones_like(part) for part in y], "drift": since}
        if like:
            columns["lag"] = [-part for part in dy]
            columns["clock"] = [-s * part for s, part in zip(since, dy, strict=True)]
            columns["cubic"] = [part**3 for part in y]
            columns["rectification"] = [np.abs(part) for part in y]
            columns["quadratic"] = [part * np.abs(part) for part in y]
            columns["hysteresis"] = _signs(dy)
        else:
            columns["rate"] = dy

        def saturation(limit: float) -> list[np.ndarray]:
            return [part.clip(-limit, limit) - part for part in y] if like else [0.0 * part for part in y]

        # what the shift took away is put back in linear form, so that lag and clock keep their whole coefficients
        target = [
            item.measured[:, j] - part - gain * (lag + clock * s) * slope
            for item, part, slope, s in zip(residuals, y, dy, since, strict=True)
        ]
        fit = select(columns, target, "saturation", saturation, _largest(y))
        return fit, 0.25 * np.pi * _rms(y) / max(_rms(dy), np.finfo(float).tiny)

    lag = clock = 0.0
    fit, longest = fitted(lag, clock, 1.0)
    for _ in range(ROUNDS):
        gain, before = 1.0 + fit.coefficients.get("gain", 0.0), (lag, clock)
        lag, clock = (fit.coefficients.get(name, 0.0) / max(gain, 0.1) for name in ("lag", "clock"))
        if gain < 0.2 or abs(lag) + abs(clock) * max(float(s[-1]) for s in since) > longest:
            fit, _ = fitted(0.0, 0.0, 1.0, like=False)
            doubt = (*doubt, NO_SENSOR)
            break
        changes = zip(("lag", "clock"), before, (lag, clock), strict=True)
        if all(abs(new - old) <= 0.01 * fit.std.get(name, 0.0) for name, old, new in changes):
            break
        fit, longest = fitted(lag, clock, gain)
    return _finished(channel, j, _terms(fit, _SHAPES, channel.unit, ""), fit, residuals, doubt)


def _signs(velocities: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Smooth below 2 % of the rms velocity, where a sign means little."""
    slow = max(0.02 * _rms(velocities), np.finfo(float).tiny)
    return [np.tanh(v / slow) for v in velocities]


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _largest(parts: Sequence[np.ndarray]) -> float:
    return max(float(np.abs(part).max()) for part in parts)


def _terms(fit: Fit, shapes: Mapping[str, tuple[str, str]], u: str, d: str) -> tuple[Term, ...]:
    whole = 1.0 + fit.coefficients.get("gain", 0.0)
    terms: list[Term] = []
    for name, coefficient in fit.coefficients.items():
        unit = shapes[name][0].format(u=u, d=d)
        value, std = coefficient, fit.std[name]
        if name == "gain":
            value = whole
        elif name in ("lag", "clock"):
            value, std = coefficient / whole, std / abs(whole)
        elif name in ("saturation", "stop"):
            value, std = fit.limit, fit.limit_std
        kept = round(whole - coefficient, 2) + 0.0
        side, size = "later" if value > 0.0 else "earlier", abs(value)
        said = {"value": value, "unit": unit, "kept": kept, "whole": whole, "slope": coefficient, "u": u, "d": d}
        words = shapes[name][1].format(side=side, size=size, **said)
        terms.append(Term(name, words, value, std, unit, fit.share[name]))
    return tuple(sorted(terms, key=lambda term: -term.share))


def _finished(
    channel: Channel, j: int, terms: tuple[Term, ...], fit: Fit, residuals: Sequence[Residual], doubt: tuple[str, ...]
) -> OutputMap:
    held_out: dict[str, tuple[float | None, float | None]] = {}
    before = after = 0.0
    for item, left in zip(residuals, fit.left, strict=True):
        measured, response = item.measured[:, [j]], item.response[:, [j]]
        noise = len(left) * float(np.nan_to_num(item.sigma[j])) ** 2
        before += float(((measured - response) ** 2).sum()) - noise
        after += float((left**2).sum()) - noise
        held_out[item.condition.name] = (None, None)
        if np.ptp(measured) > 0.0:
            pair = [metrics.score(values, measured).mean_nrmse for values in (response, measured - left[:, None])]
            held_out[item.condition.name] = (pair[0], pair[1])
    explained = float(np.clip(1.0 - after / before, 0.0, 1.0)) if terms and before > 0.0 else 0.0
    single = [
        f"only condition {residuals[g].condition.name!r} shows the {name}: it cannot be held out"
        for name, g in fit.alone.items()
    ]
    return OutputMap(channel.name, terms, held_out, explained, (*doubt, *single) if terms else ())
