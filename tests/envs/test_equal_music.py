"""The fast physics plays the same music as the exact one."""

import numpy as np
import pytest
from episodes import steps_of
from scipy.stats import ks_2samp

from sb3_piano.envs import PianoEnv

pytestmark = pytest.mark.slow

# How far the fast profile may be from RoboPianist on its recorded performances.
F1_EACH, F1_MEAN, RETURN_SHARE = 0.03, 0.015, 0.01


def test_recorded_playing_keeps_its_f1_and_its_return_on_the_fast_physics(performances, tell):
    lines, f1_changes = [], []
    for recording in performances:
        recorded_f1, recorded_return = float(recording["f1"]), recording["reward"].sum()
        rewards, info = recording.replay(
            PianoEnv(recording.piece, **recording.options, physics="fast")
        )
        f1, total = info["f1"], sum(rewards)
        f1_changes.append(f1 - recorded_f1)
        return_change = total / recorded_return - 1
        lines.append(
            f"{recording.piece:<32}{recorded_f1:7.3f}{f1:7.3f}{f1 - recorded_f1:+8.3f}"
            f"{recorded_return:8.1f}{total:8.1f}{return_change:+8.2%}"
        )
        assert abs(f1_changes[-1]) < F1_EACH
        assert abs(return_change) < RETURN_SHARE
    heading = f"{'piece':<32}{'F1':>7}{'fast':>7}{'':>8}{'return':>8}{'fast':>8}"
    tell("\n".join([heading, *lines]))
    assert len(f1_changes) == 3
    assert np.mean(np.abs(f1_changes)) < F1_MEAN


def random_terms(physics, seeds):
    """Return the reward terms of each step of random episodes, (steps, terms)."""
    env, rows = PianoEnv("CMajorScaleTwoHands", physics=physics), []
    for seed in seeds:
        random, action = np.random.default_rng(seed), np.zeros(env.action_space.shape)

        def wander(_, random=random, action=action):
            action[:] = np.clip(0.9 * action + 0.3 * random.normal(size=action.size), -1, 1)
            return action

        rows += [list(info["reward_terms"].values()) for *_, info in steps_of(env, wander, seed)]
    return np.array(rows)


def test_random_actions_earn_reward_terms_of_one_distribution_on_both_physics(tell):
    """The profiles differ by less than two samples of 6 episodes of one profile may."""
    seeds = range(6)
    reference, fast = random_terms("reference", seeds), random_terms("fast", seeds)
    # Both change with the noise, but each mean by a small part of the spread ...
    shift = (fast.mean(axis=0) - reference.mean(axis=0)) / reference.std(axis=0)
    # ... and so do the distributions. Rounded: a key at rest is at 0 or at a millionth of its way.
    apart = [
        ks_2samp(ours, theirs, method="asymp").statistic
        for ours, theirs in zip(fast.round(2).T, reference.round(2).T, strict=True)
    ]
    tell(f"reward terms: shift of the mean over spread {shift.round(3)}, KS {apart}")
    assert not np.array_equal(fast, reference)
    assert np.abs(shift).max() < 0.15
    assert max(apart) < 0.1
