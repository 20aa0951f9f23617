"""Finger labels out of sight: nothing of what is observed depends on them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from side_by_side import TINY, block, episode

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Score
from sb3_piano.wrappers import HideFingering, KeyRange, Lookahead, PreviousActionReward

STACKS = {
    "alone": HideFingering,
    "around labels ahead": lambda env: HideFingering(Lookahead(env, 8, stride=2, fingers=True)),
    "inside of a lookahead": lambda env: Lookahead(HideFingering(env), 20),
    "between": lambda env: KeyRange(
        HideFingering(KeyRange(Lookahead(env, 4, fingers=True), 88)), 36, outside="hide"
    ),
}


def with_fingers(score, fingers):
    notes = [dataclasses.replace(n, finger=f) for n, f in zip(score.notes, fingers, strict=True)]
    return Score(notes=notes, pedals=score.pedals, title=score.title)


FINGERS = st.lists(st.integers(-1, 9), min_size=len(TINY.notes), max_size=len(TINY.notes))


@pytest.mark.slow
@pytest.mark.parametrize("stack", STACKS.values(), ids=STACKS)
@settings(max_examples=6, deadline=None)
@given(first=FINGERS, second=FINGERS, seed=st.integers(0))
def test_pieces_that_differ_in_their_labels_only_look_the_same(stack, first, second, seed):
    envs = [
        stack(PianoEnv(with_fingers(TINY, fingers), physics="fast", fingering_reward="off"))
        for fingers in (first, second)
    ]
    for one, other in episode(*envs, seed=seed):
        np.testing.assert_array_equal(one, other)


def test_the_labels_are_zeros_and_everything_else_is_there_in_its_place():
    def piano():
        return Lookahead(PianoEnv(TINY, physics="fast"), 4, fingers=True)

    shown_env, inner = piano(), piano()
    env = HideFingering(inner)
    assert env.observation_space == inner.observation_space == shown_env.observation_space
    labels_were_shown = False
    for shown, hidden in episode(shown_env, env):
        for name in shown_env.observation_layout:
            seen, expected = block(env, hidden, name), block(shown_env, shown, name)
            if "fingering" in name:
                labels_were_shown |= expected.any()
                expected = np.zeros_like(expected)
            np.testing.assert_array_equal(seen, expected, name)
    assert labels_were_shown


def test_the_reward_still_tells_labels_unless_it_does_not_ask_for_them():
    def rewards(fingers, **options):
        env = PreviousActionReward(
            HideFingering(PianoEnv(with_fingers(TINY, fingers), physics="fast", **options))
        )
        env.reset(seed=0)
        action = env.unwrapped.rest_action
        return [block(env, env.step(action)[0], "previous_reward").item() for _ in range(8)]

    labels, others = [0, 6, -1, 0, 4], [3, 1, -1, 9, 2]
    assert rewards(labels) != rewards(others)
    for fingering_reward in ("off", "optimal-transport"):
        options = {"fingering_reward": fingering_reward}
        assert rewards(labels, **options) == rewards(others, **options)
