"""Within a control step, the time is noted at which a key goes down or comes up."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sb3_piano.envs import PianoEnv
from sb3_piano.envs.record import press_times
from sb3_piano.metrics import Presses, presses_of


def within(**columns):
    """Return (p, 88) bool from the states of keys k<number>: ``.`` up, ``#`` down."""
    states = np.zeros((5, 88), dtype=bool)
    for name, column in columns.items():
        states[:, int(name[1:])] = [state == "#" for state in column]
    return states


def times_of(made, moments, n_steps):
    """Return the press times, with what is known ``within`` by control step."""
    states = np.array(list(moments.values()), dtype=bool).reshape(-1, 5, 88)
    return press_times(made, np.array(list(moments), dtype=np.intp), states, 0.05, n_steps)


def presses(*rows):
    return Presses(*(np.array(column, dtype=np.intp) for column in zip(*rows, strict=True)))


@pytest.mark.parametrize(
    ("states", "time"),
    [
        ("....#", 0.05),  # with the last physics step, which is the end of the control step
        ("..###", 0.03),
        ("#####", 0.01),
        ("#.###", 0.03),  # it bounced, and went down for good then
        ("##..#", 0.05),
    ],
)
def test_a_key_is_struck_when_it_goes_down_for_good(states, time):
    strikes, releases = times_of(presses((40, 2, 4)), {2: within(k40=states)}, 4)
    assert strikes == pytest.approx([0.1 + time])
    assert releases == pytest.approx([0.2])  # still held


def test_each_press_has_its_own_times():
    moments = {
        0: within(k10="..###", k20="....#"),
        1: within(k10="##...", k20="#####"),
        3: within(k10="....#", k20="#####", k30="...##"),
        4: within(k10="#####", k20="#....", k30="#####"),
    }
    made = presses((10, 0, 1), (20, 0, 4), (10, 3, 5), (30, 3, 5))
    strikes, releases = times_of(made, moments, 5)
    assert strikes == pytest.approx([0.03, 0.05, 0.2, 0.19])
    assert releases == pytest.approx([0.08, 0.22, 0.25, 0.25])


def test_a_key_that_goes_down_with_the_last_physics_step_still_makes_a_note():
    strikes, releases = times_of(presses((40, 2, 3)), {2: within(k40="....#")}, 3)
    assert (strikes, releases) == (pytest.approx([0.15]), pytest.approx([0.151]))


@pytest.mark.slow
@pytest.mark.parametrize("physics", ["reference", "fast"])
def test_times_are_those_of_a_simulation_watched_step_by_step(performance, physics):
    env = PianoEnv(performance.piece, **performance.options, physics=physics)
    env.reset(seed=0)
    data, sounding = mujoco.MjData(env.model), []
    for action in performance["action"][: len(env.roll)]:
        env.step(action)
        data.ctrl[:] = env.data.ctrl
        for _ in range(env.config.n_substeps):
            mujoco.mj_step(env.model, data)
            angle = data.qpos[env.scene.key_qpos]
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
    env.reset(seed=0)
    for action in performance["action"][: len(env.roll)]:
        *_, info = env.step(action)
    assert info["fingering_agreement"] > 0.9
    assert info["effective_fingers"] > 5
    played = env.performance.to_score()
    assert {note.finger for note in played.notes} == {note.finger for note in env.score.notes}
    # The planner that made them has keys down by the end of a step: some 25 ms late, if not more.
    assert 20 < info["onset_error_mean_ms"] < 35
    env.reset(seed=0)
    for _ in range(len(env.roll)):
        *_, resting = env.step(env.rest_action)
    assert (resting["f1"], resting["onset_f1"]) == (info["noop_f1"], 0.0)
    assert info["normalized_return"] == pytest.approx(
        float(np.sum(performance["reward"])) / env._goal.highest_return, rel=0.01
    )
