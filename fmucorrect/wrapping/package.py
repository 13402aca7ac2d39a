"""wrap(): a solver's FMU, a corrector and effects become one FMU."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import fmucorrect
from fmucorrect import bundle, effects, outputs
from fmucorrect.bundle import Bundle
from fmucorrect.effects import Effects
from fmucorrect.errors import FmuError, WrapError, few, require_path
from fmucorrect.fmu import FmuDescription, open_fmu, state_check
from fmucorrect.fmu.startvalues import start_values
from fmucorrect.fmu.state_check import StateCheck
from fmucorrect.units import NONE
from fmucorrect.workfolder import WorkFolder
from fmucorrect.wrapping import (
    alone,
    compiler,
    ctext,
    description_xml,
    generated,
    laws,
    licences,
    linked,
    network,
    places,
    proof,
    solver,
)
from fmucorrect.wrapping.added import Added
from fmucorrect.wrapping.description import Capabilities, Description, Outer, describe
from fmucorrect.wrapping.description_structure import fed_through
from fmucorrect.wrapping.generated import Facts
from fmucorrect.wrapping.linked import Linked
from fmucorrect.wrapping.proof import Proof
from fmucorrect.wrapping.wiring import MappingFile, Wiring, read_mapping, wire

STEPS = ("generate", "compile", "prove", "check state", "write")
_C = Path(__file__).parent / "c"
_HEADERS = ("wrapper.h", "platform.h", "paths.h", "joint.h", "together.h")
_ALWAYS = ("wrapper", "sampling", "coupling", "variables", "state", "platform", "paths")


@dataclass(frozen=True)
class Wrapped:
    """A finished FMU. fmi: 2 or 3. proof: the compiled network held against ONNX Runtime, None without a corrector. state:
    what was tried of its state. notes: what could not be carried over or was not tried, in words. size: bytes."""

    path: Path
    fmi: int
    platforms: tuple[str, ...]
    proof: Proof | None
    state: StateCheck
    notes: tuple[str, ...]
    size: int

    def to_json(self) -> dict[str, Any]:
        """All of it for programs."""
        return {**asdict(self), "path": str(self.path)}

    def text(self) -> str:
        """All of it for people."""
        state = "copied and serialised" if self.state.serialise else "copied" if self.state.copy else "not offered"
        lines = [
            f"{self.path}: FMI {self.fmi}.0 for {', '.join(self.platforms)}, {self.size / 1e6:.2f} MB",
            f"state: {state}" + (" (tried out)" if self.state.copy else ""),
        ]
        if self.proof is not None:
            lines.insert(
                1,
                f"network in C against ONNX Runtime: {max(self.proof.errors.values()):.0%} of what rounding allows at most, "
                f"in {self.proof.windows} windows, by each of {', '.join(self.proof.errors)}",
            )
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


@dataclass(frozen=True)
class _Parts:
    """Everything that was read and checked, before anything is computed."""

    inner: FmuDescription | None
    xml: bytes
    model: Bundle | None
    effects: Effects
    wiring: Wiring
    step_ns: int
    fmi: int
    platforms: list[str]

    @property
    def added(self) -> Added:
        """What the wrapped FMU says beyond the solver."""
        if self.model is None:
            return Added(effects=bool(self.effects.forces), starts=self.starts)
        read = [source.variable.name for source in (*self.wiring.seen, *self.wiring.conditions.values())]
        return Added(self.model.channels, tuple(read), self.wiring.tunables, bool(self.effects.forces), self.starts)

    @property
    def starts(self) -> dict[str, float]:
        """Start values that the wrapper gives to the solver, by name."""
        return {variable.name: value for variable, value in self.wiring.parameters.items()}


def wrap(
    fmu: str | Path | None,
    corrector: str | Path | None,
    out: str | Path,
    *,
    effects_file: str | Path | None = None,
    mapping: str | Path | None = None,
    fmi: int | None = None,
    platforms: Sequence[str] = (),
    overwrite: bool = False,
    made_by: str = "wrap",
    progress: Callable[[str], object] = lambda step: None,
) -> Wrapped:
    """Writes the FMU `out`: the solver's FMU `fmu` with its inputs, parameters and outputs, the corrected channels, and the
    effects fed back into it (DESIGN section 7). Without `fmu` it holds the network alone, its channels as inputs.

    mapping: see wrapping/wiring.py. fmi: version of the new FMU, the solver's own by default. platforms: of
    compiler.TARGETS; by default all that the solver has. progress: called with each of STEPS as it begins.
    Raises WrapError, FmuError, BundleError, SignalError; what is at `out` stays until the new file is complete.
    """
    require_path("the solver's FMU", fmu)
    require_path("an ONNX bundle", corrector)
    out = Path(out)
    named = {
        "the solver's FMU": fmu,
        "the corrector": corrector,
        "the effects file": effects_file,
        "the mapping": mapping,
    }
    read = [(what, None if path is None else Path(path)) for what, path in named.items()]
    outputs.check_file(out, read, made_by, overwrite, parents=True)
    outputs.check_ending(out, "an FMU is written", (".fmu",))
    parts = _read(fmu, corrector, effects_file, mapping, fmi, platforms)
    with WorkFolder() as folder:
        work = folder.path
        progress("generate")
        net = network.sources(parts.model.path) if parts.model else None
        sources, outer, first, untried = _generate(parts, net.files if net else {})
        notes = [*first.left_out, *_step_notes(parts), *_input_notes(parts), *untried]
        notes += solver.left_out(parts.inner) if parts.inner else []
        if "darwin64" in parts.platforms and sys.platform != "darwin":
            notes.append(
                "its libraries for darwin64 are built, and were run nowhere: not here, and not in fmucorrect's tests"
            )
        (work / "sources").mkdir()
        for name, content in sources.items():
            (work / "sources" / name).write_bytes(content)
        progress("compile")
        files = compiler.libraries(
            work / "sources",
            outer.files,
            outer.identifier,
            parts.fmi,
            solver.targets(parts.inner, parts.platforms),
            work / "binaries",
        )
        files |= {f"sources/{name}": content for name, content in sources.items()}
        files |= licences.files(network=net is not None)
        files |= solver.files(parts.inner, parts.platforms) if parts.inner else {}
        progress("prove")
        own = parts.inner.defined if parts.inner else NONE
        proved = proof.prove(parts.model, net, work / "proof", own) if parts.model and net else None
        progress("check state")
        trial = work / "trial.fmu"
        compiler.write_fmu(trial, files | _described(parts, outer, True, True))
        made = open_fmu(trial, warn=False)
        state, unsure = _check_state(made, parts.step_ns)
        notes += [*unsure, *_faults(parts.inner, made), *_start_notes(parts), *_condition_notes(parts)]
        progress("write")
        files |= _described(parts, outer, state.copy, state.serialise)
        files[outputs.FACTS] = json.dumps(_facts(parts, proved, state), indent=1).encode()
        out.parent.mkdir(parents=True, exist_ok=True)
        compiler.write_fmu(out, files, made_by)
    return Wrapped(out, parts.fmi, tuple(parts.platforms), proved, state, tuple(notes), out.stat().st_size)


def _read(
    fmu: str | Path | None,
    corrector: str | Path | None,
    effects_file: str | Path | None,
    mapping: str | Path | None,
    fmi: int | None,
    wanted: Sequence[str],
) -> _Parts:
    """Opens everything and holds it against each other."""
    if fmi not in (None, 2, 3):
        raise WrapError("there is no such FMI version", expected="2 or 3", got=fmi)
    if corrector is None and (effects_file is None or fmu is None):
        raise WrapError(
            "there is nothing to wrap", expected="a solver's FMU with a corrector or effects, or a corrector"
        )
    if fmu is None and (effects_file is not None or mapping is not None):
        raise WrapError(
            "effects and a mapping are of a solver, and none is given",
            where=str(effects_file if effects_file is not None else mapping),
            expected="the solver's FMU beside them",
            remedy="Name it (SOLVER), or leave them out: without a solver the FMU holds the corrector alone.",
        )
    model = bundle.load(corrector) if corrector is not None else None
    if fmu is None:
        assert model is not None
        version = fmi or 2
        wiring = alone.wiring(model.info, version)
        platforms = solver.platforms(None, wanted)
        xml = alone.model_description(model.info, version)
        return _Parts(None, xml, model, Effects(), wiring, model.info.step_ns, version, platforms)
    inner = open_fmu(fmu, warn=False)
    if inner.exchange is not None:
        raise WrapError(
            "this FMU offers model exchange only, and a wrapped FMU carries no integrator",
            where=str(inner.path),
            expected="co-simulation, with a solver of its own in it",
            remedy="Export it for co-simulation too (OpenModelica: fmuType me_cs; Dymola: co-simulation using CVODE); run, "
            "train, compare and discover take it as it is.",
        )
    found = effects.read(effects_file) if effects_file is not None else Effects()
    info = model.info if model else None
    said = read_mapping(Path(mapping), inner, info) if mapping is not None else MappingFile()
    inner = said.known(inner, info)
    wiring = wire(inner, model.info, said) if model else Wiring((), {}, {}, start_values(inner, said.parameters or {}))
    wiring = replace(wiring, parameters=places.with_offsets(inner, wiring.parameters, found.offsets))
    step_ns = model.info.step_ns if model else round((found.coupling_step or inner.step_size or 1e-3) * 1e9)
    platforms = solver.platforms(inner, wanted)
    return _Parts(inner, solver.description(inner), model, found, wiring, step_ns, fmi or int(inner.fmi[0]), platforms)


def _generate(parts: _Parts, net: Mapping[str, bytes]) -> tuple[dict[str, bytes], Outer, Description, list[str]]:
    """The C sources, the model description that goes with them, and notes on what could not be tried for them."""
    found = laws.sources(parts.effects)
    version = int(parts.inner.fmi[0]) if parts.inner else 0
    names = [*_ALWAYS, f"inner_fmi{version}" if version else "inner_none", f"outer_fmi{parts.fmi}"]
    if parts.fmi == 3:
        names.append("outer_fmi3_variables")
    sources = {name: (_C / name).read_bytes() for name in (*(f"{name}.c" for name in names), *_HEADERS)}
    for needed in {version or parts.fmi, parts.fmi}:
        sources |= {path.name: path.read_bytes() for path in compiler.fmi_headers(needed)}
    sources |= {**net, **found.files}
    stem, suffix = (parts.inner.name, "corrected" if parts.model else "augmented") if parts.inner else ("corrector", "")
    inside = linked.read(parts.inner, parts.xml) if parts.inner else Linked()
    sources |= inside.files
    outer = Outer(
        fmi=parts.fmi,
        identifier=ctext.identifier(f"{parts.inner.identifier}_{suffix}") if parts.inner else "corrector",
        name=f"{stem} ({suffix})" if suffix else stem,
        token="",
        tool=f"fmucorrect {fmucorrect.__version__}",
        files=tuple(
            sorted([*(name for name in sources if name.endswith(".c") and name not in inside.files), "wrapped.c"])
        ),
        solver=inside.sets,
    )
    try:
        first = describe(parts.xml, parts.added, outer)
    except WrapError as error:
        raise WrapError(str(error), where=str(parts.inner.path) if parts.inner else None) from error
    coupling = parts.effects.coupling_step or 0.0
    located, untried = (), list[str]()
    if parts.inner:
        located = places.places(parts.inner, found.wiring)
        sub_ns = round(coupling * 1e9) or parts.step_ns
        located, untried = places.with_answers(parts.inner, located, sub_ns, parts.starts)
    root = description_xml.read(parts.xml)
    facts = Facts(
        inner=parts.inner,
        outer=parts.fmi,
        token="",
        base=first.base,
        wired=first.wired if parts.inner else alone.wired(parts.wiring, parts.fmi),
        info=parts.model.info if parts.model else None,
        wiring=parts.wiring,
        step_ns=parts.step_ns,
        variable_step=parts.inner is not None and "variable step size" in parts.inner.capabilities,
        places=located,
        coupling=coupling,
        channels_fed=fed_through(root, [source.variable.name for source in parts.wiring.at_once]),
        joints_fed=fed_through(
            root,
            [port.variable.name for place in located for port in place.ports if port],
            {place.force.name for place in located},
        ),
    )
    digest = hashlib.sha256(parts.inner.path.read_bytes() if parts.inner else b"")
    for name in sorted(sources):
        digest.update(name.encode() + b"\0" + sources[name])
    digest.update(generated.header(facts).encode() + generated.tables(facts).encode() + first.xml)
    code = digest.hexdigest()
    token = "{" + "-".join((code[:8], code[8:12], code[12:16], code[16:20], code[20:32])) + "}"
    facts, outer = replace(facts, token=token), replace(outer, token=token)
    sources["wrapped.h"] = generated.header(facts).encode()
    sources["wrapped.c"] = generated.tables(facts).encode()
    return sources, outer, first, [*inside.notes, *untried]


def _described(parts: _Parts, outer: Outer, copy: bool, serialise: bool) -> dict[str, bytes]:
    """The descriptions with what may be offered of the state."""
    made = describe(parts.xml, parts.added, replace(outer, capabilities=Capabilities(copy, serialise)))
    return {"modelDescription.xml": made.xml} | ({"sources/buildDescription.xml": made.build} if made.build else {})


def _step_notes(parts: _Parts) -> list[str]:
    """What a solver of fixed internal step (FMI 3.0) will make of steps that end on the samples."""
    interface = description_xml.read(parts.xml).find("CoSimulation")
    internal = float(interface.get("fixedInternalStepSize", "0")) if interface is not None else 0.0
    sample = parts.step_ns / 1e9
    if internal <= 0.0 or abs(sample / internal - round(sample / internal)) < 1e-6:
        return []
    return [
        f"the sample time {sample:g} s is no multiple of the solver's internal step {internal:g} s: it may refuse steps"
    ]


def _start_notes(parts: _Parts) -> list[str]:
    """Where the solver begins with other numbers than the corrector was trained with: by itself, or by the effects file."""
    if parts.model is None or parts.inner is None:
        return []
    own = {v.name: v.begins for v in parts.inner.of("parameter") if v.number and math.isfinite(v.begins)}
    unlike = parts.model.info.unlike(parts.starts, own)
    if not unlike:
        return []
    return [
        f"the corrector will correct nothing, unless the host sets the solver's parameters as they were in training: "
        f"{few(unlike)}"
    ]


def _condition_notes(parts: _Parts) -> list[str]:
    """What of the operating condition only the host can say."""
    begins = [f"corrector_{key} (begins at {value:.6g})" for key, value in parts.wiring.tunables.items() if value]
    if not begins:
        return []
    return [f"the host sets the operating condition, as nothing in the solver says it: {', '.join(begins)}"]


def _input_notes(parts: _Parts) -> list[str]:
    """What the order of a host's calls makes of inputs that the corrector sees."""
    seen = [source.variable.name for source in parts.wiring.at_once if source.variable.causality == "input"]
    if not seen:
        return []
    late = "a host that reads the corrected channels before it sets the inputs of that time, as fmpy does, reads"
    if parts.inner is None:
        return [
            f"the host sets what is corrected: {late} them a sample late; one that sets first and then reads does not"
        ]
    return [
        f"the corrector sees what the host sets: {few(seen)}. {late[0].upper()}{late[1:]} the correction of the sample before: "
        "what the input changes at once is not corrected then; one that sets first and then reads has it as in training"
    ]


def _check_state(made: FmuDescription, step_ns: int) -> tuple[StateCheck, list[str]]:
    """Whether the state of the FMU just made can be offered, tried on this machine."""
    try:
        made.binaries  # noqa: B018 (raises without a library for this machine)
    except FmuError:
        return StateCheck(False, False, ""), ["its state is not offered: it could not be tried on this machine"]
    state = state_check.works(made.path, step_ns)
    notes = [f"its state is not offered in full: {state.why}"] if state.why else []
    if state.copy and state.rests:
        notes.append(
            "its state was tried while no output moved, which proves little: try it in your host before you rely on it"
        )
    return state, notes


def _faults(inner: FmuDescription | None, made: FmuDescription) -> list[str]:
    """Notes on where the solver's model description breaks the standard, and whether the one that was made does."""
    notes: list[str] = []
    if inner is not None and inner.faults:
        notes.append(f"the solver's model description breaks the FMI standard: {'; '.join(inner.faults)}")
    if made.faults:
        notes.append(f"what is taken over of it breaks the standard in the wrapped FMU too: {'; '.join(made.faults)}")
    return notes


def _facts(parts: _Parts, proved: Proof | None, state: StateCheck) -> dict[str, Any]:
    """What `fmucorrect inspect` shows."""
    inner, model = parts.inner, parts.model
    return {
        "format": 1,
        "fmucorrect": fmucorrect.__version__,
        "solver": None
        if inner is None
        else {
            "file": inner.path.name,
            "sha256": hashlib.sha256(inner.path.read_bytes()).hexdigest(),
            "name": inner.name,
            "tool": inner.tool,
            "fmi": inner.fmi,
        },
        "corrector": None
        if model is None
        else {
            "file": model.path.name,
            "sha256": hashlib.sha256(model.path.read_bytes()).hexdigest(),
            "name": model.info.name,
            "study": model.info.study_hash,
            "step": parts.step_ns / 1e9,
            "rows": model.info.rows,
            **({"numbers in its state": model.info.state} if model.info.state else {}),
            "channels": {
                channel.name: source.variable.name
                for channel, source in zip(model.info.seen, parts.wiring.seen, strict=True)
            },
            "conditions from the solver": {k: s.variable.name for k, s in parts.wiring.conditions.items()},
            "tunables": dict(parts.wiring.tunables),
            "envelope": {key: list(corners) for key, corners in model.info.envelope.items()},
        },
        "effects": [
            {"effect": i.law.name, "joint": i.joint.name, "parameters": dict(i.values)} for i in parts.effects.instances
        ],
        "start values": parts.starts,
        "network in C against ONNX Runtime": None if proved is None else proved.figures(),
        "state": asdict(state),
    }
