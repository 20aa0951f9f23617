"""The piano environment, alone or as a vector, and its registration with gymnasium."""

from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.observation import (
    ALL_KEYS,
    KeyWindow,
    ObservationBlock,
    ObservationLayout,
    ObservationSpace,
)
from sb3_piano.envs.piano_env import PianoEnv
from sb3_piano.envs.record import EnvState, Snapshot
from sb3_piano.envs.recorder import EpisodeRecorder, Motion, Recording
from sb3_piano.envs.rewards import (
    DEFAULT_REWARD_WEIGHTS,
    RETURN_KEYS,
    SELF_ACTUATED_REWARD_WEIGHTS,
)
from sb3_piano.envs.score_choice import ScoreTransform
from sb3_piano.envs.vector_env import PianoVectorEnv
from sb3_piano.performance import Performance
from sb3_piano.registration import (
    DEBUG_IDS,
    ENV_IDS,
    GENERAL_ID,
    PIECE_IDS,
    PIG_IDS,
    SELF_ACTUATED_ID,
    register_envs,
)

__all__ = [
    "ALL_KEYS",
    "DEBUG_IDS",
    "DEFAULT_REWARD_WEIGHTS",
    "ENV_IDS",
    "GENERAL_ID",
    "PIECE_IDS",
    "PIG_IDS",
    "RETURN_KEYS",
    "SELF_ACTUATED_ID",
    "SELF_ACTUATED_REWARD_WEIGHTS",
    "EnvState",
    "EpisodeRecorder",
    "KeyWindow",
    "Motion",
    "ObservationBlock",
    "ObservationLayout",
    "ObservationSpace",
    "Performance",
    "PianoEnv",
    "PianoEnvConfig",
    "PianoVectorEnv",
    "Recording",
    "ScoreTransform",
    "Snapshot",
    "register_envs",
]
