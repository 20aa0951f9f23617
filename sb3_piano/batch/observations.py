"""Observations of many worlds, by the tables and formulas of the encodings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import torch

from sb3_piano.batch.tables import Pieces
from sb3_piano.batch.task import Heard
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.envs.blocks import Encoding
from sb3_piano.envs.encodings import DM_PER_M, MOST_WRONG_KEYS, FingerEncoding, RollEncoding
from sb3_piano.envs.hand_encoding import FASTEST, FRAMES_AHEAD, PRESSES_AHEAD, HandEncoding


class Observations(ABC):
    """Encoder of N worlds' observations, (N, n) float32."""

    def __init__(self, pieces: Pieces, worlds: Worlds, heard: Heard):
        self._pieces, self._worlds, self._heard = pieces, worlds, heard
        self._known = pieces.known
        self._each = torch.arange(worlds.count, device=worlds.device)[:, None]

    def _index(self, array: Any) -> Tensor:
        return torch.as_tensor(np.asarray(array, dtype=np.int64), device=self._worlds.device)

    def _number(self, array: Any) -> Tensor:
        return torch.as_tensor(np.asarray(array, dtype=float)).to(self._worlds.qpos)

    @abstractmethod
    def write(self, row: Tensor) -> Tensor:
        """Compute the observations before the control steps at rows (N,) of the tables."""


def observations_of(
    encoding: Encoding, pieces: Pieces, worlds: Worlds, heard: Heard
) -> Observations:
    """Create the batched encoder for an encoding."""
    if isinstance(encoding, HandEncoding):
        return HandObservations(encoding, pieces, worlds, heard)
    if isinstance(encoding, FingerEncoding):
        return FingerObservations(encoding, pieces, worlds, heard)
    assert isinstance(encoding, RollEncoding), "there are three"
    return RollObservations(encoding, pieces, worlds, heard)


class RollObservations(Observations):
    """Observations of :class:`~sb3_piano.envs.encodings.RollEncoding`."""

    def __init__(self, encoding: RollEncoding, pieces: Pieces, worlds: Worlds, heard: Heard):
        super().__init__(pieces, worlds, heard)
        self._ahead = torch.arange(encoding.rows_shown, device=worlds.device)
        self._keys = encoding.keys
        self._joints = self._index(worlds.scene.hand_qpos)

    def write(self, row: Tensor) -> Tensor:
        """Return the observations; see :meth:`Observations.write`."""
        blocks = (
            self._known["goal"][row[:, None] + self._ahead].flatten(1),
            self._known["fingers"][row],
            self._heard.key_state[:, self._keys].float(),
            self._heard.pedal[:, None].float(),
            self._worlds.qpos.index_select(1, self._joints).float(),
        )
        return torch.cat(blocks, 1)


class FingerObservations(Observations):
    """Observations of :class:`~sb3_piano.envs.encodings.FingerEncoding`."""

    def __init__(self, encoding: FingerEncoding, pieces: Pieces, worlds: Worlds, heard: Heard):
        super().__init__(pieces, worlds, heard)
        layout = encoding.layout
        names = ("targets", "sustain", "wrong_keys")
        self._targets, self._sustain, self._wrong = (layout[name].slice for name in names)
        self._fingers = self._index(worlds.scene.fingers)
        self._joints = self._index(worlds.scene.hand_qpos)

    def write(self, row: Tensor) -> Tensor:
        """Return the observations; see :meth:`Observations.write`."""
        heard, worlds = self._heard, self._worlds
        known = {name: table.index_select(0, row) for name, table in self._known.items()}
        observation = known["known"]
        points = worlds.geom_xpos[self._each, known["key_geom"]] + known["press_offset"]
        tips = heard.fingertips
        if tips.shape[1] > len(self._fingers):
            tips = tips.index_select(1, self._fingers)
        targets = observation[:, self._targets].view(len(row), -1, 8)
        targets[..., :3] = points.sub_(tips).mul_(known["scale"])
        targets[..., 3] = heard.key_state.gather(1, known["key"]).mul_(known["has_target"])
        wrong = (heard.sounding > self._pieces.due.index_select(0, row)).sum(1)
        observation[:, self._sustain.start] = heard.pedal
        observation[:, self._wrong.start] = wrong.clamp_(max=MOST_WRONG_KEYS)
        observation[:, -len(self._joints) :] = worlds.qpos.index_select(1, self._joints)
        return observation


class HandObservations(Observations):
    """Observations of :class:`~sb3_piano.envs.hand_encoding.HandEncoding`."""

    def __init__(self, encoding: HandEncoding, pieces: Pieces, worlds: Worlds, heard: Heard):
        super().__init__(pieces, worlds, heard)
        self._at = encoding.at
        worlds.geom_xmat  # noqa: B018  from now on it is there
        self._qpos, self._dofs = self._index(encoding.qpos), self._index(encoding.dofs)
        self._tips = self._index(encoding.tip_geoms)
        self._along = self._number(encoding.tip_along)
        self._sign, self._mirror = self._number(encoding.sign), self._number(encoding.mirror)
        self._joint_sign = self._number(encoding.joint_sign)
        self._slider, self._slope = encoding.slider, encoding.slope
        self._middle = encoding.hands[0].middle
        self._nearest, self._lowest = self._index(encoding.nearest), encoding.lowest
        self._places = self._number(encoding.places.y)
        self._black = self._number(encoding.black).float()
        self._around = self._index(encoding.around)

    def write(self, row: Tensor) -> Tensor:
        """Return the observations; see :meth:`Observations.write`."""
        worlds, known, here_at = self._worlds, self._known, self._at
        count, hands = len(row), len(self._sign)
        rows = known["known"][row]
        joints = worlds.qpos[:, self._qpos] * self._joint_sign
        speeds = worlds.qvel[:, self._dofs] * self._joint_sign
        arm = (self._middle + self._slope * joints[..., self._slider])[..., None]
        axes = worlds.geom_xmat.index_select(1, self._tips)[..., 2::3]
        tips = worlds.geom_xpos.index_select(1, self._tips) + axes * self._along
        tips = tips.view(count, hands, -1, 3) * self._mirror
        here = tips * DM_PER_M
        rows[..., here_at["positions"]] = joints.float()
        rows[..., here_at["velocities"]] = speeds.clamp(-FASTEST, FASTEST).float()
        ways = ((known["target"][row] - here[:, :, None]) * known["scale"][row]).float()
        fingers, shown = tips.shape[2], len(FRAMES_AHEAD)
        frames = rows[..., here_at["frames"]].unflatten(-1, (shown, fingers, -1))
        frames[..., :3] = ways[:, :, :shown]
        presses = rows[..., here_at["presses"]]
        presses = presses.unflatten(-1, (PRESSES_AHEAD, fingers, -1))
        presses[..., :3] = ways[:, :, shown:]
        depth = self._heard.key_state.gather(1, known["press_key"][row].flatten(1))
        depth = depth.view(count, hands, -1, fingers)
        presses[..., 3] = (depth * known["press_there"][row]).float()
        self._write_keys(rows[..., here_at["keys"]], row, tips[..., 1])
        from_arm = arm * DM_PER_M
        here = torch.stack([here[..., 0], here[..., 1] - from_arm, here[..., 2]], -1)
        rows[..., here_at["fingertips"]] = here.flatten(2).float()
        # As in one world: differences are computed in double precision.
        for name in ("places", "line"):
            rows[..., here_at[name]] = (rows[..., here_at[name]] - from_arm).float()
        other = from_arm.flip(1) if hands > 1 else self._middle * DM_PER_M
        rows[..., here_at["other_arm"]] = (from_arm + other).float()
        return rows.flatten(1)

    def _write_keys(self, rows: Tensor, row: Tensor, places: Tensor) -> None:
        across = places * self._sign  # (N, h, 5) in the world
        cells = ((across - self._lowest) * 1000.0).long().clamp(0, len(self._nearest) - 1)
        key = self._nearest[cells]
        around = key[..., None] + self._around
        flat = around.flatten(1)
        state = torch.nn.functional.pad(self._heard.key_state, (1, 1)).float()
        shown = rows.unflatten(-1, (places.shape[2], -1))
        shown[..., 0:3] = state.gather(1, flat).view(around.shape)
        shown[..., 3:6] = self._known["due"][row].gather(1, flat).view(around.shape)
        shown[..., 6:9] = self._black[around]
        shown[..., 9] = (100.0 * (self._places[key] - across) * self._sign).float()
