"""Notebooks as pages: executed when the site is built, so that what they show is what happens.

A cell becomes a block of code, what it prints the block below, and what it displays a picture or
HTML. An error in a cell ends the build.
"""

from __future__ import annotations

import base64
import functools
import os
import re
import tempfile
from collections.abc import Iterator

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbclient import NotebookClient
from nbformat import NotebookNode

_LINK = re.compile(r"(?<=\w)\.ipynb(?=\)|#[^)\s]*\))")

_STEPS = re.compile(r"^STEPS = [\d_]+", re.M)
_PICTURE = re.compile(r"Picture\([^)]*\)")

TIMEOUT = 300
"""Time that a cell may take, s."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, beside the notebook itself."""
    for file in list(files):
        if file.src_uri.endswith(".ipynb"):
            for uri, content in _pages(file.src_uri, file.content_string):
                files.append(File.generated(config, uri, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links of other pages to a notebook lead to its page."""
    del config  # handed over by name
    notebook = f"{page.file.src_uri.removesuffix('.md')}.ipynb"
    is_its_page = files.get_file_from_path(notebook) is not None
    return markdown if is_its_page else _LINK.sub(".md", markdown)


@functools.lru_cache(maxsize=8)  # `mkdocs serve` builds again whenever a page changes
def _pages(uri: str, text: str) -> tuple[tuple[str, str | bytes], ...]:
    """Execute a notebook; return its page and its pictures, each with the place in the site."""
    notebook = nbformat.reads(text, as_version=4)
    steps = os.environ.get("NOTEBOOK_STEPS")  # for tests: how long a notebook trains at most
    for cell in notebook.cells if steps else ():
        cell.source = _STEPS.sub(f"STEPS = {steps}", cell.source)
        cell.source = _PICTURE.sub("Picture(width=160, height=90, fps=20)", cell.source)
    with tempfile.TemporaryDirectory() as folder:  # runs and videos are written there
        place = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=TIMEOUT, resources=place).execute()
    stem = uri.removesuffix(".ipynb")
    name = uri.rpartition("/")[2]
    blocks: list[str] = []
    pictures: list[tuple[str, bytes]] = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            blocks.append(cell.source)
            continue
        blocks.append(_fenced(cell.source, "python"))
        for output in cell.outputs:
            for kind, content in _shown(output):
                if kind == "image/png":
                    picture = f"{stem}_{len(pictures)}.png"
                    pictures.append((picture, base64.b64decode(content)))
                    blocks.append(f"![Figure]({picture.rpartition('/')[2]})")
                else:
                    blocks.append(content if kind == "text/html" else _fenced(content, "text"))
    blocks.append(f"*[{name}]({name}), executed when this site was built.*")
    return ((f"{stem}.md", "\n\n".join(blocks) + "\n"), *pictures)


def _shown(output: NotebookNode) -> Iterator[tuple[str, str]]:
    """Yield what is shown of an output: its richest form, and of what is printed no warnings."""
    if output.output_type == "stream":
        if output.name == "stdout":
            yield "text/plain", output.text
        return
    for kind in ("image/png", "text/html", "text/plain"):
        if kind in output.data:
            yield kind, output.data[kind]
            return


def _fenced(text: str, language: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```"
