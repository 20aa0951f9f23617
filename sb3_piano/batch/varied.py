"""Conditions that differ from world to world: physics, latency and noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from sb3_piano.batch.task import Heard
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.wrappers import DomainRandomization


class Varied:
    """Drawn conditions of N worlds, by :class:`~sb3_piano.wrappers.DomainRandomization`."""

    def __init__(self, wrapper: DomainRandomization, worlds: Worlds, heard: Heard):
        self._draw, self._worlds, self._heard = wrapper, worlds, heard
        heard.threshold = heard.threshold.clone()
        count, device, most = worlds.count, worlds.device, wrapper.latency[1]
        self._latency = torch.zeros(count, dtype=torch.long, device=device)
        self._all = torch.arange(count, device=device)
        piano: Any = wrapper.unwrapped
        self._rest = torch.from_numpy(np.append(*piano.action_map.controls(piano.rest_action)))
        self._rest = self._rest.to(worlds.qpos)
        self._told = self._rest.repeat(count, most + 1, 1)  # the newest first
        self._noisy = torch.as_tensor(wrapper.noisy, device=device)
        self._random = torch.Generator(device)

    def begin(self, mask: Tensor, random: np.random.Generator) -> None:
        """Draw the conditions of the worlds whose episodes start, before their reset."""
        worlds, rows = self._worlds, mask.nonzero().flatten()
        drawn = self._draw.draw(len(rows), random)
        for name, values in drawn.fields.items():
            worlds.fields[name][rows] = torch.from_numpy(values).to(worlds.fields[name])
        worlds.update_constants(mask)
        threshold = torch.from_numpy(drawn.sounding_angle).to(worlds.qpos)
        self._heard.threshold[rows] = threshold
        self._latency[rows] = torch.from_numpy(drawn.latency).to(rows)
        self._told[rows] = self._rest
        self._random.manual_seed(int(random.integers(2**31)))

    def late(self, pedal: Tensor, controls: Tensor) -> tuple[Tensor, Tensor]:
        """Return the pedal and the actuators' targets that are due in this control step."""
        if self._told.shape[1] == 1:
            return pedal, controls
        told = torch.cat([controls, pedal[:, None]], 1)
        self._told = torch.cat([told[:, None], self._told[:, :-1]], 1)
        due = self._told[self._all, self._latency]
        return due[:, -1], due[:, :-1]

    def seen(self, observation: Tensor) -> Tensor:
        """Return observations with noise, (N, n)."""
        if self._draw.noise:
            shape = (len(observation), len(self._noisy))
            noise = torch.randn(shape, generator=self._random, device=observation.device)
            observation[:, self._noisy] += self._draw.noise * noise
        return observation
