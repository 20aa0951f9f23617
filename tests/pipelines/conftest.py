"""Curricula as files."""

from functools import partial

import pytest
from tiny_curriculum import write_curriculum


@pytest.fixture
def write(tmp_path):
    """A function that writes a curriculum of a tiny SAC, and returns the file."""
    return partial(write_curriculum, tmp_path / "tiny.yml")
