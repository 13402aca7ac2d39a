"""A layout for Foxglove beside a log: a plot a channel, with its unit, and the corrector's status over time."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from fmucorrect.records import field_names
from fmucorrect.signals import Channel


def layout(channels: Sequence[Channel], series: Mapping[str, Sequence[str]], status: str) -> str:
    """The layout's JSON. series: topic -> the name that each of the channels has in it. status: `topic.field`."""
    panels: dict[str, dict[str, Any]] = {}
    fields = {topic: field_names(names) for topic, names in series.items()}
    for i, channel in enumerate(channels):
        panels[f"Plot!{i}"] = {
            "foxglovePanelTitle": f"{channel.name} [{channel.unit}]",
            "paths": [
                {
                    "value": f"{topic}.{fields[topic][i]}",
                    "label": f"{topic.lstrip('/')} [{channel.unit}]",
                    "enabled": True,
                    "timestampMethod": "receiveTime",
                }
                for topic in series
            ],
            "isSynced": True,
            "showLegend": True,
            "legendDisplay": "floating",
            "showXAxisLabels": True,
            "showYAxisLabels": True,
            "xAxisVal": "timestamp",
        }
    panels["StateTransitions!status"] = {
        "foxglovePanelTitle": "status of the correction",
        "paths": [{"value": status, "timestampMethod": "receiveTime"}],
        "isSynced": True,
    }
    config = {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}}
    return json.dumps(config | {"layout": _stacked(list(panels))}, indent=1) + "\n"


def _stacked(panels: Sequence[str]) -> Any:
    """The panels above one another, each of the same height."""
    if len(panels) == 1:
        return panels[0]
    below = _stacked(panels[1:])
    return {"first": panels[0], "second": below, "direction": "column", "splitPercentage": 100 / len(panels)}
