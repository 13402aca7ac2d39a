"""Shapes and types of the whole package are checked while the tests run, its own processes are forked ones; no test is asked
how long it takes."""

import functools
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import jaxtyping
import pytest
from forked import Nursery
from hypothesis import settings

CHECKED_CALLS = 2
"""So many calls of each function are checked in each test, as a second one may have other shapes: loops took twice as long
where all of them were."""

whole = jaxtyping.jaxtyped
calls: dict[int, list[int]] = {}
"""Calls in this test, of each function by its code: what is defined in a function is made anew in each call."""


def jaxtyped(fn: Any, *, typechecker: Any) -> Any:
    """As jaxtyping's, for the first calls; nothing is compiled for a function that no test calls."""
    if not hasattr(fn, "__code__"):
        return whole(fn, typechecker=typechecker)
    seen = calls.setdefault(id(fn.__code__), [0])
    checked: Callable[..., Any] | None = None

    @functools.wraps(fn)
    def first(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if seen[0] >= CHECKED_CALLS:
            return fn(*args, **kwargs)
        seen[0] += 1
        if checked is None:
            checked = whole(fn, typechecker=typechecker)
        return checked(*args, **kwargs)

    return first


# of classes, methods and properties jaxtyping wraps each function by the second name
jaxtyping.jaxtyped = lambda *, typechecker: functools.partial(jaxtyped, typechecker=typechecker)
jaxtyping._decorator.jaxtyped = jaxtyped

# tools/mutation.py has only the module checked that it changed: so all others run as they are
hook = jaxtyping.install_import_hook(os.environ.get("FMUCORRECT_CHECKED", "fmucorrect"), "beartype.beartype")

# behind the hook, which has them checked
from fmucorrect.fmu import process  # noqa: E402
from fmucorrect.records import child  # noqa: E402

solvers = Nursery(["fmucorrect.fmu.child"])
libraries = Nursery(
    ["fmucorrect.records.child", "pyarrow.parquet", "pandas", "asammdf", "h5py", "scipy.io", "pyuff", "tdm_loader"]
)

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

TOGETHER = ("training", "wrapping")
"""Folders whose tests share what takes long to make: under pytest-xdist they stay in one process, others file by file."""
WITH = dict.fromkeys(("test_elsewhere", "test_resuming", "test_time_limit", "test_estimate"), "test_discover")
"""Files that share it with one other."""
FIRST = ("training", "wrapping", "test_discover")
"""Groups that take longest, in the order in which they are begun: what begins last keeps one process busy alone."""

START = ("test_places", "test_isolated", "test_trouble", "test_mutations", "test_the_child")
"""Files and tests of the processes that solvers and libraries for logs have: only there is each a Python begun anew."""


@pytest.hookimpl(tryfirst=True)  # before fixtures
def pytest_runtest_setup(item: pytest.Item) -> None:
    for seen in calls.values():
        seen[0] = 0
    if sys.platform == "linux":
        begun = any(name in item.nodeid for name in START)
        vars(process)["subprocess"] = subprocess if begun else solvers
        vars(child)["subprocess"] = subprocess if begun else libraries


def pytest_sessionfinish() -> None:
    solvers.close()
    libraries.close()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: Sequence[str]) -> None:
    """Ends the run where pytest-xdist lost the groups, as it does without a word under a pytest that it does not know: what
    tests share would be made in each process, which takes twice as long."""
    if node.config.getoption("dist") == "loadgroup" and not all("@" in name for name in ids):
        pytest.exit("tests are in no group under pytest-xdist: take a pytest that it knows", returncode=4)


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks for groups, or there are none
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    groups: dict[str, list[pytest.Item]] = {name: [] for name in FIRST}
    for item in items:
        folder = item.path.parent.name
        file = item.path.stem
        group = folder if folder in TOGETHER else WITH.get(file, file)
        item.add_marker(pytest.mark.xdist_group(group))
        groups.setdefault(group, []).append(item)
    items[:] = [item for group in groups.values() for item in group]
