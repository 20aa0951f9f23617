"""Excerpts of a corpus as the pieces of episodes."""

import itertools

import pytest
from playing_scores import piano, titles

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import CorpusExcerpt
from sb3_piano.wrappers import Excerpt, KeyRange

CORPUS = {"n": 50, "duration": 1.0}


def test_an_excerpt_is_played_in_so_many_episodes_in_a_row():
    once, thrice = (CorpusExcerpt(piano(), CORPUS, episodes) for episodes in (1, 3))
    drawn = titles(once, 4, seed=5)
    assert len(set(drawn)) > 1
    expected = list(itertools.chain.from_iterable([title] * 3 for title in drawn))
    assert titles(thrice, 12, seed=5) == expected
    titles(thrice, 1, seed=6)  # two of the three are left, and a seed begins anew
    assert titles(thrice, 12, seed=5) == expected
    with pytest.raises(ConfigError, match="episodes is 0: expected"):
        CorpusExcerpt(piano(), CORPUS, episodes=0)


def test_a_fixed_part_of_excerpts_is_played_whichever_wrapper_is_outside():
    part, longer = {"start": 0.9, "length": 1.5}, {**CORPUS, "duration": 4.0}
    inside = CorpusExcerpt(Excerpt(piano(), **part), longer)
    outside = Excerpt(CorpusExcerpt(piano(), longer), **part)
    for env in (inside, outside, KeyRange(inside, 88)):
        env.reset(seed=5)
        assert 0 < env.unwrapped.score.duration <= 1.5
