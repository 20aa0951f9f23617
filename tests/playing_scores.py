"""What the tests of the score wrappers share: a piano, pieces, and what is played."""

import functools

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Note, Score


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
