import { InputError } from "./types";

/** Most bytes that an archive may have unpacked, as Python's. */
const MOST_BYTES = 2 ** 28;

const END = 0x06054b50;
const ENTRY = 0x02014b50;
const END_LENGTH = 22;
const STORED = 0;
const DEFLATED = 8;

/** Whether a file is a zip archive, by its first bytes. */
export function isArchive(bytes: Uint8Array): boolean {
  return bytes[0] === 0x50 && bytes[1] === 0x4b;
}

/**
 * Unpack a zip archive: its files by name.
 *
 * @throws InputError If it is damaged, encrypted or too large.
 */
export async function unzip(bytes: Uint8Array, name: string): Promise<Map<string, Uint8Array>> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const files = new Map<string, Uint8Array>();
  try {
    let end = bytes.length - END_LENGTH;
    while (end >= 0 && view.getUint32(end, true) !== END) end--;
    if (end < 0) throw new Error("it has no end");
    let at = view.getUint32(end + 16, true);
    let left = MOST_BYTES;
    for (let count = view.getUint16(end + 10, true); count > 0; count--) {
      if (view.getUint32(at, true) !== ENTRY) throw new Error("its list of files is damaged");
      const [method, packed] = [view.getUint16(at + 10, true), view.getUint32(at + 20, true)];
      const [title, extra, comment] = [28, 30, 32].map((place) => view.getUint16(at + place, true));
      const header = view.getUint32(at + 42, true);
      const start = header + 30 + view.getUint16(header + 26, true) + view.getUint16(header + 28, true);
      const file = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + title));
      const content = bytes.subarray(start, start + packed);
      left -= view.getUint32(at + 24, true);
      if (left < 0) throw new Error(`it has more than ${MOST_BYTES} bytes`);
      if (method !== STORED && method !== DEFLATED) throw new Error(`${file} is packed by method ${method}`);
      files.set(file, method === STORED ? content : await convert(content, new DecompressionStream("deflate-raw")));
      at += 46 + title + extra + comment;
    }
  } catch (error) {
    const reason = error instanceof RangeError || error instanceof TypeError ? "it is damaged" : (error as Error).message;
    throw new InputError(`“${name}” cannot be unpacked: ${reason}.`);
  }
  return files;
}

/** Send bytes through a stream that packs or unpacks them. */
export async function convert(
  bytes: Uint8Array,
  through: CompressionStream | DecompressionStream,
): Promise<Uint8Array<ArrayBuffer>> {
  const stream = new Blob([bytes.slice()]).stream().pipeThrough(through);
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
