"""Text of others, such as titles and names of files, fit to be shown."""

from __future__ import annotations

import re

_BREAKS = re.compile("\\s*[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]\\s*|\t")
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, which terminals obey; those that turn the direction of writing; surrogates,
which stand for bytes of names that are no text."""

_LONGEST = 1200
"""Most characters of a message, which may quote values of any length."""
_KEPT_OF_END = 500


def escaped(text: str) -> str:
    """Return text that a terminal only shows, with its lines."""
    return _UNPRINTABLE.sub("\ufffd", text)


def printable(text: str) -> str:
    """Return text in one line that can be written and shown anywhere."""
    return escaped(_BREAKS.sub(" ", text))


def told(text: str) -> str:
    """Return a message in one line of some length: of a longer one the middle is left out."""
    if len(text) > _LONGEST:
        end = len(text) - _KEPT_OF_END
        text = f"{text[: _LONGEST - _KEPT_OF_END]} ... {text[end:]}"
    return printable(text)
