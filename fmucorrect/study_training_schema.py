"""The [training] table of a study file, made from the dataclasses of study_training."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_type_hints

from pydantic import ValidationError, create_model

from fmucorrect.study_places import Location, nearest
from fmucorrect.study_training import Training
from fmucorrect.study_validation import Table, message


def read(document: Mapping[str, Any]) -> tuple[Training, list[tuple[Location, str]]]:
    """The settings that a study's document asks for (defaults where it asks for none, or where something is wrong), and
    place and text of each problem."""
    table = _tuples(document.get("training", {}))
    try:
        model = _table(Training).model_validate(table)
    except ValidationError as error:
        problems: list[tuple[Location, str]] = []
        for item in error.errors():
            loc = item["loc"]
            problems.append((("training", *loc), message(dict(item), _known(loc))))
        return Training(), problems
    training = _dataclass(Training, model)
    return training, list(_names(training, document)) + list(_matrices(training, document))


def _table(kind: type[Any]) -> type[Table]:
    """The table that a dataclass stands for: same names, types, limits and defaults."""
    hints = get_type_hints(kind, include_extras=True)
    content: dict[str, Any] = {}
    for item in fields(kind):
        inner: Any = hints[item.name]
        if is_dataclass(inner) and isinstance(inner, type):
            table = _table(inner)
            content[item.name] = (table, table())
        else:
            content[item.name] = (inner, item.default if item.default is not MISSING else {})
    return create_model(f"{kind.__name__}Table", __base__=Table, **content)


def _dataclass(kind: type[Any], model: Any) -> Any:
    """The dataclass that a validated table holds the values of."""
    hints = get_type_hints(kind)
    values = {item.name: getattr(model, item.name) for item in fields(kind)}
    return kind(**{k: _dataclass(hints[k], v) if isinstance(v, Table) else v for k, v in values.items()})


def _known(loc: Location) -> Mapping[str, Any]:
    """The keys of the table in which `loc`, below [training], stands."""
    kind: Any = Training
    for key in loc[:-1]:
        inner = get_type_hints(kind).get(str(key))
        if not is_dataclass(inner):
            break
        kind = inner
    return {item.name: item for item in fields(kind)}


def _tuples(value: Any) -> Any:
    """Arrays as tuples: the settings are frozen."""
    if isinstance(value, list):
        return tuple(_tuples(inner) for inner in value)
    return {key: _tuples(inner) for key, inner in value.items()} if isinstance(value, dict) else value


def _rows(document: Mapping[str, Any], table: str) -> list[dict[str, Any]]:
    """The rows of a table; what has a wrong type is passed over: validation reports it."""
    rows = document.get(table)
    return [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []


def _names(training: Training, document: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Channels and conditions that [training.proposed] names and the study does not have; what `sees` names beside the channels
    and need not; bands that end before they begin."""
    place = ("training", "proposed")
    proposed = training.proposed
    channels = [row.get("name") for row in _rows(document, "channels")]
    conditions = [row.get("name") for row in _rows(document, "conditions")]
    for name in proposed.acceleration_channels or ():
        if name not in channels:
            yield (*place, "acceleration_channels"), f"there is no channel {name!r}{nearest(name, map(str, channels))}"
    known = {str(row.get(key)) for row in _rows(document, "channels") for key in ("name", "simulation")}
    for i, name in enumerate(sees := training.corrector.sees):
        if not name or name in sees[:i] or name in known:
            what = (
                "is a channel, which is always seen" if name in known else "stands there twice" if name else "is empty"
            )
            yield ("training", "corrector", "sees"), f"{name!r} {what}"
    for name in proposed.bands:
        if name not in conditions:
            yield (*place, "bands"), f"there is no condition {name!r}{nearest(name, map(str, conditions))}"
    for key, band in (("band", proposed.band), *(("bands", band) for band in proposed.bands.values())):
        if band is not None and band[1] <= band[0]:
            yield (*place, key), f"must end above where it begins, in Hz, got {list(band)}"
    low, high = training.pinn.damping_limits
    if not low < training.pinn.damping < high:
        yield (
            ("training", "pinn", "damping"),
            f"must lie inside damping_limits = [{low}, {high}], got {training.pinn.damping}",
        )


def _matrices(training: Training, document: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """H_q is J x p with p <= J, the nominal matrices are symmetric positive definite p x p (eq. physics_residual)."""
    import numpy as np

    proposed, channels = training.proposed, len(_rows(document, "channels"))
    size = channels
    if (rows := proposed.observation) is not None:
        place = ("training", "proposed", "observation")
        widths = {len(row) for row in rows}
        if len(rows) != channels or len(widths) != 1 or not 1 <= min(widths) <= channels:
            yield place, f"must have {channels} rows, one a channel, of p numbers each, 1 <= p <= {channels}"
            return
        size = min(widths)
        if np.linalg.matrix_rank(np.array(rows)) < size:
            yield place, "must have independent columns, or reduced coordinates could not be told apart"
    for key in ("mass", "damping", "stiffness"):
        matrix = getattr(proposed, key)
        if matrix is None:
            continue
        place = ("training", "proposed", key)
        if len(matrix) != size or any(len(row) != size for row in matrix):
            yield place, f"must be {size} x {size}, one row and column a reduced coordinate"
            continue
        values = np.array(matrix)
        if not np.array_equal(values, values.T) or np.linalg.eigvalsh(values).min() <= 0.0:
            yield place, "must be symmetric and positive definite"
