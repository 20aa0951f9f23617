"""What a study is: its settings, and what makes two studies the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_study import small_study

from sb3_piano.exceptions import ConfigError

MIDI_FILE = Path(__file__).parents[2] / "examples" / "five_fingers.mid"


@pytest.mark.parametrize("option", ["score", "fingering"])
def test_a_file_counts_by_its_content(option, tmp_path):
    copy = tmp_path / "elsewhere.mid"
    copy.write_bytes(MIDI_FILE.read_bytes())
    here, there = (small_study(entry={"env_kwargs": {option: str(f)}}) for f in (MIDI_FILE, copy))
    assert here.identity() == there.identity()
    copy.write_bytes(b"other")
    assert here.identity() != there.identity()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"metric": "f2"}, "metric is 'f2': expected one of 'f1', 'onset_f1'"),
        ({"objective": "last"}, "objective is 'last': expected one of 'final', 'best'"),
        ({"seeds": ()}, "seeds are"),
        ({"seeds": (1, 1)}, "seeds are"),
        ({"seeds": (-1,)}, r"seeds\[0\] is -1: expected a whole number, 0 or more"),
        ({"seeds": (3,), "eval_seed": 3}, "eval_seed is 3: expected a seed that no training has"),
        ({"eval_episodes": 0}, "eval_episodes is 0"),
        ({"n_evaluations": 41}, "n_evaluations is 41, in 40 steps"),
        ({"minutes": 0.0}, "minutes is 0.0: expected a finite number above 0"),
    ],
)
def test_a_setting_out_of_range_is_refused(setting, message):
    with pytest.raises(ConfigError, match=message):
        small_study(**setting)
