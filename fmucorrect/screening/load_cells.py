"""Whether a load cell at a joint would feel a force that is added there.

What a model's own element gives is not what a load cell in line with it measures, once the model lacks a force at that
place: an effect pushes beside the element, and only an output that sums both shows it.
"""

from __future__ import annotations

from collections.abc import Iterator

from fmucorrect.fmu import open_fmu
from fmucorrect.fmu.feedthrough import feedthrough
from fmucorrect.screening.finding import Finding
from fmucorrect.study import Study
from fmucorrect.units import UNSAID, conversion

FELT = 0.5
"""Share of a force at the joint that an output has to pass on at once: a sum passes on all of it, an element alone in one step
next to nothing."""


def unfelt(study: Study) -> Iterator[Finding]:
    """Of the channels that are the force of a joint's own element; each is tried out by three steps of the FMU. Raises what the
    FMU raises."""
    if study.fmu is None:
        return
    simulation, fmu = study.simulation, open_fmu(study.fmu, warn=False)
    units = {**fmu.units, **simulation.units}
    for channel in study.channels:
        shown = channel.simulation or channel.name
        for joint in study.joints:
            if joint.nominal_force != shown:
                continue
            (answer,) = feedthrough(study.fmu, [joint.force], [shown], simulation.step_ns, simulation.parameters)[0]
            source, target = units.get(joint.force, ""), units.get(shown, "")
            if not {source, target} & UNSAID:  # else taken to be SI
                answer /= conversion(source, target, f"joint {joint.name!r}", fmu.defined)
            if abs(answer) < FELT:
                unit = "N.m" if "rad" in units.get(joint.displacement, "") else "N"
                yield Finding(
                    "load cell that feels no added force",
                    "warning",
                    f"channel {channel.name!r}",
                    f"it is the element's force at joint {joint.name!r}: of 1 {unit} at {joint.force!r} it shows "
                    f"{answer:.2g} {unit}",
                    "A load cell in line with the joint measures what an effect adds there, too: the effect would be denied "
                    "by this channel, and another one named",
                    f"Export the sum of the element's force and {joint.force!r} as an output, and name it as the channel's "
                    "simulation; nominal_force stays as it is. Where it is a drive's force, no spring's or damper's, and the "
                    "drive's own sensor measures it, take nominal_force out of the joint.",
                )
