/**
 * Sessions for Python's tests: a request (JSON) on each line of the standard input, an answer on each line out. A
 * request names a folder of `sb3-piano export web`, a piece of its catalogue and a player.
 */

import { createInterface } from "node:readline";

import { musicianship } from "../music/musicianship";
import { pieceOf } from "../music/piece";
import { Sessions } from "../players/session";
import { InputError, type Catalogue, type KeyEvent, type PlayerId, type Score, type Session } from "../types";
import { FolderAssets } from "./folder_assets";

/** What a visitor does before a control step. */
type Touch =
  | { readonly step: number; readonly key: number; readonly down: boolean }
  | { readonly step: number; readonly body: string | null; readonly force: Vector; readonly at: Vector };

type Vector = [number, number, number];

interface Request {
  readonly folder: string;
  readonly piece: string;
  readonly player: PlayerId;
  /** How many control steps to play; left out, all. */
  readonly steps?: number;
  /** How often to play them: from the second time on after `restart`. */
  readonly times?: number;
  readonly noise?: number;
  readonly latency?: number;
  readonly touches?: readonly Touch[];
}

/** A session of each folder's scene is loaded once. */
const loaded = new Map<string, Promise<Sessions>>();

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(`${JSON.stringify(await answer(JSON.parse(line) as Request))}\n`);
}

async function answer(request: Request): Promise<object> {
  try {
    return { answer: await play(request) };
  } catch (error) {
    return { refused: (error as Error).message };
  }
}

async function play({ folder, piece: id, player, steps, times = 1, noise, latency, touches = [] }: Request) {
  const assets = new FolderAssets(folder);
  if (!loaded.has(folder)) loaded.set(folder, Sessions.load(assets));
  const sessions = await loaded.get(folder)!;
  const { pieces } = await assets.json<Catalogue>("catalogue.json");
  const entry = pieces.find((one) => one.id === id);
  if (entry === undefined) throw new InputError(`There is no piece ${id}.`);
  const piece = pieceOf(id, await assets.json<Score>(entry.score!));
  const session = await sessions.open(piece, player, entry, null);
  session.noise = noise ?? 0;
  session.latency = latency ?? 0;
  const answers = [];
  for (let time = 0; time < times; time++) {
    if (time > 0) session.restart();
    answers.push(episode(session, sessions, steps ?? piece.roll.steps, touches));
  }
  return answers;
}

function episode(session: Session, { simulation }: Sessions, steps: number, touches: readonly Touch[]) {
  const events: KeyEvent[] = [];
  const qpos = [];
  for (let step = 0; step < steps; step++) {
    for (const touch of touches.filter((one) => one.step === step)) {
      if ("key" in touch) session.pushKey(touch.key, touch.down);
      else session.pull(touch.body, touch.force, touch.at);
    }
    events.push(...session.step());
    qpos.push([...simulation.qpos]);
  }
  const { state } = session;
  return {
    metrics: session.metrics(),
    musicianship: musicianship(session.piece, events, session.stepsPlayed),
    events,
    qpos,
    played: [...session.played()],
    finished: session.finished,
    bodies: Object.fromEntries(
      state.bodyNames.map((name, body) => [name, [...state.bodyPositions.slice(3 * body, 3 * body + 3)]]),
    ),
    keyState: [...state.keyState],
  };
}
