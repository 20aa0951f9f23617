"""The example that lets trained policies look ahead: what it keeps."""

from __future__ import annotations

import importlib.util
import types
from pathlib import Path

FILE = Path(__file__).parents[1] / "examples" / "curriculum" / "tree.py"


def test_a_policy_that_was_trained_further_is_measured_again(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("curriculum_tree", FILE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    steps, measured = 100, []

    def evaluate(folder, score, tree):
        measured.append(steps)
        mean = dict.fromkeys(("onset_f1", "f1", "effective_fingers", "return"), float(steps))
        found = {"num_timesteps": steps, "mean": mean, "tree": None}
        return types.SimpleNamespace(to_json=lambda: found)

    monkeypatch.setattr(example, "evaluate", evaluate)
    for steps in (100, 100, 200, 200):
        found = example.played(tmp_path, "a", None, steps)
        assert found == [steps] * 4 + [0, 0]
    assert measured == [100, 200]
