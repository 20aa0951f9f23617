"""The sight-reader on the command line, with the network of a run."""

import json
from pathlib import Path

import pytest
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.envs import GENERAL_ID
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.players import HandModel
from sb3_piano.training import OpenPlayer, RunConfig, RunFolder
from sb3_piano.training.playing.player_files import write_player
from sb3_piano.training.runs.builders import build_model, build_vec_env

READER = ["--player", "sight-reader"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    notes = [Note(onset=i / 4, offset=(i + 1) / 4, pitch=72 + i) for i in range(3)]
    write_midi(Score(notes=notes), "tune.mid")


@pytest.fixture
def shared():
    """Return the folder of a run that was shared: an untrained policy of PPO for hands."""
    config = RunConfig(env_id=GENERAL_ID, **Tables(__file__)["shared"])
    run = RunFolder.create(config, "run")
    build_model(config, build_vec_env(config)).save(run.model_file)
    return write_player(run.path, "shared").path


@pytest.mark.slow
def test_the_network_of_a_shared_run_plays_another_piece_by_every_command(shared, capsys):
    weights = [*READER, "--weights", str(shared)]
    play = ["play", "tune.mid", *weights, "--physics", "fast", "--no-video"]
    assert main(play) == 0
    assert "Read in 0." in capsys.readouterr().out
    assert (Path("play") / "tune-sight-reader-modelshared" / "performance.wav").is_file()
    file = shared / "hand.safetensors"
    for player in (f"sight-reader:model={shared}", str(file)):
        with OpenPlayer.open(player, score="tune.mid", physics="fast") as opened:
            found = opened.model.model.tensors
            assert found.keys() == HandModel.load(file).tensors.keys()
            assert opened.play()[0].metrics["length"] > 0
    command = ["evaluate", str(file), "--pieces", "tune.mid", "--physics", "fast", "--json"]
    assert main([*command, "a.json"]) == main([*command, "b.json"]) == 0
    assert main(["report", "tune.mid", "--player", str(file), "--physics", "fast"]) == 0
    assert main(["compare", "a.json", "b.json", "--metric", "f1", "--json", "c.json"]) == 0
    [pair] = json.loads(Path("c.json").read_text())["metrics"]["f1"]["pairs"]
    assert (pair["piece"], pair["difference"]) == ("tune", 0.0)
    record = ["record", "tune.mid", *READER, "--set", "physics=fast", "--episodes", "1"]
    assert main(record) == 0  # with the network that is shipped
    assert "robopianist/tune/sight-reader-v0" in capsys.readouterr().out
