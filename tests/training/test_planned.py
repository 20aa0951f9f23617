"""What plays without training: its runs, and ``sb3-piano play --planned``."""

import json
import re
import shutil
import signal
from pathlib import Path

import av
import numpy as np
import pretty_midi
import pytest
import yaml
from short_scores import score_of
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.callbacks import F1Callback
from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, PlanWarning, RunError
from sb3_piano.music import read_midi, write_midi
from sb3_piano.planning import PlannedPianist, PlanSettings, Refinement
from sb3_piano.planning.sampling import PredictiveSampling, SamplingNoise
from sb3_piano.simulation import find_gl_backend
from sb3_piano.training import PLANNERS, PlannedConfig, RunFolder, SavedPlayer, evaluate
from sb3_piano.training.playing.player import run_to_record
from sb3_piano.training.playing.takes import PLANNED_IN, plan_run, planner_config, take_of_planner

TUNE = score_of(
    (0.0, 0.45, 76, 1), (0.5, 0.95, 77, 2), (0.5, 1.0, 48, 6), pedals=[(0.2, 0.6)], title="tune"
)
# Some frames are lost on the way.
LEAP = score_of((0.0, 0.25, 60, 0), (0.25, 0.5, 72, 1), (0.5, 0.75, 60, 0))
# One finger cannot hold two keys a sixth apart.
TOO_WIDE = score_of((0.0, 0.4, 60, 0), (0.0, 0.4, 84, 4))
FAST = {"physics": "fast"}
SHORTLY = ("--refine", "0.001")
"""A pass, most of which has no time for searching."""
ZERO = {"nominal": "none", "samples": 2, "horizon": 2, "n_threads": 1}
"""Sampling from zero, which needs no plan and little time."""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(TUNE, "tune.mid")
    write_midi(LEAP, "leap.mid")
    write_midi(TOO_WIDE, "wide.mid")
    write_midi(PLAIN, "plain.mid")


@pytest.fixture(scope="module")
def pianist():
    """Return a planned pianist in a vector of one environment, which keeps its plan."""
    return PlannedPianist(DummyVecEnv([lambda: Monitor(PianoEnv(TUNE, **PLANNED_IN, **FAST))]))


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """Return the metrics of the tune as it is played without any run."""
    path = tmp_path_factory.mktemp("score") / "tune.mid"
    write_midi(TUNE, path)
    return dict(take_of_planner(planner_config(str(path), env_kwargs=FAST)).metrics)


def zero_run(folder="zero", **changes):
    config = planner_config("tune.mid", "sampling", env_kwargs=FAST, **{**ZERO, **changes})
    return plan_run(config, folder)[0]


@pytest.mark.slow
def test_a_planned_run_is_evaluated_compared_watched_and_reported(capsys, piano_run, expected):
    assert main(["plan", "tune.mid", "--set", "physics=fast"]) == 0
    out = capsys.readouterr().out
    assert "tune: ready to play after" in out
    run = "runs/planned/RoboPianist-v0_1"
    assert f"sb3-piano evaluate {run}" in out
    assert main(["evaluate", run]) == 0
    assert "tune: 1 episode, model after 0 steps of training" in capsys.readouterr().out
    found = json.loads(Path(run, "evaluation/metrics.json").read_text())
    assert found["mean"] == pytest.approx(expected, nan_ok=True)
    assert found["mean"]["f1"] > 0.8 > found["baseline"]["f1"]

    trained = piano_run(np.zeros(39, dtype=np.float32), name="trained", score="tune.mid")
    assert main(["evaluate", str(trained.path)]) == 0
    assert main(["compare", str(trained.path), run, "--metric", "f1", "--json", "c.json"]) == 0
    [pair] = json.loads(Path("c.json").read_text())["metrics"]["f1"]["pairs"]
    assert (pair["piece"], pair["b"]) == ("tune", found["mean"]["f1"])

    assert main(["play", run, "--no-video"]) == 0
    played = read_midi(f"{run}/play/performance.mid")
    assert {note.pitch for note in played.notes} == {48, 76, 77}
    assert main(["report", run]) == 0
    assert "PLANNED after 0 steps" in Path(run, "evaluation/report.html").read_text()


@pytest.mark.slow
def test_a_planned_run_plays_another_piece():
    run = RunFolder.create(planner_config("tune.mid", env_kwargs=FAST), "run")
    write_midi(TUNE.transpose(-2), "lower.mid")
    found = evaluate(run.path, score="lower.mid")
    assert found.piece == "lower"
    assert found.mean["f1"] > 0.8


def test_a_run_keeps_the_score_and_what_was_chosen():
    config = planner_config(
        "tune.mid",
        "sampling",
        seed=3,
        env_kwargs={"reduced_action_space": True, **FAST},
        noise={"finger": 0.3, "knots": 4},
        **ZERO,
    )
    run, piece, _ = plan_run(config, "run")
    Path("tune.mid").unlink()
    assert piece == "tune"
    read = run.read_config()
    changed = {"reduced_action_space": True, "score": "run/score.mid"}
    assert read.env_kwargs == {**PLANNED_IN, **FAST, **changed}
    assert (read.algo, read.seed) == ("sampling", 3)
    with SavedPlayer.open("run", seed=4) as player:
        assert player.env.action_space.shape == (39,)
        sampler = player.model
        assert isinstance(sampler, PredictiveSampling)
        assert (sampler._samples, sampler._horizon, sampler._planned) == (2, 2, False)
        assert sampler._noise == SamplingNoise(finger=0.3, knots=4)
        drawn = np.random.default_rng(np.random.SeedSequence(4).spawn(1)[0])
        assert sampler._random[0].bit_generator.state == drawn.bit_generator.state


def test_the_constants_of_a_plan_are_settings_of_its_run():
    config = planner_config("tune.mid", env_kwargs=FAST, settings={"hover": "0.02", "rounds": 3})
    mapping = yaml.safe_load(yaml.safe_dump(config.to_mapping()))
    assert PlannedConfig(**mapping) == config
    former = RunFolder.create(config, "former")
    mapping = yaml.safe_load(former.config_file.read_text())
    unneeded = {"n_timesteps": 1, "normalize": False, "callback": []}  # of folders of before
    former.config_file.write_text(yaml.safe_dump({**mapping, **unneeded}))
    assert former.read_config().to_mapping().keys() == mapping.keys()
    config = planner_config("tune.mid", env_kwargs=FAST, settings={"rounds": 2})
    run = RunFolder.create(config, "run")
    with SavedPlayer.open(run.path) as player:
        assert player.model.settings == PlanSettings(rounds=2)


@pytest.mark.slow
def test_an_episode_comes_from_its_seed_whatever_was_played_before():
    run = zero_run()
    both = evaluate(run.path, 1, (0, 1))
    alone = evaluate(run.path, 1, 1)
    assert both.episodes[1] == alone.episodes[0]
    assert both.episodes[0] != both.episodes[1]


def test_a_run_is_recorded_by_a_player_of_the_environment_that_is_recorded():
    run = zero_run()
    with run_to_record(run.path) as (policy, env, config):
        observation, _ = env.reset(seed=0)
        state = None
        for _ in range(3):  # which another environment's player would refuse
            action, state = policy.predict(observation, state)
            observation, *_ = env.step(action)
        assert env.unwrapped.steps_played == 3
    assert config.algo == "sampling"


@pytest.mark.parametrize("algo", PLANNERS)
def test_what_is_not_trained_is_told_so_in_one_way(algo, capsys, caplog):
    run = RunFolder.create(planner_config("tune.mid", algo), "run").path
    commands = [
        ["train", "--algo", algo, "--midi", "tune.mid"],
        ["train", "--algo", algo, "--midi", "tune.mid", "--config", "none.yml"],
        ["train", "--resume", str(run)],
        ["tune", "--algo", algo, "--midi", "tune.mid"],
    ]
    before = sorted(run.rglob("*"))
    for command in commands:
        assert main(command) == 2
        error = capsys.readouterr().err
        told = f"Algorithm {algo!r} is not trained, it plays at once: expected 'sb3-piano plan'"
        assert told in error
    assert sorted(run.rglob("*")) == before
    assert not caplog.records  # nothing was begun
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"samples": 2}, "Unknown key 'samples' of PlannedPianist"),
        ({"algo": "td3"}, "algo is 'td3': expected one of 'planned', 'sampling'"),
        ({"settings": {"hovr": 1}}, "Unknown key 'hovr' of PlanSettings. Did you mean 'hover'"),
        ({"settings": {"hover": "high"}}, "hover is 'high': expected a finite number"),
        ({"settings": 3}, "settings is 3: expected a mapping"),
    ],
)
def test_arguments_of_a_planner_are_checked(arguments, message):
    with pytest.raises(ConfigError, match=message):
        planner_config("tune.mid", **arguments)


def test_a_planned_run_has_no_best_model():
    with pytest.raises(RunError, match="has no best model by 'f1'"):
        evaluate(zero_run().path, best="f1")


@pytest.mark.slow
def test_notes_that_cannot_be_played_are_told_once_and_in_words(capsys, recwarn):
    assert main(["plan", "wide.mid", "--set", "physics=fast", "--out", "run"]) == 0
    told = "sb3-piano: warning: 1 note cannot be played as written"
    assert capsys.readouterr().err.count(told) == 1
    shutil.copytree("run", "again")
    assert main(["evaluate", "run", "again"]) == 0
    error = capsys.readouterr().err
    assert error.count(told) == 1
    assert "C4 (pitch 60) at 0.50 s, right thumb: left out by the hand, which plays C6" in error
    assert not [warning for warning in recwarn if warning.category is PlanWarning]


@pytest.mark.slow
def test_the_policy_of_stable_baselines_judges_it_like_a_model(pianist, expected):
    mean, deviation = evaluate_policy(pianist, pianist.get_env(), n_eval_episodes=2)
    assert mean == pytest.approx(expected["return"], abs=1e-3)
    assert deviation == 0


@pytest.mark.slow
@pytest.mark.parametrize("own", [True, False], ids=["a copy of its own", "the pianist's"])
def test_callbacks_evaluate_it_like_a_model(own, pianist, expected):
    callback = F1Callback(
        None if own else pianist.get_env(), eval_freq=1, stop_threshold=expected["f1"] - 1e-6
    )
    callback.init_callback(pianist)
    assert callback.on_step() is False  # it is that good
    assert callback.last_mean_reward == pytest.approx(expected["f1"])


needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

# Without fingers.
PLAIN = score_of((0.0, 0.4, 76), (0.0, 0.4, 48), (0.45, 0.8, 77), title="plain")
ZERO_OPTIONS = ["--sampling", "2", "--nominal", "none", "--horizon", "2"]


@pytest.mark.slow
@needs_gl
def test_a_midi_file_becomes_a_video_with_sound(capsys):
    command = ["play", "--planned", "plain.mid", "--physics", "fast", "--size", "64x48"]
    assert main(command) == 0
    out, error = capsys.readouterr()
    f1, precision, recall, nothing, onset_f1 = map(float, re.findall(r"\d\.\d{3}", out))
    assert f1 > 0.8 > nothing
    assert precision + recall > 1.6
    assert 0 <= onset_f1 <= 1
    assert re.search(r"Planned in \d+\.\d s, 1\.4 s of music played in \d+\.\d s", out)
    folder = Path("play/plain-planned")
    assert f"Video: {folder / 'performance.mp4'}" in out
    played = read_midi(folder / "performance.mid")
    assert {note.pitch for note in played.notes} == {48, 76, 77}
    with av.open(str(folder / "performance.mp4")) as video:
        assert (len(video.streams.video), len(video.streams.audio)) == (1, 1)
    assert error.strip() == ""


@pytest.mark.slow
def test_what_is_left_out_of_a_file_is_told_in_words(capsys):
    music = pretty_midi.PrettyMIDI()
    music.instruments.append(pretty_midi.Instrument(program=0))
    for pitch in (60, 120):  # the piano ends at 108
        music.instruments[0].notes.append(pretty_midi.Note(80, pitch, 0.0, 0.5))
    music.write("high.mid")
    command = ["play", "high.mid", "--planned", "--no-video", "--physics", "fast"]
    assert main([*command, "--no-progress"]) == 0
    error = capsys.readouterr().err
    told = "sb3-piano: warning: Reading 'high.mid' left out 1 note off the keyboard (C9 at 0 s)."
    assert error.strip() == told


def test_all_joints_play_unless_the_reduced_action_space_is_asked_for(monkeypatch):
    widths = []

    def noted(config, on_step, **options):
        played = take_of_planner(config, on_step, **options)
        widths.append(played.take.scene.model.nu)
        return played

    monkeypatch.setattr("sb3_piano.training.playing.takes.take_of_planner", noted)
    command = ["play", "--planned", "plain.mid", "--no-video", "--physics", "fast", *ZERO_OPTIONS]
    assert main(command) == main([*command, "--reduced"]) == 0
    assert widths == [44, 38]


def test_the_listener_hears_of_planning_and_of_every_step():
    calls = []
    arguments = {"samples": 1, "horizon": 1, "nominal": "none"}
    config = planner_config("plain.mid", "sampling", env_kwargs={"physics": "fast"}, **arguments)
    played = take_of_planner(config, lambda done, total: calls.append((done, total)))
    steps = len(played.take.performance.roll)
    assert calls == [(step, steps) for step in range(steps + 1)]
    assert played.metrics["length"] == steps
    # Half a second to get to the first note, and a finger for each note.
    roll = played.take.performance.roll
    assert not roll.active[:10].any()
    assert roll.active[10].sum() == 2
    assert (roll.finger[roll.active] >= 0).all()
    assert len(played.take.qpos) == steps + 1
    assert played.score.title == "plain"
    assert min(played.planning, played.playing) > 0


@pytest.mark.slow
def test_a_refined_run_keeps_its_plan_plays_it_and_goes_on(capsys):
    assert main(["plan", "leap.mid", *SHORTLY, "--set", "physics=fast", "--out", "run"]) == 0
    told = capsys.readouterr().out
    found = re.search(r"F1 ([\d.]+) before, ([\d.]+) after 1 pass,", told)
    assert found is not None
    before, f1 = map(float, found.groups())
    assert f1 >= before
    shutil.move("run", "moved")
    config = RunFolder.open("moved").read_config()
    assert config.algorithm_kwargs["plan"] == str(Path("moved", "plan.npz"))
    with SavedPlayer.open("moved") as player:
        (recording,) = player.play()
    assert recording.metrics["f1"] == pytest.approx(f1, abs=5e-4)
    assert main(["plan", "moved", *SHORTLY]) == 0
    told = capsys.readouterr().out
    assert f"F1 {f1:.3f} before" in told
    f1 = float(told.partition("before, ")[2].split()[0])
    play = ["play", "leap.mid", "--planned", "--physics", "fast", "--no-video"]
    assert main([*play, "--plan", "moved/plan.npz"]) == 0
    assert f"F1 {f1:.3f}" in capsys.readouterr().out
    # A single sample is the plan itself; the run of sampling has its own copy of it.
    sample = ["plan", "leap.mid", "--sampling", "1", "--horizon", "1", "--set", "physics=fast"]
    assert main([*sample, "--plan", "moved/plan.npz", "--out", "sampled"]) == 0
    shutil.rmtree("moved")
    with SavedPlayer.open("sampled") as player:
        (recording,) = player.play()
    assert recording.metrics["f1"] == pytest.approx(f1, abs=5e-4)


@pytest.mark.slow
def test_ctrl_c_ends_a_refinement_and_keeps_the_best_so_far(monkeypatch, capsys):
    search = Refinement._search

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        return search(*given)

    monkeypatch.setattr(Refinement, "_search", interrupted)
    command = ["plan", "leap.mid", "--refine", "60", "--set", "physics=fast", "--out", "run"]
    assert main(command) == 130
    assert "interrupted: the best plan so far is kept" in capsys.readouterr().err
    assert RunFolder.open("run").plan_file.is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["leap.mid", "--refine", "5", "--sampling", "8"],
            "--refine cannot be given to the player",
        ),
        (["folder"], "'folder' is a folder: expected a piece, or --refine MINUTES"),
        (["folder", "--refine", "5"], "'folder' is no run"),
        (["folder", "--refine", "5", "--out", "x"], "--out cannot be given with the run 'folder'"),
    ],
)
def test_what_cannot_be_refined_is_told(arguments, message, capsys):
    Path("folder").mkdir()
    assert main(["plan", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("minutes", ["0", "-1", "soon", "inf", "nan"])
def test_a_time_for_refinement_is_above_0(minutes, capsys):
    with pytest.raises(SystemExit):
        main(["plan", "leap.mid", "--refine", minutes])
    assert "is no number of minutes above 0" in capsys.readouterr().err
