"""What holds for every id that the package registers."""

from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from sb3_piano.envs import (
    DEBUG_IDS,
    ENV_IDS,
    GENERAL_ID,
    PIECE_IDS,
    PIG_IDS,
    SELF_ACTUATED_ID,
    register_envs,
)
from sb3_piano.exceptions import ConfigError, EnvStateError, UnknownPieceError
from sb3_piano.music import BUILT_IN, Note, Pedal, Score, load_score
from sb3_piano.music.built_in import ENCORE
from sb3_piano.music.library import Library
from sb3_piano.music.library.datasets import PIG_PIECES

# Pieces of every kind, short enough to be played to their ends.
SAMPLE = (
    GENERAL_ID,
    SELF_ACTUATED_ID,
    *DEBUG_IDS,
    "RoboPianist-scale-EbMajor-v0",
    "RoboPianist-repertoire-PathetiqueRondo-v0",
)

# Prints a hash of everything that a seeded episode of random actions hands out.
EPISODE_HASH = """
import hashlib, sys
import gymnasium, numpy as np
env = gymnasium.make("sb3_piano:" + sys.argv[1], randomize_hand_positions=True)
env.action_space.seed(3)
digest = hashlib.sha256(env.reset(seed=3)[0].tobytes())
for _ in range(40):
    observation, reward, *_ = env.step(env.action_space.sample())
    digest.update(observation.tobytes() + np.float64(reward).tobytes())
print(digest.hexdigest())
"""


def test_the_names_that_are_registered_are_those_of_the_pieces():
    """They stand in ``sb3_piano/piece_names.json``, which has to name each."""
    assert list(PIECE_IDS.values()) == list(BUILT_IN)
    assert list(PIG_IDS.values()) == list(PIG_PIECES)
    kwargs = {name: gym.spec(f"RoboPianist-{name}-v0").kwargs for name in BUILT_IN}
    labelled = {name for name in BUILT_IN if "fingering" not in kwargs[name]}
    assert labelled == BUILT_IN.keys() - ENCORE.keys()


def test_the_ids_are_in_gymnasiums_registry_under_robopianists_names():
    ours = {name for name in gym.registry if name.startswith("RoboPianist")}
    assert ours == {*ENV_IDS, *PIG_IDS}
    assert len(ENV_IDS) == 2 + 6 + 37 + 24 + 20 + 12 + 15
    assert {name for name in ours if "debug" in name} == {
        f"RoboPianist-debug-{piece}-v0"
        for piece in (
            "CMajorScaleOneHand",
            "CMajorScaleTwoHands",
            "DMajorScaleOneHand",
            "DMajorScaleTwoHands",
            "CMajorChordProgressionTwoHands",
            "TwinkleTwinkleLittleStar",
        )
    }


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_every_id_makes_resets_and_steps(env_id):
    env = gym.make(env_id)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    assert not terminated
    assert not truncated
    assert env.unwrapped.score.has_fingering


def test_an_id_of_the_pig_data_set_says_how_to_get_the_data(tmp_path, monkeypatch):
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path))
    assert len([name for name in PIG_IDS if "etude-12" in name]) == 12
    for env_id in PIG_IDS:
        with pytest.raises(UnknownPieceError, match="register at https://.*pieces import PianoF"):
            gym.make(env_id)


def test_an_imported_piece_of_the_benchmark_gets_its_id_though_nobody_knew_its_name(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path))
    env_id = "RoboPianist-repertoire-150-Unheard-v0"
    score = load_score("CMajorScaleOneHand")
    Library().add(score, "repertoire-150-Unheard", source="a test", fingering="ours")
    register_envs()
    try:
        assert gym.make(env_id).unwrapped.default_score.notes == score.notes
    finally:
        del gym.registry[env_id]


@pytest.mark.slow
@pytest.mark.parametrize("env_id", SAMPLE)
def test_a_random_episode_stays_in_the_observation_space_and_ends_with_the_score(env_id):
    env = gym.make(env_id)
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated:
        assert env.observation_space.contains(observation)
        observation, _, terminated, truncated, info = env.step(env.action_space.sample())
        assert not terminated
        steps += 1
    assert steps == len(env.unwrapped.roll)
    assert 0 <= info["f1"] <= 1


@pytest.mark.slow
def test_the_same_seed_gives_bitwise_the_same_episode_in_two_processes():
    def episode_hash() -> str:
        command = [sys.executable, "-c", EPISODE_HASH, "RoboPianist-debug-CMajorScaleTwoHands-v0"]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    first = episode_hash()
    assert len(first.strip()) == 64
    assert episode_hash() == first


def test_an_environment_of_a_score_is_made_again_from_the_json_of_its_spec():
    notes = [Note(onset=0.1, offset=1 / 3, pitch=60, finger=1)]
    score = Score(notes=notes, pedals=[Pedal(onset=0, offset=0.2)], title="one", bars=[0, 0.2])
    spec = EnvSpec.from_json(gym.make(GENERAL_ID, score=score).spec.to_json())
    again = gym.make(spec).unwrapped.default_score
    assert (again, again.bars) == (score, score.bars)


def test_an_episode_can_begin_after_the_first_reset_was_refused():
    """Gymnasium's checker, which is off, would raise a TypeError in step."""
    env = gym.make("RoboPianist-scale-CMajor-v0", physics="fast")
    with pytest.raises(ConfigError, match="Unknown reset option 'piece'"):
        env.reset(options={"piece": "scale-CMajor"})
    with pytest.raises(EnvStateError, match="call reset"):
        env.unwrapped.step(env.action_space.sample())
    env.reset(seed=0)
    assert not env.step(env.action_space.sample())[2]
