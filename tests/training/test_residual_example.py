"""The settings and the script of examples/residual."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest
import yaml

from sb3_piano.music import Note, Score, write_midi
from sb3_piano.training import load_config

FOLDER = Path(__file__).parents[2] / "examples" / "residual"
SETTINGS = FOLDER / "td3.yml"
PIECE = Score(notes=[Note(onset=0.0, offset=0.3, pitch=64)], title="one note")
PIECES = list(yaml.safe_load(SETTINGS.read_text(encoding="utf-8")))


def test_all_pieces_have_the_same_settings():
    assert len(PIECES) >= 2
    each = [load_config("td3", env_id, SETTINGS, seed=0).to_mapping() for env_id in PIECES]
    assert [one.pop("env_id") for one in each] == PIECES
    first = each[0]
    assert all(one == first for one in each)
    assert first["policy"] == "sb3_piano.policies.ResidualTD3Policy"
    assert first["n_timesteps"] <= 50_000


@pytest.mark.slow
def test_the_script_trains_and_its_agent_begins_with_the_plan_s_f1(tmp_path, monkeypatch, capsys):
    write_midi(PIECE, tmp_path / "piece.mid")
    settings = yaml.safe_load(SETTINGS.read_text(encoding="utf-8"))[PIECES[0]]
    # An evaluation comes after 1000 steps, which this run never reaches.
    settings["callback"] = [{"sb3_piano.callbacks.F1Callback": {"eval_freq": 50}}]
    options = {"score": str(tmp_path / "piece.mid"), "fingering": "ergonomic", "physics": "fast"}
    settings["env_kwargs"].update(options)
    (tmp_path / "td3.yml").write_text(yaml.safe_dump({"RoboPianist-v0": settings}))
    script = runpy.run_path(str(FOLDER / "run.py"))
    script["main"].__globals__["SETTINGS"] = tmp_path / "td3.yml"
    command = ["run.py", "--seeds", "0", "--steps", "100", "--runs", str(tmp_path / "runs")]
    monkeypatch.setattr(sys, "argv", command)
    assert script["main"]() == 0
    row = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].split("|")[1:-1]]
    assert row[:2] == ["RoboPianist-v0", "0"]
    plan, at_first, last, best = map(float, row[2:])
    assert plan == at_first > 0.7
    assert last == best == plan  # it has not learnt yet
