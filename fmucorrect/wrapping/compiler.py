"""C to shared libraries for every platform of an FMU, by zig (PyPI: ziglang), and the zip file that they go into."""

from __future__ import annotations

import hashlib
import importlib.util
import platform
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fmucorrect.errors import MissingExtra, WrapError
from fmucorrect.outputs import Replacing
from fmucorrect.places import CORES

TARGETS: Mapping[str, Sequence[tuple[str, str, str]]] = {
    "linux64": [("x86_64-linux-gnu.2.17", "x86_64-linux", ".so")],
    "aarch64-linux": [("aarch64-linux-gnu.2.17", "aarch64-linux", ".so")],
    "win64": [("x86_64-windows-gnu", "x86_64-windows", ".dll")],
    "darwin64": [("x86_64-macos.11.0", "x86_64-darwin", ".dylib"), ("aarch64-macos.11.0", "aarch64-darwin", ".dylib")],
}
"""Platform as FMI 2.0 names it -> zig target, folder in FMI 3.0 and suffix of the library, for each processor. Beyond 32 and 64
bits of x86, FMI 2.0.4 and later take the names of FMI 3.0; darwin64 holds both processors, since hosts on either look there."""

_HOSTS = {
    ("linux", "x86_64"): TARGETS["linux64"][0],
    ("linux", "aarch64"): TARGETS["aarch64-linux"][0],
    ("win32", "AMD64"): TARGETS["win64"][0],
    ("darwin", "x86_64"): TARGETS["darwin64"][0],
    ("darwin", "arm64"): TARGETS["darwin64"][1],
}

# No symbols or debug information, so no paths either.
_FLAGS = [
    "-std=c11",
    "-fno-trigraphs",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
    "-s",
    "-Wall",
    "-Wextra",
    "-Wno-unused-parameter",
]
_C = Path(__file__).parent / "c"
EXACT = ["-O2", "-ffp-contract=off"]
"""No fused multiply-add, so that the platforms round alike."""


@dataclass(frozen=True)
class Sources:
    """Generated C. files: content by name, all for one folder."""

    files: Mapping[str, bytes]

    @property
    def names(self) -> list[str]:
        """The files to be compiled."""
        return sorted(name for name in self.files if name.endswith(".c"))

    def write(self, folder: Path) -> list[str]:
        """Writes all files to `folder`; returns `names`."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        return self.names


def host() -> tuple[str, str, str]:
    """Target, folder and suffix, as in TARGETS, of the machine that this runs on. Raises WrapError where there is none."""
    machine = (sys.platform, platform.machine())
    if machine not in _HOSTS:
        raise WrapError("nothing can be compiled for this machine", got=" on ".join(machine))
    return _HOSTS[machine]


def compile_library(
    sources: Path, names: Sequence[str], target: str, output: Path, flags: Sequence[str] = EXACT
) -> None:
    """Compiles the files `names` of the folder `sources` to a shared library.

    zig caches what has not changed, which it knows by its path from where it runs, and only behind the same first file: it runs
    in a folder where each file's path tells its content, a network's files first, so that what was compiled once is known
    wherever it comes again. Were another content at the same path, two at a time could wait for each other's locks for ever.

    Raises WrapError with the compiler's own words, MissingExtra where there is no zig.
    """
    zig = importlib.util.find_spec("ziglang")
    if zig is None or zig.origin is None:
        raise MissingExtra("ziglang", "wrap")
    output.parent.mkdir(parents=True, exist_ok=True)
    extra: list[str] = []
    if "macos" in target:
        extra = [f"-Wl,-install_name,@rpath/{output.name}"]
    elif "linux" in target:
        extra = ["-lm", "-ldl", "-Wl,--build-id=none"]
    elif "windows" in target:
        extra = windows(Path(zig.origin).parent)
    ordered = sorted(names, key=lambda name: (not name.startswith("network"), name))
    with tempfile.TemporaryDirectory(dir=sources) as made:
        copies = [_by_content(sources, name, Path(made)) for name in ordered]
        if "windows" in target:
            copies.append(_by_content(_C, "windows.c", Path(made)))
        command = [
            *(sys.executable, "-m", "ziglang", "cc", "-target", target, *_FLAGS, *flags, *extra, *copies),
            *("-o", output.name),  # no path: zig takes "%41" in it for "A"
        ]
        result = subprocess.run(command, cwd=made, capture_output=True, text=True)
        if result.returncode:
            raise WrapError(f"the C compiler refused: {' '.join(command[1:])}\n{result.stderr}", where=str(sources))
        shutil.copy(Path(made) / output.name, output)  # over an older one, on Windows too
    if result.stderr:
        print(result.stderr, file=sys.stderr)


def windows(zig: Path) -> list[str]:
    """Flags for Windows. zig: the folder of its package. Headers and import libraries of mingw-w64, which zig has, are taken,
    not its C library, which would be compiled first, once a machine, for two minutes of a processor. The Universal C Runtime,
    a part of Windows, has all that is called but what windows.c adds."""
    headers = zig / "lib" / "libc" / "include" / "any-windows-any"
    return ["-nostdlib", "-isystem", str(headers), "-D_UCRT", "-lkernel32", "-lucrtbase"]


_INCLUDE = re.compile(rb'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)


def _by_content(sources: Path, name: str, folder: Path) -> str:
    """A copy of a file of `sources` in `folder`, with all that it includes from there; its path in `folder`."""
    contents: dict[str, bytes] = {}
    left = [name]
    while left:
        file = left.pop()
        contents[file] = (sources / file).read_bytes()
        included = {found.decode() for found in _INCLUDE.findall(contents[file])}
        left += [file for file in included - contents.keys() if (sources / file).is_file()]
    told = hashlib.sha256(b"".join(file.encode() + b"\0" + contents[file] + b"\0" for file in sorted(contents)))
    place = folder / told.hexdigest()[:16]
    for file, content in contents.items():
        (place / file).parent.mkdir(parents=True, exist_ok=True)
        (place / file).write_bytes(content)
    return f"{place.name}/{name}"


def fmi_headers(version: int) -> list[Path]:
    """The standard's C headers for FMI version 2 or 3, unchanged: in those of fmpy, FMI2_FUNCTION_PREFIX does nothing."""
    return sorted((_C / "fmi").glob(f"fmi{version}*.h"))


def linkage() -> dict[str, bytes]:
    """The headers by which all C files of one FMU agree on the names that the linker sees."""
    return {name: (_C / name).read_bytes() for name in ("linkage.h", "names.h")}


def fat_library(slices: Sequence[bytes]) -> bytes:
    """One universal Mach-O file of several (fat_header and fat_arch of <mach-o/fat.h>, big endian, 16 KiB pages)."""
    page = 1 << 14
    header, body = struct.pack(">II", 0xCAFEBABE, len(slices)), b""
    for code in slices:
        body += bytes(-len(body) % page)
        cpu, subtype = struct.unpack_from("<ii", code, 4)
        header += struct.pack(">iiIII", cpu, subtype, page + len(body), len(code), 14)
        body += code
    return header + bytes(page - len(header)) + body


def libraries(
    sources: Path,
    names: Sequence[str],
    identifier: str,
    fmi: int,
    targets: Mapping[str, Sequence[tuple[str, str, str]]],
    work: Path,
    flags: Sequence[str] = EXACT,
) -> dict[str, bytes]:
    """The libraries of one FMU by their place in it (`binaries/...`), compiled for `targets` (some of TARGETS), as many at
    a time as there are processors."""
    places = {
        target: work / folder / f"{identifier}{suffix}"
        for processors in targets.values()
        for target, folder, suffix in processors
    }
    with ThreadPoolExecutor(CORES) as pool:
        for job in [pool.submit(compile_library, sources, names, *place, flags) for place in places.items()]:
            job.result()
    files: dict[str, bytes] = {}
    for name, processors in targets.items():
        made = [places[target] for target, _, _ in processors]
        slices = [library.read_bytes() for library in made]
        if fmi == 3:
            files |= {f"binaries/{it.parent.name}/{it.name}": code for it, code in zip(made, slices, strict=True)}
        else:
            files[f"binaries/{name}/{made[0].name}"] = slices[0] if len(slices) == 1 else fat_library(slices)
    return files


def write_fmu(path: Path, files: Mapping[str, bytes], by: str = "") -> None:
    """A zip file whose bytes depend on its content alone. It replaces an old one at once, never leaving half a file. by: as in
    `outputs.write`."""
    with Replacing(path, by) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.create_system = 3
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])
