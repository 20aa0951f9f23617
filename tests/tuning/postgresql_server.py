"""A PostgreSQL server of one's own."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path


class NoServerError(Exception):
    """PostgreSQL cannot be started here; the message says why."""


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def _programs() -> Path | None:
    """Return the folder of PostgreSQL's programs, which Debian does not have on the PATH."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    on_path = shutil.which("initdb")
    found += [Path(on_path).resolve()] if on_path else []
    return found[-1].parent if found else None


@contextlib.contextmanager
def postgresql_server() -> Iterator[str]:
    """Start a server in a new folder and give its URL; PostgreSQL refuses to run as root.

    Raises:
        NoServerError: If it is not installed, or there is nobody to run it.
    """
    programs = _programs()
    if programs is None:
        raise NoServerError(
            "PostgreSQL is not installed: no initdb in /usr/lib/postgresql or on PATH"
        )
    folder = Path(tempfile.mkdtemp(prefix="postgresql-of-tests-", dir="/tmp"))
    other_user = {}
    if os.getuid() == 0:
        try:
            owner = pwd.getpwnam("postgres")
        except KeyError:
            folder.rmdir()
            raise NoServerError(
                "PostgreSQL does not run as root, and there is no user postgres"
            ) from None
        os.chown(folder, owner.pw_uid, owner.pw_gid)
        other_user = {"user": owner.pw_uid, "group": owner.pw_gid, "extra_groups": []}

    def run(program: str, *arguments: str) -> None:
        command = [str(programs / program), "-D", str(folder / "data"), *arguments]
        with (folder / "programs.log").open("ab") as log:
            done = subprocess.run(
                command, cwd=folder, stdout=log, stderr=log, check=False, **other_user
            )
        if done.returncode != 0:
            logs = [file.read_text() for file in folder.glob("*.log")]
            raise RuntimeError("\n".join([f"{program} failed", *logs]))

    port = _free_port()
    options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1 -c fsync=off"
    try:
        run("initdb", "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
        run("pg_ctl", "-w", "-l", str(folder / "server.log"), "-o", options, "start")
        try:
            yield f"postgresql+psycopg://postgres@127.0.0.1:{port}/postgres"
        finally:
            run("pg_ctl", "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder)
