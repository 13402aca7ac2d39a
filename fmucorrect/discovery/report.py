"""What a discovery returns: its report, as report.json holds it, in words for a terminal and in tables for a notebook."""

from __future__ import annotations

from typing import Any

from fmucorrect import sketch
from fmucorrect.discovery.wording import moved_far


class Report(dict[str, Any]):
    """The content of report.json."""

    def lines(self) -> list[str]:
        """The verdict, one line for each effect and each condition."""
        lines = [f"{'' if self.complete else 'so far '}{self['verdict']}: {self['sentence']}"]
        for effect, joint, share, equation, values in self._effects():
            lines.append(f"  {effect} at {joint} ({share}): {equation}; {values}")
        lines += [f"  {told}" for told in self._moved()]
        how = "look at" if self["verdict"] == "unexplained" else "hangs on"
        lines += [f"  {how} {doubt}" for doubt in self.get("cautions", [])]
        learned = self._learned()
        for condition, role, before, after, noise in self._gaps():
            held = ", held out" if role == "evaluation" else ""
            near = " with what came nearest, which is in no file" if self.get("suspects") else ""
            near += f", {learned[condition]}" if condition in learned else ""
            lines.append(f"  {condition}{held}: {before} -> {after} %{near} ({noise})")
        if not self.complete:
            lines += [f"  not looked at yet: {what}" for what in self["not_looked_at"]]
            lines.append("  The same command without --time-limit goes on where this search was.")
        return lines

    @property
    def complete(self) -> bool:
        """Whether the search came to its end."""
        return self.get("complete", True)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        effects = sketch.table(
            ["effect", "at", "probability", "equation", "parameters"],
            self._effects(),
            f"{self['verdict']}: {self['sentence']}",
        )
        gaps = sketch.table(["condition", "role", "NRMSE before [%]", "after [%]", "noise"], self._gaps())
        return effects + gaps

    def _effects(self) -> list[tuple[str, str, str, str, str]]:
        return [
            (
                row["effect"],
                row["joint"],
                f"{100 * row['probability']:.0f} %{'' if self.complete else ' of what was looked at'}" + _of_class(row),
                row["equation"],
                ", ".join(
                    f"{name} = {entry['value']:.4g} +- {entry['std']:.2g} {entry['unit']}"
                    for name, entry in row["parameters"].items()
                    if entry["std"] > 0.0
                )
                + _acted(row),
            )
            for row in self["effects"]
        ]

    def _moved(self) -> list[str]:
        """The model's parameters that moved by a tolerance or more, with their standard deviations."""
        before, now, by = (self.get(key, {}) for key in ("adjusted_from", "adjusted", "adjusted_by"))
        std = {name: f" +- {value:.2g}" for name, value in self.get("adjusted_std", {}).items()}
        return [
            f"{name}: {before[name]:.4g} -> {now[name]:.4g}{std.get(name, '')}, {by[name]:+.2g} tolerances"
            for name in moved_far(by)
        ]

    def _learned(self) -> dict[str, str]:
        """Of the conditions with a learned force their NRMSE, as told; of none where augmented.fmu has none."""
        row = self.get("learned")
        if row is None or "augmented.fmu" not in self["files"]:
            return {}

        def told(gap: dict[str, Any]) -> str:
            own = gap.get("nrmse_alone")
            beside = "" if own is None else f" and sensors' gains and lags, {own:.3g} % by augmented.fmu alone"
            return f"{gap['nrmse_after']:.3g} % with the learned force{beside}"

        return {gap["condition"]: told(gap) for gap in row["gap"]}

    def _gaps(self) -> list[tuple[str, str, str, str, str]]:
        return [
            (
                row["condition"],
                row["role"],
                f"{row['nrmse_before']:.3g}",
                f"{row['nrmse_after']:.3g}",
                "noise unknown" if row["noise_floor"] is None else f"noise {row['noise_floor']:.2g} %",
            )
            for row in self["gap"]
        ]


def _acted(row: dict[str, Any]) -> str:
    """The force of a law on the measured records."""
    acts = row.get("acting")
    return f"; acted with {acts['rms']:.3g} {acts['unit']} rms, {acts['peak']:.3g} at most" if acts else ""


def _of_class(row: dict[str, Any]) -> str:
    """How probable it is that it is this effect or one that cannot be told from it."""
    if "class_probability" not in row:
        return ""
    others = " or ".join(f"{other['effect']} at {other['joint']}" for other in row["indistinguishable_from"])
    return f"; it or {others}: {100 * row['class_probability']:.0f} %"
