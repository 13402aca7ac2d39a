"""Shapes and types of the whole package are checked while the tests run; no test is asked how long it takes."""

import os

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

# tools/mutation.py has only the module checked that it changed: the whole package takes four seconds to import so
hook = install_import_hook(os.environ.get("FMUCORRECT_CHECKED", "fmucorrect"), "beartype.beartype")

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

TOGETHER = ("training", "wrapping")
"""Folders whose tests share what takes long to make: under pytest-xdist they stay in one process, others file by file."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        folder = item.path.parent.name
        item.add_marker(pytest.mark.xdist_group(folder if folder in TOGETHER else item.path.stem))
