"""Distillations of a few seconds: what is learnt from, what is learnt, going on after a kill."""

import csv
import dataclasses
import json
import os
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import yaml
from stable_baselines3 import TD3
from yaml_rows import Tables

from sb3_piano import exceptions
from sb3_piano.cli import main
from sb3_piano.demonstrations.dataset import Transitions, open_dataset
from sb3_piano.demonstrations.shards import find_shard
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError, RunError, ScoreError
from sb3_piano.hyperparams import SIGHT_READER
from sb3_piano.lab.distillation import DEFAULT_FILE, DistillConfig, distill
from sb3_piano.lab.distillation.config import TeacherSettings
from sb3_piano.lab.distillation.distill import _check_files
from sb3_piano.lab.distillation.rollout import hands_env, play_excerpt
from sb3_piano.lab.distillation.rounds import held_out_pieces
from sb3_piano.lab.distillation.shards import read_rows, shard_jobs
from sb3_piano.lab.distillation.teachers import new_teacher
from sb3_piano.lab.music import Corpus
from sb3_piano.music import load_score, write_midi
from sb3_piano.players import HandModel, SightReader
from sb3_piano.training import RunConfig, RunFolder, train

tables = Tables(__file__)
DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    file = tmp_path_factory.mktemp("settings") / "tiny.yml"
    return shutil.copy(DATA / "tiny_distillation.yml", file)


@pytest.fixture(scope="module")
def executor():
    """One thread of this process, where the pool of processes would take seconds to begin."""
    with ThreadPoolExecutor(1) as one:
        yield one


@pytest.fixture(scope="module")
def whole(tiny, executor, tmp_path_factory):
    """The result of a distillation that was not interrupted."""
    folder = tmp_path_factory.mktemp("distilled")
    return distill(DistillConfig.from_yaml(tiny), folder, executor=executor)


def shards_of(folder, config, number):
    learner = folder / f"round-{number - 1}.safetensors" if number else None
    return [find_shard(job) for job in shard_jobs(config, number, learner, folder / "data")]


def rows_of(folder, config):
    """Return observations and labels of all rounds, of whole shards only."""
    shards = [shard for number in (0, 1) for shard in shards_of(folder, config, number)]
    return [
        np.concatenate(a)
        for a in zip(*(read_rows(s.open(folder / "data")) for s in shards), strict=True)
    ]


def weights_of(folder):
    """Return the networks of both rounds; their files differ in the order of what they note."""
    return [HandModel.load(folder / f"round-{number}.safetensors") for number in (0, 1)]


def assert_same_weights(folder, other):
    for ours, theirs in zip(weights_of(folder), weights_of(other), strict=True):
        assert ours.facts == theirs.facts
        assert ours.tensors.keys() == theirs.tensors.keys()
        for name, tensor in ours.tensors.items():
            assert np.array_equal(tensor, theirs.tensors[name]), name


def test_the_file_that_comes_with_the_package_has_the_defaults():
    config = DistillConfig.from_yaml(DEFAULT_FILE)
    assert config == DistillConfig()
    again = DistillConfig.from_mapping(config.to_mapping())
    assert json.dumps(again.to_mapping()) == json.dumps(DistillConfig().to_mapping())
    assert sum(one.excerpts for one in config.rounds) == 500 <= len(config.corpus)


@tables("name, value, message")
def test_a_wrong_setting_is_named(tiny, name, value, message):
    with pytest.raises(ConfigError, match=message):
        DistillConfig.from_yaml(tiny, **{name: value})


@pytest.fixture
def songs(tmp_path, monkeypatch):
    """Work beside a folder ``songs`` with a piece ``a.mid``."""
    (tmp_path / "songs").mkdir()
    write_midi(load_score("TwinkleTwinkle").excerpt(0.0, 4.0), tmp_path / "songs" / "a.mid")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "songs"


@pytest.mark.parametrize("source", ["songs", "./songs", "songs/a.mid", "{place}/songs"])
def test_a_file_that_is_learnt_from_does_not_judge(tiny, songs, source):
    changes = {"corpus.sources": {source.format(place=songs.parent): 1}}
    for piece in ("songs/a.mid", "./songs/../songs/a.mid", f"{songs}/a.mid"):
        with pytest.raises(ConfigError, match=r"a\.mid', which the corpus learns from"):
            DistillConfig.from_yaml(tiny, **{**changes, "evaluation.pieces": [piece]})
    DistillConfig.from_yaml(tiny, **{**changes, "evaluation.pieces": ["songs/b.mid"]})


def test_paths_with_a_slash_are_made_absolute_on_windows_too(songs, monkeypatch):
    shutil.copy("songs/a.mid", "songs/b.mid")
    windows = SimpleNamespace(sep="\\", path=os.path)
    monkeypatch.setattr("sb3_piano.lab.distillation.config.os", windows)
    corpus = Corpus(sources={"songs": 1}, held_out=("songs/a.mid", "hanon-05"))
    found = DistillConfig(corpus=corpus).corpus
    assert found.held_out == (str(songs / "a.mid"), "hanon-05")
    assert found.names == {str(songs): (str(songs / "b.mid"),)}
    assert DistillConfig(corpus=found).corpus is found  # a folder of many files is read once


def test_settings_are_the_same_in_another_folder(tiny, songs, monkeypatch):
    for copy in ("judge.mid", "songs/b.mid"):
        shutil.copy("songs/a.mid", copy)
    (songs.parent / "teacher").mkdir()
    changes = {
        "corpus.sources": {"generated": 1, "songs": 1, "songs/b.mid": 1},
        "corpus.held_out": ["songs/a.mid", "hanon-05"],
        "evaluation.pieces": ["judge.mid", "TwinkleTwinkle"],
        "teacher.name": "teacher",
        "improvements": [{"n_timesteps": 1, "corpus": {"sources": {"songs": 2}}}],
    }
    config = DistillConfig.from_yaml(tiny, **changes)
    (songs / "elsewhere").mkdir()
    monkeypatch.chdir(songs / "elsewhere")
    again = DistillConfig.from_mapping(config.to_mapping())
    assert again.to_mapping() == config.to_mapping()
    assert again.corpus.names[str(songs)] == (str(songs / "b.mid"),)
    assert again.corpus_of(0).names == {str(songs): (str(songs / "b.mid"),)}
    assert again.teacher.name == str(songs.parent / "teacher")
    assert len(held_out_pieces(again)) == 3
    plain = DistillConfig.from_yaml(tiny, **{"evaluation.duration": None})  # whole pieces
    assert held_out_pieces(plain)[-1].duration == load_score("TwinkleTwinkle").duration > 10


def test_files_that_have_changed_are_told(tiny, songs):
    config = DistillConfig.from_yaml(tiny, **{"corpus.sources": {"songs": 1}})
    for _ in range(2):
        _check_files(songs, config)
    write_midi(load_score(songs / "a.mid").transpose(2), songs / "a.mid")
    with pytest.raises(RunError, match=r"has .*a.mid \w{64}, not \w{64}: expected"):
        _check_files(songs, config)


def test_what_comes_after_a_shard_does_not_change_it(tiny):
    def digest(number, **changes):
        config = DistillConfig.from_yaml(tiny, **changes)
        return shard_jobs(config, number, None, tiny.parent)[0].digest

    later = {"improvements": [{"n_timesteps": 1}], "evaluation.duration": 1.0}
    later |= {"network.net_arch": [8], "buffer": 9, "rounds.1.learner": 0.5}
    for name, value in later.items():
        assert digest(0, **{name: value}) == digest(0), name
    assert digest(1, **{"rounds.1.learner": 0.5}) != digest(1)
    own = {"corpus.seed": 1, "rounds.0.noise": 0.5, "playing.physics": "reference", "seed": 1}
    own |= {"teacher.plan": {"feedback": 0.5}, "shard": 3}
    for name, value in own.items():
        assert digest(0, **{name: value}) != digest(0), name
        assert digest(1, **{name: value}) != digest(1), name


@pytest.mark.slow
def test_a_label_is_what_the_teacher_would_do_in_the_state_that_the_played_actions_led_to(whole):
    config = DistillConfig.from_yaml(whole.folder / "config.yml")
    shard = shards_of(whole.folder, config, 1)[0]
    assert [notes["excerpt"] for notes in shard.episodes] == [3, 4]
    assert max(notes["by_learner"] for notes in shard.episodes) > 0.3
    data = Transitions.of(open_dataset(shard.name, whole.folder / "data"))
    env = hands_env("fast")
    observation, _ = env.reset(options={"score": config.corpus[3]})
    with new_teacher(config.teacher, config.playing, env) as teacher:
        for step in range(40):
            assert np.array_equal(observation, data.observations[step])
            label, _ = teacher.predict(observation, episode_start=np.array([step == 0]))
            assert np.array_equal(label, data.expert_actions[step])
            observation = env.step(data.actions[step])[0]
    assert np.abs(data.actions[:40] - data.expert_actions[:40]).max() > 0.05
    env.close()


@pytest.mark.slow
def test_the_network_comes_near_the_labels_and_is_judged_on_other_music(whole):
    config = DistillConfig.from_yaml(whole.folder / "config.yml")
    assert not whole.interrupted
    # Each round begins with new weights, but sees as the first one did.
    first, second = (model.tensors for model in weights_of(whole.folder))
    for name, tensor in first.items():
        assert np.array_equal(tensor, second[name]) == name.startswith("standardize."), name
    observations, labels = rows_of(whole.folder, config)
    assert len(labels) == 2 * whole.rounds[1].transitions
    learner = HandModel.load(whole.folder)  # hand.safetensors
    actions = np.stack([learner.act(seen) for seen in observations.reshape(len(labels) // 2, -1)])
    errors = [np.abs(guess - labels).mean() for guess in (0, actions.reshape(labels.shape))]
    assert errors[1] < 0.4 * errors[0]
    for result in whole.rounds:
        assert list(result.pieces)[-1] == "TwinkleTwinkle"
        assert len(result.pieces) == 2
        assert 0.1 < result.f1 <= 1
    with (whole.folder / "rounds.csv").open() as file:
        assert [float(row["f1"]) for row in csv.DictReader(file)] == [r.f1 for r in whole.rounds]


@pytest.mark.slow
def test_going_on_after_a_crash_makes_what_was_lost_again_and_nothing_else(
    whole, tiny, executor, tmp_path
):
    config, folder = DistillConfig.from_yaml(tiny), tmp_path / "run"

    def crash(text, done, total):
        if text.startswith("round-1: playing") and done == 1:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        distill(config, folder, executor=executor, on_progress=crash)
    data = folder / "data"
    assert shards_of(folder, config, 1)[0] is not None
    (data / ".recording-of-a-killed-process").mkdir()
    damaged = data / "round0-shard001-v0" / "data" / "main_data.hdf5"
    damaged.write_bytes(damaged.read_bytes()[:-4000])
    (folder / "round-0.json").unlink()  # killed after the training, before it was judged
    kept = [data / "round0-shard000-v0.json", folder / "round-0.safetensors"]
    times = [file.stat().st_mtime_ns for file in kept]
    assert shards_of(folder, config, 0)[1] is None
    result = distill(None, folder, executor=executor)
    assert [file.stat().st_mtime_ns for file in kept] == times
    assert not list(data.glob(".recording-*"))
    for ours, theirs in zip(rows_of(folder, config), rows_of(whole.folder, config), strict=True):
        assert np.array_equal(ours, theirs)
    assert_same_weights(folder, whole.folder)
    without_times = [dataclasses.replace(r, minutes=0) for r in whole.rounds]
    assert [dataclasses.replace(r, minutes=0) for r in result.rounds] == without_times


@pytest.mark.slow
def test_what_cannot_be_played_is_skipped_and_told(tiny, executor, tmp_path):
    file = tmp_path / "no music.mid"
    file.write_bytes(b"MThd nothing else")
    changes = {"corpus.sources": {"generated": 1, str(file): 1}, "corpus.duration": 1.0}
    changes |= {"rounds": [{"excerpts": 6, "epochs": 1}], "evaluation.excerpts": 0}
    config = DistillConfig.from_yaml(tiny, **changes)
    result = distill(config, tmp_path / "run", executor=executor)
    skipped = []
    for number in range(6):
        try:
            config.corpus[number]
        except ScoreError:
            skipped.append(number)
    assert 0 < len(skipped) < 6
    assert [int(n) for n in sorted(result.rounds[0].skipped)] == skipped
    assert all("no music.mid" in why for why in result.rounds[0].skipped.values())


@pytest.fixture(scope="module")
def begun(tiny, executor, tmp_path_factory):
    """The folder of a distillation that failed at its first step."""

    def fail(*facts):
        raise ZeroDivisionError

    folder = tmp_path_factory.mktemp("begun")
    with pytest.raises(ZeroDivisionError):
        distill(DistillConfig.from_yaml(tiny), folder, executor=executor, on_progress=fail)
    return folder


@tables("changes, error, message")
def test_what_does_not_go_together_is_refused_at_once(begun, tiny, changes, error, message):
    config = DistillConfig.from_yaml(tiny, **changes)
    with pytest.raises(getattr(exceptions, error), match=message):
        distill(config, begun)


def test_the_model_of_a_run_teaches_if_it_sees_what_the_learner_sees(tiny, tmp_path):
    run = RunConfig(algo="td3", env_id="Pendulum-v1", n_timesteps=1)
    other = train(run, tmp_path / "other", progress_bar=False).folder.path
    config = DistillConfig.from_yaml(tiny, **{"teacher.name": str(other)})
    with pytest.raises(ConfigError, match="cannot teach: expected a trained model with observ"):
        distill(config, tmp_path / "out")
    run = RunConfig(**tables["teacher"])
    model_file = train(run, tmp_path / "run", progress_bar=False).folder.model_file
    env = hands_env("fast")
    teacher = TeacherSettings(name=str(tmp_path / "run"))
    with new_teacher(teacher, config.playing, env) as opened:
        episode, _ = play_excerpt(config, 0, 0, env, opened, None)
    labels, _ = TD3.load(model_file).predict(episode.observations[:-1], deterministic=True)
    assert np.allclose(labels, episode.infos["expert_action"][:-1], atol=1e-6)
    assert np.abs(labels - episode.actions).max() > 0.01
    env.close()


@pytest.fixture(scope="module")
def few_steps(tmp_path_factory):
    """The settings of PPO that come with the package, for updates of two short episodes."""
    entry = yaml.safe_load(SIGHT_READER.read_text())[GENERAL_ID]
    entry |= {"n_envs": 2, "vec_env": "dummy", "n_steps": 20, "batch_size": 40}
    entry["policy_kwargs"] = entry["policy_kwargs"].replace("critic_first=24", "critic_first=1")
    file = tmp_path_factory.mktemp("settings") / "few steps.yml"
    file.write_text(yaml.safe_dump({GENERAL_ID: entry}))
    return file


@pytest.fixture(scope="module")
def improved(whole, few_steps, executor, tmp_path_factory):
    """What was told at an interrupted improvement and as it went on; and the result of that."""
    folder = tmp_path_factory.mktemp("improved") / "run"
    shutil.copytree(whole.folder, folder)
    settings = yaml.safe_load((folder / "config.yml").read_text())
    changes = {"n_timesteps": 80, "physics": "reference", "corpus": {"near": 0.5}}
    steps = ({"n_timesteps": 240}, changes)
    settings["improvements"] = [{**one, "config": str(few_steps)} for one in steps]
    (folder / "config.yml").write_text(yaml.safe_dump(settings))
    told = []

    def stop(text, done, total):
        told.append((text, done, total))
        if done >= 100 and text.startswith("improved-0: training"):
            signal.raise_signal(signal.SIGINT)

    before = distill(None, folder, executor=executor, on_progress=stop)
    assert before.interrupted
    assert before.weights.read_bytes() == (folder / "round-1.safetensors").read_bytes()
    interrupted, told = told, []
    after = distill(None, folder, executor=executor, on_progress=lambda *facts: told.append(facts))
    return interrupted, told, after


@pytest.mark.slow
def test_reinforcement_learning_goes_on_from_the_last_round_also_when_interrupted(improved):
    interrupted, told, result = improved
    steps = [done for text, done, _ in told if text.startswith("improved-0: training")]
    assert [done for _, done, _ in interrupted][-1] == 100
    assert not any("playing" in text for text, _, _ in told), "no round is done again"
    assert steps[0] == 104, "four hands go on"
    assert 240 <= steps[-1] < 320, "until the update is whole"
    assert [one.name for one in result.rounds] == ["round-0", "round-1", "improved-0", "improved-1"]
    before, after = (
        HandModel.load(result.folder / f"{one.name}.safetensors") for one in result.rounds[1:3]
    )
    changes = [np.abs(after.tensors[n] - tensor).max() for n, tensor in before.tensors.items()]
    assert 0 < max(changes) < 1e-3
    assert result.rounds[2].transitions == result.rounds[1].transitions + steps[-1] // 2
    with (result.folder / "rounds.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)][-1] == "improved-1"
    run, then = (RunFolder.open(result.folder / f"improved-{n}").read_config() for n in (0, 1))
    assert [one.env_kwargs["physics"] for one in (run, then)] == ["fast", "reference"]
    start = then.callback[0].kwargs["model"]
    assert start == str(result.folder / "improved-0.safetensors")
    corpus = DistillConfig.from_yaml(result.folder / "config.yml").corpus
    assert Corpus(**run.env_wrapper[0].kwargs["corpus"]) == corpus
    assert Corpus(**then.env_wrapper[0].kwargs["corpus"]) == dataclasses.replace(corpus, near=0.5)
    assert (run.seed, run.algorithm_kwargs["policy_kwargs"]["net_arch"]["pi"]) == (0, [32])


@pytest.mark.slow
def test_what_came_of_it_plays_as_it_was_judged(improved, executor):
    result = improved[2]
    score = load_score("TwinkleTwinkle").excerpt(0.0, 2.0)
    options = {"fingering": "robot", "reduced_action_space": False, "initial_buffer_time": 0.5}
    env = gym.make(GENERAL_ID, score="scale-CMajor", physics="fast", **options)
    observation, _ = env.reset(options={"score": score})
    player, over = SightReader(env, result.folder), False
    while not over:
        observation, _, _, over, info = env.step(player.predict(observation)[0])
    judged = result.rounds[-1].pieces["TwinkleTwinkle"]
    assert (info["f1"], info["onset_f1"]) == (judged["f1"], judged["onset_f1"])
    kept = result.folder / "improved-1.json"
    written = kept.stat().st_mtime_ns
    assert distill(None, result.folder, executor=executor).rounds == result.rounds
    assert kept.stat().st_mtime_ns == written


def test_settings_of_a_training_that_do_not_fit_are_refused_at_once(tiny, few_steps, tmp_path):
    entry = yaml.safe_load(few_steps.read_text())[GENERAL_ID]
    file = tmp_path / "one piece.yml"
    entry["env_wrapper"] = entry["env_wrapper"][1:]
    file.write_text(yaml.safe_dump({GENERAL_ID: entry}))
    for changes, message in (
        ({"config": str(file)}, r"one piece.yml', which has no CorpusExcerpt: expected"),
        (
            {"config": str(few_steps), "physics": "fats"},
            r"Unknown physics profile 'fats'.*'fast'",
        ),
    ):
        config = DistillConfig.from_yaml(tiny, improvements=[{"n_timesteps": 1, **changes}])
        with pytest.raises(ConfigError, match=message):
            distill(config, tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_the_command_goes_on_in_a_folder_and_tells_what_came_of_it(whole, capsys):
    folder = str(whole.folder)
    assert main(["distill", "--resume", folder, "--workers", "1"]) == 0
    told = capsys.readouterr().out
    assert f"round-1: F1 {whole.rounds[1].f1:.3f}" in told
    assert f"Weights:     {whole.folder / 'hand.safetensors'}" in told
