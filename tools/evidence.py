"""Writes the pages of docs/evidence from what the tools have measured and committed: python tools/evidence.py [--check]

Nothing on these pages is typed: figures come from exported_models/**, tools/*.json, tools/*.md, tools/hidden_effects/score.md
and tools/real_data/README.md, each beside the command that makes it. --check writes nothing, and fails where a page is not
what would be written.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "docs" / "evidence"
MODELS = ROOT / "exported_models"
RIGS = {"A": MODELS / "roller_rig", "B": MODELS / "roller_rig_B", "C": MODELS / "roller_rig_C"}
HELD_OUT = "385"  # km/h, the condition that is opened at the end
NOTICE = "Written by `python tools/evidence.py` from committed results; change those, not this page."
CAVEAT = "The rigs are virtual unless a line says otherwise. None of this is evidence for safety, certification or acceptance."

Table = tuple[list[str], list[list[str]]]


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the pages of docs/evidence.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail where a page is not up to date")
    check = parser.parse_args().check
    made = pages()
    stale = [
        name for name, text in made.items() if not (OUT / name).is_file() or (OUT / name).read_text("utf-8") != text
    ]
    if check:
        if stale:
            sys.exit(f"docs/evidence: {', '.join(stale)} not up to date; run: python tools/evidence.py")
        return
    OUT.mkdir(parents=True, exist_ok=True)
    for name in stale:
        (OUT / name).write_text(made[name], encoding="utf-8")
    print(f"{len(made)} pages, {len(stale)} written")


def pages() -> dict[str, str]:
    """Text of each page, by its name."""
    bodies = {
        "correction.md": correction(),
        "methods.md": methods(),
        "discovery.md": discovery(),
        "speed.md": speed(),
        "robustness.md": robustness(),
        "soundness.md": soundness(),
        "index.md": index(),
    }
    return {name: f"{head}\n\n*{NOTICE}*\n\n{text.strip()}\n" for name, (head, text) in bodies.items()}


def load(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def tables(text: str) -> list[Table]:
    """Every table of a Markdown text."""
    found: list[Table] = []
    for block in re.findall(r"(?:^\|.*\n?)+", text, re.M):
        rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in block.strip().splitlines()]
        found.append((rows[0], rows[2:]))
    return found


def sections(text: str) -> list[tuple[str, str]]:
    """Headings of the second level and what stands below each."""
    parts = re.split(r"^## (.*)\n", text, flags=re.M)
    return list(zip(parts[1::2], parts[2::2], strict=True))


def repo(path: Path) -> str:
    """A file or folder of the project, as a page of docs/evidence links it."""
    return f"../../{path.relative_to(ROOT).as_posix()}"


def held_out(rig: Path) -> dict[str, Any]:
    return next(c for c in load(rig / "evaluation.json")["conditions"] if c["condition"] == HELD_OUT)


def correction() -> tuple[str, str]:
    rows = []
    for name, rig in RIGS.items():
        c = held_out(rig)
        before, after = c["simulated"], c["corrected"]
        rows.append(
            [
                f"[{name}]({repo(rig)}/card.md)",
                f"{before['mean_r2']:.3f}",
                f"**{after['mean_r2']:.4f}**",
                f"{before['mean_nrmse']:.1f} %",
                f"**{after['mean_nrmse']:.2f} %**",
                f"{before['mean_nmae']:.1f} %",
                f"{after['mean_nmae']:.2f} %",
                f"{percent(c['coverage_90'])} ({percent(c['coverage_90_excited'])})",
            ]
        )
    head = [
        "rig",
        "mean R2 before",
        "after",
        "NRMSE before",
        "after",
        "NMAE before",
        "after",
        "90 % band holds (excited)",
    ]
    random = load(MODELS / "random_rigs.json")
    s = random["summary"]
    spread = [
        [label, *(f"{s[key][q]:.{digits}f}" for q in ("least", "lower", "median", "upper", "greatest"))]
        for key, label, digits in (
            ("nrmse_before", "NRMSE before, %", 2),
            ("nrmse_after", "NRMSE after, %", 2),
            ("after_over_before", "after over before", 3),
            ("after_over_noise_floor", "after over the sensors' noise", 2),
            ("mean_r2_after", "mean R2 after", 4),
        )
    ]
    models = load(MODELS / "roller_rig" / "models.json")
    names = [c["name"] for c in models["conditions"]]
    roles = {c["name"]: c["role"] for c in models["conditions"]}
    both = [
        [row["label"], *(f"{row['conditions'][name]['nrmse']:.2f}" for name in names)] for row in models["rows"]
    ] + [["the sensors' noise alone", *(f"{models['noise_floor'][name]:.2f}" for name in names)]]
    where = [f"{name} km/h{'' if roles[name] == 'development' else ', held out'}" for name in names]
    text = f"""
{CAVEAT}

## Three rigs at {HELD_OUT} km/h

Trained at 300 to 360 km/h; {HELD_OUT} km/h was held out of everything. Scores are over the whole record, as the paper defines them.
`python tools/train_models.py` makes the models, `fmucorrect demo` repeats rig A's line. Each card has every condition, how its
model was chosen and where it may be used.

{table(head, rows)}

![Rig A, measured, simulated and corrected](../../exported_models/roller_rig/result.svg)

## Twelve rigs drawn by chance

Hidden effects, severities, sensors and parameters by chance, each trained shortly and alone (`python tools/random_rigs.py`).
{s["rigs"]} rigs, {len(s["worse"])} became worse; the 90 % band held {percent(s["coverage_90"])} of all samples and \
{percent(s["coverage_90_excited"])} of those while the excitation ran.

{table(["", "least", "lower quartile", "median", "upper quartile", "greatest"], spread)}

![NRMSE of the random rigs before and after](../../exported_models/random_rigs.svg)

## Many plants

Every condition that was held out, of rigs, quarter cars, a chain of masses and the data of others, as simulated, by the best of what
anyone would try first, and corrected. [The table](../../exported_models/gallery.md) has the figures, the targets and where they were
missed (`python tools/gallery.py`). Rigs A to C stand there as `train` makes them with its defaults by the code of its day; those
above are shipped, and were trained before.

![NRMSE of each plant as simulated, by the best baseline and corrected](../../exported_models/gallery.svg)

## A network, a named effect, or both

Rig A, trained on 300 to 360 km/h; *augmented* is the model with the effects that `fmucorrect discover` found in it. NRMSE in %, mean of
the channels (`fmucorrect discover fmus/roller_rig/A/study.toml -o found`, then `python tools/compare_models.py A found`).

{table(["model", *where], both)}

Away from the trained speeds the exported corrector fades to its simulation, and the model that is right is far better; near them
the network is, as it learns the sensors' errors with the rest. With both, what is left at {HELD_OUT} km/h is the noise. The lag
of the platform and the sensors' offsets, which discovery found too, are no part of an FMU.
"""
    return "# Correction", text


def percent(share: float | Sequence[float]) -> str:
    return f"{100 * float(np.mean(share)):.0f} %"


def methods() -> tuple[str, str]:
    found = load(MODELS / "roller_rig" / "compare.json")
    paper = {row["case"]: row for row in found["paper"]}
    rows = []
    for case in found["cases"]:
        of = [run["conditions"][HELD_OUT] for run in case["runs"]]
        later = [c["hour_later_nrmse"] for c in of if c.get("hour_later_nrmse") is not None]
        printed = paper.get(case["case"])
        rows.append(
            [
                case["label"],
                case["inputs"],
                mean([float(np.mean(c["r2"])) for c in of], 3),
                mean([float(np.mean(c["nrmse"])) for c in of], 2),
                mean(later, 2) if later else "",
                f"{printed['nrmse']:.2f}" if printed else "",
            ]
        )
    ablations = [found["ablation"], *(load(RIGS[name] / "ablation.json")["ablation"] for name in ("B", "C"))]
    terms = []
    for i, variant in enumerate(ablations[0]["rows"]):
        cells = []
        for a in ablations:
            row, full = a["rows"][i], np.array(a["rows"][0]["nrmse"])
            change = np.array(row["nrmse"]) - full
            if i == 0:
                cells.append(f"{full.mean():.2f} ± {full.std(ddof=1):.2f}")
                continue
            error = change.std(ddof=1) / np.sqrt(len(change))
            said = f"{change.mean():+.2f} ± {error:.2f}"
            cells.append(f"**{said}**" if abs(change.mean()) > 2 * error else said)
        terms.append(["nothing: NRMSE, %" if i == 0 else variant["label"], *cells])
    epochs = ", ".join(f"{a['epochs']}" for a in ablations)
    text = f"""
{CAVEAT}

## The paper's three cases, simple methods, and ours

`fmucorrect compare` trains every case on the same development conditions and scores it on the one that was held out. Rig A at
{HELD_OUT} km/h, the paper's epochs, {len(found["ablation"]["seeds"])} random starts, mean ± standard deviation
(`python tools/compare_rigs.py A`). *An hour later*: the same simulation and phase, a clock that has run for an hour.

{table(["case", "sees", "mean R2", "NRMSE, %", "an hour later, %", "the paper's NRMSE on its real rig"], rows)}

{found["ranking"]["text"].replace("seeds", "random starts")}

## What each term of the paper's loss is worth

`compare --ablate`, {epochs} epochs on rigs A, B and C, random starts paired: NRMSE at {HELD_OUT} km/h against the full formulation,
per cent points ± standard error. Positive: what was taken away had helped. First row: mean ± standard deviation. Bold: more than
two standard errors; of terms that do nothing, one in eight looks so.

{table(["taken away", "rig A", "rig B", "rig C"], terms)}

In words: the acceleration and physics terms, at the paper's weights, show no use worth their name here. What helps is history in the
place of time, and the simulation itself in the place of a TDNN that is trained to repeat it. The corrector that is shipped has
neither of the regularising terms.
"""
    return "# Against other methods", text


def mean(values: Sequence[float], digits: int) -> str:
    told = f"{np.mean(values):.{digits}f}"
    return told if len(values) < 2 else f"{told} ± {np.std(values, ddof=1):.{digits}f}"


def draws() -> list[tuple[str, Table, Table | None]]:
    """What each unseen draw of the suite gave, newest first: what was run, its figures, and what went wrong in it."""
    text = (ROOT / "tools/hidden_effects/score.md").read_text(encoding="utf-8")
    found = []
    for heading, body in sections(text):
        if not re.match(r"Seed [1-9]\d*, chains", heading):
            continue
        what = heading.partition(": ")[2].replace(", as run first", "")
        inside = tables(body)
        figures = next(t for t in inside if t[0][0] == "figure")
        wrong = next((t for t in inside if t[0][0] == "kind"), None)
        found.append((what, figures, wrong))
    return found


def rig_figures(kind: str = "swept") -> Table:
    """Of the roller rig, with swept runs or with the paper's single tone."""
    text = (ROOT / "tools/hidden_effects/score.md").read_text(encoding="utf-8")
    body = next(body for heading, body in sections(text) if heading.startswith("Roller rig") and kind in heading)
    return next(t for t in tables(body) if t[0][0] == "figure")


def plain(figure: str) -> str:
    return re.sub(r" \((?:rig|singles alone)[^)]*\)", "", figure)


def discovery() -> tuple[str, str]:
    unseen = draws()
    columns = [(what, {plain(row[0]): row for row in figures[1]}) for what, figures, _ in unseen]
    columns.append(("roller rig, swept runs", {plain(row[0]): row for row in rig_figures()[1]}))
    targets: dict[str, list[str]] = {}
    for _, rows in columns:
        for name, row in rows.items():
            if row[3] not in targets.setdefault(name, []):
                targets[name].append(row[3])
    order = list(dict.fromkeys(name for _, rows in columns for name in rows))
    lines = [
        [
            name,
            *(verdict(rows[name]) if name in rows else "not run" for _, rows in columns),
            "; rig: ".join(targets[name]),
        ]
        for name in sorted(order, key=lambda name: place(name, columns))
    ]
    head = ["", *(f"{label}: {what}" for label, (what, _) in zip(ages(len(unseen)), columns, strict=False))]
    head += [columns[-1][0], "target"]
    newest = unseen[0][2]
    assert newest is not None, "the newest draw has no table of what went wrong"
    wrong = table(*newest)
    rigs = []
    for name, rig in RIGS.items():
        text = (rig / "discovery" / "README.md").read_text(encoding="utf-8")
        rows = tables(text)[0][1]
        error = re.search(r"held out: ([\d.]+ -> [\d.]+ %), sensors' noise ([\d.]+ %)", text)
        assert error, f"{rig}/discovery/README.md says no error"
        named = sum(row[2].startswith(("named", "class")) for row in rows)
        rigs.append([f"[{name}]({repo(rig)}/discovery/README.md)", f"{named} of {len(rows)}", error[1], error[2]])
    real = tables((ROOT / "tools/real_data/README.md").read_text(encoding="utf-8"))[1]
    tone = [[plain(row[0]), f"{row[1]} of {row[2]}"] for row in rig_figures("single 2 Hz tone")[1]]
    text = f"""
{CAVEAT}

{second_generator().strip()}

## Data of others

Measured (all but one) or published as a benchmark (Bouc-Wen), with a known answer; what is scored was held out. `python tools/real_data/make.py` makes the studies, [how](../../tools/real_data/README.md). The last column is the best published figure.

{table(["set", "named", "error reached", "best published"], real[1])}

## Cases that nobody had seen

Virtual chains of masses with hidden effects, drawn anew by `python tools/hidden_effects/run.py --out suite`
([how they are made and scored](../../tools/hidden_effects/README.md)). Each draw is counted as it came out first, before anybody had looked at one of its
cases; what was wrong is then mended where its cause is general, for the next draw to judge.

{table(head, lines)}

What went wrong in the newest draw (`mark`: what the effect leaves at the sensors, in standard deviations of their noise):

{wrong}

The roller rig with the paper's single tone of 2 Hz, by which some effects cannot be told apart; classes are expected, and there are no
targets:

{table(["", ""], tone)}

## The three virtual rigs

What is hidden in them discovery does not read; each page compares line by line. NRMSE at {HELD_OUT} km/h, held out.

{table(["rig", "hidden effects told by name or class", "error before and after", "the sensors' noise alone"], rigs)}
"""
    return "# Discovery", text


def second() -> dict[str, Any]:
    return load(ROOT / "tools" / "second_generator" / "score.json")


def second_figures() -> list[list[str]]:
    """What, value of how many, target: of the second generator."""
    return [
        [
            row["what"],
            f"{100.0 * row['value']:.3g} % of {row['of']}",
            "" if row["target"] is None else f"at {'least' if row['at_least'] else 'most'} {100.0 * row['target']:g} %",
        ]
        for row in second()["figures"]
    ]


def second_missed() -> list[list[str]]:
    """Of these those that miss their target."""
    found = zip(second()["figures"], second_figures(), strict=True)
    return [
        said
        for row, said in found
        if row["target"] is not None
        and (row["value"] < row["target"]) == row["at_least"]
        and row["value"] != row["target"]
    ]


def second_generator() -> str:
    """The section on the second generator's cases."""
    found, missed = second(), second_missed()
    rows = [[a, b + (", **missed**" if [a, b, c] in missed else ""), c] for a, b, c in second_figures()]
    medians = [[name, f"{value:.3g}"] for name, value in found["medians"].items() if value is not None]
    wrong = [
        [
            c["kind"],
            c["plant"],
            "; ".join(c["hidden"]) or "nothing",
            ", ".join(f"{m:.0f}" for m in c["marks"]),
            c["verdict"],
            "; ".join(c["said"]) or "-",
            f"{c['score']:g}",
        ]
        for c in found["cases"]
        if c["score"] < 1.0 or c["wrong"]
    ]
    return f"""
## Cases of a second generator

Quarter car, geared drive, beam, swaying body and crane, their FMUs by another exporter, laws from textbooks with located events,
filtered, sampled and rounded logs: a generator that shares no code with the one below
(`python tools/second_generator/run.py --out DIR --seed {found["seed"]} --keep`, [how](../../tools/second_generator/README.md)).
{found["run"]} of the draw's {found["planned"]} cases were run, in the order of their names, which are hashes; nothing was changed for them.

{table(["", "", "target"], rows)}

{table(["median", ""], medians)}

What went wrong in it (in brackets what the generator drew):

{table(["kind", "plant", "hidden", "mark", "verdict", "said", "score"], wrong) if wrong else "nothing."}
"""


def place(name: str, columns: Sequence[tuple[str, dict[str, list[str]]]]) -> tuple[int, str]:
    """Order of a figure: that of the draw that has most of them."""
    most = list(max((rows for _, rows in columns), key=len))
    return (most.index(name), "") if name in most else (len(most), name)


def ages(count: int) -> list[str]:
    return ["newest", "second newest", "third newest", *(f"{n}th newest" for n in range(4, count + 1))][:count]


def verdict(row: Sequence[str]) -> str:
    return f"{row[1]} of {row[2]}" + (", **missed**" if "no" in row[4] else "")


def speed() -> tuple[str, str]:
    return "# Speed", (ROOT / "tools" / "benchmark.md").read_text(encoding="utf-8").partition("\n")[2]


def robustness() -> tuple[str, str]:
    attack = load(ROOT / "tools" / "attack.json")
    verdicts = list(dict.fromkeys(v for counts in attack["counts"].values() for v in counts))
    rows = [
        [kind, *(str(counts.get(v, 0)) for v in verdicts), str(sum(counts.values()))]
        for kind, counts in sorted(attack["counts"].items())
    ]
    mutation = (ROOT / "tools" / "mutation.md").read_text(encoding="utf-8")
    noticed = next(line for line in mutation.splitlines() if "random mutants were noticed" in line)
    head, mutants = tables(mutation)[0]
    keep = [i for i, name in enumerate(head) if name != "tests"]
    conformance = tables((ROOT / "tools" / "conformance.md").read_text(encoding="utf-8"))[0]
    text = f"""
## Damaged and hostile inputs, and kills

`python tools/attack.py`: {attack["inputs"]} damaged or hostile files through {attack["commands"]} commands, and {attack["kills"]} kills
at random moments. An input is counted once, by the worst of what its commands made of it. *Clean error*: exit 2 and one message.
*Same result*: the numbers of the whole file. *Another valid file*: what was changed lies under no checksum, and the numbers are
those that now stand there. *Different, said*: other numbers, and the output says so. A kind that did not occur (a crash, a
traceback, a file left over, a wrong number without a word) has no column.

{table(["input", *verdicts, "all"], rows)}

## Would the tests notice a mistake?

`python tools/mutation.py` changes one operator or number of the code at a time. {noticed}

{table([head[i] for i in keep], [[row[i] for i in keep] for row in mutants])}

## MCAP files of others

The MCAP project's conformance cases and our own, read by fmucorrect and by both readers of the mcap library
(`python tools/conformance.py`). *Refused*: there is no message, and one error says so. The last column counts files that the
library's own reader by the summary cannot read.

{table(*conformance)}
"""
    return "# Damaged and hostile files", text


def soundness() -> tuple[str, str]:
    found = load(ROOT / "tools" / "assessed.json")
    names = list(found)
    lines = list(dict.fromkeys(key for model in found.values() for key in model))
    rows = [[line, *(found[name].get(line, "-") for name in names)] for line in lines]
    text = f"""
`fmucorrect assess all fmus/MODEL/assess.toml -o page` asks whether a model is consistent in itself. It is no proof of compliance with
EN 14363 or any other standard, and no evidence for safety, certification or acceptance.

{table(["", *names], rows)}

Written down by `python tools/assess_models.py`, beside what the paper prints of its own vehicle where it prints something.
"""
    return "# Soundness of the shipped models", text


def index() -> tuple[str, str]:
    missed = [["discovery, second generator", what, got, wanted] for what, got, wanted in second_missed()]
    for label, (what, figures, _) in zip(ages(99), draws(), strict=False):
        missed += [[f"discovery, {label} draw ({what})", plain(r[0]), r[1], r[3]] for r in figures[1] if "no" in r[4]]
    missed += [["discovery, roller rig, swept runs", plain(r[0]), r[1], r[3]] for r in rig_figures()[1] if "no" in r[4]]
    benchmark = tables((ROOT / "tools" / "benchmark.md").read_text(encoding="utf-8"))[0]
    for row in benchmark[1]:
        if "missed" in row[2] or row[2].endswith(", missed"):
            missed.append(["[speed](speed.md)", row[0], row[1], row[2].partition(",")[0]])
    for name, rig in RIGS.items():
        for c in load(rig / "evaluation.json")["conditions"]:
            shares = [*np.atleast_1d(c["coverage_90"]), *np.atleast_1d(c["coverage_90_excited"])]
            if min(shares) < 0.85:
                what = f"90 % band at {c['condition']} km/h, lowest of the channels (all samples, and while excited)"
                missed.append(
                    [f"[correction, rig {name}]({repo(rig)}/card.md)", what, f"{100 * min(shares):.0f} %", "90 %"]
                )
    gallery = (MODELS / "gallery.md").read_text(encoding="utf-8")
    wanted = next(rows for head, rows in tables(gallery) if head[:3] == ["what", "wanted", "got"])
    where = f"[many plants]({repo(MODELS / 'gallery.md')})"
    missed += [[where, row[0], row[2], row[1]] for row in wanted if row[3].startswith("missed")]
    ranking = load(MODELS / "roller_rig" / "compare.json")["ranking"]
    held = sum(ranking["holds"])
    if held < len(ranking["holds"]):
        what = "the paper's order of its cases, on rig A"
        missed.append(["[methods](methods.md)", what, f"{held} of {len(ranking['holds'])} random starts", "all"])
    attack = load(ROOT / "tools" / "attack.json")["counts"]
    fine = {"clean error", "same result", "another valid file", "different, said"}
    for kind, counts in attack.items():
        missed += [
            ["[files](robustness.md)", f"{kind}: {what}", str(n), "0"] for what, n in counts.items() if what not in fine
        ]
    text = f"""
Every figure on these pages is made by a command that stands beside it. {CAVEAT}

| page | what it answers |
|---|---|
| [Correction](correction.md) | how much of the disagreement a corrector takes away, on three rigs and on twelve drawn by chance |
| [Many plants](../../exported_models/gallery.md) | what `train` makes of rigs, cars, masses and the data of others, beside what anyone would try first |
| [Against other methods](methods.md) | the paper's three cases, simple methods, and what each term of the loss is worth |
| [Discovery](discovery.md) | how often the right effect is named: data of others, cases that nobody had seen, three rigs |
| [Hosts](../../fmucorrect/wrapping/hosts.md) | whether a wrapped FMU gives in seven hosts what the bare one gives |
| [Speed](speed.md) | what a step, a run, a file and a discovery cost |
| [Damaged and hostile files](robustness.md) | what happens with files that are not as they should be |
| [Soundness](soundness.md) | whether the shipped models stand, hunt and run through curves as they should |
| [Where a corrector ends](../../fmucorrect/training/README.md#where-a-corrector-ends) | excitations that training did not hold: what is flagged, and where the band is too narrow |

## What was missed

{table(["where", "what", "got", "wanted"], missed)}
"""
    return "# Evidence", text


if __name__ == "__main__":
    main()
