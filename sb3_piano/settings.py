"""Settings: dataclasses and single values that are checked where they enter, by pydantic.

A class decorated with :func:`settings` is a frozen dataclass of keyword arguments. Its annotations
say what is valid, and every violation becomes one :class:`~sb3_piano.exceptions.ConfigError` that
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


_EXPONENTIAL = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")


def _spelled(value: Any) -> Any:
    """Return the number that text such as ``1e-3`` is, which PyYAML does not read as one."""
    is_number = isinstance(value, str) and _EXPONENTIAL.fullmatch(value)
    return float(value) if is_number else value


def _integer(value: Any) -> Any:
    """Return NumPy's integers as int, and ``1e6``."""
    number = _spelled(value)
    if number is not value and number.is_integer():
        return int(number)
    return int(value) if isinstance(value, Integral) and not isinstance(value, bool) else value


def _float(value: Any) -> Any:
    """Return any other real number as float."""
    value = _spelled(value)
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
"""A whole number, NumPy's included; true and false are none."""

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
    """What is wrong in settings within settings; their place is told before it."""


class _FromMapping:
    """Annotation of settings that may be given as a mapping of their fields."""

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
"""Settings within settings, also as a mapping of their fields."""


@dataclasses.dataclass(frozen=True)
class Unit:
    """Annotation of a number: what follows its range in a message, such as a unit or a reason."""

    text: str


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass of keyword arguments, checked against its annotations.

    ``__post_init__`` may check what concerns several fields, and raise ``ConfigError`` itself.

    Raises:
        ConfigError: When the class is called with values that do not fit, or with names that it
            does not have.
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
    # Who converts values before they get here, such as text from YAML, wants the bare types.
    bare, signature = typing.get_type_hints(cls), inspect.signature(checked)
    checked.__signature__ = signature.replace(
        parameters=[p.replace(annotation=bare[name]) for name, p in signature.parameters.items()]
    )
    return checked


def checked(name: str, value: Any, kind: Any) -> Any:
    """Return a single value, called by its name, as an annotation wants it.

    Raises:
        ConfigError: If it does not fit.
    """
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError as error:
        raise ConfigError(_message(error, {name: kind}, name)) from None


def refuse_unknown(names: Iterable[str], known: Iterable[str], what: str, of: str = "") -> None:
    """Refuse names that mean nothing.

    The message calls a name ``what``, such as "reward term", and says of what it is one.

    Raises:
        ConfigError: If one is not among those that are known.
    """
    known = list(known)
    for name in names:
        if name not in known:
            place = f" of {of}" if of else ""
            raise ConfigError(
                f"Unknown {what} {name!r}{place}.{near_names(str(name), known)} Expected one of "
                f"{', '.join(known)}."
            )


@functools.lru_cache(maxsize=256)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind, config=ConfigDict(strict=True, arbitrary_types_allowed=True))


def _message(error: ValidationError, kinds: Mapping[str, Any], *names: str) -> str:
    """Return what is wrong with the first value that does not fit.

    ``kinds`` has the annotation of each value by its name, with which the error's place begins;
    ``names`` are what comes before that place.
    """
    first = error.errors(include_url=False)[0]
    raised = first.get("ctx", {}).get("error")
    place: tuple[str | int, ...] = (*names, *first["loc"])
    if isinstance(raised, _NestedError):
        return f"{_called(place)}: {raised}"
    if isinstance(raised, SB3PianoError):  # from a __post_init__, or a validator of ours
        return str(raised)
    name, inside = place[0], place[1:]
    if first["type"] == "missing":
        return f"{name} is missing: it has no default."
    kind = kinds.get(str(name))
    is_key = inside[-1:] == ("[key]",)
    if is_key:  # the message shows the key itself
        inside = inside[:-2]
    for _ in inside:
        kind = _inner(kind)
    kind = _inner(kind, key=True) if is_key else kind
    expected = _expected(first, *_parts(kind))
    return f"{_called((name, *inside))} is {reprlib.repr(first['input'])}: expected {expected}"


def _called(place: tuple[str | int, ...]) -> str:
    return f"{place[0]}{''.join(f'[{part!r}]' for part in place[1:])}"


def _expected(error: ErrorDetails, bare: Any, notes: tuple[Any, ...]) -> str:
    """Return the end of a message: what was expected in place of a value."""
    if error["type"] == "literal_error":
        choices = typing.get_args(bare)
        return f"one of {', '.join(map(repr, choices))}.{near_names(str(error['input']), choices)}"
    if bare in (int, float):
        return f"{_number_text(bare, notes)}."
    if error["type"] == "too_short":
        least = error["ctx"]["min_length"]
        return f"at least {'one entry' if least == 1 else f'{least} entries'}."
    texts = {bool: "true or false", str: "text", Mapping: "a mapping", tuple: "a list"}
    text = texts.get(typing.get_origin(bare) or bare)
    text = "a mapping" if dataclasses.is_dataclass(bare) else text
    return f"{text}." if text else f"{error['msg']}."


def _number_text(bare: type, notes: tuple[Any, ...]) -> str:
    """Return "a whole number from 1 to 1920 pixels" for a kind of number and its annotations."""
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


def _inner(kind: Any, *, key: bool = False) -> Any:
    """Return the annotation of what a mapping or a sequence holds."""
    arguments = [a for a in typing.get_args(_parts(kind)[0]) if a is not ...]
    return arguments[0 if key else -1] if arguments else None


def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return an annotation without ``None`` and ``Annotated``, and what annotates it."""
    notes: tuple[Any, ...] = ()
    while True:
        if typing.get_origin(kind) is Annotated:
            kind, *more = typing.get_args(kind)
            notes = (*notes, *more)
        elif type(None) in (options := typing.get_args(kind)) and len(options) == 2:
            kind = next(option for option in options if option is not type(None))
        else:
            return kind, notes
