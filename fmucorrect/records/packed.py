"""What numbers stand for by the conventions of NetCDF (CF, and the NetCDF User's Guide): packed, missing, out of range."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fmucorrect.records.structures import Unreadable

_MISSING = ("_FillValue", "missing_value")
_RANGES = ("valid_range", "valid_min", "valid_max")
_SCALING = ("scale_factor", "add_offset")


def physical(values: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray | Unreadable:
    """The physical values: values * scale_factor + add_offset, NaN where they are missing or out of the valid range.

    Numbers that no attribute changes come back as they are. A range counts as one of the physical values where it is of the
    kind of the scaling and the values are not.
    """
    if values.dtype.kind not in "fiu":
        return values
    told: dict[str, np.ndarray] = {}
    for key in (*_MISSING, *_RANGES, *_SCALING):
        if key in attributes:
            try:
                told[key] = _numbers(attributes[key])
            except ValueError:
                return Unreadable(f"its {key} is no number")
    if any(told[key].size != 1 for key in _SCALING if key in told):
        return Unreadable("its scale_factor or add_offset is no single number")
    unsigned = values.dtype.kind == "i" and text_of(attributes.get("_Unsigned", "")).lower() == "true"
    if unsigned:
        values = values.astype(f"u{values.dtype.itemsize}")
    missing = np.zeros(values.shape, bool)
    for key in _MISSING:
        for number in told.get(key, np.empty(0)).ravel():
            # a double that stands for a single, or a signed number for an unsigned one, is equal to it as one only
            missing |= values == (number.astype(values.dtype) if unsigned or values.dtype.kind == "f" else number)
    scaled = any(key in told for key in _SCALING)
    found = values
    if scaled:
        factor, offset = (float(told.get(key, np.array(d)).item()) for key, d in zip(_SCALING, (1, 0), strict=True))
        found = values.astype(np.float64) * factor + offset
    low, high = _range(told)
    for bound, beyond in ((low, np.less), (high, np.greater)):
        if bound is not None:
            of_physical = scaled and bound.dtype.kind == "f" and values.dtype.kind != "f"
            missing |= beyond(found if of_physical else values, bound.astype(values.dtype) if unsigned else bound)
    return np.where(missing, np.nan, found.astype(np.float64)) if missing.any() else found


def _range(told: Mapping[str, np.ndarray]) -> tuple[Any, Any]:
    """The least and the largest valid value; None where there is none."""
    both = told.get("valid_range", np.empty(0)).ravel()
    low, high = (both[0], both[1]) if both.size == 2 else (None, None)
    return (
        told["valid_min"].ravel()[0] if "valid_min" in told else low,
        told["valid_max"].ravel()[0] if "valid_max" in told else high,
    )


def _numbers(value: Any) -> np.ndarray:
    """An attribute's numbers, which some programs write as text. Raises ValueError when they are none."""
    array = np.atleast_1d(np.asarray(value))
    if array.dtype.kind in "fiu" and array.size:
        return array
    return np.array([float(text_of(value))])


def text_of(value: Any) -> str:
    """An attribute as text, whatever string type it has."""
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
