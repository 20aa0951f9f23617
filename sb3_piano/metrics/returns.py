"""Returns on a scale that pieces share."""

from __future__ import annotations


def normalized_return(value: float, highest: float) -> float:
    """Return the share of the highest return that the piece allows: ``value / highest``.

    It is below 0 if the costs outweigh the rewards.

    Args:
        value: The return.
        highest: The highest return that the piece allows, at least 0.

    Returns:
        The share; 1.0 if the highest return is 0, as in a piece without a step.
    """
    return float(value / highest) if highest else 1.0
