"""What the package may cost its readers: lines of each room, modules, exported names.

Growing is a decision: whoever raises a budget says why in the commit that does. Whoever makes a
room smaller lowers its budget.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

import sb3_piano

PACKAGE = Path(sb3_piano.__file__).parent
TESTS = Path(__file__).parent

# Lines of each room, of Python alone. `base` are the modules beside the rooms.
LINES = {
    "base": 2_585,
    "batch": 2_487,
    "buffers": 654,
    "callbacks": 2_933,
    "cli": 3_446,
    "demonstrations": 1_502,
    "envs": 2_699,
    "hands": 650,
    "hyperparams": 39,
    "interop": 236,
    "jobs": 729,
    "lab": 7_695,
    "metrics": 1_416,
    "music": 9_090,
    "pipelines": 1_009,
    "planning": 3_073,
    "players": 2_321,
    "policies": 1_737,
    "reading": 403,
    "simulation": 986,
    "training": 6_327,
    "tuning": 1_260,
    "vec_env": 480,
    "viewing": 2_623,
    "wrappers": 2_269,
}

# Work that takes long, in all: jobs, the pipelines that are made of them, and tuning. The design
# has 3,000 lines for it.
LONG_WORK = ("jobs", "pipelines", "tuning")
LONG_WORK_LINES = 3_000

# Of all rooms but the lab, of the lab, and of the tests: lines, modules, exported names.
TOTALS = {
    "core": {"lines": 50_954, "modules": 338, "names": 227},
    "lab": {"lines": 7_695, "modules": 57, "names": 23},
    "tests": {"lines": 41_098},
}


def room_of(path: Path) -> str:
    first, *rest = path.relative_to(PACKAGE).parts
    return first if rest else "base"


def exported_names(text: str) -> int:
    """Return how many names a module has in ``__all__``."""
    return sum(
        len(ast.literal_eval(node.value))
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    )


@pytest.fixture(scope="module")
def spent() -> dict[str, Counter[str]]:
    """Return lines, modules and exported names of each room."""
    found: dict[str, Counter[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        each = {"lines": text.count("\n"), "modules": 1, "names": exported_names(text)}
        found.setdefault(room_of(path), Counter()).update(each)
    return found


def check(what: str, spent: int, budget: int) -> None:
    assert spent <= budget, (
        f"{what}: {spent}, {spent - budget} more than the budget. Make it smaller, or raise the "
        "budget and say why in the commit."
    )


def test_no_room_has_more_lines_than_its_budget(spent):
    assert set(spent) <= set(LINES), "a new room needs a budget"
    for room, of_room in spent.items():
        check(f"lines of {room}", of_room["lines"], LINES[room])


def test_work_that_takes_long_stays_within_one_budget(spent):
    lines = sum(spent.get(room, Counter())["lines"] for room in LONG_WORK)
    check("lines of jobs, pipelines and tuning", lines, LONG_WORK_LINES)


@pytest.mark.parametrize("part", ["core", "lab"])
def test_core_and_lab_stay_within_their_budgets(part, spent):
    rooms = [each for room, each in spent.items() if (room == "lab") == (part == "lab")]
    for what, budget in TOTALS[part].items():
        check(f"{what} of {part}", sum(each[what] for each in rooms), budget)


def test_the_tests_stay_within_their_budget():
    lines = sum(path.read_text(encoding="utf-8").count("\n") for path in TESTS.rglob("*.py"))
    check("lines of the tests", lines, TOTALS["tests"]["lines"])
