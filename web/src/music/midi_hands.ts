/** Hand of a track of a MIDI file, as far as the file tells. */

type Hand = 0 | 1;

/** A note, from one tick to another. */
export interface MidiNote {
  readonly start: number;
  readonly end: number;
  readonly pitch: number;
  readonly velocity: number;
}

/** The notes of one program in a track. */
export interface MidiTrack {
  readonly name: string;
  readonly program: number;
  readonly notes: MidiNote[];
}

/** Words that name the right and the left hand wherever they stand in the name of a track. */
const PHRASES = [
  ["right hand", "righthand", "rh", "rechte hand", "main droite", "mano destra", "mano derecha"],
  ["left hand", "lefthand", "lh", "linke hand", "main gauche", "mano sinistra", "mano izquierda"],
] as const;

/** Words that name a hand only where nothing but a piano is named beside them: not "Guitar left". */
const BARE: readonly (readonly string[])[] = [
  ["right", "upper", "upper staff", "treble", "treble clef", "treble staff", "rechts", "droite", "md"],
  ["left", "lower", "lower staff", "bass clef", "bass staff", "links", "gauche", "mg", "ms"],
];

const PIANO = new Set([
  "piano", "pianoforte", "pno", "pf", "klavier", "clavier",
  "keyboard", "keys", "grand", "acoustic", "solo", "track", "part",
]);

/** The first programs of General MIDI are pianos, the harpsichord and the clavinet among them. */
const LAST_PIANO = 7;

/** Semitones between the middles of two tracks that make them the two hands: a fifth. */
const LEAST_DISTANCE = 7;

const MOST_STRUCK_AT_ONCE = 5;

/**
 * Return the hand of each track that has notes (no drums), null where the file does not tell.
 *
 * The names decide. Where no name tells anything, two tracks of one piano are the two hands if the
 * medians of their pitches are at least a fifth apart and neither strikes more than five keys at a time:
 * the higher one is the right hand.
 */
export function handsOfTracks(tracks: readonly MidiTrack[]): (Hand | null)[] {
  const hands = tracks.map((track) => handOfName(track.name));
  if (hands.every((hand) => hand === null) && areOfOnePiano(tracks) && !tracks.some(isTooFull)) {
    const [first, second] = tracks.map(medianPitch) as [number, number];
    if (Math.abs(first - second) >= LEAST_DISTANCE) return first > second ? [0, 1] : [1, 0];
  }
  return hands;
}

/**
 * Return the hand that the name of a track tells: "Piano RH", "main gauche".
 *
 * Case, digits, punctuation and the word piano do not matter. A name that tells both hands or another
 * instrument as well ("Guitar left") tells neither.
 */
export function handOfName(name: string): Hand | null {
  const apart = name.replace(/(?<=[a-z])(?=[A-Z])/g, " ").toLowerCase();
  const words = apart.replace(/(?:[^\p{L}\p{N}]|\p{Nd})+/gu, " ").trim();
  // Initials are one word: R.H. and m. d.
  const text = words.replace(/(?<![\p{L}\p{N}])([rlm]) ([hdgs])(?![\p{L}\p{N}])/gu, "$1$2");
  const bare = text.split(" ").filter((word) => !PIANO.has(word)).join(" ");
  const told = ([0, 1] as const).filter(
    (hand) =>
      BARE[hand]!.includes(bare) || PHRASES[hand].some((phrase) => ` ${text} `.includes(` ${phrase} `)),
  );
  return told.length === 1 ? told[0]! : null;
}

function areOfOnePiano(tracks: readonly MidiTrack[]): boolean {
  const [first, second] = tracks;
  if (tracks.length !== 2 || !first || !second) return false;
  return first.program === second.program && first.program <= LAST_PIANO;
}

/** Return whether a track strikes more keys at a time than a hand does. */
function isTooFull(track: MidiTrack): boolean {
  const struck = new Map<number, number>();
  for (const { start } of track.notes) struck.set(start, (struck.get(start) ?? 0) + 1);
  return [...struck.values()].some((count) => count > MOST_STRUCK_AT_ONCE);
}

function medianPitch(track: MidiTrack): number {
  const pitches = track.notes.map((note) => note.pitch).sort((a, b) => a - b);
  const middle = pitches.length >> 1;
  return pitches.length % 2 ? pitches[middle]! : (pitches[middle - 1]! + pitches[middle]!) / 2;
}
