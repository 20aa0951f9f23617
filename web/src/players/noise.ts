/** Standard normal numbers from a seed: uniform ones by Marsaglia's xorshift (2003), in pairs by Box and Muller. */
export class Noise {
  private state: number;
  private spare: number | null = null;

  /** @param seed A whole number other than 0. */
  constructor(seed: number) {
    this.state = seed;
  }

  next(): number {
    if (this.spare !== null) {
      const spare = this.spare;
      this.spare = null;
      return spare;
    }
    const radius = Math.sqrt(-2 * Math.log(this.uniform()));
    const angle = 2 * Math.PI * this.uniform();
    this.spare = radius * Math.sin(angle);
    return radius * Math.cos(angle);
  }

  /** A number above 0 and below 1. */
  private uniform(): number {
    this.state ^= this.state << 13;
    this.state ^= this.state >>> 17;
    this.state ^= this.state << 5;
    return (this.state >>> 0) / 2 ** 32;
  }
}
