"""Corrects many virtual rigs that chance has drawn: python tools/random_rigs.py -> exported_models/random_rigs.json, .svg

Each rig is drawn by its seed (tools/virtual_rig/draw.py), measured and written as a study into a temporary folder; a
corrector is trained from that study alone, with a short training, and every condition is scored. Two rigs
at a time; what is done stands in exported_models/random_rigs.jsonl at once, so that a study that was stopped goes on where
it was. Results made by other code (of the training or of the rigs) are made again, unless --any-code is given.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tools" / "virtual_rig"))
import generate  # noqa: E402
from draw import Drawn, Settled, draw  # noqa: E402
from plant import Plant  # noqa: E402

from fmucorrect.comparison import BAND_90, Comparison  # noqa: E402
from fmucorrect.study import Study, load_study  # noqa: E402

FMU = ROOT / "fmus" / "roller_rig" / "roller_rig.fmu"
PROCESSES = 2
EPOCHS = (
    200  # of each residual network, without a choice: minutes for a dozen rigs where the shipped models took an hour
)


def train_and_score(study: Study) -> list[Comparison]:
    """Train on the study's development conditions, and open every condition with the finished bundle."""
    from fmucorrect import bundle
    from fmucorrect.pairs import pair
    from fmucorrect.sealing import evaluate
    from fmucorrect.training.protocol import train

    trained = train(study, replace(study.training, corrector=replace(study.training.corrector, epochs=(EPOCHS,))))
    path = study.path.parent / "corrector.onnx"
    path.write_bytes(trained.content)
    model = bundle.load(path)
    return [evaluate(pair(study, condition), model) for condition in study.conditions]


def write_study(drawn: Drawn, place: Path, plant: Plant) -> Study:
    """The drawn rig's measurements and study file in the folder `place`, as a user would have them."""
    generate.write(drawn.rig, place, Settled(plant))
    path = place / "study.toml"
    text = path.read_text(encoding="utf-8").replace('"../roller_rig.fmu"', json.dumps(str(FMU)))
    path.write_text(text, encoding="utf-8", newline="\n")
    return load_study(path)


def one(seed: int) -> dict[str, Any]:
    """Everything of one rig: drawn, measured, trained, scored."""
    plant = Plant()
    drawn = draw(seed, plant)
    with tempfile.TemporaryDirectory(prefix=f"rig_{seed}_") as place:
        comparisons = train_and_score(write_study(drawn, Path(place), plant))
    return {**told(drawn), "conditions": [figures(item) for item in comparisons]}


def told(drawn: Drawn) -> dict[str, Any]:
    """What was drawn, in words and numbers."""
    return {"seed": drawn.seed, "story": drawn.story, "rejected": drawn.rejected, "truth": drawn.rig}


def figures(item: Comparison) -> dict[str, Any]:
    """One condition. coverage_90: share of samples within the 90 % band, a number a channel; excited: while the platform
    moves. noise_floor: the NRMSE (%) that the sensors' noise, as the study states it, leaves to the truth."""
    noise = np.array([channel.noise or np.nan for channel in item.channels])
    extent = np.ptp(item.measured[item.scored], axis=0)
    moving = item.excited
    return {
        "condition": item.condition.name,
        "role": item.condition.role,
        "rows": len(item.measured[item.scored]),
        "nrmse_before": round(item.before.mean_nrmse, 4),
        "nrmse_after": round(item.after.mean_nrmse, 4),
        "mean_r2_before": round(item.before.mean_r2, 5),
        "mean_r2_after": round(item.after.mean_r2, 5),
        "rows_excited": moving.stop - moving.start,
        "coverage_90": [round(float(share), 4) for share in item.within(BAND_90)],
        "coverage_90_excited": [round(float(share), 4) for share in item.within(BAND_90, moving)],
        "noise_floor": round(float(np.mean(100.0 * noise / extent)), 4),
    }


def summary(rigs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Over all evaluation conditions of all rigs. worse: rigs with an evaluation condition that became worse."""
    held = [(rig["seed"], item) for rig in rigs for item in rig["conditions"] if item["role"] == "evaluation"]
    worst = max(held, key=lambda entry: entry[1]["nrmse_after"])
    return {
        "rigs": len(rigs),
        "nrmse_before": quartiles([item["nrmse_before"] for _, item in held]),
        "nrmse_after": quartiles([item["nrmse_after"] for _, item in held]),
        "mean_r2_before": quartiles([item["mean_r2_before"] for _, item in held]),
        "mean_r2_after": quartiles([item["mean_r2_after"] for _, item in held]),
        "after_over_before": quartiles([item["nrmse_after"] / item["nrmse_before"] for _, item in held]),
        "after_over_noise_floor": quartiles([item["nrmse_after"] / item["noise_floor"] for _, item in held]),
        "noise_floor": quartiles([item["noise_floor"] for _, item in held]),
        "worst": {"seed": worst[0], "nrmse_after": worst[1]["nrmse_after"]},
        "worse": sorted({seed for seed, item in held if item["nrmse_after"] > item["nrmse_before"]}),
        "coverage_90": pooled([(np.mean(item["coverage_90"]), item["rows"]) for _, item in held]),
        "coverage_90_excited": pooled(
            [(np.mean(item["coverage_90_excited"]), item["rows_excited"]) for _, item in held]
        ),
    }


def pooled(shares: Iterable[tuple[float, int]]) -> float:
    """The share over all rows together, from share and number of rows of each."""
    values, rows = np.array(list(shares), float).T
    return round(float(np.average(values, weights=rows)), 4)


def quartiles(values: Iterable[float]) -> dict[str, float]:
    """Least, quartiles and greatest."""
    numbers = np.quantile(list(values), [0.0, 0.25, 0.5, 0.75, 1.0])
    return dict(zip(("least", "lower", "median", "upper", "greatest"), numbers.round(4).tolist(), strict=True))


def code() -> str:
    """A digest of all that makes the results: training, rigs, model."""
    virtual = ROOT / "tools" / "virtual_rig"
    files = [*(ROOT / "fmucorrect" / "training").glob("*.py"), *(ROOT / "fmucorrect").glob("study_training*.py"), FMU]
    files += [*virtual.glob("*.py"), virtual / "rig.c", virtual / "study_head.toml", Path(__file__)]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def done(target: Path) -> list[dict[str, Any]]:
    """The results of an earlier, perhaps unfinished, study."""
    rigs: list[dict[str, Any]] = []
    if target.is_file():
        rigs += json.loads(target.read_text(encoding="utf-8"))["rigs"]
    lines = target.with_suffix(".jsonl")
    if lines.is_file():
        for line in lines.read_text(encoding="utf-8").splitlines():
            try:
                rigs.append(json.loads(line))
            except json.JSONDecodeError:  # the line that was being written when the study was stopped
                continue
    return rigs


def run(target: Path, seeds: Sequence[int], any_code: bool = False) -> dict[str, Any]:
    """Make what is missing, then write `target` (JSON) and its picture beside it. A rig that fails is told and left out;
    the next call tries it again. any_code: also take over what other code has made."""
    made_by = code()
    known = [rig for rig in done(target) if rig["seed"] in seeds]
    results = {rig["seed"]: rig for rig in known if any_code or rig["code"] == made_by}
    if aside := sorted({rig["seed"] for rig in known} - set(results)):
        print(f"rigs {', '.join(map(str, aside))} were made by other code and are made again (--any-code: keep them)")
    missing = [seed for seed in seeds if seed not in results]
    failed: dict[int, str] = {}
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    lines = target.with_suffix(".jsonl")
    with (
        ProcessPoolExecutor(PROCESSES, context) as pool,
        tqdm(total=len(seeds), initial=len(results), unit="rig", disable=None) as bar,
    ):
        jobs = {pool.submit(one, seed): seed for seed in missing}
        try:
            for job in as_completed(jobs):
                seed, error = jobs[job], job.exception()
                if error is not None:  # whatever stops one rig must not stop the study
                    failed[seed] = f"{type(error).__name__}: {error}"
                    bar.write(f"rig {seed} failed: {failed[seed]}")
                    continue
                results[seed] = {**job.result(), "code": made_by}
                with lines.open("a", encoding="utf-8", newline="\n") as out:
                    out.write("\n" + json.dumps(results[seed]))  # behind a line that a killed study left unfinished
                bar.update()
                bar.write(line(results[seed]))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    rigs = [results[seed] for seed in sorted(results)]
    if not rigs:
        raise SystemExit("no rig came out")
    content = {"summary": summary(rigs), "failed": failed, "rigs": rigs}
    others = [json.dumps(rig) for rig in done(target) if rig["seed"] not in results]  # not asked for, not thrown away
    partial = target.with_name(target.name + ".partial")
    partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
    partial.replace(target)
    target.with_suffix(".svg").write_text(picture(rigs), encoding="utf-8", newline="\n")
    if others:
        lines.write_text("\n".join(others), encoding="utf-8", newline="\n")
    else:
        lines.unlink(missing_ok=True)
    return content


def line(rig: dict[str, Any]) -> str:
    """One rig for the terminal."""
    held = [item for item in rig["conditions"] if item["role"] == "evaluation"]
    text = ", ".join(
        f"{item['condition']} km/h NRMSE {item['nrmse_before']:.2f} -> {item['nrmse_after']:.2f} %" for item in held
    )
    return f"rig {rig['seed']}: {text}"


WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 900, 430, 70, 96, 48


def picture(rigs: Sequence[dict[str, Any]]) -> str:
    """NRMSE of the evaluation condition before and after, and the noise floor, a column a rig, sorted by the result."""
    held = [(rig["seed"], item) for rig in rigs for item in rig["conditions"] if item["role"] == "evaluation"]
    held.sort(key=lambda entry: entry[1]["nrmse_after"])
    values = [item[key] for _, item in held for key in ("nrmse_before", "nrmse_after", "noise_floor")]
    ticks = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
    low = max(t for t in ticks if t <= max(min(values), ticks[0]))
    high = min(t for t in ticks if t >= min(max(values), ticks[-1]))
    y = lambda v: TOP + (HEIGHT - TOP - BOTTOM) * np.log(high / min(max(v, low), high)) / np.log(high / low)  # noqa: E731
    pitch = (WIDTH - LEFT - 20) / len(held)
    middle = float(np.median([item["nrmse_before"] for _, item in held]))
    after = float(np.median([item["nrmse_after"] for _, item in held]))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="13">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/><text x="{LEFT}" y="26" font-size="17">'
        f"{len(held)} rigs drawn at random, at 385 km/h, never seen in training: "
        f"median error {middle:.1f} % before, {after:.2f} % after</text>"
    ]
    legend = (("simulated", "#d1495b"), ("corrected", "#1f7a8c"), ("noise of the sensors alone", "#888"))
    for x, (name, colour) in zip((LEFT + 6, LEFT + 126, LEFT + 246), legend, strict=True):
        parts.append(mark(x, 50, colour, "noise" in name) + f'<text x="{x + 14}" y="54">{name}</text>')
    for tick in (t for t in ticks if low <= t <= high):
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - 20}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y(tick) + 4:.1f}" text-anchor="end" fill="#555">{tick:g} %</text>')
    parts.append(
        f'<text x="8" y="{TOP - 14}" fill="#555" font-size="12">NRMSE, % of the measured range, logarithmic</text>'
    )
    for i, (seed, item) in enumerate(held):
        x = LEFT + pitch * (i + 0.5)
        before, behind = y(item["nrmse_before"]), y(item["nrmse_after"])
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{before:.1f}" y2="{behind:.1f}" stroke="#bbb"/>')
        parts.append(mark(x, y(item["noise_floor"]), "#888", True))
        parts.append(mark(x, before, "#d1495b") + mark(x, behind, "#1f7a8c"))
        parts.append(
            f'<text x="{x:.1f}" y="{HEIGHT - 26}" text-anchor="middle" fill="#555" font-size="12">{seed}</text>'
        )
    parts.append(
        f'<text x="{LEFT}" y="{HEIGHT - 8}" fill="#555" font-size="12">seed, in the order of the result</text>'
    )
    parts.append("</svg>\n")
    return "".join(parts)


def mark(x: float, y: float, colour: str, bar: bool = False) -> str:
    """A dot, or a short bar."""
    if bar:
        return f'<line x1="{x - 9:.1f}" x2="{x + 9:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="{colour}" stroke-width="3"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5.5" fill="{colour}"/>'


def only_draw(seeds: Sequence[int]) -> None:
    """Tell what the seeds would draw."""
    plant = Plant()
    for seed in seeds:
        drawn = draw(seed, plant)
        print(f"rig {seed}: {drawn.rig['excitation_kind']} recorded, surge {drawn.rig['surge']}")
        print("".join(f"  {text}\n" for text in (*drawn.story, *(f"rejected {why}" for why in drawn.rejected))), end="")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Correct virtual rigs that chance has drawn.")
    parser.add_argument("--rigs", type=int, default=12)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--only-draw", action="store_true", help="tell what is hidden in each, train nothing")
    parser.add_argument("--any-code", action="store_true", help="keep results that other code has made")
    options = parser.parse_args()
    wanted = range(options.first_seed, options.first_seed + options.rigs)
    if options.only_draw:
        only_draw(wanted)
    else:
        content = run(ROOT / "exported_models" / "random_rigs.json", wanted, options.any_code)
        print(json.dumps(content["summary"], indent=1))
