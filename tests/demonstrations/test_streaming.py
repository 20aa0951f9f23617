"""Rows of several parts: each once an epoch, mixed, and few of them in memory."""

from itertools import chain

import numpy as np
import pytest
import torch

from sb3_piano.demonstrations.streaming import ShuffledRows

SIZES = (7, 0, 20, 1, 30, 13)


def new_rows(buffer, read=lambda number: None):
    """Return rows whose two numbers are their place, and its negative."""
    ends = np.cumsum(SIZES)

    def part(number):
        read(number)
        places = np.arange(ends[number] - SIZES[number], ends[number], dtype=np.float32)[:, None]
        return places, -places

    return ShuffledRows([lambda n=n: part(n) for n in range(len(SIZES))], SIZES, buffer)


def epoch(rows, size=4, seed=0):
    batches = list(rows.batches(size, torch.Generator().manual_seed(seed)))
    return [batch[0][:, 0].tolist() for batch in batches], batches


@pytest.mark.parametrize("buffer", [1, 8, 10, 25, 70, 71, 1000])
@pytest.mark.parametrize("size", [1, 4, 100])
def test_each_row_comes_once_in_full_minibatches(buffer, size):
    places, batches = epoch(new_rows(buffer), size)
    assert sorted(chain(*places)) == list(range(71))
    assert all(torch.equal(first, -second) for first, second in batches)
    assert [len(batch) for batch in places[:-1]] == [size] * (len(places) - 1)
    assert len(places) == -(-71 // size)


@pytest.mark.parametrize("buffer", [16, 71])
def test_the_order_follows_from_the_seed_and_changes_with_the_epoch(buffer):
    rows = new_rows(buffer)
    assert epoch(rows)[0] == epoch(new_rows(buffer))[0]
    assert epoch(rows)[0] != epoch(rows, seed=1)[0]
    random = torch.Generator().manual_seed(0)
    first, second = ([b[0].tolist() for b in rows.batches(4, random)] for _ in range(2))
    assert first != second


def test_what_fits_is_read_once_and_shuffled_as_a_whole():
    read = []
    rows = new_rows(71, read.append)
    places = list(chain(*epoch(rows)[0]))
    epoch(rows)
    assert read == list(range(len(SIZES)))
    assert places == torch.randperm(71, generator=torch.Generator().manual_seed(0)).tolist()


def test_what_does_not_fit_is_read_part_by_part_as_it_is_needed():
    read, came = [], []
    rows = new_rows(16, read.append)
    for _ in rows.batches(4, torch.Generator().manual_seed(0)):
        came.append(len(read))
    assert sorted(read) == list(range(len(SIZES)))
    assert came[0] < came[-1] == len(SIZES)


def test_minibatches_mix_the_parts_that_are_in_memory():
    part_of = np.repeat(np.arange(len(SIZES)), SIZES)
    parts = [{int(part_of[int(place)]) for place in batch} for batch in epoch(new_rows(50))[0]]
    assert sum(len(found) > 1 for found in parts) > len(parts) / 2
