"""Exploration by searching among actions."""

import copy

import numpy as np
import pytest
import torch
from acting import ActAt, Noted
from episodes import as_dict
from sb3_contrib import TQC, CrossQ
from scripted import tiny, tiny_ppo
from short_scores import score_of
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from sb3_piano.callbacks import ActionSearchCallback, F1Callback
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.values import critic_values
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import HandActions, HandReward, PreviousActionReward

TUNE = score_of((0.1, 0.4, 60, 0), (0.4, 0.8, 62, 1))


def piano():
    return PreviousActionReward(PianoEnv(TUNE, physics="fast", hands_in_scene="right"))


def learner(env=None, algorithm=SAC, **arguments):
    torch.manual_seed(0)
    settings = {"learning_starts": 10, "batch_size": 8, "policy_kwargs": {"net_arch": [16]}}
    return tiny(piano() if env is None else env, algorithm, **{**settings, "seed": 0, **arguments})


def looking(look, at=15):
    """Return what calls a function in a step of a training, with the model."""
    return Noted(lambda own: look(own.model) if own.n_calls == at else None)


def looked_at(callback, look, **arguments):
    learner(**arguments).learn(20, callback=[callback, looking(look)])


@pytest.mark.slow
def test_evaluations_in_the_training_are_not_searched():
    judge = F1Callback(piano(), deterministic=False, eval_freq=4, evaluate_start=True)
    callback = ActionSearchCallback(candidates=3, score="simulation")
    searched, own = [], callback._tried

    def spied(slot, actions):
        searched.append((callback.num_timesteps, judge.eval_env.get_attr("steps_played")))
        return own(slot, actions)

    callback._tried = spied
    for callbacks in ([callback, judge], [judge, callback]):
        searched.clear()
        learner().learn(16, callback=callbacks)
        assert [step for step, _ in searched] == [10, 11, 12, 13, 14, 15]  # each once, by itself


def explored(model, count=1):
    """Return actions that a model takes when it explores, with what it observes."""
    found = []
    for _ in range(count):
        model._last_obs = model._last_obs.copy()  # shown anew, as after a step
        found.append(model.policy.predict(model._last_obs)[0])
    return np.concatenate(found)


def test_greedy_choice_by_critics_takes_the_action_that_they_value_most():
    def look(model):
        policy = model.policy
        state = torch.get_rng_state()
        played = explored(model)
        torch.set_rng_state(state)
        policy.actor(torch.as_tensor(model._last_obs))  # what SB3 draws first
        seen, _ = policy.obs_to_tensor(model._last_obs)
        with torch.no_grad():
            mean, log_std, _ = policy.actor.get_action_dist_params(seen)
            noise = torch.randn(12, mean.shape[1])
            noise[0] = 0
            actions = torch.tanh(mean + 2 * log_std.exp() * noise)
            values = critic_values(policy, seen.expand(12, -1), actions)
        score = values.mean(dim=1) + 1.5 * values.std(dim=1, correction=0)
        np.testing.assert_allclose(played[0], actions[score.argmax()], atol=1e-6)

    looked_at(ActionSearchCallback(candidates=12, choice="greedy", optimism=1.5), look)


@pytest.mark.slow
def test_a_single_candidate_is_the_policys_own_action_and_the_model_is_saved_meanwhile(tmp_path):
    def look(model):
        own, _ = model.policy.predict(model._last_obs, deterministic=True)
        np.testing.assert_allclose(explored(model), own, atol=1e-6)
        model.save(tmp_path / "model.zip")

    for score in ("critics", "simulation", "both"):
        looked_at(ActionSearchCallback(candidates=1, score=score), look)
        loaded = SAC.load(tmp_path / "model.zip", device="cpu")
        assert loaded.predict(np.zeros(loaded.observation_space.shape))[0].shape == (20,)
    model, callback = learner(), ActionSearchCallback(candidates=3)
    with pytest.raises(KeyboardInterrupt):
        model.learn(20, callback=[callback, ActAt(15, "keyboard")])
    model.learn(20, callback=callback)  # another one searches anew
    assert model.num_timesteps == 20
    assert "_predict" not in vars(model.policy)


def test_with_simulation_the_action_that_earns_most_is_taken_and_the_environment_stays():
    def look(model):
        env = model.get_env().envs[0]
        before = env.unwrapped.get_state()
        played = explored(model)[0]
        after = env.unwrapped.get_state()
        np.testing.assert_array_equal(before.physics, after.physics)
        assert before.step == after.step

        def worth(action):
            copied = copy.deepcopy(env)
            observation, reward, *_ = copied.step(action)
            seen, _ = model.policy.obs_to_tensor(observation)
            with torch.no_grad():
                ahead = critic_values(model.policy, seen, model.policy.actor(seen, True)).mean()
            return reward + model.gamma * float(ahead)

        others = [np.tanh(np.random.default_rng(s).normal(size=played.shape)) for s in range(8)]
        own, _ = model.policy.predict(model._last_obs, deterministic=True)
        assert worth(played) >= max(map(worth, [own[0], *others]))

    search = ActionSearchCallback(candidates=40, score="simulation", choice="greedy")
    looked_at(search, look, gamma=0.8)


def test_hands_that_are_agents_are_judged_alone_by_critics_and_together_by_simulation():
    def both_hands():
        options = {"physics": "fast", "observation": "hands", "reduced_action_space": False}
        return HandReward(HandActions(PianoEnv(TUNE, **options)))

    def look(model):
        envs = model.get_env().unwrapped.envs
        policy, state = model.policy, torch.get_rng_state()
        played = explored(model)
        torch.set_rng_state(state)
        policy.actor(torch.as_tensor(model._last_obs))  # what SB3 draws first
        for slot, env in enumerate(envs):
            rows = slice(2 * slot, 2 * slot + 2)
            seen, _ = policy.obs_to_tensor(model._last_obs[rows])
            with torch.no_grad():
                mean, log_std, _ = policy.actor.get_action_dist_params(seen)
                noise = torch.randn(6, *mean.shape)
                noise[0] = 0
                actions = torch.tanh(mean + 2 * log_std.exp() * noise)
                if search._score == "critics":
                    values = [critic_values(policy, seen, each).mean(dim=1) for each in actions]
                    chosen = torch.stack(values).argmax(dim=0)
                else:
                    worths = [worth(model, env, each.numpy()) for each in actions]
                    chosen = torch.full((2,), int(np.argmax(worths)))
            expected = torch.stack([actions[chosen[hand], hand] for hand in range(2)])
            np.testing.assert_allclose(played[rows], expected, atol=1e-6)

    def worth(model, env, actions):
        observation, reward, *_ = copy.deepcopy(env).step(actions.reshape(-1))
        seen, _ = model.policy.obs_to_tensor(observation.reshape(2, -1))
        with torch.no_grad():
            ahead = critic_values(model.policy, seen, model.policy.actor(seen, True)).mean()
        return reward + model.gamma * float(ahead)

    for score in ("critics", "simulation"):
        search = ActionSearchCallback(candidates=6, score=score, choice="greedy", optimism=0)
        env = HandsAsAgents(DummyVecEnv([both_hands, both_hands]))
        learner(env).learn(4 * 8, callback=[search, looking(look, at=5)])


def test_nothing_is_expected_after_the_last_control_step():
    def look(model):
        assert model.get_env().get_attr("steps_played") == [steps - 1]
        search._values.judge = lambda observation: pytest.fail("the piece is over")
        explored(model)

    steps = len(piano().unwrapped.roll)
    search = ActionSearchCallback(candidates=3, score="simulation")
    learner().learn(steps - 1, callback=[search, looking(look, at=steps - 1)])


def test_a_high_temperature_draws_all_and_a_low_one_the_best():
    def look_at_all(model):
        assert len(np.unique(explored(model, 40), axis=0)) == 40

    def spread(model, found):
        found.append(explored(model, 40).std(axis=0).mean())

    looked_at(ActionSearchCallback(temperature=1e9), look_at_all)
    spreads = []
    for temperature in (1e9, 1e-4):
        callback = ActionSearchCallback(temperature=temperature, optimism=0)
        looked_at(callback, lambda model: spread(model, spreads))
    assert spreads[1] < 0.95 * spreads[0]  # the best of 33 are alike


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "score"),
    [(SAC, "critics"), (TQC, "critics"), (CrossQ, "both"), (SAC, "simulation")],
)
def test_trainings_explore_by_it_and_are_as_before_afterwards(algorithm, score):
    def trained(callback, seed=0):
        model = learner(DummyVecEnv([piano, piano]), algorithm)
        return model.learn(40, callback=callback)

    search = [ActionSearchCallback(candidates=4, score=score) for _ in range(2)]
    models = [trained(callback) for callback in search]
    played = [model.replay_buffer.actions[: model.replay_buffer.pos] for model in models]
    np.testing.assert_array_equal(*played)  # by the seed
    plain = trained(None)
    assert np.abs(played[0] - plain.replay_buffer.actions[: plain.replay_buffer.pos]).max() > 0.1
    assert "_predict" not in vars(models[0].policy)
    observation = models[0].get_env().reset()
    mode, _ = models[0].predict(observation, deterministic=True)
    models[0].learn(4)  # without it
    assert mode.shape == (2, 20)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: learner(algorithm=TD3), "TD3 has no critics and no distribution"),
        (lambda: tiny_ppo(piano(), 8), "PPO has no critics and no distribution"),
        (lambda: learner(use_sde=True), "use_sde is True"),
        (lambda: learner(as_dict(piano())), r"search by Dict.*: expected a space of plain arrays"),
        (lambda: learner(SubprocVecEnv([piano], start_method="fork")), "in other processes"),
    ],
)
def test_what_cannot_be_searched_is_refused(model, message):
    learns = model()
    with pytest.raises(ConfigError, match=message):
        learns.learn(8, callback=ActionSearchCallback(score="both"))
    learns.get_env().close()
