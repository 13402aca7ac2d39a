"""What a study leaves open of the paper's case 3, from its development conditions and its FMU: channels and band of the
acceleration loss, nominal matrices. What was found is told in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fmucorrect.diagnosis import agreements, recommend
from fmucorrect.errors import FmuError
from fmucorrect.pairs import Pair
from fmucorrect.study import Study
from fmucorrect.study_training import Proposed, Training
from fmucorrect.training.nominal import DAMPING_RATIO, NATURAL_FREQUENCY, in_words, linearised, rows


def resolved(study: Study, training: Training, development: Sequence[Pair]) -> tuple[Training, tuple[str, ...]]:
    """The settings without anything open, and a sentence for each that was. Raises what `diagnosis.agreement` raises."""
    settings, told = _accelerations(study, training.proposed, development)
    settings, more = _matrices(study, settings)
    return replace(training, proposed=settings), (*told, *more)


def _accelerations(study: Study, settings: Proposed, development: Sequence[Pair]) -> tuple[Proposed, tuple[str, ...]]:
    """Channels and band that `diagnose` recommends; no channel where there is no band to compare in."""
    every = {item.condition.name for item in development} <= set(settings.bands)
    open_band = settings.band is None and not every
    if settings.acceleration_channels == () or (settings.acceleration_channels is not None and not open_band):
        return settings, ()
    asked = settings.acceleration_channels
    found = [item for each in development for item in agreements(study, each)]
    if asked is not None:
        found = [item for item in found if item.channel in asked]
    channels, band = recommend(found) if found else ((), None)
    if asked is None and not channels:
        why = (
            "no accelerometer agrees with its displacement at every development condition"
            if found
            else "no accelerometer"
        )
        return replace(settings, acceleration_channels=()), (f"Acceleration loss: none, {why}.",)
    if open_band and band is None:
        named = ", ".join(asked or channels)
        why = f"{named} and the second derivative of the displacement are coherent in no common band"
        return replace(settings, acceleration_channels=()), (f"Acceleration loss: none, {why}.",)
    chosen = replace(
        settings,
        acceleration_channels=channels if asked is None else asked,
        band=band if open_band else settings.band,
    )
    where = f"{band[0]:g} to {band[1]:g} Hz, where it is coherent" if open_band and band else "the study's band"
    named = ", ".join(chosen.acceleration_channels or ())
    return chosen, (f"Acceleration loss: {named}, {where}, as `fmucorrect diagnose` recommends.",)


def _matrices(study: Study, settings: Proposed) -> tuple[Proposed, tuple[str, ...]]:
    """From the FMU, where the study gives none of the three; the scale of one given would not be that of the others."""
    if any(matrix is not None for matrix in (settings.mass, settings.damping, settings.stiffness)):
        return settings, ()
    try:
        nominal = linearised(study, settings)
    except FmuError as error:
        usual = f"{NATURAL_FREQUENCY:g} Hz spring with {100 * DAMPING_RATIO:g} % damping a coordinate"
        return settings, (f"Nominal matrices: a unit mass on a {usual}, since there is nothing to linearise: {error}.",)
    mass, damping, stiffness = (rows(matrix) for matrix in nominal.matrices)
    text = f"Nominal matrices: of the FMU, linearised where it starts: {in_words(nominal)}."
    return replace(settings, mass=mass, damping=damping, stiffness=stiffness), (text,)
