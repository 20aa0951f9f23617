"""Packed observations come back as they were."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from transitions import Play, make_space

from sb3_piano.buffers.ring_observations import ObservationPacking
from sb3_piano.exceptions import ConfigError

BLOCKS = st.lists(st.tuples(st.integers(1, 20), st.booleans()), min_size=1, max_size=5)


@given(blocks=BLOCKS, n=st.integers(1, 3), seed=st.integers(0, 2**32 - 1))
def test_unpacking_undoes_packing_for_any_layout(blocks, n, seed):
    space = make_space(*blocks)
    packing = ObservationPacking(space)
    observations = Play(space, n, seed).observations
    packed, exact = packing.pack(observations)
    assert exact.all()
    assert packing.unpack(packed).tobytes() == observations.tobytes()


@pytest.mark.parametrize(
    ("blocks", "width"),
    [
        (((3, False),), 12),
        (((8, True),), 1),
        (((9, True),), 2),
        (((4, True), (1, False), (4, True)), 5),
        (((979, True), (10, True), (135, False)), 664),
    ],
)
def test_a_binary_number_takes_a_bit_and_another_its_four_bytes(blocks, width):
    packing = ObservationPacking(make_space(*blocks))
    assert packing.width == width
    assert packing.pack(np.zeros((2, len(packing.binary)), np.float32))[0].shape == (2, width)


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(0.0, 1.0, (5,), dtype=np.float64),
        spaces.Box(0, 255, (2, 3, 4), dtype=np.uint8),
        spaces.MultiBinary(11),
        spaces.MultiDiscrete([3, 4]),
        spaces.Discrete(7),
    ],
    ids=str,
)
def test_observations_of_a_space_without_layout_are_kept_as_they_are(space):
    packing = ObservationPacking(space)
    observations = np.stack([np.asarray(space.sample()).reshape(packing.shape) for _ in range(4)])
    packed, exact = packing.pack(observations)
    assert exact.all()
    assert packed.tobytes() == observations.tobytes()
    unpacked = packing.unpack(packed)
    assert (unpacked.dtype, unpacked.shape) == (space.dtype, observations.shape)
    np.testing.assert_array_equal(unpacked, observations)


@pytest.mark.parametrize("value", [0.5, -1.0, 2.0, np.nan, np.inf, 1e-45, 1 - 2**-24])
def test_a_number_that_is_neither_0_nor_1_is_noticed_in_binary_columns_only(value):
    packing = ObservationPacking(make_space((2, False), (3, True)))
    observations = np.zeros((3, 5), np.float32)
    observations[0, :2] = value
    observations[1, 4] = value
    assert packing.pack(observations)[1].tolist() == [True, False, True]


def test_the_error_tells_the_first_number_that_is_neither_its_block_and_environment():
    packing = ObservationPacking(make_space((2, False), (3, True), (4, True)))
    observations = np.full((3, 9), 1.0, np.float32)
    observations[:, 0] = 0.25  # not binary
    observations[1, 6] = 0.5
    error = packing.not_binary(observations)
    assert isinstance(error, ConfigError)
    start = "Observation column 6 (in block 'b2') of environment 1 is 0.5: expected 0 or 1, since"
    assert str(error).startswith(start)
