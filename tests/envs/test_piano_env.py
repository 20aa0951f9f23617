"""The environment's behaviour on scores of a few notes, written here."""

import copy
import dataclasses
import functools
import inspect
import pickle
import re
import warnings

import mujoco
import numpy as np
import pytest
import torch
from short_scores import score_of

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, RETURN_KEYS, EnvState, PianoEnv
from sb3_piano.exceptions import (
    ConfigError,
    EnvStateError,
    InvalidActionError,
    SimulationDivergedError,
)
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.metrics.musicianship import MUSICIANSHIP
from sb3_piano.music import Note, Score

# Three control steps of middle C by the right thumb, then two of E by the left index finger with
# the pedal; with the silent step after the last note, six steps.
C4, E4 = 60 - 21, 64 - 21
TINY = score_of((0.0, 0.15, 60, 0), (0.15, 0.25, 64, 6), pedals=[(0.15, 0.25)], title="tiny")


def random_actions(env, count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, *env.action_space.shape)).astype(np.float32)


def play(env, actions):
    """Return everything that an episode hands out, flattened into comparable arrays."""
    rows = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        terms = list(info["reward_terms"].values())
        rows.append(np.concatenate([observation, [reward, terminated, truncated], terms]))
        if terminated or truncated:
            break
    return np.array(rows)


def push_key(env, key):
    """Press a key down with an outside torque, as no action can be relied upon to."""
    dof = env.model.jnt_dofadr[np.flatnonzero(env.model.jnt_qposadr == env.scene.key_qpos[key])]
    env.data.qfrc_applied[dof] = 10.0


@pytest.fixture
def env():
    env = PianoEnv(TINY, n_steps_lookahead=2)
    env.reset(seed=0)
    return env


# The layout of the observation and the pedal in it.


def test_the_class_docstring_tells_the_default_layout():
    layout = PianoEnv(TINY).observation_layout
    text = inspect.getdoc(PianoEnv)
    rows = re.findall(r"^\| (\w+) \| (\d+)(?:-(\d+))? \|", text, re.MULTILINE)
    told = {name: (int(first), int(last or first)) for name, first, last in rows}
    assert told == {b.name: (b.start, b.start + b.size - 1) for b in layout.values()}


def test_the_pedal_is_observed_as_a_command_and_down_from_the_middle_on(env):
    action = env.rest_action
    for command, down in [(-1.0, False), (-0.02, False), (0.0, True), (1.0, True)]:
        env.reset()
        action[-1] = command
        observation, *_ = env.step(action)
        shown = observation[env.observation_layout["sustain"].slice]
        assert shown == pytest.approx((command + 1) / 2)
        assert env.pedal_down is down


# Rewards and the end of an episode.


def test_the_song_ends_in_truncation_after_its_last_step_with_all_numbers_in_info(env):
    returns = dict.fromkeys(RETURN_KEYS, 0.0)
    for step in range(6):
        _, _, terminated, truncated, info = env.step(env.rest_action)
        assert not terminated
        assert truncated is (step == 5)
        for name, value in info["reward_terms"].items():
            returns[f"return_{name}"] += DEFAULT_REWARD_WEIGHTS[name] * value
    assert all(type(info[name]) is float for name in (*EPISODE_METRICS, *RETURN_KEYS))
    assert {name: info[name] for name in RETURN_KEYS} == pytest.approx(returns)
    # Nothing was pressed: of six steps one is silent, and four have no pedal.
    assert (info["precision"], info["recall"], info["f1"]) == pytest.approx((1, 1 / 6, 1 / 6))
    assert info["sustain_f1"] == pytest.approx(4 / 6)


def test_musicianship_is_in_the_last_info_where_it_is_asked_for(env):
    for asked in (PianoEnv(TINY, musicianship=True), env):
        asked.reset(seed=0)
        info = [asked.step(asked.rest_action)[-1] for _ in range(6)][-1]
        names = MUSICIANSHIP if asked is not env else ()
        assert set(MUSICIANSHIP) & set(info) == set(names)
        assert all(type(info[name]) is float for name in names)


def test_returns_belong_to_their_terms_in_whatever_order_these_come(env, monkeypatch):
    terms = {"fingering": 3.0, "energy": -20.0, "forearm": 0.0, "sustain": 1.0, "key_press": 0.5}
    terms |= {"strike": -2.0, "dynamics": 1.5}
    values = {name: functools.partial(lambda value, _: value, terms[name]) for name in terms}
    monkeypatch.setattr(env, "_terms", values)
    info = [env.step(env.rest_action)[-1] for _ in range(6)][-1]
    expected = {f"return_{n}": 6 * w * terms[n] for n, w in DEFAULT_REWARD_WEIGHTS.items()}
    assert {name: info[name] for name in RETURN_KEYS} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("enabled", "key", "step", "ends"),
    [
        (True, 5, 0, (True, False)),
        (True, C4, 0, (False, False)),
        (False, 5, 0, (False, False)),
        (True, 5, 5, (False, True)),  # at the end of the song it is truncation, as in RoboPianist
    ],
)
def test_a_wrong_press_terminates_only_where_it_is_asked_to(enabled, key, step, ends):
    env = PianoEnv(TINY, wrong_press_termination=enabled)
    env.reset(seed=0)
    for _ in range(step):
        env.step(env.rest_action)
    push_key(env, key)
    _, _, terminated, truncated, info = env.step(env.rest_action)
    assert (terminated, truncated) == ends
    if terminated:  # an early end has all the numbers too, over the one step that was played
        assert set(info) >= {*EPISODE_METRICS, *RETURN_KEYS}
        assert (info["precision"], info["recall"]) == (0.0, 0.0)
        with pytest.raises(EnvStateError, match="reset"):
            env.step(env.rest_action)


@pytest.mark.parametrize(
    ("choice", "labelled", "expected"),
    [
        ("auto", True, "labels"),
        ("auto", False, "optimal-transport"),
        ("labels", False, "zero"),
        ("optimal-transport", True, "optimal-transport"),
        ("off", True, "zero"),
    ],
)
def test_the_fingering_term_follows_the_labels_or_the_nearest_fingers(choice, labelled, expected):
    note = Note(onset=0.0, offset=0.1, pitch=60, finger=3 if labelled else -1)
    env = PianoEnv(Score(notes=[note]), fingering_reward=choice)
    env.reset(seed=0)
    term = env.reward_terms(0)["fingering"]
    distances = np.linalg.norm(
        env.scene.press_point(env.data, np.array([C4])) - env.scene.fingertip_position(env.data),
        axis=1,
    )
    distance = {"labels": distances[3], "optimal-transport": distances.min(), "zero": np.inf}
    assert term == pytest.approx(0.1 ** (((distance[expected] - 0.01) / 0.1) ** 2))


@pytest.mark.parametrize("enabled", [True, False])
def test_crossed_forearms_lose_the_forearm_reward(enabled):
    env = PianoEnv(TINY, forearm_reward=enabled)
    env.reset(seed=0)
    assert env.reward_terms(0)["forearm"] == float(enabled)
    env.data.qpos[env.scene.slider_qpos] = [-0.15, 0.15]
    mujoco.mj_step1(env.model, env.data)
    assert env.reward_terms(0)["forearm"] == 0.0


# Options, scores and randomness.


@pytest.mark.parametrize(
    ("hands", "reduced", "actions", "joints", "size"),
    [
        ("both", True, 39, 46, 1124),
        ("both", False, 45, 52, 1130),
        ("right", True, 20, 23, 1096),
        ("left", False, 23, 26, 1099),
    ],
)
def test_the_spaces_have_robopianists_sizes(hands, reduced, actions, joints, size):
    env = PianoEnv(TINY, reduced_action_space=reduced, hands_in_scene=hands)
    assert env.action_space.shape == (actions,)
    assert env.model.nq == 88 + joints
    assert env.reset(seed=0)[0].shape == (size,)


def test_leading_silence_is_trimmed_unless_asked_for():
    late = Score(notes=[Note(onset=1.0, offset=1.1, pitch=60)])
    assert len(PianoEnv(late).roll) == 3
    assert len(PianoEnv(late, trim_silence=False).roll) == 23
    assert len(PianoEnv(late, initial_buffer_time=0.5).roll) == 13


def test_hands_start_in_random_places_drawn_from_the_seed():
    env = PianoEnv(TINY, randomize_hand_positions=True)
    starts = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        starts.append(env.data.qpos[env.scene.slider_qpos].copy())
    assert starts[0][0] == starts[0][1]  # both hands move together
    assert 0 < abs(starts[0][0]) <= 0.05
    np.testing.assert_array_equal(starts[0], starts[2])
    assert starts[0][0] != starts[1][0]


# State.


@pytest.mark.slow
@pytest.mark.parametrize("few_keys", [False, True])
@pytest.mark.parametrize(
    "options",
    [
        {"physics": "fast"},
        {"reduced_action_space": False, "n_steps_lookahead": 3},
        {"hands_in_scene": "right"},
        {"hands_in_scene": "left"},
    ],
    ids=str,
)
def test_a_restored_state_deep_in_an_episode_repeats_every_step_bitwise(options, few_keys):
    env, other = (PianoEnv("CMajorScaleTwoHands", **options) for _ in range(2))
    for each in (env, other) if few_keys else ():
        each.fix_keys(30, 60)
    env.reset(seed=0)
    actions = random_actions(env, 151)
    play(env, actions[:120])
    state = env.get_state()
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = play(env, actions[120:])
    final, returns = env.performance.metrics(), env.get_state().returns
    env.reset(options={"score": TINY})
    for one in (env, other):
        observation = one.set_state(pickle.loads(pickle.dumps(state)))
        assert one.steps_played == 120
        np.testing.assert_array_equal(observation, one.set_state(state))
    for one in (env, other, *twins):
        np.testing.assert_array_equal(play(one, actions[120:]), expected)
        assert one.performance.metrics() == final
        np.testing.assert_array_equal(one.get_state().returns, returns)
    if few_keys:
        with pytest.raises(EnvStateError, match="same options"):
            PianoEnv("CMajorScaleTwoHands", **options).set_state(state)


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copied_environment_goes_on_by_itself_with_its_options(clone):
    env = PianoEnv(TINY, n_steps_lookahead=1, reward_weights={"energy": 0.1})
    env.reset(seed=0)
    actions = random_actions(env, 6)
    play(env, actions[:2])
    twin = clone(env)
    expected = play(env, actions[2:])
    np.testing.assert_array_equal(play(twin, actions[2:]), expected)
    assert twin.config == env.config
    assert twin.model is twin.scene.model is not env.model


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"control_timestep": 0.1}, "control_timestep 0.05, but here is .*control_timestep 0.1:"),
        ({"reduced_action_space": False}, "physics numbers.*same options"),
        ({"physics": "fast"}, "saved with physics 'reference'.*here is physics 'fast'"),
    ],
)
def test_a_state_of_another_environment_is_refused(env, options, message):
    play(env, random_actions(env, 5))
    with pytest.raises(EnvStateError, match=message):
        PianoEnv(TINY, **options).set_state(env.get_state())


# Bad input.


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(EnvState)])
def test_a_state_with_a_field_of_another_kind_is_refused_and_changes_nothing(env, field):
    play(env, random_actions(env, 5))
    state = env.get_state()
    before = pickle.dumps(state)
    late = {9: np.zeros((1, 88), dtype=bool)}
    for other in (None, b"x", 3, np.zeros(3), np.zeros((5, 88)), {0: None}, late):
        with pytest.raises(EnvStateError, match="expected"):
            env.set_state(dataclasses.replace(state, **{field: other}))
    assert pickle.dumps(env.get_state()) == before


def test_what_is_no_state_is_refused(env):
    for restore in (env.set_state, env.go_back):
        with pytest.raises(EnvStateError, match=r"A dict is no .*: expected what"):
            restore({})


def test_a_refused_reset_ends_the_episode(env):
    with pytest.raises(ConfigError, match="Unknown reset option"):
        env.reset(options={"piece": TINY})
    with pytest.raises(EnvStateError, match="call reset"):
        env.step(env.rest_action)
    env.reset()
    env.step(env.rest_action)


def test_stepping_before_the_first_reset_and_after_the_end_is_refused(env):
    for _ in range(6):
        env.step(env.rest_action)
    assert env.performance.to_score() is None  # nothing was pressed
    for idle in (PianoEnv(TINY), env):
        with pytest.raises(EnvStateError, match="call reset"):
            idle.step(env.rest_action)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(38), r"shape \(38,\): expected \(39,\)"),
        (np.zeros((1, 39)), r"shape \(1, 39\): expected \(39,\)"),
        (np.append(np.zeros(38), np.nan), "Element 38 of the action is nan"),
        (np.append(np.inf, np.zeros(38)), "Element 0 of the action is inf"),
        ("press", "not an array of numbers"),
        (np.zeros(39, dtype=complex), "not an array of numbers: they are complex"),
        ([1j] * 39, "not an array of numbers: they are complex"),
        (["0.5"] * 39, "they are texts or dates"),
        (np.array(["0.5"] * 39, dtype=object), "they are texts or dates"),
        (np.zeros(39, dtype="M8[s]"), "they are texts or dates"),
        (np.ma.masked_array(np.zeros(39), mask=[1] + 38 * [0]), "some are masked"),
        (torch.zeros(39, requires_grad=True), r"requires grad\. Use tensor\.detach"),
        ([10**400] * 39, "int too large to convert"),
    ],
)
def test_a_bad_action_is_refused_and_changes_nothing(env, action, message):
    before = pickle.dumps(env.get_state())
    with pytest.raises(InvalidActionError, match=message):
        env.step(action)
    assert pickle.dumps(env.get_state()) == before


def test_actions_outside_the_bounds_are_clipped(env):
    state = env.get_state()
    inside = play(env, [np.ones(39)])
    for beyond in (7.0, 1e300):
        env.set_state(state)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            np.testing.assert_array_equal(play(env, [np.full(39, beyond)]), inside)


def test_an_unstable_simulation_is_reported_not_hidden(env):
    env.step(env.rest_action)
    env.data.qfrc_applied[:] = 1e13
    with pytest.raises(SimulationDivergedError, match="control step 1"):
        env.step(env.rest_action)
    env.reset()
    env.step(env.rest_action)


@pytest.mark.parametrize(
    ("options", "highest"),
    [
        ({}, 6.5 * 1 + 8 + 5 + 4),  # eight steps: five with a key due, all of them labelled
        ({"fingering_reward": "off"}, 6.5 + 8 + 4),
        ({"fingering_reward": "optimal-transport"}, 6.5 + 8 + 8 + 4),
        ({"forearm_reward": False}, 6.5 + 8 + 5),
        ({"reward_weights": {"fingering": 2.0, "sustain": 0.0}}, 6.5 + 10 + 4),
    ],
)
def test_the_return_is_told_as_a_share_of_the_highest_one(options, highest):
    """Pressing earns 1 in five steps and 0.5 in three; pedal 1, forearms 0.5 in eight."""
    notes = [Note(onset=0.0, offset=0.25, pitch=60, finger=0)]
    env = PianoEnv(Score(notes=notes, title="short"), initial_buffer_time=0.1, **options)
    env.reset(seed=0)
    for _ in range(8):
        *_, info = env.step(env.rest_action)
    returns = sum(info[name] for name in RETURN_KEYS)
    assert info["normalized_return"] == pytest.approx(returns / highest)
    assert env.performance.title == "short"


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(ConfigError, match=r"render_mode is 'ansi': expected None or one of"):
        PianoEnv(TINY, render_mode="ansi")
