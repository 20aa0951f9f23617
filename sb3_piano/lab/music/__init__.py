"""Training music: generated pieces, and corpora of excerpts."""

from sb3_piano.lab.music.corpus import Corpus
from sb3_piano.lab.music.corpus_excerpt import CorpusExcerpt
from sb3_piano.lab.music.generation import generate_score

__all__ = ["Corpus", "CorpusExcerpt", "generate_score"]
