"""Hyperparameters for the piano environments, one YAML file per algorithm in RL Zoo's form."""

from __future__ import annotations

from pathlib import Path

PRESETS = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.yml"))}
"""The files by the name of their algorithm."""

SIGHT_READER = Path(__file__).parent / "sight_reader" / "ppo.yml"
"""PPO on many pieces, from a distilled network of a hand."""
