"""The rules of fingering as first published, see ``data/music/published_rules.yml``."""

from dataclasses import fields
from pathlib import Path

import yaml

from sb3_piano.music.fingering.cost import FingeringWeights

_RULES = yaml.safe_load(
    (Path(__file__).parents[1] / "data" / "music" / "published_rules.yml").read_text()
)
PARNCUTT_WEIGHTS = FingeringWeights(
    **{field.name: _RULES["points"].get(field.name, 0.0) for field in fields(FingeringWeights)}
)
PARNCUTT_HAND = {
    tuple(map(int, pair.split("-"))): tuple(distances) for pair, distances in _RULES["hand"].items()
}
