"""FMUs as others export them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def by_pythonfmu(folder: Path, name: str, code: str, *flags: str, package: str = "pythonfmu") -> Path:
    """The FMU that pythonfmu or pythonfmu3, whichever `package` is, makes of `code`, whose class has this name. In a process of
    its own: such an FMU brings the package along, and one that ran in this process has left its copy in sys.modules, without
    what is needed to export. flags: of `pythonfmu build`."""
    source = folder / f"{name.lower()}.py"
    source.write_text(code)
    command = [sys.executable, "-m", package, "build", "-f", str(source), "-d", str(folder), *flags]
    subprocess.run(command, check=True, capture_output=True)
    return folder / f"{name}.fmu"
