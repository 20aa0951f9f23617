import type { Assets } from "./types";

/** Files beside the page, fetched when they are needed. */
export class FetchedAssets implements Assets {
  constructor(private readonly base: string) {}

  async bytes(name: string): Promise<Uint8Array> {
    // Names of samples have a #, which would end an address.
    const response = await fetch(this.base + name.replaceAll("#", "%23"));
    if (!response.ok) throw new Error(`${name} cannot be fetched: ${response.status}`);
    return new Uint8Array(await response.arrayBuffer());
  }

  async json<T>(name: string): Promise<T> {
    return JSON.parse(new TextDecoder().decode(await this.bytes(name))) as T;
  }
}

/** Files within the page itself, each as gzip in base64: a page that opens from a disk may fetch nothing. */
export class EmbeddedAssets implements Assets {
  constructor(private readonly files: Readonly<Record<string, string>>) {}

  async bytes(name: string): Promise<Uint8Array> {
    const text = this.files[name];
    if (text === undefined) throw new Error(`${name} is not in the page`);
    const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  async json<T>(name: string): Promise<T> {
    return JSON.parse(new TextDecoder().decode(await this.bytes(name))) as T;
  }
}

/** The files of a page: those within it (in an element of the id "assets"), or those in the folder beside it. */
export function assetsOf(page: Document): Assets {
  const embedded = page.getElementById("assets")?.textContent;
  if (!embedded) return new FetchedAssets("assets/");
  return new EmbeddedAssets(JSON.parse(embedded) as Record<string, string>);
}
