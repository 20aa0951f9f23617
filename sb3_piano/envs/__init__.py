"""The piano environment, and its registration with gymnasium."""

from sb3_piano.envs.blocks import Block
from sb3_piano.envs.blocks import Now as Now
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.observation import ObservationBlock as ObservationBlock
from sb3_piano.envs.observation import ObservationLayout as ObservationLayout
from sb3_piano.envs.observation import ObservationSpace
from sb3_piano.envs.piano_env import PianoEnv
from sb3_piano.envs.record import EnvState as EnvState
from sb3_piano.envs.record import Snapshot as Snapshot
from sb3_piano.envs.score_choice import ScoreTransform as ScoreTransform
from sb3_piano.envs.terms import DEFAULT_REWARD_WEIGHTS, StepView, Term
from sb3_piano.envs.terms import RETURN_KEYS as RETURN_KEYS
from sb3_piano.envs.terms import SELF_ACTUATED_REWARD_WEIGHTS as SELF_ACTUATED_REWARD_WEIGHTS
from sb3_piano.music.key_window import ALL_KEYS as ALL_KEYS
from sb3_piano.music.key_window import KeyWindow as KeyWindow
from sb3_piano.performance import Performance
from sb3_piano.registration import DEBUG_IDS as DEBUG_IDS
from sb3_piano.registration import ENV_IDS, GENERAL_ID, SELF_ACTUATED_ID
from sb3_piano.registration import PIECE_IDS as PIECE_IDS
from sb3_piano.registration import PIG_IDS as PIG_IDS
from sb3_piano.registration import register_envs as register_envs

__all__ = [
    "DEFAULT_REWARD_WEIGHTS",
    "ENV_IDS",
    "GENERAL_ID",
    "SELF_ACTUATED_ID",
    "Block",
    "ObservationSpace",
    "Performance",
    "PianoEnv",
    "PianoEnvConfig",
    "StepView",
    "Term",
]
