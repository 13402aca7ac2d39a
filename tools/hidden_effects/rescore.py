"""Judges rules of the decision on recorded ledgers: no FMU, a second or two a case.

    python tools/hidden_effects/run.py --out DIR --ledgers ...             # records DIR/results/NAME/ledger.bin
    python tools/hidden_effects/rescore.py --out DIR WORTH=0.03 TEMPER=3

Each rule is NAME=NUMBER, a constant of fmucorrect/discovery/worth.py or decide.py. Every case is decided twice, with the
code's constants and with these; what is told are the scores of both and the cases that they differ in. Which sets are
worth it is decided on all that the search compared. Where that comes to the same best set as in the record, the sets that
were then fitted to their end are decided on, as in the report; else those of the search, since equivalents and further
fits of another best set are not in the record.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from judging import judge
from recording import FILE, read
from scoring import places_of

from fmucorrect.discovery import decide, worth
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.terms import Term
from fmucorrect.discovery.worth import believed, first_of, names


@dataclass(frozen=True)
class Decided:
    """score: as judging.py has it. told: verdict and effects in words."""

    score: float
    told: str


def decided(
    stages: Sequence[Naming], label: Mapping[str, Any], study: Path, best: frozenset[tuple[str, str]]
) -> Decided:
    """One case by the constants as they stand. best: the best set by those of the record."""
    searched = stages[-2]
    chosen = believed(searched.setting, searched.base, searched.sets)
    naming = stages[-1] if best_of(searched) == best else replace(searched, sets=tuple(chosen))
    decision = decide.decide(naming)
    rows = [
        {"effect": term.effect, "joint": term.where, "probability": share, "indistinguishable_from": _others(others)}
        for term, share, others in zip(decision.best.model.terms, decision.probability, decision.classes, strict=True)
    ]
    report = {"verdict": decision.verdict, "effects": rows}
    told = ", ".join(f"{row['effect']} at {row['joint']} ({100 * row['probability']:.0f} %)" for row in rows)
    return Decided(judge(label, report, places_of(study)).score, f"{decision.verdict}: {told}")


def _others(terms: Sequence[Term]) -> list[dict[str, str]]:
    return [{"effect": term.effect, "joint": term.where} for term in terms]


def best_of(searched: Naming) -> frozenset[tuple[str, str]]:
    """The best set that is worth it."""
    return names(first_of([searched.base, *believed(searched.setting, searched.base, searched.sets)]))


@contextmanager
def changed(rules: Mapping[str, float]) -> Generator[None]:
    """The constants of these names set to other numbers, in every module that decides. Raises ValueError for a name of none."""
    with ExitStack() as stack:
        for name, value in rules.items():
            there = [module for module in (worth, decide) if hasattr(module, name)]
            if not there:
                raise ValueError(
                    f"no rule is called {name!r}: one of worth.py and decide.py is expected, as WORTH or TEMPER"
                )
            for module in there:
                stack.enter_context(patch.object(module, name, value))
        yield


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("rules", nargs="*", metavar="NAME=NUMBER")
    args = parser.parse_args()
    rules = {name: float(value) for name, _, value in (rule.partition("=") for rule in args.rules)}
    pairs: list[tuple[Decided, Decided]] = []
    for path in sorted((args.out / "results").glob(f"*/{FILE}")):
        name, record = path.parent.name, read(path)
        label = json.loads((args.out / "labels" / f"{name}.json").read_text(encoding="utf-8"))
        study, best = args.out / "cases" / name / "study.toml", best_of(record["stages"][-2])
        old = decided(record["stages"], label, study, best)
        with changed(rules):
            new = decided(record["stages"], label, study, best)
        pairs.append((old, new))
        if old != new:
            print(f"{name}: {old.score} {old.told}\n    -> {new.score} {new.told}")
    better, worse = (sum(sign * (new.score - old.score) > 0 for old, new in pairs) for sign in (1, -1))
    scores = (sum(pair[k].score for pair in pairs) for k in (0, 1))
    print(f"{len(pairs)} cases: {next(scores)} -> {next(scores)}; {better} better, {worse} worse")


if __name__ == "__main__":
    main()
