"""Saved models, statistics and weights: shared as plain files, damaged, of something else."""

from __future__ import annotations

import copy
import pickle
import sys

import numpy as np
import pytest
from damage import told, variants_of
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import RunError
from sb3_piano.training import OpenPlayer, evaluate, resume
from sb3_piano.training.configuration.names import ALGORITHMS
from sb3_piano.training.playing.player_files import write_player
from sb3_piano.training.runs.saved import model_files

_unpickled: list[str] = []
_hook_is_set: list[bool] = []


@pytest.fixture
def unpickled():
    """A list of what is unpickled during the test: every class and function, in any way."""

    def notice(event, arguments):
        if event == "pickle.find_class":
            _unpickled.append(".".join(arguments))

    if not _hook_is_set:  # a hook can never be taken away
        sys.addaudithook(notice)
        _hook_is_set.append(True)
    _unpickled.clear()
    return _unpickled


def played(folder, seed=3):
    with OpenPlayer.open(folder, seed=seed) as player:
        (recording,) = player.play()
        return recording.metrics, player.num_timesteps


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_shared_run_plays_the_same_to_the_last_bit_without_unpickling(
    pendulum_run, tmp_path, algo, unpickled
):
    run = pendulum_run(algo=algo, n_timesteps=24, n_envs=2, normalize=True)
    unpickled.clear()
    expected = played(run.path)
    assert unpickled, "the hook notices what a run unpickles"
    shared = write_player(run.path, tmp_path / "shared")
    names = {file.name for file in shared.path.iterdir()}
    assert names == {"config.yml", "run.yml", "policy.safetensors"}
    unpickled.clear()
    assert played(shared.path) == expected
    assert unpickled == []


@pytest.mark.slow
def test_a_shared_piano_is_evaluated_reported_and_played(piano_run, tmp_path, unpickled, capsys):
    run = piano_run(np.linspace(-0.5, 0.5, 39), physics="fast")
    place = tmp_path / "for a friend"
    assert main(["export", str(run.path), str(place), "--no-video", "--episodes", "1"]) == 0
    assert "Evaluate: sb3-piano evaluate '" in capsys.readouterr().out
    expected = evaluate(run.path, seed=3)
    unpickled.clear()
    found = evaluate(place, seed=3)
    assert (found.episodes, found.piece) == (expected.episodes, "duet")
    assert main(["report", str(place)]) == 0
    assert main(["play", str(place), "--no-video", "--no-progress"]) == 0
    assert main(["compare", str(run.path), str(place)]) == 0
    assert unpickled == []
    (place / "model.zip").write_bytes((run.path / "model.zip").read_bytes())
    evaluate(place)
    assert unpickled == [], "a pickle beside the weights is left alone"


def test_a_shared_run_cannot_be_trained_on_and_has_one_model_of_its_settings(
    pendulum_run, tmp_path
):
    shared = write_player(pendulum_run().path, tmp_path / "shared")
    with pytest.raises(RunError, match="exported to be played, without what training needs"):
        resume(shared.path)
    with pytest.raises(RunError, match="was exported with one model, and has no best one by 'f1'"):
        evaluate(shared.path, best="f1")
    with pytest.raises(RunError, match="holds a run already"):
        write_player(shared.path, shared.path)
    config = shared.read_config()
    for change, message in (  # or of another model
        ({"algorithm_kwargs": {"policy_kwargs": {"net_arch": [9]}}}, "do not fit .*size mismatch"),
        ({"algo": "sac"}, "its algo is 'td3', not 'sac'"),
        ({"normalize": True}, "it has no statistics, not normalization.returns.mean"),
    ):
        shared.write_config(type(config)(**{**config.to_mapping(), **change}))
        with pytest.raises(RunError, match=message):
            evaluate(shared.path)


@pytest.mark.slow
def test_damaged_weights_are_refused_or_harmless(pendulum_run, tmp_path):
    shared = write_player(pendulum_run(normalize=True).path, tmp_path / "shared")
    file, expected = shared.path / "policy.safetensors", played(shared.path)
    content = file.read_bytes()
    cut, changed = variants_of(content, 40)
    refused, found = 0, []
    for variant in [*cut, *changed, b"\x80\x04.", b"null", content * 2]:
        file.write_bytes(variant)
        line = told(RunError, lambda: found.append(played(shared.path)))
        if line is None:
            assert found[-1] == expected
        else:
            refused += 1
            assert "policy.safetensors' cannot be loaded" in line
            assert "\n" not in line
    assert refused >= len(cut) + len(changed)


def test_an_interruption_leaves_no_folder_and_one_that_cannot_be_written_is_told(
    pendulum_run, tmp_path, monkeypatch
):
    def ctrl_c(*arguments):
        raise KeyboardInterrupt

    run = pendulum_run()
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="cannot be written"):
        write_player(run.path, tmp_path / "file" / "shared")
    monkeypatch.setattr("sb3_piano.training.playing.player_files.pack_weights", ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        write_player(run.path, tmp_path / "shared")
    assert not (tmp_path / "shared").exists()


def test_the_help_says_what_loading_a_run_may_do(capsys):
    for command in ("evaluate", "play", "report", "train", "record", "clone"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        assert "Trust: a run's model.zip is a Python pickle" in " ".join(
            capsys.readouterr().out.split()
        )


@pytest.fixture
def normalized_run(pendulum_run):
    """Train a tiny run with normalisation."""
    return pendulum_run(normalize=True)


def test_damaged_statistics_end_in_one_line_that_names_the_file(normalized_run):
    file = normalized_run.path / "vecnormalize.pkl"
    content = file.read_bytes()
    cut, changed = variants_of(content, 10)
    for variant in cut:
        file.write_bytes(variant)
        check_refused(normalized_run)
    for variant in changed:  # of which some give other numbers, or none that are used
        file.write_bytes(variant)
        line = told(RunError, lambda: play(normalized_run))
        assert line is None or "vecnormalize.pkl' cannot be loaded" in line


def test_a_model_and_statistics_of_two_checkpoints_are_mended_or_refused(normalized_run):
    file = normalized_run.path / "vecnormalize.pkl"
    with OpenPlayer.open(normalized_run.path) as player:
        normalizer = player.model.get_vec_normalize_env()
    normalizer.saved_after_timesteps = 20
    normalizer.save(str(file))  # as after a kill between the two
    newest = Checkpoint.read(normalized_run.checkpoint_dir)
    found = model_files(normalized_run, normalized_run.read_config())
    assert [path.name for path in found] == [newest.model, newest.vec_normalize]
    (normalized_run.checkpoint_dir / "checkpoint.json").unlink()
    with pytest.raises(RunError, match="saved after different numbers of steps"):
        evaluate(normalized_run.path)
    del normalizer.saved_after_timesteps  # as it was saved before there were any
    normalizer.save(str(file))
    assert evaluate(normalized_run.path, 1).num_timesteps == 30


def test_a_pickle_of_something_else_and_statistics_that_cannot_be_are_refused(normalized_run):
    file = normalized_run.path / "vecnormalize.pkl"
    with OpenPlayer.open(normalized_run.path) as player:
        normalizer = player.model.get_vec_normalize_env()
    right = copy.deepcopy(normalizer.obs_rms)
    for other in (3, None, [1.0], {"obs_rms": 1}, np.zeros(3), right, ValueError):
        file.write_bytes(pickle.dumps(other))
        check_refused(normalized_run)
    for field, value in Tables(__file__)["statistics_that_cannot_be"]:
        normalizer.obs_rms = copy.deepcopy(right)
        value = np.array(value, float) if isinstance(value, list) else value
        setattr(normalizer.obs_rms, field, value)
        normalizer.save(str(file))
        check_refused(normalized_run)


def test_a_damaged_model_is_an_error(pendulum_run):
    run = pendulum_run()
    content = run.model_file.read_bytes()
    cut, changed = variants_of(content, 12)
    for variant in [*cut, *changed]:
        run.model_file.write_bytes(variant)
        line = told(RunError, lambda: play(run))
        assert line is None or "model.zip' cannot be loaded" in line


def test_a_run_with_a_damaged_origin_plays_and_one_with_damaged_settings_does_not(
    piano_run, capsys
):
    run = piano_run(np.zeros(39), physics="fast")
    damaged = (b"\xff\xfe\x00c", b"seed: [", b"- 1", b"a: " + b"1" * 5000)
    for content in damaged:
        run.provenance_file.write_bytes(content)
        with OpenPlayer.open(run.path) as player:
            assert player.piece == "score"
    assert main(["report", str(run.path)]) == 0
    for content in damaged:
        run.config_file.write_bytes(content)
        capsys.readouterr()
        assert main(["evaluate", str(run.path)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "config.yml" in line


def play(run):
    with OpenPlayer.open(run.path) as player:
        player.play()


def check_refused(run):
    line = told(RunError, lambda: play(run))
    assert "vecnormalize.pkl' cannot be loaded" in line
    assert "expected those of VecNormalize for 'Pendulum-v1'" in line
    assert "\n" not in line
