"""Wrapper that observes a part of the keyboard."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le

from sb3_piano.envs.observation import restrict_to
from sb3_piano.exceptions import ConfigError
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.key_window import ALL_KEYS, KeyWindow
from sb3_piano.settings import Index, Whole, checked
from sb3_piano.wrappers.piano import LayoutWrapper, layout_of, unwrap_piano
from sb3_piano.wrappers.score_wrapper import possible_scores

_WINDOWS = {
    12: KeyWindow(60 - MIN_PITCH, 71 - MIN_PITCH),  # C4 to B4
    24: KeyWindow(48 - MIN_PITCH, 71 - MIN_PITCH),  # C3 to B4
    36: KeyWindow(48 - MIN_PITCH, 83 - MIN_PITCH),  # C3 to B5
    88: ALL_KEYS,
}
_PITCH = Annotated[Whole, Ge(MIN_PITCH), Le(MAX_PITCH)]


class KeyRange(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Observe goal and state of a range of keys only.

    The blocks ``goal`` and ``key_state`` get narrower; everything else, the reward included, stays
    the same. It may be outside or inside another wrapper that changes the layout.

    An outer score wrapper may bring a piece beyond the range, an error at ``reset``; an inner one
    is checked when this wrapper is made.

    Source: "utilizing the keys in the 3 central octaves" (the report on SAC and TD3 with pitch
    shifts and key reduction). It does not name the keys; 36 are taken to be C3 to B5. RoboPianist's
    scales for two hands span 37 (C3 to C6, D3 to D6): with 36 keys they need ``outside="hide"``.

    Args:
        env: A piano environment, wrapped or not, that observes keys (not ``"fingers"``).
        keys: 36 for C3 to B5, 24 for C3 to B4, 12 for C4 to B4, 88 for all; "piece" for the range
            of everything that ``env`` may play by itself, and a margin; or the lowest and the
            highest MIDI pitch, from 21 to 108.
        margin: How many more keys "piece" shows on either side, 0 or more.
        outside: "error": a piece that leaves the range is refused. "hide": its notes beyond the
            range are not observed, while the reward still asks for them.
        simulated: Whether the keys beyond the range are rigid in the simulation, too, which makes
            it faster: see :meth:`~sb3_piano.envs.PianoEnv.fix_keys`. Not with "hide", which needs
            them.

    Raises:
        ConfigError: If an argument has the wrong type or is out of range, ``env`` is no piano or
            does not observe all keys of the range.
        ScoreError: If a piece leaves the range, here for what ``env`` may play by itself, at
            ``reset`` for what is played. The message names the notes.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        keys: int | str | Sequence[int] = 36,
        *,
        margin: int = 3,
        outside: str = "error",
        simulated: bool = False,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, keys=keys, margin=margin, outside=outside, simulated=simulated
        )
        _check_outside(outside, simulated)
        layout = layout_of(env, "KeyRange", "goal", "key_state")
        self._piano = unwrap_piano(env, "KeyRange")
        possible = {note.key for score in possible_scores(env) for note in score.notes}
        self._hides = outside == "hide"
        self.window = _window(keys, checked("margin", margin, Index), possible)
        """The keys that are observed."""
        self._check(possible)
        cut, self._columns = restrict_to(self.window, layout)
        super().__init__(env, cut)
        if simulated:
            self._piano.fix_keys(self.window.first, self.window.last)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Raises:
            ScoreError: If its piece leaves the range, which is not to be hidden.
        """
        observation, info = super().reset(seed=seed, options=options)
        self._check(self._piano.roll.used_keys)
        return observation, info

    def observation(self, observation: Any) -> npt.NDArray[np.float32]:
        """Return the part of the observation for these keys."""
        remaining: npt.NDArray[np.float32] = observation.take(self._columns)
        return remaining

    def _check(self, keys: Iterable[int]) -> None:
        if not self._hides:
            self.window.check_keys(keys, 'another range, or outside="hide"')


def _check_outside(outside: Any, simulated: Any) -> None:
    checked("outside", outside, Literal["error", "hide"])
    if checked("simulated", simulated, bool) and outside == "hide":
        raise ConfigError(
            'outside is "hide" and simulated is true: expected one of them only. Notes that are '
            "hidden are still to be played, on keys that must move."
        )


def _window(keys: Any, margin: int, possible: set[int]) -> KeyWindow:
    if keys == "piece":
        return KeyWindow.around(possible, margin)
    try:
        if isinstance(keys, Sequence):
            low, high = (checked("keys", key, _PITCH) - MIN_PITCH for key in keys)
            return KeyWindow(low, checked("keys", high, Annotated[int, Ge(low)]))
        return _WINDOWS[checked("keys", keys, Whole)]
    except (ValueError, KeyError):
        raise ConfigError(
            f'keys is {keys!r}: expected 12, 24, 36, 88, "piece", or the lowest and the highest '
            f"MIDI pitch from {MIN_PITCH} to {MAX_PITCH}."
        ) from None
