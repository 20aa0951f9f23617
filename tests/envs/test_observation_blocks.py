"""Blocks of one's own in the observation: described, computed, kept by runs, or refused."""

import copy
import dataclasses
import itertools
import pickle

import numpy as np
import pytest
from episodes import assert_checks_pass, at_random, steps_of
from short_scores import score_of

from sb3_piano.batch import PianoVectorEnv
from sb3_piano.envs import Block, PianoEnv
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.imports import known_packages_only
from sb3_piano.music import Score
from sb3_piano.policies import HandsSACPolicy
from sb3_piano.training import EnvSpec
from sb3_piano.wrappers import HandActions, HindsightFlag, KeyRange, Lookahead, PreviousActionReward

PIECE = score_of((0.0, 0.1, 60, 0), (0.2, 0.4, 64, 1), (0.1, 0.3, 48, 5), title="three notes")
ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"


class Due(Block):
    """How many keys are due, from the piece alone."""

    name = "due"
    meaning = "how many keys are due now"
    high = 88.0

    def prepare(self, roll):
        return roll.active.sum(axis=1, keepdims=True)


class Sliders(Block):
    """Where the hands are along the keyboard, from the simulation, and when, from the piece."""

    name = "sliders"
    unit = "m, s"
    meaning = "the sliders along the keyboard; time since the piece began"

    def __init__(self, scene, config):
        self._qpos, self._timestep = scene.slider_qpos, config.control_timestep
        self.shape = (2, len(scene.sides))
        self.low, self.high = -2.0, [[2.0], [60.0]]

    def prepare(self, roll):
        time = np.arange(len(roll)) * self._timestep
        return np.tile(time[:, None, None], (1, *self.shape))

    def write(self, out, now):
        out[0] = now.simulation.qpos[self._qpos]


class Picky(Due):
    """A block that does not show every piece."""

    def prepare(self, roll):
        if roll.active[:, 0].any():
            raise ScoreError("A0 is too low.")
        return super().prepare(roll)


def own(cls=Due, **changes):
    """Return a subclass that differs in some attributes."""
    return type(cls.__name__, (cls,), changes)


BLOCKS = [f"{__name__}.Due", Sliders]


@pytest.mark.parametrize("observation", ["roll", "window", "fingers", "hands"])
def test_added_blocks_stand_at_the_end_of_any_observation_and_pass_both_checkers(observation):
    options = {"observation": observation, "fingering": "robot", "physics": "fast"}
    bare, env = PianoEnv(PIECE, **options), PianoEnv(PIECE, observation_blocks=BLOCKS, **options)
    assert_checks_pass(env)
    layout = env.observation_layout
    assert list(layout) == [*bare.observation_layout, "due", "sliders"]
    assert (layout["sliders"].unit, layout["sliders"].shape) == ("m, s", (2, 2))
    one_hand = PianoEnv(PIECE, hands_in_scene="left", observation_blocks=[Sliders])
    assert one_hand.observation_layout["sliders"].shape == (2, 1)
    size = bare.observation_layout.size
    for step, (ours, theirs) in enumerate(
        zip(steps_of(env, at_random(env)), steps_of(bare, at_random(bare)), strict=True), start=1
    ):
        np.testing.assert_array_equal(ours[0][:size], theirs[0])
        at = min(step, len(env.roll) - 1)
        assert ours[0][layout["due"].slice] == env.roll.active[at].sum()
        sliders = [*env.data.qpos[env.scene.slider_qpos], *[0.05 * at] * 2]
        np.testing.assert_allclose(ours[0][layout["sliders"].slice], sliders, rtol=1e-6)
        assert ours[1:3] == theirs[1:3]


def test_states_copies_and_other_keys_are_observed_alike():
    env = PianoEnv(PIECE, observation="fingers", observation_blocks=BLOCKS, physics="fast")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    state, action = env.get_state(), env.action_space.sample()
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    after = env.step(action)[0]
    for other in others:
        np.testing.assert_array_equal(other.step(action)[0], after)
    env.set_state(state)
    np.testing.assert_array_equal(env.step(action)[0], after)
    env.fix_keys(20, 60)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


def test_observations_are_not_written_again():
    env = PianoEnv(PIECE, observation_blocks=[Sliders])
    first, _ = env.reset(seed=0)
    before = first.copy()
    env.step(env.action_space.sample())
    np.testing.assert_array_equal(first, before)


def test_a_vector_has_them_for_each_of_its_pieces():
    envs = PianoVectorEnv(2, [PIECE, PIECE.transpose(2)], observation_blocks=BLOCKS)
    observations, _ = envs.reset(seed=0)
    single = PianoEnv(PIECE, observation_blocks=BLOCKS).reset(seed=0)[0]
    np.testing.assert_array_equal(observations[0], single)
    envs.close()


def test_wrappers_that_cut_or_extend_the_observation_keep_the_block():
    def around(env):
        for wrapper in (PreviousActionReward, HindsightFlag):
            env = wrapper(env)
        return KeyRange(Lookahead(env, 3, fingers=True), 36)

    env = around(PianoEnv(PIECE, observation_blocks=BLOCKS))
    layout = env.observation_space.layout
    for observation, *_ in itertools.islice(steps_of(env, at_random(env)), 4):
        step = env.unwrapped.steps_played
        assert observation[layout["due"].slice] == env.unwrapped.roll.active[step].sum()
        sliders = env.unwrapped.data.qpos[env.unwrapped.scene.slider_qpos]
        shown = observation[layout["sliders"].slice].reshape(2, 2)[0]
        np.testing.assert_allclose(shown, sliders, rtol=1e-6)


def test_runs_keep_them_by_their_import_paths():
    spec = EnvSpec(id=ID, options={"observation_blocks": [Due, f"{__name__}.Sliders"]})
    saved = spec.to_mapping()["options"]
    assert saved == {"observation_blocks": [f"{__name__}.Due", f"{__name__}.Sliders"]}
    layout = EnvSpec(id=ID, options=saved).make().unwrapped.observation_layout
    assert list(layout)[-2:] == ["due", "sliders"]


def test_an_exported_run_imports_no_block_of_others():
    options = {"observation_blocks": ["somebody.elses.Block"]}
    with known_packages_only(), pytest.raises(ConfigError, match="refused, as settings of an exp"):
        EnvSpec(id=ID, options=options)


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ("my.Block", "observation_blocks is 'my.Block': expected a list"),
        (["nowhere.Due"], "'nowhere.Due' cannot be imported: No module named 'nowhere'"),
        ([f"{__name__}.Duo"], "has no 'Duo'. Did you mean 'Due'"),
        ([f"{__name__}.score_of"], "score_of' is no subclass of Block"),
        ([score_of], "observation_blocks has <function score_of.*expected subclasses of"),
        ([Due, Due], "Two blocks of the observation are called 'due'"),
        ([own(name="goal")], "Two blocks of the observation are called 'goal'"),
        ([own(Block)], "block Block does not say what it is.*'name'.*a name, a meaning"),
        ([own(low=[0.0, 1.0])], "block Due does not say what it is.*bounds that fit"),
        ([own(shape=(2,))], r"'due' prepares .* shape \(\d+, 1\), finite: expected .*\(2,\)"),
        ([own(prepare=lambda self, roll: "many")], "'due' prepares no numbers"),
        (
            [own(prepare=lambda self, roll: roll.active[:, :1] * np.nan)],
            ", not all finite: ",
        ),
    ],
)
def test_what_is_no_block_is_refused_when_the_environment_is_made(blocks, message):
    with pytest.raises(ConfigError, match=message):
        PianoEnv(PIECE, observation_blocks=blocks)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda self, out, now: out.fill(np.inf), r"'due' writes \[inf\] in control step 0"),
        (lambda self, out, now: out.__setitem__(slice(None), [1, 2]), "'due' cannot write .*shape"),
    ],
)
def test_what_is_written_must_be_finite_and_fit(write, message):
    env = PianoEnv(PIECE, observation_blocks=[own(write=write)])
    with pytest.raises(ConfigError, match=message):
        env.reset()


@pytest.mark.parametrize("observation", ["roll", "hands"])
def test_a_piece_that_a_block_refuses_leaves_the_former_one(observation):
    env = PianoEnv(
        PIECE, observation=observation, fingering="robot", observation_blocks=[Sliders, Picky]
    )
    before, _ = env.reset(seed=0)
    with pytest.raises(ScoreError, match="A0 is too low"):
        env.reset(options={"score": score_of((0.0, 0.3, 21, 5))})
    np.testing.assert_array_equal(env.reset(seed=0)[0], before)


def test_worlds_of_a_batch_refuse_them():
    torch_batch = pytest.importorskip("sb3_piano.batch")
    with pytest.raises(
        ConfigError, match="Due of observation_blocks sees one environment and cannot be batched"
    ):
        torch_batch.BatchedPiano(2, PIECE, observation_blocks=[Due])


def test_policies_of_hands_refuse_an_observation_that_is_not_all_of_hands():
    options = {"observation": "hands", "fingering": "robot", "reduced_action_space": False}
    env = HandActions(PianoEnv(PIECE, observation_blocks=[Sliders], **options))
    with pytest.raises(ConfigError, match="n_hands is 2, the observation has the blocks right_.*s"):
        HandsSACPolicy(env.observation_space, env.action_space, lambda _: 1e-4)
    HandsSACPolicy(env.observation_space, env.action_space, lambda _: 1e-4, n_hands=1)


def test_the_loudness_of_each_keys_next_strike_is_shown():
    soft, loud = (dataclasses.replace(PIECE.notes[0], velocity=v, **at) for v, at in TWICE)
    env = PianoEnv(
        Score(notes=[soft, loud], title="twice"),
        observation_blocks=["sb3_piano.envs.loudness.Loudness"],
        fingering="robot",
    )
    shown = env.reset()[0][env.observation_layout["loudness"].slice]
    key, steps = soft.key, []
    for _ in range(len(env.roll) - 1):
        steps.append(shown[key] * 127)
        shown = env.step(env.rest_action)[0][env.observation_layout["loudness"].slice]
    first, second = np.flatnonzero(env.roll.onset[:, key])
    assert steps[: first + 1] == pytest.approx([40] * (first + 1))
    assert steps[first + 1 : second + 1] == pytest.approx([100] * (second - first))
    assert not any(steps[second + 1 :])
    assert np.count_nonzero(shown) == 0


TWICE = ((40, {"onset": 0.0, "offset": 0.1}), (100, {"onset": 0.2, "offset": 0.4}))
