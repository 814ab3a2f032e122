/** What came over the live stream: the newest value of each channel, and to whom rows are given. */
import type { Frames, LiveMessage } from "../../net/live_messages";

/** Rows as they come: times in s since 1970, values per row in the order of `names`, qualities of the newest row. */
export type Taker = (frames: Frames) => void;

export interface Reading {
  name: string;
  unit: string;
  value: number | null;
  quality: string;
  /** Seconds since it was measured, as of the message that told; null: never. */
  age: number | null;
}

export class History {
  readonly readings = new Map<string, Reading>();
  acquisition: string | null = null;
  /** ms of this device's clock at the last message with values. */
  heard: number | null = null;
  missed = 0;
  readonly takers = new Set<Taker>();

  take(message: LiveMessage, now: number): void {
    if (message.acquisition !== undefined) this.acquisition = message.acquisition;
    if (message.type === "heartbeat") return;
    if (message.type === "snapshot") {
      this.begin(message.channels);
      if (message.time !== null) this.heard = now;
      return;
    }
    this.heard = now;
    this.missed += message.missed ?? 0;
    const last = message.samples[message.samples.length - 1];
    message.channels.forEach((name, index) => {
      const reading = this.readings.get(name);
      if (reading === undefined || last === undefined) return;
      reading.value = last.values[index] ?? null;
      reading.quality = message.quality[index] ?? "missing";
      reading.age = message.age_s?.[index] ?? null;
    });
    for (const taker of this.takers) taker(message);
  }

  private begin(channels: Extract<LiveMessage, { type: "snapshot" }>["channels"]): void {
    this.readings.clear();
    for (const [name, channel] of Object.entries(channels)) {
      const { value, unit, quality, age_s } = channel;
      this.readings.set(name, { name, unit, value, quality, age: age_s });
    }
  }
}
