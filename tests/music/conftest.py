"""What the tests of music share."""

import pytest

from sb3_piano.music.library import DATA_VARIABLE


@pytest.fixture(autouse=True)
def data(tmp_path, monkeypatch):
    """A data folder of the test's own."""
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))
    return tmp_path / "data"
