"""A second generator of cases whose truth is known: made, discovered from and scored.

    python tools/second_generator/run.py --out DIR --seed N                    # all of it, one case at a time
    python tools/second_generator/run.py --out DIR --seed N --cases single     # names, or patterns of names or kinds
    python tools/second_generator/run.py --out DIR --seed N --keep             # and write tools/second_generator/score.json

What is there is not made again: a run that was stopped goes on. Cases lie in DIR/cases, what is hidden in DIR/labels (only the
score reads it), reports in DIR/results, the score in DIR/score.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from fnmatch import fnmatch
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.append(
    str(Path(__file__).resolve().parents[1] / "hidden_effects")
)  # how reports are judged, not how cases are made

from discovering import run_case
from draws import suite
from secret import make
from studies import write
from tally import scored, words

LIMIT = 4.0 * 3600.0
"""s of the clock, after which a case is given up; a machine that does other things too is slow."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", default="", help="names, or patterns of names or kinds: c01*,pair")
    parser.add_argument("--generate-only", action="store_true")
    parser.add_argument("--score-only", action="store_true")
    parser.add_argument("--keep", action="store_true", help="write the score to tools/second_generator/score.json, too")
    args = parser.parse_args()
    patterns = [text for text in args.cases.split(",") if text]
    specs = [
        spec
        for spec in suite(args.seed)
        if not patterns or any(fnmatch(text, p) for text in (spec.name, spec.kind) for p in patterns)
    ]
    for i, spec in enumerate(specs if not args.score_only else []):
        if not (args.out / "labels" / f"{spec.name}.json").is_file():
            write(make(spec), args.out)
        result = args.out / "results" / spec.name
        if not args.generate_only and not (result / "run.json").is_file():
            told = run_case(args.out / "cases" / spec.name / "study.toml", result, limit=LIMIT)
            took = f"{told['seconds']:.0f} s"
            print(f"{i + 1}/{len(specs)} {spec.name}: {(told['error'] or took).splitlines()[-1]}", flush=True)
    if args.generate_only:
        return
    found = scored(args.out, [spec.name for spec in specs], args.seed, len(suite(args.seed)))
    text = json.dumps(found, indent=1) + "\n"
    for path in (args.out / "score.json", *([Path(__file__).with_name("score.json")] if args.keep else [])):
        path.write_text(text, encoding="utf-8")
    print(words(found))


if __name__ == "__main__":
    main()
