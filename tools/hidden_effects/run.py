"""The hidden-effect suite in three steps: cases whose truth is known are made, discovered from, and scored.

    python tools/hidden_effects/run.py --out DIR                       # all of it: hours on two cores
    python tools/hidden_effects/run.py --out DIR --subset quick        # ten chains of masses
    python tools/hidden_effects/run.py --out DIR --generate-only       # cases and labels alone, minutes
    python tools/hidden_effects/run.py --out DIR --score-only          # what was run so far

Cases lie in DIR/cases, what is hidden in DIR/labels (only the scoring reads it), reports in DIR/results, the score in
DIR/score.md and score.json. What is there is not made again: a suite that was stopped goes on (--again: from the
start).

How the score is formed (judging.py has it word by word): a case scores 1 for exactly the hidden effects at their
joints, 0.5 for `ambiguous` with classes of at most three that hold them, else 0. Cases whose effect leaves no mark
above the noise score 1 only for `none` or `ambiguous`. Names of one and the same equation count as equal; a line of the
table says how it is without that.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from fnmatch import fnmatch
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [sys.path[1], os.environ.get("PYTHONPATH")]))

import discovering
import looking_again
import making
from cases import subset
from specs import Spec
from table import write_score


def generate(specs: Sequence[Spec], folder: Path, workers: int) -> None:
    """Cases and labels that are not there yet."""
    wanted = [spec for spec in specs if not (folder / "labels" / f"{spec.name}.json").is_file()]
    if workers == 1:
        for spec in wanted:
            print(generate_one(spec, folder), flush=True)
        return
    with ProcessPoolExecutor(workers) as pool:
        for job in as_completed([pool.submit(generate_one, spec, folder) for spec in wanted]):
            print(job.result(), flush=True)


def generate_one(spec: Spec, folder: Path) -> str:
    """One case and its label. What came of it, in a line."""
    begun = time.perf_counter()
    made = making.make(spec)
    making.write(made, folder)
    told = [
        f"{e['effect']} at {e['joint']}, share {e['share']:.3f}, mark {e['mark']:.0f}" for e in made.label["effects"]
    ]
    return f"{spec.name} {spec.bench} {spec.kind} ({time.perf_counter() - begun:.1f} s): {'; '.join(told)}"


def discover(names: Sequence[str], folder: Path, workers: int, scheduler: str, ledgers: bool) -> None:
    """Reports that are not there yet."""
    left = [name for name in names if not (folder / "results" / name / "run.json").is_file()]
    run = (
        discovering.discover_there(left, folder, scheduler)
        if scheduler
        else discovering.discover_here(left, folder, workers, ledgers)
    )
    for i, (name, result) in enumerate(run):
        told = (result["error"] or "").splitlines()[-1:] or [f"{result['seconds']:.1f} s, {result['peak_mb']:.0f} MB"]
        print(f"{i + 1}/{len(left)} {name}: {told[0]}", flush=True)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--subset", choices=["quick", "oscillator", "rig", "all"], default="all")
    parser.add_argument("--cases", default="", help="names, or patterns of names or kinds: osc_00123,swe_*,null")
    parser.add_argument(
        "--seed", type=int, default=0, help="other cases of the same kinds, which nobody has tuned anything on"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", default="", metavar="ADDRESS", help="of a dask scheduler")
    parser.add_argument("--ledgers", action="store_true", help="keep what every search fitted, for rescore.py")
    parser.add_argument("--generate-only", action="store_true")
    parser.add_argument("--score-only", action="store_true")
    parser.add_argument("--look-again", action="store_true", help="simulate the tests that ambiguous reports ask for")
    parser.add_argument("--again", action="store_true", help="throw away the results of earlier runs first")
    args = parser.parse_args()
    patterns = [text for text in args.cases.split(",") if text]
    specs = [
        spec
        for spec in subset(args.subset, args.seed)
        if not patterns or any(fnmatch(text, p) for text in (spec.name, spec.kind) for p in patterns)
    ]
    names = [spec.name for spec in specs]
    if args.again:
        for name in names:
            shutil.rmtree(args.out / "results" / name, ignore_errors=True)
    if not args.score_only:
        generate(specs, args.out, args.workers)
    if args.generate_only:
        return
    if not args.score_only:
        discover(names, args.out, args.workers, args.scheduler, args.ledgers)
    after = looking_again.look(names, args.out, args.workers) if args.look_again else None
    print(write_score(args.out, names, after))


if __name__ == "__main__":
    main()
