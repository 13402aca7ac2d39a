"""The solver's FMU as the wrapped one carries it: unpacked in resources/solver, for the platforms asked for; its sources, where
hosts look for sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from fmucorrect.errors import WrapError
from fmucorrect.fmu import FmuDescription, archive
from fmucorrect.wrapping import linked
from fmucorrect.wrapping.compiler import TARGETS

PLACE = "resources/solver"
_OUTER = ("documentation", "terminalsAndIcons", "extra", "model.png", "icon.png")
"""What stays where hosts look for it: at the top."""
_CALLED = {folder: name for name, processors in TARGETS.items() for _, folder, _ in processors}
"""Name in FMI 3.0 -> in TARGETS."""
_ELF = {3: "x86", 40: "ARM of 32 bits", 62: "x86_64", 183: "aarch64"}
"""Processor by e_machine of <elf.h>."""
_LIBRARIES = {
    ".so": ("a shared library of Linux (ELF)", b"\x7fELF"),
    ".dll": ("a DLL of Windows", b"MZ"),
    ".dylib": ("a dynamic library of macOS (Mach-O)", (b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf")),
}
"""By suffix: what it is, and how it begins; on macOS for one processor, or for several in one file."""


def platforms(fmu: FmuDescription | None, wanted: Sequence[str]) -> list[str]:
    """`wanted`, by whichever FMI version's name, or all that the solver has a library for; all there are where there is no
    solver. Raises WrapError where one is not known or the solver lacks it."""
    wanted = list(dict.fromkeys(_CALLED.get(name, name) for name in wanted))
    unknown = [name for name in wanted if name not in TARGETS]
    if unknown:
        raise WrapError(f"platform {', '.join(unknown)} is not known", expected=f"some of {', '.join(TARGETS)}")
    if fmu is None:
        return wanted or list(TARGETS)
    have = [name for name in TARGETS if _folders(fmu, name)]
    missing = [name for name in wanted if name not in have]
    if missing or not have:
        raise WrapError(
            f"the solver's FMU has no library for {', '.join(missing) or 'any of ' + ', '.join(TARGETS)}",
            where=str(fmu.path),
            expected=f"{', '.join(wanted) or 'one of these'}{fmu.misnamed}",
            got=fmu.inside,
            remedy="Export it again for that platform, or ask for others with --platforms.",
        )
    for name in wanted or have:
        _check_libraries(fmu, name)
    return wanted or have


def _check_libraries(fmu: FmuDescription, platform: str) -> None:
    """What the platform cannot load would be found out by the host only; and some exporters on ARM write to linux64, as if
    there were one processor. Raises WrapError."""
    for _, place, suffix in TARGETS[platform]:
        folder, wanted = platform if fmu.fmi.startswith("2") else place, place.split("-")[0]
        name = f"binaries/{folder}/{fmu.identifier}{suffix}"
        if name not in fmu.libraries:
            continue
        with archive.opened(fmu.path) as file:
            code = archive.read(file, name, fmu.path, archive.UNPACKED)
        kind, begins = _LIBRARIES[suffix]
        if not code.startswith(begins) or len(code) < 20:
            raise WrapError(
                f"{name} is no library that {platform} can load",
                where=str(fmu.path),
                expected=kind,
                got=f"{len(code)} bytes that begin with {code[:12]!r}" if code else "an empty file",
                remedy="Export it again, or name the platforms to wrap it for with --platforms.",
            )
        got = _ELF.get(code[18], f"machine {code[18]} of ELF")
        if suffix == ".so" and got != wanted:
            raise WrapError(
                f"the solver's library in binaries/{folder} is for another processor",
                where=str(fmu.path),
                expected=wanted,
                got=got,
                remedy=f"Move it to binaries/{got}-linux." if got == "aarch64" else "Export it again.",
            )


def targets(fmu: FmuDescription | None, platforms: Sequence[str]) -> Mapping[str, Sequence[tuple[str, str, str]]]:
    """What of TARGETS to build for: in FMI 3.0 the processors that the solver has a library for."""
    if fmu is None or fmu.fmi.startswith("2"):
        return {name: TARGETS[name] for name in platforms}
    return {name: [target for target in TARGETS[name] if target[1] in fmu.platforms] for name in platforms}


def left_out(fmu: FmuDescription) -> list[str]:
    """A note on libraries for platforms that nothing is built for here, 32-bit ones above all."""
    served = {folder for name in TARGETS for folder in _folders(fmu, name)}
    gone = [platform for platform in fmu.platforms if platform not in served]
    if not gone:
        return []
    return [f"the solver's libraries for {', '.join(gone)} are left out: only {', '.join(TARGETS)} are built"]


def description(fmu: FmuDescription) -> bytes:
    """Its modelDescription.xml."""
    with archive.opened(fmu.path) as file:
        return archive.read(file, archive.MODEL_DESCRIPTION, fmu.path)


def files(fmu: FmuDescription, platforms: Sequence[str]) -> dict[str, bytes]:
    """The entries of the wrapped FMU that come from the solver's. Raises FmuError where an entry is damaged."""
    folders = {folder for name in platforms for folder in _folders(fmu, name)}
    found: dict[str, bytes] = {}
    with archive.opened(fmu.path) as file:
        for name in file.namelist():
            top, *rest = PurePosixPath(name).parts or ("",)
            if name.endswith("/") or (top == "binaries" and rest[:1] and rest[0] not in folders):
                continue
            found[_place(name)] = archive.read(file, name, fmu.path, archive.UNPACKED)
    return found


def _place(name: str) -> str:
    """Where an entry of the solver's FMU lies in the wrapped one."""
    top, *rest = PurePosixPath(name).parts
    if top == "sources":
        return "/".join((top, linked.PLACE, *rest))
    return name if top in _OUTER else f"{PLACE}/{name}"


def _folders(fmu: FmuDescription, platform: str) -> list[str]:
    """The folders in binaries/ of the solver that serve a platform."""
    if fmu.fmi.startswith("2"):
        return [platform] if platform in fmu.platforms else []
    return [folder for _, folder, _ in TARGETS[platform] if folder in fmu.platforms]
