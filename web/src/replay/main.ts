/** The player in a report: a recorded performance in three dimensions, without a simulation. */
import { EmbeddedAssets } from "../assets";
import { Playback } from "../page/playback";
import { NUM_KEYS, type Metrics, type Piece } from "../types";
import type { View } from "../view/cameras";
import { qualityFor } from "../view/quality";
import { SceneView } from "../view/scene";
import { loadStage } from "../view/stage";
import { RecordedSession, type Recording } from "./recorded_session";

/** The JSON part of what Python writes; arrays are files beside it. */
interface Facts {
  readonly title: string;
  readonly bodyNames: readonly string[];
  readonly resolution: number;
  readonly controlTimestep: number;
  readonly metrics: Metrics;
}

async function recordingOf(assets: EmbeddedAssets): Promise<Recording> {
  const facts = await assets.json<Facts>("facts.json");
  const bytes = async (name: string): Promise<Uint8Array<ArrayBuffer>> => (await assets.bytes(name)).slice();
  const active = await bytes("active.bin");
  const steps = active.length / NUM_KEYS;
  const piece: Piece = {
    id: "",
    score: { title: facts.title, notes: [], pedals: [], duration: steps * facts.controlTimestep },
    roll: {
      controlTimestep: facts.controlTimestep,
      steps,
      active,
      finger: new Int8Array((await bytes("finger.bin")).buffer),
      onset: await bytes("onset.bin"),
      sustain: new Uint8Array(steps),
      strikes: [],
    },
    warnings: [],
    lead: null,
  };
  return {
    bodyNames: facts.bodyNames,
    poses: new Int16Array((await bytes("poses.bin")).buffer),
    resolution: facts.resolution,
    sounding: await bytes("sounding.bin"),
    piece,
    metrics: facts.metrics,
  };
}

function element<T extends HTMLElement>(root: HTMLElement, selector: string): T {
  const found = root.querySelector<T>(selector);
  if (found === null) throw new Error(`The report has no ${selector} in its player.`);
  return found;
}

async function start(root: HTMLElement): Promise<void> {
  const data = element(root, "script[type='application/json']");
  const assets = new EmbeddedAssets(JSON.parse(data.textContent ?? "") as Record<string, string>);
  const [stage, recording] = await Promise.all([loadStage(assets), recordingOf(assets)]);
  const session = new RecordedSession(recording);
  const canvas = element<HTMLCanvasElement>(root, "canvas");
  const view = new SceneView(canvas, stage, session.state, qualityFor(location.search));
  const playback = new Playback(session, { before: () => {}, after: () => {} });
  view.showPiece(session.piece);

  const play = element<HTMLButtonElement>(root, "[data-replay=play]");
  const place = element<HTMLInputElement>(root, "[data-replay=place]");
  // The report's own player; a performance of which nothing is heard has none.
  const sound = document.querySelector<HTMLAudioElement>("#sound");
  /** Let the sound be where the pictures are, and play if they do. */
  const sing = (): void => {
    if (sound === null) return;
    sound.currentTime = playback.shown;
    if (playback.playing) void sound.play().catch(() => {});
    else sound.pause();
  };
  const clock = element(root, "[data-replay=clock]");
  place.max = String(recording.sounding.length / NUM_KEYS);
  let drawn = false;
  const draw = (elapsed: number): void => {
    view.draw(playback.moment(), elapsed);
    place.value = String(session.stepsPlayed);
    clock.textContent = `${playback.shown.toFixed(1)} s`;
    play.textContent = playback.playing ? "Pause" : "Play";
    drawn = true;
  };
  play.addEventListener("click", () => {
    if (!playback.playing && session.finished) playback.restart();
    playback.playing = !playback.playing;
    sing();
    drawn = false;
  });
  place.addEventListener("input", () => {
    const steps = Number(place.value);
    playback.restart();
    playback.advance(steps);
    sing();
    drawn = false;
  });
  element<HTMLSelectElement>(root, "[data-replay=view]").addEventListener("change", (event) => {
    view.look((event.target as HTMLSelectElement).value as View, false);
    drawn = false;
  });
  canvas.addEventListener("pointermove", () => (drawn = false));
  canvas.addEventListener("wheel", () => (drawn = false));
  new ResizeObserver(() => {
    view.resize(canvas.clientWidth, canvas.clientHeight, devicePixelRatio);
    drawn = false;
  }).observe(canvas);
  root.dataset["steps"] = place.max;
  root.dataset["ready"] = "true";

  let last = performance.now();
  const frame = (now: number): void => {
    const elapsed = Math.max(0, now - last) / 1000;
    last = now;
    const moves = playback.playing;
    // Pictures follow the sound, which cannot wait.
    const heard = sound !== null && !sound.paused && sound.readyState >= HTMLMediaElement.HAVE_FUTURE_DATA;
    const behind = (): number => (heard ? sound.currentTime - playback.shown : 0);
    if (!heard) playback.tick(elapsed);
    while (playback.playing && behind() > 1e-3) playback.tick(behind());
    if (moves && !playback.playing) sound?.pause();
    if (moves || !drawn) draw(elapsed);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

const root = document.getElementById("replay");
if (root !== null) {
  start(root).catch((error: unknown) => {
    element(root, "[data-replay=problem]").textContent =
      `The performance cannot be shown in three dimensions: ${error instanceof Error ? error.message : String(error)}`;
  });
}
