"""The environment equals RoboPianist, number by number, on recorded episodes."""

import dataclasses

import mujoco
import numpy as np
import pytest

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnv

# The names of the recorded reward terms and observation blocks, in the order of ours.
TERMS = {
    "key_press": "key_press",
    "sustain": "sustain_reward",
    "energy": "energy",
    "fingering": "fingering_reward",
    "forearm": "forearm",
}
BLOCKS = {
    "goal": "obs_goal",
    "fingering": "obs_fingering",
    "key_state": "obs_piano_state",
    "sustain": "obs_sustain",
    "right_joints": "obs_rh_joints",
    "left_joints": "obs_lh_joints",
}


def make_env(recording):
    env = PianoEnv(recording.piece, **recording.options)
    env.reset(seed=0)
    return env


def state_at(env, recording, row, finished=False):
    """Return the recorded state before step ``row``, with what was recorded up to there."""
    mujoco.mj_resetData(env.model, env.data)
    env.data.qpos[:], env.data.qvel[:] = recording["qpos"][row], recording["qvel"][row]
    pedal = (recording["action"][row - 1, -1] + 1) / 2 if row > 0 else 0.0
    return dataclasses.replace(
        env.get_state(),
        finished=finished,
        pedal=pedal,
        key_active=recording["key_active"][:row].astype(bool),
        sustain=recording["sustain_active"][:row, 0],
        fingertips=np.zeros((row, 10, 3)),  # not recorded
    )


def one_step_deviations(recording):
    """Step from every recorded state; return the deviations, and where forearms touched."""
    env = make_env(recording)
    qpos, energy, touched, wrong_keys = [], [], [], 0
    for row in range(len(recording)):
        env.set_state(state_at(env, recording, row))
        touching = env.scene.forearms_touch(env.data)
        *_, info = env.step(recording["action"][row])
        touched.append(touching or env.scene.forearms_touch(env.data))
        qpos.append(np.abs(env.data.qpos - recording["qpos"][row + 1]).max())
        weighted = DEFAULT_REWARD_WEIGHTS["energy"] * info["reward_terms"]["energy"]
        energy.append(abs(weighted - recording["energy"][row]))
        wrong_keys += int((env.key_active != recording["key_active"][row]).sum())
    return np.array(qpos), np.array(energy), np.array(touched), wrong_keys, info


def test_one_control_step_from_every_recorded_state_equals_the_recorded_next_state(rollout, tell):
    qpos, energy, touched, wrong_keys, info = one_step_deviations(rollout)
    tell(
        f"{rollout.piece}: one-step qpos deviation, apart ({(~touched).sum()} rows): "
        f"median {np.median(qpos[~touched]):.1e}, 90 % {np.quantile(qpos[~touched], 0.9):.1e}, "
        f"worst {qpos[~touched].max():.1e}; touching ({touched.sum()} rows): "
        f"median {np.median(qpos[touched]):.1e}, worst {qpos[touched].max():.1e}; "
        f"energy: median {np.median(energy):.1e}, worst {energy.max():.1e}; "
        f"wrong key states: {wrong_keys}"
    )
    assert np.median(qpos[~touched]) < 1e-9
    assert np.quantile(qpos[~touched], 0.9) < 1e-5
    assert np.median(qpos[touched]) < 1e-4
    assert np.median(energy) < 1e-5
    assert wrong_keys == 0
    for metric in ("precision", "recall", "f1"):
        assert info[metric] == pytest.approx(float(rollout[metric]), abs=1e-9)


def test_every_observation_block_of_every_recorded_state_equals_the_recorded_one(rollout, tell):
    env = make_env(rollout)
    worst = dict.fromkeys(BLOCKS, 0.0)
    for row in range(len(rollout) + 1):
        observation = env.set_state(state_at(env, rollout, row, finished=row == len(rollout)))
        for block, recorded in BLOCKS.items():
            ours = observation[env.observation_layout[block].slice]
            # float32 is the observation's own resolution: compare what it can hold.
            theirs = rollout[recorded][row].astype(np.float32)
            worst[block] = max(worst[block], float(np.abs(ours - theirs).max()))
    tell(f"{rollout.piece}: worst observation deviations {worst}")
    assert max(worst.values()) <= 1e-9


def test_the_key_state_equals_the_recorded_one_in_double_precision(rollout):
    env = make_env(rollout)
    for row in range(len(rollout) + 1):
        env.data.qpos[:] = rollout["qpos"][row]
        ours = env.scene.key_angle(env.data) / env.scene.key_max_angle
        np.testing.assert_allclose(ours, rollout["obs_piano_state"][row], rtol=0, atol=1e-9)


def test_every_reward_term_of_every_recorded_state_equals_the_recorded_one(rollout, tell):
    env = make_env(rollout)
    worst = dict.fromkeys(TERMS, 0.0)
    for row in range(len(rollout)):
        env.set_state(state_at(env, rollout, row + 1))
        terms = env.reward_terms(row)
        for term, recorded in TERMS.items():
            ours = DEFAULT_REWARD_WEIGHTS[term] * terms[term]
            worst[term] = max(worst[term], float(abs(ours - rollout[recorded][row])))
    del worst["energy"]  # needs the forces of the step before: see the one-step test
    tell(f"{rollout.piece}: worst reward-term deviations {worst}")
    assert max(worst.values()) <= 1e-9


@pytest.mark.slow
def test_recorded_playing_replayed_open_loop_earns_the_recorded_scores(performance, tell):
    env = make_env(performance)
    rewards, info = performance.replay(env)
    deviation = sum(rewards) - performance["reward"].sum()
    tell(
        f"{performance.piece}: open-loop replay F1 {info['f1']:.6f} (recorded "
        f"{float(performance['f1']):.6f}), return deviates by {deviation:.1e}"
    )
    np.testing.assert_array_equal(env.performance.key_active, performance["key_active"])
    for metric in ("precision", "recall", "f1"):
        assert info[metric] == pytest.approx(float(performance[metric]), abs=1e-9)
    assert deviation == pytest.approx(0.0, abs=1e-3)
