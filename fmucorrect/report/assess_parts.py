"""Parts that only the page of a consistency assessment has."""

from __future__ import annotations

from html import escape

from fmucorrect.report.discovery_parts import DiscoveryPage


class AssessmentPage(DiscoveryPage):
    """A page with folded parts. As in Page, nothing that comes in is taken for HTML."""

    def open_fold(self, summary: str) -> None:
        """Everything up to close_fold() unfolds at a click."""
        self._parts.append(f"<details><summary>{escape(summary)}</summary>")

    def close_fold(self) -> None:
        self._parts.append("</details>")
