"""What the tests of music share."""

import pytest

from sb3_piano.cli import main
from sb3_piano.music.library import Library
from sb3_piano.user_data import DATA_VARIABLE


@pytest.fixture(autouse=True)
def data(tmp_path, monkeypatch):
    """A data folder of the test's own."""
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def library():
    """The library in that folder."""
    return Library()


@pytest.fixture
def music(tmp_path):
    """A folder for files of music."""
    folder = tmp_path / "music"
    folder.mkdir()
    return folder


@pytest.fixture
def run(capsys):
    """Run `sb3-piano pieces` in this process; return its status and what it printed."""

    def run(*arguments):
        capsys.readouterr()
        status = main(["pieces", *map(str, arguments)])
        return status, *capsys.readouterr()

    return run
