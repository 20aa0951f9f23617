"""RoboPianist's names for the pieces of the PIG data set, which are known before its import.

The data set (Nakamura, Saito and Yoshii 2020) may not be passed on. RoboPianist names its 150
pieces by their titles in the list that comes with it; those names that public code mentions are
below, the others are known once the data set has been imported.

Source of the names: RoboPianist (`robopianist/music/__init__.py`) for the twelve etudes; for the
others the environment ids in azadsalam/robopianist-cl, in OmniPiano and in the table of the data
set well-balanced/cantabile-runs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

from sb3_piano.exceptions import UnknownPieceError
from sb3_piano.music.library.imported import user_library
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score

REPERTOIRE_COLLECTION, ETUDE_COLLECTION = "repertoire-150", "etude-12"

PIG_SITE = "https://beam.kisarazu.ac.jp/~saito/research/PianoFingeringDataset/"

_ETUDE_NAMES = """
FrenchSuiteNo1Allemande FrenchSuiteNo5Sarabande PianoSonataD8451StMov PartitaNo26 WaltzOp64No1
BagatelleOp3No4 KreislerianaOp16No8 FrenchSuiteNo5Gavotte PianoSonataNo232NdMov
GolliwoggsCakewalk PianoSonataNo21StMov PianoSonataK279InCMajor1StMov
"""

ETUDES = tuple(_ETUDE_NAMES.split())
"""RoboPianist's names of its twelve etudes, in its order."""

_OTHER_NAMES = """
BalladeNo1 BalladeNo2 CarnivalOp37ANo2 ClairDeLune EnglishSuiteNo2Prelude
EnglishSuiteNo3Prelude EtudeOp10No12 EtudeOp10No3 EtudeOp25No11 FantaisieImpromptu
FantasieStuckeOp12No7 ForElise FrohlicherLandmannOp68No10 GrandeValseBrillanteOp18
HumoreskeOp101No7 ImpromptuOp90No4 ItalianConverto1StMov JeTeVeux JeuxDeau KinderszenenOp15No1
KreislerianaOp16No1 KreislerianaOp16No3 LaChasseOp19No3 LaFilleAuxCheveuxDeLin
LyricPiecesOp43No1 LyricPiecesOp62No2 MapleLeafRag MazurkaOp7No1 MusicalMomentOp16No4 NocturneOp9No2
NorwegianDanceOp35No3 PartitaNo42 PavanePourUneInfanteDefunte PeerGyntOp46No2 PianoSonata1StMov
PianoSonataK281InBbMajor1StMov PianoSonataK282InEbMajorMinuet1 PianoSonataK283InGMajor1StMov
PianoSonataK284InDMajor1StMov PianoSonataK284InDMajor3RdMov PianoSonataK332InFMajor3RdMov
PianoSonataK457InCMinor3RdMov PianoSonataK570InBbMajor1StMov PianoSonataK576InDMajor2NdMov
PianoSonataK576InDMinor1StMov PianoSonataNo141StMov PianoSonataNo142NdMov PianoSonataNo143RdMov
PianoSonataNo213RdMov PianoSonataNo241StMov PianoSonataNo242NdMov PianoSonataNo281StMov
PianoSonataNo301StMov PianoSonataNo303RdMov PianoSonataNo41StMov PianoSonataNo43RdMov
PianoSonataNo5 PianoSonataNo51StMov PianoSonataNo82NdMov PicturesAtAnExhibitionGreatKiev
PicturesAtAnExhibitionPromenade PolonaiseFantasieOp61 PolonaiseOp40No1 PolonaiseOp53
PreludeOp23No5 PreludeOp28No19 PreludeOp28No7 PreludeOp3No2 Reverie RomanianDanceNo1 ScherzoNo2
Sicilienne SinfoniaNo12 SonataInAMajorK208 Sonatine1StMov SongWithoutWordsOp19No1
SuiteBergamasquePasspied SuiteBergamasquePrelude SuiteEspanolaOp45No1 TwoPartInventionInCMajor
TwoPartInventionInCMinor TwoPartInventionInDMajor VenetianischesGondelliedOp30No6 WaltzOp39No15
WaltzOp64No2 WaltzOp69No2 WandererFantasy WellTemperedClavierBookIPreludeNo23InBMajor
WellTemperedClavierBookIPreludeNo2InCMinor WellTemperedClavierBookIPreludeNo7InEbMajor
WellTemperedClavierBookIiPreludeNo11InFMajor
"""


def _load(name: str) -> Score:
    library = user_library()
    if name in library:
        return library.score(name)
    raise UnknownPieceError(
        f"Piece {name!r} is of the PIG data set, which is not imported yet and may not be passed "
        f"on: register at {PIG_SITE}, unzip what you get, and import it with 'sb3-piano pieces "
        "import PianoFingeringDataset_v1.2'."
    )


def _piece(collection: str, short: str) -> Piece:
    name = f"{collection}-{short}"
    return Piece(
        name=name,
        # A space before each capital letter and number, but not within "2Nd" or "K279".
        title=re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=\d)(?=[A-Z][a-z]{2})", " ", short),
        collection=collection,
        source="the PIG data set, not imported yet",
        fingering="PIG",
        build=partial(_load, name),
    )


PIG_PIECES: Mapping[str, Piece] = MappingProxyType(
    {
        piece.name: piece
        for piece in (
            *(_piece(ETUDE_COLLECTION, short) for short in ETUDES),
            *(
                _piece(REPERTOIRE_COLLECTION, short)
                for short in sorted({*ETUDES, *_OTHER_NAMES.split()})
            ),
        )
    }
)
"""The pieces of the PIG data set by name; making one that is not imported says how to get it."""
