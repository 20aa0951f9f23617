import { convert, isArchive, unzip } from "../archive";
import { readMidi } from "../music/midi";
import { documentOf, readMusicXml } from "../music/musicxml";
import { pieceOf } from "../music/piece";
import { pieceOfTake, readTake, type Take } from "../take";
import { InputError, type Assets, type Catalogue, type CataloguePiece, type Piece, type Score } from "../types";

/** Identifier of a visitor's own file. No piece of the catalogue has it: theirs are of letters, digits, `-` and `_`. */
export const OWN_FILE = "own:file";

/** Largest files that are read, bytes: a long piano sonata has a tenth of it; a take grows by 20 kB a second. */
const LARGEST_FILE = 2_000_000;
const LARGEST_ARCHIVE = 50_000_000;
/** Largest packed file that a link holds, bytes: it makes a link of 8,000 characters, which all browsers open. */
const LARGEST_IN_LINK = 6_000;

/** A visitor's own file as a link holds it: packed, in letters; null if it is too large. */
export interface OwnFile {
  readonly name: string;
  readonly packed: string | null;
}

/** A piece, and what the catalogue knows of it; null for a visitor's own file. */
export interface Chosen {
  readonly piece: Piece;
  readonly entry: CataloguePiece | null;
  /** A performance that was brought with the piece. */
  readonly take: Take | null;
  readonly file: OwnFile | null;
}

/** The pieces that come with the page, and those that a visitor brings. */
export class Library {
  private constructor(
    private readonly assets: Assets,
    readonly catalogue: Catalogue,
  ) {}

  static async open(assets: Assets): Promise<Library> {
    return new Library(assets, await assets.json<Catalogue>("catalogue.json"));
  }

  /** The piece of which a piece is a version, or itself. */
  whole(id: string): CataloguePiece | null {
    return this.catalogue.pieces.find((piece) => versionsOf(piece).some((one) => one.id === id)) ?? null;
  }

  /** @throws InputError If the catalogue has no such piece or version. */
  async piece(id: string): Promise<Chosen> {
    const entry = this.catalogue.pieces.flatMap(versionsOf).find((piece) => piece.id === id);
    if (entry === undefined) {
      throw new InputError(`There is no piece '${id}' on this page: choose one from the list, or open a file.`);
    }
    if (entry.score !== undefined) {
      return { piece: pieceOf(id, await this.assets.json<Score>(entry.score)), entry, take: null, file: null };
    }
    const take = await readTake(await this.assets.bytes(entry.recording!), entry.recording!);
    return { piece: pieceOfTake(id, take), entry, take, file: null };
  }

  /**
   * Read a visitor's file: MIDI, MusicXML or a take, as its content tells.
   *
   * @throws InputError If it is none of these, or cannot be played.
   */
  async file(bytes: Uint8Array, name: string): Promise<Chosen> {
    const archive = isArchive(bytes);
    const largest = archive ? LARGEST_ARCHIVE : LARGEST_FILE;
    if (bytes.length > largest) {
      throw new InputError(
        `'${name}' has ${bytes.length.toLocaleString("en")} bytes: expected a MIDI file of at most ` +
          `${largest.toLocaleString("en")}.`,
      );
    }
    const files = archive ? await unzip(bytes, name) : null;
    if (files?.has("header.npy")) {
      const take = await readTake(bytes, name);
      return { piece: pieceOfTake(OWN_FILE, take), entry: null, take, file: { name, packed: null } };
    }
    const document = documentOf(bytes, files, name);
    const score = document === null ? readMidi(bytes, name) : readMusicXml(document, name);
    const packed = await convert(bytes, new CompressionStream("gzip"));
    const file = { name, packed: packed.length > LARGEST_IN_LINK ? null : lettersOf(packed) };
    return { piece: pieceOf(OWN_FILE, score), entry: null, take: null, file };
  }

  /** Read a file from a link. @throws InputError If the link is cut off. */
  async linked({ name, packed }: OwnFile): Promise<Chosen> {
    let bytes: Uint8Array;
    try {
      bytes = await convert(bytesOf(packed ?? ""), new DecompressionStream("gzip"));
    } catch {
      throw new InputError(`The link to “${name}” is damaged: copy the whole of it, or open the file itself.`);
    }
    return this.file(bytes, name);
  }
}

/** A piece of the catalogue, and takes of its beginning. */
export function versionsOf(piece: CataloguePiece): readonly CataloguePiece[] {
  return [piece, ...(piece.versions ?? [])];
}

/** Bytes as letters that an address may have. */
function lettersOf(bytes: Uint8Array): string {
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

function bytesOf(letters: string): Uint8Array {
  return Uint8Array.from(atob(letters.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0));
}
