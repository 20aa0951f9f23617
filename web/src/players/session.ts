import { EpisodeMetrics } from "../music/metrics";
import { loadSimulation, type OnSubstep, type Simulation } from "../simulation/simulation";
import { readTake, type Take } from "../take";
import { readTensors } from "../tensors";
import {
  InputError,
  type Assets,
  type CataloguePiece,
  type KeyEvent,
  type Metrics,
  type Piece,
  type PlayerId,
  type SceneState,
  type Session,
} from "../types";
import { ActionMap } from "./actions";
import { Noise } from "./noise";
import { Planned } from "./planned";
import type { Player } from "./player";
import { EpisodeRecord } from "./record";
import { Recorded } from "./recorded";
import { ScorePlayer } from "./score_player";
import { SightReader } from "./sight_reader";
import { restingControls, Visitor } from "./visitor";

/** Seed of the noise: an episode with the same settings is the same again. */
const SEED = 1;

/** Sessions on one simulated piano; there is one at a time, as a new one begins where the piano is. */
export class Sessions {
  private reader: SightReader | null = null;

  private constructor(
    private readonly assets: Assets,
    readonly simulation: Simulation,
  ) {}

  /** Load MuJoCo and the scene. */
  static async load(assets: Assets): Promise<Sessions> {
    return new Sessions(assets, await loadSimulation(assets));
  }

  /**
   * Begin to play a piece.
   *
   * @param entry What the catalogue has of the piece; null for a visitor's own file.
   * @param take The recording of the piece; null for that of the catalogue.
   * @throws InputError If this player cannot play the piece.
   */
  async open(piece: Piece, player: PlayerId, entry: CataloguePiece | null, take: Take | null): Promise<Session> {
    return new PianoSession(this.simulation, piece, player, await this.playerOf(player, entry, take));
  }

  private async playerOf(player: PlayerId, entry: CataloguePiece | null, take: Take | null): Promise<Player> {
    const { simulation } = this;
    switch (player) {
      case "sight-reader":
        this.reader ??= await SightReader.load(this.assets, simulation);
        return this.reader;
      case "planned":
        return new Planned(readTensors(await this.bytes(entry?.plan, "a plan")), simulation);
      case "recorded":
        take ??= await readTake(await this.bytes(entry?.recording, "a recording"), entry?.recording ?? "");
        return new Recorded(take, simulation);
      case "score":
        return new ScorePlayer(simulation);
      case "you":
        return new Visitor(simulation.facts);
    }
  }

  private async bytes(name: string | undefined, what: string): Promise<Uint8Array> {
    if (name === undefined) {
      throw new InputError(`There is no ${what.slice(2)} of this piece: expected a piece that comes with ${what}.`);
    }
    return this.assets.bytes(name);
  }
}

class PianoSession implements Session {
  noise = 0;
  latency = 0;
  readonly state: SceneState;
  private record!: EpisodeRecord;
  private judge!: EpisodeMetrics;
  private random!: Noise;
  /** What the player wanted, control step by control step. */
  private wanted: Float64Array[] = [];
  private failed = false;
  private readonly map: ActionMap;
  private readonly resting: Float64Array;

  constructor(
    private readonly simulation: Simulation,
    readonly piece: Piece,
    readonly player: PlayerId,
    private readonly actor: Player,
  ) {
    this.state = {
      keyState: simulation.keyState,
      sounding: simulation.sounding,
      get bodyPositions() {
        return simulation.bodyXpos;
      },
      get bodyQuaternions() {
        return simulation.bodyXquat;
      },
      bodyNames: simulation.facts.bodyNames,
    };
    this.map = new ActionMap(simulation.facts);
    this.resting = restingControls(simulation.facts);
    this.restart();
  }

  get stepsPlayed(): number {
    return this.record.steps;
  }

  get finished(): boolean {
    return this.failed || this.record.steps === this.piece.roll.steps;
  }

  restart(): void {
    const { steps, controlTimestep } = this.piece.roll;
    this.simulation.reset();
    this.record = new EpisodeRecord(this.simulation, steps, controlTimestep);
    this.judge = new EpisodeMetrics(this.piece.roll);
    this.random = new Noise(SEED);
    this.wanted = [];
    this.failed = false;
    this.actor.prepare(this.piece);
  }

  step(): readonly KeyEvent[] {
    if (this.finished) throw new Error("The piece is over: call restart() before step().");
    const { actor, simulation } = this;
    const step = this.record.steps;
    if (this.noise > 0 || this.latency > 0) actor.disturb?.();
    this.wanted[step] = actor.controls(step);
    let events: readonly KeyEvent[];
    try {
      events = this.placed(step) ?? this.simulated(step);
    } catch (error) {
      this.failed = true;
      throw error;
    }
    const strikes = events.filter((event) => event.down);
    this.judge.add(simulation.sounding, strikes);
    return events;
  }

  metrics(): Metrics {
    return this.judge.metrics();
  }

  played(): Uint8Array {
    return this.record.played();
  }

  pull(body: string | null, force?: readonly [number, number, number], at?: readonly [number, number, number]): void {
    this.simulation.letGo();
    if (body === null || force === undefined || at === undefined) return;
    const index = this.state.bodyNames.indexOf(body);
    if (index < 0) throw new Error(`There is no body ${body}: expected one of bodyNames.`);
    this.actor.disturb?.();
    this.simulation.pull(index, force, at);
  }

  pushKey(key: number, down: boolean): void {
    this.actor.disturb?.();
    this.simulation.pushKey(key, down);
  }

  private placed(step: number): readonly KeyEvent[] | null {
    const placed = this.actor.place?.(step) ?? null;
    return placed === null ? null : this.record.add(placed.sounding, placed.events);
  }

  private simulated(step: number): readonly KeyEvent[] {
    const look: OnSubstep = (substep, angles, speeds) => this.record.look(substep, angles, speeds);
    this.simulation.advance(this.controls(step), look);
    return this.record.addLooked();
  }

  /**
   * What the actuators are told: what was wanted `latency` control steps ago, with noise, within their ranges.
   *
   * It is rounded to an action on the way, as it is in Python: differences of a millionth grow with each contact.
   */
  private controls(step: number): Float64Array {
    const action = this.map.action(this.wanted[step - this.latency] ?? this.resting);
    // The range of an action is 2.
    if (this.noise > 0) action.forEach((value, i) => (action[i] = value + 2 * this.noise * this.random.next()));
    return this.map.controls(action);
  }
}
