import type { CataloguePiece, Metrics, PlayerId } from "../types";
import { PLAYERS, PLAYER_IDS, hindrance } from "./players";

interface Row {
  readonly radio: HTMLInputElement;
  readonly label: HTMLElement;
  readonly python: HTMLElement;
  readonly f1: HTMLElement;
  readonly onsetF1: HTMLElement;
}

/** The table of players: a menu, and what each of them has reached on the piece. */
export class Scoreboard {
  private readonly rows: ReadonlyMap<PlayerId, Row>;

  constructor(table: HTMLTableElement, onChoice: (player: PlayerId) => void) {
    const body = table.tBodies[0];
    this.rows = new Map(PLAYER_IDS.map((id) => [id, addRow(body, id, () => onChoice(id))]));
  }

  /** Forget all figures, and offer who can play a piece; null for a visitor's own file. */
  showPiece(entry: CataloguePiece | null): void {
    for (const [id, row] of this.rows) {
      const reason = hindrance(id, entry);
      row.radio.disabled = reason !== null;
      row.label.title = reason ?? "";
      row.f1.textContent = row.onsetF1.textContent = "";
      const expected = entry?.expected[id];
      row.python.textContent =
        expected === undefined ? "" : `Python ${expected.f1.toFixed(3)}, ${expected.onset_f1.toFixed(3)}`;
    }
  }

  /** Check the player that is on. */
  choose(player: PlayerId): void {
    this.rows.get(player)!.radio.checked = true;
  }

  /** Keep what a player has reached so far. */
  record(player: PlayerId, metrics: Metrics): void {
    const row = this.rows.get(player)!;
    row.f1.textContent = metrics.f1.toFixed(3);
    row.onsetF1.textContent = metrics.onset_f1.toFixed(3);
  }
}

function addRow(body: HTMLTableSectionElement, id: PlayerId, onChoice: () => void): Row {
  const row = body.insertRow();
  const head = document.createElement("th");
  head.scope = "row";
  const radio = Object.assign(document.createElement("input"), { type: "radio", name: "player", value: id });
  radio.addEventListener("change", onChoice);
  const label = document.createElement("label");
  const text = document.createElement("span");
  const about = Object.assign(document.createElement("small"), { textContent: PLAYERS[id].about });
  const python = document.createElement("small");
  text.append(PLAYERS[id].name, about, python);
  label.append(radio, text);
  head.append(label);
  row.append(head);
  return { radio, label, python, f1: row.insertCell(), onsetF1: row.insertCell() };
}
