"""Trainings that correct the sight-reader on one piece: presets, the run's folder, the commands."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from stable_baselines3 import PPO, SAC, TD3
from untrained_hand import write_network
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.envs import GENERAL_ID, Block
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import FINE_TUNING
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.players import HandModel
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.policies import hand_weights
from sb3_piano.training import (
    RunConfig,
    RunFolder,
    evaluate,
    load_config,
    load_fine_tuning,
    train,
)

tables = Tables(__file__)

EXCERPT = Path(__file__).parents[2] / "examples" / "fine_tuning" / "fur_elise.yml"
ALGORITHMS = {"sac": SAC, "td3": TD3, "ppo": PPO}
BRIEF = {
    "sac": {"learning_starts": 16, "buffer_size": 128, "batch_size": 8},
    "td3": {"learning_starts": 16, "buffer_size": 128, "batch_size": 8},
    "ppo": {"n_steps": 8, "batch_size": 8},
}
COMMON = {"n_envs": 2, "vec_env": "dummy", "env_kwargs": {"initial_buffer_time": 0.0}}


NETWORK = "other.safetensors"
TUNE = Score(notes=[Note(onset=i / 5, offset=(i + 1) / 5, pitch=72 + i, finger=i) for i in (0, 1)])


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(TUNE, "tune.mid")
    write_network(NETWORK, TUNE)


def brief(algo, policy_kwargs=None):
    """Return changes of a preset with which a training is a matter of a second."""
    entry = yaml.safe_load(FINE_TUNING[algo].read_text())["default"]
    entry["policy_kwargs"] |= {"critic_first": 0, **(policy_kwargs or {})}
    callback = [entry["callback"][0], {"sb3_piano.callbacks.F1Callback": {"evaluate_start": True}}]
    return {**COMMON, **BRIEF[algo], "policy_kwargs": entry["policy_kwargs"], "callback": callback}


@pytest.mark.slow
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_training_begins_as_the_sight_reader_and_learns(algo):
    settings = brief(algo)
    settings["env_kwargs"] = {**settings["env_kwargs"], "score": "tune.mid"}
    config = load_fine_tuning(
        algo, GENERAL_ID, player=NETWORK, n_timesteps=64, seed=0, learning_rate=0.01, **settings
    )
    run = train(config, "run", progress_bar=False).folder
    first, last = (
        ALGORITHMS[algo].load(file)
        for file in (run.best_dir("f1") / "best_model.zip", run.model_file)
    )
    seen = np.random.default_rng(1).normal(size=first.observation_space.shape).astype(np.float32)
    assert (first.predict(seen, deterministic=True)[0] == 0).all()
    assert np.abs(last.predict(seen, deterministic=True)[0]).max() > 0.01
    base = HandModel.load(NETWORK).tensors
    for model in (first, last):
        for name in ("standardize.mean", "standardize.scale"):
            found = hand_weights(model.policy)[name].numpy()
            np.testing.assert_allclose(found, base[name], rtol=1e-6)


@pytest.mark.slow
def test_every_command_works_with_such_a_run():
    Path("mine.yml").write_text(yaml.safe_dump({GENERAL_ID: brief("sac")}))
    command = "train --from other.safetensors --midi tune.mid --config mine.yml --steps 32 --seed 0"
    assert main([*command.split(), "--out", "run", "--no-progress"]) == 0
    wanted = evaluate("run").mean
    assert main(["export", "run", "shared", "--no-video", "--episodes", "1"]) == 0
    tensors = HandModel.load(NETWORK).tensors
    Path(NETWORK).unlink()  # the run has its own
    shutil.move("run", "moved")
    for folder in ("moved", "shared"):
        for name, tensor in HandModel.load(folder).tensors.items():
            np.testing.assert_array_equal(tensor, tensors[name])
        assert evaluate(folder).mean == wanted
    assert main(["train", "--resume", "moved", "--steps", "48", "--no-progress"]) == 0
    assert main(["evaluate", "moved", "--best", "f1"]) == 0
    assert main(["report", "moved"]) == 0
    assert main(["play", "moved", "--no-video"]) == 0


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_preset_is_valid_and_an_overlay_changes_it(algo):
    plain = load_fine_tuning(algo, GENERAL_ID)
    assert plain.env.network == str(SHIPPED)
    cut = load_fine_tuning(algo, GENERAL_ID, EXCERPT, env_kwargs={"physics": "reference"})
    assert cut.env_wrapper[0].path == "sb3_piano.wrappers.Excerpt"
    assert cut.env_kwargs == {**plain.env_kwargs, "physics": "reference"}
    same = {**plain.to_mapping(), "env_wrapper": [], "env_kwargs": {}}
    assert {**cut.to_mapping(), "env_wrapper": [], "env_kwargs": {}} == same


def test_what_cannot_be_fine_tuned_is_refused():
    with pytest.raises(ConfigError, match="env_wrapper has no sb3_piano.players.PlayerRes"):
        load_fine_tuning("sac", GENERAL_ID, env_wrapper=[])
    assert load_config("sac", GENERAL_ID).env.network is None
    for name in ("fast", "robopianist"):
        with pytest.raises(ConfigError, match=f"preset '{name}' is for a training from nothing"):
            load_fine_tuning("sac", GENERAL_ID, name)


# What a run plays, whose model is corrected.


@pytest.fixture
def base():
    """Return a function that makes the folder of a run; it is not trained."""

    def make(**settings):
        given = {"algo": "td3", "env_id": GENERAL_ID, "n_timesteps": 1, **settings}
        return RunFolder.create(RunConfig(**given), "base")

    return make


class Idle(Block):
    name, meaning = "idle", "nothing"


@pytest.mark.parametrize("blocks", [[], [Idle]])
def test_hands_are_corrected_one_by_one_where_nothing_else_is_observed(base, blocks):
    base(env_kwargs={"observation": "hands", "observation_blocks": blocks})
    config = load_fine_tuning("sac", player="base")
    assert bool(config.vec_env_wrapper) is not bool(blocks)


@tables("wrapper, rad")
def test_how_far_a_run_is_corrected_may_be_changed(base, wrapper, rad):
    base()
    around = "sb3_piano.wrappers.HandReward"
    Path("own.yml").write_text(yaml.safe_dump({"default": {"env_wrapper": [wrapper, around]}}))
    residual, outside = load_fine_tuning("sac", path="own.yml", player="base").env_wrapper
    assert (residual.path, outside.path) == ("sb3_piano.training.RunResidual", around)
    assert residual.kwargs.get("scale") == (None if rad is None else pytest.approx(rad))
    default = load_fine_tuning("sac", player="base").env_wrapper[0]
    assert default.kwargs["scale"] == pytest.approx(0.06)  # what RunResidual has by itself
