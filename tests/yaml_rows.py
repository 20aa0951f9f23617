"""Tables of inputs and right values in YAML, each row of which is a case of a test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

# The one in C takes a tenth of the time: all tables are read before the first test.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Tables:
    """The tables of a file of tests: those of ``test_score.py`` stand in ``tables/score.yml``.

    A table is called like its test, without ``test_``.
    """

    def __init__(self, file: str) -> None:
        path = Path(file)
        name = f"{path.stem.removeprefix('test_')}.yml"
        text = path.parent.joinpath("tables", name).read_text(encoding="utf-8")
        self._tables: dict[str, Any] = yaml.load(text, Loader=LOADER)

    def __getitem__(self, name: str) -> Any:
        """Return a table as it is."""
        return self._tables[name]

    def __call__(self, arguments: str, **options: Any) -> Callable[[Any], Any]:
        """Return the decorator that makes a case of each row of the test's table.

        ``options`` are those of ``pytest.mark.parametrize``.
        """

        def of_each_row(test: Any) -> Any:
            rows = self._tables[test.__name__.removeprefix("test_")]
            return pytest.mark.parametrize(arguments, rows, **options)(test)

        return of_each_row
