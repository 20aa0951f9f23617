"""Meta messages of MIDI files that mido 1.3 does not read as the standard has them."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import mido  # type: ignore[import-untyped]
from mido.midifiles import meta  # type: ignore[import-untyped]


@functools.cache
def read_all_meta_messages() -> None:
    """Let mido read meta messages of all types, from now on and in the whole process.

    It loses the time before those that it does not know, such as names of programs
    (0x08), so that everything after them in the track comes too early; and it refuses a
    whole file for a key signature of a mode that does not exist, which some programs write.
    """
    meta.add_meta_spec(_KeySignature)
    for number in range(128):
        if number not in meta._META_SPECS:
            name = f"MetaSpec_unknown_{number:02x}"
            meta.add_meta_spec(type(name, (_Unknown,), {"type_byte": number}))


class _Unknown(meta.MetaSpec):
    """A meta message that nobody reads."""

    attributes = ("data",)
    defaults = ((),)

    def decode(self, message: mido.MetaMessage, data: Sequence[int]) -> None:
        message.data = tuple(data)

    def encode(self, message: mido.MetaMessage) -> list[int]:
        return list(message.data)


class _KeySignature(meta.MetaSpec_key_signature):
    """A key signature: C major, as without one, if its mode does not exist."""

    type = "key_signature"

    def decode(self, message: mido.MetaMessage, data: Sequence[int]) -> None:
        try:
            super().decode(message, data)
        except mido.KeySignatureError:
            message.key = "C"
