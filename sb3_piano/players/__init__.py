"""What plays any piece at once, behind SB3's ``predict``: planned, sampling, or learned.

:func:`make_player` makes one by its name. The learned one, :class:`SightReader`, is a small network
of one hand (:class:`HandModel`) that never trained on the piece; with :class:`SightReaderResidual`
an agent corrects it.
"""

from sb3_piano.players.hand_model import HandFacts, HandModel
from sb3_piano.players.making import PLAYERS, make_player, player_class
from sb3_piano.players.residual import SightReaderResidual
from sb3_piano.players.sight_reader import SightReader

__all__ = [
    "PLAYERS",
    "HandFacts",
    "HandModel",
    "SightReader",
    "SightReaderResidual",
    "make_player",
    "player_class",
]
