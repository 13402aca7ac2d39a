"""The content of report.json, as its page takes it: SI units unless a unit stands beside, shares of 1, names in quotes by their
place in the study.

A field is called as its key. What a report does not say is nan, "", empty, or None where a type allows it (json_table.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any

from fmucorrect.report.base.json_table import Numbers, read
from fmucorrect.report.base.words import quantity
from fmucorrect.report.discovery.text import OF_FACTOR, at

FARTHER = 1.5
"""By how many times the augmented FMU's own error has to be larger than the one with the sensors' errors to be told."""


@dataclass(frozen=True)
class Study:
    """fmu: its file's name, "" for recorded simulations alone. step_size: s."""

    name: str
    fmu: str
    step_size: float


@dataclass(frozen=True)
class Named:
    """An effect by its name in the catalogue and where it acts: joint, group, channel, input or parameter."""

    effect: str
    joint: str

    @property
    def at(self) -> str:
        """In words."""
        return at(self.effect, self.joint)

    @property
    def key(self) -> tuple[str, str]:
        """By which it is the same as another."""
        return self.effect, self.joint


@dataclass(frozen=True)
class Parameter:
    """A number of a law. std: standard deviation, 0 where it was not estimated. symbol: its letter in the equation."""

    value: float
    std: float
    unit: str
    symbol: str
    meaning: str

    def told(self, std: bool = True) -> str:
        """Value, perhaps ± standard deviation, with its unit; of parameters that are scaled together in %."""
        scale, unit = (100.0, "%") if self.meaning == OF_FACTOR else (1.0, self.unit)
        return quantity(scale * self.value, scale * self.std if std else nan, unit)


@dataclass(frozen=True)
class Change:
    """A parameter of the FMU, in its own unit."""

    before: float
    after: float


@dataclass(frozen=True)
class Varies:
    """The parameter that would have to differ between conditions. share: the standard deviation over it."""

    parameter: str
    share: float


@dataclass(frozen=True)
class Uneven:
    """How a force would have to differ over "displacement" or "velocity". share: the standard deviation of it. factors: by
    which it would be larger at these places, in the unit."""

    over: str
    share: float
    unit: str
    places: Numbers
    factors: Numbers


@dataclass(frozen=True)
class Acting:
    """The force of a law on the measured records, in the unit."""

    rms: float
    peak: float
    unit: str


@dataclass(frozen=True)
class Picture:
    """A force along what a joint goes through, in the order of time. force: what the data ask for there. law: what the law
    gives. t: s. units: of displacement, velocity and force."""

    displacement: Numbers
    velocity: Numbers
    t: Numbers
    force: Numbers
    law: Numbers
    units: Sequence[str]


@dataclass(frozen=True)
class Effect(Named):
    """What was found. parameters: by name, the main one first. equation, latex, modelica, c: the law as text. probability: of
    it at this place, among the sets that were compared; class_probability: with what cannot be told from it.
    changes: by the FMU's parameter."""

    parameters: Mapping[str, Parameter]
    equation: str
    latex: str
    modelica: str
    c: str
    probability: float
    class_probability: float
    indistinguishable_from: Sequence[Named]
    description: str
    changes: Mapping[str, Change]
    varies: Varies | None
    uneven: Uneven | None
    acting: Acting | None
    picture: Picture

    @property
    def moved(self) -> dict[str, str]:
        """`changes` in words, in the unit of the effect's own number."""
        unit = next((item.unit for item in self.parameters.values()), "")
        ends = {name: (pair.before, pair.after) for name, pair in self.changes.items()}
        return {name: " → ".join(quantity(end, unit=unit) for end in pair) for name, pair in ends.items()}


@dataclass(frozen=True)
class Candidate(Named):
    """A set that was compared. members: its effects; empty where it is one. error, held_out_error: NRMSE, %; the latter at
    conditions that were left out of the fit in turn. probability: nan where the search gave it up. behind: the best, in
    -2 log p."""

    members: Sequence[Named]
    error: float
    held_out_error: float
    probability: float
    behind: float


@dataclass(frozen=True)
class Sensor:
    """What a sensor took on. gain: error, share. lag: s. gain_by, lag_by: in standard deviations of what is expected."""

    channel: str
    gain: float
    lag: float
    gain_by: float
    lag_by: float


@dataclass(frozen=True)
class Part:
    """Of a channel or a condition. nrmse, and noise_floor, that of noise alone: %. share: of the disagreement's energy."""

    nrmse: float
    noise_floor: float
    share: float


@dataclass(frozen=True)
class Harmonics:
    """Shares of a condition's residual energy at the excitation's frequency, its odd and its even multiples, and 0 Hz."""

    fundamental: float
    odd: float
    even: float
    offset: float


@dataclass(frozen=True)
class Dependence:
    """Of a condition. amplitude or speed (km/h): of the excitation, whichever it is listed by. residual: rms, in `unit`."""

    condition: str
    amplitude: float
    speed: float
    residual: float
    unit: str


@dataclass(frozen=True)
class Course:
    """The residual's rms along a condition. t: s. unit: the channels', or what each of them is measured by, "noise" or
    "standard deviation"."""

    t: Numbers
    rms: Numbers
    unit: str


@dataclass(frozen=True)
class Where:
    """Where simulation and measurement disagree: shares of the energy of the disagreement by joint (what a free force there
    would explain), channel, band of frequency and order of what turns; the rest by condition. pictures: by joint, where
    nothing is named."""

    joints: Mapping[str, float]
    channels: Mapping[str, Part]
    bands: Mapping[str, float]
    orders: Mapping[str, float]
    conditions: Mapping[str, Part]
    harmonics: Mapping[str, Harmonics]
    amplitude: Sequence[Dependence]
    speed: Sequence[Dependence]
    time: Mapping[str, Course]
    pictures: Mapping[str, Picture]


@dataclass(frozen=True)
class Gap:
    """Of one condition: NRMSE (%) and R2 before and after the change. role: evaluation or development. noise_floor: the NRMSE
    that noise alone makes. nrmse_sensors: NRMSE of the model before the change, seen through the gains and lags of the
    sensors; nan where the report does not say. nrmse_moved: beside a learned force, NRMSE of the model whose parameters alone
    have moved; nan otherwise. nrmse_alone: NRMSE of augmented.fmu alone, without what the sensors took on; nan where it was not
    simulated."""

    condition: str
    role: str
    nrmse_before: float
    nrmse_after: float
    noise_floor: float
    r2_before: float
    r2_after: float
    nrmse_sensors: float
    nrmse_moved: float
    nrmse_alone: float

    @property
    def far(self) -> bool:
        """Whether augmented.fmu is farther from the measurement than what was found, sensors and all."""
        return self.nrmse_alone > FARTHER * self.nrmse_after

    @property
    def sensed(self) -> bool:
        """Whether the sensors' gains and lags alone bring the model closer to the measurement, not what was found."""
        return self.nrmse_before > FARTHER * self.nrmse_sensors

    @property
    def held_out(self) -> bool:
        """Whether nothing was fitted to it."""
        return self.role == "evaluation"


@dataclass(frozen=True)
class Curves:
    """A channel over time, in its unit. before, after: simulated."""

    unit: str
    measured: Numbers
    before: Numbers
    after: Numbers


@dataclass(frozen=True)
class Stretch:
    """Some seconds of a condition. t: s."""

    t: Numbers
    channels: Mapping[str, Curves]


@dataclass(frozen=True)
class Section:
    """A learned force, with one standard deviation, at displacements or velocities."""

    at: Numbers
    force: Numbers
    std: Numbers


@dataclass(frozen=True)
class Sections:
    """displacement: at rest. velocity: in the middle of the travel."""

    displacement: Section
    velocity: Section


@dataclass(frozen=True)
class Learned:
    """A force learned at a joint. closed, closed_in_development: share of the gap above the noise; closed: where it was held
    out, nan where nothing was. rms, peak: of the force. units: of displacement, velocity and force. from: lowest and highest
    displacement, highest speed that it was learned from. remembers: displacement."""

    joint: str
    closed: float
    closed_in_development: float
    rms: float
    peak: float
    units: Sequence[str]
    from_: Numbers
    remembers: float
    gap: Sequence[Gap]
    sections: Sections
    picture: Picture


@dataclass(frozen=True)
class Repetition:
    """A measured condition once more. like: its name. scale: of the excitation. speed: km/h, nan for the condition's own."""

    like: str
    scale: float
    speed: float


@dataclass(frozen=True)
class NextTest:
    """The measurement that would decide. confidence: in words."""

    text: str
    conditions: Sequence[Repetition]
    separates: Sequence[Named]
    confidence: str


@dataclass(frozen=True)
class Cost:
    """runs of the FMU, and seconds that they simulated. told_by_response: runs that its linear response stood in for."""

    runs: float
    seconds: float
    told_by_response: float


@dataclass(frozen=True)
class Discovery:
    """verdict: named, ambiguous, none or unexplained. suspects: what came nearest where nothing is named. adjusted,
    adjusted_from, adjusted_by, adjusted_std: parameters that moved: value after, before, by how many tolerances, standard
    deviation of the value. cautions: what the verdict hangs on. series: by condition. unexplained: share of the residual's
    energy. not_named: why what came nearest has no name though it leaves little. warnings: as Finding.to_json has them.
    time_limit, stages: s. complete: whether the search came to its end, which one before there was a time limit always did.
    """

    verdict: str
    sentence: str
    study: Study | None
    time_limit: float
    not_looked_at: Sequence[str]
    effects: Sequence[Effect]
    suspects: Sequence[Effect]
    adjusted: Mapping[str, float]
    adjusted_from: Mapping[str, float]
    adjusted_by: Mapping[str, float]
    adjusted_std: Mapping[str, float]
    sensors: Sequence[Sensor]
    cautions: Sequence[str]
    candidates: Sequence[Candidate]
    learned: Learned | None
    where: Where
    gap: Sequence[Gap]
    series: Mapping[str, Stretch]
    unexplained: float
    next_test: NextTest | None
    notes: Sequence[str]
    warnings: Sequence[Mapping[str, str]]
    cost: Cost
    files: Sequence[str]
    stages: Mapping[str, float]
    complete: bool = True
    not_named: str = ""

    @classmethod
    def read(cls, report: Any) -> Discovery:
        """report.json. ValueError, with the key, for what is none."""
        found = read(cls, report, "report.json")
        if report.get("verdict") is None:
            raise ValueError("report.json: expected the report of a discovery, got no verdict")
        return found

    @property
    def found(self) -> bool:
        """Whether effects have been named."""
        return bool(self.effects) and self.verdict in ("named", "ambiguous")

    @property
    def has_learned(self) -> bool:
        """Whether augmented.fmu has a learned force in it."""
        return self.learned is not None and "augmented.fmu" in self.files

    @property
    def fmu(self) -> str:
        """The name of the study's FMU; "" where there is none."""
        return self.study.fmu if self.study else ""
