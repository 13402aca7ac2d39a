"""Hooks of mkdocs: pages that are made, so that each fact has one home.

- PAGES: files of the project that are pages as they stand (READMEs of the packages, cards, CHANGELOG and so on).
- reference/cli.md from the command line itself, reference/api.md from the public names.
- Links between such files lead to pages; a link to a file that is no page shows its place in the project instead.
"""

from __future__ import annotations

import html
import os
import re
from pathlib import Path, PurePosixPath
from typing import Any

import click
import griffe
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
PAGES = {
    "index.md": "README.md",
    "reference/study.md": "fmucorrect/README.md",
    "reference/records.md": "fmucorrect/records/README.md",
    "reference/fmu.md": "fmucorrect/fmu/README.md",
    "reference/training.md": "fmucorrect/training/README.md",
    "reference/discovery.md": "fmucorrect/discovery/README.md",
    "reference/catalogue.md": "fmucorrect/catalogue/README.md",
    "reference/wrapping.md": "fmucorrect/wrapping/README.md",
    "reference/railway.md": "fmucorrect/railway/README.md",
    **{
        f"models/{name}.md": f"fmus/{name}/readme.md"
        for name in ("roller_rig", "full_vehicle", "oscillator", "cooperrider", "wheelset")
    },
    "evidence/hosts.md": "fmucorrect/wrapping/hosts.md",
    **{
        f"evidence/{page}_{rig}.md": f"exported_models/{folder}/{file}"
        for rig, folder in (("A", "roller_rig"), ("B", "roller_rig_B"), ("C", "roller_rig_C"))
        for page, file in (("card", "card.md"), ("found", "discovery/README.md"))
    },
    "evidence/gallery.md": "exported_models/gallery.md",
    "evidence/virtual_rigs.md": "tools/virtual_rig/README.md",
    "evidence/suite.md": "tools/hidden_effects/README.md",
    "evidence/real_data.md": "tools/real_data/README.md",
    "project/contributing.md": "CONTRIBUTING.md",
    "project/changelog.md": "CHANGELOG.md",
    "project/security.md": "SECURITY.md",
    "project/example_c.md": "tools/examples/c/README.md",
    "project/example_node.md": "tools/examples/node/README.md",
}
PAGE_OF = {source: page for page, source in PAGES.items()}
FILES = "files"  # folder of the site for pictures, data and pages of reports that are linked
SHOWN = {".svg", ".png", ".html", ".json", ".toml", ".csv"}
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
MATH = re.compile(r"^```math\n(.*?)^```", re.M | re.S)
FENCE = re.compile(r"(^```.*?^```[^\n]*$)", re.M | re.S)
BARRED = re.compile(r"`([^`\n]*\\\|[^`\n]*)`")  # code with a bar in a cell of a table: GitHub takes the backslash away
COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7}\b(?!-)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made, and every file of the project that a page links."""
    for page, source in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    files.append(File.generated(config, "reference/cli.md", content=command_line()))
    files.append(File.generated(config, "reference/api.md", content=public_names()))
    linked = {
        target
        for file in files.documentation_pages()
        for _, _, link in LINK.findall(file.content_string)
        if (target := target_of(file.src_uri, link)[0]) and target.suffix in SHOWN
    }
    for target in sorted(linked):
        if (ROOT / target).is_file() and not target.is_relative_to("docs"):
            files.append(File.generated(config, f"{FILES}/{target}", abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links as the site has them. Raises ValueError where a page names a commit: these belong into the history."""
    uri = page.file.src_uri
    markdown = MATH.sub(
        lambda match: convert(" ".join(match[1].split()), display="block"), markdown
    )  # no script draws it
    parts = FENCE.split(markdown)
    parts[::2] = [LINK.sub(lambda match: link(uri, *match.groups()), part) for part in parts[::2]]
    parts[::2] = [BARRED.sub(lambda match: code(match[1].replace("\\|", "|")), part) for part in parts[::2]]
    if found := COMMIT.findall(re.sub(r"sha256[^\n]*", "", "".join(parts[::2]))):
        raise ValueError(f"{PAGES.get(uri, uri)} names commits: {', '.join(found)}")
    return "".join(parts)


def target_of(uri: str, link: str) -> tuple[PurePosixPath | None, str]:
    """The file of the project that a link of a page means, and the anchor; None where it leads out of the project."""
    if re.match(r"[a-z]+:|#", link):
        return None, ""
    path, _, anchor = link.partition("#")
    source = PAGES.get(uri, f"docs/{uri}")
    return PurePosixPath(os.path.normpath(PurePosixPath(source).parent / path)), anchor


def link(uri: str, picture: str, text: str, target: str) -> str:
    """One link of a page, rewritten."""
    file, anchor = target_of(uri, target)
    if file is None or ((ROOT / "docs" / uri).is_file() and file.is_relative_to("docs")):
        return f"{picture}[{text}]({target})"
    if file.is_relative_to("docs"):
        place = str(file.relative_to("docs"))
    elif str(file) in PAGE_OF:
        place = PAGE_OF[str(file)]
    elif not (ROOT / file).exists():
        return f"{picture}[{text}]({target})"  # mkdocs says that it leads nowhere
    elif file.suffix in SHOWN and (ROOT / file).is_file():
        place = f"{FILES}/{file}"
    else:
        return f"`{file}`" if text.strip("`/") in str(file) else f"{text} (`{file}`)"
    way = os.path.relpath(place, PurePosixPath(uri).parent)
    return f"{picture}[{text}]({way}{'#' if anchor else ''}{anchor})"


def command_line() -> str:
    """Every command with its options, as click knows them."""
    from fmucorrect.cli import main

    text = ["# Command line", "", "Made from the commands themselves; `fmucorrect COMMAND --help` says the same.", ""]
    text += paragraphs(main)
    for name in sorted(main.commands):
        text += described(main.commands[name], f"fmucorrect {name}", 2)
    return "\n".join(text)


def described(command: click.Command, name: str, level: int) -> list[str]:
    context = click.Context(command, info_name=name)
    arguments = " ".join(piece for piece in command.collect_usage_pieces(context) if piece != "[OPTIONS]")
    text = [
        f"{'#' * level} {name}",
        "",
        "```text",
        f"{name} [OPTIONS] {arguments}".rstrip(),
        "```",
        "",
        *paragraphs(command),
    ]
    rows = [record for item in command.get_params(context) if (record := item.get_help_record(context)) and record[1]]
    text += ["| option | what it does |", "|---|---|", *(f"| {code(a)} | {escaped(b)} |" for a, b in rows), ""]
    if isinstance(command, click.Group):
        for sub in sorted(command.commands):
            text += described(command.commands[sub], f"{name} {sub}", level + 1)
    return text


def paragraphs(command: click.Command) -> list[str]:
    """The help text; examples in a block of their own."""
    text: list[str] = []
    for part in re.split(r"\n\s*\n", (command.help or "").replace("\b", "").strip()):
        line = " ".join(part.split())
        example = re.match(r"(Example|Examples|Start with): (fmucorrect .*)", line)
        text += ["```text", example[2], "```", ""] if example else [escaped(line), ""]
    return text


def code(text: str) -> str:
    """In a cell of a table, where a bar ends the cell."""
    return f"<code>{html.escape(text).replace('|', '&#124;')}</code>"


def escaped(text: str) -> str:
    return re.sub(r"([<>*_|\[\]])", r"\\\1", " ".join(text.split()))


def public_names() -> str:
    """What `import fmucorrect as fc` offers, in the order of `__all__`, each from where it is defined."""
    import fmucorrect

    where: dict[str, Any] = fmucorrect._WHERE
    text = ["# Python", "", "`import fmucorrect as fc`; each name is imported when it is first used.", ""]
    names = {name: f"fmucorrect.{'.'.join(where[name])}" for name in fmucorrect.__all__ if name in where}
    text += ["| name | what it is |", "|---|---|"]
    package = griffe.load("fmucorrect", search_paths=[ROOT])  # read, not imported: torch and others need not be there
    for name, path in names.items():
        said = package[path.removeprefix("fmucorrect.")].docstring
        text.append(f"| [`fc.{name}`](#{path}) | {summary(said.value if said else '')} |")
    for name, path in names.items():
        text += ["", f"::: {path}", "    options:", f"      heading: fc.{name}", f"      toc_label: fc.{name}"]
    return "\n".join(text) + "\n"


def summary(docstring: str) -> str:
    """Its first sentence."""
    return escaped(re.split(r"(?<=\.) |[:;] ", " ".join(docstring.split()))[0].rstrip(".")) + "."
