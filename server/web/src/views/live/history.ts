/** What came over the live stream: the newest value of each channel, and the last half minute of all. */
import type { LiveMessage } from "../../net/live_messages";

/** Seconds that are drawn. */
export const SPAN_S = 30;
/** Rows that may gather beyond that before the old ones are dropped. */
const SLACK = 250;
/** A pause longer than this is drawn as a gap. */
const GAP_S = 0.5;

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
  /** s, the machine's own time. */
  t: number[] = [];
  columns = new Map<string, (number | null)[]>();
  acquisition: string | null = null;
  /** ms of this device's clock at the last message with values. */
  heard: number | null = null;
  missed = 0;

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
    for (const sample of message.samples) this.add(sample.t, message.channels, sample.values);
    const last = message.samples[message.samples.length - 1];
    message.channels.forEach((name, index) => {
      const reading = this.readings.get(name);
      if (reading === undefined || last === undefined) return;
      reading.value = last.values[index] ?? null;
      reading.quality = message.quality[index] ?? "missing";
      reading.age = message.age_s?.[index] ?? null;
    });
    this.trim();
  }

  private begin(channels: Extract<LiveMessage, { type: "snapshot" }>["channels"]): void {
    this.readings.clear();
    for (const [name, channel] of Object.entries(channels)) {
      const { value, unit, quality, age_s } = channel;
      this.readings.set(name, { name, unit, value, quality, age: age_s });
      if (!this.columns.has(name))
        this.columns.set(
          name,
          this.t.map(() => null),
        );
    }
    for (const name of [...this.columns.keys()]) if (!this.readings.has(name)) this.columns.delete(name);
    if (this.readings.size === 0) this.t = [];
  }

  private add(time: number, names: string[], values: (number | null)[]): void {
    const before = this.t[this.t.length - 1];
    if (before !== undefined && time <= before) {
      // The acquisition began anew, and its time with it; a sample that came twice is dropped.
      if (before - time < 1) return;
      this.t = [];
      for (const name of this.columns.keys()) this.columns.set(name, []);
    } else if (before !== undefined && time - before > GAP_S) {
      this.t.push(before + 0.02);
      for (const column of this.columns.values()) column.push(null);
    }
    this.t.push(time);
    const row = new Map(names.map((name, index) => [name, values[index] ?? null]));
    for (const [name, column] of this.columns) column.push(row.get(name) ?? null);
  }

  private trim(): void {
    const end = this.t[this.t.length - 1];
    if (end === undefined) return;
    let old = 0;
    while ((this.t[old] as number) < end - SPAN_S) old += 1;
    if (old < SLACK) return;
    this.t.splice(0, old);
    for (const column of this.columns.values()) column.splice(0, old);
  }
}
