"""Draws the picture of README.md: python tools/make_picture.py -> exported_models/roller_rig/result.svg

Runs the shipped corrector on rig A at 385 km/h, as `fmucorrect demo` does, and draws two seconds of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmucorrect import bundle
from fmucorrect.metrics import score
from fmucorrect.pairs import pair
from fmucorrect.stepper import CorrectedStepper, ReplayStepper
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent
WIDTH, HEIGHT, LEFT, TOP, GAP = 900, 150, 92, 64, 26
SPAN = (9.8, 11.8)  # s: the start of the excitation, its surge, and the first steady cycles
COLOURS = {"measured": "#1b1b1b", "simulated": "#d1495b", "corrected": "#1f7a8c"}


def main() -> None:
    study = load_study(ROOT / "fmus" / "roller_rig" / "A" / "study.toml")
    item = pair(study, study.condition("385"))
    stepper = CorrectedStepper(
        ReplayStepper(item.simulated.channels), bundle.load(ROOT / "exported_models/roller_rig/corrector.onnx")
    )
    stepper.reset(item.condition)
    result = stepper.process(item.simulated)
    names = [channel.name for channel in study.channels]
    corrected = result.select([f"{name}_corrected" for name in names]).values[item.rows]
    before, after = score(item.response, item.measured).mean_nrmse, score(corrected, item.measured).mean_nrmse
    t = item.t_ns * 1e-9
    rows = (t >= SPAN[0]) & (t <= SPAN[1])
    series = {"simulated": item.response[rows], "corrected": corrected[rows], "measured": item.measured[rows]}
    text = panels(names, t[rows], series)
    title = f"385 km/h, never seen in training: error {before:.1f} % of the measured range before, {after:.2f} % after"
    height = TOP + len(names) * (HEIGHT + GAP) + 20
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="13">'
        f'<rect width="{WIDTH}" height="{height}" fill="white"/><text x="{LEFT}" y="24" font-size="17">{title}</text>'
    )
    (ROOT / "exported_models" / "roller_rig" / "result.svg").write_text(head + text + "</svg>\n", encoding="utf-8")


def panels(names: list[str], t: np.ndarray, series: dict[str, np.ndarray]) -> str:
    """One panel a channel, mm over s, and the legend."""
    parts = [
        f'<line x1="{LEFT + 120 * i}" x2="{LEFT + 22 + 120 * i}" y1="42" y2="42" stroke="{colour}" stroke-width="3"/>'
        f'<text x="{LEFT + 28 + 120 * i}" y="46">{name}</text>'
        for i, (name, colour) in enumerate(COLOURS.items())
    ]
    limit = 1.05 * max(np.abs(values).max() for values in series.values())
    x = LEFT + (t - t[0]) / (t[-1] - t[0]) * (WIDTH - LEFT - 16)
    for j, name in enumerate(names):
        top = TOP + j * (HEIGHT + GAP)
        middle = top + HEIGHT / 2
        parts.append(
            f'<rect x="{LEFT}" y="{top}" width="{WIDTH - LEFT - 16}" height="{HEIGHT}" fill="none" stroke="#ccc"/>'
        )
        parts.append(f'<text x="8" y="{middle + 4}">{name}, mm</text>')
        for level in (-4, 0, 4):
            y = middle - level / limit * HEIGHT / 2
            parts.append(f'<line x1="{LEFT}" x2="{WIDTH - 16}" y1="{y:.1f}" y2="{y:.1f}" stroke="#eee"/>')
            parts.append(
                f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end" fill="#777" font-size="11">{level}</text>'
            )
        for label, values in series.items():
            y = middle - values[:, j] / limit * HEIGHT / 2
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[::4], y[::4], strict=True))
            width = 3.2 if label == "measured" else 1.8
            opacity = 0.35 if label == "measured" else 1.0
            parts.append(
                f'<polyline points="{points}" fill="none" stroke="{COLOURS[label]}" stroke-width="{width}" '
                f'opacity="{opacity}"/>'
            )
    bottom = TOP + len(names) * (HEIGHT + GAP) - GAP + 16
    for second in np.arange(np.ceil(t[0] * 2) / 2, t[-1], 0.5):
        place = LEFT + (second - t[0]) / (t[-1] - t[0]) * (WIDTH - LEFT - 16)
        parts.append(
            f'<text x="{place:.1f}" y="{bottom}" text-anchor="middle" fill="#777" font-size="11">{second:g} s</text>'
        )
    return "".join(parts)


if __name__ == "__main__":
    main()
