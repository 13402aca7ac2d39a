"""What several tests of discovery share."""

import pytest


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """The loop of discovery, compiled."""
    pytest.importorskip("ziglang")
    pytest.importorskip("sympy")
    from fmucorrect.discovery import native

    return native.build(tmp_path_factory.mktemp("march"))
