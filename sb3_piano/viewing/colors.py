"""Which colour means what, in every picture."""

from __future__ import annotations

# Okabe and Ito's palette, which people with colour-blindness can tell apart, without its greens:
# green says that a key sounds.
_THUMB_TO_LITTLE = (
    (0.84, 0.37, 0.00, 1.0),  # vermillion
    (0.00, 0.45, 0.70, 1.0),  # blue
    (0.94, 0.89, 0.26, 1.0),  # yellow
    (0.80, 0.47, 0.65, 1.0),  # reddish purple
    (0.34, 0.71, 0.91, 1.0),  # sky blue
)

FINGER_COLORS = _THUMB_TO_LITTLE * 2
"""RGBA of each finger label 0-9: the same for both hands, thumb to little finger."""

UNLABELLED_COLOR = (0.55, 0.55, 0.62, 1.0)
"""RGBA of a key that is due without a finger label."""

PRESSED_COLOR = (0.13, 0.72, 0.25, 1.0)
"""RGBA of a key that sounds."""
