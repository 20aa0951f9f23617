"""A batch gives, world by world, what single environments give."""

from __future__ import annotations

import functools
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

import sb3_piano
from sb3_piano.batch import BatchedPiano, BatchVecEnv
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError, InvalidActionError
from sb3_piano.music import Note, Score
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import Excerpt, HandActions, HandReward, HideFingering

LEAP = str(Path(__file__).parents[2] / "examples" / "leap_hand")
FAST = {"physics": "fast", "initial_buffer_time": 0.2}


def score(*pitches, step=0.15, thumb=0):
    """Return notes one after the other, of the thumb to the little finger of a hand."""
    notes = [
        Note(onset=step * i, offset=step * (i + 1), pitch=p, finger=thumb + i % 5)
        for i, p in enumerate(pitches)
    ]
    return Score(notes=notes, title=f"from {pitches[0]}")


SCORES = [score(60, 62, 64), score(67, 65, 64, 62, 60)]  # 14 and 20 control steps
HANDS = (functools.partial(HandReward, strikes=0.4, guidance=0.2), HandActions)


def smooth_actions(steps, n_envs, size, seed=0):
    """Return actions that wander, with the fingers low so that keys are played."""
    rng = np.random.default_rng(seed)
    action, actions = np.zeros((n_envs, size)), []
    for _ in range(steps):
        action = np.clip(0.8 * action + 0.5 * rng.normal(size=action.shape), -1, 1)
        actions.append(action.astype(np.float32))
    return actions


def single_envs(count, scores, wrappers, options):
    envs = []
    for slot in range(count):
        env = PianoEnv(scores[slot % len(scores)], **options)
        for wrapper in wrappers:
            env = wrapper(env)
        envs.append(env)
    return envs


ONE_HAND = {
    side: {"hands_in_scene": side, "observation": "hands", "scores": [score(60, 62, thumb=thumb)]}
    for side, thumb in (("right", 0), ("left", 5))
}
OPTIONS = [
    {"observation": "roll"},
    {"observation": "hands", "wrappers": HANDS},
    {"observation": "hands", "hands_version": 2},
    ONE_HAND["right"],
    {"hands_in_scene": "none"},
    {"wrong_press_termination": True},
    *(
        pytest.param(options, marks=pytest.mark.slow)
        for options in (
            {"hand": LEAP, "observation": "fingers"},
            {"hand": LEAP, "observation": "hands", "wrappers": HANDS[1:]},
            {"observation": "window", "scores": SCORES[1:]},
            {"observation": "fingers", "physics": "faithful"},
            {"reward_weights": {"strike": 0.3, "energy": 0.0}, "goal_time": "end"},
            ONE_HAND["left"],
            {"fingering": "optimal-transport", "forearm_reward": False},
            {"forearm_dofs": ["forearm_tx", "forearm_yaw"]},
        )
    ),
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: "-".join(options))
def test_observations_rewards_and_metrics_are_those_of_single_environments(options):
    """Of whole episodes; in those of five fingers to their ends, many keys are struck."""
    options = {"wrappers": (), "scores": SCORES, **FAST, **options}
    wrappers, scores, count = options.pop("wrappers"), options.pop("scores"), 3
    envs = single_envs(count, scores, wrappers, options)
    batch = BatchedPiano(count, scores, wrappers=wrappers, n_threads=1, **options)
    first = np.stack([env.reset()[0] for env in envs])
    np.testing.assert_array_equal(batch.reset().numpy(), first)
    playing, struck = set(range(count)), 0
    for action in smooth_actions(40, count, batch.action_space.shape[0]):
        seen = batch.step(torch.from_numpy(action))
        struck += int(batch.heard.struck.sum())
        for slot in sorted(playing):
            observation, reward, terminated, truncated, info = envs[slot].step(action[slot])
            np.testing.assert_array_equal(seen.observation[slot].numpy(), observation)
            assert seen.reward[slot].item() == pytest.approx(reward, abs=1e-12)
            assert bool(seen.terminated[slot]) == terminated
            assert bool(seen.truncated[slot]) == truncated
            if terminated or truncated:
                playing.discard(slot)
                ours = batch.summaries([slot])[0]
                assert ours == pytest.approx({name: info[name] for name in ours}, nan_ok=True)
                assert ours["f1"] == info["f1"]
                assert ours["onset_f1"] == info["onset_f1"]
    assert not playing
    assert struck > 10 or len(scores) == 1 or options.keys() & {"hand", "wrong_press_termination"}


def test_keys_may_be_rigid_as_in_one_environment():
    env = PianoEnv(SCORES[0], **FAST)
    env.fix_keys(36, 50)
    batch = BatchedPiano(2, SCORES[0], moving_keys=(36, 50), **FAST)
    np.testing.assert_array_equal(batch.reset()[1].numpy(), env.reset()[0])
    for action in smooth_actions(14, 2, 39):
        seen = batch.step(torch.from_numpy(action))
        observation, reward, *_, info = env.step(action[1])
        np.testing.assert_array_equal(seen.observation[1].numpy(), observation)
        assert seen.reward[1].item() == pytest.approx(reward, abs=1e-12)
    assert batch.summaries([1])[0]["onset_f1"] == info["onset_f1"]


def test_worlds_are_reset_by_a_mask_and_others_play_on():
    batch = BatchedPiano(2, SCORES[0], **FAST)
    batch.reset()
    actions = [torch.from_numpy(a) for a in smooth_actions(9, 2, 39)]
    for action in actions[:4]:
        batch.step(action)
    batch.reset(torch.tensor([False, True]))
    for action in actions[4:]:
        seen = batch.step(action)
    for world, start in ((0, 0), (1, 4)):
        env = PianoEnv(SCORES[0], **FAST)
        env.reset()
        for action in actions[start:]:
            observation, *_ = env.step(action[world].numpy())
        np.testing.assert_array_equal(seen.observation[world].numpy(), observation)


@pytest.mark.parametrize(
    "options",
    [{}, {"hand": LEAP}, {"forearm_dofs": ["forearm_tx", "forearm_yaw"]}],
    ids=lambda options: "-".join(options),
)
def test_forearms_touch_where_they_do_in_a_single_environment(options):
    env, random = PianoEnv(SCORES[0], **FAST, **options), np.random.default_rng(0)
    batch = BatchedPiano(200, SCORES[0], n_threads=1, **FAST, **options)
    scene, data, qpos = env.scene, env.data, batch.worlds.qpos.clone()
    joints = np.concatenate([qpos_of[-2:] for qpos_of in scene.joint_qpos])  # of the forearms
    qpos[:, joints] = torch.from_numpy(random.uniform(-0.3, 0.3, (200, len(joints))))
    batch.worlds.set_state(qpos, torch.zeros_like(batch.worlds.qvel))
    expected = []
    for row in qpos.numpy():
        data.qpos[:] = row
        mujoco.mj_forward(env.model, data)
        expected.append(scene.forearms_touch(data))
    assert 20 < sum(expected) < 180
    assert batch.worlds.forearms_touch().tolist() == expected


def test_equal_seeds_draw_equal_pieces_and_places():
    wrappers = (functools.partial(Excerpt, start="random", length=0.2),)
    options = {**FAST, "randomize_hand_positions": True, "wrappers": wrappers, "draws": 12}

    def played(seed):
        batch = BatchedPiano(6, SCORES[1], seed=seed, **options)
        rows = [batch.reset().numpy(), batch.piece.numpy().copy(), batch.reset().numpy()]
        assert len(batch.pieces.goals) > 2
        return rows

    for one, same in zip(played(3), played(3), strict=True):
        np.testing.assert_array_equal(one, same)
    assert not np.array_equal(played(3)[0], played(4)[0])


def test_sums_are_f1_and_returns_alone():
    options = {**FAST, "n_threads": 1}
    batches = [BatchedPiano(2, SCORES[0], metrics=kind, **options) for kind in ("all", "sums")]
    for batch in batches:
        batch.reset()
        for action in smooth_actions(14, 2, 39):
            batch.step(torch.from_numpy(action))
    every, some = (batch.summaries([0, 1]) for batch in batches)
    for one, few in zip(every, some, strict=True):
        assert {"f1", "return_key_press", "normalized_return"} < set(few) < set(one)
        assert few == pytest.approx({name: one[name] for name in few})


def test_what_is_wrong_is_told_in_one_line():
    with pytest.raises(ConfigError, match="'smooth' of reward_terms .* cannot be batched"):
        BatchedPiano(2, SCORES[0], reward_terms={"smooth": "own_terms.smooth"})
    with pytest.raises(ConfigError, match="reward of dynamics has weight 0.5, but"):
        BatchedPiano(2, SCORES[0], reward_weights={"dynamics": 0.5})
    with pytest.raises(ConfigError, match="HideFingering is no wrapper that can be batched"):
        BatchedPiano(2, SCORES[0], wrappers=[HideFingering])
    with pytest.raises(ConfigError, match="device is 'cuda', but MuJoCo's own threads are on"):
        BatchedPiano(2, SCORES[0], device="cuda")
    batch = BatchedPiano(2, SCORES[0], **FAST)
    with pytest.raises(EnvStateError, match="call reset"):
        batch.step(torch.zeros(2, 39))
    batch.reset()
    with pytest.raises(InvalidActionError, match=r"shape \(2, 3\): expected \(2, 39\)"):
        batch.step(torch.zeros(2, 3))
    with pytest.raises(InvalidActionError, match="not finite"):
        batch.step(torch.full((2, 39), torch.nan))


def test_a_world_whose_physics_breaks_down_ends_alone():
    batch = BatchedPiano(2, SCORES[0], **FAST)
    batch.reset()
    batch.worlds.qpos[1, 5] = 1e12
    seen = batch.step(torch.zeros(2, 39))
    assert seen.terminated.tolist() == [False, True]
    assert seen.reward[1] == 0
    batch.reset(seen.terminated)
    assert not batch.step(torch.zeros(2, 39)).terminated.any()


def test_stable_baselines_gets_final_infos_and_next_episodes():
    venv = BatchVecEnv(BatchedPiano(3, SCORES, **FAST))
    first = venv.reset()
    over = []
    for action in smooth_actions(20, 3, 39):
        observations, rewards, dones, infos = venv.step(action)
        assert rewards.dtype == np.float32
        for slot in np.flatnonzero(dones):
            over.append((slot, infos[slot]["episode"]["l"]))
            np.testing.assert_array_equal(observations[slot], first[slot])
            assert infos[slot]["TimeLimit.truncated"]
            assert infos[slot]["terminal_observation"].shape == first[slot].shape
            returns = sum(v for name, v in infos[slot].items() if name.startswith("return_"))
            assert infos[slot]["episode"]["r"] == pytest.approx(returns, abs=1e-4)
            assert "onset_f1" in infos[slot]
    assert over == [(0, 14), (2, 14), (1, 20)]


def test_hands_are_agents_of_a_batch_too():
    batch = BatchedPiano(2, SCORES[0], wrappers=HANDS, observation="hands", **FAST)
    venv = HandsAsAgents(BatchVecEnv(batch))
    assert venv.num_envs == 4
    venv.reset()
    action = smooth_actions(1, 4, venv.action_space.shape[0])[0]
    observations, rewards, _, _ = venv.step(action)
    assert observations.shape == (4, *venv.observation_space.shape)
    assert rewards.tolist() == pytest.approx(batch.hand_rewards.flatten().tolist())


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_gymnasium_makes_vectors_of_each_mode_that_equal_those_of_threads(mode):
    sb3_piano.register_envs()

    def made(**more):
        return gym.make_vec(
            "RoboPianist-v0",
            2,
            gym.VectorizeMode.VECTOR_ENTRY_POINT,
            score=SCORES[0],
            autoreset_mode=mode,
            **FAST,
            **more,
        )

    ours, theirs = made(backend="cpu"), made()
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    np.testing.assert_array_equal(ours.reset()[0], theirs.reset()[0])
    for action in smooth_actions(16, 2, 39):
        *mine, my_info = ours.step(action)
        *expected, info = theirs.step(action)
        for one, other in zip(mine, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12)
        if "final_info" in info:
            assert set(my_info["final_info"]) < set(info["final_info"])
        if expected[3].any() and mode == "Disabled":
            both = np.ones(2, dtype=bool)
            for envs in (ours, theirs):
                envs.reset(options={"reset_mask": both})
    theirs.close()


def test_tensors_are_given_on_demand():
    envs = gym.make_vec(
        "RoboPianist-v0", 2, "vector_entry_point", score=SCORES[0], backend="cpu", tensors=True
    )
    observation, _ = envs.reset()
    assert isinstance(observation, torch.Tensor)
    assert isinstance(envs.step(torch.zeros(2, 39))[1], torch.Tensor)


@pytest.mark.slow
def test_ppo_on_64_worlds_learns_the_piano_that_plays_itself():
    options = {"physics": "fast", "hands_in_scene": "none", "n_steps_lookahead": 0}
    pianos = BatchedPiano(64, "debug-CMajorScaleTwoHands", metrics="sums", seed=0, **options)
    scores = []

    def note(local, _):
        scores.extend(info["f1"] for info in local["infos"] if "f1" in info)
        return True

    settings = {"n_steps": 32, "batch_size": 512, "n_epochs": 6, "gamma": 0.0, "gae_lambda": 1.0}
    settings |= {"learning_rate": 1e-3, "device": "cpu", "seed": 0}
    network = {"log_std_init": -0.7, "net_arch": [256]}
    model = PPO("MlpPolicy", BatchVecEnv(pianos), policy_kwargs=network, **settings)
    model.learn(90_000, callback=note)
    assert np.mean(scores[-64:]) > 0.15 > 4 * np.mean(scores[:64])
