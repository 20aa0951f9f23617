import { musicianship, type Musicianship } from "../music/musicianship";
import type { Assets, Metrics, PlayerId, Session } from "../types";
import { paintLegend } from "../view/legend";
import { qualityFor } from "../view/quality";
import { RollView } from "../view/roll";
import { SceneView } from "../view/scene";
import { PianoSound } from "../view/sound";
import { loadStage } from "../view/stage";
import { App } from "./app";
import { connectControls } from "./controls";
import { findElements, type Elements } from "./elements";
import { Library, type Chosen } from "./library";
import { Pointer } from "./pointer";
import { Visitor } from "./visitor";
import { hear } from "./visitor_keys";

/** Control steps that are played before the browser may do something else. */
const STEPS_AT_ONCE = 100;

/** What makes a session of a piece and a player. */
export type MakeSession = (chosen: Chosen, player: PlayerId) => Promise<Session>;

/** The page by program, as `window.piano`: it is stepped by count, whatever the time. */
export interface PianoPage {
  /** Load a piece of the catalogue, or a file, with a player, at its beginning. */
  load(piece: string | Uint8Array, player: PlayerId): Promise<void>;
  /** Play so many control steps, or fewer if the piece ends. */
  advance(steps: number): Promise<Metrics>;
  metrics(): Metrics;
  /** Loudness, chords, timing and legato so far; null where the score is not known. */
  musicianship(): Musicianship | null;
  /** Control steps played, and those of the piece. */
  steps(): { played: number; total: number };
  /** Take up a message of a MIDI keyboard. */
  midi(message: readonly number[]): void;
  /** Keys, 0-87, that sound. */
  sounding(): number[];
  /** The key or the body at a point of the page, in CSS pixels; null if there is neither. */
  at(x: number, y: number): number | string | null;
  /** Place of a body, m. */
  place(body: string): number[];
  /** Draw pictures one after the other; return how many there have been. */
  draw(pictures: number): number;
  /** Root mean square of the sound, and whether it comes from samples. */
  sound(): { level: number; sampled: boolean };
  /** Go to a time, s. */
  seek(time: number): Promise<void>;
}

/** Build the page from its files, and return it once the piece of the link is there. */
export async function start(assets: Assets, open: (assets: Assets) => Promise<MakeSession>): Promise<PianoPage> {
  const elements = findElements();
  paintLegend(document);
  const sound = new PianoSound(assets);
  sound.volume = Number(elements.volume.value);
  sound.flat = !elements.dynamics.checked;
  const [library, makeSession, stage] = await Promise.all([Library.open(assets), open(assets), loadStage(assets)]);
  const app = new App({ elements, library, sound, roll: new RollView(elements.roll), makeSession });
  const visitor = new Visitor(
    () => (app.player === "you" ? app.session : null),
    sound,
    () => app.playback?.playing === true,
  );
  app.visitor = visitor;
  connectControls(app, elements, sound, visitor);
  const fitAll = fit(app, elements);
  app.onFirstSession = (session) => {
    showScene(app, elements, stage, session);
    fitAll();
  };
  await app.follow(location.hash);
  run(app);
  return pageOf(app, library, sound, visitor);
}

/** Add the picture; a browser without WebGL has the piano roll, the sound and the words. */
function showScene(app: App, elements: Elements, stage: Awaited<ReturnType<typeof loadStage>>, session: Session): void {
  try {
    app.view = new SceneView(elements.scene, stage, session.state, qualityFor(location.search));
  } catch (error) {
    const reason = error instanceof Error ? error.message : String(error);
    app.say(`There is no picture of the hands, as this browser cannot draw in three dimensions: ${reason}`);
    return;
  }
  app.view.showPiece(session.piece);
  app.view.look(app.viewName, false);
  const pointer = new Pointer(elements.scene, app.view, () => app.session, () => app.wake());
  app.beforeStep = () => pointer.apply();
  for (const name of ["pointerdown", "wheel"]) elements.scene.addEventListener(name, () => app.wake(true));
  elements.scene.addEventListener("pointermove", (event) => {
    if (event.buttons !== 0) app.wake(true);
  });
}

/** Keep picture and piano roll as large as their places on the page; return what makes them so now. */
function fit(app: App, elements: Elements): () => void {
  const fitAll = (): void => {
    const { clientWidth: width, clientHeight: height } = elements.stage;
    if (width > 0 && height > 0) app.view?.resize(width, height, devicePixelRatio);
    app.resizeRoll(elements.roll.clientWidth, elements.roll.clientHeight, devicePixelRatio);
    app.wake();
    app.draw(0);
  };
  const observer = new ResizeObserver(fitAll);
  observer.observe(elements.stage);
  observer.observe(elements.roll);
  fitAll();
  return fitAll;
}

function run(app: App): void {
  let last = performance.now();
  const frame = (now: number): void => {
    app.frame(Math.max(0, now - last) / 1000);
    last = now;
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

function pageOf(app: App, library: Library, sound: PianoSound, visitor: Visitor): PianoPage {
  const session = (): Session => {
    if (app.session === null) throw new Error("No piece is loaded.");
    return app.session;
  };
  return {
    async load(piece, player) {
      const find = () => (typeof piece === "string" ? library.piece(piece) : library.file(piece, "file.mid"));
      await app.load(find, player);
    },
    async advance(steps) {
      for (let left = steps; left > 0; left -= STEPS_AT_ONCE) {
        app.advance(Math.min(left, STEPS_AT_ONCE));
        await new Promise((resolve) => setTimeout(resolve));
      }
      return session().metrics();
    },
    metrics: () => session().metrics(),
    musicianship: () => musicianship(session().piece, app.events, session().stepsPlayed),
    steps: () => ({ played: session().stepsPlayed, total: session().piece.roll.steps }),
    midi: (message) => hear(Uint8Array.from(message), visitor),
    sounding: () => [...session().state.sounding.entries()].filter(([, on]) => on === 1).map(([key]) => key),
    at(x, y) {
      const hit = app.view?.touch(x, y)?.hit ?? null;
      return hit === null ? null : "key" in hit ? hit.key : hit.body;
    },
    place(body) {
      const { bodyNames, bodyPositions } = session().state;
      const index = bodyNames.indexOf(body);
      return [...bodyPositions.subarray(3 * index, 3 * index + 3)];
    },
    draw(pictures) {
      for (let i = 0; i < pictures; i++) app.draw(1 / 60);
      return app.frames;
    },
    sound: () => ({ level: sound.level(), sampled: sound.sampled }),
    seek: (time) => app.seek(time),
  };
}
