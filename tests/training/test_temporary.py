"""What training leaves among temporary files: nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TRAINED = """
import torch
from fmucorrect.training.loop import adam
layer = torch.nn.Linear(2, 2)
optimiser = adam(layer, 1e-3, 0.0)
layer(torch.ones(1, 2)).sum().backward()
optimiser.step()
"""


def test_an_optimiser_leaves_no_folder_of_compiled_code(tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "TORCHINDUCTOR_CACHE_DIR"}
    environment |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(tmp_path))
    subprocess.run([sys.executable, "-c", TRAINED], check=True, env=environment)
    assert list(tmp_path.iterdir()) == []
