"""The solver's own sources as a part of one program: each of its files gets a file beside the wrapper's that includes it.

The solver is compiled there alone, and only where the wrapper itself is linked (c/linkage.h): with the prefix that the
standards give to the functions of an FMU, its modelIdentifier and `_`, with the standard's headers in the place of its own
copies, and with its own preprocessor definitions, which FMI 2.0 has no place for.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from fmucorrect.fmu import FmuDescription, archive
from fmucorrect.wrapping import ctext

PLACE = "solver"
"""In sources/."""
_NAME = re.compile(r"[\w.+/-]+", re.ASCII)
_VALUE = re.compile(r'[\w.+-]*|"[\w. +-]*"', re.ASCII)
"""What may stand in an #include, and as the value of a #define, and is nothing else."""
_UNIT = """\
/* A part of the solver, where all is linked into one program (linkage.h); else the solver's library is loaded. */
#include "linkage.h"
#if LINKED
#undef LINKED
#undef OWN
#undef FMI2_FUNCTION_PREFIX
#undef FMI3_FUNCTION_PREFIX
#undef FMI3_OVERRIDE_FUNCTION_PREFIX
#undef FMI3_ACTUAL_FUNCTION_PREFIX
#define FMI{fmi}_FUNCTION_PREFIX {identifier}_
{definitions}#include "fmi{fmi}Functions.h"
#include "{place}/{name}"
#else
typedef int solver_is_loaded;
#endif
"""


@dataclass(frozen=True)
class FileSet:
    """Files that are compiled alike. language: as FMI 3.0 writes it, "" where the solver does not say. includes: folders in
    sources/."""

    language: str
    files: tuple[str, ...]
    includes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Linked:
    """sets: what is compiled for the solver, () where it has no sources. files: content of the new files, by their names in
    sources/. notes: why its sources are left out."""

    sets: tuple[FileSet, ...] = ()
    files: dict[str, bytes] = field(default_factory=dict[str, bytes])
    notes: tuple[str, ...] = ()


def read(fmu: FmuDescription, xml: bytes) -> Linked:
    """What the solver's own build description names. xml: its model description. Raises FmuError where an entry is damaged."""
    with archive.opened(fmu.path) as file:
        there = set(file.namelist())
        if fmu.fmi.startswith("2"):
            sets = [ET.fromstring(xml).find("CoSimulation/SourceFiles")]
        elif archive.BUILD_DESCRIPTION in there:
            sets = _configuration(archive.read(file, archive.BUILD_DESCRIPTION, fmu.path), fmu.identifier)
        else:
            sets = []
    found: list[FileSet] = []
    files: dict[str, bytes] = {}
    for element in sets:
        if element is None:
            continue
        definitions = {d.get("name", ""): d.get("value", "") for d in element.findall("PreprocessorDefinition")}
        names = [child.get("name", "") for child in element if child.tag in ("File", "SourceFile")]
        folders = [child.get("name", "") for child in element.findall("IncludeDirectory")]
        strange = [
            name for name in (*names, *folders) if not _NAME.fullmatch(name) or ".." in PurePosixPath(name).parts
        ]
        strange += [name for name in names if f"sources/{name}" not in there]
        strange += [
            key for key, text in definitions.items() if ctext.identifier(key) != key or not _VALUE.fullmatch(text)
        ]
        if ctext.identifier(fmu.identifier) != fmu.identifier:
            strange.append(fmu.identifier)
        if strange:
            return Linked(
                notes=(f"its sources cannot be linked statically: {strange[0]!a} is not there, or no plain name",)
            )
        units: list[str] = []
        for name in names:
            unit = f"solver_{len(files)}{PurePosixPath(name).suffix}"
            defined = "".join(f"#define {key} {text}\n" for key, text in definitions.items())
            text = _UNIT.format(fmi=fmu.fmi[0], identifier=fmu.identifier, definitions=defined, place=PLACE, name=name)
            files[unit] = text.encode()
            units.append(unit)
        if units:
            found.append(
                FileSet(element.get("language", ""), tuple(units), tuple(f"{PLACE}/{name}" for name in folders))
            )
    return Linked(tuple(found), files)


def _configuration(build: bytes, identifier: str) -> list[ET.Element | None]:
    """The sets of the configuration for every platform."""
    for configuration in ET.fromstring(build).findall("BuildConfiguration"):
        if configuration.get("modelIdentifier") == identifier and not configuration.get("platform"):
            return [*configuration.findall("SourceFileSet")]
    return []
