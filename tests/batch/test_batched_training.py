"""A run trains on a batch of worlds, and is then like any other run."""

import csv

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_piano.batch import DeviceReplayBuffer
from sb3_piano.buffers.rows import buffer_rows
from sb3_piano.callbacks import HindsightCallback
from sb3_piano.callbacks.difficulty_curriculum import DifficultyCallback
from sb3_piano.cli.main import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.training import RunConfig, RunFolder, load_config, resume, train
from sb3_piano.training.runs.builders import build_vec_env

PENDULUM = "Pendulum-v1"
SELF_ACTUATED = "RoboPianist-selfactuated-v0"


@pytest.fixture(scope="module")
def piece(tmp_path_factory):
    """Return the file of a piece of five control steps."""
    path = tmp_path_factory.mktemp("piece") / "two.mid"
    notes = [Note(onset=0.1 * i, offset=0.1 * i + 0.1, pitch=60 + i, finger=i) for i in (0, 1)]
    write_midi(Score(notes=notes), path)
    return str(path)


def config(piece, **changes):
    """Return settings for three worlds of the piano that plays itself."""
    algorithm = {"learning_starts": 3, "buffer_size": 60, "batch_size": 6, "device": "cpu"}
    algorithm["policy_kwargs"] = {"net_arch": [8]}
    settings = {"n_timesteps": 30, "seed": 0, "monitor_kwargs": {"info_keywords": ["f1"]}}
    settings |= {"env_kwargs": {"score": piece, "physics": "fast"}, "algorithm_kwargs": algorithm}
    settings |= {"algo": "sac", "env_id": SELF_ACTUATED, **changes}
    return RunConfig(**settings).batched(3)


def rows(run):
    """Return the episodes in a run's only log."""
    (log,) = run.path.glob("monitor/*.csv")
    return list(csv.DictReader(log.read_text().splitlines()[1:]))


def test_a_run_on_a_batch_is_resumed_and_played_like_any_other(piece, tmp_path, capsys):
    run = train(config(piece), tmp_path / "run", progress_bar=False).folder
    assert RunFolder.open(run.path).read_config().vec_env == "batch"
    assert [(row["l"], float(row["f1"]) >= 0) for row in rows(run)] == [("5", True)] * 6
    result = resume(run.path, 45, progress_bar=False)
    assert (result.started_at, result.num_timesteps) == (30, 45)
    assert len(rows(run)) == 9
    assert main(["evaluate", str(run.path)]) == 0
    assert "F1" in capsys.readouterr().out


def test_equal_seeds_train_equal_models(piece, tmp_path):
    runs = [train(config(piece), tmp_path / name, progress_bar=False) for name in "ab"]
    one, other = ([row["r"] for row in rows(run.folder)] for run in runs)
    assert one == other


def test_each_of_several_pieces_is_played(piece):
    several = {"env_kwargs": {"physics": "fast", "hands_in_scene": "none"}}
    several |= {"env_id": "RoboPianist-v0", "pieces": [piece, "CMajorChordProgressionTwoHands"]}
    venv = build_vec_env(config(piece, **several))
    assert len(venv.batch.pieces.goals) == 2
    venv.reset()
    drawn = {int(venv.batch.reset() is not None and p) for _ in range(9) for p in venv.batch.piece}
    assert drawn == {0, 1}


def test_replay_buffers_lie_on_the_device_unless_another_kind_is_named(piece):
    named = "replay_buffer_class"
    assert config(piece).algorithm_kwargs[named].endswith("DeviceReplayBuffer")
    preset = load_config("sac", SELF_ACTUATED).batched(2)
    assert preset.algorithm_kwargs[named].endswith("DeviceReplayBuffer")
    cycling = {named: "sb3_piano.buffers.CyclingReplayBuffer"}
    assert "Cycling" in config(piece, algorithm_kwargs=cycling).algorithm_kwargs[named]
    assert named not in load_config("ppo", SELF_ACTUATED).batched(2).algorithm_kwargs
    assert load_config("ppo", SELF_ACTUATED).batched(2, "cuda").vec_env == "warp"


@pytest.mark.parametrize("algo", ["sac", "td3", "ppo"])
def test_presets_for_batches_train_both_hands(algo, piece, tmp_path):
    own = load_config(algo, "RoboPianist-v0", "batched", n_timesteps=32, n_envs=2, callback=[])
    small = {"net_arch": {"pi": [8], "qf": [8], "vf": [8]}}
    network = {**own.algorithm_kwargs["policy_kwargs"], **small}
    arguments = {**own.algorithm_kwargs, "batch_size": 8, "policy_kwargs": network}
    arguments |= {"n_steps": 4} if algo == "ppo" else {"learning_starts": 4, "buffer_size": 80}
    made = own.in_env(score=piece, physics="fast")
    made = RunConfig(**{**made.to_mapping(), "algorithm_kwargs": arguments})
    result = train(made, tmp_path / algo, progress_bar=False)
    assert result.num_timesteps == 32
    assert len(rows(result.folder)) == 2


def test_what_has_no_batch_is_told_in_one_line(piece, tmp_path):
    with pytest.raises(ConfigError, match="A batch cannot wrap a PendulumEnv"):
        build_vec_env(config(piece, env_id=PENDULUM, env_kwargs={}, monitor_kwargs={}))
    hide = {"env_wrapper": ["sb3_piano.wrappers.PreviousActionReward"]}
    with pytest.raises(ConfigError, match="PreviousActionReward is no wrapper that can be batched"):
        build_vec_env(config(piece, **hide))
    for callback in (HindsightCallback(), DifficultyCallback()):
        with pytest.raises(ConfigError):
            train(config(piece), tmp_path / "run", callbacks=[callback], progress_bar=False)


def test_the_command_takes_the_preset_for_batches(capsys):
    arguments = ["train", "--env", SELF_ACTUATED, "--batched", "2"]
    assert main([*arguments, "--n-envs", "2"]) == 2
    assert "--n-envs cannot be given with --batched" in capsys.readouterr().err
    assert main([*arguments, "--device", "cuda"]) == 2
    assert "expected" in capsys.readouterr().err


# The replay buffer on the device gives what SB3's own gives.


SPACES = (spaces.Box(-8, 8, (3,)), spaces.Box(-2, 2, (1,)))  # those of a pendulum


def filled(made, steps=7, n_envs=3):
    """Return a buffer of four rows, which has gone round."""
    rng = np.random.default_rng(0)
    buffer = made(4 * n_envs, *SPACES, device="cpu", n_envs=n_envs)
    for _ in range(steps):
        one, other = rng.normal(size=(2, n_envs, 3)).astype(np.float32)
        action, reward = rng.uniform(-1, 1, (n_envs, 1)), rng.normal(size=n_envs)
        done = rng.random(n_envs) < 0.5
        infos = [{"TimeLimit.truncated": bool(rng.random() < 0.5)} for _ in done]
        buffer.add(one, other, action, reward, done, infos)
    return buffer


def transitions(buffer, env=None):
    """Return all that the buffer gives, as a set of tuples of numbers."""
    samples = buffer.sample(400, env)[:5]
    rows = np.concatenate([part.numpy().reshape(400, -1) for part in samples], axis=1)
    return {tuple(row) for row in np.round(rows, 4).tolist()}


def test_samples_are_those_of_the_usual_buffer():
    ours, theirs = filled(DeviceReplayBuffer), filled(ReplayBuffer)
    assert transitions(ours) == transitions(theirs)
    assert len(transitions(ours)) == 12


def test_samples_are_normalised_as_usual():
    venv = VecNormalize(DummyVecEnv([lambda: gym.make("Pendulum-v1")] * 3))
    venv.reset()
    for _ in range(5):
        venv.step(np.ones((3, 1)))
    ours, theirs = (transitions(filled(made), venv) for made in (DeviceReplayBuffer, ReplayBuffer))
    assert len(ours) == len(theirs) == 12
    np.testing.assert_allclose(sorted(ours), sorted(theirs), atol=2e-4)
    assert ours != transitions(filled(DeviceReplayBuffer))


def test_rows_are_saved_and_put_back():
    old = filled(DeviceReplayBuffer)
    new = DeviceReplayBuffer(12, *SPACES, device="cpu", n_envs=3)
    rows = np.arange(4)
    buffer_rows(new).put_rows(rows, buffer_rows(old).take_rows(rows))
    new.pos, new.full = old.pos, old.full
    assert transitions(new) == transitions(old)


def test_what_it_has_not_is_refused():
    with pytest.raises(ValueError, match="no optimize_memory_usage"):
        DeviceReplayBuffer(12, *SPACES, optimize_memory_usage=True)
