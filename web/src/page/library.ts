import { readMidi } from "../music/midi";
import { pieceOf } from "../music/piece";
import { InputError, type Assets, type Catalogue, type CataloguePiece, type Piece, type Score } from "../types";

/** Identifier of a visitor's own file. No piece of the catalogue has it: theirs are of letters, digits, `-` and `_`. */
export const OWN_FILE = "own:file";

/** Largest MIDI file that is read, bytes: a long piano sonata has a tenth of it. */
const LARGEST_FILE = 2_000_000;

/** A piece, and what the catalogue knows of it; null for a visitor's own file. */
export interface Chosen {
  readonly piece: Piece;
  readonly entry: CataloguePiece | null;
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

  /** @throws InputError If the catalogue has no such piece. */
  async piece(id: string): Promise<Chosen> {
    const entry = this.catalogue.pieces.find((piece) => piece.id === id);
    if (entry === undefined) {
      throw new InputError(`There is no piece '${id}' on this page: choose one from the list, or open a MIDI file.`);
    }
    return { piece: pieceOf(id, await this.assets.json<Score>(entry.score)), entry };
  }

  /** @throws InputError If a file is no MIDI file that can be played. */
  midi(bytes: Uint8Array, name: string): Chosen {
    if (bytes.length > LARGEST_FILE) {
      throw new InputError(
        `'${name}' has ${bytes.length.toLocaleString("en")} bytes: expected a MIDI file of at most ` +
          `${LARGEST_FILE.toLocaleString("en")}.`,
      );
    }
    return { piece: pieceOf(OWN_FILE, readMidi(bytes, name)), entry: null };
  }
}
