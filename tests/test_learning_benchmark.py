"""The benchmark of learning curves."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
import yaml

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score

FOLDER = Path(__file__).parents[1] / "benchmarks"
learning = runpy.run_path(str(FOLDER / "learning.py"))

STUDY = {
    "minutes": 0.002,
    "every": 20,
    "seeds": [0, 1],
    "envs": ["RoboPianist-debug-CMajorScaleOneHand-v0"],
    "variants": {
        "strikes": {"settings": {"env_kwargs": {"reward_weights": {"strike": 0.5}}}},
        "published": {"algo": "td3", "published": True},
    },
}


@pytest.mark.parametrize("file", sorted((FOLDER / "learning").glob("*.yml")), ids=lambda f: f.stem)
def test_the_studies_of_the_repository_have_valid_settings(file, tmp_path):
    study = learning["Study"].from_yaml(file, tmp_path)
    for name, piece, seed in study.cells():
        variant = study.variants[name]
        if "{piece}" in (variant.player or ""):  # a run that a user makes first
            with pytest.raises(ConfigError, match=f"clones/{piece.name}/cloned"):
                variant.config(piece, seed)
        else:
            assert variant.config(piece, seed).seed == seed


@pytest.mark.slow
def test_a_study_trains_until_its_time_is_up_and_what_is_whole_is_not_done_again(tmp_path, capsys):
    file = tmp_path / "study.yml"
    brief = {"envs": [], "pieces": ["TwinkleTwinkle"], "seconds": 1}
    file.write_text(yaml.safe_dump({**STUDY, **brief}))
    out = tmp_path / "out"
    study = learning["Study"].from_yaml(file, out)
    for name, piece, seed in study.cells():
        made = learning["file_of"](out, name, piece, seed)
        learning["run"](study.variants[name], piece, seed, study, made)
        rows = [json.loads(line) for line in made.read_text().splitlines()]
        assert [row["steps"] for row in rows] == sorted({row["steps"] for row in rows})
        assert rows[0]["steps"] == 0 < rows[-1]["cpu_seconds"]
        assert all(0 <= row[metric] <= 1 for row in rows for metric in ("f1", "onset_f1"))
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.jsonl")}
    assert len(before) == 4
    learning["main"]([str(file), "--out", str(out)])
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("*.jsonl")}
    printed = capsys.readouterr().out
    assert "| strikes | TwinkleTwinkle | 2 |" in printed
    assert (out / "curves.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_training_ends_after_the_steps_of_its_settings(tmp_path):
    given = {"n_timesteps": 20, "learning_starts": 100}
    variants = {"brief": {"settings": given}}
    file = tmp_path / "study.yml"
    file.write_text(yaml.safe_dump({**STUDY, "minutes": 0.1, "seeds": [0], "variants": variants}))
    study = learning["Study"].from_yaml(file, tmp_path)
    made = tmp_path / "rows.jsonl"
    learning["run"](study.variants["brief"], study.pieces[0], 0, study, made)
    last = json.loads(made.read_text().splitlines()[-1])
    assert last["steps"] == 20


def test_a_study_takes_the_first_seconds_of_its_pieces(tmp_path):
    file = tmp_path / "study.yml"
    file.write_text(yaml.safe_dump({**STUDY, "pieces": ["FurElise"], "seconds": 3}))
    whole, piece = learning["Study"].from_yaml(file, tmp_path / "out").pieces
    assert whole.env_id == STUDY["envs"][0]
    score = load_score(piece.env_kwargs["score"])
    assert piece.name == "FurElise"
    assert score.duration == pytest.approx(3, abs=0.05)
    assert [note.pitch for note in score.notes[:4]] == [
        note.pitch for note in load_score("FurElise").notes[:4]
    ]


def test_evaluations_normalise_as_the_training_does(tmp_path):
    settings = {"normalize": {"norm_reward": False}, "learning_starts": 10**6}
    piece = learning["Piece"](env_id="RoboPianist-debug-CMajorScaleOneHand-v0")
    config = learning["Variant"](settings=settings).config(piece, 0)
    model = learning["build_model"](config, learning["build_vec_env"](config))
    callback = learning["TimedEvaluation"](config, 10**6, 60.0, tmp_path / "rows.jsonl")
    model.learn(30, callback=callback)
    callback.evaluate()
    learnt, used = model.get_vec_normalize_env().obs_rms, callback.venv.obs_rms
    assert learnt.count == used.count == pytest.approx(31, abs=1)
    np.testing.assert_array_equal(used.mean, learnt.mean)
