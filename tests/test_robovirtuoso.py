"""The cells of RoboVirtuoso's tables are what their names say, and the driver runs them."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path
from statistics import fmean

import pytest
import yaml
from fresh_python import run_python

from sb3_piano.lab.music.corpus import HELD_OUT
from sb3_piano.music import load_score, select_pieces
from sb3_piano.training import RunFolder, load_config
from sb3_piano.training.runs.builders import build_vec_env

FOLDER = Path(__file__).parents[1] / "examples" / "robovirtuoso"
STUDY = yaml.safe_load((FOLDER / "study.yml").read_text(encoding="utf-8"))
NAMES = list(STUDY["cells"])
PIANO = "RoboPianist-v0"


def config_of(name, **changed):
    return load_config("sac", PIANO, FOLDER / f"{name}.yml", **changed)


def classes(plugins):
    return {plugin.path.rpartition(".")[2] for plugin in plugins}


def test_each_cell_has_a_file_and_stands_after_what_it_starts_from():
    files = {str(file.relative_to(FOLDER))[:-4] for file in FOLDER.glob("*/*.yml")}
    assert files == set(NAMES)
    for index, name in enumerate(NAMES):
        start = STUDY["cells"][name].get("start")
        assert start is None or start in NAMES[:index]
    tables = yaml.safe_load((FOLDER / "paper.yml").read_text(encoding="utf-8"))
    reported = {name for cells in tables.values() for name in cells}
    assert reported == {name for name in NAMES if not name.startswith("pretraining/")}


@pytest.mark.parametrize("name", NAMES)
def test_a_cell_is_what_its_name_says(name):
    config = config_of(name, pieces="scale-CMajor")
    wrappers, short = classes(config.env_wrapper), name.partition("/")[2]
    assert ("HindsightFlag" in wrappers) == ("hindsight" in short)
    assert ("HindsightCallback" in classes(config.callback)) == ("hindsight" in short)
    both = short.startswith("both")
    assert ("KeyRewardTiering" in wrappers) == ("key_tiers" in short or both)
    assert ("RewardTiering" in wrappers) == (short.startswith("tiers") or both)
    encoder, _, steps = short.removesuffix("_key_tiers").partition("_")
    shows_roll = encoder in ("mlp", "conv", "transformer")
    ahead = [p.kwargs["steps"] for p in config.env_wrapper if p.path.endswith("Lookahead")]
    assert ahead == ([int(steps)] if shows_roll else [])
    assert config.algorithm_kwargs["policy_kwargs"].get("encoder", encoder) == encoder
    together = STUDY["cells"][name].get("together", "")
    n_pieces = len(select_pieces(together)) if together else 1
    assert config.n_envs == n_pieces
    buffer = str(config.algorithm_kwargs["replay_buffer_class"])
    assert ("Cycling" in buffer) == (n_pieces > 1)
    base = config_of("table_4/mlp_10" if shows_roll else "table_1/from_nothing")
    own = {"replay_buffer_class", "train_freq", "gradient_steps", "policy_kwargs"}
    for key, value in base.algorithm_kwargs.items():
        assert key in own or config.algorithm_kwargs[key] == value


def test_all_pieces_can_be_shown():
    entries = [cell["together"] for cell in STUDY["cells"].values() if "together" in cell]
    for piece in select_pieces([*entries, *STUDY["pieces"]]):
        assert all(note.finger >= 0 for note in load_score(piece).notes)
        build_vec_env(config_of("table_1/from_nothing", pieces=piece)).close()
    build_vec_env(config_of("table_4/conv_100", pieces=STUDY["one"])).close()
    assert set(STUDY["one"]) <= set(STUDY["pieces"])
    assert not set(STUDY["unseen"]) & set(select_pieces(entries))
    assert len(select_pieces(STUDY["unseen"])) == 4
    # Nor has the sight-reader, which stands beside them.
    studies = {piece for piece in STUDY["unseen"] if not piece.startswith("repertoire-")}
    assert studies <= set(HELD_OUT)


def script(name, monkeypatch, folder=FOLDER):
    """Return a script as a module that others import by its bare name."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    return module


def test_the_page_has_the_tables_of_what_was_kept(tmp_path, monkeypatch, capsys):
    script("cells", monkeypatch)
    monkeypatch.setattr(sys, "argv", ["table.py", "--runs", str(tmp_path)])
    script("table", monkeypatch).main()
    printed = [line for line in capsys.readouterr().out.splitlines() if not line.endswith("| 0 |")]
    page = (FOLDER.parents[1] / "docs/reproductions/robovirtuoso.md").read_text(encoding="utf-8")
    assert [line for line in printed if line.startswith("| table_")] == [
        line for line in page.splitlines() if line.startswith("| table_")
    ]
    for row in page.splitlines():
        if row.startswith("| table_"):
            _, _, (f1, *marked), _, _, (resting, *_), *_ = map(str.split, row.split("|"))
            assert marked == ["floor"] * (float(f1) < float(resting) + 0.05)
    kept = json.loads((FOLDER / "results.json").read_text(encoding="utf-8"))
    unseen = page.partition("## Pieces not seen before")[2]
    for name in ("pretraining/one_scale", "pretraining/twelve_scales", "sight-reader"):
        of_seeds = [found for run, found in kept.items() if run.rpartition("/")[0] == name]
        for piece in STUDY["unseen"]:
            means = [fmean(of_seed[piece][column] for of_seed in of_seeds) for column in (0, 1)]
            assert " / ".join(f"{mean:.3f}".lstrip("0") for mean in means) in unseen


@pytest.mark.slow
def test_the_driver_trains_starts_resumes_and_prints(tmp_path, monkeypatch, capfd):
    driver, runs = tmp_path / "driver", tmp_path / "runs"
    shutil.copytree(FOLDER, driver)
    piece = STUDY["pieces"][0]
    fewer = {"pieces": [piece], "unseen": STUDY["unseen"][:1]}
    (driver / "study.yml").write_text(yaml.safe_dump({**STUDY, **fewer}))
    cell = driver / "table_1" / "from_one_scale.yml"
    cell.write_text(cell.read_text().replace("n_timesteps: 30000", "n_timesteps: 300"))
    script("cells", monkeypatch, driver)
    modules = {name: script(name, monkeypatch, driver) for name in ("run", "table")}

    def call(name, *arguments):
        """Return the exit status of a script, what it printed, and its messages."""
        monkeypatch.setattr(sys, "argv", [f"{name}.py", "--runs", str(runs), *arguments])
        capfd.readouterr()
        try:
            status = modules[name].main()
        except SystemExit as error:
            status = error.code
        return (status, *capfd.readouterr())

    command = [str(driver / "run.py"), "--runs", str(runs), "table_1/from_one_scale"]
    early = run_python(command, tmp_path)
    assert early.returncode == 2
    assert "pretraining/one_scale/seed_0" in early.stderr
    cells = ["pretraining/one_scale", "table_1/from_one_scale", "--steps", "300", "--no-progress"]
    status, printed, said = call("run", *cells)
    assert status == 0, said
    assert printed.count(": F1 ") == 3  # with the sight-reader's
    first = runs / "table_1/from_one_scale" / f"{piece}_seed_0"
    config = RunFolder.open(first).read_config()
    assert config.callback[-1].kwargs["run"] == str(runs / "pretraining/one_scale/seed_0")
    (found,) = json.loads((first / "pieces.json").read_text())["evaluations"]
    assert found["piece"] == piece
    assert call("run", *cells)[1] == "2 of 2 trainings are finished.\n"
    # What cannot be judged is told, and judged again when it can be.
    model, judged = first / "model.zip", first / "pieces.json"
    content, expected = model.read_bytes(), judged.read_text()
    judged.unlink()
    model.write_bytes(b"damaged")
    status, _, said = call("run", *cells)
    assert status == 2
    assert "Nothing was kept: the same command judges it again." in said
    assert not judged.exists()
    model.write_bytes(content)
    assert call("run", *cells)[0] == 0
    assert json.loads(judged.read_text()) == json.loads(expected)
    table = call("table", "--kept", str(tmp_path / "none.json"))[1]
    row = next(line for line in table.splitlines() if "table_1/from_one_scale" in line)
    assert row.endswith("| 0.469 | 1 |")
    assert "| table_2/hindsight | - | - | - | - | 0.073 | 0 |" in table
    unseen = table.partition("Not seen in training: scale-EHarmonicMinor")[2]
    scale = next(line for line in unseen.splitlines() if "pretraining/one_scale" in line)
    assert scale.endswith("| - | 1 |")
    reader = next(line for line in unseen.splitlines() if line.startswith("| sight-reader |"))
    assert float(reader.split("|")[2]) > 0.9
    # What is shorter than its cell says is shown, not kept; what is kept needs no folder any more.
    kept = tmp_path / "kept.json"
    assert call("table", "--keep", "--kept", str(kept))[1].startswith("2 runs are kept in")
    shutil.rmtree(runs)
    table = call("table", "--kept", str(kept))[1]
    assert {row, reader} <= set(table.splitlines())
    assert "| pretraining/one_scale | - | - | - | - | - | 0 |" in table
