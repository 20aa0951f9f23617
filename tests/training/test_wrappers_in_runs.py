"""Wrappers named in YAML: in trainings, resumed ones, evaluations, and stock RL Zoo."""

from __future__ import annotations

import copy
import dataclasses
from typing import ClassVar

import numpy as np
import own_terms
import pytest
import yaml
from acting import VEC_ENVS, act_at, scalars
from fresh_python import run_python
from html_page import Page
from short_scores import score_of
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.save_util import load_from_pkl
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.callbacks.relabelling import Stage
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.take import Take
from sb3_piano.training import (
    OpenPlayer,
    RunConfig,
    RunFolder,
    evaluate,
    play_run,
    resume,
    train,
    write_report,
)
from sb3_piano.training.runs.builders import build_vec_env

tables = Tables(__file__)

ENV_ID = "RoboPianist-v0"
ROOM = "sb3_piano.wrappers"

# C5, then E5, 0.2 s each. With the silence at its end, 9 control steps; in the stack 13.
PIECE = score_of((0.0, 0.2, 72, 0), (0.2, 0.4, 76, 2), title="two notes")
STEPS, STACKED_STEPS = 9, 13
PITCHES, STACKED_PITCHES = [72, 76], [75, 79]

STACK = tables["stack"]
SAVED = [entry if isinstance(entry, dict) else {entry: {}} for entry in STACK]

# A goal of 11 rows for 25 keys and the pedal, the fingers, the keys' state, and all the rest.
STACKED_SIZE = 11 * 26 + 10 + 25 + 1 + 46


@pytest.fixture
def score_file(tmp_path):
    path = tmp_path / "two_notes.mid"
    write_midi(PIECE, path)
    return path


@pytest.fixture
def piano_config(small_config, score_file):
    """Return a function that makes a config of a tiny TD3, which never learns, with the stack."""

    def make(**changes):
        settings = {
            "env_id": ENV_ID,
            "env_kwargs": {"score": str(score_file), "physics": "fast"},
            "env_wrapper": copy.deepcopy(STACK),
            "n_timesteps": 12,
            "algorithm_kwargs": {"learning_starts": 1000},
        }
        return small_config(**{**settings, **changes})

    return make


def assert_has_the_stack(venv):
    """Compare the wrappers in a vector of one, and the arguments they were made with."""
    specs = venv.envs[0].spec.additional_wrappers
    ours = [spec for spec in specs if spec.entry_point.startswith(f"{ROOM}.")]
    for spec, entry in zip(ours, SAVED, strict=True):
        [(path, given)] = entry.items()
        assert f"{ROOM}.{spec.name}" == path
        assert {name: spec.kwargs[name] for name in given} == given


def pitches(score):
    return [note.pitch for note in score.notes]


# From YAML into a run, and out of its folder again.


def write_yaml(path, **changes):
    entry = {**tables["entry"], "env_wrapper": copy.deepcopy(STACK)}
    path.write_text(yaml.safe_dump({ENV_ID: {**entry, **changes}}))
    return path


def train_by_command(tmp_path, score_file, **changes):
    file = write_yaml(tmp_path / "stack.yml", **changes)
    command = ["train", "--algo", "td3", "--config", str(file), "--midi", str(score_file)]
    return main([*command, "--seed", "1", "--no-progress", "--out", str(tmp_path / "run")])


@pytest.mark.slow
def test_a_stack_in_yaml_is_trained_with_saved_and_put_back(tmp_path, score_file, capsys):
    assert train_by_command(tmp_path, score_file) == 0
    run = RunFolder.open(tmp_path / "run")
    assert yaml.safe_load(run.config_file.read_text())["env_wrapper"] == SAVED
    with OpenPlayer.open(run.path) as player:
        assert_has_the_stack(player.model.get_env())
        assert player.model.observation_space.shape == (STACKED_SIZE,)
        assert player.piece == "two_notes"
        for recording in (*player.play(2), player.rest()):
            assert len(recording.performance) == STACKED_STEPS
            due = recording.performance.roll.active.any(axis=0)
            assert (np.flatnonzero(due) + 21).tolist() == STACKED_PITCHES
    assert main(["evaluate", str(run.path)]) == 0
    assert "two_notes" in capsys.readouterr().out
    assert play_run(run.path, picture=None).wav.is_file()


def test_a_given_piece_is_played_unshifted_but_observed_by_the_runs_wrappers(
    piano_config, tmp_path
):
    run = train(piano_config(), tmp_path / "run", progress_bar=False).folder
    assert [e["length"] for e in evaluate(run.path).episodes] == [STACKED_STEPS]
    assert [e["length"] for e in evaluate(run.path, score=PIECE).episodes] == [STEPS]
    with OpenPlayer.open(run.path, score=PIECE) as player:
        (recording,) = player.play()
        assert pitches(player.env.score) == PITCHES
        assert recording.performance.title == player.piece == "two notes"
        assert_has_the_stack(player.model.get_env())
    low = Score(notes=[Note(onset=0.0, offset=0.2, pitch=40)], title="low")
    with pytest.raises(RunError, match="cannot play 'low': .*40"):
        OpenPlayer.open(run.path, score=low)


@pytest.mark.slow
def test_random_pieces_follow_the_seed_also_in_an_evaluation(piano_config, tmp_path):
    pieces = ["CMajorScaleOneHand", "DMajorScaleOneHand", "TwinkleTwinkleLittleStar"]
    chosen = {f"{ROOM}.RandomPiece": {"pieces": pieces}}
    shortened = {f"{ROOM}.Excerpt": {"start": 0.0, "length": 0.2, "unit": "seconds"}}
    config = piano_config(env_wrapper=[shortened, chosen])
    run = train(config, tmp_path / "run", progress_bar=False).folder
    titles = []
    with OpenPlayer.open(run.path) as player:
        assert player.piece == " or ".join(pieces)
        for seed in (5, 5, 6):
            recordings = [recording.performance.title for recording in player.play(6, seed=seed)]
            titles.append(recordings)
    assert titles[0] == titles[1] != titles[2]
    assert set(titles[0] + titles[2]) == set(pieces)
    with OpenPlayer.open(run.path, score=PIECE) as player:  # whatever wrappers choose
        for recording in (*player.play(2), player.rest()):
            assert recording.performance.title == player.piece == "two notes"
    evaluation = evaluate(run.path, episodes=6, seed=5, motion=True)
    assert [Take.read(path).title for path in evaluation.motions] == titles[0]
    assert f"<h1>{titles[0][0]}</h1>" in write_report(run.path, seed=5).read_text(encoding="utf-8")


# Stock RL Zoo.


@pytest.mark.slow
def test_the_stock_zoo_trains_with_the_stack_on_the_same_transitions(tmp_path, score_file):
    env_kwargs = {"score": str(score_file), "physics": "fast"}
    file = write_yaml(tmp_path / "zoo.yml", env_kwargs=env_kwargs)
    command = ["-m", "rl_zoo3.train", "--algo", "td3", "--env", ENV_ID]
    command += ["--gym-packages", "sb3_piano", "--conf-file", str(file), "--seed", "1"]
    command += ["--log-folder", str(tmp_path / "zoo"), "--eval-freq", "-1", "--save-replay-buffer"]
    done = run_python(command, tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = load_from_pkl(tmp_path / "zoo" / "td3" / f"{ENV_ID}_1" / "replay_buffer.pkl")
    assert train_by_command(tmp_path, score_file) == 0
    folder = RunFolder.open(tmp_path / "run").checkpoint_dir
    ours = {"observations": [], "actions": [], "rewards": []}
    for segment in Checkpoint.read(folder).replay.segments:
        with np.load(folder / segment.file) as rows:
            for name, found in ours.items():
                found.append(rows[name])
    for name, found in ours.items():
        np.testing.assert_array_equal(np.concatenate(found), getattr(theirs, name)[:40])
    assert theirs.observations.shape == (100, 1, STACKED_SIZE)


# Schedules go on in a resumed training.

DECAY = {f"{ROOM}.FingeringDecay": {"n_steps": 10, "start": 1}}


class FingeringWeights(BaseCallback):
    """Note down the weights of each step; named in configs by its import path."""

    noted: ClassVar = []

    def _on_step(self):
        weights = [w["fingering"] for w in self.training_env.get_attr("reward_weights")]
        self.noted.append(pytest.approx(weights))
        return True


HANDS = {
    "env_kwargs": {"score": "hanon-01", "physics": "fast", "observation": "hands"},
    "env_wrapper": [DECAY, f"{ROOM}.HandActions", f"{ROOM}.HandReward"],
    "vec_env_wrapper": "sb3_piano.vec_env.HandsAsAgents",
}


@pytest.mark.slow
@pytest.mark.parametrize("vec_env", [*VEC_ENVS, "hands"])
def test_a_decay_goes_on_where_the_training_was_interrupted(piano_config, vec_env, tmp_path):
    """Where hands are agents, by their control steps, of three each time."""
    n_envs = 1 if vec_env in ("subproc", "hands") else 2  # processes take long to start
    agents = 2 if vec_env == "hands" else n_envs
    config = piano_config(
        n_envs=n_envs,
        callback=[f"{__name__}.FingeringWeights", act_at(6, "stop")],
        **(HANDS if vec_env == "hands" else {"env_wrapper": [DECAY]}),
    )
    FingeringWeights.noted.clear()
    first = train(config, tmp_path / "run", progress_bar=False)
    assert (first.num_timesteps, len(FingeringWeights.noted)) == (6, 6 // agents)
    if vec_env != "hands":
        first.folder.write_config(dataclasses.replace(config, vec_env=vec_env))
    assert resume(first.folder.path, progress_bar=False).num_timesteps == 12
    expected = np.clip(1 - np.arange(12 // agents) / 10, 0, 1)
    assert [[weight] * agents for weight in expected] == FingeringWeights.noted


@pytest.mark.slow
def test_relabelled_episodes_go_by_the_steps_of_a_resumed_training(
    piano_config, tmp_path, monkeypatch
):
    begun, relabelled = [], Stage.relabelled

    def spied(stage, episode):
        begun.append(episode.steps_before)
        return relabelled(stage, episode)

    monkeypatch.setattr(Stage, "relabelled", spied)
    callback = "sb3_piano.callbacks.HindsightCallback"
    config = piano_config(env_wrapper=[], callback=callback, n_timesteps=2 * STEPS)
    run = train(config, tmp_path / "run", progress_bar=False).folder
    resume(run.path, 4 * STEPS, progress_bar=False)
    assert begun == [0, STEPS, 2 * STEPS, 3 * STEPS]


# Reward terms from outside.


TERMS = {"smooth": "own_terms.smooth", "still": "own_terms.still"}


@pytest.fixture
def entry(small_config, midi_file):
    """Return an entry of a YAML file: one episode, of which the monitor notes a term."""
    config = small_config(env_id=ENV_ID, n_timesteps=30).to_mapping()
    kept = {name: config[name] for name in ("n_timesteps", "policy")} | config["algorithm_kwargs"]
    options = {"score": str(midi_file), "physics": "fast", "reward_terms": TERMS}
    options["reward_weights"] = {"smooth": "1e-3"}
    monitor = {"info_keywords": ["return_smooth"]}
    return {**kept, "env_kwargs": options, "monitor_kwargs": monitor}


@pytest.mark.slow
def test_a_run_from_yaml_logs_evaluates_and_reports_them(entry, tmp_path, capsys, episodes_of):
    file, folder = tmp_path / "own.yml", tmp_path / "run"
    file.write_text(yaml.safe_dump({ENV_ID: entry}))
    command = ["train", "--algo", "td3", "--env", ENV_ID, "--config", str(file), "--no-progress"]
    assert main([*command, "--out", str(folder)]) == 0
    run = RunFolder.open(folder)
    assert run.read_config().env_kwargs["reward_terms"] == TERMS
    (episode,) = episodes_of(run.monitor_dir)
    (logged,) = scalars(run, "reward/smooth").values()
    assert episode["return_smooth"] == pytest.approx(logged)
    assert logged < 0
    mean = evaluate(folder).mean
    assert mean["return_smooth"] <= 0 <= mean["return_still"]
    capsys.readouterr()
    assert main(["evaluate", str(folder), "--metrics", "f1", "return_smooth"]) == 0
    shown = capsys.readouterr().out
    assert "smooth" in shown
    assert "still" not in shown
    text = Page(write_report(folder).read_text(encoding="utf-8")).text
    assert "Smooth" in text
    assert "Hands that rest" in text


def test_functions_of_modules_become_their_paths_and_others_are_refused(entry):
    options = {**entry["env_kwargs"], "reward_terms": {"smooth": own_terms.smooth}}
    config = RunConfig(algo="td3", env_id=ENV_ID, n_timesteps=30, env_kwargs=options, n_envs=2)
    assert config.env_kwargs["reward_terms"] == {"smooth": "own_terms.smooth"}
    venv = build_vec_env(config)
    assert venv.env_method("reward_terms", 0)
    venv.close()
    for terms, message in (
        ({"smooth": "own_terms.smoth"}, "Reward term 'smooth': .*mean 'smooth'"),
        ({"smooth": lambda step: 0.0}, "Reward term 'smooth': .*<lambda>' is no import path"),
        ({"still": own_terms.still}, "still is a Term, which a run's folder cannot hold"),
        ({"energy": "own_terms.smooth"}, "Reward term 'energy' is built in"),
    ):
        with pytest.raises(ConfigError, match=message):
            dataclasses.replace(config, env_kwargs={**options, "reward_terms": terms})
