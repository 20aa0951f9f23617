"""Goals at the beginning or at the end of control steps."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import steps_of

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Note, Pedal, PianoRoll, Score, load_score
from sb3_piano.wrappers import Lookahead

C4 = 39
NOTES = [
    Note(onset=0.0, offset=0.1, pitch=60, finger=0),
    Note(onset=0.22, offset=0.4, pitch=64, finger=2),
    Note(onset=0.2, offset=0.25, pitch=67, finger=4),
]
SCORE = Score(notes=NOTES, pedals=[Pedal(onset=0.1, offset=0.2)], title="three notes")


class TestAStepEarlier:
    def test_keys_are_due_a_step_earlier_and_the_pedal_is_not(self):
        roll = PianoRoll.from_score(SCORE, 0.05, 0.1)
        earlier = roll.a_step_earlier()
        for name in ("active", "finger", "onset"):
            np.testing.assert_array_equal(getattr(earlier, name)[:-1], getattr(roll, name)[1:])
        assert not earlier.active[-1].any()
        np.testing.assert_array_equal(earlier.sustain, roll.sustain)
        np.testing.assert_allclose(earlier.onset_time, roll.onset_time - 0.05)

    def test_what_begins_with_the_piece_is_shortened(self):
        earlier = PianoRoll.from_score(SCORE, 0.05).a_step_earlier()
        assert earlier.onset[0, C4]
        assert earlier.active[:, C4].sum() == 1
        assert earlier.onset_time[0] == 0.0

    @pytest.mark.parametrize("name", ["FantaisieImpromptu", "MapleLeafRag"])
    def test_real_music_keeps_its_strikes(self, name):
        roll = PianoRoll.from_score(load_score(name).excerpt(0, 30), 0.05, 0.5)
        earlier = roll.a_step_earlier()
        pairs = zip(roll.strikes(), earlier.strikes(), strict=True)
        for (step, key, time), (step_earlier, key_earlier, time_earlier) in pairs:
            assert (step_earlier, key_earlier) == (step - 1, key)
            assert time_earlier == pytest.approx(time - 0.05)


def goal_at(observation, env):
    return observation[env.unwrapped.observation_layout["goal"].slice]


@pytest.mark.parametrize("wrap", [lambda env: env, lambda env: Lookahead(env, steps=3)])
def test_the_observation_shows_and_the_reward_asks_for_the_end(wrap):
    options = {"initial_buffer_time": 0.1, "fingering_reward": "off", "n_steps_lookahead": 3}
    beginning = wrap(gym.wrappers.OrderEnforcing(PianoEnv(SCORE, **options)))
    end = wrap(gym.wrappers.OrderEnforcing(PianoEnv(SCORE, goal_time="end", **options)))
    shown = [goal_at(env.reset(seed=0)[0], env) for env in (beginning, end)]
    keys = [one.reshape(-1, 89)[:, :88] for one in shown]
    np.testing.assert_array_equal(keys[1][:-1], keys[0][1:])
    rest = end.unwrapped.rest_action
    terms, recalls = ([], []), []
    for env, list_of in zip((beginning, end), terms, strict=True):
        for *_, info in steps_of(env, lambda _: rest):
            list_of.append(info["reward_terms"]["key_press"])
        recalls.append(info["recall"])
    assert terms[1][:-1] == terms[0][1:]  # of hands that rest
    assert recalls[0] == recalls[1] < 1  # metrics judge by the piece as it is
