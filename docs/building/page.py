"""The page that plays in the browser, as ``play/`` of the site if ``make web`` has built it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig

BUILT = Path(__file__).parents[2] / "web" / "dist"
FOLDER = "play"
_SINGLE_FILE = "piano.html"
"""The page once more, in one file of twice the size: for disks, not for sites."""

_MARK = re.compile(r"^<!-- play -->$", re.M)
_FRAME = (
    f'<iframe src="{FOLDER}/index.html" title="Robot hands that play the piano" '
    'allow="autoplay; midi; fullscreen" loading="lazy"></iframe>\n\n'
    f'<a href="{FOLDER}/index.html">The whole window</a>'
)
_MISSING = "*It is not part of this site: `make web` builds it, `make site` puts it here.*"


def on_page_markdown(markdown: str, **named: object) -> str:
    """Put the page in the place of its mark."""
    del named  # page, config and files, which MkDocs hands over
    built = (BUILT / "index.html").is_file()
    return _MARK.sub(_FRAME if built else _MISSING, markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Copy the page."""
    if (BUILT / "index.html").is_file():
        without = shutil.ignore_patterns(_SINGLE_FILE)
        shutil.copytree(BUILT, Path(config.site_dir, FOLDER), ignore=without, dirs_exist_ok=True)
