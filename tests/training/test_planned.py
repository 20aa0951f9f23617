"""What plays without training, by every command, and plans in files."""

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
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.callbacks import F1Callback
from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning, RunError
from sb3_piano.music import write_midi
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.planning import PlanSettings, Refinement
from sb3_piano.planning.plan_file import settings_of_plan
from sb3_piano.planning.sampling import SamplingNoise
from sb3_piano.players import PLAYERS, PlayerSpec
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.training import OpenPlayer, evaluate
from sb3_piano.training.playing.player import PLANNED_IN
from sb3_piano.training.playing.takes import take_of

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
    with OpenPlayer.open("planned", score=path, physics="fast") as player:
        return dict(player.play()[0].metrics)


ZERO_SPEC = PlayerSpec(name="sampling", arguments=ZERO)


@pytest.fixture
def former():
    """Return a function that writes the folder that version 0.2 made for a player."""

    def write(folder="former", algo="planned", **arguments):
        Path(folder).mkdir()
        shutil.copy("tune.mid", Path(folder, "score.mid"))
        played = {**PLANNED_IN, **FAST, "score": "score.mid"}
        settings = {"algo": algo, "env_kwargs": played, "algorithm_kwargs": arguments, "seed": 0}
        settings |= {"env_id": "RoboPianist-v0", "env_module": None, "env_wrapper": []}
        Path(folder, "config.yml").write_text(yaml.safe_dump(settings))
        return folder

    return write


@pytest.mark.slow
def test_a_player_is_evaluated_compared_and_reported(capsys, piano_run, expected):
    player = ["planned", "--pieces", "tune.mid", "--physics", "fast"]
    assert main(["evaluate", *player, "--json", "planned.json"]) == 0
    assert "tune: 1 episode, model after 0 steps of training" in capsys.readouterr().out
    [found] = json.loads(Path("planned.json").read_text())["evaluations"]
    assert found["mean"] == pytest.approx(expected, nan_ok=True)
    assert found["mean"]["f1"] > 0.8 > found["baseline"]["f1"]
    assert (found["run"], found["training_seed"]) == ("planned", None)

    trained = piano_run(np.zeros(39, dtype=np.float32), name="trained", score="tune.mid")
    assert main(["evaluate", str(trained.path)]) == 0
    compared = ["compare", str(trained.path), "planned.json", "--metric", "f1"]
    assert main([*compared, "--json", "c.json"]) == 0
    [pair] = json.loads(Path("c.json").read_text())["metrics"]["f1"]["pairs"]
    assert (pair["piece"], pair["b"]) == ("tune", found["mean"]["f1"])

    assert main(["report", "tune.mid", "--player", "planned", "--physics", "fast"]) == 0
    assert "PLANNED · fast physics" in Path("play/tune-planned/report.html").read_text()


@pytest.mark.slow
def test_the_folder_of_a_player_of_version_0_2_plays_as_before(former, expected, capsys):
    folder = former("once")
    shutil.move(folder, "moved")
    assert evaluate("moved").mean == pytest.approx(expected, nan_ok=True)
    write_midi(TUNE.transpose(-2), "lower.mid")
    found = evaluate("moved", score="lower.mid")
    assert (found.piece, found.mean["f1"] > 0.8) == ("lower", True)
    assert main(["play", "moved", "--no-video"]) == 0
    with pytest.raises(RunError, match="'planned' has no best model by 'f1'"):
        evaluate("moved", best="f1")
    for command in (["train", "--resume", "moved"], ["export", "moved", "shared"]):
        assert main(command) == 2
        assert "not trained" in capsys.readouterr().err


def test_a_folder_of_version_0_2_keeps_what_was_chosen(former):
    settings = {"hover": 0.02, "rounds": 3}
    folder = former(algo="sampling", noise={"finger": 0.3, "knots": 4}, **ZERO)
    with OpenPlayer.open(folder, seed=4) as player:
        assert player.env.action_space.shape == (45,)
        sampler = player.model
        assert (sampler._samples, sampler._horizon, sampler._planned) == (2, 2, False)
        assert sampler._noise == SamplingNoise(finger=0.3, knots=4)
        drawn = np.random.default_rng(np.random.SeedSequence(4).spawn(1)[0])
        assert sampler._random[0].bit_generator.state == drawn.bit_generator.state
    with OpenPlayer.open(former("other", settings=settings)) as player:
        assert player.model.settings == PlanSettings(**settings)


@pytest.mark.slow
def test_an_episode_comes_from_its_seed_whatever_was_played_before():
    both = evaluate(ZERO_SPEC, 1, (0, 1), score="tune.mid", physics="fast")
    alone = evaluate(ZERO_SPEC, 1, 1, score="tune.mid", physics="fast")
    assert both.episodes[1] == alone.episodes[0]
    assert both.episodes[0] != both.episodes[1]


@pytest.mark.parametrize("algo", PLAYERS)
def test_what_is_not_trained_is_told_so_in_one_way(algo, former, capsys, caplog):
    run = Path(former("run", algo))
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
        assert "is not trained" in error
        assert repr(algo) in error
    assert sorted(run.rglob("*")) == before
    assert not caplog.records  # nothing was begun
    assert not Path("runs").exists()


@pytest.mark.slow
def test_notes_that_cannot_be_played_are_told_once_and_in_words(capsys, recwarn):
    told = "sb3-piano: warning: 1 note cannot be played as written"
    twice = ["planned", "planned:feedback=0.9", "--pieces", "wide.mid", "--physics", "fast"]
    assert main(["evaluate", *twice]) == 0
    error = capsys.readouterr().err
    assert error.count(told) == 1
    assert "C4 (pitch 60) at 0.50 s, right thumb: left out by the hand, which plays C6" in error
    assert not [warning for warning in recwarn if warning.category is PlanWarning]


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
    command = "play --planned plain.mid --physics fast --size 80x46 --view top"
    assert main(command.split()) == 0
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
        size = video.streams.video[0].codec_context
        assert (size.width, size.height) == (80, 46)
    assert error.strip() == ""


def test_what_is_left_out_of_a_file_is_told_in_words(capsys):
    music = pretty_midi.PrettyMIDI()
    music.instruments.append(pretty_midi.Instrument(program=0))
    for pitch in (60, 120):  # the piano ends at 108
        music.instruments[0].notes.append(pretty_midi.Note(80, pitch, 0.0, 0.5))
    music.write("high.mid")
    command = ["play", "high.mid", "--player", "score", "--no-video", "--physics", "fast"]
    assert main([*command, "--no-progress"]) == 0
    error = capsys.readouterr().err
    told = "sb3-piano: warning: Reading 'high.mid' left out 1 note off the keyboard (C9 at 0 s)."
    assert error.strip() == told


def test_all_joints_play_unless_the_reduced_action_space_is_asked_for(monkeypatch):
    widths = []

    def noted(player, on_step):
        take = take_of(player, on_step)
        widths.append(take.scene.model.nu)
        return take

    monkeypatch.setattr("sb3_piano.training.playing.takes.take_of", noted)
    command = ["play", "--planned", "plain.mid", "--no-video", "--physics", "fast", *ZERO_OPTIONS]
    for reduced in ([], ["--reduced"], ["--set", "reduced_action_space=true"]):
        assert main([*command, *reduced]) == 0
    assert widths == [44, 38, 38]


def f1_of(told):
    return float(told.partition("before, ")[2].split()[0])


@pytest.mark.slow
def test_a_refined_plan_is_kept_played_and_gone_on_with(capsys):
    plan = ["plan", "leap.mid", *SHORTLY, "--set", "physics=fast", "--out", "leap.npz"]
    assert main(plan) == 0
    told = capsys.readouterr().out
    found = re.search(r"F1 ([\d.]+) before, ([\d.]+) after 1 pass", told)
    assert found is not None
    before, f1 = map(float, found.groups())
    assert f1 >= before
    assert main(plan) == 0
    told = capsys.readouterr().out
    assert f"F1 {f1:.3f} before" in told
    f1 = f1_of(told)
    for player in ("planned:", "sampling:samples=1,horizon=1,"):  # one sample is the plan itself
        play = ["play", "leap.mid", "--player", f"{player}plan=leap.npz", "--physics", "fast"]
        assert main([*play, "--no-video"]) == 0
        assert f"F1 {f1:.3f}" in capsys.readouterr().out
    assert main([*play[:2], "--planned", "--plan", "leap.npz", *play[4:], "--no-video"]) == 0
    assert f"F1 {f1:.3f}" in capsys.readouterr().out
    assert main(["plan", "tune.mid", "--set", "physics=fast", "--out", "leap.npz"]) == 2
    assert "is of another piece" in capsys.readouterr().err


@pytest.mark.slow
def test_a_plan_without_refinement_lies_with_the_piece_s_takes(capsys):
    assert main(["plan", "tune.mid", "--set", "physics=fast"]) == 0
    out = capsys.readouterr().out
    assert "tune: planned in" in out
    assert "sb3-piano play tune.mid --player planned:plan=play/tune-planned/plan.npz" in out
    assert settings_of_plan("play/tune-planned/plan.npz") == PlanSettings()


@pytest.mark.slow
def test_ctrl_c_ends_a_refinement_and_keeps_the_best_so_far(monkeypatch, capsys):
    search = Refinement._search

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        return search(*given)

    monkeypatch.setattr(Refinement, "_search", interrupted)
    command = ["plan", "leap.mid", "--refine", "60", "--set", "physics=fast", "--out", "leap.npz"]
    assert main(command) == 130
    assert "interrupted: the best plan so far is kept" in capsys.readouterr().err
    assert Path("leap.npz").is_file()
