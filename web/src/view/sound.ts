import { velocityOf } from "../music/dynamics";
import { MIN_PITCH, type Assets, type KeyEvent, type Pedal } from "../types";

/** A sample, and the pitch at which it was recorded. */
interface Sample {
  readonly pitch: number;
  readonly buffer: AudioBuffer;
}

interface Voice {
  readonly source: AudioScheduledSourceNode;
  readonly gain: GainNode;
}

/** Pitches of the samples of Salamander Grand Piano: every third, from A0 to C8. */
const SAMPLE_PITCHES = Array.from({ length: 30 }, (_, i) => 21 + 3 * i);
const SAMPLE_NAMES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"];

/** MIDI velocity that sounds as loud as the samples were played; half of it is 12 dB softer. */
const FULL_VELOCITY = 110;
/** Velocity of all notes where they are equally loud: MIDI's usual one. */
const FLAT_VELOCITY = 80;
/** Least loudness. */
const SOFTEST = 0.04;
/** Time in which a damper silences a string, s; strings from this pitch on have none. */
const DAMPING_TIME = 0.09;
const FIRST_UNDAMPED_PITCH = 90;
/** Time constant in which a synthesised tone of middle C dies away, s. */
const TONE_DECAY = 1.1;
const MIDDLE_C = 60;

/** Samples a second of a file, and how long it goes on after the end, s. */
const RATE = 44_100;
const RINGING = 1.5;

/** The piano's sound: samples of a grand piano, or a synthesised tone where these cannot be decoded. */
export class PianoSound {
  private context: BaseAudioContext | null = null;
  private output: GainNode | null = null;
  private analyser: AnalyserNode | null = null;
  private samples: readonly Sample[] = [];
  private loading: Promise<void> | null = null;
  private readonly voices = new Map<number, Voice>();
  private readonly held = new Map<number, Voice>();
  private pedal = false;
  private loudness = 0.8;
  /** Whether all notes are equally loud, whatever was struck. */
  flat = false;

  constructor(private readonly assets: Assets) {}

  /** Begin to sound; browsers allow it in answer to a click or a key only. */
  async start(): Promise<void> {
    if (this.context === null) this.connect(new AudioContext({ latencyHint: "interactive" }));
    await (this.context as AudioContext).resume();
    this.loading ??= this.load();
    await this.loading;
  }

  /** Whether it can be heard. */
  get running(): boolean {
    return this.context?.state === "running";
  }

  /** Whether the samples are there; otherwise tones are synthesised. */
  get sampled(): boolean {
    return this.samples.length > 0;
  }

  /** 0 to 1. */
  set volume(volume: number) {
    this.loudness = volume;
    if (this.output !== null) this.output.gain.setTargetAtTime(volume, this.context!.currentTime, 0.02);
  }

  /** Root mean square of what sounds just now. */
  level(): number {
    if (this.analyser === null) return 0;
    const wave = new Float32Array(this.analyser.fftSize);
    this.analyser.getFloatTimeDomainData(wave);
    return Math.sqrt(wave.reduce((sum, value) => sum + value * value, 0) / wave.length);
  }

  /** Sound a key that went down, or let it go, in so many seconds from now. */
  play(event: KeyEvent, delay: number): void {
    if (!this.running) return;
    const at = this.context!.currentTime + Math.max(0, delay);
    if (event.down) this.strike(event.key, event.speed, at);
    else this.release(event.key, at);
  }

  /** Hold all strings that sound from now on, or damp those whose keys are up. */
  setPedal(down: boolean, at = this.context?.currentTime ?? 0): void {
    if (this.pedal && !down) {
      for (const voice of this.held.values()) this.damp(voice, at);
      this.held.clear();
    }
    this.pedal = down;
  }

  /** Silence everything. */
  stop(): void {
    if (this.context === null) return;
    for (const voice of [...this.voices.values(), ...this.held.values()]) {
      this.damp(voice, this.context.currentTime);
    }
    this.voices.clear();
    this.held.clear();
  }

  /** Make the sound of a whole performance of so many s, as fast as it goes. */
  async render(events: readonly KeyEvent[], pedals: readonly Pedal[], seconds: number): Promise<AudioBuffer> {
    const context = new OfflineAudioContext(2, Math.ceil((seconds + RINGING) * RATE), RATE);
    const piano = new PianoSound(this.assets);
    piano.flat = this.flat;
    piano.connect(context);
    if (this.sampled) piano.samples = this.samples;
    else await piano.load();
    const moves: [number, () => void][] = events.map((event) => [
      event.time,
      () => (event.down ? piano.strike(event.key, event.speed, event.time) : piano.release(event.key, event.time)),
    ]);
    for (const { onset, offset } of pedals) {
      moves.push([onset, () => piano.setPedal(true, onset)], [offset, () => piano.setPedal(false, offset)]);
    }
    for (const [, move] of moves.sort((a, b) => a[0] - b[0])) move();
    return context.startRendering();
  }

  private connect(context: BaseAudioContext): void {
    this.context = context;
    this.output = new GainNode(context, { gain: this.loudness });
    this.analyser = new AnalyserNode(context, { fftSize: 2048 });
    // Chords of ten strings stay below what a loudspeaker can do.
    const limiter = new DynamicsCompressorNode(context, { threshold: -14, ratio: 6, attack: 0.004, release: 0.2 });
    this.output.connect(limiter).connect(this.analyser).connect(context.destination);
    const room = new ConvolverNode(context, { buffer: roomResponse(context) });
    this.output.connect(room).connect(new GainNode(context, { gain: 0.16 })).connect(limiter);
  }

  private async load(): Promise<void> {
    const context = this.context!;
    const loaded = await Promise.all(
      SAMPLE_PITCHES.map(async (pitch) => {
        try {
          const name = `${SAMPLE_NAMES[pitch % 12]}${Math.floor(pitch / 12) - 1}v10.ogg`;
          const bytes = await this.assets.bytes(`samples/${name}`);
          return { pitch, buffer: await context.decodeAudioData(bytes.slice().buffer) };
        } catch {
          // A browser without Ogg Vorbis, or a page without samples: the tone is synthesised.
          return null;
        }
      }),
    );
    this.samples = loaded.filter((sample) => sample !== null);
  }

  private strike(key: number, speed: number, at: number): void {
    const before = this.voices.get(key) ?? this.held.get(key);
    if (before !== undefined) this.damp(before, at);
    this.held.delete(key);
    const velocity = this.flat ? FLAT_VELOCITY : velocityOf(speed, key);
    const loudness = Math.max(SOFTEST, Math.min(1, velocity / FULL_VELOCITY) ** 2);
    const voice = this.sampled ? this.sampleVoice(key, loudness, at) : this.toneVoice(key, loudness, at);
    this.voices.set(key, voice);
    voice.source.onended = () => {
      if (this.voices.get(key) === voice) this.voices.delete(key);
      if (this.held.get(key) === voice) this.held.delete(key);
    };
  }

  private release(key: number, at: number): void {
    const voice = this.voices.get(key);
    if (voice === undefined || key + MIN_PITCH >= FIRST_UNDAMPED_PITCH) return;
    this.voices.delete(key);
    if (this.pedal) this.held.set(key, voice);
    else this.damp(voice, at);
  }

  private damp(voice: Voice, at: number): void {
    voice.gain.gain.setTargetAtTime(0, at, DAMPING_TIME);
    voice.source.stop(at + 8 * DAMPING_TIME);
  }

  private sampleVoice(key: number, loudness: number, at: number): Voice {
    const context = this.context!;
    const pitch = key + MIN_PITCH;
    const nearest = this.samples.reduce((best, sample) =>
      Math.abs(sample.pitch - pitch) < Math.abs(best.pitch - pitch) ? sample : best,
    );
    const source = new AudioBufferSourceNode(context, {
      buffer: nearest.buffer,
      playbackRate: 2 ** ((pitch - nearest.pitch) / 12),
    });
    const gain = new GainNode(context, { gain: loudness });
    // A string that is struck softly has fewer overtones.
    const filter = new BiquadFilterNode(context, { type: "lowpass", frequency: 900 + 15000 * loudness ** 2, Q: 0 });
    source.connect(filter).connect(gain).connect(this.output!);
    source.start(at);
    return { source, gain };
  }

  private toneVoice(key: number, loudness: number, at: number): Voice {
    const context = this.context!;
    const pitch = key + MIN_PITCH;
    const source = new OscillatorNode(context, {
      frequency: 440 * 2 ** ((pitch - 69) / 12),
      periodicWave: context.createPeriodicWave([0, 0, 0, 0, 0, 0], [0, 1, 0.45, 0.25, 0.12, 0.06]),
      type: "custom",
    });
    const gain = new GainNode(context, { gain: 0 });
    const decay = TONE_DECAY * 2 ** ((MIDDLE_C - pitch) / 18);
    gain.gain.setValueAtTime(0, at);
    gain.gain.linearRampToValueAtTime(0.3 * loudness, at + 0.005);
    gain.gain.setTargetAtTime(0, at + 0.005, decay);
    source.connect(gain).connect(this.output!);
    source.start(at);
    source.stop(at + 7 * decay);
    return { source, gain };
  }
}

/** A small room: noise that dies away within a second. */
function roomResponse(context: BaseAudioContext): AudioBuffer {
  const buffer = new AudioBuffer({ length: context.sampleRate, sampleRate: context.sampleRate, numberOfChannels: 2 });
  for (let channel = 0; channel < 2; channel++) {
    const wave = buffer.getChannelData(channel);
    for (let i = 0; i < wave.length; i++) {
      wave[i] = (2 * Math.random() - 1) * Math.exp((-5 * i) / wave.length);
    }
  }
  return buffer;
}
