"""The gallery's plants: what each is called, how its study is made and trained on.

Every study is made into a folder, from the virtual rig's own tool, a tool that draws or writes plants, or data that nobody
here wrote.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ROOT / "tools"
sys.path += [str(TOOLS), str(TOOLS / "virtual_rig"), str(TOOLS / "hidden_effects")]
import compare_models  # noqa: E402
import excitation  # noqa: E402
import generate  # noqa: E402
import making  # noqa: E402
import quarter_car  # noqa: E402
import random_rigs  # noqa: E402
import specs  # noqa: E402
import writing  # noqa: E402

from fmucorrect.discovery.augmented import toml  # noqa: E402
from fmucorrect.study import Study  # noqa: E402
from fmucorrect.study_training import Training  # noqa: E402

RIGS = {f"rig {letter}": letter for letter in "ABC"}
RANDOM = {f"random rig {seed}": seed for seed in range(1000, 1012)}
CARS = {f"quarter car, {kind}": kind for kind in quarter_car.KINDS}
CHAIN = "two masses, hysteresis"
MEASURED = {
    "silverbox": "silverbox",
    "bouc_wen": "bouc_wen",
    "friction_damper_backlash": "rotary",
    "mr_damper": "mr_damper",
    "emps": "emps",
}
"""Data of others (bouc_wen is simulated, the rest measured), and what tools/real_data calls them."""
PLANTS = (*RIGS, *CARS, CHAIN, *MEASURED, *RANDOM)
QUICK_TO_NAME = (*CARS, CHAIN, *MEASURED)
"""Plants of which a discovery takes minutes."""

ELSEWHERE = 340.0
"""km/h at which rig C is excited otherwise: a trained speed, so that the excitation alone is new."""
FREQUENCIES = (0.7, 1.5, 3.0)  # Hz; trained are 2 Hz and sweeps
LOW, HIGH = 0.5, 4.0  # Hz, of the random excitation
LEVELS = {
    "sweep_low": ("sweep_high", 0.3, "development"),
    "sweep_middle": ("sweep_high", 0.6, "development"),
    "sweep_high": ("sweep_high", 1.0, "development"),
    "random_low": ("random", 0.5, "development"),
    "random": ("random", 1.0, "development"),
    "sweep_between": ("sweep_high", 0.8, "evaluation"),
    "random_between": ("random", 0.75, "evaluation"),
}
"""Of the chain: the bench's run that is repeated, factor on its push, role."""
HYSTERESIS = specs.Spec(
    *("two_masses_hysteresis", "two_soft", "single", 0.01, False),
    effects=(specs.Wanted("bouc_wen_hysteresis", "joint 2", 0.3),),
    recorded="command",
)
"""What is hidden in the chain moves its worse channel by 30 %; noise of 1 %."""


def made_by(plant: str) -> str:
    """A digest of what makes the plant's study and trains on it."""
    package, rigs, chains = ROOT / "fmucorrect", ROOT / "fmus" / "roller_rig", ROOT / "fmus" / "oscillator"
    files = [*(package / "training").glob("*.py"), *package.glob("study_training*.py"), Path(__file__)]
    shaken = [path for path in (TOOLS / "virtual_rig").iterdir() if path.suffix in (".py", ".c", ".toml")]
    shaken += [rigs / "roller_rig.fmu", TOOLS / "compare_models.py"]
    if plant in RIGS:
        files += [*shaken, rigs / RIGS[plant] / "study.toml"]
    elif plant in RANDOM:
        files += [*shaken, TOOLS / "random_rigs.py"]
    elif plant in CARS:
        files += [TOOLS / "quarter_car.py"]
    elif plant == CHAIN:
        files += [
            *(TOOLS / "hidden_effects").glob("*.py"),
            TOOLS / "hidden_effects" / "truth.c",
            chains / "oscillator.fmu",
        ]
    else:
        files += [TOOLS / "real_data" / f"{name}.py" for name in ("make", "real_study", MEASURED[plant])]
        files += [chains / "oscillator.fmu"]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def study_of(plant: str, folder: Path) -> Path:
    """The study's path in `folder`; it is made where it is not there."""
    path = folder / "study.toml"
    if path.is_file():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    if plant == "rig C":
        return _excited_otherwise(RIGS[plant], folder)
    if plant in RIGS:
        return ROOT / "fmus" / "roller_rig" / RIGS[plant] / "study.toml"
    if plant in RANDOM:
        shaken = random_rigs.Plant()
        random_rigs.write_study(random_rigs.draw(RANDOM[plant], shaken), folder, shaken)
        return path
    if plant in CARS:
        return quarter_car.write(folder, CARS[plant])
    if plant == CHAIN:
        return _chain(folder)
    make = [sys.executable, str(TOOLS / "real_data" / "make.py"), MEASURED[plant], "--out", str(folder)]
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    return path


def training_of(plant: str, study: Study) -> Training:
    """The study's own; random rigs are many, and trained as shortly as their own tool does it."""
    if plant not in RANDOM:
        return study.training
    return replace(study.training, corrector=replace(study.training.corrector, epochs=(random_rigs.EPOCHS,)))


def _excited_otherwise(letter: str, folder: Path) -> Path:
    """A rig's study with further conditions to be held out, measured by the rig's own tool: at ELSEWHERE, random and tones."""
    rig = tomllib.loads((TOOLS / "virtual_rig" / f"{letter}.toml").read_text(encoding="utf-8"))
    study = ROOT / "fmus" / "roller_rig" / letter / "study.toml"
    size, quiet = generate.AMPLITUDE, f"start = {generate.START}\nquiet = [0.0, 9.5]"
    rng = excitation.np.random.default_rng(rig["seed"])
    wave = size * excitation.multisine(generate.END, generate.START, LOW, HIGH, generate.STEP, rng)
    runs = {
        1: generate.Run("random", ELSEWHERE, wave, "random.csv", "evaluation", f"amplitude = {size}\n{quiet}"),
    }
    for number, f in enumerate(FREQUENCIES, start=2):
        told = f"amplitude = {size}\nfrequency = {f}\n{quiet}"
        tone = generate.tone(size, rig["surge"], f)
        runs[number] = generate.Run(f"{f:g} Hz", ELSEWHERE, tone, f"tone_{f:g}_Hz.csv", "evaluation", told)
    document = compare_models.absolute(tomllib.loads(study.read_text(encoding="utf-8")), study.parent)
    document["conditions"] += compare_models.measured(rig, runs, folder)
    (folder / "study.toml").write_text(toml(document), encoding="utf-8", newline="\n")
    return folder / "study.toml"


def _chain(folder: Path) -> Path:
    """Two masses of the hidden-effect suite, pushed as LEVELS say, with HYSTERESIS that the model does not have."""
    made = making.make(HYSTERESIS)
    known = {run.name: run for run in made.bench.runs}
    runs = tuple(
        replace(
            known[like],
            name=name,
            role=role,
            inputs={key: factor * series for key, series in known[like].inputs.items()},
        )
        for name, (like, factor, role) in LEVELS.items()
    )
    bench = replace(made.bench, runs=runs)
    rng = making.np.random.default_rng(making.seed_of(HYSTERESIS.name))
    for run in runs:
        writing.write_series(bench, run, folder / f"inputs_{run.name}.csv")
        writing.write_record(
            bench, HYSTERESIS, *making.measure(made, run, rng), folder / f"measured_{run.name}.parquet"
        )
    text = writing.study(bench, HYSTERESIS, made.noise)
    fmu = ROOT / "fmus" / bench.fmu.removesuffix(".fmu") / bench.fmu
    text = text.replace(json.dumps(f"../../fmus/{bench.fmu}"), json.dumps(str(fmu)))
    (folder / "study.toml").write_text(text, encoding="utf-8", newline="\n")
    return folder / "study.toml"
