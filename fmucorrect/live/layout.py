"""A layout for Foxglove beside a log, or for a run that is being watched: a plot a channel, with its unit, and the corrector's
status over time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fmucorrect.signals import Channel


@dataclass(frozen=True)
class Curve:
    """One curve of every plot. topic: where it is. fields: the one that each of the channels has there, by records.field_names.
    label: "" for the topic's own name."""

    topic: str
    fields: Sequence[str]
    label: str = ""


def layout(channels: Sequence[Channel], curves: Sequence[Curve], status: str = "", stamp: str = "") -> str:
    """The layout's JSON. status: `topic.field`, "" for none. stamp: the field that holds the sample time, where the time of
    receipt does not say it."""
    panels: dict[str, dict[str, Any]] = {}
    for i, channel in enumerate(channels):
        panels[f"Plot!{i}"] = {
            "foxglovePanelTitle": f"{channel.name} [{channel.unit}]",
            "paths": [
                {
                    "value": f"{curve.topic}.{curve.fields[i]}",
                    "label": f"{curve.label or curve.topic.lstrip('/')} [{channel.unit}]",
                    "enabled": True,
                    **_timed(curve.topic, stamp),
                }
                for curve in curves
            ],
            "isSynced": True,
            "showLegend": True,
            "legendDisplay": "floating",
            "showXAxisLabels": True,
            "showYAxisLabels": True,
            "xAxisVal": "timestamp",
        }
    if status:
        panels["StateTransitions!status"] = {
            "foxglovePanelTitle": "status of the correction",
            "paths": [{"value": status, **_timed(status.partition(".")[0], stamp)}],
            "isSynced": True,
        }
    config = {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}}
    return json.dumps(config | {"layout": _stacked(list(panels))}, indent=1) + "\n"


def _timed(topic: str, stamp: str) -> dict[str, str]:
    if not stamp:
        return {"timestampMethod": "receiveTime"}
    return {"timestampMethod": "customField", "timestampPath": f"{topic}.{stamp}"}


def _stacked(panels: Sequence[str]) -> Any:
    """The panels above one another, each of the same height."""
    if len(panels) == 1:
        return panels[0]
    below = _stacked(panels[1:])
    return {"first": panels[0], "second": below, "direction": "column", "splitPercentage": 100 / len(panels)}
