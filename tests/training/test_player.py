"""A run's saved model plays what and where it is told to."""

import dataclasses

import pytest
from acting import STILL

from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, Score
from sb3_piano.training import OpenPlayer, evaluate, train

BEYOND = Score(notes=[Note(pitch=100, onset=0.0, offset=0.2)], title="Beyond")


@pytest.mark.slow
def test_episodes_are_recorded_with_their_motion(piano_run):
    with OpenPlayer.open(piano_run(STILL).path, seed=3) as player:
        assert isinstance(player.env, PianoEnv)
        first, second = player.play(2)
        for recording in (first, second):
            steps = len(recording.performance)
            assert steps == len(player.env.roll) == recording.metrics["length"]
            assert recording.motion.qpos.shape == (steps + 1, player.env.model.nq)
        assert first.metrics == second.metrics
        assert (player.seed, player.num_timesteps, player.piece) == (3, 1, "duet")
        resting = player.rest()
        assert resting.metrics["return_energy"] != first.metrics["return_energy"]
        # a rest leaves nothing behind
        assert player.play()[0].metrics == first.metrics


def test_an_episode_ends_when_a_wrapper_of_the_run_ends_it(piano_run):
    folder = piano_run(STILL)
    limit = {"gymnasium.wrappers.TimeLimit": {"max_episode_steps": 3}}
    folder.write_config(dataclasses.replace(folder.read_config(), env_wrapper=[limit]))
    found = evaluate(folder.path, episodes=2)
    for metrics in (*found.episodes, found.baseline):
        assert metrics["length"] == 3
    assert found.summary["f1"].mean == found.episodes[0]["f1"]
    with OpenPlayer.open(folder.path) as player:
        endless = player.episodes()
        next(endless)
        player.wrapped.step(STILL)  # leave one under way
        assert [recording.metrics["length"] for recording in player.play(2)] == [3, 3]
    # Without a file, the score names the piece.
    folder.provenance_file.unlink()
    named = {"score": "CMajorScaleOneHand"}
    folder.write_config(dataclasses.replace(folder.read_config(), env_kwargs=named))
    with OpenPlayer.open(folder.path) as player:
        assert player.piece == "CMajorScaleOneHand"


def test_each_playing_starts_from_its_seed(pendulum_run):
    with OpenPlayer.open(pendulum_run().path, seed=5) as player:
        returns = [r.metrics["return"] for r in player.play(3)]
        assert [r.metrics["return"] for r in player.play(2)] == returns[:2]
        other = [r.metrics["return"] for r in player.play(1, seed=6)]
        assert other[0] not in returns
        endless = player.episodes(seed=5)
        assert [next(endless).metrics["return"] for _ in range(3)] == returns


def test_a_window_keeps_its_keys_for_another_piece(piano_run):
    """Observed are the keys of the run's own piece, C3 to E5, and three beside them."""
    folder = piano_run(STILL, observation="window")
    inside = Score(notes=[Note(pitch=60, onset=0.0, offset=0.2)], title="Inside")
    with OpenPlayer.open(folder.path) as own, OpenPlayer.open(folder.path, score=inside) as other:
        assert own.env.observation_space == other.env.observation_space
        assert len(other.play()[0].performance) == 5
    with pytest.raises(RunError, match="run' cannot play 'Beyond': .*that its observation"):
        OpenPlayer.open(folder.path, score=BEYOND)


def test_what_a_run_of_no_piano_cannot_play_is_refused(pendulum_run):
    folder = pendulum_run().path
    for error, message, changes in (
        (ConfigError, "seed is -1: expected a whole number, 0 or more", {"seed": -1}),
        (ConfigError, "cannot play 'Beyond': its environment 'Pendulum-v1' is", {"score": BEYOND}),
        (RunError, "no best model by 'f1', it has none by any metric", {"best": "f1"}),
    ):
        with pytest.raises(error, match=message):
            OpenPlayer.open(folder, **changes)
    with OpenPlayer.open(folder) as player:
        assert (player.rest(), player.piece) == (None, "Pendulum-v1")
        (recording,) = player.play()
        assert (recording.performance, recording.motion) == (None, None)
        with pytest.raises(ConfigError, match="episodes is 0: expected a whole number"):
            player.play(0)
        with pytest.raises(ConfigError, match="seed is -2: expected a whole number"):
            player.play(1, seed=-2)


@pytest.fixture
def evaluated_run(small_config, tmp_path, midi_file):
    """Return a function that trains for 30 steps with three evaluations, the first one the best.

    Nothing is pressed in so few steps: all evaluations are alike.
    """

    def make(**changes):
        config = small_config(
            env_id="RoboPianist-v0",
            env_kwargs={"score": str(midi_file), "physics": "fast"},
            n_timesteps=30,
            callback=({"sb3_piano.callbacks.F1Callback": {"eval_freq": 10}},),
            **changes,
        )
        return train(config, tmp_path / "best", progress_bar=False).folder

    return make


@pytest.mark.slow
@pytest.mark.parametrize("normalize", [False, True])
def test_the_best_model_plays_in_place_of_the_last_one(evaluated_run, normalize):
    run = evaluated_run(normalize=normalize)
    for best, steps in ((None, 30), ("f1", 10)):
        with OpenPlayer.open(run.path, best=best) as player:
            assert player.num_timesteps == steps
            assert len(player.play()) == 1
            statistics = player.model.get_vec_normalize_env()
            assert (statistics is not None) is normalize
            assert not normalize or statistics.obs_rms.count == pytest.approx(steps + 1, abs=0.1)
    assert evaluate(run.path, best="f1").num_timesteps == 10
    with pytest.raises(RunError, match="no best model by 'onset_f1', it has one by f1: expected"):
        OpenPlayer.open(run.path, best="onset_f1")


@pytest.mark.slow
def test_every_command_that_plays_takes_the_best_model(evaluated_run, capsys):
    folder = evaluated_run()
    run = str(folder.path)
    for command in (["evaluate"], ["play", "--no-video"], ["report"]):
        assert main([*command, run, "--best", "recall"]) == 2
        assert "has no best model by 'recall'" in capsys.readouterr().err
        assert main([*command, run, "--best", "f1"]) == 0
    page = (folder.evaluation_dir / "report.html").read_text(encoding="utf-8")
    assert "best by f1" in page
    assert f"sb3-piano report {run} --seed 0 --best f1" in page
