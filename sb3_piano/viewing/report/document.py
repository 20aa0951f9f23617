"""The frame of a page: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from sb3_piano.viewing.report.style import STYLE
from sb3_piano.viewing.report.theme import library_html

# The browser itself refuses whatever would have to be fetched.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def document_html(title: str, parts: Iterable[str], script: str = "") -> str:
    """Return a page that holds the plotting library and style, and asks for nothing else.

    Args:
        title: What the browser shows as the page's name; it is escaped.
        parts: HTML of the page's parts, in which figures may stand.
        script: What runs when they are there.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)} · sb3-piano</title><style>{STYLE}</style>{library_html()}</head>\n"
        f"<body><main>{''.join(part + chr(10) for part in parts)}</main>"
        f"<script>{script}</script></body></html>\n"
    )
