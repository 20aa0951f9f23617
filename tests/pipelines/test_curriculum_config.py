"""YAML files of curricula: what they say, and what is refused in them."""

import re
from pathlib import Path

import pytest
import yaml
from tiny_curriculum import PENDULUM
from yaml_rows import Tables

from sb3_piano.callbacks import Condition
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.pipelines import Curriculum, Stage, load_curriculum
from sb3_piano.pipelines.curriculum import check_fit

tables = Tables(__file__)

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "curricula.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "examples" / "curriculum"


def test_settings_of_the_curriculum_hold_for_all_stages_unless_a_stage_has_its_own(write):
    file = write(
        {"piece": "hanon-01", "env_kwargs": {"tempo": 108}, "gamma": 0.9},
        {"env": "Pendulum-v1", "until": None, "name": "swing it!"},
        {"config": "fast"},
        piece="hanon-02",
        env_kwargs={"tempo": 60, "physics": "fast"},
        gamma=0.8,
        until={"onset_f1": 0.8, "eval_freq": "1e1", "patience": 2},
        n_timesteps="1e3",
    )
    first, second, third = load_curriculum(file).stages
    assert [stage.piece for stage in (first, second, third)] == ["hanon-01", None, "hanon-02"]
    assert second.env == "Pendulum-v1"
    assert first.settings["env_kwargs"] == {"tempo": 108, "physics": "fast"}
    assert (first.settings["gamma"], third.settings["gamma"]) == (0.9, 0.8)
    assert first.until == Condition(thresholds={"onset_f1": 0.8}, eval_freq=10, patience=2)
    assert second.until is None
    assert load_curriculum(file).run_names == ("1_hanon-01", "2_swing-it-", "3_hanon-02")
    config = first.run_config("sac")
    assert config.env_kwargs == {"tempo": 108, "physics": "fast", "score": "hanon-01"}
    assert (config.env_id, config.algorithm_kwargs["gamma"]) == ("RoboPianist-v0", 0.9)
    assert third.run_config("sac").env_kwargs["observation"] == "hands"


def test_files_lie_beside_the_yaml_file(write, tmp_path, monkeypatch):
    folder = tmp_path / "music"
    folder.mkdir()
    notes = [Note(onset=0.0, offset=0.5, pitch=60)]
    write_midi(Score(notes=notes), folder / "a.mid")
    (folder / "own.yml").write_text("default: {n_timesteps: 7, policy: MlpPolicy}")
    (folder / "fingers.csv").write_text("")
    file = folder / "tiny.yml"
    written = write(
        {"piece": "a.mid", "config": "own.yml", "env_kwargs": {"fingering": "fingers.csv"}},
        {"piece": "FurElise", "config": "fast", "env_kwargs": {"fingering": "ergonomic"}},
        {"pieces": ["*.mid", "./b/*.mid", "scale-*", "list.txt"]},
        {"pieces": "music/*.mid"},
        init_from="runs/a",
        n_timesteps=None,
    )
    written.rename(file)
    monkeypatch.chdir(tmp_path)
    curriculum = load_curriculum("music/tiny.yml")
    first, second, third, fourth = curriculum.stages
    assert (first.piece, first.config) == (str(folder / "a.mid"), str(folder / "own.yml"))
    assert first.settings["env_kwargs"]["fingering"] == str(folder / "fingers.csv")
    assert (second.piece, second.config) == ("FurElise", "fast")
    assert second.settings["env_kwargs"]["fingering"] == "ergonomic"
    files = [str(folder / name) for name in ("*.mid", "b/*.mid", "list.txt")]
    assert third.pieces == (*files[:2], "scale-*", files[2])
    assert fourth.pieces == (str(folder / "music/*.mid"),)
    assert curriculum.init_from == str(folder / "runs" / "a")
    assert curriculum.run_names[:3] == ("1_a", "2_FurElise", "3_4-pieces")
    assert first.run_config("sac").n_timesteps == 7


def test_what_is_written_down_is_read_as_the_same(write):
    file = write(
        {"piece": "hanon-01", "until": {"f1": 0.5, "recall": 0.25, "eval_freq": 5}},
        {"pieces": ["scale-*", "repertoire"], "with_buffer": True, "learning_rate": "lin_1e-3"},
        {"env": "Pendulum-v1", "name": "b", "policy_kwargs": "dict(net_arch=[4])"},
        seed=3,
        init_from="runs/a",
    )
    curriculum = load_curriculum(file)
    text = yaml.safe_dump(curriculum.to_mapping())
    assert Curriculum.from_mapping(yaml.safe_load(text)) == curriculum


@tables("changes, message")
def test_a_curriculum_that_is_wrong_is_refused(write, changes, message):
    changes.setdefault("stages", [{"piece": "hanon-01"}])
    stages = changes.pop("stages")
    file = write(**changes)
    content = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump({**content, "stages": stages}))
    with pytest.raises(ConfigError, match=f"^'{file}': .*{message}"):
        load_curriculum(file)


@tables("changes, message")
def test_a_stage_that_is_wrong_is_refused(write, changes, message):
    file = write({**PENDULUM}, {"piece": "hanon-01", **changes})
    with pytest.raises(ConfigError, match=f"^'{file}': (Stage 2: )?.*{message}"):
        load_curriculum(file)


@tables("algo, second, message")
def test_settings_are_checked_in_python_too(algo, second, message):
    with pytest.raises(ConfigError, match=message):
        Curriculum(algo=algo, stages=(Stage(piece="a"), Stage(piece="b", **second)))


@tables("values, patience, is_met")
def test_a_condition_is_met_by_all_its_metrics_in_the_last_evaluations(values, patience, is_met):
    condition = Condition(thresholds={"f1": 0.5, "onset_f1": 0.8}, patience=patience)
    evaluations = [{"f1": f1, "onset_f1": onset_f1} for f1, onset_f1 in values]
    assert condition.is_met(evaluations) == is_met


@tables("condition, callback, eval_freq")
def test_a_run_without_evaluations_gets_some(condition, callback, eval_freq):
    stage = Stage(piece="hanon-01", settings={"callback": []}, until=Condition(**condition))
    (added,) = stage.run_config("sac").callback
    assert added.path == f"sb3_piano.callbacks.{callback}"
    assert added.kwargs == ({} if eval_freq is None else {"eval_freq": eval_freq})


def test_an_evaluation_at_the_start_counts():
    evaluates = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 30, "evaluate_start": True}}
    settings = {"callback": evaluates, "n_timesteps": 60}
    until = {"thresholds": {"f1": 1}}
    patient = Stage(piece="a", settings=settings, until=Condition(**until, patience=3))
    assert patient.run_config("sac").n_timesteps == 60
    with pytest.raises(ConfigError, match="come 3 evaluations"):
        Stage(piece="a", settings=settings, until=Condition(**until, patience=4)).run_config("sac")


def test_where_hands_are_agents_a_call_is_a_step_of_each():
    until = Condition(thresholds={"onset_f1": 0.8}, eval_freq=10000)
    stage = {"piece": "hanon-01", "config": "fast", "until": until}  # of 16 hands
    assert Stage(**stage, settings={"n_timesteps": 160_000}).run_config("sac").n_envs == 8
    with pytest.raises(ConfigError, match="159999 of 16 environment.*hands as agents, come 0 eval"):
        Stage(**stage, settings={"n_timesteps": 159_999}).run_config("sac")


def test_the_curriculum_of_the_page_fits(tmp_path):
    (tmp_path / "practice.yml").write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.S)[1])
    curriculum = load_curriculum(tmp_path / "practice.yml")
    check_fit(curriculum)
    assert f"runs/curricula/practice/{curriculum.run_names[2]}\n" in PAGE


@pytest.mark.parametrize("name", ["hanon", "repertoire"])
def test_the_stages_of_the_examples_fit(name):
    file = EXAMPLES / f"{name}.yml"
    curriculum = load_curriculum(file)
    check_fit(curriculum)
    for folder in re.findall(r"runs/curricula/(\S+)", file.read_text("utf-8")):
        assert folder == f"{name}/{curriculum.run_names[-1]}"
