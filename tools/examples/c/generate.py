"""A corrector as C: python generate.py corrector.onnx FOLDER

FOLDER gets the network's sources, and corrector.h: what correct.c has to know of the channels.
"""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

from fmucorrect.bundle import Bundle, load
from fmucorrect.signals import Channel
from fmucorrect.stepper import corrected_channels
from fmucorrect.wrapping import network


def main(bundle: Path, folder: Path) -> None:
    network.sources(bundle).write(folder)
    (folder / "corrector.h").write_text(_header(load(bundle)), encoding="utf-8")


def _header(corrector: Bundle) -> str:
    uncorrected = ", ".join(map(repr, corrector.uncorrected.tolist()))
    return (
        "/* What correct.c has to know of the corrector. */\n"
        f"#define CORRECTOR_INPUT {_columns(corrector.info.seen)}\n"
        f"#define CORRECTOR_OUTPUT {_columns(corrected_channels(corrector.channels))}\n"
        f"#define CORRECTOR_STEP_NS {corrector.step_ns}\n"
        "/* sigma while there is no correction: rms of measurement minus simulation in development */\n"
        f"#define CORRECTOR_UNCORRECTED {{{uncorrected}}}\n"
    )


def _columns(channels: tuple[Channel, ...]) -> str:
    """The header of a CSV file of these channels, as fmucorrect writes it, as a C string."""
    line = io.StringIO()
    names = [channel.name if channel.unit == "1" else f"{channel.name} [{channel.unit}]" for channel in channels]
    csv.writer(line, lineterminator="").writerow(["time", *names])
    return json.dumps(line.getvalue(), ensure_ascii=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
