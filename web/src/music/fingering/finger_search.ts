/**
 * The search: the fingers of a hand that cost the least over a whole piece, for any model of costs.
 *
 * An order-k Viterbi search (Viterbi 1967). A *state* is a way to lay fingers on all keys that are down from
 * one onset to the next; a cost depends on the states of an onset and of the k before it. The search is
 * exact unless the number of states that are followed is limited.
 */

/** Ways to lay fingers on keys: for each way the finger, 0 (thumb) to 4, of each key. */
export type States = readonly (readonly number[])[];

/** Keys that are down from one onset to the next. */
export interface Onset<K> {
  /** What is held and what is struck. */
  readonly down: readonly K[];
  readonly states: States;
}

/** What a hand can do, and what its fingers cost. */
export interface FingerCosts<K, S extends Onset<K>> {
  /** Return what of `down` stays when others are struck, in the order in which it is let go if it must. */
  held(down: readonly K[], struck: readonly K[]): K[];
  /** Return the ways to lay fingers on what is held and what is struck. */
  lay(path: readonly S[], held: readonly K[], struck: readonly K[]): S;
  /**
   * Return what the states of an onset cost after those before, infinity if impossible.
   *
   * @returns row by row: (states of each of the last k onsets, states), those that there are not as one.
   */
  costs(path: readonly S[], onset: S): Float64Array;
  /** The same onset with only these of its states, in this order. */
  keep(onset: S, kept: readonly number[]): S;
}

/**
 * Find the fingers that cost the least, for what is struck at each onset, in order of time.
 *
 * @param order k: on how many earlier onsets a cost depends, 1 or 2.
 * @param mostStates of an onset so many states are followed, the cheapest.
 * @returns the finger, 0 (thumb) to 4, of each key that is struck.
 */
export function searchFingers<K, S extends Onset<K>>(
  chords: Iterable<readonly K[]>,
  model: FingerCosts<K, S>,
  order: 1 | 2,
  mostStates = Infinity,
): Map<K, number> {
  const path: S[] = [];
  const backs: Reached[] = [];
  let best: Best = { cost: new Float64Array(1), lead: 1 };
  for (const struck of chords) {
    const held = model.held(path.at(-1)?.down ?? [], struck);
    let onset: S;
    let reached: Reached;
    for (;;) {
      onset = model.lay(path, held, struck);
      reached = reach(best, model.costs(path, onset), onset.states.length);
      if (reached.cost.some(Number.isFinite)) break;
      if (held.length === 0) throw new Error("What is struck alone can always be reached.");
      held.shift();
    }
    if (Number.isFinite(mostStates)) {
      const kept = cheapest(reached).slice(0, mostStates);
      onset = model.keep(onset, kept);
      reached = only(reached, kept);
    }
    best = { cost: reached.cost, lead: order === 1 ? reached.cost.length : reached.rows };
    path.push(onset);
    backs.push(reached);
  }
  return trace(path, backs, best, order);
}

/** Least costs by the states of the last k onsets; `lead` is how many the first of these onsets has. */
interface Best {
  readonly cost: Float64Array;
  readonly lead: number;
}

/** Least costs: a row for each state of the k - 1 onsets before (one if there is none), a column for each state. */
interface Reached {
  readonly cost: Float64Array;
  /** The state of the k-th onset before that leads to each. */
  readonly back: Int32Array;
  readonly rows: number;
  readonly columns: number;
}

function reach(best: Best, costs: Float64Array, columns: number): Reached {
  const rows = best.cost.length / best.lead;
  const cost = new Float64Array(rows * columns).fill(Infinity);
  const back = new Int32Array(rows * columns);
  for (let first = 0; first < best.lead; first++) {
    for (let row = 0; row < rows; row++) {
      const before = best.cost[first * rows + row]!;
      const from = (first * rows + row) * columns;
      const to = row * columns;
      for (let column = 0; column < columns; column++) {
        const total = before + costs[from + column]!;
        if (total < cost[to + column]!) {
          cost[to + column] = total;
          back[to + column] = first;
        }
      }
    }
  }
  return { cost, back, rows, columns };
}

/** Return all states, the cheapest first; of equals, the first ones. */
function cheapest({ cost, rows, columns }: Reached): number[] {
  const least = new Float64Array(columns).fill(Infinity);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      least[column] = Math.min(least[column]!, cost[row * columns + column]!);
    }
  }
  // Infinities are equal: their difference is NaN.
  return Array.from(least.keys()).sort((a, b) => least[a]! - least[b]! || 0);
}

function only({ cost, back, rows, columns }: Reached, kept: readonly number[]): Reached {
  const places = Array.from({ length: rows }, (_, row) => kept.map((one) => row * columns + one)).flat();
  return {
    cost: Float64Array.from(places, (place) => cost[place]!),
    back: Int32Array.from(places, (place) => back[place]!),
    rows,
    columns: kept.length,
  };
}

function trace<K, S extends Onset<K>>(
  path: readonly S[],
  backs: readonly Reached[],
  best: Best,
  order: 1 | 2,
): Map<K, number> {
  const fingers = new Map<K, number>();
  let place = 0; // in the costs of the last onset
  for (let i = 1; i < best.cost.length; i++) if (best.cost[i]! < best.cost[place]!) place = i;
  for (let at = path.length - 1; at >= 0; at--) {
    const { down, states } = path[at]!;
    const { back, columns } = backs[at]!;
    const state = place % columns;
    down.forEach((key, index) => fingers.set(key, states[state]![index]!));
    const row = Math.floor(place / columns);
    const first = back[place]!;
    // The row is the state of the onset before; behind it stands the one that led there.
    place = order === 1 ? first : first * (at > 0 ? backs[at - 1]!.columns : 1) + row;
  }
  return fingers;
}
