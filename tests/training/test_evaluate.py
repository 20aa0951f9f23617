"""Evaluation measures what saved models play, and writes it down; one that fails stops no other."""

import dataclasses
import errno
import json

import gymnasium as gym
import numpy as np
import pytest
from acting import LOUD, STILL
from episodes import steps_of
from printed import read_csv
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize
from yaml_rows import Tables

from sb3_piano.envs import RETURN_KEYS
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.training import compare, evaluate
from sb3_piano.training.evaluation.evaluate import evaluate_runs
from sb3_piano.training.evaluation.evaluations import Evaluations
from sb3_piano.training.evaluation.statistics import summarize

tables = Tables(__file__)


class DoubleReward(gym.RewardWrapper):
    """Double the reward; named in a config by its import path."""

    def reward(self, reward):
        return 2.0 * float(reward)


def loudly(env):
    """Return rewards and the last info of an episode in which one action is repeated."""
    steps = list(steps_of(env, lambda _: np.clip(LOUD, -0.9999999, 0.9999999)))
    return [reward for _, reward, *_ in steps], steps[-1][-1]


def test_what_was_played_is_written_as_midi_and_measured(piano_run, midi_file):
    env = gym.make("RoboPianist-v0", score=str(midi_file))
    rewards, info = loudly(env)
    total = sum(rewards)
    played = env.unwrapped.performance.to_score()
    assert played is not None

    evaluation = evaluate(piano_run(LOUD).path, episodes=2, seed=5)
    assert evaluation.mean["length"] == len(env.unwrapped.roll)
    assert evaluation.mean["return"] == pytest.approx(total, rel=1e-3)
    for name in (*EPISODE_METRICS, *RETURN_KEYS):
        assert evaluation.mean[name] == pytest.approx(info[name], rel=1e-3, abs=1e-6), name
    notes = read_midi(evaluation.performances[0]).notes
    assert [note.pitch for note in notes] == [note.pitch for note in played.notes]
    assert [note.onset for note in notes] == pytest.approx([n.onset for n in played.notes])
    # beside it stand the same hands at rest: no wrong key, and next to no due one
    assert evaluation.mean["precision"] < evaluation.baseline["precision"] == 1.0
    assert evaluation.baseline["recall"] < 0.1
    content = json.loads(evaluation.metrics_file.read_text())
    assert content == json.loads(json.dumps(evaluation.to_json()))
    assert (content["num_timesteps"], content["training_seed"]) == (1, 1)
    assert content["episode_seeds"] == [5, 5]
    for name in ("mean", "baseline"):
        assert content[name] == getattr(evaluation, name)
    assert content["std"]["f1"] == 0.0  # nothing is random here
    assert content["interval"]["f1"] is None
    assert content["no_interval"]["f1"] == "all values are equal"
    assert (content["algo"], content["piece"], content["interrupted"]) == ("td3", "duet", False)
    assert content["episodes"] == list(evaluation.episodes)
    assert content["performances"] == ["performance_1.mid", "performance_2.mid"]


@pytest.mark.slow
def test_hands_that_rest_equal_the_baseline_and_leave_no_midi_file(piano_run, midi_file):
    rest = gym.make("RoboPianist-v0", score=str(midi_file)).unwrapped.rest_action
    folder = piano_run(LOUD)
    assert evaluate(folder.path).performances[0].is_file()
    evaluation = evaluate(piano_run(rest).path)
    assert evaluation.performances == (None,)
    assert {path.name for path in folder.evaluation_dir.iterdir()} == {"metrics.json"}
    assert evaluation.mean == pytest.approx(evaluation.baseline, rel=1e-3, abs=1e-3)


@pytest.mark.slow
def test_a_run_can_be_judged_on_other_physics_than_its_own(piano_run):
    folder = piano_run(LOUD)
    returns = {}
    for physics in (None, "reference", "fast"):
        evaluation = evaluate(folder.path, physics=physics)
        returns[physics] = evaluation.mean["return_energy"]
        written = json.loads(evaluation.metrics_file.read_text())
        assert written["env_kwargs"].get("physics") == physics
    assert returns[None] == returns["reference"] != returns["fast"]
    with pytest.raises(ConfigError, match="Unknown physics profile 'quick'"):
        evaluate(folder.path, physics="quick")


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [TD3, SAC])
def test_returns_equal_those_of_sb3s_own_evaluation_without_exploring(pendulum_run, algorithm):
    wrapper = "gymnasium.wrappers.FlattenObservation"
    folder = pendulum_run(algo=algorithm.__name__.lower(), normalize=True, env_wrapper=wrapper)
    venv = make_vec_env("Pendulum-v1", env_kwargs={"max_episode_steps": 20})
    venv = VecNormalize.load(str(folder.path / "vecnormalize.pkl"), venv)
    venv.training = False
    model = algorithm.load(folder.model_file)
    venv.seed(4)
    returns, lengths = evaluate_policy(model, venv, 3, return_episode_rewards=True)
    evaluation = evaluate(folder.path, episodes=3, seed=4)
    ours = [episode["return"] for episode in evaluation.episodes]
    assert ours == pytest.approx(returns, rel=1e-5)
    assert [episode["length"] for episode in evaluation.episodes] == lengths
    assert evaluation.mean["return"] == pytest.approx(np.mean(returns))
    assert evaluation.std["return"] == pytest.approx(np.std(returns))


def test_other_environments_have_return_and_length_only_and_wrappers_do_not_change_them(
    pendulum_run,
):
    folder = pendulum_run()
    evaluation = evaluate(folder.path)
    assert set(evaluation.mean) == {"return", "length"}
    assert evaluation.baseline is None
    assert evaluation.performances == (None,)
    wrap(folder, f"{__name__}.DoubleReward")
    assert evaluate(folder.path).mean == evaluation.mean


def test_a_run_without_its_copy_of_the_model_plays_its_checkpoint(pendulum_run):
    folder = pendulum_run(normalize=True)
    expected = evaluate(folder.path).mean
    folder.model_file.unlink()
    (folder.path / "vecnormalize.pkl").unlink()
    assert evaluate(folder.path).mean == expected


@tables("missing, message")
def test_a_run_without_model_or_statistics_is_refused(pendulum_run, missing, message):
    folder = pendulum_run(normalize=missing == "vecnormalize.pkl")
    (folder.path / missing).unlink()
    (folder.checkpoint_dir / "checkpoint.json").unlink()
    with pytest.raises(RunError, match=message):
        evaluate(folder.path)


def test_episodes_of_several_seeds_are_those_of_each_seed_alone(pendulum_run):
    folder = pendulum_run()
    together = evaluate(folder.path, episodes=2, seed=[4, 1])
    alone = [evaluate(folder.path, episodes=2, seed=seed) for seed in (4, 1)]
    assert together.episodes == (*alone[0].episodes, *alone[1].episodes)
    assert together.episode_seeds == (4, 4, 1, 1)
    returns = [episode["return"] for episode in together.episodes]
    assert together.summary["return"] == summarize(returns)
    assert together.mean["return"] == pytest.approx(np.mean(returns))
    low, high = together.summary["return"].interval
    assert min(returns) <= low < together.mean["return"] < high <= max(returns)
    assert together.to_json()["interval"]["return"] == (low, high)
    assert "return" not in together.to_json()["no_interval"]
    for episodes, seeds, message in ((0, 0, "episodes is 0: expected a"), (1, [], "no seeds")):
        with pytest.raises(ConfigError, match=message):
            evaluate(folder.path, episodes, seeds)


@pytest.mark.slow
def test_another_piece_is_played_and_leaves_the_files_of_the_own_one(piano_run):
    folder = piano_run(LOUD, physics="fast")
    own = evaluate(folder.path)
    before = own.metrics_file.read_text()
    other = evaluate(folder.path, score="TwinkleTwinkleLittleStar")
    env = gym.make("RoboPianist-v0", score="TwinkleTwinkleLittleStar", physics="fast")
    _, info = loudly(env)
    for name in EPISODE_METRICS:
        assert other.mean[name] == pytest.approx(info[name], rel=1e-3, abs=1e-6), name
    assert other.baseline["length"] == other.mean["length"] == len(env.unwrapped.roll)
    assert (own.piece, other.piece) == ("duet", "TwinkleTwinkleLittleStar")
    assert (other.performances, other.metrics_file) == ((), None)
    assert own.metrics_file.read_text() == before


def test_a_place_that_cannot_be_written_is_told_before_and_a_full_disk_afterwards(
    pendulum_run, monkeypatch, caplog
):
    def full(file, content):
        raise OSError(errno.ENOSPC, "No space left on device")

    folder = pendulum_run()
    folder.evaluation_dir.write_text("in the way")
    with pytest.raises(RunError, match=r"evaluation' cannot be written: File exists"):
        evaluate(folder.path, on_episode=lambda: pytest.fail("it was played first"))
    folder.evaluation_dir.unlink()
    monkeypatch.setattr("sb3_piano.training.evaluation.evaluate.write_json", full)
    (failure,) = evaluate_runs([folder.path]).failures
    assert "evaluation' cannot be written: No space left on device. Expected" in failure.reason
    assert not caplog.records


@pytest.fixture
def three_runs(pendulum_run):
    """Runs of three algorithms on Pendulum."""
    return [pendulum_run(algo, algo=algo) for algo in ("td3", "sac", "ddpg")]


def wrap(folder, wrapper):
    folder.write_config(dataclasses.replace(folder.read_config(), env_wrapper=wrapper))


@pytest.mark.slow
def test_files_of_one_name_are_told_apart(piano_run, tmp_path):
    files = [tmp_path / composer / "midi_score.mid" for composer in ("Bach", "Liszt")]
    for index, file in enumerate(files):
        file.parent.mkdir()
        notes = [Note(onset=0.0, offset=0.2 * (index + 1), pitch=60)]
        write_midi(Score(notes=notes), file)
    run = piano_run(STILL, physics="fast").path
    found = evaluate_runs([run], scores=[*files, "CMajorScaleOneHand"])
    assert [one.piece for one in found.evaluations] == [*map(str, files), "CMajorScaleOneHand"]
    (alone,) = evaluate_runs([run], scores=files[:1]).evaluations
    assert alone.piece == "midi_score"


@pytest.mark.slow
def test_the_csv_has_a_row_for_each_episode_of_each_run_as_if_it_were_alone(
    three_runs, piano_run, tmp_path
):
    paths = [run.path for run in three_runs]
    found = evaluate_runs(paths, 2, [7, 0])
    assert found == Evaluations(evaluations=tuple(evaluate(path, 2, [7, 0]) for path in paths))
    found.write_csv(tmp_path / "all.csv")
    rows = read_csv(tmp_path / "all.csv")
    names = ["run", "algo", "piece", "seed", "episode", "return", "length"]
    assert list(rows[0]) == names
    assert [(r["algo"], r["seed"], r["episode"]) for r in rows] == [
        (algo, seed, episode)
        for algo in ("td3", "sac", "ddpg")
        for seed in "70"
        for episode in "12"
    ]
    assert {row["piece"] for row in rows} == {"Pendulum-v1"}
    assert rows[4]["run"] == str(three_runs[1].path)
    returns = [e["return"] for evaluation in found.evaluations for e in evaluation.episodes]
    assert [float(row["return"]) for row in rows] == returns
    # Metrics that a run lacks are empty.
    evaluate_runs([paths[0], piano_run(STILL, "piano").path]).write_csv(tmp_path / "both.csv")
    pendulum, piano = read_csv(tmp_path / "both.csv")
    assert pendulum["f1"] == ""
    assert 0 <= float(piano["f1"]) <= 1


def test_the_json_has_everything_and_can_be_compared(three_runs, tmp_path):
    td3, sac, _ = three_runs
    found = evaluate_runs([td3.path, tmp_path / "nix"], 3)
    file = tmp_path / "td3.json"
    found.write_json(file)
    content = json.loads(file.read_text())
    assert content["evaluations"] == [json.loads(json.dumps(found.evaluations[0].to_json()))]
    assert content["evaluations"][0]["interval"]["return"] is not None
    assert content["failures"][0]["run"] == str(tmp_path / "nix")
    assert content["interrupted"] is False
    other = evaluate(sac.path, 3)
    (pair,) = compare(file, sac.path).metrics[0].pairs
    assert pair.a == pytest.approx(found.evaluations[0].mean["return"])
    assert pair.b == pytest.approx(other.mean["return"])
