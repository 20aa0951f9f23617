"""Corpora: performances of many pieces, recorded by many processes, to learn from."""

from sb3_piano.corpora.config import DEFAULT_NOISE, CorpusConfig
from sb3_piano.corpora.making import PlayedSo, record_corpus, summary
from sb3_piano.demonstrations.corpus import RecordedCorpus

__all__ = [
    "DEFAULT_NOISE",
    "CorpusConfig",
    "PlayedSo",
    "RecordedCorpus",
    "record_corpus",
    "summary",
]
