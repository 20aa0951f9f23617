import type { CataloguePiece } from "../types";
import { versionsOf } from "./library";

/** The switch between a piece and takes of its beginning. */
export class Versions {
  private whole: CataloguePiece | null = null;

  constructor(
    private readonly field: HTMLFieldSetElement,
    private readonly onChoice: (id: string) => void,
  ) {}

  /** Offer the versions of a piece, if it has any, with the one of some identifier chosen. */
  show(whole: CataloguePiece | null, chosen: string): void {
    this.field.hidden = whole?.versions === undefined;
    // As long as the piece is the same, so are the buttons: one of them may have the focus.
    if (whole !== this.whole) {
      this.field.querySelectorAll("label").forEach((label) => label.remove());
      if (whole?.versions !== undefined) versionsOf(whole).forEach((one) => this.offer(one, one === whole));
    }
    this.whole = whole;
    for (const radio of this.field.querySelectorAll("input")) radio.checked = radio.value === chosen;
  }

  private offer({ id, recorder }: CataloguePiece, isWhole: boolean): void {
    const radio = Object.assign(document.createElement("input"), { type: "radio", name: "version", value: id });
    radio.addEventListener("change", () => this.onChoice(id));
    const label = document.createElement("label");
    label.append(radio, isWhole ? "The whole piece" : recorder!);
    this.field.append(label);
  }
}
