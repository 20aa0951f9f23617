import type { PianoSound } from "../view/sound";
import type { View } from "../view/cameras";
import type { App } from "./app";
import type { Elements } from "./elements";
import { TEMPO_RANGE } from "./permalink";
import { ComputerKeys, listenToMidi } from "./visitor_keys";
import { pitchName } from "../music/constants";
import type { Visitor } from "./visitor";

const TEMPO_STEP = 0.05;
const MS_PER_STEP = 50;
/** Keys of the progress bar, and by how much they move it, s. */
const SEEK_KEYS: ReadonlyMap<string, number> = new Map([
  ["ArrowLeft", -1],
  ["ArrowDown", -1],
  ["ArrowRight", 1],
  ["ArrowUp", 1],
  ["PageDown", -10],
  ["PageUp", 10],
  ["Home", -Infinity],
  ["End", Infinity],
]);

/** Let the buttons, menus, sliders and keys of the page do what they say. */
export function connectControls(app: App, elements: Elements, sound: PianoSound, visitor: Visitor): void {
  elements.begin.addEventListener("click", () => void app.toggle());
  elements.play.addEventListener("click", () => void app.toggle());
  elements.restart.addEventListener("click", () => app.restart());
  elements.step.addEventListener("click", () => app.advance(1));
  connectSeek(app, elements);
  elements.tempo.addEventListener("input", () => app.setTempo(Number(elements.tempo.value)));
  elements.volume.addEventListener("input", () => (sound.volume = Number(elements.volume.value)));
  elements.dynamics.addEventListener("change", () => (sound.flat = !elements.dynamics.checked));
  for (const slider of [elements.noise, elements.latency]) {
    slider.addEventListener("input", () => disturb(app, elements));
  }
  for (const radio of elements.views.querySelectorAll("input")) {
    radio.addEventListener("change", () => app.look(radio.value as View, !reducedMotion()));
  }
  connectFiles(app, elements);
  connectKeys(app, elements, visitor);
  addEventListener("hashchange", () => void app.follow(location.hash));
}

/** Let the progress bar be dragged, and moved by keys: it seeks when it is let go of. */
function connectSeek(app: App, { seek }: Elements): void {
  seek.addEventListener("input", () => app.showPlace(Number(seek.value)));
  seek.addEventListener("change", () => void app.seek(Number(seek.value)));
  seek.addEventListener("keydown", (event) => {
    const seconds = SEEK_KEYS.get(event.key);
    if (seconds === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    void app.seek(Number(seek.value) + seconds);
  });
}

function disturb(app: App, elements: Elements): void {
  const noise = Number(elements.noise.value);
  const latency = Number(elements.latency.value);
  elements.noiseText.value = `${(100 * noise).toFixed(1).replace(/\.0$/, "")} %`;
  elements.latencyText.value = `${latency * MS_PER_STEP} ms`;
  app.setDisturbance(noise, latency);
}

function connectFiles(app: App, elements: Elements): void {
  const { file, open, piece } = elements;
  piece.addEventListener("change", () => void app.choosePiece(piece.value));
  open.addEventListener("click", () => file.click());
  file.addEventListener("change", () => {
    const chosen = file.files?.[0];
    // The same file may be chosen again after it was corrected.
    if (chosen !== undefined) void app.openFile(chosen).finally(() => (file.value = ""));
  });
  const body = document.body;
  body.addEventListener("dragover", (event) => {
    event.preventDefault();
    body.classList.add("dropping");
  });
  body.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) body.classList.remove("dropping");
  });
  body.addEventListener("drop", (event) => {
    event.preventDefault();
    body.classList.remove("dropping");
    const dropped = event.dataTransfer?.files[0];
    if (dropped !== undefined) void app.openFile(dropped);
  });
}

function connectKeys(app: App, elements: Elements, visitor: Visitor): void {
  const keys = new ComputerKeys(visitor);
  addEventListener("keydown", (event) => {
    const plays = app.player === "you" && !writesText(event.target);
    if (plays && keys.press(event)) {
      elements.octave.value = pitchName(keys.upperC);
      event.preventDefault();
    } else if (obey(app, elements, event)) {
      event.preventDefault();
    }
  });
  addEventListener("keyup", (event) => keys.release(event));
  addEventListener("blur", () => keys.releaseAll());
  elements.connect.addEventListener("click", () => {
    const show = (names: readonly string[]): void => {
      const none = "No MIDI keyboard is connected yet; it may be plugged in now.";
      elements.connected.textContent = names.length === 0 ? none : `Listening to ${names.join(", ")}.`;
    };
    listenToMidi(visitor, show).catch((error: Error) => (elements.connected.textContent = error.message));
  });
}

/** Do what a shortcut asks for; return whether it was one. Controls keep the keys that they have by themselves. */
function obey(app: App, elements: Elements, event: KeyboardEvent): boolean {
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  const target = event.target as Element;
  const presses = target.matches("button, select, summary, a");
  const moves = target.matches("input, select");
  const tempo = Number(elements.tempo.value);
  if (event.key === " " && !presses) void app.toggle();
  else if (moves) return false;
  else if (event.key === "ArrowRight") app.advance(1);
  else if (event.key === "Home") app.restart();
  else if (event.key === "+" || event.key === "=") app.setTempo(Math.min(TEMPO_RANGE.max, round(tempo + TEMPO_STEP)));
  else if (event.key === "-") app.setTempo(Math.max(TEMPO_RANGE.min, round(tempo - TEMPO_STEP)));
  else return false;
  return true;
}

function round(tempo: number): number {
  return Number(tempo.toFixed(2));
}

/** Whether letters belong to an element: a list is searched by them. */
function writesText(target: EventTarget | null): boolean {
  return target instanceof HTMLSelectElement;
}

function reducedMotion(): boolean {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}
