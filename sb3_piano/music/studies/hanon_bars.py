"""The bars of Hanon's exercises, as `hanon` puts them together.

Degrees count the white keys from the first C of each hand (the last C for the way down), which is
0; fingers are the pianists' numbers, one digit a note.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sb3_piano.music.hands import Hand


class HanonBar:
    """One bar, which both hands play an octave apart.

    Attributes:
        degrees: Its notes, in degrees of the scale.
        fingers: The fingers' numbers, by hand.
    """

    def __init__(self, degrees: str, right: str, left: str) -> None:
        """Read the degrees, with spaces between them, and the digits of the fingers."""
        self.degrees = tuple(map(int, degrees.split()))
        self.fingers: Mapping[Hand, tuple[int, ...]] = {
            "right": tuple(map(int, right)),
            "left": tuple(map(int, left)),
        }


@dataclass(frozen=True, kw_only=True)
class Exercise:
    """One exercise: a bar that climbs a degree each time, and one that falls.

    Attributes:
        up: The bar that climbs, where it would stand first.
        down: The bar that falls, where it stands first; degrees from the last C.
        opening: The first bar, if it is another than `up`.
        top: The last bar on the way up, if it is altered; degrees from the last C.
        bottom: The last bar on the way down, if it is altered; degrees from the first C.
        more_up: Bars on the way up beyond seven an octave.
        more_down: The same on the way down.
        right_end: The right hand's last notes: degrees, each with the number of its finger.
        left_end: The left hand's.
    """

    up: HanonBar
    down: HanonBar
    opening: HanonBar | None = None
    top: HanonBar | None = None
    bottom: HanonBar | None = None
    more_up: int = 0
    more_down: int = 0
    right_end: tuple[tuple[int, int], ...] = ((0, 1),)
    left_end: tuple[tuple[int, int], ...] = ((0, 5),)


EXERCISES: Mapping[int, Exercise] = MappingProxyType(
    {
        1: Exercise(
            up=HanonBar("0 2 3 4 5 4 3 2", "12345432", "54321234"),
            down=HanonBar("4 2 1 0 -1 0 1 2", "54321234", "12345432"),
            more_down=1,
        ),
        2: Exercise(
            up=HanonBar("0 2 5 4 3 4 3 2", "12543432", "53123234"),
            down=HanonBar("4 1 -1 0 1 0 1 2", "52123234", "13543432"),
        ),
        3: Exercise(
            up=HanonBar("0 2 5 4 3 2 3 4", "12543234", "53123432"),
            down=HanonBar("4 1 -1 0 1 2 1 0", "52123432", "13543234"),
        ),
        4: Exercise(
            up=HanonBar("0 1 0 2 5 4 3 2", "12125432", "54531234"),
            down=HanonBar("4 3 4 1 -1 0 1 2", "54521234", "12135432"),
        ),
        5: Exercise(
            up=HanonBar("0 5 4 5 3 4 2 3", "15453423", "51213243"),
            down=HanonBar("0 1 0 2 1 3 2 4", "12132435", "54534231"),
        ),
        6: Exercise(
            up=HanonBar("0 5 4 5 3 5 2 5", "15453525", "51213141"),
            top=HanonBar("-1 4 3 4 2 4 1 0", "15453521", "51213145"),
            down=HanonBar("4 -1 0 -1 1 -1 2 -1", "51213141", "15453525"),
            bottom=HanonBar("5 0 1 0 2 0 3 2", "51213143", "15453523"),
        ),
        7: Exercise(
            up=HanonBar("0 2 1 3 2 4 3 2", "13243543", "53423134"),
            top=HanonBar("-1 1 0 2 1 3 2 1", "13243532", "53423134"),
            down=HanonBar("4 2 3 1 2 0 1 2", "53423134", "13243543"),
            bottom=HanonBar("5 3 4 2 3 1 2 3", "53423134", "13243532"),
        ),
        8: Exercise(
            up=HanonBar("0 2 4 5 3 4 2 3", "12453423", "54213243"),
            down=HanonBar("4 2 0 -1 1 0 2 1", "54213243", "12453423"),
        ),
        9: Exercise(
            up=HanonBar("0 2 3 2 4 3 5 4", "12324354", "54342312"),
            down=HanonBar("4 2 1 2 0 1 -1 0", "54342312", "12324354"),
            bottom=HanonBar("5 3 2 3 1 2 1 2", "54342323", "12324343"),
        ),
        10: Exercise(
            up=HanonBar("0 5 4 3 2 3 2 3", "15432323", "51234343"),
            down=HanonBar("4 -1 0 1 2 1 2 1", "51234343", "15432323"),
        ),
        11: Exercise(
            up=HanonBar("0 2 5 4 5 4 3 4", "12545434", "53121232"),
            down=HanonBar("4 1 -1 0 -1 0 1 0", "52121232", "13545434"),
        ),
        12: Exercise(
            opening=HanonBar("4 0 2 1 0 1 2 0", "51321231", "15345435"),
            up=HanonBar("5 0 2 1 0 1 2 0", "51321231", "15345435"),
            top=HanonBar("4 -1 1 0 -1 0 1 2", "51321234", "15345432"),
            down=HanonBar("-1 4 2 3 4 3 2 4", "15345435", "51321231"),
            bottom=HanonBar("0 4 2 3 4 3 2 3", "15345434", "51321232"),
            more_down=1,
        ),
        13: Exercise(
            up=HanonBar("2 0 3 1 4 2 3 4", "31425345", "35241321"),
            down=HanonBar("2 4 1 3 2 0 1 2", "35243134", "31423532"),
        ),
        14: Exercise(
            up=HanonBar("0 1 3 2 3 2 4 3", "12434354", "54232313"),
            top=HanonBar("-1 0 2 1 2 1 3 2", "12434353", "54232313"),
            down=HanonBar("4 3 1 2 1 2 0 1", "54232313", "12434354"),
            bottom=HanonBar("5 4 2 3 2 3 1 2", "54232313", "12434353"),
        ),
        15: Exercise(
            up=HanonBar("0 2 1 3 2 4 3 5", "12132435", "53423121"),
            top=HanonBar("-1 1 0 2 1 3 2 3", "12132434", "53423121"),
            down=HanonBar("4 2 3 1 2 0 1 -1", "53423121", "12132435"),
            bottom=HanonBar("5 3 4 2 3 1 2 1", "53423132", "12132434"),
        ),
        16: Exercise(
            up=HanonBar("0 2 1 2 5 4 3 4", "13235434", "53431232"),
            down=HanonBar("4 1 2 1 -1 0 1 0", "52321232", "13235434"),
        ),
        17: Exercise(
            up=HanonBar("0 2 5 4 6 5 4 5", "12435434", "54231232"),
            top=HanonBar("-1 1 4 3 5 4 3 2", "12435432", "54231234"),
            down=HanonBar("4 1 -1 0 -2 -1 0 -2", "53231231", "12435435"),
            bottom=HanonBar("6 3 1 2 0 1 2 1", "53231232", "12435434"),
            more_down=-1,
        ),
        18: Exercise(
            up=HanonBar("0 1 3 2 4 3 1 2", "12435423", "54231243"),
            top=HanonBar("-1 0 2 1 3 2 0 1", "12435412", "54231254"),
            down=HanonBar("4 3 1 2 0 1 3 2", "54231243", "12435423"),
            bottom=HanonBar("5 4 2 3 1 2 4 3", "54231354", "12435412"),
        ),
        19: Exercise(
            up=HanonBar("0 5 3 4 5 3 2 4", "15345324", "51321342"),
            down=HanonBar("4 -1 1 0 -1 1 2 0", "51321342", "15345324"),
        ),
        20: Exercise(
            up=HanonBar("2 4 7 9 7 6 7 5", "12454342", "54212324"),
            top=HanonBar("2 4 7 9 7 6 7 4", "12454342", "54212324"),
            down=HanonBar("9 7 4 2 4 3 4 2", "54213231", "12453435"),
            bottom=HanonBar("9 7 4 2 4 3 4 3", "54213232", "12453434"),
            more_up=1,
            more_down=1,
            right_end=((2, 1), (7, 5)),
            left_end=((0, 5), (7, 1)),
        ),
    }
)
"""Exercises 1 to 20 by number."""
