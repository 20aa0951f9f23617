/** Rounding as NumPy and Python do it. */

/** Return the nearest whole number, of two equally near ones the even one. */
export function roundHalfEven(value: number): number {
  const low = Math.floor(value);
  const above = value - low;
  if (above !== 0.5) return above < 0.5 ? low : low + 1;
  return low % 2 === 0 ? low : low + 1;
}

/** Return a number rounded to so many decimals, by the arithmetic of `np.round`. */
export function roundTo(value: number, decimals: number): number {
  const scale = 10 ** decimals;
  return roundHalfEven(value * scale) / scale;
}

/** Return a number, but at least `low` and at most `high`. */
export function clip(value: number, low: number, high: number): number {
  return Math.min(Math.max(value, low), high);
}
