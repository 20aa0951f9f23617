"""All metrics of whole performances, worked by hand."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.envs import RETURN_KEYS
from sb3_piano.metrics import DEFINITIONS, EPISODE_METRICS, Onsets, episode_metrics, frame_scores
from sb3_piano.metrics.episode import FINGER_SHARES, has_value, normalized_return
from sb3_piano.metrics.fingers import fingering_agreement
from sb3_piano.metrics.musicianship import MUSICIANSHIP
from sb3_piano.metrics.presses import wrong_presses
from sb3_piano.music import PianoRoll

tables = Tables(__file__)

DT = 0.05


class Played(NamedTuple):
    """What sounded in T control steps, by which fingers, when keys were struck, and the pedal."""

    keys: np.ndarray
    finger: np.ndarray
    onsets: Onsets
    pedal: np.ndarray


def played(presses, steps, pedal=()):
    """Play presses of (key, strike, release, finger), times in s, noted at the end of each step."""
    keys, fingers = np.zeros((steps, 88), dtype=bool), np.full((steps, 88), -1, dtype=np.int8)
    for key, strike, release, finger in presses:
        sounds = [k for k in range(steps) if strike < (k + 1) * DT - 1e-9 <= release]
        keys[sounds, key], fingers[sounds, key] = True, finger
    strikes = Onsets(np.array([p[1] for p in presses]), np.array([p[0] for p in presses], np.intp))
    pedals = np.zeros(steps, dtype=bool)
    pedals[list(pedal)] = True
    return Played(keys, fingers, strikes, pedals)


def judge(due: Played, done: Played):
    target = {f"target_{name}": array for name, array in due._asdict().items()}
    played = {f"played_{name}": array for name, array in done._asdict().items()}
    played["press_finger"] = played.pop("played_finger")
    return episode_metrics(**target, **played, control_timestep=DT)


def assert_scores(metrics, **expected):
    assert {name: metrics[name] for name in expected} == pytest.approx(expected)


PIECE = [(39, 0.1, 0.3, 0), (41, 0.3, 0.5, 1)]
"""Middle C with the thumb in steps 2-5, D with the forefinger in steps 6-9."""

STEPS = 12
"""Steps 0, 1, 10 and 11 are silent: playing nothing has F1 4 / 12."""

DUE = played(PIECE, STEPS)


def test_perfect_playing():
    """All shares are 1 and all errors 0; two fingers press four steps each.

    Effective fingers: 2 in all, 2 of the right hand, 0 of the left.
    """
    metrics = judge(DUE, DUE)
    none = ("onset_error_mean_ms", "onset_error_std_ms", "wrong_presses_per_second")
    others = dict.fromkeys((*none, "effective_fingers_left", *FINGER_SHARES[2:]), 0.0)
    others |= {"effective_fingers": 2.0, "effective_fingers_right": 2.0, "noop_f1": 4 / 12}
    others |= dict.fromkeys(FINGER_SHARES[:2], 0.5)
    assert metrics == pytest.approx(dict.fromkeys(EPISODE_METRICS[:-1], 1.0) | others)


def test_all_keys_at_once():
    """All 88 keys are struck at 0 s and held.

    In 8 of 12 steps 1 of 88 sounding keys is right: precision 1/88, recall 1, F1 2 / (88 + 1); in
    the other 4 they are 0, 1 and 0. No strike is within 50 ms of 0.1 s or 0.3 s. 86 keys are due
    at no step of the 0.6 s. The right thumb has half the keys, the left one the other half.
    """
    presses = [(key, 0.0, 0.6, 0 if key >= 44 else 5) for key in range(88)]
    metrics = judge(DUE, played(presses, STEPS))
    assert_scores(metrics, precision=8 / 12 / 88, recall=1.0, f1=8 / 12 * 2 / 89)
    assert_scores(metrics, non_silent_f1=2 / 89, wrong_presses_per_second=86 / 0.6)
    assert_scores(metrics, onset_precision=0.0, onset_recall=0.0, onset_f1=0.0)
    assert_scores(metrics, effective_fingers=2.0, effective_fingers_right=1.0)
    assert_scores(metrics, effective_fingers_left=1.0, finger_share_r1=0.5, finger_share_l1=0.5)


def shifted(seconds):
    return played([(k, on + seconds, off + seconds, f) for k, on, off, f in PIECE], STEPS)


def test_a_unison_of_both_hands_is_one_strike():
    """Two notes of one key at one time are one strike of the roll, and one strike hits it."""
    roll = PianoRoll.from_score(score_of((0.1, 0.3, 60, 0), (0.1, 0.3, 60, 5)), DT)
    metrics = judge(due_of(roll), played([(39, 0.1, 0.3, 0)], len(roll)))
    assert_scores(metrics, f1=1.0, onset_precision=1.0, onset_recall=1.0, onset_f1=1.0)


def test_pedal_only():
    """Due in steps 0-3, down in 0, 1 and 4, of six: the keys, all silent, are all right.

    Precision is 0 in step 4, recall in 2 and 3, F1 in 2, 3 and 4.
    """
    metrics = judge(played([], 6, pedal=(0, 1, 2, 3)), played([], 6, pedal=(0, 1, 4)))
    assert_scores(metrics, sustain_precision=5 / 6, sustain_recall=4 / 6, sustain_f1=3 / 6)
    assert_scores(metrics, precision=1.0, f1=1.0, onset_f1=1.0, non_silent_f1=1.0, noop_f1=1.0)


def test_an_empty_piece():
    """Without a step everything that can be right is right, and nobody has done anything."""
    metrics = judge(played([], 0), played([], 0))
    done = ("finger_share", "effective", "onset_error", "wrong_presses")
    assert metrics == {name: float(not name.startswith(done)) for name in EPISODE_METRICS[:-1]}


@pytest.mark.parametrize("compare", [frame_scores, fingering_agreement, wrong_presses])
def test_arrays_of_different_shapes_are_refused(compare):
    with pytest.raises(ValueError, match=r"one shape, got \(2, 88\) and \(3, 88\)"):
        compare(np.zeros((2, 88)), np.zeros((3, 88)))


def test_metrics_are_plain_floats_in_the_order_of_their_names():
    metrics = judge(DUE, shifted(0.04))
    assert (*metrics, "normalized_return") == EPISODE_METRICS
    assert {type(value) for value in metrics.values()} == {float}


@pytest.mark.parametrize(
    ("value", "highest", "expected"), [(30, 40, 0.75), (-4, 40, -0.1), (0, 0, 1.0), (40, 40, 1.0)]
)
def test_the_normalized_return_is_a_share_of_the_highest(value, highest, expected):
    share = normalized_return(value, highest)
    assert share == pytest.approx(expected)
    assert type(share) is float


def due_of(roll):
    """Return what a roll asks for as if it had been played so, unlabelled keys by the thumb."""
    fingers = np.where(roll.active & (roll.finger < 0), 0, roll.finger).astype(np.int8)
    strikes = Onsets(roll.onset_time, np.nonzero(roll.onset)[1])
    return Played(roll.active, fingers, strikes, roll.sustain)


# Each number of an episode has words, and one set of them.


def test_every_number_of_an_episode_is_defined_and_no_other():
    expected = [*EPISODE_METRICS, *MUSICIANSHIP, *RETURN_KEYS, "return", "length"]
    assert sorted(DEFINITIONS) == sorted(expected)
    assert all(name == definition.name for name, definition in DEFINITIONS.items())


def test_no_two_numbers_have_the_same_words():
    labels = [definition.label for definition in DEFINITIONS.values()]
    shorts = [(definition.section, definition.short) for definition in DEFINITIONS.values()]
    meanings = [definition.meaning for definition in DEFINITIONS.values()]
    for words in (labels, shorts, meanings):
        assert len(set(words)) == len(words)


def test_what_is_about_the_same_stands_together():
    of_each = [definition.section for definition in DEFINITIONS.values()]
    sections = [section for section, _ in itertools.groupby(of_each)]
    assert len(set(sections)) == len(sections) == 6


@pytest.mark.parametrize("definition", DEFINITIONS.values(), ids=DEFINITIONS)
def test_words_fit_in_a_line_and_end_as_they_should(definition):
    assert definition.meaning.endswith(".")
    assert definition.meaning[0].isupper()
    assert len(definition.meaning) <= 100
    for words in (definition.label, definition.short):
        assert words.startswith("F1") or words[0].islower()
        assert len(words) <= 40
    assert (definition.unit == "ms") == definition.name.endswith("_ms")
    assert (definition.unit == "/s") == definition.name.endswith("_per_second")


@tables("name, value, text")
def test_a_value_has_as_many_decimals_as_are_worth_showing(name, value, text):
    assert DEFINITIONS[name].rounded(value) == text


@tables("name, metrics, expected")
def test_timing_and_fingers_have_a_value_where_something_was_hit(name, metrics, expected):
    assert has_value(name, metrics) is expected
