"""Everyone's control steps are real, and the same."""

from __future__ import annotations

import contextlib

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from sb3_piano.bench.settings import ENV_ID
from sb3_piano.bench.simulation import episode_actions, simulation_contestants, smooth_actions
from sb3_piano.envs import PianoEnv, PianoVectorEnv

STEPS = 3


@pytest.fixture
def actions(short):
    return episode_actions(short(episode_steps=STEPS))


@pytest.fixture
def contestants(short, actions):
    with contextlib.ExitStack() as stack:
        found = simulation_contestants(short(), actions, None, stack)
        yield {contestant.name: contestant for contestant in found}


@pytest.fixture
def calls(monkeypatch):
    """Return a function that lists the calls of a function, which still does its work."""

    def listen(owner, name, note):
        real, heard = getattr(owner, name), []

        def heeded(*args, **kwargs):
            result = real(*args, **kwargs)
            heard.append(note(*args, **kwargs))
            return result

        monkeypatch.setattr(owner, name, heeded)
        return heard

    return listen


def test_actions_are_a_random_walk_that_is_clipped():
    actions = smooth_actions(500, 39)
    assert (actions.shape, actions.dtype) == ((500, 39), np.float32)
    assert (actions.min(), actions.max()) == (-1, 1)
    np.testing.assert_array_equal(actions[:7], smooth_actions(7, 39))
    noise = np.random.default_rng(0).normal(size=(2, 39))
    second = np.clip(0.9 * np.clip(0.3 * noise[0], -1, 1) + 0.3 * noise[1], -1, 1)
    np.testing.assert_allclose(actions[1], second, rtol=1e-6)


def test_an_episode_is_played_to_its_end_unless_it_is_cut_short(short, actions):
    env = gym.make(ENV_ID).unwrapped
    whole = episode_actions(short(episode_steps=None))
    assert whole.shape == (len(env.roll), 39)
    np.testing.assert_array_equal(actions, whole[:STEPS])


def test_who_takes_part(contestants):
    assert list(contestants) == [
        "mj_step, reference",
        "PianoEnv.step, reference",
        "gymnasium.make, reference",
        "PianoEnv.step, reference, 43 keys move",
        "mj_step, fast",
        "PianoEnv.step, fast",
        "gymnasium.make, fast",
        "PianoEnv.step, fast, 43 keys move",
        "vector env, 1 slot, fast",
        "vector env, 2 slots, fast",
    ]


def test_who_is_compared_with_whom(contestants):
    compared = {
        name: [(c.label, c.base, c.of_times) for c in contestant.comparisons]
        for name, contestant in contestants.items()
    }
    beside_bare = ("x of bare reference", "mj_step, reference", False)
    assert compared["mj_step, reference"] == []
    assert compared["mj_step, fast"] == [beside_bare]
    for profile in ("reference", "fast"):
        over_bare = ("env/bare", f"mj_step, {profile}", True)
        for name in (f"PianoEnv.step, {profile}", f"gymnasium.make, {profile}"):
            assert compared[name] == [over_bare, beside_bare]
        beside_all_keys = (f"x of PianoEnv.step, {profile}", f"PianoEnv.step, {profile}", False)
        fewer = compared[f"PianoEnv.step, {profile}, 43 keys move"]
        assert fewer == [beside_all_keys, beside_bare]
    beside_one = ("x of PianoEnv.step, fast", "PianoEnv.step, fast", False)
    assert compared["vector env, 2 slots, fast"] == [beside_one, beside_bare]


@pytest.mark.parametrize("profile", ["reference", "fast"])
def test_an_environment_plays_the_actions(profile, contestants, actions, calls):
    heard = calls(PianoEnv, "step", lambda env, action: (env.config.physics, action))
    for name in (f"PianoEnv.step, {profile}", f"gymnasium.make, {profile}"):
        heard.clear()
        lap = contestants[name].play()
        assert lap.steps == STEPS
        assert lap.seconds > 0
        assert [physics for physics, _ in heard] == [profile] * STEPS
        np.testing.assert_array_equal([action for _, action in heard], actions)


@pytest.mark.parametrize("profile", ["reference", "fast"])
def test_with_fewer_keys_the_rest_is_rigid_and_the_actions_are_the_same(
    profile, contestants, actions, calls
):
    heard = calls(PianoEnv, "step", lambda env, action: (env, action))
    assert contestants[f"PianoEnv.step, {profile}, 43 keys move"].play().steps == STEPS
    np.testing.assert_array_equal([action for _, action in heard], actions)
    env = heard[0][0]
    assert (env.config.physics, len(env.scene.key_qpos)) == (profile, 43)


def test_the_environment_is_measured_bare_and_with_gymnasiums_wrappers(contestants, calls):
    order = calls(gym.wrappers.OrderEnforcing, "step", lambda *_: None)
    contestants["PianoEnv.step, fast"].play()
    assert len(order) == 0
    contestants["gymnasium.make, fast"].play()
    assert len(order) == STEPS


@pytest.mark.parametrize("profile", ["reference", "fast"])
def test_the_bare_physics_moves_exactly_as_the_environment(profile, contestants, actions, calls):
    env = gym.make(ENV_ID, physics=profile).unwrapped
    env.reset()
    for action in actions:
        env.step(action)
    heard = calls(
        mujoco,
        "mj_step",
        lambda model, data, nstep: (nstep, data.qpos.copy(), data.ctrl.copy()),
    )
    for _ in range(2):  # each time from the beginning
        heard.clear()
        assert contestants[f"mj_step, {profile}"].play().steps == STEPS
        assert [nstep for nstep, *_ in heard] == [env.config.n_substeps] * STEPS
        np.testing.assert_array_equal(heard[-1][1], env.data.qpos)
        np.testing.assert_array_equal(heard[-1][2], env.data.ctrl)


def test_slots_of_the_vector_env_play_the_same_and_all_count(contestants, actions, calls):
    heard = calls(PianoVectorEnv, "step", lambda venv, batch: (venv, batch))
    assert contestants["vector env, 2 slots, fast"].play().steps == 2 * STEPS
    assert [batch.shape for _, batch in heard] == [(2, 39)] * STEPS
    for slot in range(2):
        np.testing.assert_array_equal([batch[slot] for _, batch in heard], actions)
        assert heard[0][0].envs[slot].config.physics == "fast"


class StubPeer:
    """Says what it was told to play."""

    def play(self, what):
        return what


def test_a_peer_is_compared_with_by_everyone(short, actions):
    with contextlib.ExitStack() as stack:
        found = simulation_contestants(short(slots=(1,)), actions, StubPeer(), stack)
    *others, physics, env = found
    assert (physics.name, physics.play()) == ("RoboPianist's mj_step", "physics")
    assert (env.name, env.play()) == ("RoboPianist", "env")
    assert {other.unit for other in found} == {"control steps/s"}
    for contestant in (*others, physics):
        last = contestant.comparisons[-1]
        assert (last.label, last.base) == ("x of the peer", "RoboPianist")
    (over_bare,) = env.comparisons
    assert (over_bare.label, over_bare.base) == ("env/bare", "RoboPianist's mj_step")
    assert over_bare.of_times
