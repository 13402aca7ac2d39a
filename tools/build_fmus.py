"""Builds the FMUs of fmus/: python tools/build_fmus.py [MODEL ...] [--platforms linux64,win64,darwin64]

A model is a folder with variables.toml, model.c, further C files and headers if it wants, and the files that it reads at
instantiation, which variables.toml names as resources (fmus/common/model.h says what they hold). It becomes <model>.fmu
(FMI 2.0) and <model>_fmi3.fmu (FMI 3.0), compiled by zig for every platform from the same sources that travel inside.
The same sources and the same compiler give the same bytes. Needs: pip install ziglang fmpy (fmpy for the FMI headers).
"""

import argparse
import hashlib
import re
import shutil
import sys
from pathlib import Path

from fmu_description import build_description, description_fmi2, description_fmi3
from fmu_variables import Model, read_model, variables_header

from fmucorrect.errors import WrapError
from fmucorrect.wrapping.compiler import TARGETS, fmi_headers, libraries, write_fmu

ROOT = Path(__file__).resolve().parent.parent
COMMON = ROOT / "fmus" / "common"
SHIPPED = ("linux64", "win64", "darwin64")


def own_sources(folder: Path, version: int) -> list[Path]:
    """The model's C files, the generic layer for one FMI version, and every header of ours that these include."""
    pending = [COMMON / "model.h", *folder.glob("*.c")]
    pending += [path for path in COMMON.glob("*.c") if path.name.startswith(("instance", f"fmi{version}"))]
    found: dict[str, Path] = {}
    while pending:
        path = pending.pop()
        if path.name in found:
            continue
        found[path.name] = path
        for name in re.findall(r'^\s*#include\s+"([^"]+)"', path.read_text(encoding="utf-8"), re.M):
            pending += [place / name for place in (folder, COMMON) if (place / name).is_file()][:1]
    return [found[name] for name in sorted(found)]


def model_token(folder: Path) -> str:
    """The guid of FMI 2.0 and instantiationToken of FMI 3.0: a hash of all that decides the model's behaviour."""
    sources = {*own_sources(folder, 2), *own_sources(folder, 3), folder / "variables.toml"}
    sources |= {folder / name for name in read_model(folder / "variables.toml").resources}
    digest = hashlib.sha256()
    for path in sorted(sources, key=lambda path: path.name):
        digest.update(path.name.encode() + b"\0" + path.read_bytes().replace(b"\r\n", b"\n"))
    code = digest.hexdigest()
    return "{" + "-".join((code[:8], code[8:12], code[12:16], code[16:20], code[20:32])) + "}"


def stage_sources(folder: Path, model: Model, version: int, place: Path) -> list[str]:
    """Writes the complete sources of one FMU into place and returns the names of the files to compile."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    for path in (*own_sources(folder, version), *fmi_headers(version)):
        shutil.copyfile(path, place / path.name)
    (place / "variables.h").write_text(variables_header(model, model_token(folder)), encoding="utf-8", newline="\n")
    return sorted(path.name for path in place.glob("*.c"))


def build(folder: Path, platforms: list[str], work: Path, destination: Path) -> list[Path]:
    """Builds both FMUs of one model folder into destination; work keeps what lies between. Returns the two paths."""
    model = read_model(folder / "variables.toml")
    if model.name != folder.name:
        raise ValueError(f"{folder / 'variables.toml'}: expected the folder's name {folder.name!r}, got {model.name!r}")
    token = model_token(folder)
    built = []
    for version in (2, 3):
        place = work / f"fmi{version}" / "sources"
        names = stage_sources(folder, model, version, place)
        files = {f"sources/{path.name}": path.read_bytes() for path in place.iterdir()}
        files |= {f"resources/{name}": (folder / name).read_bytes() for name in model.resources}
        if version == 2:
            files["modelDescription.xml"] = description_fmi2(model, token, names)
        else:
            files["modelDescription.xml"] = description_fmi3(model, token)
            files["sources/buildDescription.xml"] = build_description(model, names)
        targets = {platform: TARGETS[platform] for platform in platforms}
        files |= libraries(place, names, model.name, version, targets, (work / f"fmi{version}").resolve())
        built.append(destination / f"{model.name}{'' if version == 2 else '_fmi3'}.fmu")
        write_fmu(built[-1], files)
    return built


def main() -> None:
    models = sorted(
        path.parent.name for path in (ROOT / "fmus").glob("*/variables.toml") if (path.parent / "model.c").is_file()
    )
    parser = argparse.ArgumentParser(description="Build the FMUs of fmus/.")
    parser.add_argument("models", nargs="*", metavar="MODEL", help=f"default: all of {', '.join(models)}")
    parser.add_argument("--platforms", default=",".join(SHIPPED), help="comma-separated, default: %(default)s")
    arguments = parser.parse_args()
    platforms = arguments.platforms.split(",")
    unknown = [name for name in arguments.models if name not in models] + [
        name for name in platforms if name not in TARGETS
    ]
    if unknown:
        parser.error(
            f"unknown: {', '.join(unknown)}; models are {', '.join(models)}, platforms are {', '.join(TARGETS)}"
        )
    try:
        for name in arguments.models or models:
            for path in build(ROOT / "fmus" / name, platforms, ROOT / "build" / "fmus" / name, ROOT / "fmus" / name):
                print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1024:.0f} KiB  {', '.join(platforms)}")
    except (ValueError, WrapError) as error:
        sys.exit(f"build_fmus: {error}")


if __name__ == "__main__":
    main()
