"""Reward terms from outside in runs: from YAML, in logs, evaluations, tables and reports."""

import own_terms
import pytest
import yaml
from acting import scalars
from html_page import Page

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.training import RunConfig, RunFolder, evaluate, write_report
from sb3_piano.training.runs.builders import build_vec_env

TERMS = {"smooth": "own_terms.smooth", "still": "own_terms.still"}
ENV_ID = "RoboPianist-v0"


@pytest.fixture
def entry(small_config, midi_file):
    """Return an entry of a YAML file: one episode, of which the monitor notes a term."""
    config = small_config(env_id=ENV_ID, n_timesteps=30).to_mapping()
    kept = {name: config[name] for name in ("n_timesteps", "policy")} | config["algorithm_kwargs"]
    options = {"score": str(midi_file), "physics": "fast", "reward_terms": TERMS}
    options["reward_weights"] = {"smooth": "1e-3"}
    monitor = {"info_keywords": ["return_smooth"]}
    return {**kept, "env_kwargs": options, "monitor_kwargs": monitor}


@pytest.mark.slow
def test_a_run_from_yaml_logs_evaluates_and_reports_them(entry, tmp_path, capsys, episodes_of):
    file, folder = tmp_path / "own.yml", tmp_path / "run"
    file.write_text(yaml.safe_dump({ENV_ID: entry}))
    command = ["train", "--algo", "td3", "--env", ENV_ID, "--config", str(file), "--no-progress"]
    assert main([*command, "--out", str(folder)]) == 0
    run = RunFolder.open(folder)
    assert run.read_config().env_kwargs["reward_terms"] == TERMS
    (episode,) = episodes_of(run.monitor_dir)
    (logged,) = scalars(run, "reward/smooth").values()
    assert episode["return_smooth"] == pytest.approx(logged)
    assert logged < 0
    mean = evaluate(folder).mean
    assert mean["return_smooth"] <= 0 <= mean["return_still"]
    capsys.readouterr()
    assert main(["evaluate", str(folder), "--metric", "f1", "return_smooth"]) == 0
    shown = capsys.readouterr().out
    assert "smooth" in shown
    assert "still" not in shown
    text = Page(write_report(folder).read_text(encoding="utf-8")).text
    assert "Smooth" in text
    assert "Hands that rest" in text


def test_functions_of_modules_become_their_paths(entry):
    options = {**entry["env_kwargs"], "reward_terms": {"smooth": own_terms.smooth}}
    config = RunConfig(algo="td3", env_id=ENV_ID, n_timesteps=30, env_kwargs=options, n_envs=2)
    assert config.env_kwargs["reward_terms"] == {"smooth": "own_terms.smooth"}
    venv = build_vec_env(config)
    assert venv.env_method("reward_terms", 0)
    venv.close()


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"smooth": "own_terms.smoth"}, "Reward term 'smooth': .*mean 'smooth'"),
        ({"smooth": lambda step: 0.0}, "Reward term 'smooth': .*<lambda>' is no import path"),
        ({"still": own_terms.still}, "still is a Term, which a run's folder cannot hold"),
        ({"energy": "own_terms.smooth"}, "Reward term 'energy' is built in"),
    ],
)
def test_what_a_run_cannot_have_is_told_before_it_is_made(entry, terms, message):
    options = {**entry["env_kwargs"], "reward_terms": terms}
    with pytest.raises(ConfigError, match=message):
        RunConfig(algo="td3", env_id=ENV_ID, n_timesteps=30, env_kwargs=options)
