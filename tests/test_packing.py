"""Values come back from bytes to the bit, and bytes of any kind make nothing but values."""

import contextlib
import pickle
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.packing import pack, unpack
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import Status

LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text() | st.binary()
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner)
        | st.lists(inner).map(tuple)
        | st.dictionaries(st.text() | st.integers(), inner)
        | st.dictionaries(st.text(), inner).map(MappingProxyType)
    ),
    max_leaves=20,
)


def alike(a: object, b: object) -> bool:
    return type(a) is type(b) and repr(a) == repr(b)


@given(VALUES)
def test_values_come_back(value: object) -> None:
    assert alike(unpack(pack(value)), value)


def test_what_the_package_makes_comes_back() -> None:
    channel = Channel("FW", unit="mm", noise=0.1)
    value = [channel, Condition("300", speed=300.0, inputs=Path("a/b.csv")), Status.OUTSIDE, slice(1, None, 2), {3, 1}]
    found = unpack(pack(value))
    assert found == value
    assert [*map(type, found)] == [*map(type, value)]


@pytest.mark.parametrize("kind", ["f8", "f4", ">f8", "c16", "i8", "u1", "?"])
def test_arrays_come_back_in_their_order(kind: str) -> None:
    array = np.arange(24.0).reshape(2, 3, 4).astype(kind)
    for given_ in (array, array.T, array[:, ::2], array[:0], array[0, 0, 0], np.asarray(array[0, 0, 0])):
        found = unpack(pack([given_, given_]))
        assert alike(found[0], given_)
        assert np.asarray(found[0]).dtype == np.asarray(given_).dtype
        if isinstance(given_, np.ndarray):
            assert found[0].tobytes("A") == np.array(given_, order="K", copy=True).tobytes("A") or not given_.size
            assert found[0].flags.f_contiguous == (given_.flags.f_contiguous or found[0].flags.f_contiguous)
            assert found[0].flags.writeable


def test_floats_that_json_does_not_know() -> None:
    nan, high, low = unpack(pack([float("nan"), float("inf"), -float("inf")]))
    assert nan != nan
    assert (high, low) == (float("inf"), -float("inf"))


@dataclass(frozen=True)
class Foreign:
    """A dataclass that is not of the package."""

    number: int = 1


class Kind(Enum):
    ONE = 1


@pytest.mark.parametrize(
    "value", [Foreign(), Kind.ONE, print, np.array([object()]), np.array(["a"]), 1j, CATALOGUE["preload"][0].formula]
)
def test_what_is_no_value_is_not_written(value: object) -> None:
    with pytest.raises(TypeError, match="cannot be kept"):
        pack(value)


@pytest.mark.parametrize(
    "tree",
    [
        '{"of": ["os", "system", [["command", "true"]]]}',
        '{"of": ["fmucorrect.packing", "sys", []]}',
        '{"of": ["fmucorrect.packing", "own", []]}',
        '{"of": ["fmucorrect.packing", "Path", [["a", 1]]]}',
        '{"of": ["fmucorrect.bundle", "Bundle", []]}',
        '{"of": ["fmucorrect.__main__", "main", []]}',
        '{"of": ["fmucorrect.signals", "Channel", [["name", "x"]]]}',
        '{"of": ["fmucorrect.signals", "Channel", [["name", "x"], ["__class__", 1]]]}',
        '{"enum": ["fmucorrect.signals", "Channel", "x"]}',
        '{"array": ["|O", [1], "C", 0, 8]}',
        '{"array": ["<f8", [1000000000000], "C", 0, 0]}',
        '{"array": ["<f8", [-1, -1], "C", 0, 8]}',
        '{"array": ["<f8", [2], "C", 0, 16]}',
        '{"number": ["<f8", [], "C", -8, 8]}',
        '{"for": ["law", ["Law", "x"]]}',
        '{"tuple": 1}',
        '{"a": 1, "b": 2}',
        "{}",
        "[" * 100_000,
        '{"tuple": [' * 5_000,
        "NaN NaN",
        "",
    ],
)
def test_what_was_not_written_here_is_refused(tree: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        unpack(b"fmucorrect values 1\n" + tree.encode() + b"\n" + bytes(8))


def test_a_pickle_is_refused_unopened(tmp_path: Path) -> None:
    class Runs:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "ran",))

    with pytest.raises(ValueError, match="no values"):
        unpack(pickle.dumps(Runs()))
    assert not (tmp_path / "ran").exists()


@settings(max_examples=300)
@given(st.data())
def test_changed_bytes_give_values_or_an_error(data: st.DataObject) -> None:
    content = bytearray(pack([Channel("FW"), np.arange(4.0), (1, {"a": 2.5}), Status.OK]))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(ValueError):
        unpack(bytes(content[: data.draw(st.integers(0, len(content)))]))
