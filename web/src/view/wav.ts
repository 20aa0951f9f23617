/** A WAV file of 16 bits. */
export function wavOf(sound: AudioBuffer): Uint8Array<ArrayBuffer> {
  const { numberOfChannels: channels, sampleRate: rate, length } = sound;
  const size = 2 * channels * length;
  const file = new Uint8Array(44 + size);
  const view = new DataView(file.buffer);
  const text = (at: number, letters: string): void => file.set(new TextEncoder().encode(letters), at);
  text(0, "RIFF");
  view.setUint32(4, 36 + size, true);
  text(8, "WAVEfmt ");
  view.setUint32(16, 16, true);
  view.setUint16(20, 1, true);
  view.setUint16(22, channels, true);
  view.setUint32(24, rate, true);
  view.setUint32(28, 2 * channels * rate, true);
  view.setUint16(32, 2 * channels, true);
  view.setUint16(34, 16, true);
  text(36, "data");
  view.setUint32(40, size, true);
  for (let channel = 0; channel < channels; channel++) {
    sound.getChannelData(channel).forEach((value, i) => {
      const level = Math.max(-1, Math.min(1, value));
      view.setInt16(44 + 2 * (channels * i + channel), Math.round(32767 * level), true);
    });
  }
  return file;
}
