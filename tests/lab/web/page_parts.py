"""The page in a real browser: built once, opened from a disk or from a server of this process."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

from sb3_piano.lab.web import export_web
from sb3_piano.music import load_score

WEB = Path(__file__).parents[3] / "web"

BROKEN_CHORD, MELODY = "arpeggio-CMajor", "debug-TwinkleTwinkleLittleStar"
"""Short pieces that the page of the tests has."""

LISTEN = "repertoire-OdeToJoy"
"""Piece of whose beginning there are takes without and with dynamics and pedal."""

PARITY_PIECES = [
    *("repertoire-FantaisieImpromptu", "repertoire-MapleLeafRag", "repertoire-ClairDeLune"),
    *("repertoire-ChopinNocturneOp9No2", "repertoire-PathetiqueRondo", "repertoire-BachPreludeC"),
    *("repertoire-FurElise", "repertoire-Reverie", "hanon-05", "scale-Chromatic"),
    "debug-CMajorChordProgressionTwoHands",
]
"""Pieces that page and Python read and finger alike."""

# Notes of the graphics driver that pictures are read back, which screenshots do.
_HARMLESS = re.compile(r"GPU stall due to ReadPixels")


class Built:
    """The page in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.one_file = folder / "piano.html"
        catalogue = json.loads((folder / "assets" / "catalogue.json").read_text("utf-8"))
        self.pieces = {piece["id"]: piece for piece in catalogue["pieces"]}
        self.first = catalogue["pieces"][0]


def build_page(folder: Path) -> Built:
    """Export three pieces and build the page of them."""
    takes = sorted((WEB / "recordings").glob("ode_to_joy_*.npz"))
    longer = load_score(LISTEN).trim_silence().excerpt(0.0, 11.0)
    export_web(folder / "exported", [BROKEN_CHORD, MELODY, longer], takes=takes)
    options = ["--assets", str(folder / "exported"), "--out", str(folder / "dist")]
    subprocess.run(["node", "build.mjs", *options], cwd=WEB, check=True, capture_output=True)
    return Built(folder / "dist")


class PianoTab:
    """A tab with the page in it, which notes down what should not happen."""

    def __init__(self, context: Any, address: str) -> None:
        self.complaints: list[str] = []
        # Whatever is asked of another machine is noted down and refused.
        own = re.escape(address.partition("index.html")[0])
        context.route(re.compile(f"^(?!{own}|file:|data:|blob:)"), self._refuse)
        self.page = context.new_page()
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.open(address)

    def open(self, address: str) -> None:
        """Open the page, and wait until its piece is there."""
        self.page.goto(address)
        self.page.evaluate("async () => { window.opened = await piano.ready; }")

    def load(self, piece: str, player: str) -> None:
        """Put a piece and a player on."""
        self.page.evaluate("([piece, player]) => opened.load(piece, player)", [piece, player])

    def advance(self, steps: int) -> dict[str, float]:
        """Play so many control steps, and return the metrics so far."""
        return dict(self.page.evaluate("steps => opened.advance(steps)", steps))

    def steps(self) -> tuple[int, int]:
        """Return the control steps that are played, and those of the piece."""
        steps = self.page.evaluate("opened.steps()")
        return steps["played"], steps["total"]

    def play_all(self, piece: str, player: str) -> dict[str, float]:
        """Let a player play a piece to its end, and return the metrics."""
        self.load(piece, player)
        _, total = self.steps()
        metrics = self.advance(total)
        assert self.steps() == (total, total)
        return metrics

    def sounding(self) -> list[int]:
        """Return the keys that sound."""
        return list(self.page.evaluate("opened.sounding()"))

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.page.locator(selector).inner_text())

    def _console(self, message: Any) -> None:
        if not _HARMLESS.search(message.text):
            self.complaints.append(message.text)

    def _refuse(self, route: Any) -> None:
        self.complaints.append(route.request.url)
        route.abort()
