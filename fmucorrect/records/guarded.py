"""The boundary to the libraries that read files: whatever they raise becomes one RecordError with the file's name."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

from fmucorrect.errors import FmucorrectError, RecordError
from fmucorrect.records.contents import Extent, Topic
from fmucorrect.records.source import Block, Source


class Guarded:
    """A source, each of whose calls gives a result or a RecordError that names the file."""

    def __init__(self, path: str, opened: Callable[[str], Source]) -> None:
        self.path = path
        with _one_error(path):
            self._source = opened(path)
        self.format = self._source.format

    @property
    def truncated(self) -> bool:
        """Whether the file was cut off."""
        return self._source.truncated

    @property
    def damage(self) -> str:
        """What is lost, in words, as far as is known by now; "" when nothing is. A run of ours that broke off is not whole."""
        with _one_error(self.path):
            if lost := self._source.damage or ("it is cut off" if self._source.truncated else ""):
                return lost
            notes = [topic.metadata for topic in self._source.topics() if topic.metadata.get("complete") == "false"]
            return f"the run that wrote it broke off: {notes[0].get('why', 'nothing says why')}" if notes else ""

    @property
    def left_out(self) -> tuple[str, ...]:
        """What is not offered as a column, each with its reason."""
        return self._source.left_out

    def topics(self) -> tuple[Topic, ...]:
        """The topics in file order."""
        with _one_error(self.path):
            return self._source.topics()

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows of a topic, block by block."""
        with _one_error(self.path):
            yield from self._source.blocks(topic, columns)

    def extent(self, topic: str) -> Extent:
        """Rows and time range of a topic."""
        with _one_error(self.path):
            return self._source.extent(topic)

    def require_whole(self) -> None:
        """Raise RecordError when something of the file is known to be lost."""
        if damage := self.damage:
            raise damaged(self.path, damage)

    def close(self) -> None:
        """Release the file."""
        self._source.close()


def damaged(path: str, damage: str) -> RecordError:
    """The error of a record that is not whole."""
    return RecordError(
        f"the record is damaged: {damage}",
        where=path,
        remedy="To go on with what is there, say --allow-damaged (in Python allow_damaged=True).",
    )


@contextmanager
def _one_error(path: str) -> Generator[None]:
    try:
        yield
    except FmucorrectError:
        raise
    except Exception as error:  # six libraries and their codecs have no common base, and damaged bytes reach all of it
        why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise RecordError(f"the file is damaged, or of a kind that cannot be read ({why})", where=path) from error
