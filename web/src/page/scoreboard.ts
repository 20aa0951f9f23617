import type { Metrics, PlayerId } from "../types";
import { percent } from "./captions";
import type { Chosen } from "./library";
import { PLAYERS, PLAYER_IDS, hindrance } from "./players";

/** The columns: what is measured, and how it is written. */
const COLUMNS = [
  ["onset_recall", percent],
  ["f1", (value: number) => value.toFixed(3)],
  ["onset_f1", (value: number) => value.toFixed(3)],
] as const;

interface Row {
  readonly radio: HTMLInputElement;
  readonly label: HTMLElement;
  readonly about: HTMLElement;
  readonly inPython: HTMLElement;
  readonly figures: readonly Figure[];
}

/** A cell with what was reached here, and below what Python measured. */
class Figure {
  private readonly here = document.createElement("span");
  private readonly python = document.createElement("small");

  constructor(
    cell: HTMLTableCellElement,
    private readonly written: (value: number) => string,
  ) {
    cell.append(this.here, this.python);
  }

  show(value: number | null): void {
    this.here.textContent = value === null ? "" : this.written(value);
  }

  expect(value: number | undefined): void {
    this.python.textContent = value === undefined ? "" : this.written(value);
  }
}

/** The table of players: a menu, and what each of them has reached on the piece. */
export class Scoreboard {
  private readonly rows: ReadonlyMap<PlayerId, Row>;

  constructor(table: HTMLTableElement, onChoice: (player: PlayerId) => void) {
    const body = table.tBodies[0];
    this.rows = new Map(PLAYER_IDS.map((id) => [id, addRow(body, id, () => onChoice(id))]));
  }

  /** Forget all figures, and offer who can play a piece. */
  showPiece({ entry, take }: Chosen): void {
    for (const [id, row] of this.rows) {
      const reason = hindrance(id, { entry, take });
      const recorder = id === "recorded" ? (entry?.recorder ?? take?.player) : undefined;
      row.about.textContent = recorder || PLAYERS[id].about;
      row.radio.disabled = reason !== null;
      row.label.title = reason ?? "";
      const expected = entry?.expected[id];
      row.inPython.hidden = expected === undefined;
      COLUMNS.forEach(([name], i) => {
        row.figures[i].show(null);
        row.figures[i].expect(expected?.[name]);
      });
    }
  }

  /** Check the player that is on. */
  choose(player: PlayerId): void {
    this.rows.get(player)!.radio.checked = true;
  }

  /** Keep what a player has reached so far. */
  record(player: PlayerId, metrics: Metrics): void {
    const row = this.rows.get(player)!;
    COLUMNS.forEach(([name], i) => row.figures[i].show(metrics[name]));
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
  const inPython = Object.assign(document.createElement("small"), { textContent: "In Python" });
  text.append(PLAYERS[id].name, about, inPython);
  label.append(radio, text);
  head.append(label);
  row.append(head);
  return { radio, label, about, inPython, figures: COLUMNS.map(([, written]) => new Figure(row.insertCell(), written)) };
}
