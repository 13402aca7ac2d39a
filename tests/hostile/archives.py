"""FMU archives: entries that should not be there, damaged libraries, hostile XML, and solvers that misbehave (hostile.c)."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import io
import random
import re
import shutil
import stat
import subprocess
import sys
import zipfile
import zlib
from functools import cache
from pathlib import Path

import damage

HERE = Path(__file__).parent
OSCILLATOR = HERE.parents[1] / "fmus" / "oscillator"
WHERE = ("constructor", "instantiate", "initialise", "step", "get", "free", "destructor", "nowhere")
WHAT = ("crash", "leave", "abort", "loop", "memory", "talk", "sleep", "fail", "overflow")
VALUES = (
    "", "0", "-1", "1", "nan", "INF", "1e400", "4294967296", "9" * 300, "abc", "true", "2.0", "3.0", "4.0", "..", "/", "../../evil", "a/b", "con", "x" * 5000, "&#0;", "&#x1b;[31m",
    "&lt;script&gt;", "??/", "é", "\U0001f682", "input", "output", "parameter", "local", "independent", "fixed", "continuous", "exact", "calculated", "mass1.x", "m/s", "parsec",
)  # fmt: skip
BOMB_MB = 3000
STUDY = """format = 1
name = "a solver of someone else's"
[simulation]
fmu = "model.fmu"
step_size = 0.001
[[channels]]
name = "y"
simulation = "y"
measurement = "y"
quantity = "displacement"
unit = "m"
[[conditions]]
name = "a"
role = "development"
measurement = "measured.csv"
"""
MEASURED = "\n".join(["time,y [m]", *(f"{i / 1000},{i / 1000}" for i in range(31)), ""]).encode()
XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="hostile" guid="{1}">
<CoSimulation modelIdentifier="hostile" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="m"/></UnitDefinitions>
<ModelVariables><ScalarVariable name="y" valueReference="0" causality="output"><Real unit="m"/></ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure></fmiModelDescription>"""


def library(folder: Path, where: str, what: str) -> Path:
    """hostile.c, compiled for this machine."""
    path = folder / f"hostile_{where}_{what}.so"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined"]
        flags = [f"-DWHERE={WHERE.index(where)}", f"-DWHAT={WHAT.index(what)}", "-shared", "-fPIC", "-O0", "-w"]
        made = path.with_suffix(".part")
        subprocess.run([*compiler, *flags, "-o", str(made), str(HERE / "hostile.c")], check=True)
        made.rename(path)
    return path


def misbehaving(folder: Path, where: str, what: str) -> bytes:
    """An FMU whose solver does it."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", XML)
        archive.write(library(folder, where, what), "binaries/linux64/hostile.so")
    return out.getvalue()


@cache
def slim(name: str = "oscillator.fmu") -> bytes:
    """The shipped oscillator with what this machine needs alone."""
    out = io.BytesIO()
    with zipfile.ZipFile(OSCILLATOR / name) as archive, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for info in archive.infolist():
            if not re.match(r"binaries/(?!linux64|x86_64-linux)|sources/|documentation/", info.filename):
                made.writestr(info, archive.read(info))
    return out.getvalue()


def repacked(
    fmu: bytes, change: dict[str, bytes | None], more: list[tuple[zipfile.ZipInfo, bytes]] | None = None
) -> bytes:
    """The archive with entries changed, left out (None) or added."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for info in archive.infolist():
            content = change.get(info.filename, archive.read(info))
            if content is not None:
                made.writestr(zipfile.ZipInfo(info.filename), content, zipfile.ZIP_DEFLATED)
        for info, content in more or []:
            made.writestr(info, content, info.compress_type)
    return out.getvalue()


def read(fmu: bytes, ending: str) -> tuple[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
        name = next(name for name in archive.namelist() if name.endswith(ending))
        return name, archive.read(name)


def hostile_xml(rng: random.Random, fmu: bytes) -> tuple[bytes, str]:
    name, xml = read(fmu, "modelDescription.xml")
    kind = rng.random()
    if kind < 0.55:
        found = list(re.finditer(rb'(\w+)="([^"]*)"', xml))
        match = rng.choice(found[:12] if rng.random() < 0.3 else found)
        value = rng.choice(VALUES).encode()
        new, what = xml[: match.start(2)] + value + xml[match.end(2) :], f"{match[0][:40]!r} made {value[:20]!r}"
    elif kind < 0.7:
        found = list(re.finditer(rb' \w+="[^"]*"', xml))
        match = rng.choice(found)
        new, what = xml[: match.start()] + xml[match.end() :], f"{match[0][:40]!r} deleted"
    elif kind < 0.8:
        found = list(re.finditer(rb"<(\w+)[^<>]*/>|<ScalarVariable.*?</ScalarVariable>", xml, re.S))
        match = rng.choice(found)
        twice = rng.random() < 0.5
        new, what = (
            xml[: match.start()] + match[0] * (2 if twice else 0) + xml[match.end() :],
            f"{match[0][:40]!r} {'doubled' if twice else 'deleted'}",
        )
    elif kind < 0.9:
        found = damage.damaged(rng, xml, b"", True)
        new, what = found.data, found.what
    else:
        new, what = rng.choice(_documents(xml))
    return repacked(fmu, {name: new}), f"XML: {what}"


def _documents(xml: bytes) -> list[tuple[bytes, str]]:
    body = xml[xml.index(b"<fmiModelDescription") :]
    entities = (
        b'<!DOCTYPE a [<!ENTITY a0 "ha">'
        + b"".join(b'<!ENTITY a%d "%s">' % (i, b"&a%d;" % (i - 1) * 10) for i in range(1, 12))
        + b"]>"
    )
    return [
        (xml.decode("utf-8").encode("utf-16"), "in UTF-16 that says UTF-8"),
        (b'<?xml version="1.0" encoding="UTF-7"?>' + body, "in UTF-7"),
        (b'<?xml version="1.0" encoding="ebcdic-cp-us"?>' + body, "in EBCDIC"),
        (b'<?xml version="1.0" encoding="nonsense"?>' + body, "in an unknown encoding"),
        (entities + body.replace(b'modelName="', b'modelName="&a11;', 1), "entities that multiply"),
        (b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + body.replace(b'description="', b'description="&x;', 1), "an external entity"),
        (b'<!DOCTYPE a SYSTEM "http://127.0.0.1:1/a.dtd">' + body, "an external DTD"),
        (b"<a>" * 100_000 + b"</a>" * 100_000, "nested deeply"),
        (xml[: xml.index(b"<ModelVariables>") + 16] + b"<x>" * 20_000 + xml[xml.index(b"<ModelVariables>") + 16 :], "never closed"),
        (xml.replace(b"<ModelVariables>", b"<ModelVariables>" + b'<ScalarVariable name="v" valueReference="1"><Real/></ScalarVariable>' * 100_000), "100 000 variables of one name"),
        (xml.replace(b"</fmiModelDescription>", b"<!-- " + b"x" * 80_000_000 + b" --></fmiModelDescription>"), "80 MB of comment"),
        (b"", "empty"), (b"\0" * 100, "zeros"), (b"<fmiModelDescription/>", "nothing in it"), (b"\xef\xbb\xbf" + xml, "a byte order mark"),
    ]  # fmt: skip


def hostile_entries(rng: random.Random, fmu: bytes) -> tuple[bytes, str]:
    kind = rng.choice(("up", "up", "absolute", "backslash", "link", "link up", "device", "double", "lost", "empty", "bomb", "many", "renamed", "directory", "long", "encrypted", "method", "text library", "comment"))  # fmt: skip
    xml_name, xml = read(fmu, "modelDescription.xml")
    library_name, content = read(fmu, ".so")
    change: dict[str, bytes | None] = {}
    more: list[tuple[zipfile.ZipInfo, bytes]] = []

    def add(name: str, data: bytes = b"evil", mode: int = stat.S_IFREG | 0o644) -> None:
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr, info.compress_type = 3, mode << 16, zipfile.ZIP_DEFLATED
        more.append((info, data))

    if kind == "up":
        add(
            rng.choice(
                (
                    "../evil.txt",
                    "resources/../../../evil.txt",
                    "resources/../../in/study.toml",
                    "....//evil",
                    "../in/measured.csv",
                )
            )
        )
    elif kind == "absolute":
        add(rng.choice(("/tmp/fmucorrect_evil.txt", "//tmp/evil", "C:/evil.txt", "C:evil.txt")))
    elif kind == "backslash":
        add("resources\\..\\..\\..\\evil.txt")
    elif kind == "link":
        add("resources/link", b"/etc", stat.S_IFLNK | 0o777)
        add("resources/link/evil.txt")
    elif kind == "link up":
        add("resources/link", b"../../..", stat.S_IFLNK | 0o777)
        add("resources/link/evil.txt")
    elif kind == "device":
        add(
            rng.choice(("resources/con", "resources/nul.txt", "resources/a:b", "resources/\x01", "resources/pipe")),
            b"",
            rng.choice((stat.S_IFIFO, stat.S_IFCHR, stat.S_IFREG)) | 0o644,
        )
    elif kind == "double":
        name = rng.choice((xml_name, library_name, "MODELDESCRIPTION.XML"))
        add(name, rng.choice((b"", xml, content)))
    elif kind == "lost":
        change[rng.choice((xml_name, library_name))] = None
    elif kind == "empty":
        change[rng.choice((xml_name, library_name))] = b""
    elif kind == "bomb":
        return _bomb(
            rng.choice(("resources/data.bin", "modelDescription.xml", library_name))
        ), f"entries: {BOMB_MB} MB from 3 MB"
    elif kind == "many":
        for i in range(20_000):
            add(f"resources/{i}", b"")
    elif kind == "renamed":
        change[library_name] = None
        add(
            rng.choice(
                (
                    library_name.replace(".so", ".dll"),
                    library_name.replace("linux64", "linux32").replace("x86_64-linux", "riscv-linux"),
                    "binaries/linux64/other.so",
                )
            ),
            content,
        )
    elif kind == "directory":
        change[library_name] = None
        add(library_name + "/", b"")
    elif kind == "long":
        add("resources/" + "x" * rng.choice((300, 5000, 60_000)))
    elif kind in ("encrypted", "method"):
        data = bytearray(fmu)
        for mark, offset in ((b"PK\1\2", 8), (b"PK\3\4", 6)):
            for match in re.finditer(re.escape(mark), bytes(data)):
                at = match.start() + offset + (0 if kind == "encrypted" else 2)
                data[at : at + 2] = (1 if kind == "encrypted" else rng.choice((1, 9, 12, 14, 93, 99))).to_bytes(
                    2, "little"
                )
        return bytes(data), f"entries: {kind}"
    elif kind == "text library":
        change[library_name] = rng.choice(
            (
                b"#!/bin/sh\ntouch evil\n",
                b"\x7fELF" + bytes(100),
                b"INPUT(/etc/passwd)",
                content[: len(content) // 2],
                content[:64],
            )
        )
    else:
        return fmu[:-2] + (65535).to_bytes(2, "little") + bytes(65535), "entries: a long comment"
    return repacked(fmu, change, more), f"entries: {kind} {more[0][0].filename[:40] if more else ''}"


def zeros(megabytes: int) -> bytes:
    """So many MB of zeros as a raw deflate stream, made of the stream of one."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + again * (megabytes - 1) + packer.flush()


@cache
def _bomb(name: str) -> bytes:
    """The slim oscillator with an entry that unpacks to BOMB_MB, whose sizes and checksum are true."""
    crc, block = 0, bytes(1 << 20)
    for _ in range(BOMB_MB):
        crc = zlib.crc32(block, crc)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(slim())) as archive, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for info in archive.infolist():
            if info.filename != name:
                made.writestr(info, archive.read(info))
        made.writestr(zipfile.ZipInfo(name), zeros(BOMB_MB), zipfile.ZIP_STORED)
        start = made.getinfo(name).header_offset
    data = bytearray(out.getvalue())
    central = data.rindex(name.encode()) - 46
    for at, method, sums in ((start, 8, 14), (central, 10, 16)):
        data[at + method : at + method + 2] = b"\x08\x00"
        data[at + sums : at + sums + 4] = crc.to_bytes(4, "little")
        data[at + sums + 8 : at + sums + 12] = (BOMB_MB << 20).to_bytes(4, "little")
    return bytes(data)


def damaged_library(rng: random.Random, fmu: bytes) -> tuple[bytes, str]:
    """The library's bytes: in its headers, its tables or its code; the archive itself is whole."""
    name, content = read(fmu, ".so")
    found = damage.damaged(rng, content)
    return repacked(fmu, {name: found.data}), f"library: {found.what}"
