"""Keys that do not move: everything else is as it was, and faster."""

import numpy as np
import pytest
from episodes import at_random, steps_of
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.simulation import compile_scene

FIRST, LAST = 30, 50
MOVING = np.arange(FIRST, LAST + 1)
RIGID = np.setdiff1d(np.arange(NUM_KEYS), MOVING)
TINY = score_of(*((0.1 * k, 0.1 * k + 0.1, 55 + k, k % 5) for k in range(12)))


def fixed_env(first=FIRST, last=LAST, score=TINY, **options):
    env = PianoEnv(score, **{"physics": "fast", **options})
    env.fix_keys(first, last)
    return env


def push_all_keys(env):
    """Press every body of a key, as no action can be relied upon to."""
    bodies = env.model.geom_bodyid[env.scene.key_geom]
    env.data.xfrc_applied[bodies, 2] = -20.0


# The scene.


@pytest.mark.parametrize("physics", ["reference", "fast"])
def test_the_scene_differs_by_the_joints_of_the_rigid_keys_and_by_nothing_else(physics):
    full = compile_scene(physics=physics)
    fixed = compile_scene(physics=physics, moving_keys=(FIRST, LAST))
    names = [
        [scene.model.joint(j).name for j in range(scene.model.njnt)] for scene in (full, fixed)
    ]
    missing = {name.rsplit("_", 1)[1] for name in set(names[0]) - set(names[1])}
    assert missing == set(map(str, RIGID))
    kept = [names[0].index(name) for name in names[1]]
    for field in ("jnt_range", "jnt_pos", "jnt_axis", "jnt_stiffness", "dof_damping", "qpos0"):
        np.testing.assert_array_equal(
            getattr(fixed.model, field), getattr(full.model, field)[kept], field
        )
    for field in ("body_pos", "body_mass", "geom_pos", "geom_size", "geom_rgba", "geom_contype"):
        np.testing.assert_array_equal(
            getattr(fixed.model, field), getattr(full.model, field), field
        )
    np.testing.assert_array_equal(fixed.ctrl_low, full.ctrl_low)
    np.testing.assert_array_equal(fixed.joint_range[0], full.joint_range[0])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ((-1, 5), "first moving key is -1: expected a whole number from 0 to 87"),
        ((5, 88), "last moving key is 88: expected a whole number from 5 to 87"),
        ((6, 5), "last moving key is 5: expected a whole number from 6 to 87"),
        ((True, 5), "first moving key is True: expected a whole number"),
    ],
)
def test_keys_that_are_none_are_refused(keys, message):
    with pytest.raises(ConfigError, match=message):
        compile_scene(moving_keys=keys)
    env = PianoEnv(TINY)
    scene = env.scene
    with pytest.raises(ConfigError, match=message):
        env.fix_keys(*keys)
    assert env.scene is scene


# The environment.


def test_rigid_keys_neither_move_nor_sound_and_the_others_do():
    env, pushed = fixed_env(), np.zeros(NUM_KEYS, dtype=bool)
    env.reset(seed=0)
    at_rest = env.data.geom_xpos[env.scene.key_geom].copy()
    wander = at_random(env)
    for observation, *_, info in steps_of(env, lambda _: push_all_keys(env) or wander(_)):  # noqa: B007
        pushed |= env.key_active
        moved = np.abs(env.data.geom_xpos[env.scene.key_geom] - at_rest).max(axis=1)
        assert not moved[RIGID].any()
        assert not observation[env.observation_layout["key_state"].slice][RIGID].any()
    np.testing.assert_array_equal(np.flatnonzero(pushed), MOVING)
    played = env.performance.key_active
    assert played.shape == (len(env.roll), NUM_KEYS)
    np.testing.assert_array_equal(np.flatnonzero(played.any(axis=0)), MOVING)
    assert 0 < info["precision"] < 1


@pytest.mark.slow
@pytest.mark.parametrize("physics", ["reference", "fast"])
def test_recorded_playing_is_the_same_music_where_only_the_keys_of_the_piece_move(
    performances, physics, tell
):
    for recording in performances:
        all_move = PianoEnv(recording.piece, physics=physics, **recording.options)
        used = np.flatnonzero(
            all_move.roll.active.any(axis=0) | recording["key_active"].any(axis=0)
        )
        few = fixed_env(
            int(used[0]), int(used[-1]), recording.piece, physics=physics, **recording.options
        )
        scores = [recording.replay(env)[1]["f1"] for env in (all_move, few)]
        tell(f"{recording.piece} ({physics}): F1 {scores[0]:.4f}, {scores[1]:.4f}")
        assert scores[0] > 0.9
        assert scores[1] == pytest.approx(scores[0], abs=0.005)


def test_the_next_call_after_fixing_keys_is_reset_and_spaces_and_schedules_stay():
    env = PianoEnv(TINY, physics="fast", render_mode="rgb_array")
    spaces = env.observation_space, env.action_space
    env.reset(options={"score": "CMajorScaleOneHand"})
    env.step(env.rest_action)
    env.fix_keys(FIRST, LAST)
    assert (env.observation_space, env.action_space) == spaces
    assert env.score is env.default_score
    assert env.total_steps == 1
    with pytest.raises(EnvStateError, match="call reset"):
        env.step(env.rest_action)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    env.fix_keys(0, NUM_KEYS - 1)
    back, _ = env.reset(seed=0)
    np.testing.assert_array_equal(back, PianoEnv(TINY, physics="fast").reset(seed=0)[0])
