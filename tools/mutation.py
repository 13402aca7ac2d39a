"""Would the tests notice? python tools/mutation.py [--count 300] [--seed 1] [--only GROUP] [--again] [--table]

Draws places in the code at random, changes each in one way (the operators of cosmic-ray: another sign, another comparison,
a number one more or less, a condition turned round, a loop left out, ...), and runs the tests nearest to it on a copy of the
working tree. A mutant is killed when they fail or do not come to an end. The rows go to tools/mutation.jsonl, one a mutant,
as soon as they are there; a run that was stopped goes on where it was, and --again runs those anew that survived. What is
said of survivors stands in tools/mutation_survivors.toml. Those that no test can tell from the code (equivalent) count as
survivors all the same, and the table (tools/mutation.md) tells the figures with and without them.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
ROWS, SAID_OF, TABLE = (ROOT / "tools" / f"mutation{end}" for end in (".jsonl", "_survivors.toml", ".md"))
PATIENCE = (20.0, 5.0)
"""The tests of a mutant may take as many seconds, or as many times what they take on the code as it is."""
MEMORY = 8 << 30
"""Bytes of address space that the tests of a mutant may take; one that collects for ever ends there."""
SAID = "said.txt"
"""What the tests said, in the copy."""
PRELOADED = [
    "numpy",
    "scipy.signal",
    "scipy.interpolate",
    "scipy.stats",
    "hypothesis",
    "pytest",
    "jaxtyping",
    "beartype",
]
"""Imported once, in the process that those of the mutants are forked from."""
LEFT_OUT = ("ZeroIterationForLoop_NoOp", "VariableReplacer", "VariableInserter", "NoOp")
"""Operators that are not drawn: they want to be told a variable, or change nothing."""


@dataclass(frozen=True)
class Group:
    """files: below fmucorrect/. tests: pytest's arguments, the likeliest to fail first. preload: more of PRELOADED."""

    files: tuple[str, ...]
    tests: tuple[str, ...]
    preload: tuple[str, ...] = ()


GROUPS: Mapping[str, Group] = {
    "units": Group(("units.py",), ("tests/test_units.py", "tests/test_signals.py")),
    "signals": Group(("signals.py",), ("tests/test_signals.py",)),
    "metrics": Group(("metrics.py",), ("tests/test_metrics.py",)),
    "stepper": Group(("stepper.py",), ("tests/test_stepper.py",)),
    "registration": Group(
        ("registration.py",),
        ("tests/test_registration_truth.py", "tests/test_registration.py", "-k=not hold_95_percent"),
    ),
    "evidence": Group(("discovery/evidence.py",), ("tests/discovery/test_evidence.py",)),
    "laws as C": Group(
        ("wrapping/laws.py",),
        (
            "tests/wrapping/test_laws_as_c.py::test_the_wiring_names_what_each_law_needs",
            "tests/wrapping/test_laws_as_c.py",
            "-k=not 0.0 and not 0.2 and not another_process and not other_compilers",
        ),
        ("sympy",),
    ),
    "network as C": Group(
        ("wrapping/network.py",),
        ("tests/wrapping/test_network.py", "-k=shipped-0 or generation or allocated or operator or another_compiler"),
        ("onnx", "torch", "onnxruntime"),
    ),
    "tables as C": Group(
        ("wrapping/generated.py", "wrapping/wiring.py"),
        ("tests/wrapping/test_tables_as_c.py",),
        ("onnx", "onnxruntime"),
    ),
    "time base": Group(
        ("records/timebase.py",), ("tests/records/test_time_by_hand.py", "tests/records/test_timebase.py")
    ),
    "MCAP": Group(
        tuple(f"records/{name}.py" for name in ("mcap", "mcap_writer", "decode", "bulk", "chunks", "cdr", "columns")),
        (
            *("tests/records/test_mcap.py", "tests/records/test_encodings.py", "tests/records/test_damage.py"),
            "-k=not framing and not cut_anywhere and not memory and not killed",
        ),
    ),
    "CSV": Group(
        ("records/csv.py", "records/seconds.py"),
        (
            "tests/records/test_stamps.py",
            "tests/records/test_csv.py",
            "tests/records/test_formats.py",
            "-k=(csv or seconds or stamps) and not cut and not mf4 and not parquet and not tdms",
        ),
    ),
}


@dataclass(frozen=True)
class Mutant:
    """One change. at: line and column, from 1 and 0. old, new: the line before and after (a decorator's with the next one).
    code: the whole changed file."""

    group: str
    file: str
    operator: str
    at: tuple[int, int]
    old: str
    new: str
    code: str

    @property
    def name(self) -> str:
        """The same in every version of the file in which the line is the same."""
        return f"{self.file}: {self.old} -> {self.new}"


def mutants(group: str, count: int, seed: int) -> Iterator[Mutant]:
    """As many as `count`, all different: a place drawn evenly from those of the group, then one of the changes there."""
    from cosmic_ray.mutating import mutate_code

    places: dict[tuple[str, tuple[int, int]], list[tuple[str, Any, int]]] = {}
    for file in GROUPS[group].files:
        code = (ROOT / "fmucorrect" / file).read_text(encoding="utf-8")
        for at, change in _changes(code):
            places.setdefault((file, at), []).append(change)
    draw = random.Random(f"{group} {seed}")
    seen: set[str] = set()
    while places and len(seen) < count:
        (file, at), changes = place = draw.choice(sorted(places.items(), key=lambda item: item[0]))
        name, operator, occurrence = changes.pop(draw.randrange(len(changes)))
        if not changes:
            del places[place[0]]
        code = (ROOT / "fmucorrect" / file).read_text(encoding="utf-8")
        try:
            changed = mutate_code(code, operator, occurrence)
        except AttributeError:  # cosmic-ray does not replace exceptions with a dot in their name
            continue
        if changed is None or changed == code:
            continue
        lines = code.split("\n")
        old, new = lines[at[0] - 1].strip(), changed.split("\n")[at[0] - 1].strip()
        if name == "RemoveDecorator":
            old, new = f"{old} {lines[at[0]].strip()}", lines[at[0]].strip()
        mutant = Mutant(group, file, name, at, old, new, changed)
        if mutant.name not in seen:
            seen.add(mutant.name)
            yield mutant


def _changes(code: str) -> Iterator[tuple[tuple[int, int], tuple[str, Any, int]]]:
    """Places (line, column) of code that is run, and what can be done there: operator and its occurrence in the file."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.operators.provider import OperatorProvider

    idle = _annotations(code)
    nodes = list(ast_nodes(get_ast(code)))
    provider = OperatorProvider()
    for name in sorted(provider):
        if name in LEFT_OUT:
            continue
        operator = provider[name]()
        positions = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, at in enumerate(positions):
            if not any(first <= at < last for first, last in idle):
                yield at, (name, operator, occurrence)


def _annotations(code: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Where annotations stand: with `from __future__ import annotations` they are text, and no change of them can matter."""
    found: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.arg() | ast.AnnAssign():
                found.append(node.annotation)
            case ast.FunctionDef():
                found.append(node.returns)
            case _:
                pass
    return [
        ((node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)) for node in found if node
    ]


def copy_tree(folder: Path) -> Path:
    """The working tree as git sees it, with the folder shared/ that stands beside the checkout. Returns the copy's root."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    root = folder / "of" / "tree"
    for name in subprocess.run(listed, cwd=ROOT, capture_output=True, check=True, text=True).stdout.split("\0"):
        if name and (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
    for up in (1, 2):
        shared = ROOT.parents[up] / "shared"
        if shared.is_dir() and not (folder / "shared").exists():
            (folder / "shared").symlink_to(shared)
            (folder / "of" / "shared").symlink_to(shared)
    return root


def judge(root: Path, file: str, arguments: Sequence[str], patience: float, as_it_is: bool) -> tuple[str, float]:
    """Runs pytest in the copy: "passed", "failed" or "timeout", and the seconds that it took."""
    begin = time.monotonic()
    process = multiprocessing.get_context("forkserver").Process(target=_pytest, args=(root, file, arguments, as_it_is))
    process.start()
    process.join(patience)
    running = process.is_alive()
    if process.pid:  # with what the tests themselves have started
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.join()
    verdict = "timeout" if running else "passed" if process.exitcode == 0 else "failed"
    return verdict, time.monotonic() - begin


def _pytest(root: Path, file: str, arguments: Sequence[str], as_it_is: bool) -> None:
    os.setsid()
    os.chdir(root)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    sys.path.insert(0, str(root))
    os.environ["PYTHONPATH"] = str(root)
    os.environ["FMUCORRECT_CHECKED"] = f"fmucorrect.{file.removesuffix('.py').replace('/', '.')}"  # tests/conftest.py
    if not as_it_is:  # what is compiled of a mutant would outlive it
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = not as_it_is
    with (root / SAID).open("w") as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
    import pytest

    # the same examples for every mutant, and none remembered from one to the next
    sys.exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", *arguments]))


def read_rows(seed: int, first: bool = False) -> dict[str, dict[str, Any]]:
    """The rows of earlier runs of this seed by the mutant's name; the last one of a name holds, or the first."""
    if not ROWS.exists():
        return {}
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()]
    ordered = reversed(rows) if first else rows
    return {f"{row['file']}: {row['old']} -> {row['new']}": row for row in ordered if row["seed"] == seed}


def run(group: str, count: int, seed: int, again: bool) -> None:
    """Runs what has no row yet, and with `again` what survived."""
    known = read_rows(seed)
    todo = [
        mutant
        for mutant in mutants(group, count, seed)
        if mutant.name not in known or (again and known[mutant.name]["verdict"] == "survived")
    ]
    if not todo:
        return
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    with tempfile.TemporaryDirectory() as folder:
        root = copy_tree(Path(folder))
        arguments = [
            word for word in GROUPS[group].tests if word.startswith("-") or (root / word.split("::")[0]).exists()
        ]
        first = GROUPS[group].files[0]
        judge(root, first, arguments, 1200.0, as_it_is=True)
        verdict, seconds = judge(root, first, arguments, 1200.0, as_it_is=True)
        print(f"{group}: as it is: {verdict} in {seconds:.1f} s", flush=True)
        if verdict != "passed":
            sys.exit(f"{(root / SAID).read_text()}\nthe tests of {group} fail without a change")
        for mutant in todo:
            file = root / "fmucorrect" / mutant.file
            kept = file.read_bytes()
            for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
                stale.unlink()
            file.write_text(mutant.code, encoding="utf-8")
            verdict, took = judge(root, mutant.file, arguments, max(PATIENCE[0], PATIENCE[1] * seconds), as_it_is=False)
            file.write_bytes(kept)
            row = asdict(mutant) | {
                "verdict": {"passed": "survived", "failed": "killed"}.get(verdict, verdict),
                "seconds": round(took, 1),
                "seed": seed,
                "commit": commit.stdout.strip(),
            }
            del row["code"]
            with ROWS.open("a", encoding="utf-8") as rows:
                rows.write(json.dumps(row) + "\n")
            print(f"{row['verdict']:9}{took:6.1f} s  {mutant.name}", flush=True)


def table(seed: int) -> str:
    """Markdown: the figures of each group, then every survivor with what is said of it."""
    known = read_rows(seed)
    said: dict[str, dict[str, str]] = tomllib.loads(SAID_OF.read_text(encoding="utf-8")) if SAID_OF.exists() else {}
    reasons, seen = said.get("equivalent", {}), said.get("looked_at", {})
    lines = [
        "| code | tests | mutants | killed | timeout | survived | of these equivalent |",
        "|---|---|---|---|---|---|---|",
    ]
    survivors: list[str] = []
    total: Counter[str] = Counter()
    for group in GROUPS:
        count: Counter[str] = Counter()
        for name, row in known.items():
            if row["group"] != group:
                continue
            count[row["verdict"]] += 1
            if row["verdict"] == "survived":
                reason = reasons.get(name)
                count["equivalent"] += reason is not None
                survivors.append(
                    f"- `{row['file']}:{row['at'][0]}` {row['operator']}: `{row['old']}` → `{row['new']}`: "
                    + (f"equivalent: {reason}" if reason else f"**not noticed**: {seen.get(name, 'not looked at')}")
                )
        ran = count["killed"] + count["timeout"] + count["survived"]
        words = (group, " ".join(GROUPS[group].tests), ran, *(count[key] for key in ("killed", "timeout", "survived")))
        lines.append(f"| {' | '.join(map(str, (*words, count['equivalent'])))} |")
        total.update(count)
    ran = total["killed"] + total["timeout"] + total["survived"]
    noticed = total["killed"] + total["timeout"]
    different = ran - total["equivalent"]
    words = ("**all**", "", ran, *(total[key] for key in ("killed", "timeout", "survived", "equivalent")))
    lines.append(f"| {' | '.join(map(str, words))} |")
    at_first = sum(row["verdict"] != "survived" for row in read_rows(seed, first=True).values())
    commits = ", ".join(sorted({row["commit"] for row in known.values()}))
    head = [
        "# Mutants",
        "",
        f"Written by `python tools/mutation.py --seed {seed}` at commit {commits}.",
        f"{noticed} of {ran} random mutants were noticed by the tests nearest to them: {100 * noticed / max(ran, 1):.1f} %; "
        f"{100 * noticed / max(different, 1):.1f} % of the {different} that are not equivalent to the code. "
        f"When they were first run these were {at_first}; tests for some of the survivors were added, and these run again.",
        "",
    ]
    return "\n".join([*head, *lines, "", "## Survivors", "", *(survivors or ["None."]), ""])


def main() -> None:
    parser = argparse.ArgumentParser(description="Change the code at random places and see whether the tests notice.")
    parser.add_argument("--count", type=int, default=300, help="mutants in all, the same number in each group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=list(GROUPS), help="this group; may be given several times")
    parser.add_argument("--again", action="store_true", help="run the survivors of an earlier run anew")
    parser.add_argument("--table", action="store_true", help="run nothing, write the table of what was run")
    arguments = parser.parse_args()
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"  # before numpy is imported
    if not arguments.table:
        chosen = arguments.only or list(GROUPS)
        multiprocessing.set_forkserver_preload(
            [*PRELOADED, *(name for group in chosen for name in GROUPS[group].preload)]
        )
        for group in chosen:
            run(group, -(-arguments.count // len(GROUPS)), arguments.seed, arguments.again)
    if arguments.table or not arguments.only:
        TABLE.write_text(table(arguments.seed), encoding="utf-8")
        print(TABLE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
