/** A learned network of one hand, and its forward pass for both. */

import { type Tensors, floats } from "../tensors";

/** Standardised observations end here. */
const CLIP = 10;
/** Of LayerNorm. */
const EPSILON = 1e-5;

/** By their names in `torch.nn`. */
const ACTIVATIONS: Readonly<Record<string, (x: number) => number>> = {
  SiLU: (x) => x / (1 + Math.exp(-x)),
  ReLU: (x) => Math.max(x, 0),
  Tanh: Math.tanh,
};

/** A linear map with LayerNorm after it. */
interface Layer {
  /** (outputs, inputs) row by row. */
  readonly weight: Float32Array;
  readonly bias: Float32Array;
  readonly gain: Float32Array;
  readonly shift: Float32Array;
}

/** Numbers of the two hands, side by side. */
type Pair = readonly [Float64Array, Float64Array];

/**
 * A learned network of one hand, which plays both: Python's `HandModel`.
 *
 * The observation is standardised and cut; each hidden layer is a linear map, LayerNorm and an activation; the head
 * sees the last layer and the standardised observation, and ends in tanh.
 */
export class HandNetwork {
  /** Numbers of one hand's observation, and of its action. */
  readonly inputs: number;
  readonly outputs: number;
  /** Version of the observation for which it was trained. */
  readonly observationVersion: number;
  /** Length of the control step for which it was trained, s. */
  readonly controlTimestep: number;
  /** How far from where it is an action of 1 sends a finger's joint, rad. */
  readonly reach: number;
  private readonly mean: Float32Array;
  private readonly scale: Float32Array;
  private readonly layers: readonly Layer[];
  private readonly head: Float32Array;
  private readonly bias: Float32Array;
  private readonly activation: (x: number) => number;

  /**
   * @param file What `HandModel.save` of Python writes.
   * @throws Error If the file is another one.
   */
  constructor(file: Tensors) {
    const name = fact<string>(file, "activation");
    const activation = ACTIVATIONS[name];
    if (activation === undefined) {
      const known = Object.keys(ACTIVATIONS).join(", ");
      throw new Error(`The network's activation is ${name}: expected one of ${known}.`);
    }
    this.activation = activation;
    this.observationVersion = Number(file.metadata.observation_version ?? 1);
    this.controlTimestep = fact<number>(file, "control_timestep");
    this.reach = fact<number>(file, "reach");
    this.mean = floats(file, "standardize.mean");
    this.scale = floats(file, "standardize.scale");
    this.layers = layersOf(file);
    this.head = floats(file, "head.weight");
    this.bias = floats(file, "head.bias");
    this.inputs = this.mean.length;
    this.outputs = this.bias.length;
  }

  /** Actions of both hands, (2 outputs) in [-1, 1], for their observations, (2 inputs), the right hand's first. */
  act(observation: Float32Array): Float32Array {
    const seen: Pair = [this.standardized(observation, 0), this.standardized(observation, this.inputs)];
    let hidden = seen;
    for (const layer of this.layers) {
      hidden = multiply(layer.weight, hidden, layer.bias);
      for (const numbers of hidden) this.normalize(numbers, layer);
    }
    const latent = hidden.map((numbers, hand) => {
      const both = new Float64Array(numbers.length + this.inputs);
      both.set(numbers);
      both.set(seen[hand], numbers.length);
      return both;
    }) as unknown as Pair;
    const [right, left] = multiply(this.head, latent, this.bias);
    const action = new Float32Array(2 * this.outputs);
    right.forEach((number, i) => (action[i] = Math.tanh(number)));
    left.forEach((number, i) => (action[this.outputs + i] = Math.tanh(number)));
    return action;
  }

  /** A hand's observation, which begins at `from`, standardised and cut. */
  private standardized(observation: Float32Array, from: number): Float64Array {
    return Float64Array.from(this.mean, (mean, i) => {
      const number = (observation[from + i] - mean) * this.scale[i];
      return Math.min(Math.max(number, -CLIP), CLIP);
    });
  }

  /** Apply LayerNorm and the activation in place. */
  private normalize(numbers: Float64Array, { gain, shift }: Layer): void {
    const mean = numbers.reduce((sum, x) => sum + x, 0) / numbers.length;
    const variance = numbers.reduce((sum, x) => sum + (x - mean) ** 2, 0) / numbers.length;
    const scale = 1 / Math.sqrt(variance + EPSILON);
    for (let i = 0; i < numbers.length; i++) {
      numbers[i] = this.activation((numbers[i] - mean) * scale * gain[i] + shift[i]);
    }
  }
}

/** What a file says of its network. */
function fact<T>({ metadata }: Tensors, name: string): T {
  const text = metadata[name];
  if (text === undefined) {
    throw new Error(`The network's file does not tell its ${name}: expected one that HandModel.save of Python wrote.`);
  }
  return JSON.parse(text) as T;
}

function layersOf(file: Tensors): Layer[] {
  const layers: Layer[] = [];
  for (let i = 0; file.tensors.has(`network.hidden.${i}.linear.weight`); i++) {
    const of = (name: string) => floats(file, `network.hidden.${i}.${name}`);
    layers.push({
      weight: of("linear.weight"),
      bias: of("linear.bias"),
      gain: of("norm.weight"),
      shift: of("norm.bias"),
    });
  }
  return layers;
}

/** Outputs that are computed at a time: what is looked up once then serves several of them. */
const ROWS = 4;

/** A linear map of both hands' numbers, to `ROWS` outputs or more. */
function multiply(weight: Float32Array, [x, y]: Pair, bias: Float32Array): Pair {
  const inputs = x.length;
  const right = new Float64Array(bias.length);
  const left = new Float64Array(bias.length);
  for (let next = 0; next < bias.length; next += ROWS) {
    const first = Math.min(next, bias.length - ROWS); // the last rows may be computed twice
    const a = first * inputs;
    const b = a + inputs;
    const c = b + inputs;
    const d = c + inputs;
    // Lists would be shorter, and take twice the time.
    let xa = 0, xb = 0, xc = 0, xd = 0;
    let ya = 0, yb = 0, yc = 0, yd = 0;
    for (let i = 0; i < inputs; i++) {
      const u = x[i];
      const v = y[i];
      const p = weight[a + i];
      const q = weight[b + i];
      const r = weight[c + i];
      const s = weight[d + i];
      xa += p * u;
      ya += p * v;
      xb += q * u;
      yb += q * v;
      xc += r * u;
      yc += r * v;
      xd += s * u;
      yd += s * v;
    }
    right.set([xa, xb, xc, xd], first);
    left.set([ya, yb, yc, yd], first);
  }
  bias.forEach((number, output) => {
    right[output] += number;
    left[output] += number;
  });
  return [right, left];
}
