"""Tables of results, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from sb3_piano.lab.results.aggregates import Aggregate, aggregate
from sb3_piano.lab.results.estimates import Estimate, decimals
from sb3_piano.lab.results.records import Result


def score_table(results: Sequence[Result]) -> str:
    """Return F1 and onset F1 by piece and player, and their means, as Markdown.

    Each has its standard error over rollouts; the variation between pieces is not included. Players
    without results on every piece have no mean, as it would not be comparable.
    """
    players = list(dict.fromkeys(result.player for result in results))
    pieces = list(dict.fromkeys(result.piece for result in results))
    by_key = {(result.piece, result.player): result for result in results}
    noop = {result.piece: result.noop_f1 for result in results}
    lines = [
        f"| piece | nothing | {' | '.join(players)} |",
        f"|---|---:|{'---:|' * len(players)}",
    ]
    for piece in pieces:
        found = [by_key.get((piece, player)) for player in players]
        cells = ["" if result is None else scores([result]) for result in found]
        lines.append(f"| {piece} | {noop[piece]:.3f} | {' | '.join(cells)} |")
    means = []
    for player in players:
        of_player = [result for result in results if result.player == player]
        means.append(scores(of_player) if len(of_player) == len(pieces) else "")
    lines.append(f"| **mean** | {fmean(noop.values()):.3f} | {' | '.join(means)} |")
    return "\n".join(lines)


def scores(results: Sequence[Result]) -> str:
    """Format mean F1 and mean onset F1 for a cell."""
    of_each = ([Estimate.of(getattr(r, name)) for r in results] for name in ("f1", "onset_f1"))
    return " / ".join(str(Estimate.average(estimates)) for estimates in of_each)


def origin_table(results: Sequence[Result]) -> str:
    """Return the origin of each result, as Markdown."""
    head = (
        "| piece | player | seeds | CPU, s | score, sha256 | version | date | hardware | command |"
    )
    lines = [head, "|---|---|---|---:|---|---|---|---|---|"]
    for result in results:
        seeds = ", ".join(map(str, result.seeds))
        lines.append(
            f"| {result.piece} | {result.player} | {seeds} | {result.cpu_seconds:.1f} | "
            f"`{result.score_sha256[:12]}` | {result.package_version} | {result.date} | "
            f"{result.hardware} | `{result.command}` |"
        )
    return "\n".join(lines)


def aggregate_table(results: Sequence[Result]) -> str:
    """Return interquartile means with 95 % intervals of each player, as Markdown.

    Players are compared on the pieces played by all of them; those without a row are named.
    """
    players = list(dict.fromkeys(result.player for result in results))
    played = [{r.piece for r in results if r.player == player} for player in players]
    common = set.intersection(*played) if played else set()
    lines = [
        "| player | pieces | seeds | metric | IQM | 95 %, other seeds | 95 %, other pieces |",
        "|---|---:|---:|---|---:|---:|---:|",
    ]
    missing: list[str] = []
    for player in players:
        of_player = [r for r in results if r.player == player and r.piece in common]
        if len({len(result.seeds) for result in of_player}) != 1:
            why = "not as many seeds of each piece" if of_player else "no piece that all played"
            missing.append(f"No means of {player}: {why}.")
            continue
        for name in ("f1", "onset_f1"):
            found = aggregate([getattr(result, name) for result in of_player])
            label = "F1" if name == "f1" else "onset F1"
            lines.append(_aggregate_row(player, of_player, label, found))
    return "\n".join([*lines, *([""] if missing else []), *missing])


def _aggregate_row(player: str, results: Sequence[Result], label: str, found: Aggregate) -> str:
    low, high = found.over_seeds or (found.iqm, found.iqm)
    digits = decimals((high - low) / 4)  # which are some four standard errors
    ends = (
        "-" if interval is None else f"{interval[0]:.{digits}f} to {interval[1]:.{digits}f}"
        for interval in (found.over_seeds, found.over_pieces)
    )
    return (
        f"| {player} | {len(results)} | {len(results[0].seeds)} | {label} | "
        f"{found.iqm:.{digits}f} | {' | '.join(ends)} |"
    )
