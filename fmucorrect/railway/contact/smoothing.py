"""Smooths a measured profile: the noise of a gauge's points would otherwise be taken for curvature."""

from __future__ import annotations

import numpy as np

from fmucorrect.errors import SignalError
from fmucorrect.railway.contact.profile import Profile


def smoothed(profile: Profile, length: float) -> Profile:
    """The profile with every point moved onto the cubic fitted along the arc to what lies within length / 2 (m) of it
    (Savitzky and Golay), y and z each over the arc length, at the median distance of its points.

    Arcs much longer than length keep their radius. Raises SignalError for a length that holds fewer than seven points, or
    is more than 20 mm, which would change the shape.
    """
    from scipy.signal import savgol_filter

    steps = np.hypot(*np.diff(profile.points, axis=0).T)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    count = int(np.ceil(along[-1] / np.median(steps)))
    window = 2 * round(length / 2.0 / (along[-1] / count)) + 1 if 0.0 < length <= 20e-3 else 0
    if not 7 <= window < count:
        raise SignalError(
            "a smoothing length out of range",
            where=profile.name,
            expected=f"{along[-1] / count * 7e3:.2g} (seven points) to 20 mm",
            got=f"{length * 1e3:g} mm",
        )
    even = np.linspace(0.0, along[-1], count + 1)
    points = np.column_stack([np.interp(even, along, column) for column in profile.points.T])
    return Profile(profile.name, profile.kind, np.asarray(savgol_filter(points, window, 3, axis=0)))
