"""Several pieces in one training: one for each environment, or drawn for each episode."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint, F1Callback
from sb3_piano.callbacks.replay_segments import restore_replay_buffer
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, find_piece, load_score, select_pieces, write_midi
from sb3_piano.training import (
    RunConfig,
    compare,
    evaluate,
    export_run,
    resume,
    train,
)
from sb3_piano.training.evaluation.evaluate import evaluate_runs
from sb3_piano.training.runs.builders import build_model, build_vec_env

tables = Tables(__file__)

PIANO = "RoboPianist-v0"
KEY_RANGE = "sb3_piano.wrappers.KeyRange"
CYCLING = "importlib.import_module('sb3_piano.buffers').CyclingReplayBuffer"


@pytest.fixture
def corpus(tmp_path):
    """A folder with files 60.mid, 62.mid and 64.mid, of one key and of other lengths."""
    folder = tmp_path / "corpus"
    folder.mkdir()
    for index, pitch in enumerate((60, 62, 64)):
        notes = [Note(onset=0.0, offset=0.4 + 0.1 * index, pitch=pitch, finger=0)]
        write_midi(Score(notes=notes), folder / f"{pitch}.mid")
    return folder


@pytest.fixture
def config(small_config, corpus):
    """Return a function that makes settings of a tiny SAC that plays the corpus."""

    def make(**changes):
        options = {"buffer_size": 300, **changes.pop("algorithm_kwargs", {})}
        settings = {"algo": "sac", "env_id": PIANO, "n_timesteps": 60, "algorithm_kwargs": options}
        played = {"physics": "fast", "n_steps_lookahead": 0}
        own = {"pieces": str(corpus / "*.mid"), "env_kwargs": played, **changes}
        return small_config(**{**settings, **own})

    return make


def played(config, episodes=12):
    """Return the titles that each environment of a run plays."""
    with contextlib.closing(build_vec_env(config)) as venv:
        titles = []
        for _ in range(episodes):
            venv.reset()
            titles.append([score.title for score in venv.get_attr("score")])
    return list(map(set, zip(*titles, strict=True)))


@tables("changes, episodes, expected")
def test_each_environment_plays_the_pieces_that_it_is_dealt(config, changes, episodes, expected):
    assert list(map(sorted, played(config(**changes), episodes))) == expected


def test_what_was_chosen_of_studies_is_true_of_all_of_them_and_not_told_to_files(config, corpus):
    names = ["60", "hanon-01", "hanon-02", "scale-CMajor"]
    options = {"tempo": 90, "octaves": 1, "hands": "right", "hands_in_scene": "right"}
    pieces = [str(corpus / "60.mid"), *names[1:]]
    settings = config(pieces=pieces, env_kwargs={"physics": "fast", **options}, n_envs=4)
    lengths = {}
    for own in (settings, dataclasses.replace(settings, n_envs=1), settings.alone()):
        with contextlib.closing(build_vec_env(own)) as venv:
            for _ in range(16):
                venv.reset()
                for score in venv.get_attr("score"):
                    lengths.setdefault(score.title, set()).add((score.duration, len(score.notes)))
    assert sorted(lengths) == names
    assert all(len(found) == 1 for found in lengths.values())
    plain = find_piece("hanon-01").score(hands="right", octaves=1, tempo=90)
    assert lengths["hanon-01"] == {(plain.duration, len(plain.notes))}
    with pytest.raises(ConfigError, match="Unknown option 'temp'"):
        build_vec_env(config(pieces=pieces, env_kwargs={"temp": 240}))


def test_an_environment_of_its_own_draws_from_all_pieces(config):
    for own in (config(n_envs=3), config(n_envs=3).alone()):
        with contextlib.closing(own.env.make()) as env:
            titles = set()
            for seed in range(12):
                env.reset(seed=seed)
                titles.add(env.unwrapped.score.title)
        assert titles == {"60", "62", "64"}


class Played(F1Callback):
    """Notes down what is played in evaluations."""

    titles: ClassVar[list[list[str]]] = []

    def _on_step(self):
        self.titles.append([])
        return super()._on_step()

    def _log_success_callback(self, locals_, globals_):
        if locals_["current_lengths"][0] == 1:
            self.titles[-1] += [score.title for score in self.eval_env.get_attr("score")]
        super()._log_success_callback(locals_, globals_)


@pytest.mark.parametrize(("n_envs", "wrapped"), [(1, True), (3, False)])
def test_an_evaluation_plays_each_piece_once(config, corpus, tmp_path, n_envs, wrapped):
    Played.titles.clear()
    pieces = str(corpus / "*.mid")
    choice = {"sb3_piano.wrappers.RandomPiece": {"pieces": pieces}}
    others = {"pieces": (), "env_wrapper": [choice]} if wrapped else {"pieces": pieces}
    if wrapped:
        others["env_kwargs"] = {**config().env_kwargs, "score": str(corpus / "60.mid")}
    train(
        config(n_envs=n_envs, n_timesteps=2 * n_envs, **others),
        tmp_path / "run",
        callbacks=[Played(eval_freq=1)],
        progress_bar=False,
    )
    assert Played.titles == [["60", "62", "64"]] * 2


def test_a_run_keeps_its_pieces_by_name_and_file(config, corpus):
    mapping = config(pieces=["scale-*Major", corpus / "60.mid"]).to_mapping()
    expected = [*select_pieces("scale-*Major"), str(corpus / "60.mid")]
    assert mapping["pieces"] == expected
    assert RunConfig(**yaml.safe_load(yaml.safe_dump(mapping))).pieces == tuple(expected)


@tables("changes, message")
def test_pieces_that_cannot_be_played_are_refused(config, changes, message):
    with pytest.raises(ConfigError, match=message):
        config(**changes)


SCALES = ["debug-CMajorScaleOneHand", "debug-DMajorScaleOneHand"]


@tables("changes, message")
def test_observations_that_differ_by_piece_are_refused(config, changes, message):
    with pytest.raises(ConfigError, match=message):
        build_vec_env(config(n_envs=2, env_wrapper={KEY_RANGE: {"keys": "piece"}}, **changes))


@pytest.mark.slow
def test_a_resumed_training_goes_on_with_the_buffers_of_all_pieces(config, tmp_path):
    own = config(n_envs=3, algorithm_kwargs={"replay_buffer_class": CYCLING, "gradient_steps": -1})
    run = train(own, tmp_path / "run", progress_bar=False).folder
    before = Checkpoint.read(run.checkpoint_dir)
    assert before.replay.n_envs == 3
    assert before.replay.total == 20
    result = resume(run.path, 120, progress_bar=False)
    assert result.num_timesteps == 120
    after = Checkpoint.read(run.checkpoint_dir)
    assert after.replay.total == 40
    with contextlib.closing(build_vec_env(own)) as venv:
        buffer = build_model(own, venv).replay_buffer
    restore_replay_buffer(buffer, run.checkpoint_dir, after.replay)
    assert buffer.size() == 40
    goals = [buffer.observations[np.arange(40), np.full(40, env)][:, :88] for env in range(3)]
    keys = [set(np.flatnonzero(goal.any(axis=0))) for goal in goals]
    assert keys == [{60 - 21}, {62 - 21}, {64 - 21}]


@pytest.fixture
def run(config, tmp_path):
    """The folder of a run of three pieces, after 4 steps."""
    return train(config(n_timesteps=4), tmp_path / "run", progress_bar=False).folder


@pytest.mark.slow
def test_an_exported_run_has_copies_of_its_pieces(config, corpus, tmp_path):
    write_midi(load_score(corpus / "62.mid"), tmp_path / "mine.mid")
    assert main(["pieces", "import", str(tmp_path / "mine.mid")]) == 0
    pieces = [str(corpus / "60.mid"), "scale-CMajor", "mine"]
    options = {"physics": "fast", "tempo": 240, "octaves": 1}
    settings = config(pieces=pieces, env_kwargs=options, n_timesteps=4)
    run = train(settings, tmp_path / "run", progress_bar=False).folder
    expected = evaluate(run.path)
    # A study is judged as it was trained.
    length = find_piece("scale-CMajor").score(tempo=240, octaves=1).duration
    judged = expected.by_piece[1].episodes[0]["length"]
    assert judged == pytest.approx(length / 0.05, abs=2)
    made = export_run(run.path, tmp_path / "made", episodes=2, picture=None)
    card = made.card_file.read_text()
    assert f"| F1 | {expected.mean['f1']:.4f} |" in card
    assert "2 episodes, seeds 0 1 on each of 3 pieces" in card
    assert "--seeds 0 1\n" in card
    shutil.move(tmp_path / "made", tmp_path / "exported")
    for file in corpus.iterdir():
        file.unlink()
    assert main(["pieces", "remove", "mine"]) == 0
    found = evaluate(tmp_path / "exported")
    assert [one.piece for one in found.by_piece] == ["60", "scale-CMajor", "mine"]
    assert [one.mean for one in found.by_piece] == [one.mean for one in expected.by_piece]


@pytest.mark.slow
def test_a_run_is_judged_by_the_mean_over_its_pieces(run, corpus):
    found = evaluate(run.path, 2)
    pieces = [corpus / f"{pitch}.mid" for pitch in (60, 62, 64)]
    each = tuple(evaluate(run.path, 2, score=piece) for piece in pieces)
    assert found.by_piece == evaluate_runs([run.path], 2).evaluations
    without = {"performances": (), "metrics_file": None}
    assert tuple(dataclasses.replace(one, **without) for one in found.by_piece) == each
    assert found.piece == "3 pieces"
    assert found.episode_seeds == (0,) * 6
    assert found.episodes == sum((one.episodes for one in each), ())
    assert len({one.baseline["f1"] for one in each}) > 1
    for name, mean in found.mean.items():
        assert mean == pytest.approx(np.mean([one.mean[name] for one in each])), name
        baseline = np.mean([one.baseline[name] for one in each])
        assert found.baseline[name] == pytest.approx(baseline), name
    assert found.summary["f1"].n == 3
    assert len(found.performances) == 6
    assert sum((one.performances for one in found.by_piece), ()) == found.performances
    written = json.loads(found.metrics_file.read_text())["evaluations"]
    files = [name for one in written for name in one["performances"]]
    assert files == [None if file is None else file.name for file in found.performances]
    pairs = compare(run.path, run.path).metrics[0].pairs
    assert [pair.piece for pair in pairs] == ["60", "62", "64"]
    assert [pair.a for pair in pairs] == [one.mean["f1"] for one in found.by_piece]


class FailsOn62(gym.Wrapper):
    """Fail where the piece 62 is played; named in a config by its import path."""

    def step(self, action):
        if self.unwrapped.score.title == "62":
            raise ValueError("this one not")
        return self.env.step(action)


@pytest.mark.slow
def test_a_piece_that_fails_is_named_and_the_others_are_evaluated(run, corpus):
    before = evaluate(run.path).metrics_file.read_text()
    own = run.read_config()
    run.write_config(dataclasses.replace(own, env_wrapper=f"{__name__}.FailsOn62"))
    found = evaluate_runs([run.path])
    assert [evaluation.piece for evaluation in found.evaluations] == ["60", "64"]
    assert [str(failure) for failure in found.failures] == [
        f"Run '{run.path}' was not evaluated on '{corpus / '62.mid'}': ValueError('this one not')"
    ]
    assert not found.interrupted
    with pytest.raises(ValueError, match="this one not"):
        evaluate(run.path)
    # nothing is written that lacks a piece
    assert {evaluation.metrics_file for evaluation in found.evaluations} == {None}
    assert (run.evaluation_dir / "metrics.json").read_text() == before
    # what fails on every piece, or is not there, is told once
    run.model_file.write_bytes(b"PK")
    (failure,) = evaluate_runs([run.path]).failures
    assert failure.piece is None
    (corpus / "62.mid").unlink()
    (failure,) = evaluate_runs([run.path]).failures
    assert "62.mid" in failure.reason


@pytest.mark.slow
def test_the_commands_tell_of_the_files_and_count_the_episodes_of_all_pieces(
    run, tmp_path, monkeypatch, capsys
):
    told = []

    @contextlib.contextmanager
    def bar(arguments, what):
        yield lambda total=0, advance=0: told.append((total, advance))

    for command in ("evaluate", "export"):
        monkeypatch.setattr(f"sb3_piano.cli.{command}.progress_bar", bar)
    path = str(run.path)
    for command in (
        ["evaluate", path, "--episodes", "2"],
        ["export", path, str(tmp_path / "shared"), "--no-video", "--episodes", "2"],
    ):
        told.clear()
        assert main(command) == 0
        assert told == [(6, 0), *[(0, 1)] * 6]
    out = capsys.readouterr().out
    assert f"Metrics:     {run.evaluation_dir / 'metrics.json'}\n" in out
    assert "Performance: " in out
    monkeypatch.undo()
    assert main(["evaluate", path, str(tmp_path / "shared"), str(tmp_path / "nix")]) == 2
