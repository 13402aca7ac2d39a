"""FMUs as others export them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def by_pythonfmu(folder: Path, name: str, code: str, *flags: str) -> Path:
    """The FMU that pythonfmu makes of `code`, whose class has this name. flags: of `pythonfmu build`."""
    source = folder / f"{name.lower()}.py"
    source.write_text(code)
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", str(source), "-d", str(folder), *flags]
    subprocess.run(command, check=True, capture_output=True)
    return folder / f"{name}.fmu"
