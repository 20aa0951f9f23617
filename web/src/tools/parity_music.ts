/** The music room for Python's tests: a request (JSON) on each line of the standard input, an answer on each line out. */

import { createInterface } from "node:readline";
import { isArchive, unzip } from "../archive";
import { InputError, NUM_KEYS, type KeyEvent, type Metrics, type Score } from "../types";
import { speedOf, velocityOf } from "../music/dynamics";
import { applyFingering, fingerScore } from "../music/fingering/apply";
import { CostTables } from "../music/fingering/cost";
import { releaseEarly } from "../music/fingering/robot";
import { EpisodeMetrics } from "../music/metrics";
import { musicianship } from "../music/musicianship";
import { readMidi } from "../music/midi";
import { handOfName } from "../music/midi_hands";
import { documentOf, readMusicXml } from "../music/musicxml";
import { pieceOf } from "../music/piece";
import { pressesOfHand } from "../music/presses";
import { rollOf } from "../music/roll";
import { makeScore } from "../music/score";

/** Parts of a request; which are there depends on what is asked. */
interface Request {
  readonly ask: string;
  readonly name: string;
  /** A file in base64. */
  readonly bytes: string;
  readonly score: Pick<Score, "title" | "notes" | "pedals">;
  readonly controlTimestep: number;
  readonly initialBufferTime: number;
  readonly speeds: readonly number[];
  readonly velocities: readonly number[];
  /** Keys that moved in so many control steps. */
  readonly events: readonly KeyEvent[];
  readonly steps: number;
  /** For each control step that was played the keys that sounded at its end, and those that went down in it. */
  readonly played: readonly { readonly keys: readonly number[]; readonly strikes: readonly Strike[] }[];
}

interface Strike {
  readonly key: number;
  readonly time: number;
}

const ANSWERS: Readonly<Record<string, (request: Request) => unknown>> = {
  midi: ({ bytes, name }) => readMidi(Buffer.from(bytes, "base64"), name),
  musicxml: async ({ bytes, name }) => {
    const file = Buffer.from(bytes, "base64");
    const files = isArchive(file) ? await unzip(file, name) : null;
    return readMusicXml(documentOf(file, files, name) ?? "", name);
  },
  hand: ({ name }) => handOfName(name),
  velocities: ({ speeds }) => speeds.map((speed, at) => velocityOf(speed, at % NUM_KEYS)),
  speeds: ({ velocities }) => velocities.map((velocity, at) => speedOf(velocity, at % NUM_KEYS)),
  costs: () => plain(new CostTables()),
  pianist: (request) => fingerScore(scoreOf(request)),
  robot: (request) => applyFingering(scoreOf(request), request.controlTimestep),
  roll: (request) => plain(rollOf(scoreOf(request), request.controlTimestep, request.initialBufferTime)),
  held: (request) => {
    const roll = releaseEarly(rollOf(scoreOf(request), request.controlTimestep));
    return { ...plain(roll), presses: [pressesOfHand(roll, 0), pressesOfHand(roll, 1)] };
  },
  piece: (request) => {
    const piece = pieceOf(request.name, scoreOf(request));
    return { ...piece, roll: plain(piece.roll) };
  },
  metrics: (request) => metricsOf(request),
  musicianship: (request) => {
    const { controlTimestep, initialBufferTime: lead, events, steps } = request;
    const score = scoreOf(request);
    return musicianship({ id: "", score, roll: rollOf(score, controlTimestep), warnings: [], lead }, events, steps);
  },
};

/** The metrics after each control step. */
function metricsOf(request: Request): Metrics[] {
  const judge = new EpisodeMetrics(rollOf(scoreOf(request), request.controlTimestep));
  return request.played.map(({ keys, strikes }) => {
    const sounding = new Uint8Array(NUM_KEYS);
    for (const key of keys) sounding[key] = 1;
    judge.add(sounding, strikes);
    return judge.metrics();
  });
}

function scoreOf({ score }: Request): Score {
  return makeScore(score.notes, score.pedals, score.title);
}

/** Arrays of numbers as JSON has them. */
function plain(value: object): object {
  const entries = Object.entries(value).map(([name, part]: [string, unknown]) => {
    return [name, ArrayBuffer.isView(part) ? Array.from(part as Uint8Array) : part];
  });
  return Object.fromEntries(entries) as object;
}

async function answer(request: Request): Promise<unknown> {
  try {
    return { answer: await ANSWERS[request.ask]!(request) };
  } catch (error) {
    if (error instanceof InputError) return { refused: error.message };
    throw error;
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(`${JSON.stringify(await answer(JSON.parse(line) as Request))}\n`);
}
