"""One thing that cannot be right, or should be looked at."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal


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
