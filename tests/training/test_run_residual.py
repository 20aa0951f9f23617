"""Trainings that correct the model of another run."""

import contextlib
import copy
import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from stable_baselines3 import SAC
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.demonstrations import record
from sb3_piano.envs import GENERAL_ID
from sb3_piano.envs.actions import hand_action_unit
from sb3_piano.exceptions import ConfigError, InvalidActionError, RunError
from sb3_piano.hyperparams import FINE_TUNING
from sb3_piano.layers import layers
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.players import PlayerSpec
from sb3_piano.policies import hand_weights
from sb3_piano.training import (
    OpenPlayer,
    RunConfig,
    RunFolder,
    RunResidual,
    clone,
    evaluate,
    load_fine_tuning,
    train,
)
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.playing.player_files import write_player
from sb3_piano.training.playing.recording import player_to_record
from sb3_piano.wrappers import PitchShift

TUNE = Score(notes=[Note(onset=i / 5, offset=(i + 1) / 5, pitch=72 + i, finger=i) for i in (0, 1)])
CALLBACKS = yaml.safe_load(FINE_TUNING["sac"].read_text())["default"]["callback"][:1]
BRIEF = {
    "n_envs": 2,
    "vec_env": "dummy",
    "n_timesteps": 40,
    "learning_starts": 16,
    "buffer_size": 64,
    "batch_size": 8,
    "learning_rate": 0.01,
}

BRIEF_HANDS = {**BRIEF, "n_timesteps": 4, "learning_starts": 100, "callback": CALLBACKS}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return the folder of a run with wrappers, normalised observations and the piano's actions."""
    place = tmp_path_factory.mktemp("runs")
    write_midi(TUNE, place / "tune.mid")
    config = RunConfig(env_id=GENERAL_ID, **Tables(__file__)["made"])
    config = config.in_env(score=str(place / "tune.mid"))
    return train(config, place / "base", progress_bar=False).folder


@pytest.fixture
def base(made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made.path, "base")
    return RunFolder(Path("base"))


def correcting(algo="sac", player=Path("base"), **settings):
    entry = yaml.safe_load(FINE_TUNING[algo].read_text())["default"]
    policy = {**entry["policy_kwargs"], "critic_first": 0}
    brief = {**BRIEF, "policy_kwargs": policy, "callback": entry["callback"][:1], **settings}
    return load_fine_tuning(algo, player=player.absolute(), seed=0, **brief)


def test_an_action_of_0_plays_as_the_run_and_others_change_all_but_the_pedal(base):
    with (
        OpenPlayer.open(base.path, seed=0) as player,
        contextlib.closing(base.read_config().env.make()) as env,
    ):
        residual = RunResidual(env, "base")
        observation, _ = residual.reset(seed=0)
        for _ in range(5):
            action = player.predict(observation, deterministic=True)[0]
            inside = env.unwrapped.action_map.controls(action)[0]
            observation, *_ = residual.step(np.zeros(38))
            np.testing.assert_array_equal(env.unwrapped.data.ctrl, inside)
        action = player.predict(observation, deterministic=True)[0]
        inside = env.unwrapped.action_map.controls(action)[0]
        twin = copy.deepcopy(residual)
        seen, *_ = residual.step(np.full(38, -0.5))
        np.testing.assert_array_equal(twin.step(np.full(38, -0.5))[0], seen)
        assert twin.unwrapped is not residual.unwrapped
        assert twin._model is residual._model
        moved = inside - env.unwrapped.data.ctrl
        expected = 0.03 * hand_action_unit(env.unwrapped.scene)
        within = env.unwrapped.data.ctrl > env.unwrapped.scene.ctrl_low + 1e-6
        np.testing.assert_allclose(moved[within], expected[within], atol=1e-6)


def test_observations_are_standardised_as_the_runs_model_takes_them(base, tmp_path):
    def standardization(folder, config):
        env = config.env.make()
        return (*RunResidual(env, folder).standardization, env.observation_space.shape)

    config = base.read_config()
    mean, std, shape = standardization("base", config)
    assert mean.shape == std.shape == shape
    assert np.abs(mean).max() > 0.1
    plain = dataclasses.replace(config, n_timesteps=2, normalize={"norm_obs": False})
    folder = train(plain, tmp_path / "plain", progress_bar=False).folder
    mean, std, _ = standardization(folder.path, plain)
    assert not mean.any()
    assert (std == 1).all()


@pytest.mark.slow
def test_a_run_is_trained_on_and_its_folder_has_all_that_it_needs(base, capsys):
    config = correcting()
    assert [plugin.path.rpartition(".")[2] for plugin in config.env_wrapper] == [
        "PitchShift",
        "RunResidual",
        "HandReward",
    ]
    before = evaluate("base", physics="reference").mean
    Path("brief.yml").write_text(yaml.safe_dump({GENERAL_ID: {**BRIEF, "callback": []}}))
    command = ["train", "--from", "base", "--config", "brief.yml", "--steps", "4", "--out", "first"]
    assert main([*command, "--no-progress"]) == 0
    assert RunFolder.open("first").read_config().env.base == str(Path("first/base"))
    assert evaluate("first").mean["f1"] == before["f1"]
    run = train(config, "run", progress_bar=False).folder
    wanted = evaluate(run.path).mean
    shutil.rmtree("base")
    shutil.move("run", "moved")
    assert main(["export", "moved", "shared", "--no-video", "--episodes", "1"]) == 0
    assert not [*Path("shared").rglob("*.zip"), *Path("shared").rglob("*.pkl")]
    assert evaluate("moved").mean == wanted
    assert main(["train", "--resume", "moved", "--steps", "50", "--no-progress"]) == 0
    shutil.rmtree("moved")
    assert evaluate("shared").mean == wanted


@pytest.mark.slow
@pytest.mark.parametrize("agents", [False, True])
def test_of_a_run_that_sees_hands_each_hand_is_corrected_by_one_network(base, agents):
    config = dataclasses.replace(
        base.read_config(),
        env_kwargs={**base.read_config().env_kwargs, "observation": "hands"},
        env_wrapper=["sb3_piano.wrappers.HandActions", "sb3_piano.wrappers.HandReward"],
        vec_env_wrapper=["sb3_piano.vec_env.HandsAsAgents"] if agents else [],
    )
    first = train(config, "hands", progress_bar=False).folder
    correction = load_fine_tuning("sac", player="hands", seed=0, **BRIEF_HANDS)
    assert [plugin.path for plugin in correction.vec_env_wrapper] == [
        "sb3_piano.vec_env.HandsAsAgents"
    ]
    assert correction.env_kwargs == {**first.read_config().env_kwargs, "physics": "reference"}
    second = train(correction, "run", progress_bar=False).folder
    assert evaluate(second.path).mean == evaluate(first.path, physics="reference").mean
    assert evaluate(write_player(second.path, "shared").path).mean == evaluate(second.path).mean

    policy = SAC.load(second.model_file).policy
    with contextlib.closing(first.read_config().env.make()) as env:
        residual = RunResidual(env, "hands")
        mean, std = residual.standardization
        assert copy.deepcopy(residual)._venv is residual._venv
    seen = hand_weights(policy)
    if agents:
        np.testing.assert_allclose(seen["standardize.mean"], mean, rtol=1e-5)
    else:  # both hands' numbers as if they had been seen by one
        mean, std = mean.reshape(2, -1), std.reshape(2, -1)
        np.testing.assert_allclose(seen["standardize.mean"], mean.mean(axis=0), rtol=1e-5)
        spread = (std**2).mean(axis=0) + mean.var(axis=0)
        np.testing.assert_allclose(seen["standardize.scale"], 1 / np.sqrt(spread), rtol=1e-5)


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """Return a function that records a run, once without noise and once with."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))

    def start(folder):
        with player_to_record(PlayerSpec.parse(folder)) as (player, env):
            return record(player, env, "played-v0", episodes=2, noise=(0.0, 0.1))

    return start


@pytest.mark.slow
@pytest.mark.parametrize("by_hand", [False, True])
def test_what_a_correction_plays_is_recorded_without_it_and_can_be_cloned(
    base, recorded, by_hand, monkeypatch
):
    config = base.read_config()
    if by_hand:
        config = dataclasses.replace(
            config.in_env(observation="hands", physics="reference"),
            env_wrapper=(*config.env_wrapper, Plugin(path="sb3_piano.wrappers.HandActions")),
        )
    corrected = train(config, "corrected", progress_bar=False).folder
    correction = correcting(player=corrected.path, n_timesteps=80)
    assert len(correction.vec_env_wrapper) == by_hand
    run = train(correction, "run", progress_bar=False).folder
    wanted = evaluate(run.path).mean
    played = recorded(run.path)
    monkeypatch.chdir("datasets")
    assert played.episodes[0]["f1"] == wanted["f1"]
    assert played.episodes[0]["return"] == pytest.approx(wanted["return"])
    assert played.episodes[1]["return"] != pytest.approx(wanted["return"])

    clean, disturbed = played.dataset
    assert np.abs(disturbed.actions - disturbed.infos["expert_action"][:-1]).max() > 0.01
    [notes] = played.dataset.storage.get_episode_metadata([0])
    with contextlib.closing(played.dataset.recover_environment()) as env:
        assert not [layer for layer in layers(env) if isinstance(layer, RunResidual)]
        env.reset(seed=notes["seed"])
        rewards = [env.step(action)[1] for action in clean.actions]
    assert sum(rewards) == pytest.approx(wanted["return"])
    again = clone(played.dataset, folder="clone", epochs=2, net_arch=(8,), seed=0).folder
    assert len(correcting(player=again.path).vec_env_wrapper) == by_hand


@pytest.mark.slow
def test_a_run_whose_hands_are_agents_is_recorded(base, recorded):
    acting = ["sb3_piano.wrappers.HandActions", "sb3_piano.wrappers.HandReward"]
    config = dataclasses.replace(
        base.read_config().in_env(observation="hands"),
        env_wrapper=(*base.read_config().env_wrapper, *(Plugin(path=path) for path in acting)),
        vec_env_wrapper=(Plugin(path="sb3_piano.vec_env.HandsAsAgents"),),
    )
    run = train(config, "hands", progress_bar=False).folder
    played = recorded(run.path)
    assert played.dataset.action_space.shape == (38,)
    assert played.episodes[0]["f1"] == evaluate(run.path).mean["f1"]


@pytest.mark.slow
def test_what_sees_or_acts_around_a_correction_is_not_recorded(base):
    config = correcting(n_timesteps=2, learning_starts=100)
    bounds = {"min_action": -1, "max_action": 1}
    rescaled = Plugin(path="gymnasium.wrappers.RescaleAction", kwargs=bounds)
    config = dataclasses.replace(config, env_wrapper=(*config.env_wrapper, rescaled))
    run = train(config, "run", progress_bar=False).folder
    with (
        pytest.raises(ConfigError, match="change the action_space around the RunResidual"),
        player_to_record(PlayerSpec.parse(run.path)),
    ):
        pass


def test_the_left_hand_is_corrected_in_the_mirror(base):
    with contextlib.closing(base.read_config().env.make()) as env:
        residual = RunResidual(env, "base")
        scene = env.unwrapped.scene
        names = [scene.model.actuator(i).name for i in range(scene.model.nu)]
        right, left = (names.index(f"{side}_shadow_hand/forearm_tx") for side in ("rh", "lh"))
        told = {}
        for amount in (0.0, 0.5, -0.5):
            residual.reset(seed=0)
            action = np.zeros(38)
            action[[right, left]] = amount
            residual.step(action)
            told[amount] = env.unwrapped.data.ctrl[[right, left]].copy()
        # One way or the other: what this run plays may be at an end of the control range.
        slopes = np.array([(told[amount] - told[0.0]) / amount for amount in (0.5, -0.5)])
        assert slopes.max(axis=0)[0] == pytest.approx(0.03, rel=1e-5)
        assert slopes.min(axis=0)[1] == pytest.approx(-0.03, rel=1e-5)


def test_what_cannot_be_corrected_is_refused(base, tmp_path):
    env = base.read_config().env.make()
    with pytest.raises(RunError, match="There is no folder"):
        RunResidual(env, tmp_path / "none")
    with pytest.raises(ConfigError, match="scale is 0: expected"):
        RunResidual(env, "base", 0)
    with pytest.raises(RunError, match="cannot be loaded"):
        RunResidual(base.read_config().in_env(observation="roll").env.make(), "base")
    residual = RunResidual(PitchShift(env.env, 2), "base")
    residual.reset(seed=0)
    with pytest.raises(InvalidActionError, match=r"expected \(38,\)"):
        residual.step(np.zeros(39))
