"""Runs what a Markdown file shows: python tools/run_readme.py README.md

Every ```python block runs in one interpreter, in order, in a temporary folder beside copies of the files it names; every
```console block has its lines that begin with "$ fmucorrect" run there too. Stops at the first that fails.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# what a user of the README has beside them: a study with its FMU and records, a corrector, and models with mapping files
FILES = {
    "roller_rig.fmu": "fmus/roller_rig/roller_rig.fmu",
    "A": "fmus/roller_rig/A",
    "corrector.onnx": "exported_models/roller_rig/corrector.onnx",
    **{
        f"{model}/{name}": f"fmus/{model}/{name}"
        for model in ("full_vehicle", "roller_rig")
        for name in ("assess.toml", f"{model}.fmu")
    },
}


def main(path: Path) -> None:
    blocks = re.findall(r"^```(python|console)\n(.*?)^```", path.read_text(encoding="utf-8"), re.M | re.S)
    if not blocks:
        sys.exit(f"{path}: there is no python or console block to run")
    with tempfile.TemporaryDirectory() as folder:
        for name, source in FILES.items():
            copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copyfile
            (Path(folder) / name).parent.mkdir(exist_ok=True)
            copy(ROOT / source, Path(folder) / name)
        for kind, text in blocks:
            if kind == "python":
                print(f"--- python\n{text}", flush=True)
                subprocess.run([sys.executable, "-c", text], cwd=folder, check=True)
                continue
            for line in text.splitlines():
                if line.startswith("$ fmucorrect "):
                    print(f"--- {line}", flush=True)
                    command = [str(Path(sys.executable).with_name("fmucorrect")), *shlex.split(line)[2:]]
                    subprocess.run(command, cwd=folder, check=True, env={**os.environ, "CI": "true"})
    print(f"{path}: {len(blocks)} blocks ran")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
