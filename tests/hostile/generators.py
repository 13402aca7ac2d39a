"""Cases by number: the same number and the same seed give the same input, whatever was run before."""

from __future__ import annotations

import random
import tomllib
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import archives
import damage
import networks
import seeds
import structures
import texts
import trees
from judge import Case

FEATURES = ("--speed", "300", "--amplitude", "0.03", "--frequency", "2", "--start", "0")
OUT = ("-o", "{out}/out.mcap")
SOLVER_MB, SOLVER_S = 900, 90.0
"""What a misbehaving solver may take here: fmucorrect would give it half of the machine's memory; its start may
take 60 s, in which others fetch a licence."""
SLOW = {".mf4": 0.3, ".mdf": 0.3}
"""Formats that are read by a process of their own, which takes seconds to start, come less often."""


class Workshop:
    """What cases are made of, written once into a folder. step_timeout: options that shorten the wait for a solver."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    @cached_property
    def corrector(self) -> Path:
        return seeds.corrector(self.folder)

    @cached_property
    def record_seeds(self) -> list[seeds.Seed]:
        return seeds.record_seeds(self.folder / "records")

    @cached_property
    def impatient(self) -> tuple[str, ...]:
        """Options of `run` that bound a solver's step, where there are such."""
        from fmucorrect.cli import main

        known = {name for option in main.commands["run"].params for name in option.opts}
        return ("--step-timeout", "3") if "--step-timeout" in known else ()

    @cached_property
    def fmus(self) -> list[seeds.Seed]:
        found = []
        for name in ("oscillator.fmu", "oscillator_fmi3.fmu"):
            path = self.folder / "fmus" / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(archives.slim(name))
            found.append(seeds.Seed(name, path))
        return found

    # records

    def record(self, suffix: str, data: bytes | Path, kind: str, what: str, **more: object) -> Case:
        """A record file through `inspect` and `replay`."""
        name = f"run{suffix}"
        replay = ("replay", name, "--corrector", "corrector.onnx", *FEATURES, "--unit", "mm", *OUT)
        files = {name: data, "corrector.onnx": self.corrector}
        return Case(kind, what, files, (("inspect", name, "--json"), replay), name, **more)  # type: ignore[arg-type]

    def damaged_record(self, rng: random.Random, seed: seeds.Seed | None = None) -> Case:
        seed = seed or rng.choices(self.record_seeds, [SLOW.get(one.suffix, 1.0) for one in self.record_seeds])[0]
        other = rng.choice([one for one in self.record_seeds if one.suffix == seed.suffix])
        found = damage.damaged(rng, seed.data, other.data, seed.suffix == ".csv")
        return self.record(
            seed.suffix, found.data, f"record {seed.suffix}", f"{seed.name}: {found.what}", seed=seed, damaged=found
        )

    def hostile_record(self, rng: random.Random) -> Case:
        suffix, data, what = rng.choice(structures.MAKERS)(rng)
        return self.record(suffix, data, f"hostile {suffix}", what)

    # TOML

    def study(self, text: str | bytes, what: str) -> Case:
        content = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
        files = {**texts.study_files(), "oscillator.fmu": self.fmus[0].path, "study.toml": content}
        run = ("run", "study.toml", "--condition", "a", "--duration", "0.02", *self.impatient, *OUT)
        return Case("TOML study", what, files, (("inspect", "study.toml"), run), "study.toml")

    def toml(self, rng: random.Random) -> Case:
        kind = rng.choices(("study", "effects", "mapping"), (5, 3, 3))[0]
        text = {"study": texts.STUDY, "effects": texts.EFFECTS, "mapping": texts.MAPPING}[kind]
        if rng.random() < 0.65:
            tree, what = trees.mutated(rng, tomllib.loads(text), trees.TOML_ONLY)
            content = trees.toml(tree).encode("utf-8", "surrogatepass")
        else:
            found = damage.damaged(rng, text.encode(), texts.EFFECTS.encode(), True)
            content, what = found.data, found.what
        if kind == "study":
            return self.study(content, what)
        if kind == "effects":
            command = ("read-effects", "effects.toml")
            if rng.random() < 0.06:
                command = (
                    "wrap",
                    "oscillator.fmu",
                    "--effects",
                    "effects.toml",
                    "--platforms",
                    "linux64",
                    "-o",
                    "{out}/out.fmu",
                )
            return Case(
                "TOML effects",
                what,
                {"effects.toml": content, "oscillator.fmu": self.fmus[0].path},
                (command,),
                "effects.toml",
            )
        rig = texts.FMUS / "roller_rig" / "roller_rig.fmu"
        command = ("read-mapping", "assess.toml")
        if rng.random() < 0.1:
            command = ("assess", "preload", "assess.toml", "-o", "{out}/out")
        return Case("TOML mapping", what, {"assess.toml": content, "roller_rig.fmu": rig}, (command,), "assess.toml")

    # bundles

    def bundle(self, data: bytes, kind: str, what: str, wrapped: bool, **more: object) -> Case:
        replay = ("replay", "run.csv", "--corrector", "model.onnx", *FEATURES, *OUT)
        commands = [("inspect", "model.onnx"), replay]
        if wrapped:
            commands.append(("wrap", "--corrector", "model.onnx", "--platforms", "linux64", "-o", "{out}/out.fmu"))
        log = next(seed.path for seed in self.record_seeds if seed.name == "own.csv")
        return Case(kind, what, {"model.onnx": data, "run.csv": log}, commands, "model.onnx", **more)  # type: ignore[arg-type]

    def damaged_bundle(self, rng: random.Random) -> Case:
        seed = seeds.Seed("toy.onnx", self.corrector)
        found = damage.damaged(rng, seed.data, seed.data, rng.random() < 0.3)
        return self.bundle(found.data, "bundle, bytes", found.what, False, seed=seed, damaged=found)

    def hostile_bundle(self, rng: random.Random) -> Case:
        change = networks.hostile_metadata if rng.random() < 0.6 else networks.hostile_graph
        data, what = change(rng, self.corrector.read_bytes())
        return self.bundle(data, f"bundle, {what.partition(':')[0]} sealed anew", what, rng.random() < 0.08)

    # FMUs

    def fmu(self, data: bytes, kind: str, what: str, **more: object) -> Case:
        files = {**texts.study_files(), "oscillator.fmu": data, "study.toml": texts.STUDY.encode()}
        run = ("run", "study.toml", "--condition", "a", "--duration", "0.02", *self.impatient, *OUT)
        return Case(kind, what, files, (("inspect", "oscillator.fmu"), run), "oscillator.fmu", **more)  # type: ignore[arg-type]

    def damaged_fmu(self, rng: random.Random) -> Case:
        seed = rng.choice(self.fmus)
        found = damage.damaged(rng, seed.data, self.fmus[0].data)
        return self.fmu(found.data, "FMU, bytes", found.what, seed=seed, damaged=found)

    def hostile_fmu(self, rng: random.Random) -> Case:
        makers = (archives.hostile_xml, archives.hostile_entries, archives.damaged_library)
        data, what = rng.choices(makers, (5, 3, 4))[0](rng, rng.choice(self.fmus).data)
        return self.fmu(data, f"FMU, {what.partition(':')[0]}", what)

    def misbehaving_fmu(self, rng: random.Random) -> Case:
        return self.solver(rng.choice(archives.WHERE[:-1]), rng.choice(archives.WHAT))

    def solver(self, where: str, what: str) -> Case:
        """A solver that does it there."""
        data = archives.misbehaving(self.folder / "libraries", where, what)
        files = {"model.fmu": data, "study.toml": archives.STUDY.encode(), "measured.csv": archives.MEASURED}
        run = ("run", "study.toml", "--condition", "a", *self.impatient, *OUT)
        commands = (("inspect", "model.fmu"), run)
        return Case(
            "FMU, solver", f"{what} in {where}", files, commands, "model.fmu", data_mb=SOLVER_MB, timeout=SOLVER_S
        )


Maker = Callable[[Workshop, random.Random], Case]
KINDS: tuple[tuple[int, Maker], ...] = (
    (55, Workshop.damaged_record),
    (13, Workshop.hostile_record),
    (12, Workshop.toml),
    (4, Workshop.damaged_bundle),
    (6, Workshop.hostile_bundle),
    (3, Workshop.damaged_fmu),
    (5, Workshop.hostile_fmu),
    (2, Workshop.misbehaving_fmu),
)
"""Weight and maker."""


def case(workshop: Workshop, number: int, seed: int, kinds: tuple[tuple[int, Maker], ...] = KINDS) -> Case:
    rng = random.Random(f"{seed} {number}")
    return rng.choices([make for _, make in kinds], [weight for weight, _ in kinds])[0](workshop, rng)
