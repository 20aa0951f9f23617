"""Parts of pieces, in seconds and in bars."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from playing_scores import melody, piano, played
from random_scores import FINGERS, scores
from short_scores import score_of

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import Excerpt

SIX = melody(60, 61, 62, 63, 64, 65, length=1.0)  # bars at 0, 2 and 4 s


def pitches(score):
    return [note.pitch for note in score.notes]


def windows(env, score, count=200):
    """Return how often each part of a piece is played in several episodes, by its pitches."""
    random = np.random.default_rng(0)
    return Counter(
        "".join(chr(p) for p in pitches(env.change(score, random))) for _ in range(count)
    )


def text(*numbers):
    return "".join(map(chr, numbers))


class TestSeconds:
    def test_a_fixed_part_is_that_of_the_score(self):
        for span, arguments in (
            ((0, 4), {}),
            ((1.5, 3.5), {"start": 1.5, "length": 2}),
            ((4, 6), {"start": 4, "length": 10}),  # what is left of the piece
            ((0, 4), {"unit": "bars", "length": 2}),
            ((2, 4), {"unit": "bars", "start": 1, "length": 1}),
            ((4, 6), {"unit": "bars", "start": 2, "length": 2}),
        ):
            assert played(Excerpt(piano(SIX), **arguments)) == SIX.excerpt(*span)

    @pytest.mark.parametrize("start", [0, "random"])
    def test_a_piece_that_is_no_longer_is_played_whole(self, start):
        for length, unit in ((6, "seconds"), (7, "seconds"), (3, "bars"), (4.0, "bars")):
            assert played(Excerpt(piano(SIX), start=start, length=length, unit=unit)) is SIX

    def test_a_random_part_begins_with_a_note_and_lies_within_the_piece(self):
        drawn = windows(Excerpt(piano(), start="random", length=4), SIX, 600)
        assert set(drawn) == {text(60, 61, 62, 63), text(61, 62, 63, 64), text(62, 63, 64, 65)}
        assert all(150 < count < 250 for count in drawn.values())

    def test_notes_later_than_the_last_beginning_are_in_one_last_part(self):
        # From 3.5 s on 2.5 s are left: no note is struck there, but two are later.
        drawn = windows(Excerpt(piano(), start="random", length=2.5), SIX, 500)
        last = text(64, 65)
        assert set(drawn) == {
            *(text(first, first + 1, first + 2) for first in (60, 61, 62, 63)),
            last,
        }
        assert 60 < drawn[last] < 140
        random, env = np.random.default_rng(0), Excerpt(piano(), start="random", length=2.5)
        parts = [env.change(SIX, random) for _ in range(50)]
        assert {part.notes[0].onset for part in parts if pitches(part) == [64, 65]} == {0.5}

    @pytest.mark.slow
    @given(score=scores(FINGERS), length=st.floats(0.01, 9.0), seed=st.integers(0, 9))
    def test_a_random_part_always_has_notes_and_is_as_long_as_can_be(self, score, length, seed):
        env = Excerpt(piano(), start="random", length=length)
        random = np.random.default_rng(seed)
        start, end = env.draw(score, random)
        assert played(env, score=score, seed=seed).notes
        if score.duration <= length:
            assert (start, end) == (0, float("inf"))
        else:
            assert end - start == pytest.approx(length, abs=2e-6)
            assert start >= 0
            assert end <= score.duration + 2e-6

    def test_a_rounding_error_neither_loses_a_note_nor_adds_one(self):
        tenths = score_of(*((i / 10, (i + 1) / 10, 60 + i) for i in range(6)))
        assert tenths.notes[3].onset < 0.1 + 0.2  # which would then be struck before the end
        env = Excerpt(piano(tenths), start=0.1, length=0.2)
        assert pitches(played(env)) == [61, 62]
        env = Excerpt(piano(tenths), start=0.1 + 0.2, length=0.2)
        assert pitches(played(env)) == [63, 64]

    def test_a_silent_part_is_an_error_at_once_for_the_own_piece(self):
        message = r"No note of 'melody' is struck from 9.0 s to 10.0 s: its onsets lie"
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(SIX), start=9, length=1)
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(melody(*range(60, 72))), start=9, length=1).reset(options={"score": SIX})


class TestBars:
    def test_the_last_bar_lasts_until_the_end_of_the_piece(self):
        notes = [Note(onset=0, offset=1, pitch=60), Note(onset=2.5, offset=9, pitch=62)]
        score = Score(notes=notes, bars=[0, 2, 4, 6, 8])
        env = Excerpt(piano(score), start=1, length=1, unit="bars")
        assert [(n.onset, n.offset) for n in played(env).notes] == [(0.5, 7)]
        with pytest.raises(ScoreError, match="from bar 2: expected one of its bars, 0 to 1"):
            Excerpt(piano(score), start=2, length=1, unit="bars")

    def test_random_bars_are_equally_likely(self):
        drawn = windows(Excerpt(piano(), start="random", length=2, unit="bars"), SIX, 400)
        assert set(drawn) == {text(60, 61, 62, 63), text(62, 63, 64, 65)}
        assert 150 < drawn[text(60, 61, 62, 63)] < 250

    def test_a_random_part_begins_with_a_bar_in_which_a_note_is_struck(self):
        onsets = {0: 60, 0.5: 61, 6: 62, 10: 63}
        notes = [Note(onset=t, offset=t + 1, pitch=pitch) for t, pitch in onsets.items()]
        score = Score(notes=notes, bars=range(0, 20, 2))
        drawn = windows(Excerpt(piano(), start="random", length=1, unit="bars"), score)
        assert set(drawn) == {text(60, 61), text(62), text(63)}
        # Of the part that would begin with the last note, the first bar is empty.
        drawn = windows(Excerpt(piano(), start="random", length=2, unit="bars"), score)
        assert set(drawn) == {text(60, 61), text(62), text(63)}

    def test_an_upbeat_is_a_bar_of_its_own(self):
        notes = [Note(onset=t, offset=t + 1, pitch=60 + t) for t in range(5)]
        score = Score(notes=notes, bars=[1, 3])
        played_by = [
            pitches(played(Excerpt(piano(score), start=start, length=1, unit="bars")))
            for start in range(3)
        ]
        assert played_by == [[60], [61, 62], [63, 64]]

    def test_a_piece_without_bars_is_an_error_that_knows_a_way_out(self):
        plain = melody(60, 62, bars=(), title="plain")
        message = r"bars of 'plain' are not known: .* MusicXML file, or an excerpt in seconds"
        for start in (0, "random"):
            with pytest.raises(ScoreError, match=message):
                Excerpt(piano(plain), start=start, unit="bars")
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(), unit="bars").reset(options={"score": plain})
