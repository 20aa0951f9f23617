"""Make text from other sources, such as titles and file names, safe to show."""

from __future__ import annotations

import re

_BREAKS = re.compile("\\s*[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]\\s*|\t")
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, which terminals obey; marks of writing direction; surrogates, which stand for
undecodable bytes of file names."""

_LONGEST = 1200
"""Most characters of a message, which may quote long values."""
_KEPT_OF_END = 500


def escaped(text: str) -> str:
    """Replace unprintable characters; keep line breaks."""
    return _UNPRINTABLE.sub("\ufffd", text)


def printable(text: str) -> str:
    """Replace line breaks and unprintable characters, so that text is one line."""
    return escaped(_BREAKS.sub(" ", text))


def shortened(text: str) -> str:
    """Make a message one printable line; cut the middle out of a long one."""
    if len(text) > _LONGEST:
        end = len(text) - _KEPT_OF_END
        text = f"{text[: _LONGEST - _KEPT_OF_END]} ... {text[end:]}"
    return printable(text)
