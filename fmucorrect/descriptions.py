"""What an FMU, a bundle, a record file or a study says of itself: one JSON-able description of each, and its text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fmucorrect.bundle import Bundle
from fmucorrect.errors import few, one_line
from fmucorrect.fmu import FmuDescription
from fmucorrect.records.contents import Contents, TopicContents
from fmucorrect.signals import NANOSECONDS, Condition
from fmucorrect.study import Study

Thing = FmuDescription | Bundle | Contents | Study
_WITH_UNITS = ("channels", "columns", "outputs", "inputs", "parameters")


def describe(thing: Thing) -> dict[str, Any]:
    """What is in it, for JSON."""
    if isinstance(thing, FmuDescription):
        return _fmu(thing)
    if isinstance(thing, Bundle):
        return _bundle(thing)
    return _study(thing) if isinstance(thing, Study) else _record(thing)


def mean_step_ns(rows: int, start_ns: int | None, stop_ns: int | None) -> float | None:
    """The mean sample interval in ns of so many rows; None for fewer than two."""
    return (stop_ns - start_ns) / (rows - 1) if rows > 1 and start_ns is not None and stop_ns is not None else None


def _fmu(fmu: FmuDescription) -> dict[str, Any]:
    return {
        "path": str(fmu.path),
        "kind": "FMU",
        "name": fmu.name,
        "fmi": fmu.fmi,
        "stepped": "in co-simulation" if fmu.exchange is None else "in model exchange, integrated by CVODE",
        "description": fmu.description,
        "tool": fmu.tool,
        "platforms": list(fmu.platforms),
        "sources": fmu.has_sources,
        "capabilities": list(fmu.capabilities),
        **{f"{kind}s": {v.name: v.unit for v in fmu.of(kind)} for kind in ("output", "input", "parameter")},
        **_wrapped(fmu.wrapped),
    }


def _wrapped(facts: Mapping[str, Any]) -> dict[str, Any]:
    """What `fmucorrect wrap` put into it: a line for each part."""
    if not facts:
        return {}
    corrector = dict(facts.get("corrector") or {})
    within = {key: corrector.pop(key, {}) for key in ("channels", "conditions from the solver", "tunables", "envelope")}
    parts: dict[str, Mapping[str, Any]] = {"solver": facts.get("solver") or {}, "corrector": corrector, **within}
    for number, effect in enumerate(facts.get("effects", ()), start=1):
        parts[f"effect {number}"] = {"": f"{effect['effect']} at {effect['joint']}", **effect["parameters"]}
    parts["start values"] = facts.get("start values", {})
    parts["network in C against ONNX Runtime"] = {
        key: value for key, value in (facts.get("network in C against ONNX Runtime") or {}).items() if key != "errors"
    }
    parts["state, tried out"] = {key: value for key, value in facts.get("state", {}).items() if value != ""}
    return {"wrapped by fmucorrect": {name: part for name, part in parts.items() if part}}


def _bundle(model: Bundle) -> dict[str, Any]:
    info = model.info
    return {
        "path": str(model.path),
        "kind": "corrector (ONNX bundle)",
        "name": info.name,
        "channels": {channel.name: channel.unit for channel in info.channels},
        **({"sees": {channel.name: channel.unit for channel in info.sees}} if info.sees else {}),
        "window": info.rows,
        **({"state": info.state} if info.state else {}),
        "step": info.step_ns / NANOSECONDS,
        "envelope": {key: list(corners) for key, corners in info.envelope.items()},
        "trained on": [dict(condition) for condition in info.conditions],
        "evaluation": dict(info.evaluation),
        "study_hash": info.study_hash,
        "versions": dict(info.versions),
        "proved": "its seal and its golden pair hold on this machine",
    }


def _record(contents: Contents) -> dict[str, Any]:
    def topic(item: TopicContents) -> dict[str, Any]:
        extent = item.extent
        step = mean_step_ns(extent.rows, extent.start_ns, extent.stop_ns)
        return {
            "rows": extent.rows,
            "start": None if extent.start_ns is None else extent.start_ns / NANOSECONDS,
            "stop": None if extent.stop_ns is None else extent.stop_ns / NANOSECONDS,
            "mean step": None if step is None else step / NANOSECONDS,
            **({} if item.topic.zero_ns is None else {"counts from": item.topic.begun}),
            "encoding": item.topic.encoding,
            "columns": {column.name: column.unit for column in item.topic.columns},
            "metadata": dict(item.topic.metadata),
            **({"note": item.topic.note} if item.topic.note else {}),
        }

    return {
        "path": contents.path,
        "kind": f"record ({contents.format})",
        "cut off": contents.truncated,
        "damage": contents.damage,
        "left out": list(contents.left_out),
        "topics": {item.topic.name: topic(item) for item in contents.topics},
    }


def _study(study: Study) -> dict[str, Any]:
    def condition(c: Condition) -> dict[str, Any]:
        free = {"start values not known": list(c.free)} if c.free else {}
        declared = {"speed km/h": c.speed, "amplitude deg": c.amplitude, "frequency Hz": c.frequency}
        return {"role": c.role} | {key: value for key, value in declared.items() if value} | free

    return {
        "path": str(study.path),
        "kind": "study",
        "name": study.name,
        "fmu": None if study.simulation.fmu is None else str(study.simulation.fmu),
        "step": study.simulation.step_size,
        "channels": {channel.name: channel.unit for channel in study.channels},
        "excitation": study.excitation.simulation if study.excitation else None,
        "joints": [joint.name for joint in study.joints],
        "adjustable": [name for row in study.adjustable for name in row.parameters],
        "conditions": {c.name: condition(c) for c in study.conditions},
    }


def text(described: Mapping[str, Any]) -> str:
    """A description for people."""
    lines = [f"{described['path']}: {described['kind']}"]
    for key, value in described.items():
        if key not in ("path", "kind") and value not in (None, "", [], {}, False):
            lines += _item(key, value, 1)
    return "\n".join(map(one_line, lines))


def _item(key: str, value: Any, depth: int) -> Iterator[str]:
    indent = "  " * depth
    if isinstance(value, Mapping) and value and all(isinstance(entry, Mapping) for entry in value.values()):
        yield f"{indent}{key}"
        for name, entry in value.items():
            nested = any(isinstance(part, Mapping) for part in entry.values())
            if nested:
                yield f"{indent}  {name}"
                for part, inner in entry.items():
                    if inner not in (None, "", [], {}):
                        yield from _item(part, inner, depth + 2)
            else:
                yield f"{indent}  {name}: " + ", ".join(f"{part} {_plain(inner)}" for part, inner in entry.items())
    elif isinstance(value, Mapping):
        if key in _WITH_UNITS:
            entries = [f"{name} [{unit}]" if unit else name for name, unit in value.items()]
            yield f"{indent}{key} ({len(value)}): {few(entries)}"
        else:
            yield f"{indent}{key}: " + few([f"{name} {_plain(entry)}" for name, entry in value.items()])
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        yield f"{indent}{key}"
        yield from (f"{indent}  " + ", ".join(f"{k} {_plain(v)}" for k, v in entry.items()) for entry in value)
    elif isinstance(value, list):
        yield f"{indent}{key} ({len(value)}): {few([_plain(entry) for entry in value])}"
    else:
        yield f"{indent}{key}: {_plain(value)}"


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.9g}" if abs(value) < 1e6 else f"{value:.16g}"  # s since 1970
    if isinstance(value, list):
        return "[" + ", ".join(_plain(entry) for entry in value) + "]"
    if isinstance(value, Mapping):
        return "(" + ", ".join(f"{name} {_plain(entry)}" for name, entry in value.items()) + ")"
    return "none" if value is None else "yes" if value is True else "no" if value is False else str(value)
