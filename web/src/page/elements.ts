/** The element of some id. @throws Error If index.html has none of that kind. */
function found<T extends Element>(id: string, kind: new () => T): T {
  const element = document.getElementById(id);
  if (!(element instanceof kind)) throw new Error(`index.html has no ${kind.name} with the id ${id}.`);
  return element;
}

/** All elements of index.html that the page reads or writes. */
export function findElements() {
  return {
    stage: found("stage", HTMLElement),
    scene: found("scene", HTMLCanvasElement),
    roll: found("roll", HTMLCanvasElement),
    title: found("title", HTMLElement),
    subtitle: found("subtitle", HTMLElement),
    right: found("right", HTMLElement),
    f1: found("f1", HTMLElement),
    onsetF1: found("onset-f1", HTMLElement),
    views: found("views", HTMLFieldSetElement),
    begin: found("begin", HTMLButtonElement),
    beginText: found("begin-text", HTMLElement),
    seek: found("seek", HTMLInputElement),
    restart: found("restart", HTMLButtonElement),
    play: found("play", HTMLButtonElement),
    step: found("step", HTMLButtonElement),
    clock: found("clock", HTMLOutputElement),
    tempo: found("tempo", HTMLInputElement),
    tempoText: found("tempo-text", HTMLOutputElement),
    volume: found("volume", HTMLInputElement),
    dynamics: found("dynamics", HTMLInputElement),
    caption: found("caption", HTMLElement),
    message: found("message", HTMLElement),
    piece: found("piece", HTMLSelectElement),
    open: found("open", HTMLButtonElement),
    file: found("file", HTMLInputElement),
    warnings: found("warnings", HTMLUListElement),
    versions: found("versions", HTMLFieldSetElement),
    players: found("players", HTMLTableElement),
    musicianship: found("musicianship", HTMLDetailsElement),
    musicianshipFigures: found("musicianship-figures", HTMLElement),
    playersNote: found("players-note", HTMLElement),
    saveMidi: found("save-midi", HTMLButtonElement),
    saveWav: found("save-wav", HTMLButtonElement),
    copyLink: found("copy-link", HTMLButtonElement),
    linkNote: found("link-note", HTMLElement),
    visitor: found("visitor", HTMLElement),
    octave: found("octave", HTMLOutputElement),
    connect: found("connect", HTMLButtonElement),
    connected: found("connected", HTMLElement),
    noise: found("noise", HTMLInputElement),
    noiseText: found("noise-text", HTMLOutputElement),
    latency: found("latency", HTMLInputElement),
    latencyText: found("latency-text", HTMLOutputElement),
  };
}

export type Elements = ReturnType<typeof findElements>;
