"""Makes one case from its specification: study, inputs and measured records in a folder, the label elsewhere."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import identities
import numpy as np
from bench import OSCILLATOR, Bench, Run, bench
from hidden import KINDS, OUTSIDE, Numbers
from marks import base_sensitivities, listed, mark, motion, parameters_of, rows, share
from physical import Placed, actual, late, simulate
from specs import Spec, Wanted
from writing import write_case

SEEN = 5.0
"""Marks below this many standard deviations of the noise count as none. One more parameter pays, by BIC over 1e5
samples, where its mark squared is above ln 1e5 = 11.5, and chance finds 2 ln 100 = 9 among a hundred shapes."""


@dataclass(frozen=True)
class Made:
    """A case with all of its numbers. parameters: of the physical side, over the study's. noise: mm, a channel."""

    spec: Spec
    bench: Bench
    parameters: dict[str, float]
    effects: tuple[Placed, ...]
    noise: np.ndarray
    label: dict


def seed_of(name: str) -> int:
    return zlib.crc32(name.encode())


def make(spec: Spec) -> Made:
    """All numbers of a case. Raises ArithmeticError where no severity is stable."""
    on = bench(spec.bench)
    rng = np.random.default_rng(seed_of(spec.name))
    wrong = base_errors(on, spec, rng) if spec.base_error else {}
    asked = list(spec.effects)
    for _ in range(4):
        placed, label = place_all(on, replace(spec, effects=tuple(asked)), wrong)
        loud = [i for i, row in enumerate(label["effects"]) if row["role"] == "background" and _too_loud(label, i)]
        if not loud:
            break
        for i in loud:
            share = 0.4 * label["effects"][0]["mark"] / label["effects"][i]["mark"] * label["effects"][i]["share"]
            asked[i] = replace(asked[i], share=share)
    noise = np.array(list(label["noise"].values()))
    return Made(spec, on, wrong, tuple(placed), noise, label)


def _too_loud(label: dict, i: int) -> bool:
    """A background effect is to have at most half the main effect's own mark."""
    return label["effects"][i]["mark"] > 0.5 * label["effects"][0]["mark"]


def place_all(on: Bench, spec: Spec, wrong: dict[str, float]) -> tuple[list[Placed], dict]:
    """The effects with their severities, one after the other, and the label."""
    rng = np.random.default_rng(seed_of(spec.name) + 2)
    noise = noise_of(on, spec, rows(on, wrong, ()))
    placed: list[Placed] = []
    for wanted in spec.effects:
        placed.append(place(on, spec, wanted, wrong, placed, noise, rng))
    whole = rows(on, wrong, placed)
    return placed, label_of(on, spec, wrong, placed, noise_of(on, spec, whole), whole)


def base_errors(on: Bench, spec: Spec, rng: np.random.Generator) -> dict[str, float]:
    """Every adjustable that the study lists wrong by a normal number of its tolerance; what it leaves out is right."""
    found, told = {}, listed(on, spec)
    for row in on.adjustable:
        factor = 1.0 + row["tolerance"] * float(np.clip(rng.standard_normal(), -2.5, 2.5))
        found |= {name: on.value(name, {}) * factor for name in parameters_of(row)} if row in told else {}
    return found


def noise_of(on: Bench, spec: Spec, values: np.ndarray) -> np.ndarray:
    """mm, a channel."""
    if on.noise is not None:
        return np.full(len(on.channels), on.noise)
    return spec.noise * np.sqrt((values**2).mean(0))


def place(
    on: Bench,
    spec: Spec,
    wanted: Wanted,
    wrong: dict[str, float],
    before: Sequence[Placed],
    noise: np.ndarray,
    rng: np.random.Generator,
) -> Placed:
    """The effect with the severity that leaves the wanted mark beside those `before` it."""
    kind = KINDS.get(wanted.effect) or OUTSIDE[wanted.effect]
    joints = on.members(wanted.place) if wanted.place not in on.channels else ()
    joints = tuple(name for name in joints if any(row["name"] == name for row in on.joints))
    at = kind.draw(rng, motion(on, joints[0] if joints else on.joints[0]["name"], wrong))
    effect = Placed(wanted.effect, wanted.place, joints, Numbers("", (), {}), wanted.other)
    some = on.loudest
    less = rows(on, wrong, before, some, fine=2)
    peak, size = np.abs(less).max(0), np.sqrt((less**2).mean(0))

    def with_severity(s: float) -> Placed:
        return resolve(on, effect.with_numbers(at(s)), s, wrong, peak, size)

    def found(s: float) -> float:
        return share(rows(on, wrong, [*before, with_severity(s)], some, fine=2), less)

    target, most = wanted.share, kind.limit * (20.0 if on.programme != OSCILLATOR and kind.limit >= 1.0 else 1.0)
    if wanted.effect == "added_mass" and on.programme == OSCILLATOR:  # at most half of the mass that is there
        moved = motion(on, joints[0], wrong)
        most = min(most, 0.5 * on.value(f"m{joints[0].split()[-1]}", wrong) * moved.a / moved.f)
    if wanted.mark:
        first = with_severity(search(found, 0.03, kind.first, most))
        difference = rows(on, wrong, [*before, first]) - rows(on, wrong, before)
        target = 0.03 * wanted.mark / mark(difference, noise, sensitivities_of(on, spec))
    return with_severity(search(found, target, kind.first, most))


def search(found: Callable[[float], float], target: float, first: float, most: float, tries: int = 9) -> float:
    """The severity whose share is `target` within 8 %, or the nearest that was seen."""
    s, best = first, (np.inf, first)
    below, above = 0.0, most
    for _ in range(tries):
        try:
            value = found(s)
        except ArithmeticError:
            above, s = s, (below or 0.3 * s) if below == 0.0 else np.sqrt(below * s)
            continue
        miss = abs(np.log(max(value, 1e-9) / target))
        best = min(best, (miss, s))
        if miss < 0.08:
            break
        if value < target:
            below = s
        else:
            above = s
        guess = s * float(np.clip(target / max(value, 1e-9), 0.05, 20.0))
        low, high = below, above
        s = guess if low < guess < high else (np.sqrt(max(low, 1e-3 * high) * high))
        if low >= 0.98 * high:
            break
    if not np.isfinite(best[0]):
        raise ArithmeticError("no severity is stable")
    return best[1]


def resolve(on: Bench, effect: Placed, s: float, wrong: dict[str, float], peak: np.ndarray, size: np.ndarray) -> Placed:
    """Shares into units: of a channel's rms or peak, of an FMU parameter."""
    given = dict(effect.numbers.parameters)
    column = list(on.channels).index(effect.place) if effect.place in on.channels else 0
    if effect.effect == "sensor_offset":
        given["offset"] *= 1e-3 * float(size[column])
    elif effect.effect == "sensor_saturation":
        given["limit"] *= 1e-3 * float(peak[column])
    elif effect.effect == "parameter_offset":
        share_of = given["value"]
        first = effect.place.split(", ")[0]
        given["value"] = share_of * on.value(first, wrong)
        return replace(effect, numbers=Numbers("", (share_of,), given))
    return replace(effect, numbers=replace(effect.numbers, parameters=given))


def sensitivities_of(on: Bench, spec: Spec) -> np.ndarray | None:
    """Of the adjustables that the study lists."""
    if not spec.unsure:
        return None
    return base_sensitivities(on.name)[:, :, [on.adjustable.index(row) for row in listed(on, spec)]]


def label_of(
    on: Bench, spec: Spec, wrong: dict[str, float], placed: Sequence[Placed], noise: np.ndarray, whole: np.ndarray
) -> dict:
    """What only the scoring reads."""
    moves = sensitivities_of(on, spec)
    effects = []
    for i, (wanted, effect) in enumerate(zip(spec.effects, placed, strict=True)):
        less = rows(on, wrong, [*placed[:i], *placed[i + 1 :]])
        kind = KINDS.get(effect.effect)
        effects.append(
            {
                "effect": effect.effect,
                "joint": effect.place,
                "role": wanted.role,
                "known": kind is not None,
                "parameters": dict(effect.numbers.parameters),
                "numbers": list(effect.numbers.numbers),
                "law": effect.numbers.law,
                "other": effect.other,
                "joints": list(effect.joints),
                "main": kind.main if kind else "",
                "share": share(whole, less),
                "mark": mark(whole - less, noise, moves),
                "mark_plain": mark(whole - less, noise, None),
                "tolerances": identities.tolerances(on, spec, effect),
                "same_as": identities.same_as(on, spec, effect),
            }
        )
    return {
        "format": 1,
        "name": spec.name,
        "spec": asdict(spec),
        "programme": on.programme,
        "effects": effects,
        "seen": SEEN,
        "parameters": wrong,
        "noise": dict(zip(on.channels, noise.tolist(), strict=True)),
    }


def measure(made: Made, run: Run, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(T, channels) mm and the recorded excitation (T,), on the clock of the acquisition."""
    clean = simulate(made.bench, run, made.parameters, made.effects)
    source = run.inputs if made.spec.recorded != "actual" else actual(run, made.effects)
    drive = source[next(iter(run.inputs))]
    if made.spec.recorded != "none":
        offset = float(rng.uniform(-0.1, 0.1))
        clean, drive = late(clean, offset), late(drive, offset)
    drive = drive + 1e-3 * np.sqrt((drive**2).mean()) * rng.standard_normal(len(drive))
    drive = np.round(drive / (fine := 2.0 ** np.floor(np.log2(np.abs(drive).max() * 1e-5)))) * fine
    resolution = 2.0 ** np.floor(np.log2(made.noise / 16.0))  # of the converter
    return np.round((clean + made.noise * rng.standard_normal(clean.shape)) / resolution) * resolution, drive


def write(made: Made, folder: Path) -> None:
    """The case DIR/cases/NAME and its label DIR/labels/NAME.json."""
    rng = np.random.default_rng(seed_of(made.spec.name) + 1)
    records = {run.name: measure(made, run, rng) for run in made.bench.runs}
    write_case(made.bench, made.spec, records, made.noise, folder / "cases" / made.spec.name, folder / "fmus")
    labels = folder / "labels"
    labels.mkdir(parents=True, exist_ok=True)
    path = labels / f"{made.spec.name}.json"
    path.write_text(json.dumps(made.label, indent=1) + "\n", encoding="utf-8")
