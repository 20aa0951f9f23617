"""Texts of others: shown, and not obeyed."""

import io
import sys

import pytest

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, write_score
from sb3_piano.text import escaped, printable

HOSTILE = "a\x1b[31m\x07\x9b2J\u202egnp.<svg onload=x>"


def test_what_terminals_obey_is_taken_out():
    assert printable(HOSTILE) == "a\ufffd[31m\ufffd\ufffd2J\ufffdgnp.<svg onload=x>"
    assert printable("one\r\n two\u2028three\tfour\x1cfive") == "one two three four five"
    assert escaped("lines\nstay\tas they are\r") == "lines\nstay\tas they are\ufffd"
    assert printable("\udc80Etüde № 5, 練習") == "\ufffdEtüde № 5, 練習"


def test_titles_are_one_line_of_text():
    note = Note(pitch=60, onset=0, offset=1)
    assert Score(notes=[note], title=f"{HOSTILE}\nb").title == printable(f"{HOSTILE} b")


def test_messages_are_one_line_of_some_length():
    assert str(ConfigError("a\n b")) == "a b"
    text = str(ConfigError(f"x is '{'y' * 200_000}': expected less."))
    assert len(text) < 1300
    assert text.startswith("x is 'yyy")
    assert text.endswith("': expected less.")


@pytest.mark.parametrize("command", [["pieces", "show"], ["pieces", "rank"]])
def test_no_command_tells_a_terminal_what_a_title_says(tmp_path, monkeypatch, command):
    file = tmp_path / f"{HOSTILE}.mid"
    write_score(Score(notes=[Note(pitch=60, onset=0.1, offset=0.5)]), file)
    streams = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    assert main([*command, str(file)]) == 0
    assert main([*command, str(tmp_path / f"{HOSTILE}.txt")]) == 2
    shown, told = (stream.getvalue() for stream in streams)
    assert "[31m" in shown
    assert "[31m" in told
    for text in (shown, told):
        assert escaped(text) == text
    assert (sys.stdout, sys.stderr) == streams
