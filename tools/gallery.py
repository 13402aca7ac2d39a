"""Correctors of many plants, as `fmucorrect train` makes them: python tools/gallery.py [PLANT...] [--seeds 3]

It writes exported_models/gallery.json, gallery.md and gallery.svg. Rigs A, B and C, C also under other excitation; a quarter
car over random roads that lacks friction, a stop or nothing; two masses with hysteresis; data of others (tools/real_data),
where they are there; twelve rigs drawn at random. For each: the error of the simulation as it is, of what anyone would try
first (gallery_baselines.py), of the corrector on conditions that were held out of everything, what its 90 % band holds and what
it flags; and what the named effects gave, where that stands in committed results.

Minutes to half an hour a plant and seed on two cores. Killed, it goes on from the folder .gallery; figures that this code has
made stay, others are made again (--any-code: stay, too), and those of plants that are not asked for stay as they are.
--discover names what the models of plants lack that are trained already, and trains on that; --page writes table and picture
of what is there.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tools"))
import gallery_baselines  # noqa: E402
import gallery_named  # noqa: E402
import gallery_page  # noqa: E402
import gallery_plants  # noqa: E402

from fmucorrect import bundle, outputs  # noqa: E402
from fmucorrect.comparison import BAND_90, Comparison  # noqa: E402
from fmucorrect.errors import FmucorrectError  # noqa: E402
from fmucorrect.metrics import score  # noqa: E402
from fmucorrect.pairs import Pair, pair  # noqa: E402
from fmucorrect.places import CORES  # noqa: E402
from fmucorrect.sealing import evaluate  # noqa: E402
from fmucorrect.stepper import Status  # noqa: E402
from fmucorrect.study import Study, load_study  # noqa: E402
from fmucorrect.study_training import Training  # noqa: E402
from fmucorrect.training.protocol import screened, total_epochs  # noqa: E402
from fmucorrect.training.results import train_into  # noqa: E402
from fmucorrect.training.tasks import Workshop  # noqa: E402

WORK = ROOT / ".gallery"
FIGURES = ROOT / "exported_models" / "gallery.json"
SCORE = "score.json"
"""Beside a study by tools/real_data: its published figures."""


def simple(study: Study, training: Training) -> dict[str, Any]:
    """Of every condition that is held out: the unit, the NRMSE (%) of the simulation and of each baseline, and its published
    figures."""
    development = screened(study).pairs
    held = [pair(study, condition) for condition in study.evaluation]
    said = {"bare": [item.response for item in held]}
    said |= gallery_baselines.responses(development, held, training)
    rows: dict[str, Any] = {}
    for i, item in enumerate(held):
        warm = np.arange(len(item.measured)) >= training.window - 1 - item.rows.start
        each = {name: values[i] for name, values in said.items()}
        rows[item.condition.name] = {
            "unit": study.channels[0].unit,
            "nrmse": {name: _nrmse(values, item.measured, warm) for name, values in each.items()},
            "published": {
                figure["name"]: {
                    "unit": figure["unit"],
                    "others": figure["published"],
                    **{
                        name: _figure(figure, item, np.where(np.isnan(values), item.response, values))
                        for name, values in each.items()
                    },
                    "% of range a unit": float(f"{_range_a_unit(figure, item):.6g}"),
                }
                for figure in _figures(study, item)
            },
        }
    return rows


def _nrmse(said: np.ndarray, measured: np.ndarray, warm: np.ndarray) -> float:
    """Behind what warms up, as everything is scored. warm: rows that count; said is NaN where it cannot say anything yet."""
    rows = warm & ~np.isnan(said).any(axis=1)
    return round(score(said[rows], measured[rows]).mean_nrmse, 4)


def _kept(path: Path, make: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """What `make` gives, kept in a file for a run that is killed before the first training is done."""
    if not path.is_file():
        outputs.write(path, json.dumps(make(*arguments)))
    return json.loads(path.read_text(encoding="utf-8"))


def trained(study: Study, training: Training, folder: Path, command: str) -> dict[str, Any]:
    """Train with one seed and score what comes out. folder: where models and unfinished work lie."""
    with tqdm(total=total_epochs(study, training), unit="epoch", desc=study.name, disable=None) as bar:
        workshop = Workshop(folder / "work", CORES, advance=bar.update)
        results = train_into(folder / f"seed_{training.seed}", study, training, command, workshop)
    selection = results.trained.selection
    held = {e.condition.name: _scored(study, e) for e in results.evaluations if e.condition.role == "evaluation"}
    model = bundle.load(results.folder / "corrector.onnx")
    for condition in study.evaluation:
        like = next((c for c in study.development if c.speed == condition.speed), condition)
        declared = replace(condition, amplitude=like.amplitude, frequency=like.frequency)
        if declared.features != condition.features:
            other = evaluate(replace(pair(study, condition), condition=declared), model)
            held[condition.name]["flagged as if excited as in development"] = _flagged(other)
    return {
        "family": selection.family,
        "left out": {family: round(error, 4) for family, error in selection.means.items()},
        "held out": held,
    }


def _scored(study: Study, item: Comparison) -> dict[str, Any]:
    error = (item.corrected - item.measured)[item.scored]
    published = {figure["name"]: _figure(figure, item, item.corrected) for figure in _figures(study, item)}
    return {
        "bare": round(item.before.mean_nrmse, 4),
        "corrected": round(item.after.mean_nrmse, 4),
        "r2": round(item.after.mean_r2, 4),
        "rms": [float(f"{v:.4g}") for v in np.sqrt((error**2).mean(axis=0))],
        "coverage": round(float(item.within(BAND_90).mean()), 4),
        "coverage while excited": round(float(item.within(BAND_90, item.excited).mean()), 4),
        "flagged": round(float((item.status[item.scored] == Status.OUTSIDE).mean()), 4),
        "flagged while excited": _flagged(item),
        **({"published": published} if published else {}),
    }


def _flagged(item: Comparison) -> float:
    return round(float((item.status[item.excited] == Status.OUTSIDE).mean()), 4)


def _figures(study: Study, item: Pair | Comparison) -> list[dict[str, Any]]:
    """The published figures of a condition (tools/real_data/real_study.py), with the steps a sample; none of other studies."""
    path = study.path.parent / SCORE
    if not path.is_file():
        return []
    told = json.loads(path.read_text(encoding="utf-8"))
    return [{**f, "ratio": told["ratio"]} for f in told["figures"] if f["condition"] == item.condition.name]


def _samples(figure: dict[str, Any], item: Pair | Comparison) -> np.ndarray:
    """The rows of `item` at the record's samples that a figure covers."""
    first = round(int(item.t_ns[0]) / int(item.t_ns[1] - item.t_ns[0]))  # a record begins with its simulation
    at = np.arange(*figure["rows"]) * figure["ratio"] - first
    return at[(at >= 0) & (at < len(item.measured))]


def _figure(figure: dict[str, Any], item: Pair | Comparison, response: np.ndarray) -> float:
    """A published figure, of a response at the rows of `item`."""
    rows = _samples(figure, item)
    measured = item.measured[rows]
    wrong = float(np.sqrt(np.mean((response[rows] - measured) ** 2)))
    if figure["kind"] == "share":
        wrong /= float(np.sqrt(np.mean(measured**2)))
    return float(f"{wrong * figure['factor']:.4g}")


def _range_a_unit(figure: dict[str, Any], item: Pair) -> float:
    """NRMSE (%) for 1 of the figure's unit."""
    measured = item.measured[_samples(figure, item)]
    whole = float(np.sqrt(np.mean(measured**2))) if figure["kind"] == "share" else 1.0
    return 100.0 * whole / (figure["factor"] * float(np.ptp(measured)))


def write(rows: dict[str, Any], to: Path) -> None:
    """JSON at `to`, table and picture beside it."""
    rows = {plant: rows[plant] for plant in gallery_plants.PLANTS if plant in rows}
    for plant, found in rows.items():
        found["named"] = gallery_named.named(plant, found)
    to.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    to.with_suffix(".md").write_text(gallery_page.page(rows), encoding="utf-8")
    to.with_suffix(".svg").write_text(gallery_page.picture(rows), encoding="utf-8")


def discover(plants: Sequence[str], minutes: int, figures: Path = FIGURES, work: Path = WORK) -> None:
    """Name what the plants' models lack, and train on what was named (seed 0), of plants that are in `figures` already."""
    rows = json.loads(figures.read_text(encoding="utf-8"))
    for plant in plants:
        if plant not in rows:
            continue
        folder = _folder(plant, work)
        beside = gallery_plants.study_of(plant, folder / "study")
        model = beside.with_name("study_fmu.toml")  # of plants that are trained on from records
        found = gallery_named.discovered(model if model.is_file() else beside, folder / "found", minutes)
        if found["held out"]:
            augmented = load_study(folder / "found" / "study.toml")
            both = trained(
                augmented, augmented.training, folder / "both", f"python tools/gallery.py --discover {plant!r}"
            )
            for name, scores in found["held out"].items():
                scores["both"] = both["held out"][name]["corrected"]
        rows[plant]["discovered"] = found
        write(rows, figures)


def _folder(plant: str, work: Path) -> Path:
    return work / f"{plant.replace(',', '').replace(' ', '_')}_{gallery_plants.made_by(plant)}"


def main(plants: Sequence[str], seeds: int, figures: Path = FIGURES, work: Path = WORK, any_code: bool = False) -> None:
    """figures: the JSON. work: folder of studies, models and what is unfinished. any_code: figures of other code stay. Raises
    SystemExit at the end where a plant failed; the others are done all the same."""
    failed: dict[str, str] = {}
    rows = json.loads(figures.read_text(encoding="utf-8")) if figures.is_file() else {}
    for seed in range(seeds):  # all plants first: what is stopped has figures of each
        for plant in plants:
            try:
                _one(rows, plant, seed, figures, work, any_code)
            except FmucorrectError as problem:
                failed[f"{plant}, seed {seed}"] = str(problem)
                print(f"{plant}, seed {seed}: {problem}", file=sys.stderr)
    if failed:
        sys.exit("\n".join(["failed:", *(f"{what}: {why}" for what, why in failed.items())]))


def _one(rows: dict[str, Any], plant: str, seed: int, figures: Path, work: Path, any_code: bool) -> None:
    """A plant with a seed into `rows` and `figures`, unless it is there already."""
    code = gallery_plants.made_by(plant)
    found: dict[str, Any] = rows.get(plant, {})
    kept = plant in rows and (any_code or found["code"] == code)
    if kept and str(seed) in found["seeds"]:
        return
    folder = _folder(plant, work)
    study = load_study(gallery_plants.study_of(plant, folder / "study"))
    training = replace(gallery_plants.training_of(plant, study), seed=seed)
    if not kept:
        found = {"code": code, "held out": _kept(folder / "simple.json", simple, study, training), "seeds": {}}
    found["seeds"][str(seed)] = trained(study, training, folder, f"python tools/gallery.py {plant!r}")
    rows[plant] = found
    write(rows, figures)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train and score correctors of many plants.")
    parser.add_argument("plants", nargs="*", choices=[*gallery_plants.PLANTS, []], metavar="PLANT")
    parser.add_argument("--seeds", type=int, default=1, help="trainings of each plant, with seeds 0, 1, ...; default 1")
    parser.add_argument("--any-code", action="store_true", help="keep figures that other code has made")
    parser.add_argument(
        "--page", action="store_true", help="train nothing: table and picture of the figures that are there"
    )
    parser.add_argument(
        "--discover",
        type=int,
        metavar="MINUTES",
        help="name what the trained plants' models lack, at most so long each",
    )
    options = parser.parse_args()
    if options.discover:
        discover(options.plants or gallery_plants.QUICK_TO_NAME, options.discover)
    elif options.page:
        write(json.loads(FIGURES.read_text(encoding="utf-8")), FIGURES)
    else:
        main(options.plants or gallery_plants.PLANTS, options.seeds, any_code=options.any_code)
