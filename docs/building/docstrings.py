"""Docstrings as Markdown: Sphinx's roles become links where the reference has what they name."""

from __future__ import annotations

import re
from typing import Any

import griffe

_ROLE = re.compile(r":(?:class|func|meth|attr|data|mod|exc):`(~?)([\w.]+)`")
_EXAMPLE = re.compile(r"::$", re.M)
"""End of a line after which an indented block is code; Markdown needs no mark."""


class Roles(griffe.Extension):
    """Rewrite the docstrings of a package once all of it is known.

    A name is looked up from where it is used. What no page of the reference has, such as a class of
    Gymnasium, is code without a link.
    """

    def on_package(self, *, pkg: griffe.Module, **named: Any) -> None:
        """Rewrite every docstring of a package."""
        del named
        waiting: list[griffe.Object | griffe.Alias] = [pkg]
        while waiting:
            found = waiting.pop()
            if found.docstring is not None:
                found.docstring.value = _markdown(found.docstring.value, found)
            waiting += [member for member in found.members.values() if not member.is_alias]
            if isinstance(found, griffe.Module):
                _uncover(found)


def _uncover(package: griffe.Module) -> None:
    """Let a name that a package exports be that of the function, not of the module it is from."""
    for name in package.exports or ():
        member = package.members.get(str(name))
        if isinstance(member, griffe.Module) and str(name) in member.members:
            function = member.members[str(name)]
            for other in package.members.values():
                if isinstance(other, griffe.Alias) and other.target_path.startswith(member.path):
                    other.resolve_target()  # as its way there will be covered
            package.members[str(name)] = griffe.Alias(str(name), function, parent=package)


def _markdown(text: str, found: griffe.Object | griffe.Alias) -> str:
    def linked(match: re.Match[str]) -> str:
        short, name = match.groups()
        shown = name.rpartition(".")[2] if short else name
        target = _resolved(name, found)
        return f'<autoref optional identifier="{target}"><code>{shown}</code></autoref>'

    return _EXAMPLE.sub(":", _ROLE.sub(linked, text))


def _resolved(name: str, found: griffe.Object | griffe.Alias) -> str:
    """Return the full name of what is called so where an object is defined."""
    if name in found.members:
        return f"{found.path}.{name}"
    try:
        return found.resolve(name)
    except griffe.NameResolutionError:
        return name
