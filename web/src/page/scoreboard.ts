import type { CataloguePiece, Metrics, PlayerId } from "../types";
import { PLAYERS, PLAYER_IDS, hindrance } from "./players";

interface Row {
  readonly radio: HTMLInputElement;
  readonly label: HTMLElement;
  readonly inPython: HTMLElement;
  readonly f1: Figure;
  readonly onsetF1: Figure;
}

/** A cell with what was reached here, and below what Python measured. */
class Figure {
  private readonly here = document.createElement("span");
  private readonly python = document.createElement("small");

  constructor(cell: HTMLTableCellElement) {
    cell.append(this.here, this.python);
  }

  show(value: number | null): void {
    this.here.textContent = value === null ? "" : value.toFixed(3);
  }

  expect(value: number | undefined): void {
    this.python.textContent = value === undefined ? "" : value.toFixed(3);
  }
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
      const expected = entry?.expected[id];
      row.inPython.hidden = expected === undefined;
      for (const [figure, value] of [
        [row.f1, expected?.f1],
        [row.onsetF1, expected?.onset_f1],
      ] as const) {
        figure.show(null);
        figure.expect(value);
      }
    }
  }

  /** Check the player that is on. */
  choose(player: PlayerId): void {
    this.rows.get(player)!.radio.checked = true;
  }

  /** Keep what a player has reached so far. */
  record(player: PlayerId, metrics: Metrics): void {
    const row = this.rows.get(player)!;
    row.f1.show(metrics.f1);
    row.onsetF1.show(metrics.onset_f1);
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
  const inPython = Object.assign(document.createElement("small"), { textContent: "Measured in Python" });
  text.append(PLAYERS[id].name, about, inPython);
  label.append(radio, text);
  head.append(label);
  row.append(head);
  return { radio, label, inPython, f1: new Figure(row.insertCell()), onsetF1: new Figure(row.insertCell()) };
}
