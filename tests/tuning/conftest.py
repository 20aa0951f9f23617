"""A PostgreSQL server for the tests of studies on many machines."""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterator

import pytest
import sqlalchemy
from postgresql_server import NoServerError, postgresql_server


@pytest.fixture(scope="session")
def postgresql_url() -> Iterator[str]:
    """A server of our own."""
    pytest.importorskip("psycopg")
    with contextlib.ExitStack() as stack:
        try:
            url = stack.enter_context(postgresql_server())
        except NoServerError as error:
            pytest.skip(str(error))
        yield url


@pytest.fixture
def database_url(postgresql_url) -> str:
    """A new database."""
    name = f"test_{uuid.uuid4().hex}"
    engine = sqlalchemy.create_engine(postgresql_url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(f"CREATE DATABASE {name}"))
    engine.dispose()
    url = sqlalchemy.make_url(postgresql_url).set(database=name)
    return url.render_as_string(hide_password=False)
