"""The gallery's figures for people: table, targets and picture."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmucorrect.training.verdict import WORDS

Rows = Mapping[str, Any]
"""gallery.json: by plant."""

WORSE = 0.02
"""Share by which an error may be larger than another and count as no worse."""
MOST = 0.9
"""Share of the samples in motion from which on a condition counts as flagged: a window that has just begun to move looks like
rest."""
INTRODUCTION = """# Many plants, and what `fmucorrect train` makes of them

`python tools/gallery.py` (`--seeds 3` for more of each): NRMSE in % of the measured range, mean of the channels, on
conditions that were held out of everything; medians of as many trainings, each with another seed, as the last column
says. *Best baseline*:
the best there, of an amplitude factor, ridge regressions on 10 taps and on 400 ms of the simulation, and measurements
interpolated over the condition, all fitted to the conditions of development. *Named effects*, and *both*, one
training on the model that has them, stand where a discovery was run: here by `--discover 10`, of the rigs and the
data of others also as committed, over the rows that its figure covers. *Band*: share of the samples inside the 90 %
band; *flagged*: share with status `outside`, in brackets of the samples in motion. silverbox,
friction_damper_backlash, mr_damper and emps were measured by others; bouc_wen was simulated by others; all else is
virtual.
"""


@dataclass(frozen=True)
class Line:
    """One condition that was held out, NRMSE in %, medians over the seeds. named, both: None where nothing is known. chosen:
    family of each seed. declared: flagged in motion where the excitation of development is declared, None where it is that."""

    plant: str
    condition: str
    bare: float
    baseline: str
    best: float | None
    corrected: float
    r2: float | None
    named: float | None
    both: float | None
    chosen: tuple[str, ...]
    coverage: float
    flagged: float
    moving: float | None
    declared: float | None

    @property
    def outside(self) -> bool:
        """Whether the corrector says that it is not to be used."""
        return self.moving is not None and self.moving >= MOST


def lines(rows: Rows) -> Iterator[Line]:
    """Of every plant that was trained."""
    for plant, found in rows.items():
        seeds = list(found["seeds"].values())
        for name, known in found["held out"].items() if seeds else ():
            each = [seed["held out"][name] for seed in seeds]
            simple = {kind: error for kind, error in known["nrmse"].items() if kind != "bare"}
            best = min(simple, key=lambda kind: simple[kind]) if simple else ""
            effects = found.get("named", {}).get(name, {})
            yield Line(
                *(plant, name, known["nrmse"]["bare"], best, simple.get(best)),
                corrected=_median(each, "corrected") or 0.0,
                r2=_median(each, "r2"),
                named=effects.get("named"),
                both=effects.get("both"),
                chosen=tuple(seed["family"] for seed in seeds),
                coverage=_median(each, "coverage") or 0.0,
                flagged=_median(each, "flagged") or 0.0,
                moving=_median(each, "flagged while excited"),
                declared=_median(each, "flagged as if excited as in development"),
            )


def _median(each: Sequence[Mapping[str, Any]], key: str) -> float | None:
    found = [entry[key] for entry in each if key in entry]
    return float(np.median(found)) if found else None


def page(rows: Rows) -> str:
    """gallery.md"""
    parts = [
        INTRODUCTION,
        "![NRMSE of each plant as simulated, by the best baseline and corrected](gallery.svg)\n",
        table(rows),
        _elsewhere(rows),
        _discovered(rows),
        "## What was asked for\n",
        _table(["what", "wanted", "got", ""], targets(rows)) + "\n",
        _missed(rows),
        _published(rows),
        _families(rows),
    ]
    return "\n".join(part for part in parts if part)


def table(rows: Rows) -> str:
    """A line a condition; the random rigs as one."""
    head = ["plant", "held out", "bare", "best baseline", "corrector", "named effects", "both"]
    head += ["family", "band", "flagged", "seeds"]
    cells: list[list[str]] = []
    last, random = "", list[Line]()
    for line in lines(rows):
        if line.plant.startswith("random rig"):
            random.append(line)
            continue
        first = [line.plant if line.plant != last else "", line.condition]
        best = "" if line.best is None else f"{_number(line.best)} ({line.baseline})"
        moving = "" if line.moving is None else f" ({_percent(line.moving)})"
        cells.append(
            [
                *(*first, _number(line.bare), best, f"**{_number(line.corrected)}**"),
                *("" if value is None else _number(value) for value in (line.named, line.both)),
                *(_counted(line.chosen), _percent(line.coverage), f"{_percent(line.flagged)}{moving}"),
                str(len(line.chosen)),
            ]
        )
        last = line.plant
    for what, of in (("median", np.median), ("worst", max)) if random else ():
        best = [line.best for line in random if line.best is not None]
        seeds = sorted({len(line.chosen) for line in random})
        cells.append(
            [
                *(f"{len(random)} random rigs" if what == "median" else "", f"{random[0].condition}, {what}"),
                _number(of([line.bare for line in random])),
                _number(of(best)) if best else "",
                f"**{_number(of([line.corrected for line in random]))}**",
                *("", "", _counted([f for line in random for f in line.chosen]) if what == "median" else ""),
                _percent(
                    np.median([x.coverage for x in random]) if what == "median" else min(x.coverage for x in random)
                ),
                _percent(of([line.flagged for line in random])),
                "-".join(str(n) for n in dict.fromkeys((seeds[0], seeds[-1]))),
            ]
        )
    return _table(head, cells) + "\n"


def _elsewhere(rows: Rows) -> str:
    """Conditions under another excitation: what looks at the motion alone flags."""
    found = [
        f"{line.plant} at {line.condition}: {_percent(line.declared)} (R2 {line.r2:.3f})"
        for line in lines(rows)
        if line.declared is not None and line.r2 is not None
    ]
    if not found:
        return ""
    return (
        "Under an excitation that development had not, declared is what it truly is. Where that of development is declared "
        f"instead, so that the guard has the motion alone, it flags of the samples in motion: {', '.join(found)}.\n"
    )


def _discovered(rows: Rows) -> str:
    """What was named here."""
    found = [
        f"- {plant}: {', '.join([row['discovered']['verdict'], *row['discovered']['effects']])}"
        for plant, row in rows.items()
        if "discovered" in row
    ]
    return "What `--discover` named:\n\n" + "\n".join(found) + "\n" if found else ""


def targets(rows: Rows) -> list[list[str]]:
    """What, wanted, got, and whether that is met or by how much it is not."""
    known = list(lines(rows))
    at = {(line.plant, line.condition): line for line in known}
    told = [
        _never_worse("bare", [(line, line.bare) for line in known]),
        _never_worse("the best baseline", [(line, line.best) for line in known if line.best is not None]),
    ]
    car = [line for line in known if line.plant == "quarter car, friction"]
    most = max((line.corrected / line.bare for line in car), default=None)
    told.append(_at_most("quarter car with friction, of bare (3.0 % of 5.9)", 3.0 / 5.9, most, ""))
    for figure, limit in (("multisine", 1.0), ("arrow", 3.0)):
        told.append(_at_most(f"silverbox, {figure}", limit, _figure(rows, "silverbox", figure), " mV"))
    for letter, limit in (("A", 0.30), ("B", 1.2), ("C", 0.44)):
        line = at.get((f"rig {letter}", "385"))
        told.append(_at_most(f"rig {letter} at 385 km/h", limit, line.corrected if line else None, " %"))
    for line in known:
        if line.plant == "rig C" and line.condition != "385" and line.r2 is not None and line.moving is not None:
            got = f"{line.r2:.3f}, {_percent(line.moving)} flagged"
            met = "met" if line.r2 >= 0.95 or line.outside else "missed"
            told.append([f"rig C, {line.condition}", f"R2 0.95 or flagged ({_percent(MOST)} of the motion)", got, met])
    return told


def _never_worse(than: str, pairs: Sequence[tuple[Line, float]]) -> list[str]:
    worse = [(line.corrected / other - 1.0, line) for line, other in pairs if line.corrected > other * (1.0 + WORSE)]
    got = f"{len(worse)} of {len(pairs)} are"
    if worse:
        by, line = max(worse, key=lambda entry: entry[0])
        got += f", the most {line.plant} at {line.condition}, by {_percent(by)}"
    wanted = f"none more than {_percent(WORSE)} worse"
    return [f"never worse than {than}", wanted, got if pairs else "not run", _met(not worse) if pairs else ""]


def _at_most(what: str, limit: float, got: float | None, unit: str) -> list[str]:
    if got is None:
        return [what, f"at most {limit:.3g}{unit}", "not run", ""]
    verdict = "met" if got <= limit else f"missed by {_percent(got / limit - 1.0)}"
    return [what, f"at most {limit:.3g}{unit}", f"{got:.3g}{unit}", verdict]


def _met(yes: bool) -> str:
    return "met" if yes else "missed"


def _missed(rows: Rows) -> str:
    """Every condition that is worse than something."""
    found: list[str] = []
    for line in lines(rows):
        for than, other in (("bare", line.bare), (line.baseline, line.best)):
            if other is not None and line.corrected > other * (1.0 + WORSE):
                flagged = ", flagged" if line.outside else ""
                found.append(
                    f"- {line.plant} at {line.condition}: {_number(line.corrected)} against {_number(other)} ({than}{flagged})"
                )
    return "Worse than bare or than a baseline:\n\n" + "\n".join(found) + "\n" if found else ""


def _published(rows: Rows) -> str:
    """Published figures in their own units."""
    head = ["set", "figure", "bare", "best baseline", "corrector", "named effects", "published"]
    cells: list[list[str]] = []
    for plant, found in rows.items():
        for condition, known in found["held out"].items() if found["seeds"] else ():
            for figure, each in known.get("published", {}).items():
                kinds = [kind for kind in known["nrmse"] if kind != "bare"]
                best = min(each[kind] for kind in kinds)
                named = found.get("named", {}).get(condition, {}).get("published", {}).get(figure)
                cells.append(
                    [
                        *(plant, f"{figure}, {each['unit']}", f"{each['bare']:.4g}", f"{best:.4g}"),
                        f"**{_figure(rows, plant, figure):.4g}**",
                        "" if named is None else f"{named:.4g}",
                        ", ".join(f"{who} {value:.4g}" for who, value in each["others"].items()),
                    ]
                )
    if not cells:
        return ""
    return "## Beside what others published\n\n" + _table(head, cells) + "\n"


def _figure(rows: Rows, plant: str, figure: str) -> float | None:
    """The corrector's, median over the seeds; None where it was not run."""
    seeds = list(rows.get(plant, {}).get("seeds", {}).values())
    held = [each.get("published", {}) for seed in seeds for each in seed["held out"].values()]
    return _median(held, figure)


def _families(rows: Rows) -> str:
    """What leaving conditions out said."""
    cells: list[list[str]] = []
    for plant, found in rows.items():
        seeds = list(found["seeds"].values())
        if not seeds:
            continue
        chosen = Counter(seed["family"] for seed in seeds)
        means = {f: _median([seed["left out"] for seed in seeds], f) for f in WORDS}
        told = {f: "" if mean is None else _number(mean) for f, mean in means.items()}
        cells.append([plant, *(f"**{told[f]}**" if f in chosen else told[f] for f in WORDS)])
    text = (
        "## What leaving conditions out said\n\nMean NRMSE (%) over the conditions of development, each left out in turn, by "
        "family; bold is what was taken by at least one of the seeds. That decides what is deployed, nothing that was held "
        "out does.\n\n"
    )
    return text + _table(["plant", *WORDS.values()], cells) + "\n"


def _counted(families: Sequence[str]) -> str:
    told = Counter(families).most_common()
    return ", ".join(f"{family}{f' {n}' if len(told) > 1 else ''}" for family, n in told)


def _table(head: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *cells))


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 100.0 else f"{value:.0f}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


WIDTH, LEFT, RIGHT, TOP, PITCH = 960, 300, 24, 78, 19
COLOURS = {"as simulated": "#d1495b", "best baseline": "#e0a030", "corrected": "#1f7a8c"}


def picture(rows: Rows) -> str:
    """gallery.svg: NRMSE of every condition that was held out, as simulated, by the best baseline and corrected, on a
    logarithmic axis, sorted by the last."""
    known = sorted(lines(rows), key=lambda line: line.corrected)
    values = [v for line in known for v in (line.bare, line.best, line.corrected) if v]
    low = 10.0 ** math.floor(math.log10(min(values, default=0.1)))
    high = 10.0 ** math.ceil(math.log10(max(values, default=100.0)))
    bottom = TOP + PITCH * len(known)
    x = lambda v: LEFT + (WIDTH - LEFT - RIGHT) * math.log(max(v, low) / low) / math.log(high / low)  # noqa: E731
    title = f"Conditions that were held out of everything, {len({line.plant for line in known})} plants"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom + 44}" font-family="sans-serif" font-size="12">'
        f'<rect width="{WIDTH}" height="{bottom + 44}" fill="white"/>'
        f'<text x="12" y="26" font-size="16">{title}</text>'
    ]
    for i, (name, colour) in enumerate(COLOURS.items()):
        parts.append(_dot(LEFT + 130 * i + 6, 50, colour) + f'<text x="{LEFT + 130 * i + 16}" y="54">{name}</text>')
    for decade in range(round(math.log10(low)), round(math.log10(high)) + 1):
        at = x(10.0**decade)
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{TOP - 8}" y2="{bottom}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="{at:.1f}" y="{bottom + 16}" text-anchor="middle" fill="#555">{10.0**decade:g} %</text>')
    for i, line in enumerate(known):
        y = TOP + PITCH * (i + 0.5)
        marks = dict(zip(COLOURS, (line.bare, line.best, line.corrected), strict=True))
        there = {name: value for name, value in marks.items() if value is not None}
        ends = x(min(there.values())), x(max(there.values()))
        label = f"{line.plant}, {line.condition}".replace("&", "&amp;").replace("<", "&lt;")
        parts.append(f'<text x="{LEFT - 10}" y="{y + 4:.1f}" text-anchor="end">{label}</text>')
        parts.append(f'<line x1="{ends[0]:.1f}" x2="{ends[1]:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ccc"/>')
        parts += [_dot(x(value), y, COLOURS[name]) for name, value in there.items()]
    end = f'<text x="{WIDTH - RIGHT}" y="{bottom + 34}" text-anchor="end" fill="#555">NRMSE, % of the measured range</text>'
    parts.append(f"{end}</svg>\n")
    return "\n".join(parts)


def _dot(x: float, y: float, colour: str) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{colour}"/>'
