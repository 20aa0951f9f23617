"""The package as a whole: its public names, its rooms and who may import whom."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import yaml
from fresh_python import run_python
from yaml_rows import Tables

import sb3_piano

tables = Tables(__file__)

PACKAGE = Path(sb3_piano.__file__).parent
ROOT = Path(__file__).parents[1]

ROOMS, LAB = tables["rooms"], tables["lab"]


PACKAGES = [r for r in (*ROOMS, *(f"lab/{r}" for r in LAB)) if (PACKAGE / r).is_dir()]


@pytest.mark.parametrize("room", ["", *(f".{r.replace('/', '.')}" for r in PACKAGES)])
def test_every_public_name_exists(room):
    if room == ".interop":
        pytest.importorskip("dm_env")
    module = importlib.import_module(f"sb3_piano{room}")
    for name in getattr(module, "__all__", ()):
        assert hasattr(module, name), f"{module.__name__}.{name}"


IMPORTED = re.compile(r"^\s*(?:from|import) sb3_piano\.([\w.]+)", re.MULTILINE)


def run(program: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an interpreter of its own."""
    command = [sys.executable, *options, "-c", textwrap.dedent(program)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.parametrize(("folder", "rooms"), [("", ROOMS), ("lab", LAB)], ids=["all", "lab"])
def test_a_room_imports_only_from_rooms_before_it(folder, rooms):
    """In particular nothing imports the lab, but that the command line's table names it."""
    inside = f"{folder}." if folder else ""
    for path in (PACKAGE / folder).rglob("*.py"):
        room = path.relative_to(PACKAGE / folder).parts[0].removesuffix(".py")
        if room in ("__init__", "__main__"):
            continue
        named = IMPORTED.findall(path.read_text(encoding="utf-8"))
        modules = (m for m in named if m.startswith(inside))
        imported = {m.removeprefix(inside).partition(".")[0] for m in modules}
        assert imported <= set(rooms[: rooms.index(room) + 1]), path


# Libraries that take a tenth of a second or more, or draw.
DRAWING = {"matplotlib", "PIL", "imageio_ffmpeg", "av", "jinja2", "plotly"}
BRIDGES = {"dm_control", "dm_env", "labmaze"}  # to other programs, not to be had on every Python
LEARNING = {"torch", "stable_baselines3", "sb3_contrib", "optuna", "minari", "ray", "pandas"}
HEAVY = (
    DRAWING | LEARNING | {"scipy", "mujoco", "OpenGL", "pydantic", "yaml", "pretty_midi", "mido"}
)


HELP = """
from sb3_piano.cli.main import COMMANDS, parser_of
for name in COMMANDS.keys() - {'corpus'}:  # read from its settings
    parser_of([name])
"""
# One after the other in one process, and what has not been imported until then.
PROGRAMS = {
    "import sb3_piano": HEAVY,
    "from sb3_piano.cli import main\nwith suppress(SystemExit): main(['--help'])": HEAVY,
    HELP: {"torch", "stable_baselines3", "mujoco", "OpenGL", "scipy"},
    "print(sb3_piano.envs.PianoEnv.__name__, hasattr(sb3_piano, 'nothing'))": DRAWING | LEARNING,
    "import sb3_piano.envs, sb3_piano.viewing, sb3_piano.wrappers": (
        DRAWING | LEARNING | {"scipy.optimize", "scipy.ndimage"}
    ),
}
PLANNER = """
from sb3_piano import envs, music, players
env = envs.PianoEnv(music.Score(notes=[music.Note(onset=0.5, offset=0.7, pitch=60)]))
players.make_player('planned', env).predict(env.reset()[0])
"""
TELL = "\nprint('modules', *sys.modules)\n"


@pytest.mark.parametrize(
    "programs",
    [
        PROGRAMS,
        pytest.param({PLANNER: DRAWING | LEARNING}, marks=pytest.mark.slow),
    ],
    ids=["parts", "planner"],
)
def test_what_takes_long_to_be_imported_is_not_where_it_is_not_needed(programs):
    text = "".join(program + TELL for program in programs)
    done = run(f"import sys\nfrom contextlib import suppress\n{text}", "-W", "error")
    assert (done.returncode, done.stderr) == (0, "")
    lines = [line.split() for line in done.stdout.splitlines() if line.startswith("modules ")]
    for (program, unneeded), modules in zip(programs.items(), lines, strict=True):
        assert not (unneeded | BRIDGES) & set(modules), program
    assert ("PianoEnv False" in done.stdout) == (programs is PROGRAMS)


TO_PLAY = (PACKAGE.parent / "requirements-play.txt").read_text().splitlines()

# What players never see: all that requirements-play.txt leaves out.
WITHOUT = """
import importlib.metadata, re, sys
listed = {{re.sub("[_-]", "", name).lower() for name in {listed}}} | {{"sb3piano"}}
for module, homes in importlib.metadata.packages_distributions().items():
    if not listed & {{re.sub("[_-]", "", home).lower() for home in homes}}:
        sys.modules[module] = None  # importing it raises ImportError
from sb3_piano.cli import main
sys.exit(main({arguments}))
"""


@pytest.mark.slow
@tables("more, arguments, code, said")
def test_what_requirements_play_lists_is_enough_to_play(more, arguments, code, said, tmp_path):
    listed = [line for line in TO_PLAY if not line.startswith("#")]
    piece = ["--set", "physics=fast", "--out", str(tmp_path), "--no-progress"]
    command = ["play", "CMajorChordProgressionTwoHands", *piece, *arguments]
    done = run(WITHOUT.format(listed=listed + more, arguments=command))
    assert done.returncode == code, done.stderr
    assert said in done.stdout + done.stderr
    assert (tmp_path / "performance.mid").exists()


@pytest.mark.slow
def test_no_module_of_posix_is_needed_to_import_play_and_train(tmp_path):
    program = """
        import importlib, pkgutil, signal, sys
        for name in ("fcntl", "grp", "pwd", "resource", "termios"):
            sys.modules[name] = None  # importing it raises ImportError
        del signal.pthread_sigmask
        import gymnasium, sb3_piano
        for module in pkgutil.walk_packages(sb3_piano.__path__, "sb3_piano."):
            if module.name != "sb3_piano.batch.warp_worlds":  # of an extra
                importlib.import_module(module.name)
        env_id = "RoboPianist-debug-CMajorScaleOneHand-v0"
        env = gymnasium.make(env_id)
        env.reset(seed=0)
        env.step(env.action_space.sample())
        from sb3_piano.cli import main
        sys.exit(main(["train", "--algo", "td3", "--env", env_id, "--steps", "3", "--no-progress"]))
    """
    done = run_python(["-c", textwrap.dedent(program)], tmp_path)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob("runs/td3/*/model.zip"))


def test_package_citation_and_changelog_name_the_same_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.search(r"^## (\d\S*) \((.*)\)$", changelog, re.MULTILINE)
    assert released.groups() == (citation["version"], str(citation["date-released"]))
    assert citation["version"] == sb3_piano.__version__


def test_an_entry_of_the_changelog_is_one_line_under_its_heading():
    _, *lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")
    for line in "\n".join(lines).splitlines():
        known = re.match(
            r"- \S|### (Behaviour|Added|Changed|Fixed)$|Unreleased$|\d\S* \(.*\)$", line
        )
        assert not line or known, line
        assert len(line) <= 132
