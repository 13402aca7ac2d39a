"""A draft as the text of a study: its values, and behind each guess why it was made."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from fmucorrect.drafting.driving import Driving
from fmucorrect.drafting.guess import as_well
from fmucorrect.drafting.joints import JointGuess
from fmucorrect.drafting.pairing import ChannelGuess
from fmucorrect.drafting.parameters import MOST, ParameterGuess, other_parameters
from fmucorrect.effects import toml
from fmucorrect.errors import few, one_line
from fmucorrect.fmu import FmuDescription
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, TOLD, Reading

SHOWN_STARTS = 12
"""Start values that a comment lists; of a whole vehicle's hundred it shows some."""


@dataclass(frozen=True)
class DraftedRun:
    """A log, the simulated record that belongs to it, its role, what the others have and it has not (or not readably, with
    the reason), its clock in the study with the reason, "" for none, the units that another log says and it does not, s at
    its beginning in which nothing moves, 0 where that is not known, and whether it begins in motion."""

    path: Path
    simulated: Path | None
    role: str
    missing: tuple[str, ...]
    clock: str
    units: Mapping[str, str]
    quiet: float
    in_motion: bool = False


@dataclass(frozen=True)
class Draft:
    """A drafted study: `text` writes it, each guess with its reason.

    units: of variables that the FMU leaves without one. unsaid: inputs whose columns say no unit and are taken in the
    FMU's, with that. unpaired: columns that show no output, in words. left_out: what a log holds that is no column, in
    words. reading: what was told of the logs. filled: why `repair` is asked for, a log each, empty where it is not, or was
    by the user. starts: variables with start values that may be free. stand_ins: numbers in logs that look like lost
    samples, in words. spelled: columns whose unit nothing but their name says."""

    model: FmuDescription
    step_ns: int
    why_step: str
    driving: Driving
    channels: tuple[ChannelGuess, ...]
    joints: tuple[JointGuess, ...]
    parameters: tuple[ParameterGuess, ...]
    runs: tuple[DraftedRun, ...]
    units: Mapping[str, str]
    unpaired: tuple[str, ...]
    left_out: tuple[str, ...]
    reading: Reading = AS_IT_IS
    filled: tuple[str, ...] = ()
    starts: tuple[str, ...] = ()
    stand_ins: tuple[str, ...] = ()
    unsaid: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    spelled: frozenset[str] = frozenset()

    def text(self, path: Path) -> str:
        """The study file, to be written to `path`: file names are relative to it."""
        return "\n".join(self._lines(path.resolve().parent)) + "\n"

    def _lines(self, folder: Path) -> Iterator[str]:
        yield "# Drafted by `fmucorrect new`. What follows `# guess:` was not said by any file: look at it."
        yield "format = 1"
        yield f"name = {toml(self.model.name)}"
        yield ""
        yield "[simulation]"
        yield f"fmu = {toml(_relative(self.model.path, folder))}"
        yield f"step_size = {self.step_ns / NANOSECONDS!r}  # guess: {self.why_step}"
        if self.units:
            shares = [name for name, unit in self.units.items() if unit in ("1", "%")]
            how = "counts to 1, unless description, bounds or fit say 100"
            of = f"; the log's % is a share, and {one_line(few(shares))} {how}" * bool(shares)
            yield f"units = {toml(self.units)}  # guess: the FMU says none; SI, unless sizes say otherwise{of}"
        yield from self._records()
        for guess in self.channels:
            yield from self._channel(guess)
        for joint in self.joints:
            yield from self._joint(joint)
        if not self.joints:
            given = few([v.name for v in self.model.of("input")]) or "none"
            yield ""
            yield "# no [[joints]]: no input is known to push at a displacement that it shows, so that discovery can name"
            yield f"# parameters and sensors alone. Its inputs: {one_line(given)}"
        for parameter in self.parameters:
            yield ""
            yield "[[adjustable]]"
            yield f"parameter = {toml(parameter.name)}  # guess: {parameter.why}; it is {parameter.start:g}"
            yield f"minimum = {parameter.minimum!r}"
            yield f"maximum = {parameter.maximum!r}"
            yield f"tolerance = {parameter.tolerance}  # guess: write how well you know it"
        others = other_parameters(self.model, self.parameters)
        if others:
            yield ""
            yield f"# not among the adjustable: {one_line(', '.join(others[:MOST]))}{', ...' * (len(others) > MOST)}"
            yield "# what is not listed is taken for exact: add an [[adjustable]] where it is not"
        yield from self._conditions(folder)
        if self.unpaired:
            yield ""
            yield from (f"# used for nothing: column {one_line(text)}" for text in self.unpaired[:50])
        yield from (f"# left out: {one_line(text)}" for text in self.left_out)
        yield from (f"# {one_line(text)}" for text in self.stand_ins)

    def _records(self) -> Iterator[str]:
        guesses = (*self.driving.inputs, *self.channels)
        unsaid = {guess.column: guess.column_unit for guess in guesses if guess.column_unit}
        renamed = [guess for guess in self.driving.inputs if guess.variable != guess.column]
        keys = (*TOLD, "repair")
        told = {key: value for key in keys if (value := getattr(self.reading, key))}
        if unsaid or told:
            yield ""
            yield "[records]"
            for key, value in told.items():
                why = f"  # guess: {one_line('; '.join(self.filled))}" if key == "repair" and self.filled else ""
                yield f"{key} = {toml(value)}{why}"
        if unsaid:
            named, sized = ([column for column in unsaid if (column in self.spelled) == by] for by in (True, False))
            why = ["what their names spell"] * bool(named) + ["what makes simulated and measured of one size"] * bool(
                sized
            )
            of = f" ({one_line(few(sized))})" * bool(named and sized)
            yield f"units = {toml(unsaid)}  # guess: the logs say none; {', '.join(why)}{of}"
        if renamed:
            yield ""
            yield "[records.columns]"
        for guess in renamed:
            yield f"{toml(guess.variable)} = {toml(guess.column)}  # guess: {one_line(guess.why)}"
        if self.unsaid:
            taken = ", ".join(f"{name} in {unit}" for name, unit in self.unsaid.items())
            yield f"# guess: the logs say no unit of what drives the FMU, and it is taken in the FMU's own: {one_line(taken)}"
        if self.driving.inputs and all(guess.sign < 0 for guess in self.channels):
            yield "# every channel has measurement_sign = -1: it may as well be what drives the model that counts the other way"
        if self.driving.untried:
            yield f"# {self.driving.untried} further pairs of a column and an input were not tried: too many"

    def _channel(self, guess: ChannelGuess) -> Iterator[str]:
        named = f"alike names ({guess.alike:.2f})" if guess.alike > 0.5 else "no likeness of the names"
        yield ""
        yield "[[channels]]"
        yield f"name = {toml(guess.output)}"
        yield f"simulation = {toml(guess.output)}"
        rivals = f"; as likely: {one_line(few(guess.rivals))}" if guess.rivals else ""
        twins = one_line(as_well(guess.twins))
        yield f"measurement = {toml(guess.column)}  # guess: {named}, {guess.why}{rivals}{twins}"
        yield f'quantity = "{guess.quantity}"'
        said = "  # guess: nobody says one" if guess.column_unit and guess.variable_unit else ""
        yield f"unit = {toml(guess.unit)}{said}"
        if guess.sign < 0 or guess.heard:
            yield f"measurement_sign = {guess.sign}  # guess: by the correlation{', which is weak' * guess.heard}"

    def _joint(self, joint: JointGuess) -> Iterator[str]:
        yield ""
        yield "[[joints]]"
        yield f"name = {toml(joint.name)}"
        yield f"force = {toml(joint.force)}{'  # guess: nobody says that it is one' * joint.untold}"
        same = [
            one_line(other.name) for other in self.joints if other != joint and other.displacement == joint.displacement
        ]
        also = f", as at {' and '.join(same)}: one of them moves otherwise, or they are one joint" if same else ""
        told = ", with the square of the time, though nobody says that it is one" * joint.by_push
        yield f"displacement = {toml(joint.displacement)}  # guess: it gives way when the force pushes{told}{also}"
        for key in ("velocity", "nominal_force", "acceleration"):
            if name := getattr(joint, key):
                own = ": the spring's and damper's own there, not a drive's" if key == "nominal_force" else ""
                unit = " and unit" if self.model.variables[name].unit else ""
                of = "displacement" if key == "velocity" else "velocity"
                why = f"the time derivative of the {of} in a run" if key in joint.by_rate else f"by its name{unit}{own}"
                yield f"{key} = {toml(name)}  # guess: {why}"
        yield f"sign = {joint.sign}  # found by one push"

    def _conditions(self, folder: Path) -> Iterator[str]:
        speeds = [v for v in self.model.of("parameter") if v.unit in ("m/s", "km/h") or "speed" in v.name.lower()]
        if speeds:
            named = ", ".join(f"{v.name} = {v.start or '...'}" for v in speeds[:4])
            yield ""
            yield f"# the FMU has parameters that a run may set: parameters = {{ {one_line(named)} }} in its condition"
        names: dict[str, int] = {}
        for run in self.runs:
            names[run.path.stem] = names.get(run.path.stem, 0) + 1
            number = names[run.path.stem]
            yield ""
            yield "[[conditions]]"
            yield f"name = {toml(run.path.stem + (f' {number}' if number > 1 else ''))}"
            held = "  # guess: it is named so, or the last, and is held out, so that something proves what is found"
            yield f'role = "{run.role}"{held if run.role == "evaluation" else ""}'
            if self.driving.inputs:
                yield f"inputs = {toml(_relative(run.path, folder))}"
            yield f"measurement = {toml(_relative(run.path, folder))}"
            if run.simulated is not None:
                yield f"simulated = {toml(_relative(run.simulated, folder))}"
            if run.clock or run.units:
                value, _, reason = run.clock.partition("  # guess: ")
                entries = [f"clock = {value}"] * bool(value) + [f"units = {toml(run.units)}"] * bool(run.units)
                reasons = [reason] * bool(value) + ["it says no units: as another log does"] * bool(run.units)
                yield f"records = {{ {', '.join(entries)} }}  # guess: {'; '.join(reasons)}"
            if run.quiet:
                yield f"quiet = [0.0, {run.quiet:.3f}]  # guess: nothing moves there"
            if run.in_motion and self.starts:
                named = few(self.starts) if len(self.starts) > SHOWN_STARTS else ", ".join(map(toml, self.starts))
                yield f"# it begins in motion; those of these start values that nobody knows: free = [{one_line(named)}]"
            if run.missing:
                yield f"# it lacks {one_line(', '.join(run.missing))}"


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.resolve(), folder)).as_posix()
    except ValueError:  # another drive
        return path.resolve().as_posix()
