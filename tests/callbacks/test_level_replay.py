"""Level replay in real trainings: scores, draws, checkpoints."""

import itertools
import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from acting import ActAt
from episodes import as_dict
from hypothesis import given
from hypothesis import strategies as st
from sb3_contrib import TQC, CrossQ
from scripted import log_lines, on_pieces, series, tiny, tiny_ppo
from stable_baselines3 import DDPG, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint, LevelReplayCallback
from sb3_piano.callbacks.level_replay import Rollout, advantages
from sb3_piano.callbacks.level_sampler import Level, LevelSampler, gini, score_shares
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.training import RunConfig, resume, train
from sb3_piano.vec_env import HandsAsAgents, ProcessVecEnv, ThreadVecEnv
from sb3_piano.wrappers import HandActions, HandReward, RandomPiece


def piece(title, steps):
    """Return a note of so many control steps, but for the silence at the end of an episode."""
    return Score(notes=[Note(onset=0.0, offset=0.05 * steps, pitch=60, finger=0)], title=title)


THREE = [piece("a", 4), piece("b", 7), piece("c", 5)]
NINE = [piece(title, 3) for title in "abcdefghi"]


def piano(pieces=THREE, **options):
    options = {"physics": "fast", "n_steps_lookahead": 0, **options}
    return RandomPiece(PianoEnv(pieces[0], **options), pieces)


def model_of(venv, algorithm=SAC, **kwargs):
    """Return an off-policy model that only collects, unless told to learn."""
    settings = {"batch_size": 8, "policy_kwargs": {"net_arch": [8]}, "seed": 3, "gamma": 0.8}
    return tiny(venv, algorithm, **{**settings, **kwargs})


class Played(BaseCallback):
    """Note what each environment plays, episode after episode."""

    def __init__(self):
        super().__init__()
        self.titles = []
        self.rounds = []

    def _begun(self, envs):
        scores = self.training_env.unwrapped.get_attr("score", envs)
        self.titles += [score.title for score in scores]
        self.rounds.append([score.title for score in scores])

    def _on_training_start(self):
        self._begun(range(self.training_env.unwrapped.num_envs))

    def _on_step(self):
        agents = self.training_env.num_envs // self.training_env.unwrapped.num_envs
        ended = np.flatnonzero(self.locals["dones"][::agents])
        if len(ended):
            self._begun(ended)
        return True


class Scores(LevelReplayCallback):
    """Keep each score with the step after which it was given."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.scores = []

    def _end(self, env, infos):
        super()._end(env, infos)
        name = self._playing[env]
        self.scores.append((self.n_calls, env, self.sampler.levels[name].score))


def summed(rewards, values, gamma, decay):
    """Return advantages by their definition, a double sum."""
    steps = range(len(rewards))
    delta = [rewards[t] + gamma * values[t + 1] - values[t] for t in steps]
    return [sum((gamma * decay) ** (k - t) * delta[k] for k in steps[t:]) for t in steps]


def rows_at(observations, index):
    if isinstance(observations, dict):
        return {name: rows[index] for name, rows in observations.items()}
    return observations[index]


def q_values(model, observations):
    """Return the mean over the critics of Q at the policy's mode, by SB3's own predict."""
    normalization = model.get_vec_normalize_env()
    if normalization is not None:
        observations = normalization.normalize_obs(observations)
    actions, _ = model.predict(observations, deterministic=True)
    scaled = torch.as_tensor(model.policy.scale_action(actions))
    with torch.no_grad():
        found = model.critic(model.policy.obs_to_tensor(observations)[0], scaled)
    if torch.is_tensor(found):  # TQC's quantiles
        return found.mean(dim=(1, 2)).numpy()
    return torch.stack(found).mean(dim=0)[:, 0].numpy()


def scores_of_rows(model, scores, agents=1, decay=0.95):
    """Return the scores of the same episodes by the rows of the replay buffer."""
    buffer, found = model.replay_buffer, []
    for last, env, _ in scores:
        surprises = []
        for agent in range(env * agents, (env + 1) * agents):
            done = buffer.dones[:last, agent].astype(bool)
            before = np.flatnonzero(done[: last - 1])
            rows = slice(before[-1] + 1 if len(before) else 0, last)
            rewards = buffer.rewards[rows, agent]
            normalization = model.get_vec_normalize_env()
            if normalization is not None:
                rewards = normalization.normalize_reward(rewards)
            at = (rows, agent)
            values = q_values(model, rows_at(buffer.observations, at))
            following = q_values(model, rows_at(buffer.next_observations, at))[-1]
            ends = buffer.dones[last - 1, agent] * (1 - buffer.timeouts[last - 1, agent])
            values = [*values, (1 - ends) * following]
            surprises.append(np.abs(summed(rewards, values, model.gamma, decay)).mean())
        found.append(np.mean(surprises))
    return found


def assert_scores_of_rows(model, callback, **kwargs):
    given = [score for *_, score in callback.scores]
    assert len(set(given)) >= 4
    np.testing.assert_allclose(given, scores_of_rows(model, callback.scores, **kwargs), rtol=1e-4)


class TestScores:
    def test_advantages_are_the_discounted_sums_of_residuals(self):
        random = np.random.default_rng(0)
        for steps in (1, 2, 30):
            rewards, values = random.normal(size=steps), random.normal(size=steps + 1)
            found = advantages(rewards, values, 0.9, 0.7)
            np.testing.assert_allclose(found, summed(rewards, values, 0.9, 0.7))

    @pytest.mark.parametrize(
        ("algorithm", "decay"),
        [(SAC, 0.95), (SAC, 0.3), *((kind, 0.95) for kind in (TD3, DDPG, TQC, CrossQ))],
    )
    def test_they_are_those_of_the_rows_in_the_replay_buffer(self, algorithm, decay):
        callback = Scores(gae_lambda=decay)
        model = model_of(on_pieces(THREE), algorithm)
        model.learn(40, callback=callback)
        assert_scores_of_rows(model, callback, decay=decay)
        assert model.replay_buffer.timeouts.any()

    @pytest.mark.parametrize("kind", ["mappings", "ended by a wrong key", "normalised"])
    def test_they_are_so_of_mappings_of_episodes_that_were_not_cut_off_and_normalised(self, kind):
        # the fingers fall on wrong keys soon
        long = [piece("a", 40), piece("b", 50)]
        venv, steps = on_pieces(long, wrong_press_termination=True), 120
        if kind == "mappings":
            venv, steps = DummyVecEnv([lambda: as_dict(piano())]), 60
        elif kind == "normalised":
            venv, steps = VecNormalize(on_pieces(THREE)), 60
            for _ in range(20):
                venv.reset()
                for _ in range(3):
                    venv.step([venv.action_space.sample()])
            venv.training = False
        callback, model = Scores(), model_of(venv)
        model.learn(steps, callback=callback)
        assert_scores_of_rows(model, callback)
        ended = model.replay_buffer.dones.astype(bool)
        assert (model.replay_buffer.timeouts[ended] == 0).any() == kind.startswith("ended")

    def test_the_unexplained_share_is_one_for_a_critic_that_knows_the_mean(self):
        callback = Scores(score="unexplained", gae_lambda=1.0)
        model = model_of(on_pieces(THREE))
        model.learn(1, callback=callback)
        rewards = [1.0, 0.0, 2.0, 0.5]
        # gae_lambda is 1: advantages are returns less values, whatever comes after the end
        returns = [sum(0.8 ** (k - t) * rewards[k] for k in range(t, 4)) for t in range(4)]
        for values, expected in (
            ([*returns, 0.0], 0.0),
            ([np.mean(returns)] * 4 + [0.0], 1.0),
            ([2 * one - np.mean(returns) for one in returns] + [0.0], 1.0),
        ):
            rollout = Rollout(observations=[np.zeros(1)] * 4, rewards=rewards)
            callback._values = lambda _, values=values: np.array(values)
            info = {"terminal_observation": np.zeros(1)}
            assert callback._surprise(rollout, info) == pytest.approx(expected, abs=1e-12)

    @pytest.mark.parametrize("agents", [1, 2])
    def test_progress_is_the_change_of_f1_since_the_last_episode(self, agents):
        ends = []

        class Ends(BaseCallback):
            """Keep F1 of each episode."""

            def _on_step(self):
                infos = self.locals["infos"][::agents]
                dones = self.locals["dones"][::agents]
                ends.extend(
                    (info["f1"], info["noop_f1"])
                    for done, info in zip(dones, infos, strict=True)
                    if done
                )
                return True

        options = {"observation": "hands", "reduced_action_space": False}
        venv = DummyVecEnv([lambda: HandActions(HandReward(piano(**options)))])
        callback = Scores(score="progress")
        model = model_of(HandsAsAgents(venv) if agents == 2 else venv)
        seen = Played()
        model.learn(agents * 60, callback=[callback, seen, Ends()])
        last, expected = {}, []
        for (f1, noop_f1), name in zip(ends, seen.titles, strict=False):
            expected.append(abs(f1 - last.get(name, noop_f1)))
            last[name] = f1
        given = [score for *_, score in callback.scores]
        assert len(given) > 4
        assert given == pytest.approx(expected)
        again = LevelReplayCallback(score="progress")
        again.load_state_dict(json.loads(json.dumps(callback.state_dict())))
        assert again.state_dict() == callback.state_dict()
        again.load_state_dict(callback.sampler.state_dict())  # of a checkpoint up to 0.2

    def test_hands_as_agents_share_the_piece(self):
        options = {"observation": "hands", "reduced_action_space": False}
        left = Note(onset=0.0, offset=0.2, pitch=40, finger=6)
        both = [Score(notes=[*score.notes, left], title=score.title) for score in THREE]
        maker = lambda: HandActions(HandReward(piano(both, **options)))  # noqa: E731
        callback, seen = Scores(), Played()
        model = model_of(HandsAsAgents(DummyVecEnv([maker, maker])))
        model.learn(4 * 30, callback=[callback, seen])
        assert_scores_of_rows(model, callback, agents=2)
        assert {env for _, env, _ in callback.scores} == {0, 1}
        visits = sum(level.visits for level in callback.sampler.levels.values())
        assert visits == len(seen.titles)

    def test_those_of_ppo_are_the_advantages_that_it_learns_from(self):
        class Advantages(BaseCallback):
            """Keep the mean absolute advantage of each whole episode of a rollout."""

            found = ()

            def _on_step(self):
                return True

            def _on_rollout_end(self):
                buffer = self.model.rollout_buffer
                starts = np.flatnonzero(buffer.episode_starts[:, 0])
                bounds = itertools.pairwise(starts)
                self.found = [np.abs(buffer.advantages[i:j, 0]).mean() for i, j in bounds]

        callback, of_sb3 = Scores(), Advantages()
        model = tiny_ppo(on_pieces(THREE), 64, n_epochs=10, seed=3)
        model.learn(64, callback=[callback, of_sb3])
        given = [score for *_, score in callback.scores]
        assert len(given) >= 6
        np.testing.assert_allclose(given[: len(of_sb3.found)], of_sb3.found, rtol=1e-4)


class Rewarding(gym.RewardWrapper):
    """Reward one of the pieces more than a critic expects."""

    def reward(self, reward):
        return reward + 100 * (self.unwrapped.score.title == "b")


class TestDraws:
    def test_each_piece_is_played_once_before_any_is_played_again(self):
        callback, seen = LevelReplayCallback(), Played()
        model_of(on_pieces(NINE)).learn(14 * 4, callback=[callback, seen])
        assert len(seen.titles) > 12
        assert len(set(seen.titles[:9])) == 9
        # the tenth is drawn before the ninth has its score, but is no second first visit to it
        assert seen.titles[9] != seen.titles[8]

    @pytest.mark.parametrize("count", [7, 8, 9])
    def test_two_environments_do_not_draw_the_same_unseen_piece(self, count):
        pieces = NINE[:count]
        callback, seen = LevelReplayCallback(), Played()
        model = model_of(on_pieces(pieces, pieces, pieces), seed=count)
        model.learn(3 * 24, callback=[callback, seen])
        known = set(seen.rounds[0])  # drawn before the callback could say anything
        for drawn in seen.rounds[1:]:
            assert len(drawn) == 3  # pieces are equally long
            new = [title for title in drawn if title not in known]
            assert len(new) == len(set(new))
            known.update(new)
        assert known == {score.title for score in pieces}
        assert callback.sampler.unseen() == []

    def test_the_piece_with_the_most_to_learn_is_played_the_most(self):
        callback, seen = LevelReplayCallback(beta=0.1, rho=0.0), Played()
        model = model_of(DummyVecEnv([lambda: Rewarding(piano())]))
        model.learn(100, callback=[callback, seen])
        # the fourth is drawn before the third has its score
        assert set(seen.titles[:3]) == set("abc")
        assert set(seen.titles[4:]) == {"b"}
        counts = [seen.titles.count(title) for title in "abc"]
        assert counts == [callback.sampler.levels[name].visits for name in "abc"]

    def test_an_environment_chooses_among_its_own_pieces(self):
        a, b, c = THREE
        callback, seen = LevelReplayCallback(), Played()
        model = model_of(on_pieces([a, b], [c], [b, c]))
        model.learn(3 * 40, callback=[callback, seen])
        levels = callback.sampler.levels
        assert set(levels) == {"a", "b", "c"}
        assert all(level.score is not None for level in levels.values())
        # the piece of the one that has no choice is not counted
        assert sum(level.visits for level in levels.values()) < len(seen.titles)
        first, _, third = model.get_env().envs
        for env, names in ((first, ["a", "b"]), (third, ["b", "c"])):
            likely = callback.sampler.probabilities(names)
            assert env._probabilities.tolist() == pytest.approx(list(likely.values()))

    def test_a_training_that_goes_on_counts_no_episode_twice_and_no_given_score(self):
        venv = on_pieces(THREE)
        venv.set_options({"score": piece("other", 6)})
        callback, seen = LevelReplayCallback(), Played()
        model = model_of(venv)
        model.learn(2, callback=[callback, seen])
        assert seen.titles == ["other"]
        for _ in range(2):
            model.learn(14, callback=[callback, seen], reset_num_timesteps=False)
        visits = sum(level.visits for level in callback.sampler.levels.values())
        assert visits == len(seen.titles) - 3  # twice the other one, and one that was under way
        assert "other" not in callback.sampler.levels


class TestReproducibility:
    @staticmethod
    def trained(vector, seed=1):
        callback, seen = LevelReplayCallback(beta=1.0), Played()
        venv = on_pieces(THREE, THREE, vector=vector)
        model = model_of(venv, learning_starts=20, seed=seed)
        model.learn(2 * 40, callback=[callback, seen])
        venv.close()
        assert model._n_updates > 0
        return seen.titles, callback.state_dict()

    @pytest.mark.slow
    def test_equal_seeds_give_equal_runs_in_every_vector(self):
        first = self.trained(DummyVecEnv)
        for vector in (DummyVecEnv, ThreadVecEnv, ProcessVecEnv):
            assert self.trained(vector) == first
        assert self.trained(DummyVecEnv, seed=2)[0] != first[0]

    def test_scoring_draws_no_random_numbers(self):
        model = model_of(on_pieces(THREE))
        callback = LevelReplayCallback()
        model.learn(1, callback=callback)
        before = torch.get_rng_state(), np.random.get_state()[1].tolist()  # noqa: NPY002
        callback._values(np.stack([model.observation_space.sample()] * 3))
        assert torch.equal(torch.get_rng_state(), before[0])
        assert np.random.get_state()[1].tolist() == before[1]  # noqa: NPY002


def test_scores_and_coverage_are_logged(tmp_path):
    callback = Scores()
    model = model_of(on_pieces(THREE))
    lines = log_lines(tmp_path, model, 60, callback, log_interval=1)
    assert len(lines) == len(callback.scores)
    logged = list(series(lines, "level_replay/score").values())
    np.testing.assert_allclose(logged, [score for *_, score in callback.scores], rtol=1e-4)
    assert list(series(lines, "level_replay/unseen").values())[:4] == [2, 1, 0, 0]
    last = lines[-1]
    assert last["level_replay/gini"] == pytest.approx(callback.sampler.gini, abs=1e-4)
    likely = callback.sampler.probabilities()
    assert last["level_replay/top_probability"] == pytest.approx(max(likely.values()), abs=1e-4)


@pytest.fixture
def config(tmp_path):
    """Settings of a tiny SAC with level replay on three files."""
    for score in THREE:
        write_midi(score, tmp_path / f"{score.title}.mid")
    return RunConfig(pieces=str(tmp_path / "*.mid"), **Tables(__file__)["settings"])


def saved_state(run):
    """Return the state of the level replay in a run's checkpoint."""
    (state,) = Checkpoint.read(run.checkpoint_dir).callbacks[
        "sb3_piano.callbacks.level_replay.LevelReplayCallback"
    ]
    return state


@pytest.mark.slow
def test_an_interrupted_run_goes_on_with_its_scores_and_visits(config, tmp_path):
    result = train(config, tmp_path / "run", progress_bar=False, callbacks=[ActAt(60, "SIGINT")])
    assert (result.interrupted, result.num_timesteps) == (True, 60)
    before = saved_state(result.folder)
    assert {name.rpartition("/")[2] for name in before["levels"]} == {"a.mid", "b.mid", "c.mid"}
    assert all(level["score"] is not None for level in before["levels"].values())
    again = resume(result.folder.path, progress_bar=False, callbacks=[ActAt(62, "SIGINT")])
    assert again.num_timesteps == 62
    # a new episode of one piece has begun, and none has ended
    after = saved_state(result.folder)
    assert after["samples"] == before["samples"] + 1
    changed = [n for n in before["levels"] if before["levels"][n] != after["levels"][n]]
    (name,) = changed
    visits = before["levels"][name]["visits"] + 1
    expected = {**before["levels"][name], "visits": visits, "last": after["samples"]}
    assert after["levels"][name] == expected
    done = resume(result.folder.path, progress_bar=False)
    assert done.num_timesteps == 120
    assert saved_state(result.folder)["samples"] > after["samples"]


# The distribution, by hand and by other formulas.


tables = Tables(__file__)


def sampler_of(scores, beta=0.5, rho=0.3):
    """Return a sampler whose levels were visited in their order; ``None`` is no score yet."""
    sampler = LevelSampler(scores, beta, rho)
    for name, score in scores.items():
        if score is not None:
            sampler.visit(name)
            sampler.rate(name, score)
    return sampler


class TestDistribution:
    def test_the_share_falls_with_a_power_of_the_rank(self):
        # rank^-2 is 1, 1/9 and 1/4 of ranks 1, 3 and 2; their sum is 49/36
        expected = [36 / 49, 4 / 49, 9 / 49]
        np.testing.assert_allclose(score_shares([5.0, 1.0, 3.0], 0.5), expected)
        np.testing.assert_allclose(score_shares([5.0, 1.0, 3.0], 1.0), [6 / 11, 2 / 11, 3 / 11])

    def test_equal_scores_share_the_best_of_their_ranks(self):
        # ranks 2, 4, 2, 1 with beta 1: 1/2, 1/4, 1/2, 1
        expected = [2 / 9, 1 / 9, 2 / 9, 4 / 9]
        np.testing.assert_allclose(score_shares([3.0, 1.0, 3.0, 5.0], 1.0), expected)
        np.testing.assert_allclose(score_shares([0.0] * 4, 0.1), [1 / 4] * 4)
        # the smallest temperature leaves the highest score alone
        shares = score_shares(range(2000), 1e-300)
        assert (shares[-1], shares.sum()) == (1, 1)

    def test_scores_and_ages_are_mixed(self):
        sampler = sampler_of({"a": 1.0, "b": 3.0, "c": 2.0}, beta=1.0, rho=0.3)
        # drawn at 1, 2 and 3 of 3: ages 2, 1, 0; ranks 3, 1, 2
        expected = {
            "a": 0.7 * 2 / 11 + 0.3 * 2 / 3,
            "b": 0.7 * 6 / 11 + 0.3 * 1 / 3,
            "c": 0.7 * 3 / 11,
        }
        assert sampler.probabilities() == pytest.approx(expected)
        # Ranks and ages count among the levels that may be drawn.
        found = sampler.probabilities(["a", "c"])
        assert found == pytest.approx({"a": 0.7 / 3 + 0.3, "c": 0.7 * 2 / 3})
        sampler.visit("a")  # ages 0, 2, 1
        assert sampler.probabilities()["a"] == pytest.approx(0.7 * 2 / 11)
        assert sampler.probabilities()["b"] == pytest.approx(0.7 * 6 / 11 + 0.3 * 2 / 3)

    def test_rho_chooses_between_both_and_where_none_has_waited_scores_alone_count(self):
        for rho, expected in ((0.0, [2 / 3, 1 / 3]), (1.0, [0.0, 1.0])):
            sampler = sampler_of({"b": 1.0, "a": 2.0}, beta=1.0, rho=rho)
            assert list(sampler.probabilities(["a", "b"]).values()) == pytest.approx(expected)
        assert sampler_of({"a": 1.0, "b": 3.0}, rho=1.0).probabilities(["b"]) == {"b": 1.0}
        only = LevelSampler(["a", "b"], rho=1.0)
        for name in "ab":
            only.rate(name, 1.0)  # as after a restart amid the first episodes
        assert only.probabilities() == {"a": 0.5, "b": 0.5}

    @given(
        st.lists(st.floats(0, 1e6), min_size=1, max_size=20),
        st.floats(0.01, 10),
        st.floats(0, 1),
        st.integers(0, 19),
    )
    def test_it_always_is_a_distribution(self, scores, beta, rho, again):
        sampler = sampler_of({str(i): score for i, score in enumerate(scores)}, beta, rho)
        sampler.visit(str(again % len(scores)))
        found = np.array(list(sampler.probabilities().values()))
        assert found.min() >= 0
        assert found.sum() == pytest.approx(1)

    def test_unseen_levels_come_first_but_one_that_is_being_played(self):
        sampler = sampler_of({"a": 9.0, "b": None, "c": None})
        assert sampler.unseen() == ["b", "c"]
        assert sampler.probabilities() == {"a": 0.0, "b": 0.5, "c": 0.5}
        assert sampler.probabilities(["a"]) == {"a": 1.0}
        sampler.visit("b")
        assert sampler.unseen({"b"}) == ["c"]
        assert sampler.probabilities(playing={"b"}) == {"a": 0.0, "b": 0.0, "c": 1.0}
        assert sampler.probabilities(playing={"b", "c"}) == {"a": 1.0, "b": 0.0, "c": 0.0}
        assert sampler.unseen() == ["b", "c"]  # also if that episode was broken off
        first = LevelSampler(["a", "b"]).probabilities(playing={"a", "b"})
        assert first == {"a": 0.5, "b": 0.5}


class TestGini:
    def test_of_the_most_uneven_case_of_the_paper_of_no_counts_and_of_visits(self):
        assert gini([689] + [111 / 29] * 29) == pytest.approx(0.828, abs=5e-4)  # evened out
        assert gini([]) == 0
        sampler = sampler_of({"a": 1.0, "b": 1.0})
        assert sampler.gini == 0
        sampler.visit("a")
        sampler.visit("a")
        assert sampler.gini == pytest.approx(0.25)  # of 3 and 1

    @given(st.lists(st.integers(0, 1000), min_size=1, max_size=30))
    def test_it_is_the_sum_over_all_pairs(self, counts):
        v = np.array(counts)
        total = 2 * len(v) * v.sum()
        by_pairs = np.abs(v[:, None] - v).sum() / total if total else 0.0
        assert gini(counts) == pytest.approx(by_pairs)


class TestState:
    def test_it_survives_json(self):
        sampler = sampler_of({"a": 1.5, "b": None, "c": 0.25})
        state = json.loads(json.dumps(sampler.state_dict()))
        assert state == tables["state"]
        other = LevelSampler(["z"])
        other.load_state_dict(state)
        assert other.state_dict() == state
        for twin in (sampler, other):
            twin.rate("b", 1.0)
        assert other.probabilities() == sampler.probabilities()

    def test_levels_may_come_and_go_and_a_new_score_takes_the_place_of_the_former_one(self):
        sampler = sampler_of({"a": 1.0, "b": 2.0})
        sampler.rate("b", 4.0)
        sampler.set_levels(["c", "b"])
        assert sampler.levels == {"c": Level(), "b": Level(score=4.0, visits=1, last=2)}

    @tables("state, message")
    def test_what_is_no_state_or_score_is_refused(self, state, message):
        sampler = sampler_of({"a": 1.0})
        with pytest.raises(ConfigError, match=message):
            sampler.load_state_dict(state)
        assert list(sampler.levels) == ["a"]
        for score in (-0.1, float("nan"), float("inf")):
            with pytest.raises(ConfigError, match=f"score is {score}: expected a finite number"):
                sampler.rate("a", score)
