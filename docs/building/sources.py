"""Files of the repository that the documentation links to, as pages of the site.

The documentation is read in the repository, too, where ``../examples/demo.py`` leads to the file.
In the site the same link leads to a page that shows the file: there is no need of a server with the
repository, and the site is whole without a network. A folder becomes a page that lists its files.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = "source"
"""Folder of the site that holds the pages of files."""

ALWAYS = (ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md")
"""Files that have a page whether or not another page links to them."""

_LINK = re.compile(r"(?<=\]\()(?!https?:|#|mailto:)(?P<path>[^)\s#]+)(?=[)#])")
_LANGUAGES = {
    ".cfg": "ini",
    ".csv": "text",
    ".json": "json",
    ".py": "python",
    ".toml": "toml",
    ".txt": "text",
    ".yaml": "yaml",
    ".yml": "yaml",
}
"""Language of a file that is shown, by its suffix; others than these are for downloading."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each file that is linked to, and for what those link to."""
    waiting = list(ALWAYS)
    for file in files.documentation_pages():
        waiting += _outside(file.content_string, _origin(file))
    known: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in known or _is_in_site(path):
            continue
        known.add(path)
        if path.is_dir():
            waiting += _listed(path)
        elif path.suffix == ".md":
            waiting += _outside(path.read_text("utf-8"), path)
        files.append(_file(path, config))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to files of the repository lead to their pages."""
    del config, files  # handed over by name
    return _rewritten(markdown, _origin(page.file), page.file.src_uri)


def _origin(file: File) -> Path:
    """Return the file in the repository from which the links of a page begin."""
    if file.src_uri.startswith(f"{PAGES}/"):
        return ROOT / file.src_uri.removeprefix(f"{PAGES}/")
    return DOCS / file.src_uri


def _outside(markdown: str, origin: Path) -> Iterator[Path]:
    """Yield the files outside of the documentation that a page links to."""
    for match in _LINK.finditer(markdown):
        target = _target(match["path"], origin)
        if target.exists() and not _is_in_site(target):
            yield target


def _target(link: str, origin: Path) -> Path:
    return Path(posixpath.normpath((origin.parent / link).as_posix()))


def _is_in_site(path: Path) -> bool:
    """Return whether a file is part of the documentation; its Python files are shown as pages."""
    return path.is_relative_to(DOCS) and path.is_file() and path.suffix != ".py"


def _rewritten(markdown: str, origin: Path, src_uri: str) -> str:
    """Return the text of a page at ``src_uri`` with links that lead to the site's own pages."""

    def moved(match: re.Match[str]) -> str:
        target = _target(match["path"], origin)
        if not target.exists():
            return match["path"]  # MkDocs says that it is missing
        uri = target.relative_to(DOCS).as_posix() if _is_in_site(target) else _uri(target)
        return posixpath.relpath(uri, posixpath.dirname(src_uri) or ".")

    return _LINK.sub(moved, markdown)


def _uri(path: Path) -> str:
    """Return where a file's page stands among the sources of the site."""
    inside = f"{PAGES}/{path.relative_to(ROOT).as_posix()}"
    inside = inside.replace("/.", "/")  # MkDocs leaves out what is hidden
    if path.is_dir():
        return f"{inside}/index.md"
    return f"{inside}.md" if path.suffix in _LANGUAGES or not path.suffix else inside


def _file(path: Path, config: MkDocsConfig) -> File:
    """Return the page of a file or a folder, or the file itself where it is no text."""
    uri = _uri(path)
    if path.suffix == ".md":  # its links are rewritten as those of any page
        return File.generated(config, uri, content=path.read_text("utf-8"))
    if uri.endswith(".md"):
        body = _listing(path) if path.is_dir() else _shown(path)
        title = path.relative_to(ROOT).as_posix()
        text = f"---\nsearch:\n  exclude: true\n---\n\n# {title}\n\n{body}"
        return File.generated(config, uri, content=text)
    return File.generated(config, uri, abs_src_path=str(path))


def _shown(path: Path) -> str:
    fence = "`" * 8  # longer than any in a file
    language = _LANGUAGES.get(path.suffix, "text")
    return f"{fence}{language}\n{path.read_text('utf-8')}\n{fence}\n"


def _listing(folder: Path) -> str:
    return "\n".join(f"- [{path.name}]({path.name})" for path in _listed(folder))


def _listed(folder: Path) -> list[Path]:
    """Return what a folder holds, but for what Python and tools leave there."""
    return sorted(path for path in folder.iterdir() if not path.name.startswith(("__py", ".")))
