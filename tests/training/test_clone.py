"""``sb3-piano record`` and ``clone``: from a run to a data set, and from that to another run."""

import sys
from pathlib import Path

import gymnasium as gym
import minari
import numpy as np
import pytest
import yaml
from stable_baselines3 import SAC, TD3
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.demonstrations import record
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.players import PlayerSpec
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.training import OpenPlayer, RunFolder, clone, evaluate, resume
from sb3_piano.training.playing.recording import player_to_record

tables = Tables(__file__)

PENDULUM = "robopianist/Pendulum-v1/td3-v0"
QUICK = {"epochs": 2, "net_arch": [8], "seed": 0}


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    """Give new folders for data sets and runs."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "datasets"


@pytest.fixture
def small_yaml(tmp_path):
    """Return a file of hyperparameters for a tiny model."""
    path = tmp_path / "small.yml"
    small = "learning_starts: 20, batch_size: 8, buffer_size: 400, device: cpu"
    path.write_text(f"default: {{n_timesteps: 40, policy: MlpPolicy, {small}}}")
    return path


@pytest.fixture
def recorded_pendulum(pendulum_run):
    """Record three performances of a tiny run, of 20 steps each."""
    folder = pendulum_run()
    assert main(["record", str(folder.path), "--episodes", "3", "--no-progress"]) == 0
    return minari.load_dataset(PENDULUM)


class Still:
    """Does nothing."""

    def __init__(self, env):
        self._action = np.zeros(env.action_space.shape, dtype=np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return self._action, state


def steady(piano_run, **options):
    """Return a run that always does one action, another one in each joint."""
    return piano_run(np.linspace(-0.5, 0.5, 39), physics="fast", **options)


def test_a_run_is_recorded_in_its_own_environment(piano_run, capsys):
    folder = steady(piano_run, n_steps_lookahead=2)
    arguments = ["--episodes", "2", "--noise", "0", "0.1", "--start", "0.02", "--no-progress"]
    assert main(["record", str(folder.path), *arguments]) == 0
    out = capsys.readouterr().out
    assert "Recorded 2 performances of 50 steps in all." in out
    assert "with noise of 0.1 rad (1)" in out
    [name] = minari.list_local_datasets()
    assert f"Data set:    {name}\n" in out
    dataset = minari.load_dataset(name)
    expected = np.linspace(-0.5, 0.5, 39, dtype=np.float32)
    for episode in dataset:
        labels = episode.infos["expert_action"][:-1]
        np.testing.assert_allclose(labels, np.broadcast_to(expected, labels.shape), atol=1e-5)
    assert np.abs(dataset[1].actions - expected).max() > 0.1
    clean = dataset.recover_environment(eval_env=True)
    assert clean.unwrapped.config.n_steps_lookahead == 2
    assert clean.unwrapped.default_score.title == "score"
    assert "PerturbedStart" in str(dataset.recover_environment())
    assert main(["record", str(folder.path), "--no-progress"]) == 2
    assert f"There is a data set '{name}' already" in capsys.readouterr().err
    assert main(["record", str(folder.path), "--overwrite", "--episodes", "1"]) == 0
    assert len(minari.load_dataset(name)) == 1


@pytest.mark.slow
def test_a_run_is_recorded_with_its_wrappers_and_normalisation(pendulum_run):
    wrapper = {"gymnasium.wrappers.RescaleAction": {"min_action": -1, "max_action": 1}}
    folder = pendulum_run(env_wrapper=wrapper, normalize=True, n_timesteps=60)
    assert main(["record", str(folder.path), "--out", "p-v0", "--seed", "3"]) == 0
    dataset = minari.load_dataset("p-v0")
    episode = dataset[0]
    assert dataset.action_space.high == 1
    again = dataset.recover_environment()
    [notes] = dataset.storage.get_episode_metadata([0])
    observations = [again.reset(seed=notes["seed"])[0]]
    observations += [again.step(action)[0] for action in episode.actions]
    np.testing.assert_array_equal(observations, episode.observations)
    with OpenPlayer.open(folder.path) as player:
        shown = player._env.normalize_obs(episode.observations[:-1])
        right = player.model.predict(shown, deterministic=True)[0]
        raw = player.model.predict(episode.observations[:-1], deterministic=True)[0]
    np.testing.assert_allclose(episode.actions, right, atol=1e-6)
    assert np.abs(raw - right).max() > 1e-3


def test_what_a_run_cannot_be_told_is_refused(pendulum_run, capsys):
    folder = str(pendulum_run().path)
    for option in (["--player", "planned"], ["--fingering", "keep"], ["--set", "physics=fast"]):
        assert main(["record", folder, *option]) == 2
        assert f"{option[0]} cannot be given with the run" in capsys.readouterr().err
    assert main(["record", folder, "--best", "f1"]) == 2
    assert "has no best model by 'f1'" in capsys.readouterr().err
    stack = {"stable_baselines3.common.vec_env.VecFrameStack": {"n_stack": 2}}
    stacked = pendulum_run("stacked", vec_env_wrapper=stack)
    with (
        pytest.raises(ConfigError, match="VecFrameStack around the vector"),
        player_to_record(PlayerSpec.parse(stacked.path)),
    ):
        pass


@pytest.mark.slow
@tables("how, by_thumb")
def test_a_planned_pianist_is_recorded_with_the_fingers_that_are_observed(
    tmp_path, how, by_thumb, monkeypatch, capsys
):
    """On a black key the robot's own choice is no thumb."""
    for name, finger in (("thumb", 0), ("index", 1)):
        labelled = Score(notes=[Note(onset=0.0, offset=0.3, pitch=78, finger=finger)])
        write_midi(labelled, tmp_path / f"{name}.mid")
    command = ["record", "thumb.mid", "--episodes", "2", "--set", "physics=fast", "--no-progress"]
    assert main([*command, *how]) == 0
    out = capsys.readouterr().out
    assert "Data set:    robopianist/thumb/planned-v0" in out
    assert "with noise of 0.03 rad (1)" in out  # unless told otherwise
    monkeypatch.chdir("/")  # a data set is used from anywhere
    dataset = minari.load_dataset("robopianist/thumb/planned-v0")
    recorded, disturbed = dataset
    np.testing.assert_array_equal(recorded.actions, recorded.infos["expert_action"][:-1])
    noise = disturbed.actions - disturbed.infos["expert_action"][:-1]
    assert 0 < np.abs(noise).mean() < 0.2
    env = dataset.recover_environment()
    config = env.unwrapped.config
    assert (config.observation, config.physics) == ("fingers", "fast")
    assert env.unwrapped.default_score.title == "thumb"
    observation, _ = env.reset(seed=0)
    assert (env.unwrapped.roll.finger[0, 78 - 21] == 0) == by_thumb
    np.testing.assert_array_equal(observation, recorded.observations[0])
    played = PlannedPianist(env).predict(observation)[0]
    np.testing.assert_allclose(recorded.actions[0], played, atol=1e-6)


@pytest.mark.slow
def test_a_clone_is_a_run_that_can_be_evaluated_and_trained_on(
    recorded_pendulum, small_yaml, capsys
):
    command = ["clone", PENDULUM, "--algo", "td3", "--config", str(small_yaml), "--epochs", "40"]
    command += ["--batch-size", "8", "--learning-rate", "3e-3"]
    assert main([*command, "--hidden", "16", "--seed", "5", "--no-progress", "--evaluate"]) == 0
    out = capsys.readouterr().out
    assert "Cloned 60 transitions, to a loss of" in out
    assert "sb3-piano train --resume runs/td3/Pendulum-v1_1" in out
    assert "1 episode, model after 0 steps of training" in out
    run = RunFolder.open("runs/td3/Pendulum-v1_1")
    config = run.read_config()
    assert config.env_kwargs == {"max_episode_steps": 20}
    assert config.algorithm_kwargs["policy_kwargs"] == {"net_arch": [16]}
    assert (config.seed, config.n_timesteps) == (5, 40)
    notes = yaml.safe_load(run.provenance_file.read_text())
    assert (notes["cloned"]["dataset"], notes["cloned"]["epochs"]) == (PENDULUM, 40)
    before = TD3.load(run.model_file).actor.state_dict()
    with OpenPlayer.open(run.path) as player:
        there = recorded_pendulum[0].observations[:-1]
        action, _ = player.model.predict(player._env.normalize_obs(there), deterministic=True)
    assert np.abs(action - recorded_pendulum[0].actions).mean() < 0.1

    assert main(["train", "--resume", str(run.path), "--steps", "10", "--no-progress"]) == 0
    assert "Trained for 10 steps." in capsys.readouterr().out
    after = TD3.load(run.model_file).actor.state_dict()
    assert all(bool((after[name] == value).all()) for name, value in before.items())
    assert Checkpoint.read(run.checkpoint_dir).num_timesteps == 10
    resume(run.path, 30, progress_bar=False)
    after = TD3.load(run.model_file).actor.state_dict()
    assert not all(bool((after[name] == value).all()) for name, value in before.items())
    assert evaluate(run.path).num_timesteps == 30


@pytest.mark.slow
def test_training_on_may_begin_with_the_data_set_and_survive_a_break(recorded_pendulum, small_yaml):
    run = clone(PENDULUM, "sac", config=small_yaml, prefill=True, **QUICK).folder
    config = run.read_config()
    assert config.algorithm_kwargs["learning_starts"] == 0
    # Checkpoints keep what came from the data set, once.
    for steps in (10, 25):
        assert resume(run.path, steps, progress_bar=False).num_timesteps == steps
        saved = Checkpoint.read(run.checkpoint_dir).replay
        assert saved.total == 60 + steps
    model = SAC.load(run.model_file)
    assert model._n_updates == 25
    with np.load(run.checkpoint_dir / saved.segments[0].file) as rows:
        assert saved.segments[0].first == 0
        np.testing.assert_array_equal(
            rows["observations"][:20, 0], recorded_pendulum[0].observations[:-1]
        )


@pytest.mark.slow
def test_a_clone_plays_in_the_environment_of_the_data_set():
    """With its options and wrappers, and none of the preset's."""
    env_id = "RoboPianist-debug-CMajorScaleOneHand-v0"
    env = gym.make(env_id, observation="fingers", control_timestep=0.1)
    env = gym.wrappers.RescaleAction(env, min_action=-0.5, max_action=0.5)
    record(Still(env), env, "still-v0")
    folder = clone("still-v0", "sac", "here", epochs=1, net_arch=[4]).folder
    config = folder.read_config()
    assert config.env_id == env_id
    assert config.env_kwargs == {"observation": "fingers", "control_timestep": 0.1}
    with OpenPlayer.open(folder.path) as player:
        assert player.env.config == env.unwrapped.config
        assert player.piece == "CMajorScaleOneHand"
        assert (player._env.action_space.high == 0.5).all()


def test_what_cannot_be_cloned_is_told(recorded_pendulum, small_yaml, midi_file, capsys):
    assert main(["clone", PENDULUM, "--algo", "ppo"]) == 2
    assert "cannot be cloned into algorithm 'ppo': expected one of sac" in capsys.readouterr().err
    assert main(["clone", "other-v0"]) == 2
    assert "no data set 'other-v0'" in capsys.readouterr().err
    clone(PENDULUM, "sac", "here", config=small_yaml, **QUICK)
    told = []
    with pytest.raises(RunError, match="holds a run already"):
        clone(PENDULUM, "sac", "here", config=small_yaml, **QUICK, on_epoch=told.append)
    assert told == []  # before any work
    assert evaluate("here").num_timesteps == 0

    def stop(loss):
        with pytest.raises(RunError, match="is no run, it has no config.yml"):
            RunFolder.open("there")  # what a killed process would leave
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        clone(PENDULUM, "sac", "there", config=small_yaml, **QUICK, on_epoch=stop)
    assert not Path("there").exists()
    env = PianoEnv(midi_file, physics="fast")
    record(Still(env), env, "still-v0")
    with pytest.raises(ConfigError, match="'still-v0' does not tell its environment"):
        clone("still-v0")


@tables("package, extra, command")
def test_what_is_to_be_installed_is_told(package, extra, command, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)
    assert main(command) == 2
    assert f"pip install '.[{extra}]'  # in a clone" in capsys.readouterr().err
