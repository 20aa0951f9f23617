"""The command that trains curricula."""

from pathlib import Path

import pytest
from acting import act_at
from tiny_curriculum import PENDULUM, write_curriculum
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.training import RunFolder

tables = Tables(__file__)

PIANO = {
    "piece": "hanon-01",
    "env_kwargs": {"physics": "fast", "observation": "fingers", "hands_in_scene": "right"},
    "env_wrapper": [{"sb3_piano.wrappers.Excerpt": {"length": 1}}],
    "callback": [],
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    write(PENDULUM)
    return tmp_path


def write(*stages, name="tiny.yml"):
    write_curriculum(Path(name), *stages)


@pytest.mark.slow
def test_stages_are_trained_shown_and_evaluated(folder, capsys):
    until = {"f1": 0, "eval_freq": 20}
    write({**PIANO, "until": until}, {**PIANO, "name": "again"})
    assert main(["curriculum", "tiny.yml", "--seed", "3", "--no-progress", "--evaluate"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("[1/2] 1_hanon-01\n[2/2] 2_again\n")
    rows = [line.replace("│", " ").split() for line in out.splitlines() if line.startswith("│")]
    assert rows[0][:3] == ["1_hanon-01", "condition", "20"]
    assert [len(value) for value in rows[0][3:]] == [5, 5]  # as in 0.123
    assert rows[1] == ["2_again", "budget", "60", "-", "-"]
    last = "runs/curricula/tiny/2_again"
    assert f"Evaluate: sb3-piano evaluate {last}\n" in out
    assert "model after 60 steps of training" in out
    assert RunFolder(folder / last).read_config().seed == 3
    assert (folder / last / "evaluation").is_dir()

    assert main(["curriculum", "tiny.yml", "--no-progress"]) == 0
    out = capsys.readouterr().out
    assert "[1/2]" not in out
    assert "All stages had ended: nothing was left to do." in out


@pytest.mark.slow
def test_an_interruption_says_how_to_go_on(capsys):
    write(PENDULUM, {**PENDULUM, "callback": act_at(30, "SIGINT"), "with_buffer": True}, PENDULUM)
    command = ["curriculum", "tiny.yml", "--out", "my runs", "--no-progress", "--seed", "1"]
    assert main([*command, "--checkpoint-every", "1000"]) == 130
    out = capsys.readouterr().out
    assert "Go on:    sb3-piano curriculum --resume 'my runs'" in out
    assert "Evaluate" not in out
    assert main(["curriculum", "--resume", "my runs", "--status"]) == 0
    rows = [line.replace("│", " ").split() for line in capsys.readouterr().out.splitlines()]
    assert ["1_Pendulum-v1", "budget", "60", "-", "-"] in rows
    assert ["2_Pendulum-v1", "-", "30", "-", "-"] in rows
    assert ["3_Pendulum-v1", "-", "-", "-", "-"] in rows
    first, second, third = (Path("my runs", f"{number}_Pendulum-v1") for number in (1, 2, 3))
    before = {file: file.read_bytes() for file in first.rglob("*") if file.is_file()}
    assert main(["curriculum", "--resume", "my runs", "--no-progress"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("[2/3] 2_Pendulum-v1\n[3/3] 3_Pendulum-v1\n")
    assert "sb3-piano evaluate 'my runs/3_Pendulum-v1'" in out
    assert {file: file.read_bytes() for file in first.rglob("*") if file.is_file()} == before
    assert Checkpoint.read(second / "checkpoint").replay.total == 60 + 60
    assert RunFolder(third).read_config().seed == 1


@tables("command, message")
def test_what_is_wrong_is_told_in_one_line(folder, capsys, command, message):
    write({**PENDULUM, "gama": 1}, name="wrong.yml")
    before = sorted(folder.rglob("*"))
    assert main(["curriculum", *command.split()]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("sb3-piano: error: ")
    assert message in line
    assert captured.out == ""
    assert sorted(folder.rglob("*")) == before
