"""Legato pedalling from the notes alone: up at changes of harmony and rests, down after them."""

import dataclasses

import pytest
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Pedal, load_score
from sb3_piano.music.pedalling import legato_pedal, pedalled

C_MAJOR, G_MAJOR = (48, 60, 64, 67), (43, 59, 62, 67)


def chords(*harmonies, rest=0.0):
    """Return a score of chords of a second each, struck twice."""
    return score_of(
        *(
            (start + half, start + half + 0.5 - rest / 2, pitch, -1)
            for start, pitches in enumerate(harmonies)
            for half in (0.0, 0.5)
            for pitch in pitches
        ),
        title="chords",
    )


def spans(pedals):
    return [(round(pedal.onset, 3), round(pedal.offset, 3)) for pedal in pedals]


def test_the_pedal_stays_down_while_a_harmony_lasts_and_comes_up_with_a_new_one_and_at_rests():
    score = chords(C_MAJOR, G_MAJOR, C_MAJOR)
    assert spans(legato_pedal(score)) == [(0.1, 1.0), (1.1, 2.0), (2.1, 3.0)]
    assert spans(legato_pedal(chords(C_MAJOR, C_MAJOR))) == [(0.1, 2.0)]
    late = [(start + 2.0, end + 2.0, pitch, finger) for start, end, pitch, finger in C_ONCE]
    assert spans(legato_pedal(score_of(*C_ONCE, *late))) == [(0.1, 1.0), (2.1, 3.0)]


C_ONCE = [(0.0, 1.0, pitch, -1) for pitch in C_MAJOR]


def test_bars_of_a_prelude_get_their_own_pedal():
    score = load_score("BachPreludeC")
    ups = [pedal.offset for pedal in legato_pedal(score)]
    near = [min(abs(up - bar) for up in ups) < 0.01 for bar in score.bars[1:]]
    assert sum(near) > 0.5 * len(near)


@pytest.mark.parametrize(("pedal", "expected"), [("score", 1), ("none", 0), ("auto", 1)])
def test_a_written_pedal_stays_unless_none_is_asked_for(pedal, expected):
    written = dataclasses.replace(chords(C_MAJOR), pedals=(Pedal(onset=0.0, offset=0.5),))
    assert spans(pedalled(written, pedal).pedals) == [(0.0, 0.5)] * expected


def test_an_environment_asks_for_this_pedal_and_says_so():
    env = PianoEnv(chords(C_MAJOR, G_MAJOR), pedal="auto", physics="fast")
    env.reset()
    assert env.roll.sustain.tolist()[:22] == [False] * 2 + [True] * 18 + [False] * 2
    assert env.goal.adds_pedal
    plain = PianoEnv(chords(C_MAJOR, G_MAJOR), physics="fast")
    plain.reset()
    assert not plain.roll.sustain.any()
    assert not plain.goal.adds_pedal
