"""What the documentation is made with: links of README files as pages, evidence from committed results, blocks that run."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import nbformat  # comes with fmpy
import pytest

ROOT = Path(__file__).resolve().parent.parent


def tool(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    return importlib.import_module(name)


@pytest.mark.parametrize(
    ("page", "link", "made"),
    [
        ("index.md", "[x](fmucorrect/README.md#training)", "[x](reference/study.md#training)"),
        ("reference/records.md", "[x](../wrapping/README.md)", "[x](wrapping.md)"),
        ("reference/training.md", "[window.py](window.py)", "`fmucorrect/training/window.py`"),
        ("index.md", "[all](LICENSE)", "all (`LICENSE`)"),
        ("index.md", "![p](exported_models/random_rigs.svg)", "![p](files/exported_models/random_rigs.svg)"),
        ("start/index.md", "[x](../../CONTRIBUTING.md)", "[x](../project/contributing.md)"),
        ("start/index.md", "[x](rig.md)", "[x](rig.md)"),
        ("index.md", "[x](no/such/file.md)", "[x](no/such/file.md)"),
        ("index.md", "[x](https://semver.org)", "[x](https://semver.org)"),
    ],
)
def test_a_link_leads_where_it_led_in_the_project(page: str, link: str, made: str, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("mkdocs")
    site = tool("docs_site", monkeypatch)
    assert site.link(page, *site.LINK.fullmatch(link).groups()) == made


def test_the_evidence_is_what_was_committed(monkeypatch: pytest.MonkeyPatch):
    evidence = tool("evidence", monkeypatch)
    for name, text in evidence.pages().items():
        assert (ROOT / "docs" / "evidence" / name).read_text("utf-8") == text, "run: python tools/evidence.py"


def test_no_case_seed_or_commit_on_the_pages(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("mkdocs")
    site = tool("docs_site", monkeypatch)
    for page in [*(ROOT / "docs").rglob("*.md"), *(ROOT / source for source in site.PAGES.values())]:
        text = page.read_text(encoding="utf-8")
        assert "osc_" not in text, page
        lines = [line for line in text.splitlines() if "sha256" not in line]
        assert not site.COMMIT.findall("\n".join(site.FENCE.split("\n".join(lines))[::2])), page


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("```python\nraise SystemExit(3)\n```\n", "non-zero exit status 3"),
        ("```console\n$ fmucorrect inspect nothing.fmu\n```\n", "non-zero exit status 2"),
        ("```console\n$ no-such-program\n```\n", "there is no no-such-program"),
        ("```console\n$ fmucorrect --version\n```\n\n```text\nfmucorrect, version ...\n```\n", ""),
        ("```console\n$ fmucorrect --version\n```\n\n```text\nversion 99\n```\n", "did not print:\nversion 99"),
        ("```sh\nfalse\n```\n", "no python or console block"),
        ("```toml\n# at the end of a.txt\nx = 1\n```\n```python\nassert 'x = 1' in open('a.txt').read()\n```\n", ""),
    ],
)
def test_blocks_of_a_page_run(text: str, error: str, tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools/run_readme.py"), str(page)], capture_output=True, text=True
    )
    assert (done.returncode == 0) == (not error), done.stderr
    assert error in done.stderr


@pytest.mark.parametrize(
    ("shown", "line", "same"),
    [
        ("falls to 0.00964 %", "falls to 0.00963 %", True),
        ("falls to 0.00964 %", "falls to 0.0106 %", False),
        ("3.881e-07 +- 1.3e-07 m", "3.82e-07 +- 1.3e-07 m", True),
        ("3.881e-07 +- 1.3e-07 m", "3.881e-06 +- 1.3e-07 m", False),
        ("named: friction 2.00 N", "unexplained: friction 2.00 N", False),
        ("6 runs, ... 4.36 %", "6 runs, 2 s each, 4.35 %", True),
        ("6 runs, ... 4.36 %", "7 runs, 2 s each, 4.36 %", False),
        ("channel x1", "channel x2", False),
    ],
)
def test_numbers_of_a_page_are_alike_on_another_processor(
    shown: str, line: str, same: bool, monkeypatch: pytest.MonkeyPatch
):
    assert tool("run_readme", monkeypatch).alike(shown, line) == same


@pytest.mark.parametrize(("last", "error"), [("assert x == 1", ""), ("assert x == 2", "assert x == 2")])
def test_the_cells_of_a_notebook_run_as_one_script(last: str, error: str, tmp_path: Path):
    cells = [{"cell_type": kind, "source": text} for kind, text in
             (("code", ["x = 0\n", "x += 1"]), ("markdown", ["no code"]), ("code", [last]))]  # fmt: skip
    page = tmp_path / "page.ipynb"
    page.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools/run_readme.py"), str(page)], capture_output=True, text=True
    )
    assert (done.returncode == 0) == (not error), done.stderr
    assert error in done.stderr


def test_notebooks_are_valid_and_hold_no_outputs():
    pages = sorted((ROOT / "docs").rglob("*.ipynb"))
    assert pages
    for page in pages:
        notebook = nbformat.read(page, nbformat.NO_CONVERT)
        nbformat.validate(notebook)
        code = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert not [cell.source for cell in code if cell.outputs or cell.execution_count], page
