"""What the documentation and the examples tell their readers to run does run."""

from __future__ import annotations

import functools
import importlib
import inspect
import json
import pkgutil
import re
import runpy
import shlex
import sys
from pathlib import Path

import gymnasium as gym
import pytest
import yaml
from fresh_python import run_python
from stable_baselines3.common.buffers import BaseBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BaseModel
from stable_baselines3.common.vec_env import VecEnv
from yaml_rows import Tables

import sb3_piano.lab
from sb3_piano.cli import main
from sb3_piano.cli.main import parser_of
from sb3_piano.envs import ENV_IDS, GENERAL_ID
from sb3_piano.music import Note, Score, load_score, write_midi
from sb3_piano.music.built_in import ENCORE, REPERTOIRE
from sb3_piano.music.library import Library
from sb3_piano.training import load_config
from sb3_piano.training.runs.builders import build_callbacks

ROOT = Path(__file__).parents[1]
IDS = (ROOT / "docs" / "environments.md").read_text(encoding="utf-8")
SOURCES = (ROOT / "docs" / "sources.md").read_text(encoding="utf-8")
BLOCKS = {
    page.name: found
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if (
        found := re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    )
}
# Each block on its own, in one process: importing the package takes longer than most of them.
RUN_BLOCKS = """
import json, sys
for number, block in enumerate(json.loads(sys.argv[1])):
    exec(compile(block, f"block {number}", "exec"), {"__name__": "__main__"})
"""
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))  # the demo has tests of its own
# What is shortened in examples that train, so that the networks are updated some ten times.
SHORT = Tables(__file__)["short"]


def run(code: list[str], folder: Path) -> str:
    done = run_python(code, folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def commands_of(page: Path) -> list[list[str]]:
    """Return the arguments of each command of ours that a page shows."""
    blocks = re.findall(r"^```bash\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    ours = [line for line in lines if line.startswith("sb3-piano ")]
    return [shlex.split(line, comments=True)[1:] for line in ours]


def skip_without_packages(code: str) -> None:
    for named, package in (("sb3_piano.interop", "dm_control"), ("onnxruntime", "onnxruntime")):
        if named in code:
            pytest.importorskip(package)


@pytest.mark.slow
@pytest.mark.parametrize("page", BLOCKS)
def test_the_python_blocks_of_a_page_run(page, tmp_path):
    skip_without_packages("".join(BLOCKS[page]))
    blocks = [block.replace("n_trials=2", "n_trials=1") for block in BLOCKS[page]]
    run(["-c", RUN_BLOCKS, json.dumps(blocks)], tmp_path)


def named_ids():
    """Return a pattern for each id on the page, where ``<Key>`` and ``<Name>`` are anything.

    An id may lack its beginning, as the second one of a row does.
    """
    spans = re.findall(r"`(?:RoboPianist)?(-[\w<>-]+-v0)`", IDS)
    patterns = [re.sub(r"<\w+>", r"\\w+", span) for span in spans]
    first, last = "-hanon-01-v0", "-hanon-20-v0"
    assert {first, last} <= set(patterns)
    return [*patterns, r"-hanon-\d\d-v0"]


def test_the_page_of_the_environments_names_every_one():
    assert {"README.md", "environments.md"} <= set(BLOCKS)
    patterns = [re.compile("RoboPianist" + pattern) for pattern in named_ids()]
    named = {e for e in ENV_IDS if any(pattern.fullmatch(e) for pattern in patterns)}
    assert set(ENV_IDS) - named == {GENERAL_ID}
    assert f"`{GENERAL_ID}`" in IDS


def markdown_of(page: Path) -> str:
    """Return the text of a page, of a notebook that of its cells."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".md":
        return text
    cells = json.loads(text)["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def test_every_link_leads_to_a_file_and_a_heading_that_exist():
    pages = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"))
    for page in (*pages, *NOTEBOOKS):
        for link in re.findall(r"\]\((?!https?:)([^)\s]+)\)", markdown_of(page)):
            name, _, anchor = link.partition("#")
            target = page.parent / name if name else page
            assert target.exists(), f"{page.name}: {link}"
            if anchor:
                headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
                slugs = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
                assert anchor in slugs, f"{page.name}: {link}"


def test_a_page_has_at_most_200_lines():
    """A longer one is two pages: what to do, and how it was found out."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    lines = {page.name: len(page.read_text(encoding="utf-8").splitlines()) for page in pages}
    assert {name: count for name, count in lines.items() if count > 200} == {}


def test_nothing_says_to_install_the_package_from_an_index_where_it_is_not():
    """Whoever registered its name there could have any program run."""
    folders = (ROOT / name for name in ("sb3_piano", "docs", "examples", "web/src", "benchmarks"))
    files = [ROOT / "README.md", *(file for folder in folders for file in folder.rglob("*"))]
    texts = [file for file in files if file.suffix in {".md", ".py", ".yml", ".ipynb", ".ts"}]
    offer = re.compile(r"install\s+(-\S+\s+)*['\"]?sb3[-_]piano\b")
    assert [file.name for file in texts if offer.search(file.read_text("utf-8"))] == []


@pytest.mark.parametrize(("name", "pieces"), [("repertoire", REPERTOIRE), ("encore", ENCORE)])
def test_the_page_of_sources_has_the_facts_of_the_tables_of_pieces(name, pieces):
    table = ROOT / "sb3_piano" / "music" / name / "pieces.yml"
    facts = yaml.safe_load(table.read_text("utf-8"))
    assert [name.partition("-")[2] for name in pieces] == list(facts)
    for name, piece in zip(pieces, facts.values(), strict=True):
        entry = f"**`{name}`**: {piece['composer']}, *{piece['title']}*. {piece['source']}"
        if "simplified" in piece:
            entry += f" Simplified: {piece['simplified']}"
        assert entry in " ".join(SOURCES.split())


@pytest.mark.slow
def test_the_page_of_the_repertoire_has_commands_that_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path / "data"))
    Path("my_music").mkdir()
    write_midi(load_score("OdeToJoy"), "my_piece.mid")
    write_midi(load_score("TwinkleTwinkle"), "my_music/twinkle.mid")
    commands = commands_of(ROOT / "docs" / "repertoire.md")
    assert len(commands) > 8
    for arguments in commands:
        assert main(arguments) == 0, arguments
    assert "Imported" in capsys.readouterr().out
    assert Path("fur_elise.mid").is_file()
    assert Library().names() == ("my_piece", "twinkle")


@pytest.mark.slow
def test_the_page_of_the_planned_pianist_has_commands_that_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_midi(Score(notes=[Note(onset=0.0, offset=0.5, pitch=76)]), "my_piece.mid")
    # The others take long, and have tests of their own.
    commands = commands_of(ROOT / "docs" / "planned_pianist.md")
    play, plan = (next(c for c in commands if c[0] == name) for name in ("play", "plan"))
    shortly = ["0.001" if argument == "5" else argument for argument in plan]
    assert main([*play, "--no-video"]) == main(shortly) == 0
    assert re.search(r"^planned: F1 [01]\.\d", capsys.readouterr().out, re.MULTILINE)
    assert Path("my_piece.npz").is_file()


def test_the_commands_of_all_pages_are_ones_that_there_are():
    parser, pages = parser_of(), [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
    commands = [arguments for page in pages for arguments in commands_of(page)]
    assert len(commands) > 100
    for arguments in commands:
        parser.parse_args(arguments)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_what_it_printed(notebook):
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


def test_what_the_makefile_and_the_examples_name_is_there_and_valid():
    script = re.search(r"^demo:.*\n\t\$\(BIN\)/python (\S+)$", MAKEFILE, re.MULTILINE)[1]
    assert (ROOT / script).is_file()
    file = ROOT / "examples" / "callbacks.yml"
    (env_id,) = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert build_callbacks(load_config("td3", env_id, file))


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_prints_a_number(example, tmp_path):
    text = example.read_text(encoding="utf-8")
    skip_without_packages(text)
    for old, new in SHORT.get(example.stem, {}).items():
        assert old in text
        example, text = tmp_path / example.name, text.replace(old, new)
        example.write_text(text, encoding="utf-8")
    assert re.search(r"\d", run([str(example)], tmp_path))


# The glossary has a row for every noun of the public interface, and no stale row.


PAGE = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")
# A class is a noun of its own, a function is a verb. A subclass of one of these is a kind of the
# parent, which has one row: what each kind does stands on the pages of wrappers, callbacks, ...
FAMILIES = {
    gym.Wrapper: "wrapper",
    BaseCallback: "callback",
    BaseBuffer: "replay buffer",
    BaseModel: "policy",
    VecEnv: "vector environment",
}
TERMS = re.findall(r"^\| (.*?) \| ", PAGE, re.MULTILINE)


def exported_classes():
    """Return the classes that public packages export, by name."""
    found = {}
    for parent in (sb3_piano, sb3_piano.lab):
        for info in pkgutil.iter_modules(parent.__path__, f"{parent.__name__}."):
            if info.ispkg and not info.name.endswith(".cli"):
                package = importlib.import_module(info.name)
                values = {name: getattr(package, name) for name in getattr(package, "__all__", ())}
                found |= {name: v for name, v in values.items() if inspect.isclass(v)}
    return found


CLASSES = exported_classes()
NOUNS = sorted(name for name, cls in CLASSES.items() if not issubclass(cls, tuple(FAMILIES)))


def test_every_noun_of_the_public_interface_has_a_row():
    assert len(NOUNS) > 40
    missing = [name for name in NOUNS if f"`{name}`" not in PAGE]
    assert missing == [], f"add a row to docs/glossary.md for {', '.join(missing)}"


@pytest.mark.parametrize("family", FAMILIES, ids=FAMILIES.get)
def test_a_family_of_stable_baselines3_or_gymnasium_has_one_row(family):
    assert any(issubclass(cls, family) for cls in CLASSES.values())
    assert [term for term in TERMS if re.match(rf"{FAMILIES[family]}\b", term)] != []


def test_no_row_names_a_class_that_is_not_exported():
    named = {name for term in TERMS for name in re.findall(r"`([A-Z]\w+[a-z]\w*)`", term)}
    assert len(named) > 40
    assert sorted(named - set(CLASSES)) == []


def test_a_term_has_one_row():
    words = [re.sub(r"`.*?`|[()]", "", term).strip(" ,") for term in TERMS]
    assert sorted({word for word in words if words.count(word) > 1} - {"term"}) == []


# The demo: a piece planned, cloned and trained.


DEMO = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "demo.py"))


@pytest.fixture
def demo(tmp_path, monkeypatch, capsys):
    """Return a function that runs the demo on a second of a piece, briefer, and what it printed."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    main = DEMO["main"]
    for name in ("EPISODES", "EPOCHS"):
        monkeypatch.setitem(main.__globals__, name, 4)
    settings = functools.partial(main.__globals__["load_fine_tuning"], learning_starts=100)
    monkeypatch.setitem(main.__globals__, "load_fine_tuning", settings)

    def run(steps):
        options = ["--seconds", "1", "--steps", str(steps), "--out", str(tmp_path / "out")]
        monkeypatch.setattr(sys, "argv", ["demo.py", "TwinkleTwinkle", *options])
        assert main() == 0
        return capsys.readouterr().out

    return run


def test_a_folder_with_the_runs_of_a_demo_is_refused_and_stays_as_it_is(demo, tmp_path, capsys):
    planned = tmp_path / "out" / "cloned"
    planned.mkdir(parents=True)
    (planned / "config.yml").write_text("algo: planned")
    (tmp_path / "out" / "piece.mid").write_text("that of the runs")
    with pytest.raises(SystemExit, match="2"):
        demo(steps=0)
    assert "has the runs of a demo already: expected another --out." in capsys.readouterr().err
    assert (tmp_path / "out" / "piece.mid").read_text() == "that of the runs"


@pytest.mark.slow
def test_it_judges_each_step_and_leaves_video_and_report(demo, tmp_path):
    scores = dict(re.findall(r"\| (\w+) +\| (\d\.\d+)", demo(steps=140)))
    assert list(scores) == ["resting", "planned", "cloned", "trained"]
    assert float(scores["planned"]) > float(scores["resting"])
    assert (tmp_path / "out" / "trained" / "play" / "performance.mp4").is_file()
    assert (tmp_path / "out" / "trained" / "evaluation" / "report.html").is_file()
