"""``evaluate --motion`` writes how everything moved, and it moves so again."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sb3_piano.cli import main
from sb3_piano.envs import EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music.difficulty import read_motion
from sb3_piano.training import SavedPlayer, evaluate, evaluate_runs, train

LOUD = np.where(np.arange(39) % 2 == 0, 0.9, -0.3)
PIECE = "debug-CMajorScaleOneHand"


@pytest.mark.slow
def test_an_episode_is_written_as_it_moved(piano_run, midi_file):
    evaluation = evaluate(piano_run(LOUD).path, motion=True)
    (path,) = evaluation.motions
    assert path.name == "performance_1.npz"
    recording = read_motion(path)
    assert recording.title == "duet"

    env = PianoEnv(str(midi_file))
    steps = len(env.roll)
    hands = np.concatenate(env.scene.joint_qpos)
    assert np.array_equal(recording.hand_qpos, hands)
    assert recording.actions.shape == (steps, 39)
    env.reset(seed=0)
    for step in range(steps):
        # Fingertips are those of the state at the same time, before the action is done.
        assert np.allclose(recording.qpos[step], env.data.qpos, atol=1e-12)
        tips = env.scene.fingertip_position(env.data)
        assert np.allclose(recording.fingertips[step], tips, atol=1e-12)
        env.step(recording.actions[step])
    assert np.allclose(recording.qpos[steps], env.data.qpos, atol=1e-12)
    assert np.allclose(recording.actions, LOUD, atol=1e-6)
    assert recording.features().hand_motion > 0


@pytest.mark.slow
def test_each_episode_has_its_file_and_stale_ones_go(piano_run):
    run = piano_run(LOUD)
    evaluation = evaluate(run.path, episodes=3, motion=True)
    names = [f"performance_{number}.npz" for number in (1, 2, 3)]
    assert [path.name for path in evaluation.motions] == names
    assert json.loads(evaluation.metrics_file.read_text())["motions"] == names
    evaluation = evaluate(run.path, episodes=1)
    assert evaluation.motions == ()
    assert not list(run.evaluation_dir.glob("*.npz"))
    assert json.loads(evaluation.metrics_file.read_text())["motions"] == []


@pytest.mark.slow
def test_of_several_pieces_each_file_has_the_title_of_its_own(small_config, tmp_path):
    titles = ["CMajorScaleOneHand", "TwinkleTwinkleLittleStar"]
    config = small_config(
        env_id="RoboPianist-v0",
        env_kwargs={"score": PIECE},
        env_wrapper=[
            {"sb3_piano.wrappers.RandomPiece": {"pieces": titles}},
            {"sb3_piano.wrappers.Excerpt": {"start": 0.0, "length": 0.2, "unit": "seconds"}},
        ],
        n_timesteps=1,
    )
    folder = train(config, tmp_path / "several", progress_bar=False).folder
    evaluation = evaluate(folder.path, episodes=8, motion=True)
    found = [read_motion(path).title for path in evaluation.motions]
    assert set(found) == set(titles)
    with SavedPlayer.open(folder.path) as player:
        played = [recording.performance.title for recording in player.play(8)]
    assert found == played


def test_only_a_run_s_own_piece_on_a_piano_has_motion(piano_run, pendulum_run, midi_file):
    run = piano_run(LOUD)
    with pytest.raises(ConfigError, match="Of another piece no motion is written"):
        evaluate(run.path, score=PIECE, motion=True)
    found = evaluate_runs([run.path], scores=[PIECE], motion=True)
    assert "Of another piece no motion is written" in found.failures[0].reason
    pendulum = pendulum_run("pendulum")
    with pytest.raises(ConfigError, match="is of no piano: expected no motion=True"):
        evaluate(pendulum.path, motion=True)


@pytest.mark.slow
def test_the_command_writes_and_lists_the_files(piano_run, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    piano_run(LOUD)
    assert main(["evaluate", "run", "--episodes", "2", "--motion"]) == 0
    out = capsys.readouterr().out
    assert "Motion:      run/evaluation/performance_1.npz and 1 more\n" in out
    assert main(["evaluate", "run"]) == 0
    assert "Motion:" not in capsys.readouterr().out


def test_what_is_recorded_is_the_action_that_reached_the_environment(midi_file):
    env = EpisodeRecorder(PianoEnv(str(midi_file)))
    for resting in (True, False, True):
        env.resting = resting
        env.reset(seed=0)
        over, action = False, np.full(39, 0.25, dtype=np.float32)
        while not over:
            given = action.copy()
            *_, over, _ = env.step(given)
            given[:] = 9.0  # the array stays the caller's, who may fill it anew
        motion = env.finished.pop().motion
        expected = env.unwrapped.rest_action if resting else 0.25
        assert np.allclose(motion.actions, expected)
        lengths = (len(motion.actions) + 1, len(motion.qpos), len(motion.fingertips))
        assert len(set(lengths)) == 1
