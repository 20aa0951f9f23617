"""Random scores for round trips through files."""

import itertools

from hypothesis import strategies as st

from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Pedal, Score

FINGERS = [(finger, None) for finger in range(10)]
HANDS = [(-1, "right"), (-1, "left")]


@st.composite
def scores(draw, labels):
    """Scores whose notes of one label on one key do not overlap, nor its presses of the pedal."""
    gaps = st.floats(0.001, 2.0) | st.sampled_from([0.25, 0.5, 1.0])
    notes = []
    voices = st.tuples(st.integers(MIN_PITCH, MAX_PITCH), st.sampled_from(labels))
    for pitch, (finger, hand) in draw(st.lists(voices, min_size=1, max_size=6, unique=True)):
        time = 0.0
        for _ in range(draw(st.integers(1, 4))):
            onset = time + draw(st.just(0.0) | gaps)
            time = onset + draw(gaps)
            label = {"velocity": draw(st.integers(1, 127)), "finger": finger, "hand": hand}
            notes.append(Note(onset=onset, offset=time, pitch=pitch, **label))
    pedals, time = [], 0.0
    for _ in range(draw(st.integers(0, 3))):
        onset = time + draw(gaps)
        time = onset + draw(gaps)
        pedals.append(Pedal(onset=onset, offset=time))
    lengths = draw(st.lists(gaps | st.sampled_from([0.75, 1.5, 2.0]), max_size=6))
    bars = list(itertools.accumulate(lengths))
    return Score(notes=notes, pedals=pedals, title="piece", bars=bars)


def canonical(score):
    """Notes in an order that a shift of a tick cannot change, within their voices."""
    return sorted(
        score.notes, key=lambda note: (note.pitch, note.finger, note.hand or "", note.onset)
    )


def kept(notes):
    """What a file keeps of notes exactly."""
    return [(note.pitch, note.velocity, note.finger, note.hand) for note in notes]


def all_times(events):
    """Onset and offset of one event after the other, s."""
    return [time for event in events for time in (event.onset, event.offset)]
