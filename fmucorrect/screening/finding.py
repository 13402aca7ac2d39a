"""One thing that cannot be right, or should be looked at."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Literal

from fmucorrect.errors import few


@dataclass(frozen=True)
class Finding:
    """kind: its name, as "clipped channel". level: "error" where nothing sensible can follow. where: condition, channel or
    file. seen: what was seen, with figures. meaning: what it would mean. remedy: the key, or the step, that would mend it."""

    kind: str
    level: Literal["error", "warning"]
    where: str
    seen: str
    meaning: str
    remedy: str

    @property
    def text(self) -> str:
        """All of it in one line."""
        return f"{self.where}: {self.kind}: {self.seen}. {self.meaning}. {self.remedy}"

    def to_json(self) -> dict[str, str]:
        """For programs."""
        return asdict(self)


def together(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Warnings of one kind, with one meaning and one remedy, as the first of them, which names the places of the others: a
    mistake in every log is one mistake. Errors one by one."""
    alike: dict[tuple[object, ...], list[Finding]] = {}
    for i, item in enumerate(findings):
        apart = i if item.level == "error" else -1
        alike.setdefault((item.kind, item.meaning, item.remedy, apart), []).append(item)
    return tuple(
        first if not others else replace(first, seen=f"{first.seen}; likewise {few([item.where for item in others])}")
        for first, *others in alike.values()
    )
