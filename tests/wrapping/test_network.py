"""The network as C says what ONNX Runtime says, for every instruction set, and a real-time system can take it."""

import ctypes
import importlib.util
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from bundles import CHANNELS, make
from onnx import helper

from fmucorrect import bundle
from fmucorrect.bundle import Info
from fmucorrect.errors import MissingExtra, WrapError
from fmucorrect.sealing import ramps
from fmucorrect.training.data import Scales
from fmucorrect.training.deployed import Band, Corrector
from fmucorrect.training.export import to_bundle
from fmucorrect.training.networks import Baseline, Member, OneHead, Residual, Student, WindowHead
from fmucorrect.wrapping import compiler, graph, network, proof

ROOT = Path(__file__).resolve().parent.parent.parent
SHIPPED = ROOT / "exported_models" / "roller_rig" / "corrector.onnx"
PROBE = ROOT / "fmucorrect" / "wrapping" / "c" / "network_probe.c"
ROWS = 12
STACK = 32 * 1024
"""Bytes that one answer may take of a host's stack: a quarter of the least that a thread gets (128 KiB with musl)."""


@pytest.fixture(scope="module")
def shipped() -> network.NetworkSources:
    return network.sources(SHIPPED)


@pytest.fixture(scope="module")
def phase(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle with random weights and the phase among its inputs; its channels are in metres."""
    return random_bundle(tmp_path_factory.mktemp("phase"), one=False)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with one network in the members' place."""
    return random_bundle(tmp_path_factory.mktemp("one"), one=True)


def random_bundle(folder: Path, one: bool) -> Path:
    torch.manual_seed(0)
    channels = 2
    scales = Scales(
        response=np.full(channels, 2e-3),
        seen=np.full(channels, 2e-3),
        window=np.full(channels, 2e-3),
        components=np.random.default_rng(0).normal(size=(ROWS * channels, 5)),
        speed=(330.0, 30.0),
        uncorrected=np.full(channels, 1e-3),
    )
    members = [Member(Baseline(ROWS * channels, 7, channels), 0.9, Residual(8, (9, 6, 5), channels)) for _ in range(3)]
    for member in members:
        torch.nn.init.normal_(member.residual.out.weight, std=0.3)
    corners = {
        **{f"response {channel.name}": (-6e-3, -5e-3, 5e-3, 6e-3) for channel in CHANNELS[:channels]},
        "speed": (240.0, 270.0, 390.0, 420.0),
        "amplitude": (0.01, 0.02, 0.04, 0.05),
    }
    band = Band((1e-3,) * channels, (0.1,) * channels, (0.2,) * channels, (0.3,) * channels, (2.0,) * channels)
    info = Info(
        name="phase",
        channels=tuple(replace(channel, unit="m") for channel in CHANNELS[:channels]),
        rows=ROWS,
        step_ns=1_000_000,
        uncorrected=(1e-3,) * channels,
        envelope=corners,
        conditions=(),
        study_hash="0" * 64,
        versions={},
    )
    windows = np.random.default_rng(1).normal(size=(4, ROWS, channels), scale=2e-3).astype(np.float32)
    head = WindowHead(members, scales, phase=True)
    if one:
        features = torch.from_numpy(np.linalg.pinv(scales.components) / scales.rows)
        student = Student(members, features, beside=3, wide=4 * channels)
        torch.nn.init.normal_(student.wide.weight, std=0.3)
        shares = torch.rand(4 * channels, channels, dtype=torch.float64) * 1e-3
        head = OneHead(student, shares, torch.full((channels,), 1e-3), scales, phase=True)
    content = to_bundle(
        Corrector(head, ROWS, scales, ramps(CHANNELS[:channels], corners), band),
        info,
        windows,
        np.array([330.0, 0.03, 1.3]),
        np.array([-1.0, 0.0, 1.7, 1e6]),
        np.zeros((len(windows), 0)),
        np.zeros((len(windows), 0)),
    )
    path = folder / "corrector.onnx"
    path.write_bytes(content)
    return path


@pytest.fixture(scope="module")
def phase_sources(phase: Path) -> network.NetworkSources:
    return network.sources(phase)


def outputs(
    sources: network.NetworkSources, folder: Path, way: int, inputs: list[np.ndarray]
) -> list[np.ndarray] | None:
    """corrected, baseline, sigma, in_envelope of one way of computing."""
    names = sources.write(folder)
    shutil.copy(PROBE, folder)
    target, _, suffix = compiler.TARGETS["linux64"][0]
    library = folder / f"probe{suffix}"
    compiler.compile_library(folder, [*names, PROBE.name], target, library)
    count, channels = len(inputs[0]), sources.channels
    answers = [np.zeros((count, width), np.float32) for width in (channels, channels, channels, 1)]
    stateless = np.zeros((count, 0), np.float32)
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*inputs, *answers, stateless, stateless)]
    return answers if ctypes.CDLL(str(library)).probe(way, count, *pointers) else None


def inputs_for(rows: int, channels: int, size: float, count: int = 200) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    windows = (rng.normal(size=(count, rows, channels)).cumsum(1) * size / np.sqrt(rows)).astype(np.float32)
    conditions = np.stack([rng.uniform(230, 430, count), np.full(count, 0.03), rng.uniform(1.0, 3.0, count)], 1)
    return [windows, conditions.astype(np.float32), np.concatenate([rng.uniform(-5, 1e6, count - 1), [1e6]])[:, None]]


@pytest.mark.parametrize("way", [0, 1])
@pytest.mark.parametrize("name", ["shipped", "phase", "one"])
def test_all_outputs_equal_onnx_runtime(
    name: str,
    way: int,
    shipped: network.NetworkSources,
    phase: Path,
    phase_sources: network.NetworkSources,
    one: Path,
    tmp_path: Path,
) -> None:
    path, sources, unit = {
        "shipped": (SHIPPED, shipped, 1.0),
        "phase": (phase, phase_sources, 1e3),
        "one": (one, network.sources(one), 1e3),
    }[name]
    inputs = inputs_for(sources.rows, sources.channels, 3.0 / unit)
    if name == "shipped":  # to its guard all random windows are new
        known = bundle.load(SHIPPED).golden["window"]
        inputs[0] = np.concatenate([factor * known for factor in np.linspace(0.7, 1.3, 25, dtype=np.float32)])
    got = outputs(sources, tmp_path, way, inputs)
    if got is None:
        pytest.skip("this processor lacks the instruction set")
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    feed = dict(zip(graph.INPUTS, inputs, strict=True))
    expected = [np.asarray(array) for array in session.run(list(graph.OUTPUTS), feed)]
    for a, b in zip(got, expected, strict=True):
        assert np.abs(a - b).max() * unit <= 1e-5
    assert len(np.unique(got[3])) > 10


def test_the_phase_is_exact_after_a_million_seconds(phase_sources: network.NetworkSources, tmp_path: Path) -> None:
    sources = phase_sources
    seconds = np.concatenate([[0.0, 0.2], 1e6 + np.array([0.0, 0.2])])[:, None]
    windows = np.full((4, ROWS, sources.channels), 1e-3, np.float32)
    conditions = np.tile(np.array([330.0, 0.03, 1.3], np.float32), (4, 1))
    got = outputs(sources, tmp_path, -1, [windows, conditions, seconds])
    assert got is not None
    assert np.abs(got[0][0] - got[0][1]).max() > 1e-5
    assert np.abs(got[0][:2] - got[0][2:]).max() <= 1e-8  # 1.3 Hz: a million seconds are whole cycles


def test_the_proof_holds_for_each_instruction_set(
    shipped: network.NetworkSources, phase: Path, phase_sources: network.NetworkSources, tmp_path: Path
) -> None:
    held = proof.prove(bundle.load(SHIPPED), shipped, tmp_path / "shipped")
    assert held.windows == 2008
    assert 500 < held.inside < 2008
    assert max(held.errors.values()) <= 1.0  # of what rounding allows: most where the correction fades
    assert {"chosen", "baseline"} <= set(held.errors)
    proof.prove(bundle.load(phase), phase_sources, tmp_path / "phase")
    toy = make(tmp_path / "toy.onnx", rows=5)
    assert proof.prove(bundle.load(toy), network.sources(toy), tmp_path / "toy").largest <= 1e-5


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("network_data.c", rb"0x1\.(\w{6})p-", rb"0x1.\1p+"), ("network_lanes.h", rb"e-06f;", rb"e-05f;")],
)
def test_changed_sources_are_refused(
    shipped: network.NetworkSources, tmp_path: Path, name: str, old: bytes, new: bytes
) -> None:
    changed = re.sub(old, new, shipped.files[name], count=1)
    assert changed != shipped.files[name]
    with pytest.raises(WrapError, match="is not the corrector"):
        proof.prove(bundle.load(SHIPPED), replace(shipped, files={**shipped.files, name: changed}), tmp_path)


def test_generation_is_deterministic_and_names_no_machine(shipped: network.NetworkSources, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere.onnx"
    shutil.copy(SHIPPED, copy)
    assert network.sources(copy).files == shipped.files
    text = shipped.files["network_graph.h"] + shipped.files["network_data.c"]
    for word in (b"sha256", b"/tmp", str(ROOT).encode(), b"Metadata"):
        assert word not in text


def test_nothing_is_allocated_and_nothing_is_kept(
    shipped: network.NetworkSources, phase_sources: network.NetworkSources
) -> None:
    for sources in (shipped, phase_sources):
        for name, content in sources.files.items():
            text = re.sub(r"/\*.*?\*/", "", content.decode(), flags=re.DOTALL)
            assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|fopen|printf)\b", text), name
            kept = re.findall(r"\bstatic (?!inline\b|const\b)[^;{}()]*[;=]", text)
            assert kept == (["static network_function *fastest;"] if name == "network.c" else []), name


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_another_compiler_takes_it_without_a_word(shipped: network.NetworkSources, tmp_path: Path) -> None:
    names = shipped.write(tmp_path)
    command = [
        "gcc",
        "-std=c11",
        "-pedantic-errors",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O2",
        f"-Wframe-larger-than={STACK}",
    ]
    result = subprocess.run([*command, "-c", *names], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    if shutil.which("size"):
        objects = sorted(file.name for file in tmp_path.glob("*.o"))
        table = subprocess.run(["size", *objects], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        sections = [list(map(int, line.split()[1:3])) for line in table.splitlines()[1:]]
        assert sum(data + bss for data, bss in sections) <= 8, table  # the pointer in network.c


def test_tanh(tmp_path: Path) -> None:
    (tmp_path / "tanh.c").write_text(
        '#include <string.h>\n#define NETWORK_VECTORS 1\n#define NETWORK_LANES 4\n#include "network_lanes.h"\n'
        '__attribute__((visibility("default"))) void many(int n, float x[]);\n'
        "void many(int n, float x[]) { for (int i = 0; i < n; i++) x[i] = network_tanh(x[i]); }\n"
    )
    shutil.copy(PROBE.parent / "network_lanes.h", tmp_path)
    compiler.compile_library(tmp_path, ["tanh.c"], compiler.TARGETS["linux64"][0][0], tmp_path / "tanh.so")
    values = np.concatenate([np.linspace(-12, 12, 400_001), np.logspace(-30, 0, 1000), [np.nan, np.inf, -np.inf, 0.0]])
    got = values.astype(np.float32)
    ctypes.CDLL(str(tmp_path / "tanh.so")).many(len(got), got.ctypes.data_as(ctypes.c_void_p))
    expected = np.tanh(values.astype(np.float32).astype(float))
    assert np.isnan(got[-4])
    assert np.nanmax(np.abs(got - expected)) <= 5e-7


def test_an_operator_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    model = onnx.load(make(tmp_path / "toy.onnx"))
    last = next(node for node in model.graph.node if node.output[0] == "baseline")
    last.CopyFrom(helper.make_node("GlobalLpPool", ["newest"], ["baseline"]))
    path = tmp_path / "pool.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(WrapError, match=r"; node GlobalLpPool that makes 'baseline'\. Export"):
        network.sources(path)


def test_an_operator_that_no_graph_has_and_a_package_that_is_not_there(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "broken.onnx").write_bytes(b"\x12\xff no graph")
    with pytest.raises(WrapError, match=r"broken\.onnx: .*cannot be written as C"):
        network.sources(tmp_path / "broken.onnx")
    here = importlib.util.find_spec
    for module, package in (("onnx", "onnx"), ("emx_onnx_cgen", "emx-onnx-cgen")):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, gone=module: None if name == gone else here(name))
        with pytest.raises(MissingExtra, match=package):
            network.sources(SHIPPED)


def test_dividing_a_matrix_loses_nothing() -> None:
    rng = np.random.default_rng(0)
    saved = 0
    for _ in range(500):
        height, width = rng.integers(1, 250, 2)
        matrix = np.zeros((height, width), np.float32)
        for _ in range(rng.integers(0, 6)):
            rows, columns = np.sort(rng.integers(0, height + 1, 2)), np.sort(rng.integers(0, width + 1, 2))
            matrix[slice(*rows), slice(*columns)] = 1.0
        copy = np.zeros_like(matrix)
        blocks = graph.divide(matrix)
        for block in blocks:
            assert block.rows
            for rows in block.rows:
                copy[slice(*rows), slice(*block.columns)] += matrix[slice(*rows), slice(*block.columns)]
        assert np.array_equal(copy, matrix)
        assert [0, *(block.columns[1] for block in blocks)] == [*(block.columns[0] for block in blocks), width]
        saved += height * width - sum(block.products for block in blocks)
    assert saved > 0
