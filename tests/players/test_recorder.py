"""Records of episodes, whoever ends them."""

import mujoco
import numpy as np
import pytest
from episodes import steps_of
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv
from sb3_piano.envs.record import press_times
from sb3_piano.metrics import EPISODE_METRICS, Presses, presses_of
from sb3_piano.music import Note, Score
from sb3_piano.players import EpisodeRecorder

STEPS = 8  # the note's 0.4 s, with the control step in which it ends
SCORE = Score(notes=[Note(onset=0.0, offset=0.35, pitch=60, finger=0)], title="one")


def recorded(max_steps, steps):
    """Play so many steps under a time limit around the recorder; return it and its actions."""
    recorder = EpisodeRecorder(PianoEnv(SCORE, physics="fast"))
    venv = DummyVecEnv([lambda: TimeLimit(recorder, max_steps)])
    venv.reset()
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, 1, 39)).astype(np.float32)
    for action in actions:
        venv.step(action)
    return recorder, actions[:, 0]


@pytest.mark.parametrize(("max_steps", "length"), [(3, 3), (STEPS, STEPS), (100, STEPS)])
def test_each_episode_is_recorded_once_whoever_ends_it(max_steps, length):
    recorder, actions = recorded(max_steps, 2 * length + 1)
    first, second = recorder.finished
    for one, own in ((first, actions[:length]), (second, actions[length : 2 * length])):
        assert one.metrics["length"] == len(one.performance) == length
        np.testing.assert_array_equal(one.motion.actions, own)
        assert one.motion.qpos.shape[0] == length + 1
    assert first.metrics["return"] != second.metrics["return"]


def test_an_episode_that_is_cut_off_has_the_numbers_of_its_steps():
    whole, cut = (recorded(steps, STEPS)[0].finished[0] for steps in (STEPS, 3))
    assert cut.metrics.keys() == whole.metrics.keys() > set(EPISODE_METRICS)
    assert cut.metrics["f1"] == cut.performance.metrics()["f1"]
    terms = [value for name, value in cut.metrics.items() if name.startswith("return_")]
    assert sum(terms) == pytest.approx(cut.metrics["return"])


# Within a control step, the time is noted at which a key goes down or comes up.


def test_a_key_that_goes_down_with_the_last_physics_step_still_makes_a_note():
    within = np.zeros((1, 5, 88), dtype=bool)  # of control step 2
    within[0, 4, 40] = True
    made = Presses(*np.array([[40], [2], [3]]))
    strikes, releases = press_times(made, np.array([2]), within, 0.05, 3)
    assert (strikes, releases) == (pytest.approx([0.15]), pytest.approx([0.151]))


@pytest.mark.slow
@pytest.mark.parametrize("physics", ["reference", "fast"])
def test_times_are_those_of_a_simulation_watched_step_by_step(performance, physics):
    env = PianoEnv(performance.piece, **performance.options, physics=physics)
    env.reset(seed=0)
    data, sounding, angles = mujoco.MjData(env.model), [], []
    for action in performance["action"][: len(env.roll)]:
        env.step(action)
        data.ctrl[:] = env.data.ctrl
        for _ in range(env.config.n_substeps):
            mujoco.mj_step(env.model, data)
            angle = data.qpos[env.scene.key_qpos]
            angles.append(angle)
            sounding.append(angle >= env.scene.key_sounding_angle)
    states = np.array(sounding).reshape(len(env.performance), -1, 88)
    played, timestep = env.performance, env.model.opt.timestep
    found = presses_of(played.key_active)
    assert len(found.key) > 10
    flat = states.reshape(-1, 88)
    for key, first, strike in zip(found.key, found.first, played.strike_time, strict=True):
        before, at = round(strike / timestep) - 2, round(strike / timestep) - 1
        end = (first + 1) * env.config.n_substeps
        assert first < strike / 0.05 <= first + 1 + 1e-9
        assert flat[at:end, key].all()
        assert at == first * env.config.n_substeps or not flat[before, key]
    # The speed is what the key moved by in the physics step with which it began to sound.
    at = np.rint(played.strike_time / timestep).astype(int) - 1
    moved = np.diff(angles, axis=0, prepend=np.zeros((1, 88)))[at, found.key]
    np.testing.assert_allclose(played.strike_speed, moved / timestep, atol=1e-12)
    # The releases obey the same rule, seen from the end of each press.
    open_ended = found.end == len(played)
    for key, end, release in zip(
        found.key[~open_ended],
        found.end[~open_ended],
        played.release_time[~open_ended],
        strict=True,
    ):
        at, stop = round(release / timestep) - 1, (end + 1) * env.config.n_substeps
        assert not flat[at:stop, key].any()
        assert at == end * env.config.n_substeps or flat[at - 1, key]
    np.testing.assert_allclose(played.release_time[open_ended], env.roll.duration)


@pytest.mark.slow
def test_good_playing_is_done_by_the_fingers_that_the_score_names(performance):
    env = PianoEnv(performance.piece, **performance.options)
    _, info = performance.replay(env)
    assert info["fingering_agreement"] > 0.9
    assert info["effective_fingers"] > 5
    played = env.performance.to_score()
    assert {note.finger for note in played.notes} == {note.finger for note in env.score.notes}
    # The planner that made them has keys down by the end of a step: some 25 ms late, if not more.
    assert 20 < info["onset_error_mean_ms"] < 35
    *_, (*_, resting) = steps_of(env, lambda _: env.rest_action)
    assert (resting["f1"], resting["onset_f1"]) == (info["noop_f1"], 0.0)
    assert info["normalized_return"] == pytest.approx(
        float(np.sum(performance["reward"])) / env.goal.highest_return, rel=0.01
    )
