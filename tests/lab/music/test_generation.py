"""Generated music: valid, the same for the same seed, and for two hands of five fingers."""

from dataclasses import replace

import numpy as np
import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import generate_score
from sb3_piano.lab.music.generation import STYLES
from sb3_piano.lab.music.generation.frame import MAJOR, Frame, Tone
from sb3_piano.lab.music.generation.loudness import shaped
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import FINGERS_PER_HAND, KEY_IS_BLACK
from sb3_piano.music.fingering import apply_fingering, without_fingers
from sb3_piano.music.fingering.ergonomic import struck_together as chords_of
from sb3_piano.music.fingering.robot import release_early
from sb3_piano.music.fingering.split import assign_hands

DURATION = 12.0
SEEDS = range(3)


def generated(style: str, seed: int) -> Score:
    """Return a score whose draws differ from style to style, too."""
    return generate_score(np.random.default_rng([*style.encode(), seed]), DURATION, style)


def struck_together(score: Score, hand: str) -> list[list[int]]:
    """Return the pitches of each chord that a hand strikes."""
    notes = [note for note in score.notes if note.hand == hand]
    return [[notes[at].pitch for at in chord] for chord in chords_of(notes)]


@pytest.mark.parametrize("style", STYLES)
def test_a_style_is_music_for_two_hands(style):
    scores = [generated(style, seed) for seed in SEEDS]
    assert len({score.notes for score in scores}) == len(scores)
    for score in scores:
        assert score.title == f"generated {style}"
        assert score.notes[0].onset == 0
        assert DURATION - 3 < score.duration <= DURATION
        assert not score.has_fingering
        ends: dict[int, float] = {}
        for note in score.notes:  # a key is held once at a time
            assert note.onset >= ends.get(note.pitch, 0.0)
            ends[note.pitch] = note.offset
        for hand in ("right", "left"):
            for chord in struck_together(assign_hands(score), hand):
                assert len(chord) <= FINGERS_PER_HAND
                assert max(chord) - min(chord) <= 24
    pitches = np.concatenate([[note.pitch for note in score.notes] for score in scores])
    assert np.mean((pitches >= 36) & (pitches <= 96)) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("style", STYLES)
def test_the_robot_s_fingers_hold_nearly_all_notes_of_a_style(style):
    due = held = 0
    for seed in range(2):
        score = apply_fingering(generated(style, seed), "robot", 0.05)
        roll = release_early(PianoRoll.from_score(score, 0.05))
        due += np.count_nonzero(roll.active)
        held += np.count_nonzero(roll.active & (roll.finger >= 0))
    assert held > 0.95 * due


@pytest.mark.slow
def test_most_hands_are_found_again_where_nobody_tells_them():
    agree, notes = 0, 0
    for style in STYLES:
        score = generated(style, 1)
        if any(note.hand is None for note in score.notes):
            continue
        found = assign_hands(without_fingers(score, keep_hands=False))
        agree += sum(a.hand == b.hand for a, b in zip(score.notes, found.notes, strict=True))
        notes += len(score.notes)
    assert agree > 0.85 * notes


def test_the_same_seed_gives_the_same_music_and_another_one_other_music():
    one, same, other = (generate_score(np.random.default_rng(s), 8.0) for s in (5, 5, 6))
    assert one == same
    assert one.title == same.title
    assert one != other
    random = np.random.default_rng(0)
    with pytest.raises(ConfigError, match="Unknown style 'albert'.*Did you mean 'alberti'"):
        generate_score(random, 5.0, "albert")
    with pytest.raises(ConfigError, match="duration is 0.0: expected a finite number above 0"):
        generate_score(random, 0.0)


def test_a_phrase_rises_and_falls_its_beats_are_marked_and_its_highest_voice_leads():
    frame = Frame(
        random=np.random.default_rng(0),
        habits=0,
        tonic=0,
        scale=MAJOR,
        bar=4.0,
        beat=1.0,
        bars=2,
        chords=((0, 3),),
        register={"right": 72.0, "left": 48.0},
    )
    rows = (  # start, length, pitch, own accent; beat + rise of 9 (4 x (1 - x) - 2 / 3) - voicing
        (0.0, 4.0, 72, 0.0, 4 - 6),
        (0.0, 1.0, 48, 0.0, 4 - 6 - 12),
        (1.0, 1.0, 52, 0.0, 2 - 2.0625 - 12),
        (1.5, 1.0, 76, 0.0, -0.5156),
        (4.0, 1.0, 50, 0.0, 4 + 3),  # the middle; the melody has ended
        (6.0, 1.0, 50, 8.0, 8 + 0.75),
    )
    tones = [
        Tone(start=start, length=length, pitch=pitch, hand="right", accent=accent)
        for start, length, pitch, accent, _ in rows
    ]
    found = shaped(tones, frame, arch=9.0, voicing=12.0)
    np.testing.assert_allclose([t.accent for t in found], [row[-1] for row in rows], atol=1e-4)
    assert [replace(t, accent=0.0) for t in found] == [replace(t, accent=0.0) for t in tones]


def test_the_highest_voice_is_louder_by_10_to_15_velocities():
    leads = []
    for style in STYLES:
        notes = generated(style, 0).notes
        onset, offset, pitch, loud = np.array(
            [(n.onset, n.offset, n.pitch, n.velocity) for n in notes]
        ).T
        together = (onset <= onset[:, None] + 0.02) & (offset > onset[:, None] + 0.02)
        below = (together & (pitch > pitch[:, None])).any(axis=1)
        if below.any():
            leads.append(loud[~below].mean() - loud[below].mean())
    assert 10 < np.mean(leads) < 15


@pytest.mark.slow
def test_all_keys_tempi_and_touches_occur():
    scores = [generate_score(np.random.default_rng(seed), 6.0) for seed in range(120)]
    black = [np.mean([KEY_IS_BLACK[note.key] for note in score.notes]) for score in scores]
    assert min(black) < 0.05
    assert max(black) > 0.65
    rates = [len(score.notes) / score.duration for score in scores]
    assert min(rates) < 2.5
    assert max(rates) > 12
    lengths = [np.median([note.duration for note in score.notes]) for score in scores]
    assert min(lengths) < 0.1
    assert max(lengths) > 1
    assert {note.hand for score in scores for note in score.notes} == {"right", "left", None}
    assert 0.1 < np.mean([bool(score.pedals) for score in scores]) < 0.6
    assert len({score.title for score in scores}) == len(STYLES)
