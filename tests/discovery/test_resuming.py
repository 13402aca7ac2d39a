"""A discovery that was broken off goes on where it stopped, finds the same, and believes nothing that belongs to other data."""

import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from test_discover import cubic, write_study

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery import discover, fit
from fmucorrect.discovery.kept import Kept, digest, packed, remembered, unpacked
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study


class BrokenOff(Exception):
    """As by Ctrl-C, or a machine that goes down."""


def without_times(report):
    return {key: value for key, value in report.items() if key not in ("stages", "cost")}


def broken_off(study, out, stage, number):
    """Stops where a stage begins its number-th piece."""

    def progress(name, done, total):
        if (name, done) == (stage, number):
            raise BrokenOff

    with pytest.raises(BrokenOff):
        discover(study, out, progress=progress, overwrite=True)
    assert any((out / ".progress").iterdir())
    assert not (out / "report.json").exists()


@pytest.fixture
def fitted(monkeypatch):
    """How many sensitivities were simulated, the costly part of a fit."""
    count = []
    slopes = fit._slopes

    def counted(*args):
        count.append(1)
        return slopes(*args)

    monkeypatch.setattr(fit, "_slopes", counted)
    return count


def test_a_discovery_that_was_broken_off_goes_on_and_finds_the_same(tmp_path, fitted, found):
    """And what was kept is not believed once the data are others."""
    folder, fresh = found
    study, out = folder / "study.toml", tmp_path / "out"
    assert not (folder / "out" / ".progress").exists()
    broken_off(study, out, "fits", 3)
    before = len(fitted)
    assert before
    broken_off(study, out, "augmented FMU", 0)
    whole = len(fitted)
    assert whole > before
    shutil.copytree(out, tmp_path / "others")
    fitted.clear()
    again = discover(study, out)
    assert without_times(again) == without_times(fresh)
    assert not fitted  # nothing is fitted twice
    assert again["cost"]["runs"] >= fresh["cost"]["runs"]  # those of all three calls
    assert not (out / ".progress").exists()
    broken_off(write_study(tmp_path, lambda d, v: 1.3 * cubic(d, v)), tmp_path / "others", "fits", 3)
    assert fitted


def test_another_study_fmu_record_or_coupling_is_another_key(tmp_path):
    path = write_study(tmp_path, cubic)

    def key(change=lambda problem: None):
        with load(load_study(path), None, workers=1) as problem:
            change(problem)
            return problem.key

    first = key()
    assert key() == first
    assert key(lambda problem: problem.couple(4)) != first
    with load(load_study(path), None, workers=1) as problem, problem.of(problem.trials[:1]) as part:
        assert part.key != first
    inputs = tmp_path / "large.csv"
    inputs.write_text(inputs.read_text().replace("\n0.5", "\n0.50", 1))
    changed = key()
    assert changed != first
    (tmp_path / "copy.fmu").write_bytes(load_study(path).fmu.read_bytes() + b"\0")
    text = path.read_text()
    path.write_text(text.replace(str(load_study(path).fmu), "copy.fmu"))
    assert key() not in (first, changed)


def test_the_evaluation_records_are_no_part_of_the_key(tmp_path):
    path = write_study(tmp_path, cubic)
    with load(load_study(path), None, workers=1) as problem:
        before = problem.key
    write_study(tmp_path, cubic, garbage=True)
    with load(load_study(path), None, workers=1) as problem:
        assert problem.key == before


@dataclass
class Place:
    key: str
    kept: Kept | None


@dataclass
class Thing:
    """What holds a function and says what it is."""

    name: str
    make: object

    @property
    def identity(self):
        return self.name


calls: list[object] = []


@remembered
def work(place, values, things=(), done=print):
    calls.append(values)
    return {"sum": values.sum(), "large": values.T, "first": things[0] if things else None, "law": LAW}


LAW = CATALOGUE["coulomb_friction"][0]
VALUES = np.arange(20_000.0).reshape(2, -1)


def test_a_result_is_read_where_everything_is_alike(tmp_path):
    place, things = Place("a", Kept(tmp_path)), [Thing("one", lambda: 1)]
    calls.clear()
    first = work(place, VALUES, things, lambda: 0)
    assert first["law"] is LAW
    assert first["first"] is things[0]
    again = work(place, VALUES.copy(), [Thing("one", lambda: 2)], lambda: 1)
    assert len(calls) == 1
    assert (again["large"] == VALUES.T).all()
    assert again["large"].flags["C_CONTIGUOUS"] == first["large"].flags["C_CONTIGUOUS"]
    for other in (
        (replace(place, key="b"), VALUES, things),
        (place, VALUES + 1.0, things),
        (place, VALUES.astype(np.float32), things),
        (place, VALUES, [Thing("two", None)]),
    ):
        work(*other)
    assert len(calls) == 5
    assert work(Place("a", None), VALUES)["first"] is None
    assert len(calls) == 6


def test_what_was_torn_is_done_again(tmp_path):
    place = Place("a", Kept(tmp_path))
    calls.clear()
    work(place, VALUES)
    for ending in ("result", "npz"):
        for path in tmp_path.glob(f"*.{ending}"):
            path.write_bytes(path.read_bytes()[:-5])
        assert (work(place, VALUES)["large"] == VALUES.T).all()
    assert len(calls) == 3


def test_another_process_may_clear_what_is_kept(tmp_path):
    here, there = Kept(tmp_path / "kept"), Kept(tmp_path / "kept")
    calls.clear()
    work(Place("a", here), VALUES)
    there.clear()
    there.clear()
    for _ in range(2):
        assert (work(Place("a", here), VALUES)["large"] == VALUES.T).all()
    assert len(calls) == 2


def test_laws_and_values_are_read_as_they_were():
    laws = [law for known in (CATALOGUE, SIGNALS) for forms in known.values() for law in forms]
    assert all(a is b for a, b in zip(unpacked(packed(laws)), laws, strict=True))
    assert len({digest(law) for law in laws}) == len(laws)
    with pytest.raises(TypeError, match="no content"):
        digest([lambda: 0])


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (1, 1.0),
        (1, True),
        ("1", 1),
        ([1, [2]], [1, 2]),
        (["ab", "c"], ["a", "bc"]),
        (np.zeros(4), np.zeros((2, 2))),
        (b"", ""),
    ],
)
def test_what_differs_has_another_digest(a, b):
    assert digest(a) != digest(b)
    assert digest({"x": a, "y": b}) == digest({"y": b, "x": a}) != digest({"x": b, "y": a})
