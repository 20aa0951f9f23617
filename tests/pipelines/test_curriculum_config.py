"""YAML files of curricula: what they say, and what is refused in them."""

import re
from pathlib import Path

import pytest
import yaml
from tiny_curriculum import PENDULUM

from sb3_piano.callbacks import Condition
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.pipelines import Curriculum, Stage, load_curriculum
from sb3_piano.pipelines.curriculum import check_fit

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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stages": []}, r"stages is \[\]: expected a list of stages"),
        ({"stages": {"piece": "a"}}, "expected a list of stages"),
        ({"stages": ["hanon-01"]}, "Stage 1: It is 'hanon-01': expected a mapping"),
        ({"algo": None}, "algo is missing"),
        ({"algo": "sca"}, "Unknown algorithm 'sca'.*Did you mean 'sac'"),
        ({"gama": 0.8}, "Unknown key 'gama' of a curriculum. Did you mean 'gamma'"),
        ({"stage": []}, "Unknown key 'stage' of a curriculum. Did you mean 'stages'"),
        ({"seed": -1}, "seed is -1: expected a whole number, 0 or more"),
        ({"with_buffer": True}, "with_buffer is true of stage 1, which starts from nothing"),
        ({"algo": "ppo", "buffer_size": None}, "Unknown key 'learning_starts' of a curriculum"),
    ],
)
def test_a_curriculum_that_is_wrong_is_refused(write, changes, message):
    changes.setdefault("stages", [{"piece": "hanon-01"}])
    stages = changes.pop("stages")
    file = write(**changes)
    content = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump({**content, "stages": stages}))
    with pytest.raises(ConfigError, match=f"^'{file}': .*{message}"):
        load_curriculum(file)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"until": {"f1": 80}}, r"until.f1 is 80: expected a finite number from 0 to 1"),
        ({"until": {"f2": 0.8}}, "Unknown key 'f2' of until. Did you mean 'f1'"),
        ({"until": {"noop_f1": 0.8}}, "Unknown key 'noop_f1' of until"),
        ({"until": {"wrong_presses_per_second": 0.8}}, "Unknown key 'wrong_presses_per_second'"),
        ({"until": {"patience": 2}}, "until names no metric: expected one or more"),
        ({"until": {"f1": 1, "patience": 0}}, "patience is 0: expected a whole number, 1 or more"),
        ({"until": 0.8}, "until is 0.8: expected a mapping"),
        ({"untill": {"f1": 1}}, "Unknown setting 'untill' of stage 2. Did you mean 'until'"),
        ({"gama": 0.8}, "Unknown setting 'gama' of stage 2. Did you mean 'gamma'"),
        ({"seed": 1}, "Unknown setting 'seed' of stage 2"),
        ({"settings": {"gamma": 1}}, "Unknown setting 'settings' of stage 2"),
        ({"env": "Pendulum-v1"}, "It has piece and env: expected one of piece, pieces and env"),
        ({"piece": None}, "It has nothing to play: expected one of piece, pieces and env"),
        ({"pieces": 5, "piece": None}, "pieces is 5: expected a list"),
        ({"with_buffer": "yes"}, "with_buffer is 'yes': expected true or false"),
    ],
)
def test_a_stage_that_is_wrong_is_refused(write, changes, message):
    file = write({**PENDULUM}, {"piece": "hanon-01", **changes})
    with pytest.raises(ConfigError, match=f"^'{file}': (Stage 2: )?.*{message}"):
        load_curriculum(file)


@pytest.mark.parametrize(
    ("algo", "second", "message"),
    [
        ("sac", {"settings": {"gama": 1}}, "Unknown setting 'gama' of stage 2.*'gamma'"),
        ("ppo", {"with_buffer": True}, "with_buffer is true of stage 2, but PPO has no replay buf"),
    ],
)
def test_settings_are_checked_in_python_too(algo, second, message):
    with pytest.raises(ConfigError, match=message):
        Curriculum(algo=algo, stages=(Stage(piece="a"), Stage(piece="b", **second)))


@pytest.mark.parametrize(
    ("values", "patience", "is_met"),
    [
        ([], 1, False),
        ([(0.5, 0.8)], 1, True),
        ([(0.4, 0.9)], 1, False),
        ([(0.9, 0.7)], 1, False),
        ([(0.9, 0.9)], 2, False),
        ([(0.4, 0.9), (0.5, 0.9)], 1, True),
        ([(0.4, 0.9), (0.5, 0.9)], 2, False),
        ([(0.5, 0.9), (0.4, 0.9), (0.5, 0.9)], 2, False),
        ([(0.1, 0.1), (0.5, 0.9), (0.5, 0.9)], 2, True),
    ],
)
def test_a_condition_is_met_by_all_its_metrics_in_the_last_evaluations(values, patience, is_met):
    condition = Condition(thresholds={"f1": 0.5, "onset_f1": 0.8}, patience=patience)
    evaluations = [{"f1": f1, "onset_f1": onset_f1} for f1, onset_f1 in values]
    assert condition.is_met(evaluations) == is_met


@pytest.mark.parametrize(
    ("condition", "callback", "eval_freq"),
    [
        ({"thresholds": {"f1": 1}}, "F1Callback", None),
        ({"thresholds": {"f1": 0.5, "onset_f1": 1}, "eval_freq": 7}, "OnsetF1Callback", 7),
    ],
)
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
