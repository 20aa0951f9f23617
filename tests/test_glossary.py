"""The glossary has a row for every noun of the public interface, and no stale row."""

import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import gymnasium as gym
import pytest
from stable_baselines3.common.buffers import BaseBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BaseModel
from stable_baselines3.common.vec_env import VecEnv

import sb3_piano.lab

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
