"""Sends damaged and hostile inputs through the commands, kills them at any moment, and counts what became of it.

    python tools/attack.py                      10 000 inputs, 200 kills; the table goes to tools/attack.md and attack.json
    python tools/attack.py --inputs 500 --kills 0 -o /tmp/attack
    python tools/attack.py --show 4711          one case again, told in full

Goes on where it was broken off: outcomes lie in FOLDER/outcomes.jsonl, one line a case. Inputs with a bad outcome lie in
FOLDER/bad, named by their class. Generators and judge are those of tests/hostile. Needs Linux.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import time
import traceback
from collections import Counter
from dataclasses import asdict
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "hostile")]

from generators import KINDS, Maker, Workshop, case  # noqa: E402
from judge import BAD, CLASSES, GOOD, Judge  # noqa: E402
from kills import SCENARIOS, Killer, Scenario  # noqa: E402

EXPLAINED = """An input is counted once, by the worst of what its commands made of it. The first four columns are as it
should be:

- *clean error*: exit 2 and one message. *same result*: the numbers of the whole file.
- *another valid file*: what was changed lies under no checksum of its format, and the numbers are those that now
  stand there: a strict CSV reader of the test's own finds the same; or only the stored numbers that were touched
  differ (in a compressed page of Parquet: those of the page); or all rows are there and a column or the time differs
  by a factor and an offset, as by a changed unit or increment; or whole segments of TDMS are gone. Files that an
  author made hostile and sealed himself are counted here, too, when they are accepted: what they say is then what
  they mean.
- *different, said*: other numbers, and damage, repair or what is left out stands in the output or in the result's
  metadata.

*memory*: more than 1 GB beyond the imported program, all processes together (a solver is given 900 MB here, where
fmucorrect would give it half of the machine's memory). *hang*: more than 20 s (60 s for `wrap`, which compiles; 90 s
for a solver, which may take 60 s to start), of which half computing, or three times as long. *temporary file*: left
in the folder for temporary files, beside the input, or beside the result. A kill is SIGKILL, SIGTERM or Ctrl-C at a
random moment; then the same command runs again and must give what an undisturbed run gives, byte for byte. Commands,
and the processes in which they read files and run solvers, are forked from one that has the program imported.
"""
Kinds = tuple[tuple[int, Maker], ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--killed", default="", help="kills of these commands alone, as run,replay")
    parser.add_argument("--seed", type=int, default=37)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--only", default="", help="inputs of these makers alone, as hostile_fmu,toml")
    parser.add_argument("--show", type=int, help="run this one case again and tell all of it")
    parser.add_argument("--note", default="", help="a sentence for the table, as why there are fewer inputs")
    parser.add_argument("--commit-table", action="store_true", help="write tools/attack.md and tools/attack.json")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/attack"))
    options = parser.parse_args()
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("XDG_CACHE_HOME", str(out / "cache"))
    workshop = Workshop(out / "seeds")
    if options.show is not None:
        show(workshop, options.show, options.seed, out)
        return
    kinds = tuple(
        (weight, make) for weight, make in KINDS if not options.only or make.__name__ in options.only.split(",")
    )
    log = out / "outcomes.jsonl"
    done = {row["number"] for row in rows(log) if row["seed"] == options.seed}
    todo = [number for number in range(options.inputs) if number not in done]
    attack(workshop, todo, options.seed, options.workers, out, kinds)
    killed = sum(row["seed"] == options.seed and row["number"] < 0 for row in rows(log))
    scenarios = [one for one in SCENARIOS if not options.killed or one.name in options.killed.split(",")]
    kill(range(killed, options.kills), options.seed, out, scenarios)
    text = table(rows(log))
    print(text)
    if options.commit_table:
        write_table(rows(log), ROOT / "tools", options.note)


def attack(workshop: Workshop, todo: list[int], seed: int, workers: int, out: Path, kinds: Kinds) -> None:
    """The cases, dealt to worker processes."""
    if not todo:
        return
    _ = workshop.record_seeds, workshop.corrector, workshop.fmus  # made once, before the workers part
    children = []
    for worker in range(workers):
        pid = os.fork()
        if pid == 0:
            code = 1
            try:
                work(workshop, todo[worker::workers], seed, out / f"worker{worker}", out, kinds)
                code = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)
        children.append(pid)
    for pid in children:
        os.waitpid(pid, 0)


def work(workshop: Workshop, numbers: list[int], seed: int, folder: Path, out: Path, kinds: Kinds) -> None:
    judge, begun = Judge(folder), time.monotonic()
    try:
        with (out / "outcomes.jsonl").open("a", buffering=1, encoding="utf-8") as log:
            for i, number in enumerate(numbers):
                outcome = judge.judge(case(workshop, number, seed, kinds), out / "bad")
                log.write(json.dumps({"number": number, "seed": seed, **asdict(outcome)}) + "\n")
                if outcome.bad:
                    print(
                        f"{number}: {outcome.outcome}: {outcome.kind}, {outcome.what}: {outcome.detail}"[:400],
                        flush=True,
                    )
                if i % 200 == 199:
                    print(
                        f"-- {i + 1} of {len(numbers)}, {(i + 1) / (time.monotonic() - begun):.1f} a second", flush=True
                    )
    finally:
        judge.close()


def kill(numbers: range, seed: int, out: Path, scenarios: list[Scenario]) -> None:
    """Kills; in the log their numbers are negative."""
    killer = Killer(out / "kills")
    with (out / "outcomes.jsonl").open("a", buffering=1, encoding="utf-8") as log:
        for number in numbers:
            outcome = killer.kill(random.Random(f"{seed} kill {number}"), scenarios)
            log.write(json.dumps({"number": -1 - number, "seed": seed, **asdict(outcome)}) + "\n")
            if outcome.bad:
                print(
                    f"kill {number}: {outcome.outcome}: {outcome.kind}, {outcome.what}: {outcome.detail}"[:400],
                    flush=True,
                )


def rows(log: Path) -> list[dict]:
    if not log.exists():
        return []
    return [json.loads(line) for line in log.read_text("utf-8").splitlines()]


def table(found: list[dict]) -> str:
    """Kind against class, as Markdown."""
    counts = Counter((row["kind"], row["outcome"]) for row in found)
    kinds = sorted({row["kind"] for row in found})
    order = [*reversed(GOOD), *BAD]
    lines = ["| input | " + " | ".join(order) + " | all |", "|---" * (len(order) + 2) + "|"]
    for kind in [*kinds, ""]:
        cells = [sum(counts[one, name] for one in (kinds if not kind else [kind])) for name in order]
        lines.append(f"| {kind or '**all**'} | " + " | ".join(map(str, cells)) + f" | {sum(cells)} |")
    return "\n".join(lines)


def commit() -> str:
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def write_table(found: list[dict], folder: Path, note: str) -> None:
    """attack.json and attack.md."""
    counts = Counter((row["kind"], row["outcome"]) for row in found)
    kinds = sorted({row["kind"] for row in found})
    inputs, kills = ([row for row in found if (row["number"] < 0) == killed] for killed in (False, True))
    data = {
        "commit": commit(),
        "date": date.today().isoformat(),
        "seeds": sorted({row["seed"] for row in found}),
        "inputs": len(inputs),
        "kills": len(kills),
        "commands": sum(len(row["each"]) or 1 for row in found),
        "counts": {kind: {name: counts[kind, name] for name in CLASSES if counts[kind, name]} for kind in kinds},
    }
    (folder / "attack.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    seeds = ", ".join(map(str, data["seeds"]))
    (folder / "attack.md").write_text(
        f"# Damaged and hostile inputs, and kills\n\n`python tools/attack.py --commit-table` at {data['commit']}, "
        f"{data['date']}, seed {seeds}: {len(inputs)} inputs through {data['commands']} commands, {len(kills)} kills. "
        f"{note}\n\n"
        f"{EXPLAINED}\n{table(inputs)}\n\n{table(kills)}\n",
        encoding="utf-8",
    )


def show(workshop: Workshop, number: int, seed: int, out: Path) -> None:
    judge = Judge(out / "shown")
    try:
        outcome = judge.judge(case(workshop, number, seed), out / "bad")
    finally:
        judge.close()
    print(json.dumps(asdict(outcome), indent=1))
    for name in ("out.txt", "err.txt"):
        print(f"--- {name}\n{(judge.folder / name).read_text('utf-8', 'replace')}")


if __name__ == "__main__":
    main()
