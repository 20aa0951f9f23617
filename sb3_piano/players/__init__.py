"""Players of any piece, with SB3's ``predict``: planned, sampling, or learned.

:func:`make_player` makes one by its name. The learned player, :class:`SightReader`, is a small
network of one hand (:class:`HandModel`) that never trained on the piece. :class:`PlayerResidual`
adds an agent's corrections to it or to the plan. :class:`TreeSearch` improves a trained model or a
player by lookahead.
"""

from typing import TYPE_CHECKING, Any

from sb3_piano.players.hand_model import HandModel
from sb3_piano.players.making import PLAYERS, make_player
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.players.recorder import EpisodeRecorder
from sb3_piano.players.residual import PlayerResidual
from sb3_piano.players.rollout import Player, Transition, rollout
from sb3_piano.players.sampling import PredictiveSampling
from sb3_piano.players.sight_reader import SightReader
from sb3_piano.players.spec import PlayerSpec
from sb3_piano.players.tree import TreeSettings

if TYPE_CHECKING:
    from sb3_piano.players.tree_search import TreeSearch

__all__ = [
    "PLAYERS",
    "EpisodeRecorder",
    "HandModel",
    "PianoPolicy",
    "PlannedPianist",
    "Player",
    "PlayerResidual",
    "PlayerSpec",
    "PredictiveSampling",
    "SightReader",
    "Transition",
    "TreeSearch",
    "TreeSettings",
    "make_player",
    "rollout",
]


def __getattr__(name: str) -> Any:
    """Import ``TreeSearch`` on first access: it needs torch, whose import takes two seconds."""
    if name != "TreeSearch":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from sb3_piano.players.tree_search import TreeSearch

    return TreeSearch
