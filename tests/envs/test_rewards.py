"""Reward terms: the cases that recorded episodes do not have, and dm_control's tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import rewards


def test_tolerance_equals_dm_controls():
    dm_tolerance = pytest.importorskip("dm_control.utils.rewards").tolerance
    x = np.linspace(-2, 3, 101)
    expected = dm_tolerance(x, bounds=(0, 0.05), margin=0.5, sigmoid="gaussian")
    ours = [rewards.tolerance(distance, 0.05, 0.5) for distance in x.tolist()]
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


def test_optimal_transport_takes_the_cheapest_assignment_not_the_first():
    tips = np.full((10, 3), 5.0)
    tips[7], tips[2] = [0, 0, 0], [0, 0.3, 0]
    press = np.array([[0, 0.3, 0], [0, 0, 0]])
    assert rewards.optimal_transport_fingering(tips, press) == 1.0
    many = np.zeros((12, 3))  # of more keys than fingers the ten nearest count
    many[10:] = 9.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), many) == 1.0


def test_fingering_terms_where_nothing_is_due():
    nothing = np.zeros((0, 3))
    assert rewards.labelled_fingering([]) == 0.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), nothing) == 1.0
