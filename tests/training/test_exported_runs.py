"""Exported runs: what is in them, loading without pickles, folders that try to run code."""

import contextlib
import json
import pickle
import resource
import shutil
import sys

import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.imports import import_name, known_packages_only
from sb3_piano.lab.web import export_web
from sb3_piano.take import Take
from sb3_piano.training import RunFolder, evaluate, export_run, load_player

tables = Tables(__file__)


class Evil:
    """What makes a marker file when it is unpickled."""

    def __reduce__(self):
        return (exec, ("open('marker', 'w').close()",))


@pytest.fixture(scope="session")
def exported_once(tmp_path_factory):
    """A folder for an exported run."""
    return tmp_path_factory.mktemp("exported") / "run"


@pytest.fixture
def exported(exported_once, pendulum_run, tmp_path, monkeypatch):
    """A copy of an exported run, in the working directory."""
    monkeypatch.chdir(tmp_path)
    if not exported_once.exists():
        export_run(pendulum_run(normalize=True).path, exported_once, episodes=2)
    return RunFolder(shutil.copytree(exported_once, tmp_path / "exported"))


def change(folder, **settings):
    content = yaml.safe_load(folder.config_file.read_text())
    folder.config_file.write_text(yaml.safe_dump({**content, **settings}))


def test_the_card_has_the_figures_of_the_evaluation_in_the_format_of_the_hub(exported):
    _, front, body = (exported.path / "README.md").read_text().split("---\n", 2)
    facts = yaml.safe_load(front)
    assert facts["library_name"] == "stable-baselines3"
    (result,) = facts["model-index"][0]["results"]
    found = evaluate(exported.path, 1, range(2))
    assert result["metrics"][0]["value"] == (
        f"{found.mean['return']:.3f} +/- {found.std['return']:.3f}"
    )
    low, high = found.summary["return"].interval
    assert f"| {found.mean['return']:.4f} | {low:.4f} to {high:.4f} |" in body


def test_settings_that_name_code_of_others_are_refused_unimported(exported, tmp_path, monkeypatch):
    (tmp_path / "evil.py").write_text("open('marker', 'w').close()")
    monkeypatch.syspath_prepend(tmp_path)
    as_exported = exported.config_file.read_text()
    for settings in tables["settings_of_others"]:
        exported.config_file.write_text(as_exported)
        change(exported, **settings)
        with pytest.raises((ConfigError, RunError), match="refused|not in it"):
            load_player(exported.path)
    assert "evil" not in sys.modules
    assert not (tmp_path / "marker").exists()


def test_settings_ask_for_no_more_memory_than_the_weights_do(exported):
    def largest(**settings):
        change(exported, algorithm_kwargs={"device": "cpu", **settings})
        with contextlib.suppress(ConfigError, RunError), load_player(exported.path):
            pass
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = largest()  # as it was exported, but for its layers
    for kwargs in ({"net_arch": [30_000, 30_000]}, {"net_arch": [1000] * 1000}):
        assert largest(policy_kwargs=kwargs) < before + 2**17
    assert largest(policy_kwargs={"net_arch": [8]}, buffer_size=10**10) < before + 2**17
    as_exported = exported.config_file.read_text()
    for kind, wrapper, argument in tables["endless_wrappers"]:
        exported.config_file.write_text(as_exported)
        change(exported, **{kind: [{wrapper: {argument: 10**9}}]})
        with pytest.raises(ConfigError, match=r"FrameStack\w*: 1000000000 is refused in an"):
            load_player(exported.path)


def test_pickles_are_left_alone_or_refused(exported, tmp_path):
    bad = pickle.dumps(Evil())
    for name in ("model.zip", "vecnormalize.pkl"):
        (exported.path / name).write_bytes(bad)
    with load_player(exported.path) as player:
        player.play()
    exported.weights_file.write_bytes(bad)
    with pytest.raises(RunError, match="cannot be loaded"):
        load_player(exported.path)
    exported.weights_file.unlink()
    with pytest.raises(RunError, match="could only be unpickled"):
        load_player(exported.path)
    assert not (tmp_path / "marker").exists()


@tables("name")
def test_no_wrapper_that_writes_files_may_be_named_and_others_are_let_through_afterwards(name):
    with known_packages_only(), pytest.raises(ConfigError, match="write no files"):
        import_name(name)
    with known_packages_only(), pytest.raises(ConfigError, match="refused"):
        import_name("json.dumps")
    assert import_name("json.dumps")


@pytest.mark.slow
def test_a_run_is_on_the_page_with_what_it_plays(piano_run, tmp_path):
    run = piano_run(-0.2)
    pieces = ["debug-TwinkleTwinkleLittleStar"]
    catalogue = json.loads(export_web(tmp_path / "page", pieces, runs=[run.path]).read_text())
    own, piece = catalogue["pieces"]
    assert (own["recorder"], own["id"], piece["id"]) == ("run", f"{own['title']}-run", *pieces)
    take = Take.read(tmp_path / "page" / own["recording"])
    assert own["expected"]["recorded"]["f1"] == take.f1
    assert evaluate(run.path).episodes[0]["f1"] == take.f1
