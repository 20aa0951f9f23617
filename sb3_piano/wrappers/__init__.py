"""Gymnasium wrappers that change the score, the observation, the action or the reward."""

from sb3_piano.wrappers.excerpt import Excerpt
from sb3_piano.wrappers.hand_actions import HandActions
from sb3_piano.wrappers.hand_reward import HandReward
from sb3_piano.wrappers.hide_fingering import HideFingering
from sb3_piano.wrappers.hindsight_flag import HindsightFlag
from sb3_piano.wrappers.key_range import KeyRange
from sb3_piano.wrappers.lookahead import Lookahead
from sb3_piano.wrappers.piano import LayoutWrapper
from sb3_piano.wrappers.pixels import Pixels
from sb3_piano.wrappers.previous_action_reward import PreviousActionReward
from sb3_piano.wrappers.random_piece import RandomPiece
from sb3_piano.wrappers.randomization import DomainRandomization
from sb3_piano.wrappers.rewards import (
    FingeringDecay,
    KeyRewardTiering,
    RewardTermsWrapper,
    RewardTiering,
    RewardWeights,
)
from sb3_piano.wrappers.score_wrapper import ScoreWrapper
from sb3_piano.wrappers.transforms import OctaveShift, PitchShift, TemporalStretch

__all__ = [
    "DomainRandomization",
    "Excerpt",
    "FingeringDecay",
    "HandActions",
    "HandReward",
    "HideFingering",
    "HindsightFlag",
    "KeyRange",
    "KeyRewardTiering",
    "LayoutWrapper",
    "Lookahead",
    "OctaveShift",
    "PitchShift",
    "Pixels",
    "PreviousActionReward",
    "RandomPiece",
    "RewardTermsWrapper",
    "RewardTiering",
    "RewardWeights",
    "ScoreWrapper",
    "TemporalStretch",
]
