/**
 * Reading, observation and network for Python's tests: a request (JSON) on each line of the standard input, an answer
 * on each line out. A request names a folder of `sb3-piano export web`, and a safetensors file with a roll and, to
 * compare observations, states of the simulation in some of its control steps.
 */

import { createInterface } from "node:readline";
import { readFile } from "node:fs/promises";

import { HandEncoding, type ObservedState } from "../players/hand_encoding";
import { HandNetwork } from "../players/hand_network";
import { SightReader } from "../players/sight_reader";
import type { ReadingFacts } from "../reading/facts";
import type { HandReading } from "../reading/piece";
import type { SceneFacts } from "../simulation/facts";
import { loadSimulation } from "../simulation/simulation";
import { type Tensors, readTensors } from "../tensors";
import { type Assets, CONTROL_TIMESTEP, NUM_KEYS, type PianoRoll } from "../types";
import { FolderAssets } from "./folder_assets";

interface Request {
  readonly ask: "observe" | "play";
  readonly folder: string;
  readonly file: string;
}

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(`${JSON.stringify(await answer(JSON.parse(line) as Request))}\n`);
}

async function answer({ ask, folder, file }: Request): Promise<object> {
  const assets = new FolderAssets(folder);
  const tensors = readTensors(new Uint8Array(await readFile(file)));
  try {
    return { answer: await (ask === "play" ? play(assets, rollIn(tensors)) : observe(assets, tensors)) };
  } catch (error) {
    return { refused: (error as Error).message };
  }
}

/** What the roll asks of the hands; what they observe and do in the recorded states. */
async function observe(assets: Assets, tensors: Tensors) {
  const encoding = new HandEncoding(
    await assets.json<ReadingFacts>("reading.json"),
    await assets.json<SceneFacts>("scene.json"),
  );
  const network = new HandNetwork(readTensors(await assets.bytes("sight_reader.safetensors")));
  const { hands } = encoding.read(rollIn(tensors));
  const observations = Array.from(numbers(tensors, "step"), (step, row) =>
    encoding.write(step, stateIn(tensors, row)),
  );
  return {
    hands: hands.map(readingOf),
    observations: observations.map((observation) => [...observation]),
    actions: observations.map((observation) => [...network.act(observation)]),
  };
}

/** The keys that sound after each control step when the sight-reader plays the roll. */
async function play(assets: Assets, roll: PianoRoll): Promise<number[][]> {
  const simulation = await loadSimulation(assets);
  const reader = await SightReader.load(assets, simulation);
  const score = { title: "", notes: [], pedals: [], duration: 0 };
  reader.prepare({ id: "", score, roll, warnings: [], lead: null });
  const played = Array.from({ length: roll.steps }, (_, step) => {
    simulation.advance(reader.controls(step));
    return Array.from({ length: NUM_KEYS }, (_, key) => key).filter((key) => simulation.sounding[key]);
  });
  simulation.dispose();
  return played;
}

function readingOf({ presses, frames, place, busy, bound }: HandReading) {
  return {
    presses: presses.map(({ press, ...timed }) => ({ ...timed, key: press.key, finger: press.finger })),
    target: [...frames.target],
    weight: [...frames.weight],
    place: [...place],
    busy: [...busy],
    bound: [...bound],
  };
}

function rollIn(file: Tensors): PianoRoll {
  const keys = numbers(file, "strike_key");
  const times = numbers(file, "strike_time");
  const sustain = numbers(file, "sustain");
  return {
    controlTimestep: CONTROL_TIMESTEP,
    steps: sustain.length,
    active: Uint8Array.from(numbers(file, "active")),
    finger: Int8Array.from(numbers(file, "finger")),
    onset: Uint8Array.from(numbers(file, "onset")),
    sustain: Uint8Array.from(sustain),
    strikes: Array.from(numbers(file, "strike_step"), (step, i) => ({ step, key: keys[i], time: times[i] })),
  };
}

/** The simulation as it was in one of the recorded control steps. */
function stateIn(file: Tensors, row: number): ObservedState {
  const of = (name: string) => {
    const data = numbers(file, name);
    const size = data.length / numbers(file, "step").length;
    return Float64Array.from(data.subarray(row * size, (row + 1) * size));
  };
  return {
    qpos: of("qpos"),
    qvel: of("qvel"),
    geomXpos: of("geom_xpos"),
    geomXmat: of("geom_xmat"),
    keyState: of("key_state"),
  };
}

function numbers(file: Tensors, name: string) {
  const tensor = file.tensors.get(name);
  if (tensor === undefined) throw new Error(`The file has no array ${name}.`);
  return tensor.data;
}
