"""The cells of the study of SAC and TD3 are what their names say, and the driver runs them."""

import json
import re
import runpy
import shutil
import sys
from pathlib import Path

import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.music import PianoRoll, load_score
from sb3_piano.training import RunFolder, load_config

tables = Tables(__file__)

FOLDER = Path(__file__).parents[1] / "examples" / "sac_vs_td3"
FILES = sorted(FOLDER.glob("*/*.yml"))
CELL = "td3/d_major"
STEPS = 500  # three episodes of this cell, and the beginning of a fourth

PIECES, CHANGES = tables["pieces"], tables["changes"]
POLICIES = {"sac": "RegularizedSACPolicy", "td3": "RegularizedTD3Policy"}


def name_of(file):
    return f"{file.parent.name}/{file.stem}"


def config_of(file):
    (env_id,) = yaml.safe_load(file.read_text(encoding="utf-8"))
    return load_config(file.parent.name, env_id, file)


def hyperparameters(file):
    """Return what must be the same for all cells of an algorithm."""
    mapping = config_of(file).to_mapping()
    return {key: mapping[key] for key in mapping if key not in ("env_id", "env_wrapper", "policy")}


def test_the_paper_s_tables_have_all_cells_and_no_others():
    tables = yaml.safe_load((FOLDER / "paper.yml").read_text(encoding="utf-8"))
    assert {name for rows in tables.values() for name in rows} == set(map(name_of, FILES))


@pytest.mark.parametrize("file", FILES, ids=name_of)
def test_a_cell_holds_what_its_name_says_and_what_its_algorithm_has(file):
    piece = next(piece for piece in PIECES if file.stem.startswith(piece))
    env_id, words = PIECES[piece]
    config = config_of(file)
    assert (config.algo, config.env_id) == (file.parent.name, env_id)
    wrappers = {plugin.path.rpartition(".")[2]: plugin.kwargs for plugin in config.env_wrapper}
    change = file.stem.removeprefix(piece)
    assert wrappers == CHANGES[change]
    regularized = f"sb3_piano.policies.{POLICIES[config.algo]}"
    assert config.policy == (regularized if change == "_regularized" else "MlpPolicy")
    title = file.read_text(encoding="utf-8").partition("\n")[0]
    assert config.algo.upper() in title
    assert words in title
    assert hyperparameters(file) == hyperparameters(file.parent / "c_major.yml")


def test_the_algorithms_share_what_the_paper_has_for_both():
    sac, td3 = (hyperparameters(FOLDER / algo / "c_major.yml") for algo in ("sac", "td3"))
    differing = {key for key in sac if sac[key] != td3[key]}
    assert differing == {"algo", "algorithm_kwargs", "noise_type", "noise_std"}
    own = {"ent_coef", "target_entropy"}
    common = {k: v for k, v in sac["algorithm_kwargs"].items() if k not in own}
    assert common == td3["algorithm_kwargs"]
    assert (sac["n_timesteps"], common["learning_starts"]) == (50_000, 5_000)
    net, fused = [256, 256, 256], {"fused": True}
    assert common["policy_kwargs"] == {"net_arch": net, "optimizer_kwargs": fused}


# The driver, as a user runs it.


def steps_of(folder):
    return json.loads((folder / "checkpoint/checkpoint.json").read_bytes())["num_timesteps"]


@pytest.fixture
def script(monkeypatch, capsys):
    """Return a function that runs a script of the study: its status, output and messages."""

    def run(name, *arguments):
        monkeypatch.syspath_prepend(FOLDER)  # where the interpreter looks first for its imports
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        capsys.readouterr()
        status = None
        try:
            runpy.run_path(str(FOLDER / name), run_name="__main__")
        except SystemExit as error:
            status = error.code
        return (status, *capsys.readouterr())

    return run


@pytest.mark.slow
def test_the_driver_trains_what_is_missing_and_what_is_kept_outlives_its_folder(
    tmp_path, script, monkeypatch
):
    runs, kept = tmp_path / "runs", tmp_path / "kept.json"
    folder = runs / "td3" / "d_major_seed_0"
    metrics = folder / "evaluation" / "metrics.json"
    command = [CELL, "--steps", str(STEPS), "--runs", str(runs), "--no-progress"]
    status, output, _ = script("run.py", *command)
    assert (status, steps_of(folder)) == (0, STEPS)
    config = yaml.safe_load((folder / "config.yml").read_text())
    assert (config["n_timesteps"], config["seed"], config["algo"]) == (STEPS, 0, "td3")
    mean = json.loads(metrics.read_bytes())["mean"]
    assert f"return {mean['return']:.2f}, F1 {mean['f1']:.3f}" in output

    times = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert script("run.py", *command)[:2] == (0, "1 of 1 runs are finished.\n")
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == times

    def row(cell):
        printed = script("table.py", *places)[1]
        return re.search(rf"^\| {cell} \| (.*) \|$", printed, re.MULTILINE)[1]

    places = ["--runs", str(runs), "--kept", str(kept)]
    assert row(CELL).startswith(f"{mean['return']:.1f} | ")
    assert row(CELL).split(" | ")[2] == "421.6"
    floor = " floor" if mean["f1"] < mean["noop_f1"] + 0.05 else ""
    assert f" {mean['f1']:.3f}{floor} |" in row(CELL)
    assert row("sac/d_major").startswith("- | - | 248.3 | - |")
    whole = metrics.read_text()
    metrics.write_text(json.dumps({**json.loads(whole), "num_timesteps": STEPS - 1}))
    assert row(CELL).startswith("- |")  # what was judged in the middle is no result
    metrics.write_text(whole)

    printed = script("figures.py", *places, "--out", str(tmp_path / "out"))[1]
    drawn = sorted(path.stem for path in (tmp_path / "out").iterdir())
    assert drawn == ["figure_3", "figure_8"]  # those with the only cell that was run
    assert "figure_4: none of its cells was run" in printed

    monkeypatch.syspath_prepend(FOLDER)
    import cells
    import results

    (cell,) = cells.find_cells([CELL])
    kept.write_text(json.dumps({CELL: {"7": {"columns": {"F1": 0.5}}}}))
    assert results.keep([cell], runs, kept) == 0  # of another length than the cell's
    config = RunFolder.open(folder).read_config()
    monkeypatch.setattr(cells.Cell, "config", lambda self, seed: config)
    assert results.keep([cell], runs, kept) == 1
    before = results.results_of(cell, runs, tmp_path / "nothing.json")
    shutil.rmtree(runs)
    after = results.results_of(cell, runs, kept)
    assert before | {7: results.Result({"F1": 0.5})} == after
    assert after[0].steps[-1] == STEPS
    per_step = after[0].columns["return"] / 151
    assert after[0].columns["return / step"] == pytest.approx(per_step, rel=1e-4)
    assert row(CELL).endswith("| 2")
    assert f"| {(0.5 + after[0].columns['F1']) / 2:.3f} |" in row(CELL)


def test_the_page_has_the_tables_that_the_kept_results_give(tmp_path, script):
    printed = rows_of(script("table.py", "--runs", str(tmp_path))[1])
    page = Path(__file__).parents[1] / "docs" / "reproductions" / "sac_vs_td3.md"
    shown = rows_of(page.read_text(encoding="utf-8"))
    assert len(shown) == len(printed) == 41
    for row, measured in zip(shown, printed, strict=True):
        assert row == {name: measured[name] for name in row}
        assert row["seeds"] == "2"
        f1, *marked = row["F1"].split()
        assert marked == ["floor"] * (float(f1) < float(measured["resting F1"]) + 0.05)
        assert row["Q"] != "-"


def rows_of(text):
    """Return the rows of the tables of cells, each by the names of its columns."""
    rows, names = [], []
    for line in text.splitlines():
        values = [value.strip() for value in line.strip("|").split("|")]
        names = values if values[0] == "cell" else names
        if re.fullmatch(r"(sac|td3)/\w+", values[0]):
            rows.append(dict(zip(names, values, strict=True)))
    return rows


def test_an_unknown_cell_is_one_clear_error(tmp_path, script):
    status, _, error = script("run.py", "td3/d_majr", "--runs", str(tmp_path / "runs"))
    assert (status, error.count("\n")) == (2, 1)
    assert "No cell is called 'td3/d_majr'. Did you mean 'td3/d_major'" in error
    assert not list(tmp_path.iterdir())


def test_no_finger_is_due_on_two_keys_of_the_nocturne_at_the_paper_s_highest_speed():
    labels = PianoRoll.from_score(load_score("ChopinNocturneOp9No2").stretch(0.5), 0.05).finger
    for finger in range(10):
        assert (labels == finger).sum(axis=1).max() == 1
