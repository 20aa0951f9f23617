"""Writing a file, with an error of ours."""

from __future__ import annotations

from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.files import write_bytes


def write_score_file(path: Path, content: bytes) -> None:
    """Write the bytes of a score, whole or not at all.

    Raises:
        ScoreError: If the file cannot be written.
    """
    try:
        write_bytes(path, content)
    except OSError as error:
        raise ScoreError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error
