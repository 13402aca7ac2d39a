"""Runs what Markdown pages show: python tools/run_readme.py README.md docs/start/index.md ...

Each page has a temporary folder of its own beside copies of FILES. There, in order: a ```python block runs in an interpreter
of its own; of a ```console block every line that begins with "$ " runs, which must be a program of this environment; each
line of a ```text block behind one of these must have come of it, "..." standing for anything and numbers alike to ALIKE; a
```toml block that begins with "# at the end of NAME" is written there. All other blocks are shown only, and the page says so.
The code cells of a notebook run as one script. Without arguments: README.md, all pages and notebooks of docs, and the READMEs
of packages whose blocks no test runs. Stops at the first that fails.
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
from decimal import Decimal
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
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)
APPENDED = re.compile(r"# at the end of (\S+)\n")
NUMBER = r"(\d+(?:\.\d+)?(?:e[-+]?\d+)?)"
ALIKE = 0.02  # of a number, or one in its last decimal: another processor's vector units sum in another order


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
    count = sum(runs(kind, text) for kind, text in found)
    if not count:
        return 0
    print(f"=== {page}", flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for target, source in FILES.items():
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (ROOT / source).is_dir() else shutil.copyfile)(ROOT / source, folder / target)
        said = None
        for kind, text in found:
            begun = time.monotonic()
            if kind == "text" and said is not None:
                compare(text, said)
            said = None
            if not runs(kind, text):
                continue
            if kind == "python":
                print(f"--- python\n{text}", flush=True)
                said = printed([sys.executable, "-c", text], folder)
            elif kind == "toml":
                with (folder / text.split()[5]).open("a", encoding="utf-8") as stream:
                    stream.write("\n" + text)
            else:
                said = "".join(command(line, folder) for line in text.splitlines() if line.startswith("$ "))
            print(f"--- {time.monotonic() - begun:.1f} s", flush=True)
    return count


def runs(kind: str, text: str) -> bool:
    """Whether a block is more than shown."""
    return kind in ("python", "console") or (kind == "toml" and APPENDED.match(text) is not None)


def cells(notebook: str) -> list[tuple[str, str]]:
    """The code cells, one script: a kernel would need packages that nothing else here does."""
    code = [cell["source"] for cell in json.loads(notebook)["cells"] if cell["cell_type"] == "code"]
    return [("python", "\n\n".join("".join(lines) for lines in code))]


def compare(text: str, said: str) -> None:
    """Ends the run where a page shows a line that did not come of its commands."""
    lines = said.splitlines()
    for shown in filter(str.strip, text.splitlines()):
        if not any(alike(shown, line) for line in lines):
            sys.exit(f"the page shows a line that the commands before it did not print:\n{shown}")


def alike(shown: str, line: str) -> bool:
    """Whether a line that a page shows may stand for one that was printed: the same words, and numbers that are ALIKE."""
    shown, line = " ".join(shown.split()), " ".join(line.split())
    words = re.split(rf"(?<![\w.]){NUMBER}", shown)  # words, number, words, ..., words
    wanted = "".join(NUMBER if k % 2 else ".*".join(map(re.escape, part.split("..."))) for k, part in enumerate(words))
    found = re.fullmatch(wanted, line)
    return found is not None and all(map(near, words[1::2], found.groups()))


def near(shown: str, printed: str) -> bool:
    """Whether two numbers are ALIKE."""
    last = Decimal(1).scaleb(int(Decimal(shown).as_tuple().exponent)) if "." in shown else 0
    return abs(Decimal(printed) - Decimal(shown)) <= max(last, Decimal(ALIKE) * abs(Decimal(shown)))


def command(line: str, folder: Path) -> str:
    """What one line of a console block printed, by the program of this environment."""
    print(f"--- {line}", flush=True)
    program, *arguments = shlex.split(line.removeprefix("$ "))
    path = Path(sys.executable).with_name(program)
    if not path.is_file():
        found = shutil.which(program)  # an environment that is laid over another one
        if found is None:
            sys.exit(f"{line}: there is no {program} in this environment")
        path = Path(found)
    words = [word for a in arguments for word in (matching(a, folder) if "*" in a else [a])]
    return printed([str(path), *words], folder)


def printed(arguments: list[str], folder: Path) -> str:
    """What a program prints, shown as it comes. Raises subprocess.CalledProcessError where it fails."""
    environment, said = {**os.environ, "CI": "true", "PYTHONUNBUFFERED": "1"}, ""
    out, both = subprocess.PIPE, subprocess.STDOUT
    with subprocess.Popen(arguments, cwd=folder, env=environment, stdout=out, stderr=both, text=True) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            said += line
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, arguments)
    return said


def matching(pattern: str, folder: Path) -> list[str]:
    """As a shell would say it."""
    return sorted(str(path.relative_to(folder)) for path in folder.glob(pattern))


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
