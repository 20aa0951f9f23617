"""Validate settings, dataclasses and single values, with pydantic.

A class decorated with :func:`settings` is a frozen dataclass of keyword arguments, validated
against its annotations. Every violation raises one :class:`~sb3_piano.exceptions.ConfigError` that
names the value and what was expected:

>>> @settings
... class Canvas:
...     width: Annotated[Whole, Ge(1), Le(1920), Unit("pixels")] = 640
>>> Canvas(width=0)
Traceback (most recent call last):
sb3_piano.exceptions.ConfigError: width is 0: expected a whole number from 1 to 1920 pixels.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import re
import reprlib
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Annotated, Any, TypeVar, dataclass_transform

from annotated_types import Ge, Gt, Le, Lt, MultipleOf
from pydantic import (
    AllowInfNan,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic.dataclasses import dataclass as checked_dataclass
from pydantic_core import ErrorDetails, core_schema

from sb3_piano.exceptions import ConfigError, SB3PianoError, near_names

T = TypeVar("T")

_CONFIG = ConfigDict(strict=True, extra="forbid", arbitrary_types_allowed=True)


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


def number_in(value: Any) -> Any:
    """Parse text such as ``1e-3`` as a number; return other values unchanged."""
    if not isinstance(value, str) or not _NUMBER.fullmatch(value):
        return value
    try:
        return int(value)
    except ValueError:
        return float(value)


def _integer(value: Any) -> Any:
    """Convert any whole number to int; return other values unchanged."""
    number = number_in(value)
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    is_whole = is_number and (isinstance(number, Integral) or number % 1 == 0)
    return int(number) if is_whole else value


def _float(value: Any) -> Any:
    """Convert any real number to float; return other values unchanged."""
    value = number_in(value)
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:  # a whole number beyond all floats
            return float("inf")
    return value


def _path_text(value: Any) -> Any:
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


Whole = Annotated[int, BeforeValidator(_integer)]
"""A whole number, also NumPy's or a whole float, but not a bool."""

Number = Annotated[float, BeforeValidator(_float), AllowInfNan(False)]
"""A finite number as a float."""

Count = Annotated[Whole, Ge(1)]
"""A whole number, 1 or more."""

Index = Annotated[Whole, Ge(0)]
"""A whole number, 0 or more."""

Share = Annotated[Number, Ge(0), Le(1)]
"""A number from 0 to 1."""

NotNegative = Annotated[Number, Ge(0)]
"""A finite number, 0 or more."""

Positive = Annotated[Number, Gt(0)]
"""A number above 0."""

TextOrPath = Annotated[str, BeforeValidator(_path_text)]
"""Text, or a path as text."""

Listed = BeforeValidator(_tuple)
"""Annotation of a tuple, which YAML can only give as a list."""


class _NestedError(ConfigError):
    """An error in nested settings; the outer message adds its location."""


class _FromMapping:
    """Annotation of settings that also accept a mapping of their fields."""

    def __get_pydantic_core_schema__(
        self, kind: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def made(value: Any) -> Any:
            if not isinstance(value, Mapping):
                return value
            try:
                return kind(**value)
            except ConfigError as error:
                raise _NestedError(str(error)) from error

        return core_schema.no_info_before_validator_function(made, handler(kind))


Nested = Annotated[T, _FromMapping()]
"""Nested settings, also given as a mapping of their fields."""


@dataclasses.dataclass(frozen=True)
class Unit:
    """Annotation of a number: the text after its range in a message, a unit or a reason."""

    text: str


@dataclasses.dataclass(frozen=True)
class Expected:
    """Annotation of a value: the expectation in a message, where the type does not say it."""

    text: str


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass of keyword arguments, validated by its annotations.

    ``__post_init__`` may check several fields together, and raise ``ConfigError`` itself.

    Raises:
        ConfigError: When the class is called with invalid values or unknown names.
    """
    checked: Any = checked_dataclass(frozen=True, kw_only=True, config=_CONFIG)(cls)
    fields = [field.name for field in dataclasses.fields(checked)]
    validate: Callable[..., None] = checked.__init__

    @functools.wraps(validate)
    def init(self: Any, **values: Any) -> None:
        refuse_unknown(values, fields, "setting", cls.__name__)
        try:
            validate(self, **values)
        except ValidationError as error:
            raise ConfigError(
                _message(error, typing.get_type_hints(cls, include_extras=True))
            ) from None

    checked.__init__ = init
    # Code that converts values before, such as text from YAML, needs the bare types.
    bare, signature = typing.get_type_hints(cls), inspect.signature(checked)
    checked.__signature__ = signature.replace(
        parameters=[p.replace(annotation=bare[name]) for name, p in signature.parameters.items()]
    )
    return checked


def checked(name: str, value: Any, kind: Any) -> Any:
    """Validate and convert a single value by an annotation; ``name`` is for the message.

    Raises:
        ConfigError: If it does not fit.
    """
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError as error:
        raise ConfigError(_message(error, {name: kind}, name)) from None


def refuse_unknown(
    names: Iterable[str],
    known: Iterable[str],
    what: str,
    of: str = "",
    also_near: Iterable[str] = (),
) -> None:
    """Refuse unknown names, and suggest similar ones.

    The message calls a name ``what``, such as "reward term", of ``of``. Suggestions come from
    ``known`` and ``also_near``.

    Raises:
        ConfigError: If a name is not among ``known``.
    """
    known, near = list(known), list(also_near)
    for name in names:
        if name not in known:
            place = f" of {of}" if of else ""
            others = [other for other in (*known, *near) if other != name]
            raise ConfigError(
                f"Unknown {what} {name!r}{place}.{near_names(str(name), others)} Expected "
                f"one of {', '.join(known)}."
            )


@functools.lru_cache(maxsize=256)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind, config=ConfigDict(strict=True, arbitrary_types_allowed=True))


def _message(error: ValidationError, kinds: Mapping[str, Any], *names: str) -> str:
    """Describe the first invalid value.

    ``kinds`` has the annotation of each value by its name, the first part of the error's location;
    ``names`` come before that location.
    """
    found = error.errors(include_url=False)
    field = slice(0 if names else 1)
    of_field = (each for each in found if each["loc"][field] == found[0]["loc"][field])
    # For a union, report the alternative that matched furthest.
    first = max(of_field, key=lambda each: len(each["loc"]))
    raised = first.get("ctx", {}).get("error")
    place: tuple[str | int, ...] = (*names, *first["loc"])
    if isinstance(raised, _NestedError):
        return f"{_called(place)}: {raised}"
    if isinstance(raised, SB3PianoError):  # from a __post_init__, or a validator of ours
        return str(raised)
    if first["type"] == "missing" and len(place) == 1:
        return f"{place[0]} is missing: it has no default."
    place, kind = _shown(place, kinds.get(str(place[0])), first["type"] == "missing")
    return f"{_called(place)} is {reprlib.repr(first['input'])}: expected {_expected(first, kind)}"


def _shown(
    place: tuple[str | int, ...], kind: Any, is_short: bool
) -> tuple[tuple[str | int, ...], Any]:
    """Return the location of a value as the message shows it, and its annotation.

    Pydantic's location also has the alternative of a union, and a mark for keys of a mapping; for
    a list that is too short it ends in the missing index.
    """
    shown = list(place[:1])
    kinds = [kind]
    for part in place[1 : -1 if is_short else None]:
        several = _alternatives(kinds[-1])
        if part == "[key]":  # the message shows the key itself
            return tuple(shown[:-1]), _inner(kinds[-2], key=True)
        if several and part == place[-1]:
            break
        if several:
            kinds.append(next(one for one in several if _inner(one) is not None))
        else:
            shown.append(part)
            kinds.append(_inner(kinds[-1]))
    return tuple(shown), kinds[-1]


def _called(place: tuple[str | int, ...]) -> str:
    return f"{place[0]}{''.join(f'[{part!r}]' for part in place[1:])}"


def _expected(error: ErrorDetails, kind: Any) -> str:
    """Return the end of a message: the expectation for a value."""
    several = _alternatives(kind)
    if several:
        texts = (_expected(error, one).removesuffix(".") for one in several)
        return f"{' or '.join(dict.fromkeys(texts))}."
    bare, notes = _parts(kind)
    text = next((note.text for note in notes if isinstance(note, Expected)), None)
    if text is not None:
        return f"{text}."
    if error["type"] == "literal_error":
        choices = typing.get_args(bare)
        return f"one of {', '.join(map(repr, choices))}.{near_names(str(error['input']), choices)}"
    if bare in (int, float):
        return f"{_number_text(bare, notes)}."
    if error["type"] == "too_short":
        least = error["ctx"]["min_length"]
        return f"at least {'one entry' if least == 1 else f'{least} entries'}."
    text = _TEXTS.get(typing.get_origin(bare) or bare)
    text = "a mapping" if dataclasses.is_dataclass(bare) else text
    items = typing.get_args(bare) if typing.get_origin(bare) is tuple else (...,)
    text = text if ... in items else f"a list of {len(items)}"
    return f"{text}." if text else f"{error['msg']}."


_TEXTS: Mapping[Any, str] = {
    bool: "true or false",
    str: "text",
    tuple: "a list",
    list: "a list",
    Mapping: "a mapping",
    dict: "a mapping",
}


def _number_text(bare: type, notes: tuple[Any, ...]) -> str:
    """Describe a number's range, as in "a whole number from 1 to 1920 pixels"."""
    text = "a whole number" if bare is int or MultipleOf(1) in notes else "a finite number"
    unit, comma, reason = next((n.text for n in notes if isinstance(n, Unit)), "").partition(",")
    unit = f" {unit}" if unit else ""
    low = next((note for note in notes if isinstance(note, Ge | Gt)), None)
    high = next((note for note in notes if isinstance(note, Le | Lt)), None)
    match low, high:
        case Ge(ge), Le(le):
            return f"{text} from {ge:g} to {le:g}{unit}{comma}{reason}"
        case Ge(ge), _:
            text += f", {ge:g}{unit} or more"
        case Gt(gt), _:
            text += f" above {gt:g}{unit}"
    match high:
        case Le(le):
            text += f", {le:g}{unit} or less"
        case Lt(lt):
            text += f"{' and' if low else ''} below {lt:g}{unit}"
    return f"{text}{comma}{reason}"


def _alternatives(kind: Any) -> list[Any]:
    """Return the alternatives of a union without ``None``; empty if it is not a union."""
    bare = _parts(kind)[0]
    is_union = typing.get_origin(bare) in (typing.Union, types.UnionType)
    return [one for one in typing.get_args(bare) if one is not type(None)] if is_union else []


def _inner(kind: Any, *, key: bool = False) -> Any:
    """Return the annotation of a container's values, or of its keys."""
    arguments = [a for a in typing.get_args(_parts(kind)[0]) if a is not ...]
    return arguments[0 if key else -1] if arguments else None


def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Strip ``None`` and ``Annotated`` from an annotation; return it and its metadata."""
    notes: tuple[Any, ...] = ()
    while True:
        if typing.get_origin(kind) is Annotated:
            kind, *more = typing.get_args(kind)
            notes = (*notes, *more)
        elif type(None) in (options := typing.get_args(kind)) and len(options) == 2:
            kind = next(option for option in options if option is not type(None))
        else:
            return kind, notes
