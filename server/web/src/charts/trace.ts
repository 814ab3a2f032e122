/**
 * What is drawn: columns over time, from what the service remembers and from what came since.
 *
 * Where a moment is longer than a row, each moment is two entries, its smallest and its largest value, so that a line
 * through them fills what happened. A break in time is entries of null.
 */
import type { components } from "../net/api.gen";

export type Signals = components["schemas"]["Signals"];
export type Value = number | null;
export type Run = [number, number];

/** A pause longer than this (s), or than one and a half moments, is drawn as a gap. */
const GAP_S = 0.5;
/** Moments that may gather beyond the span before the old ones are dropped. */
const SLACK = 400;

export class Trace {
  t: number[] = [];
  readonly columns = new Map<string, Value[]>();
  /** From when to when a channel's value was not measured. */
  readonly doubtful = new Map<string, Run[]>();

  /** The values of the row that is added, and where they are among the names that it came with. */
  private readonly row: Value[] = [];
  private places: { names: string[]; at: number[] } = { names: [], at: [] };

  /** `moment`: s that a moment lasts; 0 for rows. */
  constructor(
    readonly names: string[],
    readonly moment = 0,
  ) {
    for (const name of names) {
      this.columns.set(name, []);
      this.doubtful.set(name, []);
    }
  }

  static of(signals: Signals): Trace {
    const names = Object.keys(signals.channels);
    const trace = new Trace(names, signals.moment_s);
    signals.time.forEach((time, row) => {
      trace.push(
        time,
        names.map((name) => signals.channels[name]?.low[row] ?? null),
        names.map((name) => signals.channels[name]?.high?.[row] ?? null),
      );
    });
    for (const name of names) trace.doubtful.set(name, [...(signals.channels[name]?.doubtful ?? [])] as Run[]);
    return trace;
  }

  get end(): number | undefined {
    const last = this.t[this.t.length - 1];
    return last === undefined ? undefined : last + this.moment / 4;
  }

  /** Add one row that came just now; what is not later than the last is dropped, a clock that was set back begins anew. */
  append(time: number, names: string[], values: Value[], measured: (name: string) => boolean): void {
    const newest = this.t[this.t.length - 1];
    if (newest !== undefined && newest - this.moment - time > 1) this.clear();
    const end = this.t[this.t.length - 1];
    const places = this.placesIn(names);
    const found = this.row;
    for (let index = 0; index < places.length; index += 1) found[index] = values[places[index] as number] ?? null;
    if (this.moment > 0) {
      const middle = (Math.floor(time / this.moment) + 0.5) * this.moment;
      const last = this.t[this.t.length - 2];
      if (last !== undefined && Math.abs(last + this.moment / 4 - middle) < this.moment / 4) this.widen(found);
      else if (last === undefined || middle > last) this.push(middle, found, found);
    } else if (end === undefined || time > end) this.push(time, found, found);
    for (const name of this.names) if (!measured(name)) this.mark(name, time);
  }

  /** Drop what is older than `span` seconds. */
  trim(span: number): void {
    const end = this.end;
    if (end === undefined) return;
    let old = 0;
    while ((this.t[old] as number) < end - span) old += 1;
    old -= old % 2;
    if (old < SLACK) return;
    this.t.splice(0, old);
    for (const column of this.columns.values()) column.splice(0, old);
    const start = this.t[0] ?? 0;
    for (const [name, runs] of this.doubtful)
      this.doubtful.set(
        name,
        runs.filter(([, to]) => to >= start),
      );
  }

  private push(time: number, low: Value[], high: Value[]): void {
    const end = this.end;
    const longest = Math.max(GAP_S, 1.6 * this.moment);
    const gap = end !== undefined && time - this.moment / 2 - end > longest - this.moment / 2;
    const quarter = this.moment / 4;
    if (gap) this.entry(end + quarter + 0.01, end + quarter + 0.02, null, null);
    this.entry(time - quarter, time + quarter, low, high);
  }

  /** One entry, or for moments two. */
  private entry(first: number, second: number, low: Value[] | null, high: Value[] | null): void {
    const both = this.moment > 0;
    this.t.push(first);
    if (both) this.t.push(second);
    let index = 0;
    for (const column of this.columns.values()) {
      column.push(low?.[index] ?? null);
      if (both) column.push(high?.[index] ?? null);
      index += 1;
    }
  }

  /** Where each of our names is in a list; that of rows that come together is looked through once. */
  private placesIn(names: string[]): number[] {
    if (this.places.names !== names) {
      const at = new Map(names.map((name, index) => [name, index]));
      this.places = { names, at: this.names.map((name) => at.get(name) ?? -1) };
    }
    return this.places.at;
  }

  private widen(values: Value[]): void {
    this.names.forEach((name, index) => {
      const value = values[index] ?? null;
      const column = this.columns.get(name) as Value[];
      const at = column.length - 2;
      if (value === null || at < 0) return;
      column[at] = Math.min(column[at] ?? value, value);
      column[at + 1] = Math.max(column[at + 1] ?? value, value);
    });
  }

  private mark(name: string, time: number): void {
    const runs = this.doubtful.get(name) as Run[];
    const last = runs[runs.length - 1];
    if (last !== undefined && time - last[1] < GAP_S) last[1] = Math.max(last[1], time);
    else runs.push([time, time]);
  }

  private clear(): void {
    this.t = [];
    for (const name of this.names) {
      this.columns.set(name, []);
      this.doubtful.set(name, []);
    }
  }
}
