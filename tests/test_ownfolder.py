"""Code is loaded from a folder of the user's own, or from none that was there before."""

import sys
from collections.abc import Generator
from pathlib import Path

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import ownfolder
from fmucorrect.discovery import native
from fmucorrect.ownfolder import own, own_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="owners and modes are POSIX's")


@pytest.fixture
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Where this user's caches are said to be."""
    monkeypatch.setattr(ownfolder, "_caches", lambda: tmp_path / "caches")
    own_folder.cache_clear()
    yield tmp_path / "caches"
    own_folder.cache_clear()


def test_it_is_made_for_the_user_alone(caches: Path) -> None:
    folder = own_folder()
    assert folder == caches / "fmucorrect"
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_to_is_not_used(caches: Path) -> None:
    (caches / "fmucorrect").mkdir(parents=True)
    (caches / "fmucorrect").chmod(0o777)
    folder = own_folder()
    assert caches not in folder.parents
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_link_is_not_followed(caches: Path, tmp_path: Path) -> None:
    caches.mkdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (caches / "fmucorrect").symlink_to(tmp_path / "elsewhere")
    assert tmp_path not in own_folder().parents


def test_a_user_without_a_home_gets_one_that_nobody_foresees(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(ownfolder, "_caches", none)
    own_folder.cache_clear()
    folder = own_folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    own_folder.cache_clear()
    assert own_folder() != folder
    own_folder.cache_clear()


def test_a_library_that_another_user_could_have_put_there_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Path] = []

    def compiled(sources: Path, names: list[str], target: str, output: Path) -> None:
        made.append(output)
        output.write_bytes(b"ours")

    monkeypatch.setattr(native, "compile_library", compiled)
    library = native.build(tmp_path)
    with monkeypatch.context() as none:
        none.setattr(native, "_laws", lambda: pytest.fail("laws are printed for a library that is there"))
        assert native.build(tmp_path) == library
    assert len(made) == 1
    with monkeypatch.context() as another:
        another.setattr(native, "version", lambda _: "another sympy")
        assert native.build(tmp_path) != library
    assert len(made) == 2
    assert own(library)
    library.write_bytes(b"theirs")
    library.chmod(0o666)
    assert native.build(tmp_path).read_bytes() == b"ours"
    other = tmp_path / "other"
    other.write_bytes(b"theirs")
    library.unlink()
    library.symlink_to(other)
    assert native.build(tmp_path).read_bytes() == b"ours"
    assert other.read_bytes() == b"theirs"
    assert len(made) == 4
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []
