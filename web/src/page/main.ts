import { assetsOf } from "../assets";
import { Sessions } from "../players/session";
import { start, type PianoPage } from "./start";

declare global {
  interface Window {
    /** The page by program, once it is there. */
    piano: { readonly ready: Promise<PianoPage> };
  }
}

const ready = start(assetsOf(document), async (assets) => {
  const sessions = await Sessions.load(assets);
  return ({ piece, entry, take }, player) => sessions.open(piece, player, entry, take);
});
window.piano = { ready };
ready.catch((error: unknown) => {
  const message = document.getElementById("message")!;
  const reason = error instanceof Error ? error.message : String(error);
  const hint = location.protocol === "file:" ? " Opened from a disk, only piano.html has all its files within it." : "";
  message.textContent = `The page could not be built: ${reason}.${hint}`;
  message.hidden = false;
  throw error;
});
