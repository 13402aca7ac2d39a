"""The licence texts that a wrapped FMU carries, of what is new in it; those of the solver's FMU stay where they are."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from fmucorrect.errors import WrapError

PLACE = "documentation/licenses/fmucorrect"
"""Where both FMI versions have licences, in a folder of our own, beside what the solver's FMU has there."""
_PACKAGE = Path(__file__).parents[1]
_GENERATOR = "emx-onnx-cgen"


def files(network: bool) -> dict[str, bytes]:
    """By place in the FMU. network: whether there is one, which the generator wrote as C."""
    found = {
        "fmucorrect.txt": _own(),
        "fmi-headers.txt": (Path(__file__).parent / "c" / "fmi" / "LICENSE.txt").read_bytes(),
    }
    if network:
        found[f"{_GENERATOR}.txt"] = _of(_GENERATOR)
    return {f"{PLACE}/{name}": text for name, text in found.items()}


def _own() -> bytes:
    """Installed, it lies in the package; in a checkout, beside it."""
    for folder in (_PACKAGE, _PACKAGE.parent):
        if (folder / "LICENSE").is_file():
            return (folder / "LICENSE").read_bytes()
    raise WrapError("fmucorrect's own licence is not there", where=str(_PACKAGE), remedy="Install fmucorrect again.")


def _of(package: str) -> bytes:
    for file in metadata.files(package) or ():
        if file.name.upper().startswith(("LICENSE", "LICENCE")):
            return file.read_binary()
    raise WrapError(f"the licence of {package} is not there", remedy=f"Install {package} again.")
