"""Every command tells what is wrong in one line on stderr, and then has written nothing."""

import errno
import os
import sys

import pytest
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.cli.main import parser_of
from sb3_piano.music import Note, Score, write_midi

tables = Tables(__file__)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder with a piece, hyperparameters, and a folder that is no run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yml").write_text("default: {n_timesteps: 60}\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    write_midi(Score(notes=[Note(onset=0.0, offset=0.4, pitch=76)]), tmp_path / "tune.mid")
    return tmp_path


def contents(folder):
    return {path: path.is_file() and path.read_bytes() for path in sorted(folder.rglob("*"))}


@tables("command, message")
def test_an_error_is_one_line_and_leaves_nothing(command, message, folder, monkeypatch, capsys):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / "datasets"))
    for name, text in {"LONG": "x" * 252, "DIGITS": "1" * 5000, "PYTHON": sys.executable}.items():
        command = command.replace(name, text)
    before = contents(folder)
    assert main(command.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("sb3-piano: error: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert contents(folder) == before


@tables("command, message")
def test_a_number_that_is_none_is_refused(command, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(command.split())
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "There is not enough memory: MemoryError. What was finished before is"),
        (RuntimeError("can't allocate memory: you tried"), "not enough memory: can't allocate"),
        (OSError(errno.ENOSPC, "No space", "a"), "A file cannot be written: No space ('a')."),
    ],
)
def test_what_the_machine_lacks_is_one_line(error, message, monkeypatch, capsys):
    def lacking(arguments):
        raise error

    monkeypatch.setattr(sys.modules["sb3_piano.cli.main"], "_envs", lacking)
    assert main(["envs"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may be somebody else")
def test_a_folder_that_may_not_be_read_is_called_so(folder, capsys):
    (folder / "locked").mkdir(mode=0)
    for above in (folder, *folder.parents[:3]):
        above.chmod(0o755)
    os.seteuid(65534)
    try:
        assert main(["evaluate", "locked/run"]) == 2
    finally:
        os.seteuid(0)
    (line,) = capsys.readouterr().err.splitlines()
    assert "Permission denied ('locked/run'): expected a file or folder that may be read" in line


def test_a_command_without_standard_output_ends_well(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)  # as after >&-
    assert main(["envs"]) == 0


def test_a_file_of_a_run_is_not_taken_for_a_piece(folder, capsys):
    for name in ("config.yml", "model.zip"):
        (folder / "full" / name).touch()
    assert main(["play", "full/model.zip"]) == 2
    told = "'full/model.zip' is a file of a run: expected its folder, 'full'."
    assert told in capsys.readouterr().err


@tables("command, note, error")
def test_former_names_of_options_are_taken_with_a_note(command, note, error, folder, capsys):
    assert main(command.split()) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first == f"sb3-piano: warning: {note}."
    assert error in second


def test_an_option_of_several_values_may_also_be_repeated():
    parse = parser_of(["results"]).parse_args
    measure = ["results", "measure", "--pieces", "a", "b", "--pieces", "c"]
    assert parse(measure).pieces == ["a", "b", "c"]
    assert parse(measure).players == ["sight-reader", "planned"]
    assert parse([*measure, "--player", "planned", "--player", "x"]).players == ["planned", "x"]
