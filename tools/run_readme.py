"""Runs what Markdown pages show: python tools/run_readme.py README.md docs/start/index.md ...

Each page has a temporary folder of its own beside copies of FILES. There, in order: a ```python
block runs in an interpreter of its own; of a ```console block every line that begins with "$ " runs, which must be a program
of this environment; a ```toml block that begins with "# at the end of NAME" is written there. All other blocks are shown
only, and the page says so. The code cells of a notebook run as one script. Without arguments: README.md, all pages and
notebooks of docs, and the READMEs of packages whose blocks no test runs. Stops at the first that fails.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# what a reader has beside them: the shipped rig as a clone has it, and the files of the tutorial and of the how-to pages
FILES = {
    "fmus/roller_rig": "fmus/roller_rig",
    "exported_models/roller_rig/corrector.onnx": "exported_models/roller_rig/corrector.onnx",
    "A": "fmus/roller_rig/A",  # fmucorrect/README.md: a study of the reader's own
    "roller_rig.fmu": "fmus/roller_rig/roller_rig.fmu",
    "oscillator.fmu": "fmus/oscillator/oscillator.fmu",
    "mass.py": "docs/howto/mass/mass.py",
    "mass.toml": "docs/howto/mass/mass.toml",
    "quarter_car.py": "docs/start/quarter_car/quarter_car.py",
    "test_drives.py": "docs/start/quarter_car/test_drives.py",
    "trained/corrector.onnx": "docs/start/quarter_car/corrector.onnx",
}
PACKAGES = (ROOT / "fmucorrect" / "README.md", ROOT / "fmucorrect" / "railway" / "README.md")
BLOCK = re.compile(r"^```(python|console|toml)\n(.*?)^```", re.M | re.S)
APPENDED = re.compile(r"# at the end of (\S+)\n")


def main(paths: list[Path]) -> None:
    docs = [page for kind in ("*.md", "*.ipynb") for page in sorted((ROOT / "docs").rglob(kind))]
    pages = paths or [ROOT / "README.md", *docs, *PACKAGES]
    begun = time.monotonic()
    count = sum(run(page) for page in pages)
    if not count:
        sys.exit("there is no python or console block to run")
    print(f"{count} blocks of {len(pages)} pages ran in {time.monotonic() - begun:.0f} s")


def run(page: Path) -> int:
    """How many blocks of a page ran."""
    text = page.read_text(encoding="utf-8")
    found = cells(text) if page.suffix == ".ipynb" else BLOCK.findall(text)
    blocks = [(kind, text) for kind, text in found if kind != "toml" or APPENDED.match(text)]
    if not blocks:
        return 0
    print(f"=== {page}", flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for target, source in FILES.items():
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (ROOT / source).is_dir() else shutil.copyfile)(ROOT / source, folder / target)
        for kind, text in blocks:
            begun = time.monotonic()
            if kind == "python":
                print(f"--- python\n{text}", flush=True)
                subprocess.run([sys.executable, "-c", text], cwd=folder, check=True)
            elif kind == "toml":
                with (folder / text.split()[5]).open("a", encoding="utf-8") as stream:
                    stream.write("\n" + text)
            else:
                for line in text.splitlines():
                    if line.startswith("$ "):
                        command(line, folder)
            print(f"--- {time.monotonic() - begun:.1f} s", flush=True)
    return len(blocks)


def cells(notebook: str) -> list[tuple[str, str]]:
    """The code cells, one script: a kernel would need packages that nothing else here does."""
    code = [cell["source"] for cell in json.loads(notebook)["cells"] if cell["cell_type"] == "code"]
    return [("python", "\n\n".join("".join(lines) for lines in code))]


def command(line: str, folder: Path) -> None:
    """One line of a console block, by the program of this environment."""
    print(f"--- {line}", flush=True)
    program, *arguments = shlex.split(line.removeprefix("$ "))
    path = Path(sys.executable).with_name(program)
    if not path.is_file():
        found = shutil.which(program)  # an environment that is laid over another one
        if found is None:
            sys.exit(f"{line}: there is no {program} in this environment")
        path = Path(found)
    words = [word for a in arguments for word in (matching(a, folder) if "*" in a else [a])]
    subprocess.run([str(path), *words], cwd=folder, check=True, env={**os.environ, "CI": "true"})


def matching(pattern: str, folder: Path) -> list[str]:
    """As a shell would say it."""
    return sorted(str(path.relative_to(folder)) for path in folder.glob(pattern))


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
