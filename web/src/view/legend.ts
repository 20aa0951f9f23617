import { FINGER_COLORS, MISSED_COLOR, MISTIMED_COLOR, PRESSED_COLOR, WRONG_COLOR, css, type Rgb } from "./colors";

/** Give the marks of the legend, by their classes, the colours of the picture and the piano roll. */
export function paintLegend(root: ParentNode): void {
  const colors: Record<string, Rgb> = {
    hit: PRESSED_COLOR,
    mistimed: MISTIMED_COLOR,
    missed: MISSED_COLOR,
    wrong: WRONG_COLOR,
  };
  FINGER_COLORS.forEach((rgb, finger) => (colors[`finger-${finger}`] = rgb));
  for (const [name, rgb] of Object.entries(colors)) {
    for (const mark of root.querySelectorAll<HTMLElement>(`.legend .${name}`)) mark.style.background = css(rgb);
  }
}
