"""The opening of the Nocturne is what Chopin wrote, and ten fingers can play it."""

from __future__ import annotations

import importlib.util
import itertools
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import MAX_PITCH, MIN_PITCH, PianoRoll, read_midi

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "examples" / "sac_vs_td3" / "nocturne.py"
MIDI = SCRIPT.with_suffix(".mid")
EIGHTH = 60 / 132
RIGHT, LEFT = range(5), range(5, 10)

# MIDI pitches and lengths in eighths, read off the first edition of M. Schlesinger.
MELODY = [
    (70, 1),
    *[(79, 4), (77, 1), (79, 1), (77, 3), (75, 2), (70, 1)],
    *[(79, 2), (72, 1), (84, 2), (79, 1), (82, 3), (80, 2), (79, 1)],
    *[(77, 3), (79, 2), (74, 1), (75, 3), (72, 3)],
    *[(70, 1), (86, 1), (84, 1)],
    *[(82, 0.5), (80, 0.5), (79, 0.5), (80, 0.5), (72, 0.5), (74, 0.5), (75, 3)],
]
BASS = [39, 51, 39, 38, 36, 48, 41, 41, 46, 47, 48, 45, 46, 34, 39, 51]

# Root (C is 0) and intervals of the chord on each beat, and what its bass adds to it.
MAJOR, MINOR, SEVENTH, DIMINISHED = {0, 4, 7}, {0, 3, 7}, {0, 4, 7, 10}, {0, 3, 6, 9}
E_FLAT, B_FLAT = (3, MAJOR), (10, SEVENTH)
HARMONY = [
    *[E_FLAT, (2, DIMINISHED), E_FLAT, E_FLAT],
    *[(0, SEVENTH), (0, SEVENTH), (4, DIMINISHED), (5, MINOR)],
    *[B_FLAT, (7, SEVENTH), (0, MINOR), (9, DIMINISHED)],
    *[(10, {0, 5, 7, 10}), B_FLAT, E_FLAT, E_FLAT],
]
FOREIGN_BASS = {1, 3, 6}  # beats: E flat under D diminished, a passing D, F under E diminished


@pytest.fixture(scope="module")
def nocturne():
    spec = importlib.util.spec_from_file_location("nocturne", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def score(nocturne):
    return nocturne.build()


def hand(score, fingers):
    return [note for note in score.notes if note.finger in fingers]


def beats(score):
    """Return the left hand's notes by beat, 16 lists, each in order."""
    left = hand(score, LEFT)
    number = [round((note.onset / EIGHTH - 1) // 3) for note in left]
    return [[note for note, at in zip(left, number, strict=True) if at == k] for k in range(16)]


def test_the_midi_file_is_what_the_script_builds(score):
    stored = read_midi(MIDI)
    assert [(n.pitch, n.finger, n.velocity) for n in stored.notes] == [
        (n.pitch, n.finger, n.velocity) for n in score.notes
    ]
    for events in ("notes", "pedals"):
        times = [
            [(event.onset, event.offset) for event in getattr(piece, events)]
            for piece in (stored, score)
        ]
        np.testing.assert_allclose(times[0], times[1], atol=1e-3)


def test_the_midi_file_makes_the_same_roll(score):
    stored, built = (PianoRoll.from_score(piece, 0.05) for piece in (read_midi(MIDI), score))
    for name in ("active", "finger", "onset", "sustain"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(built, name))


def test_the_melody_is_that_of_the_first_edition(score):
    right = hand(score, RIGHT)
    assert [note.pitch for note in right] == [pitch for pitch, _ in MELODY]
    lengths = [length * EIGHTH for _, length in MELODY]
    np.testing.assert_allclose(
        [note.onset for note in right], np.cumsum([0, *lengths[:-1]]), atol=1e-9
    )
    np.testing.assert_allclose([n.duration for n in right], np.array(lengths) - 0.05, atol=1e-9)


def test_each_beat_is_a_bass_note_and_two_chords_of_its_harmony(score):
    assert [notes[0].pitch for notes in beats(score)] == BASS
    for number, (notes, (root, intervals)) in enumerate(zip(beats(score), HARMONY, strict=True)):
        eighths = [round(note.onset / EIGHTH) - 1 - 3 * number for note in notes]
        assert eighths in ([0, 1, 1, 2, 2, 2], [0, 1, 1, 2, 2])
        foreign = {BASS[number] % 12} if number in FOREIGN_BASS else set()
        chord = {(root + interval) % 12 for interval in intervals}
        sounding = {note.pitch % 12 for note in notes} - foreign
        assert sounding <= chord, number
        assert len(chord - sounding) <= len(foreign), number  # one note is left to the melody


def test_the_pedal_goes_down_with_the_bass_and_up_with_the_second_chord(score):
    basses = [notes[0].onset for notes in beats(score)]
    np.testing.assert_allclose([pedal.onset for pedal in score.pedals], basses[:15], atol=1e-9)
    durations = [pedal.offset - pedal.onset for pedal in score.pedals]
    np.testing.assert_allclose(durations, [2 * EIGHTH] * 14 + [6 * EIGHTH], atol=1e-9)


def test_all_notes_have_fingers_and_keys(score):
    assert all(0 <= note.finger <= 9 for note in score.notes)
    assert all(MIN_PITCH <= note.pitch <= MAX_PITCH for note in score.notes)


def test_each_note_is_a_strike_of_its_own(score):
    roll = PianoRoll.from_score(score, 0.05)
    assert np.count_nonzero(roll.onset) == len(score.notes) == 124
    assert len(roll) == 444


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_no_finger_is_due_on_two_keys_at_any_of_the_paper_s_speeds(score, factor):
    labels = PianoRoll.from_score(score.stretch(factor), 0.05).finger
    for finger in range(10):
        assert (labels == finger).sum(axis=1).max() == 1


def test_no_finger_holds_a_key_while_it_strikes_another(score):
    for finger in range(10):
        notes = hand(score, [finger])
        for note, following in itertools.pairwise(notes):
            assert note.offset <= following.onset - 0.05


def test_the_fingers_of_a_chord_are_in_order_and_within_reach(score):
    labels = PianoRoll.from_score(score, 0.05).finger
    for step in labels:
        right, left = ([key for key in range(88) if step[key] in five] for five in (RIGHT, LEFT))
        assert list(step[right]) == sorted(set(step[right]))
        assert list(step[left]) == sorted(set(step[left]), reverse=True)
        assert all(max(keys) - min(keys) <= 14 for keys in (right, left) if keys)
        assert not right or not left or min(right) > max(left)


def test_the_left_hand_has_time_to_leap(score):
    left = hand(score, LEFT)
    onsets = sorted({note.onset for note in left})
    for note in left:
        later = [onset for onset in onsets if onset > note.onset]
        assert not later or note.offset <= later[0] - 0.0999


@pytest.mark.parametrize(
    ("right", "left", "message"),
    [
        ("C5/1*3", "-*2 G3/5", r"bar 7, right hand: .* add up to 3 eighths: expected 4"),
        ("-*4", "G3/5 -*3.5", r"bar 7, left hand: .* add up to 4.5 eighths: expected 4"),
        ("H5/1*4", "-*4", r"bar 7, right hand: 'H5/1\*4' is no note: expected one such as"),
        ("-*4", "G3/6*4", r"bar 7, left hand: 'G3/6\*4' is no note"),
        ("-*4", "C3+G3/5*4", r"bar 7, left hand: 'C3\+G3/5\*4' has 1 fingers: .* its 2 notes"),
    ],
)
def test_bad_notation_is_refused_with_its_bar(nocturne, right, left, message):
    with pytest.raises(ScoreError, match=message):
        nocturne.build([nocturne.Bar("bar 7", right, left, 4, ())])


def test_importing_the_script_writes_nothing_and_running_it_the_midi_file(tmp_path, capsys):
    copy = Path(shutil.copy(SCRIPT, tmp_path))
    runpy.run_path(str(copy), run_name="nocturne")
    assert [path.suffix for path in tmp_path.iterdir() if path.is_file()] == [".py"]
    runpy.run_path(str(copy), run_name="__main__")
    assert read_midi(copy.with_suffix(".mid")) == read_midi(MIDI)
    printed = capsys.readouterr().out
    assert re.search(r"124 notes in 22\.17 s, pitches 34 to 86 .*, 444 control steps", printed)


def test_an_environment_plays_it(monkeypatch):
    monkeypatch.chdir(ROOT)
    env = PianoEnv("examples/sac_vs_td3/nocturne.mid")
    env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    assert not terminated
    assert not truncated
    assert info["reward_terms"]["fingering"] >= 0.0
    assert len(env.roll) == 444
    env.close()
