/** Numbers of a safetensors file: arrays by name with their shapes, and what is said of them. */
export interface Tensors {
  readonly metadata: Readonly<Record<string, string>>;
  readonly tensors: ReadonlyMap<string, Tensor>;
}

export interface Tensor {
  readonly shape: readonly number[];
  /** The numbers row by row. */
  readonly data: Float32Array | Float64Array | Int8Array | Uint8Array;
}

const KINDS = { F32: Float32Array, F64: Float64Array, I8: Int8Array, U8: Uint8Array } as const;

interface Entry {
  readonly dtype: keyof typeof KINDS;
  readonly shape: readonly number[];
  readonly data_offsets: readonly [number, number];
}

/**
 * Read a safetensors file: eight bytes with the length of a JSON header, the header, then the arrays.
 *
 * @throws Error If an array is of a type that Python's exporter does not write.
 */
export function readTensors(bytes: Uint8Array): Tensors {
  const length = Number(new DataView(bytes.buffer, bytes.byteOffset).getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(8, 8 + length))) as Record<string, unknown>;
  const { __metadata__: metadata = {}, ...entries } = header;
  const tensors = new Map<string, Tensor>();
  for (const [name, entry] of Object.entries(entries as Record<string, Entry>)) {
    const Kind = KINDS[entry.dtype];
    if (Kind === undefined) {
      throw new Error(`${name} is of type ${entry.dtype}: expected one of ${Object.keys(KINDS).join(", ")}.`);
    }
    const [start, end] = entry.data_offsets;
    // A copy, as the numbers need not be aligned in the file.
    tensors.set(name, { shape: entry.shape, data: new Kind(bytes.slice(8 + length + start, 8 + length + end).buffer) });
  }
  return { metadata: metadata as Record<string, string>, tensors };
}

/** Floating-point numbers of a file. @throws Error If it has no such array of them. */
export function floats(file: Tensors, name: string): Float32Array {
  const data = file.tensors.get(name)?.data;
  if (!(data instanceof Float32Array)) {
    throw new Error(`There is no float32 array ${name}: expected a file of the same 'sb3-piano export web'.`);
  }
  return data;
}
