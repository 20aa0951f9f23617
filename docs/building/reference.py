"""Pages of the reference: one for each public package, with what it exports."""

from __future__ import annotations

import importlib
import pkgutil

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import sb3_piano.lab

FOLDER = "api"
SECTION = "Reference"
HEAD = "---\nsearch:\n  boost: 0.0005\n---\n\n"
"""Head of a page that ranks below all guides in the search: titles count a thousandfold there."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the section with the pages to the navigation."""
    entries = [f"{FOLDER}/index.md", *(f"{FOLDER}/{name}.md" for name in packages())]
    assert config.nav is not None, "mkdocs.yml has the other sections"
    if not any(SECTION in entry for entry in config.nav):
        config.nav.insert(-1, {SECTION: entries})  # the last one is about contributing
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    lines = ["# Reference", "", "| package | what it is |", "|---|---|"]
    for name, meaning in packages().items():
        full = f"{sb3_piano.__name__}.{name}"
        lines.append(f"| [`{full}`]({name}.md) | {meaning} |")
        page = f"{HEAD}# {full}\n\n::: {full}\n"
        files.append(File.generated(config, f"{FOLDER}/{name}.md", content=page))
    files.append(
        File.generated(config, f"{FOLDER}/index.md", content=HEAD + "\n".join(lines) + "\n")
    )
    return files


def packages() -> dict[str, str]:
    """Return the packages that export something, with the first lines of their docstrings."""
    found = {}
    for where, before in ((sb3_piano, ""), (sb3_piano.lab, "lab.")):
        for info in pkgutil.iter_modules(where.__path__):
            if info.ispkg and info.name != "cli":
                package = importlib.import_module(f"{where.__name__}.{info.name}")
                if getattr(package, "__all__", None) and package.__doc__:
                    found[before + info.name] = package.__doc__.partition("\n")[0]
    return found
