"""Tree search in the piano: it goes back exactly, touches nothing, and plays."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from sb3_contrib import TQC, CrossQ
from short_scores import score_of
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize
from yaml_rows import Tables

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError, SimulationDivergedError
from sb3_piano.players import PlayerResidual, TreeSearch, TreeSettings
from sb3_piano.players.tree_search import PianoWorld, moment_of
from sb3_piano.training import OpenPlayer, evaluate, load_config, play_run, train
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import HandActions, HandReward, PreviousActionReward

TUNE = score_of((0.1, 0.4, 60, 0), (0.4, 0.7, 62, 1), (0.7, 0.9, 60, 0), title="tune")
SMALL = TreeSettings(simulations=9, depth=4)


def piano(**options):
    return PianoEnv(TUNE, **{"physics": "fast", **options})


def labelled(**options):
    return piano(observation="fingers", reward_weights={"fingering": 1.0, "strike": 0.5}, **options)


def wrapped(**options):
    env = piano(observation="hands", reward_weights={"strike": 1.0}, **options)
    return PreviousActionReward(HandReward(HandActions(env)))


def corrected(**options):
    kwargs = {"physics": "fast", "observation": "hands", "reduced_action_space": False}
    return PlayerResidual(HandActions(PianoEnv(TUNE, **{**kwargs, **options})))


def untrained(env, algorithm=SAC, **arguments):
    torch.manual_seed(0)
    return algorithm(
        "MlpPolicy", env, policy_kwargs={"net_arch": [16]}, seed=0, device="cpu", **arguments
    )


def drawn_actions(env, count):
    env.action_space.seed(5)
    return [env.action_space.sample() for _ in range(count)]


def assert_same_step(one, other):
    np.testing.assert_array_equal(one[0], other[0])
    assert one[1:4] == other[1:4]


@pytest.mark.parametrize(
    ("make", "physics"),
    [(piano, "reference"), (labelled, "fast"), (wrapped, "fast"), (corrected, "reference")],
)
def test_a_step_in_the_tree_is_the_step_that_a_fresh_replay_makes(make, physics):
    """However deep: the paper asks for 1e-5 in reward, observation and end; these are equal."""
    env = make(physics=physics)
    env.reset(seed=1)
    actions = drawn_actions(env, len(env.unwrapped.roll))
    for action in actions[:4]:
        env.step(action)
    world = PianoWorld(env, TreeSearch(untrained(env), env)._values)
    moments, steps = [moment_of(env)], []
    for action in actions[4:]:  # a path to the end, each node restored before it
        other = drawn_actions(env, 1)[0] * 0.5
        world.step(moments[-1], other)  # a sibling, by which nothing may be disturbed
        steps.append(world.step(moments[-1], action))
        moments.append(steps[-1].moment)
    assert [step.terminal for step in steps] == [False] * (len(steps) - 1) + [True]

    again = make(physics=physics)
    again.reset(seed=1)
    for action in actions[:4]:
        again.step(action)
    for action, step in zip(actions[4:], steps, strict=True):
        observation, reward, terminated, truncated, _ = again.step(action)
        np.testing.assert_array_equal(step.observation, observation)
        assert step.reward == reward
        assert step.terminal == (terminated or truncated)


def test_a_search_goes_on_after_the_physics_became_unstable():
    env = piano()
    env.reset(seed=0)
    moment = env.snapshot()
    expected = env.step(env.rest_action)
    env.go_back(moment)
    env.data.qvel[:] = 1e12
    with pytest.raises(SimulationDivergedError):
        env.step(env.rest_action)
    env.go_back(moment)
    assert_same_step(env.step(env.rest_action), expected)


@pytest.mark.parametrize("algorithm", [SAC, TD3, DDPG, TQC, CrossQ])
def test_models_of_all_algorithms_with_critics_look_ahead(algorithm):
    env = piano()
    model = untrained(env, algorithm)
    player = TreeSearch(model, env, SMALL)
    alone = TreeSearch(model, env, TreeSettings(simulations=1, depth=1))
    observation, _ = env.reset(seed=0)
    for step in range(3):
        action, state = player.predict(observation)
        assert env.action_space.contains(action)
        assert state == step + 1
        # A single simulation plays what the policy does.
        expected, _ = model.predict(observation, deterministic=True)
        np.testing.assert_allclose(alone.predict(observation)[0], expected, atol=1e-6)
        observation, *_ = env.step(action)
    assert player.statistics.steps == 3
    assert player.statistics.children == 3  # of nine simulations
    assert 2 <= player.statistics.deepest <= 4
    assert 1 / 9 <= player.statistics.visit_share <= 1


def test_the_environment_is_not_touched_and_ends_as_it_would():
    plain, searched = wrapped(), wrapped()
    player = TreeSearch(untrained(searched), searched, SMALL)
    observations = [env.reset(seed=3)[0] for env in (plain, searched)]
    done = False
    while not done:
        np.testing.assert_array_equal(*observations)
        state = searched.unwrapped.get_state()
        action, _ = player.predict(observations[1])
        np.testing.assert_array_equal(state.physics, searched.unwrapped.get_state().physics)
        steps = [env.step(action) for env in (plain, searched)]
        assert_same_step(*steps)
        observations, done = [step[0] for step in steps], steps[0][3]
    assert steps[0][4]["f1"] == steps[1][4]["f1"]


@pytest.mark.slow
def test_equal_seeds_play_alike_and_others_do_not():
    def played(seed, first=None):
        env, shape = piano(), TreeSettings(simulations=30, depth=2)
        player = TreeSearch(untrained(env), env, shape, seed=seed if first is None else first)
        if first is not None:
            player.set_random_seed(seed)
        observation, _ = env.reset(seed=0)
        actions = []
        for _ in range(4):
            torch.rand(3)  # what others draw makes no difference
            actions.append(player.predict(observation)[0])
            observation, *_ = env.step(actions[-1])
        return np.array(actions)

    first = played(1)
    np.testing.assert_array_equal(first, played(1))
    np.testing.assert_array_equal(first, played(1, first=5))
    assert np.abs(first - played(2)).max() > 0


def test_several_environments_and_normalized_ones_are_searched():
    venv = VecNormalize(DummyVecEnv([piano, piano]))
    model = untrained(venv)
    venv.seed(0)
    observations = venv.reset()
    for _ in range(12):
        observations, *_ = venv.step(np.stack([venv.action_space.sample() for _ in range(2)]))
    venv.training = False
    player = TreeSearch(model, venv, SMALL)
    actions, state = player.predict(observations)
    assert actions.shape == (2, *venv.action_space.shape)
    assert state.tolist() == [13, 13]
    values, deviation = player._values, np.sqrt(venv.ret_rms.var + venv.epsilon)
    assert values.reward(None, 0.5, {}) == pytest.approx(0.5 / deviation)
    raw = venv.unnormalize_obs(observations)[0]
    mode = model.predict(observations[0], deterministic=True)[0]
    np.testing.assert_allclose(values.judge(raw)[1], mode, atol=1e-4)


def both_hands():
    options = {"physics": "fast", "observation": "hands", "reduced_action_space": False}
    return HandReward(HandActions(PianoEnv(TUNE, **options)))


@pytest.mark.slow
def test_where_hands_are_agents_a_step_is_that_of_both():
    venv = VecNormalize(HandsAsAgents(DummyVecEnv([both_hands, both_hands])), norm_reward=False)
    model = untrained(venv, TD3)
    venv.seed(0)
    observations = venv.reset()
    for _ in range(3):
        observations, *_ = venv.step(np.stack([venv.action_space.sample() for _ in range(4)]))
    venv.training = False
    own, _ = model.predict(observations, deterministic=True)
    alone = TreeSearch(model, venv, TreeSettings(simulations=1, depth=1))
    actions, state = alone.predict(observations, episode_start=np.zeros(4, dtype=bool))
    np.testing.assert_allclose(actions, own, atol=1e-5)  # the policy's own is tried first
    assert state.tolist() == [4, 4]
    with torch.no_grad():
        seen, played = torch.as_tensor(observations[:2]), torch.as_tensor(own[:2])
        values = torch.cat(model.critic(seen, played), dim=1)
    both = venv.unnormalize_obs(observations[:2]).reshape(-1)
    assert alone._values.judge(both)[0] == pytest.approx(float(values.mean()), abs=1e-4)

    def earned(player):
        venv.seed(0)
        observations, state, total, done = venv.reset(), None, 0.0, False
        while not done:
            actions, state = player.predict(observations, state, deterministic=True)
            observations, rewards, dones, _ = venv.step(actions)
            total, done = total + float(rewards.sum()), dones.any()
        return total

    assert earned(TreeSearch(model, venv, TreeSettings(simulations=30, depth=2))) > earned(model)
    with pytest.raises(
        ConfigError, match="There are 2 observations: expected 4, one for each hand"
    ):
        alone.predict(observations[:2])
    inside = HandsAsAgents(VecNormalize(DummyVecEnv([both_hands])))
    with pytest.raises(ConfigError, match="VecNormalize around the environments: .* all others"):
        TreeSearch(untrained(inside), inside)


def test_what_cannot_be_searched_is_refused():
    env = piano()
    with pytest.raises(ConfigError, match="PPO, which has no critics: expected a model of SAC"):
        TreeSearch(PPO("MlpPolicy", env, device="cpu"), env)
    model = untrained(env)
    with pytest.raises(ConfigError, match="expected the wrappers with which it was trained"):
        TreeSearch(model, PreviousActionReward(piano()))
    with pytest.raises(ConfigError, match="TimeLimit, which may remember"):
        TreeSearch(model, gym.wrappers.TimeLimit(piano(), 5))
    stacked = VecFrameStack(DummyVecEnv([piano]), 2)
    with pytest.raises(ConfigError, match="VecFrameStack around the environments"):
        TreeSearch(untrained(stacked), stacked)
    other = piano(hands_in_scene="right")
    env.reset()
    other.reset()
    with pytest.raises(EnvStateError, match="expected a state of an environment with the same"):
        other.go_back(env.snapshot())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    settings = Tables(__file__)["run"]
    config = load_config("sac", "RoboPianist-v0", **settings)
    folder = tmp_path_factory.mktemp("tree") / "run"
    return train(config, folder, progress_bar=False).folder.path


@pytest.mark.slow
def test_a_run_is_evaluated_and_played_with_a_tree(run, tmp_path):
    plain = evaluate(run)
    files = sorted(path.name for path in (run / "evaluation").iterdir())
    written = (run / "evaluation" / "metrics.json").read_text()
    looking = f"tree:{SMALL}:{run}"
    found = evaluate(looking)
    assert found.algo == "sac, tree 9x4"
    assert found.tree is not None
    assert found.tree.children == 3
    assert found.to_json()["tree"]["children"] == 3
    assert found.mean["return"] != plain.mean["return"]
    assert found.baseline == plain.baseline
    # The run's own evaluation is that of its model.
    assert sorted(path.name for path in (run / "evaluation").iterdir()) == files
    assert (run / "evaluation" / "metrics.json").read_text() == written
    assert evaluate(looking).mean == found.mean
    assert play_run(looking, tmp_path, picture=None).wav.is_file()
    with OpenPlayer.open(looking) as player:
        assert player.play()[0].metrics["return"] == found.mean["return"]
