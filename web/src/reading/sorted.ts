/** Which of some ascending numbers is the first above `bound`; how many they are if none is. */
export function firstAbove(ascending: ArrayLike<number>, bound: number): number {
  let from = 0;
  let to = ascending.length;
  while (from < to) {
    const middle = (from + to) >> 1;
    if (ascending[middle] > bound) to = middle;
    else from = middle + 1;
  }
  return from;
}
