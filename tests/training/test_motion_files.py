"""``evaluate --motion`` writes how everything moved, and it moves so again."""

import json

import numpy as np
import pytest
from acting import LOUD

from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.take import Take
from sb3_piano.training import evaluate
from sb3_piano.training.evaluation.evaluate import evaluate_runs

PIECE = "debug-CMajorScaleOneHand"
MOTIONS = ["performance_1.npz", "performance_2.npz"]


@pytest.mark.slow
def test_an_episode_is_written_as_it_moved(piano_run, midi_file):
    evaluation = evaluate(piano_run(LOUD).path, motion=True)
    (path,) = evaluation.motions
    assert path.name == "performance_1.npz"
    take = Take.read(path)
    assert (take.title, take.seed) == ("duet", 0)
    assert take.metrics == pytest.approx(evaluation.episodes[0], nan_ok=True)
    assert take.piano.metrics()["f1"] == take.metrics["f1"]
    recording = take.motion

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
def test_each_episode_has_its_file_which_the_command_lists_and_stale_ones_go(
    piano_run, capsys, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    folder = piano_run(LOUD).evaluation_dir
    for more, names in ((["--episodes", "2", "--motion"], MOTIONS), ([], [])):
        assert main(["evaluate", "run", *more]) == 0
        listed = "Motion:      run/evaluation/performance_1.npz and 1 more\n"
        assert (listed in capsys.readouterr().out) == bool(names)
        assert json.loads((folder / "metrics.json").read_text())["motions"] == names
        assert sorted(path.name for path in folder.glob("*.npz")) == names


def test_only_a_run_s_own_piece_on_a_piano_has_motion(piano_run, pendulum_run, midi_file):
    run = piano_run(LOUD)
    with pytest.raises(ConfigError, match="Of another piece no motion is written"):
        evaluate(run.path, score=PIECE, motion=True)
    with pytest.raises(ConfigError, match="Of a tree search no motion is written"):
        evaluate(f"tree:1x8:{run.path}", motion=True)
    found = evaluate_runs([run.path], scores=[PIECE], motion=True)
    assert "Of another piece no motion is written" in found.failures[0].reason
    pendulum = pendulum_run("pendulum")
    with pytest.raises(ConfigError, match="is of no piano: expected no motion=True"):
        evaluate(pendulum.path, motion=True)
