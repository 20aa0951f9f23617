"""Settings: what is refused, and in which words."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le, Lt
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import (
    Count,
    Listed,
    Nested,
    Number,
    Share,
    TextOrPath,
    Unit,
    Whole,
    checked,
    settings,
)

tables = Tables(__file__)


@settings
class Canvas:
    width: Annotated[Whole, Ge(1), Le(1920), Unit("pixels")] = 640
    seed: Count | None = None
    scale: Number = 1.0
    file: TextOrPath = ""
    grey: bool = False
    style: Literal["oil", "chalk"] = "oil"
    weights: Mapping[str, Share] = dataclasses.field(default_factory=dict)
    sizes: tuple[Count, ...] = (1,)
    title: str

    def __post_init__(self) -> None:
        if self.title == "untitled":
            raise ConfigError("title is 'untitled': expected a name.")


@tables("values, message")
def test_a_value_that_does_not_fit_is_named_with_what_was_expected(values, message):
    with pytest.raises(ConfigError) as raised:
        Canvas(**{"title": "Sea", **values})
    assert str(raised.value) == message


def test_numbers_of_numpy_and_paths_become_plain_ones(tmp_path):
    canvas = Canvas(title="Sea", width=np.int64(3), scale=np.float32(0.5), file=tmp_path)
    assert (canvas.width, canvas.scale, canvas.file) == (3, 0.5, str(tmp_path))
    assert [type(x) for x in (canvas.width, canvas.scale)] == [int, float]


def test_settings_are_frozen_dataclasses_that_can_be_changed_in_copies():
    canvas = Canvas(title="Sea")
    with pytest.raises(dataclasses.FrozenInstanceError):
        canvas.width = 3
    assert dataclasses.replace(canvas, width=3) == Canvas(title="Sea", width=3)
    with pytest.raises(ConfigError, match="width is 0"):
        dataclasses.replace(canvas, width=0)
    assert pickle.loads(pickle.dumps(canvas)) == copy.deepcopy(canvas) == canvas


def test_single_values_are_checked_alike_and_one_without_default_is_asked_for():
    share = Unit(", as it is a share")
    for kind, text in (
        (Annotated[Number, Gt(0), Le(1)], "a finite number above 0, 1 or less"),
        (Annotated[Number, Lt(1)], "a finite number below 1"),
        (Annotated[Number, Ge(-1), Le(1), share], "-1 to 1, as it is a share"),
        (Annotated[Whole, Ge(2)] | None, "a whole number, 2 or more"),
    ):
        with pytest.raises(ConfigError, match=f"^n is 'x': expected .*{text}.$"):
            checked("n", "x", kind)
    with pytest.raises(ConfigError, match="title is missing"):
        Canvas()
    with pytest.raises(
        ConfigError, match=r"^sizes\[1\] is 0: expected a whole number, 1 or more.$"
    ):
        Canvas(title="Sea", sizes=(3, 0))


@settings
class Gallery:
    first: Nested[Canvas]
    others: Annotated[tuple[Nested[Canvas], ...], Listed] = ()


def test_settings_within_settings_may_be_mappings_and_are_named_where_they_are():
    first, other = Canvas(title="a", width=3), Canvas(title="b")
    plain = {"title": "a", "width": 3}
    assert Gallery(first=plain, others=[other, plain]).others == (other, first)
    with pytest.raises(ConfigError, match=r"^others\[1\]: width is 0: expected a whole"):
        Gallery(first=first, others=[other, {**plain, "width": 0}])
    with pytest.raises(ConfigError, match=r"^first: Unknown setting 'widht' of Canvas\. Did you"):
        Gallery(first={**plain, "widht": 3})
    with pytest.raises(ConfigError, match=r"^first is 3: expected a mapping\.$"):
        Gallery(first=3)


def test_numbers_may_be_text_as_pyyaml_reads_them_and_whole_ones_floats():
    assert checked("scale", "1e-3", Number) == 0.001
    assert checked("width", "1.0e3", Whole) == checked("width", 1e3, Whole) == 1000
    assert checked("seed", "9007199254740993", Whole) == 2**53 + 1
    with pytest.raises(ConfigError, match=r"width is '1e-3': expected a whole number"):
        checked("width", "1e-3", Whole)


@tables("value, message")
def test_of_several_kinds_all_are_told_or_what_came_furthest(value, message):
    with pytest.raises(ConfigError) as raised:
        checked("it", value, Whole | Annotated[tuple[Whole, str], Listed] | None)
    assert str(raised.value) == message
