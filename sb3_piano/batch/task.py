"""Piano state and reward terms of many worlds, on tensors."""

from __future__ import annotations

import math

import numpy as np
import torch

from sb3_piano.batch.tables import Pieces
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.envs import PianoEnvConfig, rewards
from sb3_piano.metrics.onsets import ONSET_TICKS_PER_S, ONSET_TOLERANCE
from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS
from sb3_piano.simulation.keyboard import pedal_threshold
from sb3_piano.simulation.scene import FAR_AWAY

KEY_TOLERANCE = 0.05  # as in sb3_piano.envs.rewards
_FINGER_TOLERANCE = 0.01


class Heard:
    """Keys, pedal and fingertips of each world after the last control step."""

    def __init__(self, worlds: Worlds):
        scene, like = worlds.scene, worlds.qpos
        self._worlds, self._scene = worlds, scene

        def tensor(array: object) -> Tensor:
            return torch.as_tensor(np.asarray(array)).to(like)

        self._lowest, self._highest = like.new_zeros(1), tensor(scene.key_max_angle)
        self.threshold = tensor(scene.key_sounding_angle).expand(worlds.count, -1)
        """(N, 88) angle at and above which each key sounds, rad."""
        self._tip_site = torch.as_tensor(scene.fingertip_site, device=like.device)
        self._fingers = torch.as_tensor(scene.fingers, device=like.device)
        count = worlds.count
        self._far = like.new_full((count, NUM_FINGERS, 3), FAR_AWAY)
        self._substep = torch.arange(1, worlds.n_substeps, dtype=torch.int8, device=like.device)
        self.key_state = like.new_zeros(count, NUM_KEYS)
        """(N, 88) key angle divided by its maximum, in [0, 1]."""
        self.sounding = torch.zeros(count, NUM_KEYS, dtype=torch.bool, device=like.device)
        """(N, 88) sounding keys."""
        self._before = self.sounding
        self.since = torch.zeros(count, NUM_KEYS, dtype=torch.int8, device=like.device)
        """(N, 88) physics steps before a changed key reached its final state."""
        self.fingertips = self._far
        """(N, 10, 3) m; fingertips of missing hands are far away."""
        self.pedal = like.new_zeros(count)
        """(N,) pedal commands in [0, 1]."""
        self.pedal_threshold = pedal_threshold()
        """Command from which on the pedal is down."""

    @property
    def pedal_down(self) -> Tensor:
        """(N,) whether the pedal is down."""
        return self.pedal >= self.pedal_threshold

    @property
    def struck(self) -> Tensor:
        """(N, 88) sounding keys that were silent before the control step."""
        return self.sounding > self._before

    def begin(self, mask: Tensor) -> None:
        """Read the state of worlds at rest whose episodes start."""
        self.pedal = torch.where(mask, 0.0, self.pedal)
        self.since = torch.where(mask[:, None], 0, self.since)
        self._look()

    def read(self) -> None:
        """Read the state after a control step."""
        self._before = self.sounding
        self._look()
        self.since = torch.zeros_like(self.since)
        world, key = (self.sounding != self._before).nonzero(as_tuple=True)
        if len(world) and len(self._substep):
            angles, threshold = self._worlds.angles_within(world, key), self.threshold[world, key]
            other = (angles >= threshold[:, None]) != self.sounding[world, key][:, None]
            self.since[world, key] = (other * self._substep).amax(1)

    def within(self) -> Tensor:
        """Return the sounding keys after each physics step, (N, p, 88)."""
        return self._worlds.key_angles() >= self.threshold[:, None]

    def share(self) -> Tensor:
        """Return the share of the control step after which keys kept their state, (N, 88)."""
        return (self.since.to(self._highest.dtype) + 1) / self._worlds.n_substeps

    def _look(self) -> None:
        scene, worlds = self._scene, self._worlds
        moving = worlds.qpos[:, scene.key_slice]
        if moving.shape[1] < NUM_KEYS:
            first, last = scene.moving_keys.start, scene.moving_keys.stop
            moving = torch.nn.functional.pad(moving, (first, NUM_KEYS - last))
        angle = moving.clamp(self._lowest, self._highest)
        self.key_state, self.sounding = angle / self._highest, angle >= self.threshold
        if scene.sides:
            tips = worlds.site_xpos.index_select(1, self._tip_site)
            everyone = len(self._fingers) == NUM_FINGERS
            self.fingertips = tips if everyone else self._far.index_copy(1, self._fingers, tips)


def closeness(distance: Tensor, bound: float) -> Tensor:
    """Apply :func:`~sb3_piano.envs.rewards.tolerance` to non-negative distances."""
    outside = (distance - bound).clamp_(min=0)
    return outside.mul_(outside).mul_(math.log(0.1) / (10 * bound) ** 2).exp_()


def mean_where(values: Tensor, there: Tensor) -> Tensor:
    """Return the mean of the masked values along the last axis; 0 if there are none."""
    return (values * there).sum(-1) / there.sum(-1).clamp(min=1)


class Strikes:
    """Matching of strikes to onsets not yet hit, in each of N episodes."""

    def __init__(self, pieces: Pieces, count: int):
        self._onsets = pieces.onsets
        self._open = self._onsets.begun(count)

    def begin(self, mask: Tensor) -> None:
        """Start the episodes of a mask."""
        self._open[mask] = self._onsets.begun(1)

    def hit(self, piece: Tensor, row: Tensor, struck: Tensor, time: Tensor) -> Tensor:
        """Return which strikes, (N, 88) bool at (N, 88) s, hit open onsets, and close these."""
        candidates = self._onsets.candidates[row].long()
        flat = candidates.flatten(1)
        onset = self._onsets.time[piece].gather(1, flat).view_as(candidates)
        still_open = self._open.gather(1, flat).view_as(candidates)
        gap = (onset - time[..., None]).abs()
        in_time = (gap * ONSET_TICKS_PER_S).round() / ONSET_TICKS_PER_S <= ONSET_TOLERANCE
        gap = torch.where(in_time & still_open & struck[..., None], gap, torch.inf)
        nearest, which = gap.min(-1)
        hit = nearest < torch.inf
        none = self._open.shape[1] - 1
        taken = torch.where(hit, candidates.gather(-1, which[..., None])[..., 0], none)
        self._open.scatter_(1, taken, False)
        return hit


class Task:
    """Reward terms of each world's state for the goal of a control step."""

    def __init__(self, config: PianoEnvConfig, pieces: Pieces, worlds: Worlds, heard: Heard):
        self._config, self._pieces, self._worlds, self._heard = config, pieces, worlds, heard
        self._scene = worlds.scene
        kinds = {goal.fingering_reward for goal in pieces.goals}
        self._transport = torch.tensor(
            [goal.fingering_reward == "optimal-transport" for goal in pieces.goals]
        ).to(worlds.device)
        self._kinds = kinds
        pairs = [(False, False), (False, True), (True, False), (True, True)]
        self._sustain = worlds.qpos.new_tensor([rewards.sustain(*pair) for pair in pairs])
        self._sustain_row = 2 * pieces.sustain.long()
        key, like = pieces.key, worlds.qpos
        self._press_geom = torch.as_tensor(self._scene.key_geom, device=like.device)[key]
        self._press_offset = torch.as_tensor(self._scene.key_press_offset).to(like)[key]
        self._each = torch.arange(worlds.count, device=like.device)[:, None]

    def terms(self, piece: Tensor, row: Tensor) -> dict[str, Tensor]:
        """Return the unweighted terms by name, (N,) each, except the strikes' term.

        Args:
            piece: (N,) numbers of the pieces.
            row: (N,) rows of the control step in the tables.
        """
        heard, pieces = self._heard, self._pieces
        due, pedal_down = pieces.due.index_select(0, row), heard.pedal_down
        right = (heard.sounding <= due).all(1)
        depth = heard.key_state.gather(1, pieces.due_key.index_select(0, row))
        held = closeness(1.0 - depth, KEY_TOLERANCE).mul_(pieces.due_share.index_select(0, row))
        pedals = self._sustain_row.index_select(0, row) + pedal_down
        common = {
            "key_press": 0.5 * (held.sum(1) + right),
            "sustain": self._sustain.index_select(0, pedals),
        }
        if not self._scene.sides:
            mistakes = (heard.sounding != due).sum(1) + (pieces.sustain[row] != pedal_down)
            mistakes = mistakes.to(held.dtype)
            log = mistakes * math.log(1e-6)
            return {"distance": -mistakes.sqrt(), "log_likelihood": log, **common}
        worlds = self._worlds
        power = (worlds.actuator_force * worlds.actuator_velocity).abs_().sum(1)
        fingering = self._fingering(piece, row, due)
        return {**common, "energy": -power, "fingering": fingering, "forearm": self._forearm()}

    def _forearm(self) -> Tensor:
        asked = self._config.forearm_reward
        apart = ~self._worlds.forearms_touch() if asked else torch.zeros_like(self._worlds.lost)
        return apart.to(self._worlds.dtype)

    def _fingering(self, piece: Tensor, row: Tensor, due: Tensor) -> Tensor:
        reward = self._worlds.qpos.new_zeros(self._worlds.count)
        if "labels" in self._kinds:
            reward = (self.near(row) * self._pieces.share.index_select(0, row)).sum(1)
        if "optimal-transport" in self._kinds:
            for world in self._transport[piece].nonzero().flatten().tolist():
                reward[world] = self._assigned(world, due[world].nonzero().flatten())
        return reward

    def near(self, row: Tensor) -> Tensor:
        """Return how close labelled fingers are to their keys, (N, k) in [0, 1]."""
        geom, finger = (t.index_select(0, row) for t in (self._press_geom, self._pieces.finger))
        points = self._worlds.geom_xpos[self._each, geom] + self._press_offset.index_select(0, row)
        way = points - self._heard.fingertips[self._each, finger]
        return closeness(torch.linalg.vector_norm(way, dim=-1), _FINGER_TOLERANCE)

    def _assigned(self, world: int, keys: Tensor) -> float:
        # One world at a time, as in a single environment: for pieces without fingers.
        worlds, scene = self._worlds, self._scene
        geoms, offsets = scene.press_geometry(keys.cpu().numpy())
        points = worlds.geom_xpos[world].double().cpu().numpy()[geoms] + offsets
        tips = self._heard.fingertips[world].double().cpu().numpy()[scene.fingers]
        return rewards.optimal_transport_fingering(tips, points)
