"""The environment's own model and data as dm_control's physics, for its viewer and cameras."""

import mujoco
import numpy as np
import pytest

pytest.importorskip("dm_control")
from sb3_piano.interop import DmEnvironment, environment
from sb3_piano.interop.scene import import_dm_control

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (20, 39)).astype(np.float32)


@pytest.fixture
def env():
    env = DmEnvironment(ENV_ID, seed=0)
    yield env
    env.close()


def test_the_physics_is_a_live_view(env):
    env.reset()
    physics = env.physics
    for action in ACTIONS:
        env.step(action)
    piano = env.env.unwrapped
    assert physics is env.physics
    assert physics.model.ptr is piano.model
    assert physics.data.time == pytest.approx(20 * env.control_timestep())
    slider = physics.named.data.qpos["rh_shadow_hand/forearm_tx"]
    assert slider == piano.data.qpos[piano.scene.slider_qpos[0]]


def test_asking_for_the_physics_in_an_episode_changes_nothing(env):
    reference = DmEnvironment(ENV_ID, seed=0)
    for each in (env, reference):
        each.reset()
    for step, action in enumerate(ACTIONS):
        if step in (0, 10):
            env._physics = None
            assert env.physics.data.time == pytest.approx(0.05 * step)
        ours, theirs = env.step(action), reference.step(action)
        assert ours.reward == theirs.reward
        np.testing.assert_equal(ours.observation, theirs.observation)


def test_the_physics_follows_when_the_simulation_is_built_anew(env):
    before = env.physics
    env.env.unwrapped.fix_keys(30, 50)
    assert env.physics is not before
    assert env.physics.model.nq == env.env.unwrapped.model.nq


def test_the_physics_draws_the_present_state(env):
    env.reset()
    at_rest = env.physics.render(60, 80, camera_id="overview")
    for action in ACTIONS:
        env.step(action)
    assert (env.physics.render(60, 80, camera_id="overview") != at_rest).any()


@pytest.mark.slow
def test_the_viewers_runtime_plays_episode_after_episode(env):
    runtime = import_dm_control("viewer.runtime").Runtime(env, policy=lambda _: ACTIONS[0])
    errors, times = [], []
    runtime.on_error += errors.append
    for tick in range(160):  # an episode has 151 steps
        runtime.tick(env.control_timestep(), paused=tick == 5)
        if runtime.state is type(runtime.state).STOPPED:
            runtime.restart()
        times.append(runtime.get_time())
    assert not errors
    assert max(times) == pytest.approx(7.55)
    assert times[-1] < 1


def test_a_dm_control_that_does_not_know_this_mujoco_is_told_with_both_versions(env, monkeypatch):
    class Newer:
        """MuJoCo's model of a version in which a field of before is missing."""

    def outdated(name):
        module = import_dm_control(name)
        if name == "mujoco":
            monkeypatch.setattr(module.Physics, "__init__", lambda *_: Newer().flex_vertedge)
        return module

    monkeypatch.setattr(environment, "import_dm_control", outdated)
    expected = f"does not work with MuJoCo {mujoco.__version__}.*pip install"
    with pytest.raises(ImportError, match=expected):
        _ = env.physics
