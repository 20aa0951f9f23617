"""Several pieces in one training: one for each environment, or drawn for each episode."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
import yaml

from sb3_piano.callbacks import Checkpoint
from sb3_piano.callbacks.replay_segments import restore_replay_buffer
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, select_pieces, write_midi
from sb3_piano.training import RunConfig, RunFolder, SavedPlayer, evaluate_runs, resume, train
from sb3_piano.training.runs.builders import build_env, build_model, build_vec_env

PIANO = "RoboPianist-v0"
KEY_RANGE = "sb3_piano.wrappers.KeyRange"
CYCLING = "importlib.import_module('sb3_piano.buffers').CyclingReplayBuffer"


@pytest.fixture
def corpus(tmp_path):
    """A folder with files 60.mid, 62.mid and 64.mid, of one key and of other lengths."""
    folder = tmp_path / "corpus"
    folder.mkdir()
    for index, pitch in enumerate((60, 62, 64)):
        notes = [Note(onset=0.0, offset=0.4 + 0.1 * index, pitch=pitch, finger=0)]
        write_midi(Score(notes=notes), folder / f"{pitch}.mid")
    return folder


@pytest.fixture
def config(corpus):
    """Return a function that makes settings of a tiny SAC that plays the corpus."""

    def make(**changes):
        arguments = {
            "policy_kwargs": {"net_arch": [8]},
            "learning_starts": 20,
            "batch_size": 8,
            "buffer_size": 300,
            "device": "cpu",
            **changes.pop("algorithm_kwargs", {}),
        }
        settings = {
            "algo": "sac",
            "env_id": PIANO,
            "n_timesteps": 60,
            "seed": 1,
            "pieces": str(corpus / "*.mid"),
            "env_kwargs": {"physics": "fast", "n_steps_lookahead": 0},
            "algorithm_kwargs": arguments,
        }
        return RunConfig(**{**settings, **changes})

    return make


def played(config, episodes=12):
    """Return the titles that each environment of a run plays."""
    with contextlib.closing(build_vec_env(config)) as venv:
        titles = []
        for _ in range(episodes):
            venv.reset()
            titles.append([score.title for score in venv.get_attr("score")])
    return list(map(set, zip(*titles, strict=True)))


@pytest.mark.parametrize("vec_env", ["dummy", "threads"])
def test_each_environment_plays_the_piece_that_it_is_dealt(config, vec_env):
    assert played(config(n_envs=3, vec_env=vec_env), 2) == [{"60"}, {"62"}, {"64"}]


def test_with_fewer_environments_pieces_are_drawn_for_each_episode(config):
    assert played(config(n_envs=2)) == [{"60", "64"}, {"62"}]
    assert played(config()) == [{"60", "62", "64"}]


def test_with_more_environments_pieces_are_played_by_several(config):
    assert played(config(n_envs=5), 1) == [{"60"}, {"62"}, {"64"}, {"60"}, {"62"}]


def test_an_environment_of_its_own_draws_from_all_pieces(config):
    for own in (config(n_envs=3), config(n_envs=3).alone()):
        with contextlib.closing(build_env(own)) as env:
            titles = set()
            for seed in range(12):
                env.reset(seed=seed)
                titles.add(env.unwrapped.score.title)
        assert titles == {"60", "62", "64"}


def test_a_run_keeps_its_pieces_by_name_and_file(config, corpus):
    mapping = config(pieces=["scale-*Major", corpus / "60.mid"]).to_mapping()
    expected = [*select_pieces("scale-*Major"), str(corpus / "60.mid")]
    assert mapping["pieces"] == expected
    assert RunConfig(**yaml.safe_load(yaml.safe_dump(mapping))).pieces == tuple(expected)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_id": "RoboPianist-scale-CMajor-v0"}, "pieces are given to 'RoboPianist-scale-CMaj"),
        (
            {"env_kwargs": {"score": "FurElise"}},
            "the score 'FurElise': expected RoboPianist-v0",
        ),
        ({"env_kwargs": {"observation": "window"}}, "3 pieces are given with observation 'window'"),
        ({"pieces": ["nothing-*"]}, "No piece has a name like 'nothing-"),
        ({"pieces": 3}, "cannot be given as int"),
    ],
)
def test_pieces_that_cannot_be_played_are_refused(config, changes, message):
    with pytest.raises(ConfigError, match=message):
        config(**changes)


def test_observations_that_differ_by_piece_are_refused(config):
    with pytest.raises(ConfigError, match=r"With the piece '.*62.mid' the observation is"):
        build_vec_env(config(n_envs=2, env_wrapper={KEY_RANGE: {"keys": "piece"}}))


@pytest.mark.slow
def test_a_resumed_training_goes_on_with_the_buffers_of_all_pieces(config, tmp_path):
    own = config(n_envs=3, algorithm_kwargs={"replay_buffer_class": CYCLING, "gradient_steps": -1})
    run = train(own, tmp_path / "run", progress_bar=False).folder
    before = Checkpoint.read(run.checkpoint_dir)
    assert before.replay.n_envs == 3
    assert before.replay.total == 20
    result = resume(run.path, 120, progress_bar=False)
    assert result.num_timesteps == 120
    after = Checkpoint.read(run.checkpoint_dir)
    assert after.replay.total == 40
    with contextlib.closing(build_vec_env(own)) as venv:
        buffer = build_model(own, venv).replay_buffer
    restore_replay_buffer(buffer, run.checkpoint_dir, after.replay)
    assert buffer.size() == 40
    goals = [buffer.observations[np.arange(40), np.full(40, env)][:, :88] for env in range(3)]
    keys = [set(np.flatnonzero(goal.any(axis=0))) for goal in goals]
    assert keys == [{60 - 21}, {62 - 21}, {64 - 21}]


@pytest.mark.slow
def test_the_command_trains_on_pieces_and_evaluates_each(
    config, corpus, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    arguments = dict(config().algorithm_kwargs)
    settings = {"n_timesteps": 40, "env_kwargs": {"physics": "fast"}, "policy": "MlpPolicy"}
    (tmp_path / "small.yml").write_text(yaml.safe_dump({"default": {**settings, **arguments}}))
    named = ["--pieces", "corpus/6[02].mid", "scale-CMajor", "--n-envs", "3", "--run", "run"]
    base = ["train", "--algo", "sac", "--config", "small.yml", "--no-progress"]
    assert main([*base, *named]) == 0
    config_read = RunFolder.open("run").read_config()
    assert [piece.rpartition("/")[2] for piece in config_read.pieces] == [
        "60.mid",
        "62.mid",
        "scale-CMajor",
    ]
    with SavedPlayer.open("run") as player:
        assert player.piece == "3 pieces"
    found = evaluate_runs(["run"])
    assert [evaluation.piece for evaluation in found.evaluations] == ["60", "62", "scale-CMajor"]
    assert not found.failures
    capsys.readouterr()
    assert main([*base, "--pieces", "scale-CMajor", "--env", PIANO]) == 2
    assert "--env cannot be given with --pieces" in capsys.readouterr().err
    (corpus / "62.mid").unlink()
    failed = evaluate_runs(["run"])
    assert not failed.evaluations
    assert "62.mid" in failed.failures[0].reason
