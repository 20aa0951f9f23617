import type { PlayerId } from "../types";
import type { Chosen } from "./library";

/** The players, in the order of the menu. */
export const PLAYER_IDS: readonly PlayerId[] = ["sight-reader", "planned", "recorded", "score", "you"];

/** Names of the players, and what they are, in a few words. */
export const PLAYERS: Readonly<Record<PlayerId, { readonly name: string; readonly about: string }>> = {
  "sight-reader": { name: "Sight-reader", about: "A network; plays any piece" },
  planned: { name: "Planned hands", about: "Follow a plan of the piece" },
  recorded: { name: "Recording", about: "The best performance we have" },
  score: { name: "Score only", about: "The piece as it is written" },
  you: { name: "You", about: "MIDI or computer keyboard" },
};

/** Why a player cannot play a piece, or null if it can. */
export function hindrance(player: PlayerId, { entry, take }: Pick<Chosen, "entry" | "take">): string | null {
  if (player === "planned" && entry?.plan === undefined) return "There is no plan of this piece.";
  const recorded = take !== null || entry?.recording !== undefined;
  return player === "recorded" && !recorded ? "There is no recording of this piece." : null;
}
