"""Files that are cut off or changed, and what the error says that comes of it."""

import numpy as np


def variants_of(content, count, change=lambda part: bytes([part[0] ^ 0x41])):
    """Return contents that are cut off, and such that have a changed part, at many places."""
    places = np.linspace(0, len(content) - 1, count).astype(int)
    size = len(change(content))
    changed = [content[:at] + change(content[at:]) + content[at + size :] for at in places]
    return [content[:end] for end in places], changed


def told(kind, call):
    """Return what the error says that a call ends in, if it is one of a kind."""
    try:
        call()
    except kind as error:
        return str(error)
    return None
