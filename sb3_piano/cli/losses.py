"""Tables of ``--losses``: missed and wrong frames by finger, key and chord."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sb3_piano.cli.common import add_row, new_table, print_table

if TYPE_CHECKING:
    from sb3_piano.metrics.losses import Counts, Losses

HELP = "also show missed and wrong frames by finger, key and chord"
_NOTHING = "-"


def print_losses(losses: Losses) -> None:
    """Print the shares of due and wrong frames in each group."""
    from sb3_piano.metrics.losses import DUE_KINDS, WRONG_KINDS

    _print("due", losses.due, DUE_KINDS, "No key was due.")
    _print("wrong", losses.wrong, WRONG_KINDS, "No wrong key sounded.")


def _print(what: str, counts: Counts, kinds: tuple[str, ...], none: str) -> None:
    from sb3_piano.metrics.losses import ALL, shares_of

    if ALL not in counts:
        print(none)
        return
    table = new_table(f"{what}, % of frames", "frames", *(kind.replace("_", " ") for kind in kinds))
    for group, of_kind in counts.items():
        shares = shares_of(of_kind)
        cells = (f"{100 * shares[kind]:.1f}" if of_kind[kind] else _NOTHING for kind in kinds)
        add_row(table, group, str(sum(of_kind.values())), *cells)
        if group == ALL:
            table.add_section()
    print_table(table)
