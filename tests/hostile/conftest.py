"""What the tests of hostile inputs share. The judge forks, and looks into /proc: Linux alone."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from generators import Workshop
    from judge import Judge

collect_ignore_glob = [] if sys.platform.startswith("linux") else ["*"]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Workshop:
    from generators import Workshop

    return Workshop(tmp_path_factory.mktemp("workshop"))


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Judge]:
    from judge import Judge

    made = Judge(tmp_path_factory.mktemp("judge") / "case")
    yield made
    made.close()
