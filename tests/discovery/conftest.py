"""What several tests of discovery share."""

import pytest


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """The loop of discovery, compiled."""
    pytest.importorskip("ziglang")
    pytest.importorskip("sympy")
    from fmucorrect.discovery import native

    return native.build(tmp_path_factory.mktemp("march"))


@pytest.fixture(scope="session")
def found(tmp_path_factory):
    """A study of two masses on a cubic spring, its folder, and what is found in it."""
    pytest.importorskip("ziglang")
    pytest.importorskip("sympy")
    from test_discover import cubic, write_study

    from fmucorrect.discovery import discover

    folder = tmp_path_factory.mktemp("cubic")
    return folder, discover(write_study(folder, cubic), folder / "out")
