"""The ``sb3-piano`` command: one module for each of its commands."""

from sb3_piano.cli.main import main

__all__ = ["main"]
