"""Effects at signals: what a sensor does to the response that it shows, what an actuator does to its command."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue.law import Parameter, complete, opposite, starts

Samples = Float64[np.ndarray, "... T"]
"""At equal steps, in time along the last axis."""

Values = Mapping[str, float]

MARKS = (0.01, 0.05, 0.2)
"""Severities: the signature that an effect leaves, rms, as a share of the signal's own variation."""


@dataclass(frozen=True)
class Extent:
    """How large a signal is, in its unit. rms: of its variation about its mean. spread: largest less smallest value.
    peak: largest size. slope: rms of its rate, unit/s. seconds: how long it lasts."""

    rms: float
    spread: float
    peak: float
    slope: float
    seconds: float


def extent(y: Samples, step: float) -> Extent:
    """Of samples (T,) every `step` s, two at least."""
    return Extent(
        float(np.std(y)),
        float(np.ptp(y)),
        float(np.abs(y).max()),
        float(np.sqrt(np.mean((np.diff(y) / step) ** 2))),
        step * (y.shape[-1] - 1),
    )


def unit(template: str, channel: str) -> str:
    """The unit that `template` means at a signal: U stands for the signal's own."""
    return template.replace("U", channel)


@dataclass(frozen=True, kw_only=True)
class SignalLaw:
    """One effect at a signal, or one of its forms. name, form, parameters, description, equation, note, main, estimated,
    signed: as in Law; units of parameters with U for the signal's own. `equation` in s, what is shown (e, what acts), y,
    what is there (u, what is asked for), and t, s since the beginning of the record.

    at: "sensor" or "excitation". change: see `apply`. guesses: numbers that leave a signature (rms) of a share of the signal's
    variation, for each of `severities`.
    """

    name: str
    description: str
    equation: str
    change: Callable[[Samples, float, Values], Samples]
    guesses: tuple[Callable[[Extent, float], Values | None], ...]
    at: str = "sensor"
    form: str = ""
    parameters: tuple[Parameter, ...] = ()
    main: str = ""
    estimated: tuple[str, ...] = ()
    severities: tuple[float, ...] = MARKS
    signed: bool = False
    note: str = ""

    @property
    def label(self) -> str:
        """Name and form, an identifier."""
        return f"{self.name}_{self.form}" if self.form else self.name

    @property
    def neutral(self) -> Values | None:
        """With what it changes nothing (infinity for a limit); None where it always does."""
        values = {p.name: p.neutral for p in self.parameters if p.neutral is not None}
        return values if values else None

    def apply(self, y: Samples, step: float, values: Values) -> Samples:
        """What is shown in place of `y` (T,), samples every `step` s. values: all parameters."""
        return self.change(y, step, values)

    def complete(self, values: Values) -> dict[str, float]:
        """`values` in the order of `parameters`. Raises WrapError with everything that is wrong with them."""
        return complete(self.parameters, values, self.name)

    def starts(self, size: Extent, severity: float) -> tuple[dict[str, float], ...]:
        """All its numbers at a severity, one set for each shape; none where the signal gives no scale."""
        return starts(self.parameters, self.guesses, size, severity)

    def opposite(self, values: Values) -> dict[str, float]:
        """The numbers with which it acts the other way round. Only where `signed`."""
        assert self.signed, f"{self.label} has no opposite"
        return opposite(self.parameters, self.main, values)


def later(y: Samples, step: float, lag: float) -> Samples:
    """y(t - lag), cubic between samples (Catmull and Rom, 1974), held at both ends."""
    n = y.shape[-1]
    place = np.clip(np.arange(n) - lag / step, 0.0, n - 1.0)
    i = np.minimum(place.astype(np.int64), max(n - 2, 0))
    x = place - i
    before, here, after, beyond = (y[..., np.clip(i + k, 0, n - 1)] for k in (-1, 0, 1, 2))
    rise, end = (after - before) / 2, (beyond - here) / 2
    return here + x * (rise + x * (3 * (after - here) - 2 * rise - end + x * (2 * (here - after) + rise + end)))


def lowpass(y: Samples, step: float, cutoff: float) -> Samples:
    """The first-order filter of corner `cutoff` Hz, exact for a signal that is straight between samples; at rest first."""
    from scipy.signal import lfilter  # takes a second to import, of what the whole program else takes a third

    x = 2.0 * math.pi * cutoff * step
    mean = -math.expm1(-x) / x  # of exp(-t) over the step
    new, old = 1.0 - mean, mean - math.exp(-x)
    return lfilter([new, old], [1.0, -math.exp(-x)], y, zi=(1.0 - new) * y[..., :1])[0]


def _times(y: Samples, step: float) -> Samples:
    return step * np.arange(y.shape[-1])


_GAIN = Parameter("gain", "g", "1", "shown over true", minimum=0.0, above=True, neutral=1.0)
_LAG = Parameter("lag", "T", "s", "how much too late; below 0 too early", neutral=0.0)


def _gain(y: Samples, step: float, values: Values) -> Samples:
    return values["gain"] * y


def _lag(y: Samples, step: float, values: Values) -> Samples:
    return later(y, step, values["lag"])


def _follow(y: Samples, step: float, values: Values) -> Samples:
    T = values["time_constant"]
    return lowpass(y, step, 1.0 / (2.0 * math.pi * T)) if T > 0.0 else y.copy()


def _guess_gain(size: Extent, share: float) -> Values:
    return {"gain": 1.0 + share}


def _guess_lag(size: Extent, share: float) -> Values:
    return {"lag": share * size.rms / size.slope}


_LAWS = (
    SignalLaw(
        name="sensor_gain",
        description="The sensor shows the motion too large or too small by a constant factor.",
        equation="s = g y",
        parameters=(_GAIN,),
        change=_gain,
        guesses=(_guess_gain,),
        main="gain",
        estimated=("gain",),
        signed=True,
    ),
    SignalLaw(
        name="sensor_lag",
        description="The sensor shows the motion too late by a constant time.",
        equation="s = y(t - T)",
        parameters=(_LAG,),
        change=_lag,
        guesses=(_guess_lag,),
        main="lag",
        estimated=("lag",),
        signed=True,
        note="Held at its first value before the record begins.",
    ),
    SignalLaw(
        name="sensor_offset",
        description="The sensor is off by a constant value.",
        equation="s = y + b",
        parameters=(Parameter("offset", "b", "U", "shown less true", neutral=0.0),),
        change=lambda y, step, values: y + values["offset"],
        guesses=(lambda size, share: {"offset": share * size.rms},),
        main="offset",
        estimated=("offset",),
        signed=True,
    ),
    SignalLaw(
        name="sensor_drift",
        form="gain",
        description="The sensor's gain changes steadily with time.",
        equation="s = (1 + r t) y",
        parameters=(Parameter("rate", "r", "1/s", "change of gain", neutral=0.0),),
        change=lambda y, step, values: (1.0 + values["rate"] * _times(y, step)) * y,
        guesses=(lambda size, share: {"rate": math.sqrt(3.0) * share / size.seconds},),
        main="rate",
        estimated=("rate",),
        signed=True,
    ),
    SignalLaw(
        name="sensor_drift",
        form="offset",
        description="The sensor's zero moves steadily with time.",
        equation="s = y + r t",
        parameters=(Parameter("offset_rate", "r", "U/s", "change of zero", neutral=0.0),),
        change=lambda y, step, values: y + values["offset_rate"] * _times(y, step),
        guesses=(lambda size, share: {"offset_rate": math.sqrt(3.0) * share * size.rms / size.seconds},),
        main="offset_rate",
        estimated=("offset_rate",),
        signed=True,
    ),
    SignalLaw(
        name="sensor_lowpass",
        description="The sensor, or a filter behind it, smooths fast motion away.",
        equation="ds/dt = 2 pi f_c (y - s)",
        parameters=(Parameter("cutoff", "f_c", "Hz", "where 0.71 is left", minimum=0.0, above=True, neutral=math.inf),),
        change=lambda y, step, values: lowpass(y, step, values["cutoff"]),
        guesses=(lambda size, share: {"cutoff": size.slope / (2.0 * math.pi * share * size.rms)},),
        main="cutoff",
        estimated=("cutoff",),
        note="Of first order. Far above all motion it is a lag of 1 / (2 pi f_c).",
    ),
    SignalLaw(
        name="sensor_saturation",
        description="The sensor shows nothing beyond a limit.",
        equation="s = clip(y, -y_m, y_m)",
        parameters=(Parameter("limit", "y_m", "U", "to each side", minimum=0.0, above=True, neutral=math.inf),),
        change=lambda y, step, values: np.clip(y, -values["limit"], values["limit"]),
        guesses=(lambda size, share: {"limit": share * size.peak},),
        main="limit",
        estimated=("limit",),
        severities=(0.95, 0.8, 0.5),
        note="Its severities are shares of the peak.",
    ),
    SignalLaw(
        name="sensor_rectification",
        description="The sensor shows the size of the motion without its sign.",
        equation="s = |y|",
        change=lambda y, step, values: np.abs(y),
        guesses=(lambda size, share: {},),
        severities=(1.0,),
    ),
    SignalLaw(
        name="excitation_gain",
        at="excitation",
        description="The excitation acts too strongly or too weakly by a constant factor.",
        equation="e = g u",
        parameters=(_GAIN,),
        change=_gain,
        guesses=(_guess_gain,),
        main="gain",
        estimated=("gain",),
        signed=True,
    ),
    SignalLaw(
        name="excitation_lag",
        at="excitation",
        description="The excitation acts too late by a constant time; sensors that are all late by it show the same.",
        equation="e = u(t - T)",
        parameters=(_LAG,),
        change=_lag,
        guesses=(_guess_lag,),
        main="lag",
        estimated=("lag",),
        signed=True,
    ),
    SignalLaw(
        name="excitation_lag",
        form="first_order",
        at="excitation",
        description="The excitation follows what is asked for as a first-order system: too late, and smaller the faster it is.",
        equation="de/dt = (u - e) / T",
        parameters=(Parameter("time_constant", "T", "s", "its lag in slow motion", minimum=0.0, neutral=0.0),),
        change=_follow,
        guesses=(lambda size, share: {"time_constant": share * size.rms / size.slope},),
        main="time_constant",
        estimated=("time_constant",),
        note="A servo drive's or a platform's bandwidth of f Hz is T = 1 / (2 pi f).",
    ),
)

SIGNALS: Mapping[str, tuple[SignalLaw, ...]] = MappingProxyType(
    {name: tuple(law for law in _LAWS if law.name == name) for name in dict.fromkeys(law.name for law in _LAWS)}
)
"""Effect name -> its forms."""
