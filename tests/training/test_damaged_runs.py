"""Runs of which a file beside the model is damaged: one clear error, or no difference."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from stable_baselines3.common.running_mean_std import RunningMeanStd

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.training import SavedPlayer, evaluate


def variants_of(content, count):
    """Return contents that are cut off, or have a changed byte, at many places."""
    places = np.linspace(0, len(content) - 1, count).astype(int)
    changed = [content[:at] + bytes([content[at] ^ 0x41]) + content[at + 1 :] for at in places]
    return [content[:end] for end in places], changed


@pytest.fixture
def normalized_run(pendulum_run):
    """Train a tiny run with normalisation."""
    return pendulum_run(normalize=True)


def test_damaged_statistics_end_in_one_line_that_names_the_file(normalized_run):
    file = normalized_run.path / "vecnormalize.pkl"
    content = file.read_bytes()
    cut, changed = variants_of(content, 60)
    for variant in cut:
        file.write_bytes(variant)
        check_refused(normalized_run)
    for variant in changed:  # of which some give other numbers, or none that are used
        file.write_bytes(variant)
        line = told(RunError, lambda: play(normalized_run))
        assert line is None or "vecnormalize.pkl' cannot be loaded" in line


@pytest.mark.parametrize(
    "other", [3, None, [1.0], {"obs_rms": 1}, np.zeros(3), RunningMeanStd(shape=(3,)), ValueError]
)
def test_a_pickle_of_something_else_is_no_statistics(normalized_run, other):
    (normalized_run.path / "vecnormalize.pkl").write_bytes(pickle.dumps(other))
    check_refused(normalized_run)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mean", np.zeros(4)),
        ("mean", np.full(3, np.nan)),
        ("var", -np.ones(3)),
        ("var", "large"),
        ("count", np.inf),
    ],
)
def test_statistics_that_cannot_be_are_refused(normalized_run, field, value):
    file = normalized_run.path / "vecnormalize.pkl"
    with SavedPlayer.open(normalized_run.path) as player:
        normalizer = player.model.get_vec_normalize_env()
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


@pytest.mark.parametrize("content", [b"\xff\xfe\x00c", b"seed: [", b"- 1", b"a: " + b"1" * 5000])
def test_a_run_with_a_damaged_origin_plays_and_one_with_damaged_settings_does_not(
    piano_run, content, capsys
):
    run = piano_run(np.zeros(39), physics="fast")
    run.provenance_file.write_bytes(content)
    with SavedPlayer.open(run.path) as player:
        assert player.piece == "score"
    assert main(["report", str(run.path)]) == 0
    run.config_file.write_bytes(content)
    with pytest.raises(ConfigError, match="config.yml"):
        evaluate(run.path)
    capsys.readouterr()
    assert main(["evaluate", str(run.path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def play(run):
    with SavedPlayer.open(run.path) as player:
        player.play()


def told(kind, call):
    """Return what the error says that a call ends in, if it is one of a kind."""
    try:
        call()
    except kind as error:
        return str(error)
    return None


def check_refused(run):
    line = told(RunError, lambda: play(run))
    assert "vecnormalize.pkl' cannot be loaded" in line
    assert "expected those of VecNormalize for 'Pendulum-v1'" in line
    assert "\n" not in line
