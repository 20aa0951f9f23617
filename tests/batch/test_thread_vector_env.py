"""``PianoVectorEnv`` gives what its environments and gymnasium's ``SyncVectorEnv`` give."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.batch import PianoVectorEnv
from sb3_piano.envs import ENV_IDS, GENERAL_ID, PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError, InvalidActionError, ScoreError
from sb3_piano.simulation.gl import find_gl_backend

tables = Tables(__file__)
OPTIONS = {"physics": "fast", "randomize_hand_positions": True}
AUTORESET = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def score(*pitches):
    """Return a score with two control steps for each note, and a silent one."""
    notes = ((0.1 * i, 0.1 * (i + 1), pitch) for i, pitch in enumerate(pitches))
    return score_of(*notes, title=f"from {pitches[0]}")


SCORES = [score(60), score(60, 67), score(55, 60, 72)]  # 3, 5 and 7 control steps


@pytest.fixture
def make():
    """Make vector environments and close them afterwards."""
    made = []

    def make(cls, *args, **kwargs):
        made.append(cls(*args, **kwargs))
        return made[-1]

    yield make
    for envs in made:
        envs.close()


@pytest.fixture
def both(make):
    """Return a function that makes gymnasium's and our vector of equal environments."""

    def both(mode, n_threads=2, **options):
        options = {**OPTIONS, **options}
        env_fns = [lambda s=s: PianoEnv(s, **options) for s in SCORES]
        theirs = make(SyncVectorEnv, env_fns, autoreset_mode=mode)
        ours = make(PianoVectorEnv, 3, SCORES, autoreset_mode=mode, n_threads=n_threads, **options)
        return theirs, ours

    return both


def random_actions(count, n_envs=3, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, n_envs, 39)).astype(np.float32)


def assert_same(actual, expected):
    """Compare nested results bit by bit, types included."""
    assert type(actual) is type(expected)
    if isinstance(expected, dict):
        assert list(actual) == list(expected)
        for key in expected:
            assert_same(actual[key], expected[key])
    elif isinstance(expected, tuple) or getattr(expected, "dtype", None) == np.dtype(object):
        for left, right in zip(actual, expected, strict=True):
            assert_same(left, right)
    elif expected is not None:
        assert actual.dtype == expected.dtype
        np.testing.assert_equal(actual, expected)


@pytest.mark.slow
@pytest.mark.parametrize("mode", AUTORESET)
@pytest.mark.parametrize("n_threads", [1, 2, 3])
def test_everything_is_equal_to_gymnasiums_sync_vector_env(both, mode, n_threads):
    theirs, ours = both(mode, n_threads)
    assert ours.observation_space == theirs.observation_space
    assert ours.single_observation_space == theirs.single_observation_space
    assert (ours.action_space, ours.num_envs) == (theirs.action_space, theirs.num_envs)
    assert ours.metadata == theirs.metadata
    assert_same(ours.reset(seed=4), theirs.reset(seed=4))
    assert ours.np_random_seed == theirs.np_random_seed == (4, 5, 6)
    keys = set()
    for action in random_actions(17):
        result = ours.step(action)
        assert_same(result, theirs.step(action))
        keys |= set(result[4])
    if mode is AutoresetMode.SAME_STEP:
        assert {"final_obs", "_final_obs", "final_info", "_final_info"} <= keys
    else:
        assert {"f1", "_f1"} <= keys


def test_in_disabled_mode_whoever_uses_it_resets_what_has_ended(both):
    theirs, ours = both(AutoresetMode.DISABLED)
    for envs in (theirs, ours):
        envs.reset(seed=2)
    over = np.zeros(3, dtype=bool)
    for actions in random_actions(9):
        if over.any():
            results = [envs.reset(options={"reset_mask": over.copy()}) for envs in (ours, theirs)]
            assert_same(*results)
        result = ours.step(actions)
        assert_same(result, theirs.step(actions))
        over = result[2] | result[3]
    ours.reset(seed=2)
    for actions in random_actions(3):
        ours.step(actions)
    with pytest.raises(EnvStateError, match="No episode is under way"):
        ours.step(actions)


@pytest.mark.slow
@pytest.mark.parametrize("mode", AUTORESET)
@pytest.mark.parametrize("n_steps", [3, 5])  # after five, the episode of the middle slot is over
def test_a_mask_resets_only_some_environments(both, mode, n_steps):
    theirs, ours = both(mode)
    mask = np.array([True, False, True])
    results = []
    for envs in (ours, theirs):
        envs.reset(seed=1)
        for actions in random_actions(n_steps):
            envs.step(actions)
        middle = envs.envs[1].steps_played
        results.append(envs.reset(seed=[7, 8, 9], options={"reset_mask": mask.copy()}))
        assert [env.steps_played for env in envs.envs] == [0, middle, 0]
    assert_same(*results)
    for actions in random_actions(6, seed=1):
        assert_same(ours.step(actions), theirs.step(actions))


def test_scores_are_chosen_at_reset_for_one_episode(make):
    envs = make(PianoVectorEnv, 3, SCORES[0], n_threads=2, **OPTIONS)
    assert [len(roll) for roll in envs.get_attr("roll")] == [3, 3, 3]
    options = {"score": tuple(SCORES), "reset_mask": np.ones(3, dtype=bool)}
    kept = dict(options)
    envs.reset(options=options)
    assert options == kept
    assert envs.get_attr("score") == tuple(SCORES)
    for actions in random_actions(4):  # the first slot's episode ends, and the next one begins
        envs.step(actions)
    assert [len(roll) for roll in envs.get_attr("roll")] == [3, 5, 7]
    envs.reset(options={"score": SCORES[2]})
    assert [len(roll) for roll in envs.get_attr("roll")] == [7, 7, 7]
    envs.reset()
    assert [len(roll) for roll in envs.get_attr("roll")] == [3, 3, 3]


@pytest.mark.slow
@pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")
def test_pictures_are_those_of_the_environments(make):
    options = {"render_mode": "rgb_array", "width": 64, "height": 48, "physics": "fast"}
    envs = make(PianoVectorEnv, 2, SCORES[:2], n_threads=2, **options)
    singles = [PianoEnv(piece, **options) for piece in SCORES[:2]]
    envs.reset(seed=0)
    pictures = envs.render()
    for picture, env in zip(pictures, singles, strict=True):
        env.reset(seed=0)
        # Drawing contexts may round a few pixels differently.
        np.testing.assert_allclose(picture, env.render().astype(float), atol=9)
        env.close()
    assert np.abs(pictures[0] - pictures[1].astype(float)).max() > 9
    envs.envs[1].data.qpos[envs.envs[1].scene.key_qpos] = 1.0
    left, right = envs.render()
    np.testing.assert_array_equal(left, pictures[0])
    assert np.any(right != pictures[1])


@pytest.mark.parametrize("bad", [0, 1])
def test_an_error_of_one_environment_comes_when_the_other_one_has_stepped(make, bad):
    envs = make(PianoVectorEnv, 2, SCORES[1], n_threads=2, **OPTIONS)
    envs.reset(seed=0)
    actions = random_actions(1, n_envs=2)[0]
    actions[bad, 5] = np.nan
    with pytest.raises(InvalidActionError, match="Element 5 of the action is nan"):
        envs.step(actions)
    assert [env.steps_played for env in envs.envs] == [int(i != bad) for i in range(2)]
    envs.reset(seed=0)
    envs.step(np.zeros((2, 39)))
    assert envs.get_attr("steps_played") == (1, 1)


@tables("arguments, message")
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ConfigError, match=message):
        PianoVectorEnv(**{"num_envs": 3, "score": SCORES, **arguments})


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"seed": [1, 2]}, ConfigError, "seed has 2 entries: expected one seed, or one for"),
        ({"options": {"score": SCORES[:2]}}, ConfigError, "score has 2 entries: expected one"),
        ({"options": {"scoer": SCORES}}, ConfigError, "Unknown reset option 'scoer'"),
        ({"options": {"score": "a/b.mid"}}, ScoreError, "b.mid"),
        ({"options": {"reset_mask": [True] * 3}}, ConfigError, "expected a numpy array of 3 bool"),
        ({"options": {"reset_mask": np.ones(2, bool)}}, ConfigError, "a numpy array of 3 bool"),
        (
            {"options": {"reset_mask": np.zeros(3, bool)}},
            ConfigError,
            "of 3 bool with at least one True",
        ),
        (
            {"options": {"reset_mask": np.array([True, False, True])}},
            EnvStateError,
            "Environment 1 has never been reset: expected True for it",
        ),
    ],
)
def test_wrong_resets_are_named(make, arguments, error, message):
    envs = make(PianoVectorEnv, 3, SCORES, **OPTIONS)
    with pytest.raises(error, match=message):
        envs.reset(**arguments)


def test_actions_of_a_wrong_shape_and_a_missing_reset_are_named(make):
    envs = make(PianoVectorEnv, 3, SCORES, n_threads=2, **OPTIONS)
    with pytest.raises(EnvStateError, match="No episode is under way: call reset"):
        envs.step(np.zeros((3, 39)))
    envs.reset(seed=np.int64(0))
    for shape in ((2, 39), (3, 38), (39,)):
        with pytest.raises(InvalidActionError, match=r"actions have shape .*: expected \(3, 39"):
            envs.step(np.zeros(shape))


def test_make_vec_gives_it_for_every_id_without_a_warning(make):
    assert len({gym.spec(env_id).vector_entry_point for env_id in ENV_IDS}) == 1
    for env_id in (GENERAL_ID, "RoboPianist-scale-CMajor-v0", "RoboPianist-hanon-01-v0"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            envs = make(gym.make_vec, env_id, num_envs=2, n_threads=2, physics="fast")
        assert (type(envs), envs.num_envs, envs.n_threads) == (PianoVectorEnv, 2, 2)
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
        assert envs.get_attr("score") == (gym.make(env_id).unwrapped.score,) * 2
        assert str(envs) == f"PianoVectorEnv({env_id}, num_envs=2)"
