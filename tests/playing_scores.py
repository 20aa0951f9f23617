"""What the tests of the score wrappers share: a piano, pieces, and what is played."""

from __future__ import annotations

import functools

from hypothesis import strategies as st

from sb3_piano.envs import PianoEnv
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Pedal, Score


def melody(*pitches, title="melody", length=1.0, **fields):
    """Return a score of one note after the other, with a finger each and bars of two notes."""
    notes = [
        Note(onset=i * length, offset=(i + 1) * length, pitch=pitch, finger=i % 10)
        for i, pitch in enumerate(pitches)
    ]
    bars = [note.onset for note in notes[::2]]
    return Score(notes=notes, title=title, **{"bars": bars, **fields})


@functools.cache
def piano(score=None):
    """Return a piano; the same for the same score."""
    return PianoEnv(score or melody(60, 64, 67, 72), physics="fast", n_steps_lookahead=0)


def played(env, *, seed=None, **options):
    """Begin an episode and return the score that is played in it."""
    env.reset(seed=seed, options=options)
    return env.unwrapped.score


def titles(env, count, *, seed=0):
    """Return what is played in several episodes, seeded once."""
    return [played(env, seed=seed if i == 0 else None).title for i in range(count)]


@st.composite
def scores(draw):
    """Return a score of one to five notes, with a pedal and bars."""
    times = st.integers(0, 40).map(lambda step: step / 8)
    notes = [
        Note(
            onset=(onset := draw(times)),
            offset=onset + draw(st.integers(1, 8)) / 8,
            pitch=draw(st.integers(MIN_PITCH, MAX_PITCH)),
            velocity=draw(st.integers(1, 127)),
            finger=draw(st.integers(-1, 9)),
        )
        for _ in range(draw(st.integers(1, 5)))
    ]
    bars = sorted(draw(st.sets(times, max_size=3)))
    return Score(notes=notes, pedals=[Pedal(onset=0.5, offset=1.5)], title="drawn", bars=bars)
