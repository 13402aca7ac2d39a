"""host.c around an unpacked FMU: on Linux, as a program for Windows under wine, and as one for ARM under qemu."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryFile

from fmucorrect.fmu import open_fmu
from fmucorrect.wrapping.compiler import TARGETS

WINE = Path("/usr/lib/wine/wine64")
QEMU = (Path("/usr/bin/qemu-aarch64"), "-L", Path("/usr/aarch64-linux-gnu"))
"""And where Debian's libc6-arm64-cross lies."""


def library_in(fmu: Path, folder: Path, platform: str = "linux64") -> Path:
    """The FMU's library in the folder where it is unpacked."""
    said = open_fmu(fmu)
    _, place, suffix = TARGETS[platform][0]
    return folder / "binaries" / (platform if said.fmi.startswith("2") else place) / f"{said.identifier}{suffix}"


def played(
    program: Sequence[str | Path],
    fmu: Path,
    folder: Path,
    words: Sequence[str],
    *,
    platform: str = "linux64",
    library: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> str:
    """What the host prints. words: mode, step and so on. library: instead of the one inside."""
    said = open_fmu(fmu)
    drive = "Z:" if platform == "win64" else ""
    resources = f"{drive}{folder / 'resources'}/"
    if said.fmi.startswith("2"):
        resources = (folder / "resources").as_uri().replace("file://", "file:///Z:" if drive else "file://")
    command = [*program, f"{drive}{library or library_in(fmu, folder, platform)}", resources, said.token, *words]
    told = ""
    for _ in range(2):
        with TemporaryFile() as out, TemporaryFile() as err:  # no pipes, which services of wine would hold open
            done = subprocess.run(
                command, stdout=out, stderr=err, env={**os.environ, **(environment or {})}, timeout=300
            )
            out.seek(0)
            err.seek(0)
            if done.returncode == 0:
                return out.read().decode()
            told = err.read().decode(errors="replace")[-3000:]
        if "wine client error" not in told:  # its server went away beneath the host: no word of what is tested
            break
    raise AssertionError(told)
