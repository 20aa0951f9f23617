"""Gymnasium wrappers for the piano: what is played, what is observed, what is rewarded."""

from sb3_piano.wrappers.excerpt import Excerpt
from sb3_piano.wrappers.fingering_decay import FingeringDecay
from sb3_piano.wrappers.hide_fingering import HideFingering
from sb3_piano.wrappers.key_range import KeyRange
from sb3_piano.wrappers.key_reward_tiering import KeyRewardTiering
from sb3_piano.wrappers.layout_wrapper import LayoutWrapper
from sb3_piano.wrappers.lookahead import Lookahead
from sb3_piano.wrappers.octave_shift import OctaveShift
from sb3_piano.wrappers.pitch_shift import PitchShift
from sb3_piano.wrappers.previous_action_reward import PreviousActionReward
from sb3_piano.wrappers.random_piece import RandomPiece
from sb3_piano.wrappers.residual_action import ResidualAction
from sb3_piano.wrappers.reward_tiering import RewardTiering
from sb3_piano.wrappers.reward_weights import RewardWeights
from sb3_piano.wrappers.reward_wrapper import RewardTermsWrapper
from sb3_piano.wrappers.score_wrapper import ScoreWrapper
from sb3_piano.wrappers.temporal_stretch import TemporalStretch

__all__ = [
    "Excerpt",
    "FingeringDecay",
    "HideFingering",
    "KeyRange",
    "KeyRewardTiering",
    "LayoutWrapper",
    "Lookahead",
    "OctaveShift",
    "PitchShift",
    "PreviousActionReward",
    "RandomPiece",
    "ResidualAction",
    "RewardTermsWrapper",
    "RewardTiering",
    "RewardWeights",
    "ScoreWrapper",
    "TemporalStretch",
]
