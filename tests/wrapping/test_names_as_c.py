"""Names that others chose are names in the wrapped FMU and nothing else: no code, no end of a literal or a comment."""

import ctypes
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import onnx
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

import bundles
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from odd import CHANNELS, MS, ROWS, plain, solver, walk
from onnx import TensorProto, helper

from fmucorrect.errors import FmucorrectError, WrapError
from fmucorrect.fmu import open_fmu
from fmucorrect.signals import Channel
from fmucorrect.wrapping import compiler, ctext, network
from fmucorrect.wrapping.package import wrap

HOSTILE = '??/"}; int x = system("..."); //'
_PIECES = [
    "??/",
    "??/\n",
    '"',
    "\\",
    "*/",
    "/*",
    "//",
    "%s%n",
    "\n",
    "\r",
    "\\\n",
    "7",
    "\x1b[2J",
    "\u202e",
    "é",
    "\U0001f682",
]
NAMES = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40),
    st.lists(st.sampled_from(_PIECES), max_size=12).map("".join),
)


def read_back(names: list[str], flags: list[str]) -> list[str]:
    """The names, through a compiled table of them, each beside a comment of it."""
    rows = "".join(f"    /* {ctext.comment(name, 'a name')} */ {ctext.literal(name, 'a name')},\n" for name in names)
    table = f'__attribute__((visibility("default"))) const char *const names[] = {{\n{rows}    0,\n}};\n'
    target, _, suffix = compiler.host()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "names.c").write_text(table, encoding="utf-8")
        library = Path(folder) / f"names{suffix}"
        compiler.compile_library(Path(folder), ["names.c"], target, library, [*compiler.EXACT, *flags])
        found = (ctypes.c_char_p * (len(names) + 1)).in_dll(ctypes.CDLL(str(library)), "names")
        assert found[len(names)] is None
        return [(found[i] or b"").decode() for i in range(len(names))]


@pytest.mark.parametrize("flags", [[], ["-trigraphs", "-Wno-trigraphs"]])
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@example([HOSTILE, *_PIECES, "", "x" * ctext.LONGEST])
@given(st.lists(NAMES, min_size=100, max_size=300))
def test_every_name_comes_back_from_the_compiler_as_it_was(flags: list[str], names: list[str]) -> None:
    assert read_back(names, flags) == names


@given(st.text())
def test_an_identifier_is_one(text: str) -> None:
    made = ctext.identifier(text)
    assert made.isascii()
    assert made.isidentifier()
    assert len(made) <= ctext.LONGEST_IDENTIFIER + 1


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * (ctext.LONGEST + 1)])
def test_what_is_no_text_of_c_is_refused(name: str) -> None:
    with pytest.raises(WrapError, match=r"^a channel's name"):
        ctext.literal(name, "a channel's name")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(WrapError, match="finite"):
        ctext.number(value, "a factor")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_channel_with_a_name_of_code(fmi: int, tmp_path: Path) -> None:
    channels = (Channel(HOSTILE, "mm", "displacement", simulation="x", axis="*/ }", positive="??/"), *CHANNELS[1:])
    model = bundles.make(tmp_path / "corrector.onnx", channels, rows=ROWS, step_ns=MS)
    made = wrap(solver(fmi), model, tmp_path / "made.fmu", platforms=["linux64"])
    names = [f"{HOSTILE}_corrected", "x"]
    assert set(names) < set(open_fmu(made.path).variables)
    with plain(made.path, tuple(Channel(name, "mm", simulation=name) for name in names)) as stepper:
        rows = walk(stepper, range(0, 20 * MS, MS))
    assert np.abs(rows[10:, 0] - rows[10:, 1]).max() > 0  # it is corrected
    with zipfile.ZipFile(made.path) as file:
        text = file.read("sources/wrapped.c").decode()
    assert ctext.literal(HOSTILE, "a name") in text
    assert "?" not in text


@pytest.mark.parametrize("name", ["\x1b[2J", "a\x00", "\ufffe"])
@pytest.mark.parametrize("alone", [True, False])
def test_a_channel_whose_name_no_xml_can_hold(name: str, alone: bool, tmp_path: Path) -> None:
    channels = (Channel(name, "mm", "displacement", simulation="x"), *CHANNELS[1:])
    model = bundles.make(tmp_path / "corrector.onnx", channels, rows=ROWS, step_ns=MS)
    with pytest.raises(FmucorrectError, match=r"no XML file can hold|NUL"):
        wrap(None if alone else solver(2), model, tmp_path / "made.fmu", platforms=["linux64"])


def test_nothing_that_a_graph_says_of_itself_reaches_the_sources(tmp_path: Path) -> None:
    path = bundles.make(tmp_path / "toy.onnx")
    expected = network.sources(path).files
    word = "*/ int pwned; /*"
    model = onnx.load(path)
    kept = {item.name for item in (*model.graph.input, *model.graph.output)}
    for owner in (model, model.graph, *model.graph.node, *model.graph.initializer):
        for field in ("name", "doc_string", "producer_name", "producer_version", "domain"):
            if field in owner.DESCRIPTOR.fields_by_name and not (
                field == "domain" and isinstance(owner, onnx.NodeProto)
            ):
                setattr(owner, field, word + getattr(owner, field))
    for node in model.graph.node:
        node.input[:] = [name if name in kept else word + name for name in node.input]
        node.output[:] = [name if name in kept else word + name for name in node.output]
    for tensor in model.graph.output:
        tensor.type.tensor_type.shape.dim[0].dim_param = word
    model.graph.value_info.append(helper.make_tensor_value_info(word, TensorProto.FLOAT, [word]))
    path.write_bytes(model.SerializeToString())
    found = network.sources(path).files
    assert found == expected
