import type { CataloguePiece, PlayerId } from "../types";

/** The players, in the order of the menu. */
export const PLAYER_IDS: readonly PlayerId[] = ["sight-reader", "planned", "recorded", "score", "you"];

/** Names of the players, and what they are, in a few words. */
export const PLAYERS: Readonly<Record<PlayerId, { readonly name: string; readonly about: string }>> = {
  "sight-reader": { name: "Sight-reader", about: "A network; plays any piece" },
  planned: { name: "Planned hands", about: "Follow a plan of the piece" },
  recorded: { name: "Recording", about: "A performance, once more" },
  score: { name: "Score only", about: "The piece as it is written" },
  you: { name: "You", about: "MIDI or computer keyboard" },
};

/** Why a player cannot play a piece, or null if it can; a visitor's own file is no piece of the catalogue. */
export function hindrance(player: PlayerId, piece: CataloguePiece | null): string | null {
  if (player === "planned" && piece?.plan === undefined) return "There is no plan of this piece.";
  if (player === "recorded" && piece?.recording === undefined) return "There is no recording of this piece.";
  return null;
}
