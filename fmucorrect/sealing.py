"""A bundle of anyone's own network: fc.seal(model, study, path) takes an ONNX file from any framework.

    model = fc.seal("my_network.onnx", study, "corrector.onnx")
    fc.run(fc.CorrectedStepper(plant, model), condition, inputs)     # and fmucorrect wrap, replay, compare as with ours

The network needs `window` float32 (N, W, V) in and `corrected` float32 (N, J) out, in the units of the study's channels; W is
taken from it. V = J, or more where the study's [training.corrector] sees names more, in that order, inputs of the FMU as they
were held until a row's time: `fc.pair(study, condition).seen(sees)` has such rows. It may read `condition` and `time`, and have
`state` and `next_state`, as bundle.py says. What it does not say is filled in from the study:

- `baseline`: the window's last row, the simulation as it is.
- `sigma`: the rms of what is left between corrected and measured in the study's development conditions. Where the network was
  fitted to these, that is less than elsewhere.
- `in_envelope`: 1 within the conditions and responses of development, fading to 0 outside, and `corrected` fades with it to
  the simulation.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from jaxtyping import Float64
from onnx import TensorProto, helper, numpy_helper

import fmucorrect
from fmucorrect import bundle, outputs, sources
from fmucorrect.bundle import Bundle, Info
from fmucorrect.comparison import Comparison, compare
from fmucorrect.errors import BundleError, require_opened
from fmucorrect.pairs import Pair
from fmucorrect.screening import screen
from fmucorrect.signals import NANOSECONDS, Channel, Condition
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Window
from fmucorrect.study import Study
from fmucorrect.workfolder import WorkFolder

_READ = {"window", "condition", "time", "state"}
_SEALED = "NRMSE in development"
"""What a sealed bundle says of its network."""
_log = logging.getLogger("fmucorrect")
_GOLDEN = 8
"""Rows of the golden pair."""
Corners = dict[str, tuple[float, float, float, float]]


def seal(model: str | Path | onnx.ModelProto, study: Study, path: str | Path, *, overwrite: bool = False) -> Bundle:
    """Makes a bundle at `path` of `model`, with the channels, sample time, conditions and hash of `study`, and opens it. Warns
    (logging, "fmucorrect") where the network is worse than the simulation in a development condition. overwrite: whether a
    file that is there and is not as `seal` wrote it is replaced.

    Raises BundleError where the network does not fit the study or the contract; OutputError where `path` is the network, what
    the study reads, or there already; StudyError for a study of which nothing sensible can be learned, and what simulation and
    registration raise.
    """
    require_opened("a Study", study, "fc.load_study(path)")
    path = Path(path)
    where = str(model) if isinstance(model, str | Path) else str(path)
    outputs.check_ending(path, "a bundle is written", [".onnx"])
    own = Path(model) if isinstance(model, str | Path) else None
    outputs.check_file(path, [("the network", own), *study.files()], "seal", overwrite)
    network = _Network.read(model, where, study)
    pairs = screen(study).pairs
    info = replace(about(study, pairs), rows=network.rows, state=network.state)
    if not network.says("in_envelope"):
        info = replace(info, envelope=corners(study.channels, pairs))
    graph = network.filled(info, np.zeros(len(study.channels)))
    inputs = _golden(pairs[0], info, graph, where)
    with WorkFolder() as folder:
        trial = folder.path / "trial.onnx"
        trial.write_bytes(bundle.completed(graph, info, inputs, where))
        judged = [evaluate(item, bundle.load(trial)) for item in pairs]
    left = np.concatenate([(item.measured - item.corrected)[item.scored] for item in judged])
    figures = {item.condition.name: round(item.after.mean_nrmse, 4) for item in judged}
    bare = {item.condition.name: round(item.before.mean_nrmse, 4) for item in judged}
    worse = [f"{name}: {bare[name]:g} -> {figure:g} %" for name, figure in figures.items() if not figure <= bare[name]]
    if worse:
        _log.warning("%s: worse than the simulation at %s", path, ", ".join(worse))
    info = replace(info, evaluation={_SEALED: figures, f"{_SEALED}, simulated": bare})
    outputs.write(path, bundle.completed(network.filled(info, _rms(left)), info, inputs, where), "seal")
    return bundle.load(path)


def evaluate(item: Pair, model: Bundle) -> Comparison:
    """A bundle on a pair, through the same stepper as online."""
    stepper = CorrectedStepper(ReplayStepper(item.simulated.channels), model)
    stepper.reset(item.condition)
    return replace(compare(item, stepper.process(item.simulated)), withheld=stepper.withheld)


def about(study: Study, pairs: Sequence[Pair]) -> Info:
    """What a bundle says of the study that it comes from: a window of one row, no envelope, no state."""
    left = np.concatenate([item.measured - _simulated(item) for item in pairs])
    solver, sees = _solver(study), study.training.corrector.sees
    return Info(
        name=study.name,
        channels=tuple(map(_for_bundle, study.channels)),
        rows=1,
        step_ns=study.simulation.step_ns,
        uncorrected=tuple(_rms(left).tolist()),
        envelope={},
        conditions=tuple(map(_trained_on, study.development)),
        parameters=dict(study.parameters),
        solver=solver,
        defaults=sources.own_parameters(study) if solver else {},
        driven=_driven(study) if solver else {},
        units=dict(study.simulation.units),
        sees=tuple(map(_for_bundle, pairs[0].seen_beside(sees))),
        held=tuple(name for name in sees if name in pairs[0].inputs),
        study_hash=study.hash,
        versions={"fmucorrect": fmucorrect.__version__, **{name: version(name) for name in ("onnx", "numpy")}},
    )


def _driven(study: Study) -> dict[str, str]:
    """The FMU's inputs that every development condition has a column for, with their units."""
    each = [{v.name: v.unit or "1" for v in sources.driving(study, condition)} for condition in study.development]
    return {name: unit for name, unit in each[0].items() if all(name in other for other in each)}


def _solver(study: Study) -> str:
    """The file's name of the FMU that every development condition simulates; "" where a log takes its place."""
    logged = any(condition.simulated is not None for condition in study.development)
    return "" if study.fmu is None or logged else study.fmu.name


REACH, FADES = 1.25, 0.25
"""Of a channel's range, from its middle, up to where a correction is whole at most, and over which it fades."""


def ranges(
    responses: Iterable[Float64[np.ndarray, "_ J"]],
) -> tuple[Float64[np.ndarray, " J"], Float64[np.ndarray, " J"]]:
    """The middle of each channel's range over all conditions, and half of the range."""
    each = [np.stack([values.min(axis=0), values.max(axis=0)]) for values in responses]
    low, high = np.min(each, axis=0)[0], np.max(each, axis=0)[1]
    return (low + high) / 2.0, (high - low) / 2.0


def corners(channels: Sequence[Channel], pairs: Sequence[Pair], reach: float = REACH) -> Corners:
    """Where a correction may be used: half the span of speed beyond its ends, 5 % of amplitude and frequency, fading over as
    much again, and `reach` times the range of each response about its middle, fading over FADES. Nothing of what the conditions
    do not say."""
    found: Corners = {}
    for channel, middle, half in zip(channels, *ranges(map(_simulated, pairs)), strict=True):
        if half > 0.0:
            ends = (-reach - FADES, -reach, reach, reach + FADES)
            found[f"response {channel.name}"] = tuple(float(middle + half * end) for end in ends)  # type: ignore[assignment]
    for k, name in enumerate(("speed", "amplitude", "frequency")):
        values = [float(item.condition.features[k]) for item in pairs]
        low, high = min(values), max(values)
        if low > 0.0:
            margin = (high - low) / 2.0 if k == 0 and high > low else 0.05 * high
            found[name] = (low - 2.0 * margin, low - margin, high + margin, high + 2.0 * margin)
    return found


def ramps(
    channels: Sequence[Channel], envelope: Mapping[str, tuple[float, float, float, float]]
) -> tuple[Float64[np.ndarray, "Q E"], Float64[np.ndarray, " E"]]:
    """Slopes over (response, condition) and offsets of what says how far each corner is passed, in widths of its fade; two
    ramps an entry, negative inside."""
    places = [*(f"response {channel.name}" for channel in channels), "speed", "amplitude", "frequency"]
    slopes, offsets = np.zeros((len(places), 2 * len(envelope))), np.zeros(2 * len(envelope))
    for k, (name, (a, b, c, d)) in enumerate(envelope.items()):
        slopes[places.index(name), 2 * k : 2 * k + 2] = -1.0 / (b - a), 1.0 / (d - c)
        offsets[2 * k : 2 * k + 2] = b / (b - a), -c / (d - c)
    return slopes, offsets


class _Network:
    """Somebody's graph. rows: W. state: S, 0 for none."""

    def __init__(self, model: onnx.ModelProto, rows: int, state: int) -> None:
        self._model, self.rows, self.state = model, rows, state

    @staticmethod
    def read(model: str | Path | onnx.ModelProto, where: str, study: Study) -> _Network:
        """Raises BundleError for what is no corrector of the study's channels."""
        try:
            found = (
                onnx.load(model)
                if isinstance(model, str | Path)
                else onnx.ModelProto.FromString(model.SerializeToString())
            )
        except Exception as error:  # neither protobuf's errors nor those of files have a common base but Exception
            raise BundleError(f"onnx cannot open it: {error}", where=where) from error
        constants = {item.name for item in found.graph.initializer}
        types = {
            item.name: item.type.tensor_type
            for item in (*found.graph.input, *found.graph.output)
            if item.name not in constants
        }
        shapes = {name: [axis.dim_value for axis in kind.shape.dim] for name, kind in types.items()}
        inputs = {item.name for item in found.graph.input} - constants
        if "window" not in inputs or "corrected" not in shapes or inputs - _READ:
            raise BundleError(
                "the network has other inputs or outputs than a corrector",
                where=where,
                expected="window, and condition, time, state where it needs them; corrected",
                got=f"{', '.join(sorted(inputs))} to {', '.join(item.name for item in found.graph.output)}",
                remedy="Name them so when you export it.",
            )
        window, state = shapes["window"], shapes.get("state", [0, 0])
        channels, columns = len(study.channels), len(study.channels) + len(study.training.corrector.sees)
        if len(window) != 3 or window[1] < 1 or window[2] != columns:
            raise BundleError(
                "input 'window' has another shape", where=where, expected=f"(N, W, {columns})", got=window
            )
        for name in ("window", "corrected"):
            if types[name].elem_type != TensorProto.FLOAT:
                raise BundleError(
                    f"{name!r} has numbers of another kind",
                    where=where,
                    expected="float32",
                    got=TensorProto.DataType.Name(types[name].elem_type).lower(),
                    remedy="Export the network in single precision (in torch: model.float()).",
                )
        said = shapes["corrected"]
        if said and (len(said) != 2 or said[1] not in (0, channels)):  # 0: a size that the file leaves open
            raise BundleError(
                "output 'corrected' has another shape", where=where, expected=f"(N, {channels})", got=said
            )
        if ("state" in shapes) != ("next_state" in shapes) or len(state) != 2 or ("state" in shapes and state[1] < 1):
            raise BundleError(
                "a state goes in as 'state' (N, S) and out as 'next_state'", where=where, got=sorted(shapes)
            )
        return _Network(found, window[1], state[1])

    def says(self, name: str) -> bool:
        return any(item.name == name for item in self._model.graph.output)

    def filled(self, info: Info, sigma: Float64[np.ndarray, " J"]) -> bytes:
        """The graph with all inputs and outputs of a bundle. sigma: in the place of what the network does not say."""
        model = onnx.ModelProto.FromString(self._model.SerializeToString())
        graph = model.graph
        said = {item.name for item in graph.output}
        names = {
            name: f"theirs_{name}" for name in ("corrected", "sigma") if name in said and not self.says("in_envelope")
        }
        for node in graph.node:
            node.input[:] = [names.get(name, name) for name in node.input]
            node.output[:] = [names.get(name, name) for name in node.output]

        def constant(name: str, values: Any) -> str:
            graph.initializer.append(numpy_helper.from_array(np.asarray(values), f"sealing_{name}"))
            return f"sealing_{name}"

        def add(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
            graph.node.append(helper.make_node(kind, inputs, [output], **attributes))
            return output

        last = ""
        if not {"baseline", "in_envelope"} <= said:  # what was sealed before says all
            last = add("Gather", ["window", constant("last", np.int64(info.rows - 1))], "sealing_newest", axis=1)
            if info.sees:
                columns = constant("channels", np.arange(len(info.channels)))
                last = add("Gather", [last, columns], "sealing_simulated", axis=1)
        if "baseline" not in said:
            add("Identity", [last], "baseline")
        if "in_envelope" not in said:
            self._fade(info, add, constant, last)
            delta = add("Sub", [names["corrected"], last], "sealing_delta")
            add("Add", [last, add("Mul", ["in_envelope", delta], "sealing_faded")], "corrected")
        if "sigma" not in said or names:
            bare = np.array([info.uncorrected], np.float32)
            theirs = names.get("sigma") or constant("sigma", sigma[None].astype(np.float32))
            more = add("Sub", [theirs, constant("uncorrected", bare)], "sealing_more")
            add("Add", ["sealing_uncorrected", add("Mul", ["in_envelope", more], "sealing_spread")], "sigma")
        _declare(graph, info)
        del graph.value_info[:], model.metadata_props[:]
        return model.SerializeToString()

    @staticmethod
    def _fade(info: Info, add: Any, constant: Any, last: str) -> None:
        """in_envelope: 1 less how far responses and conditions are beyond their inner corners, in widths of the fade."""
        slopes, offsets = ramps(info.channels, info.envelope)
        x = add("Concat", [last, "condition"], "sealing_x", axis=1)
        weights = [constant("slopes", slopes.astype(np.float32)), constant("offsets", offsets.astype(np.float32))]
        outside = add("Relu", [add("Gemm", [x, *weights], "sealing_ramps")], "sealing_outside")
        taken = [
            constant("taken", np.full((len(offsets), 1), -1.0, np.float32)),
            constant("one", np.ones(1, np.float32)),
        ]
        add("Relu", [add("Gemm", [outside, *taken], "sealing_share")], "in_envelope")


def _declare(graph: onnx.GraphProto, info: Info) -> None:
    constants = {item.name for item in graph.initializer}
    for rows, field in ((info.inputs, graph.input), (info.outputs, graph.output)):
        kept = [item for item in field if item.name in constants]
        del field[:]
        field.extend(kept)
        for name, row in rows.items():
            kind = TensorProto.DOUBLE if name == "time" else TensorProto.FLOAT
            field.append(helper.make_tensor_value_info(name, kind, ["N", *row]))


def _golden(item: Pair, info: Info, graph: bytes, where: str) -> dict[str, np.ndarray]:
    """Inputs of the golden pair: real ones, and states to which the graph comes there. Others need not be possible ones."""
    seen = item.seen([channel.name for channel in info.sees])
    windows = Window(info.rows, len(info.seen)).extend(seen)
    t_ns = item.simulated.t_ns[info.rows - 1 :]
    inputs = {
        "window": windows,
        "condition": np.tile(np.array(item.condition.features, np.float32), (len(windows), 1)),
        "time": (t_ns[:, None] - item.condition.start_ns) / NANOSECONDS,
    }
    if info.state:
        inputs["state"] = bundle.states(graph, info, inputs, where)
    picked = np.linspace(0, len(windows) - 1, _GOLDEN).astype(int)
    return {name: values[picked] for name, values in inputs.items()}


def _simulated(item: Pair) -> Float64[np.ndarray, "N J"]:
    """At the rows that were measured."""
    return item.simulated.values[item.rows, : item.measured.shape[1]]


def _rms(values: Float64[np.ndarray, "N J"]) -> Float64[np.ndarray, " J"]:
    return np.sqrt(np.mean(values**2, axis=0))


def _for_bundle(channel: Channel) -> Channel:
    """A channel without what belongs to the measurement alone."""
    return Channel(
        channel.name,
        unit=channel.unit,
        quantity=channel.quantity,
        axis=channel.axis,
        positive=channel.positive,
        frame=channel.frame,
        simulation=channel.simulation,
    )


def _trained_on(condition: Condition) -> dict[str, Any]:
    """A condition with the FMU start values by which a wrapped FMU knows it again."""
    numbers = {key: getattr(condition, key) for key in ("name", "speed", "amplitude", "frequency", "start")}
    return {**numbers, "parameters": dict(condition.parameters)}
