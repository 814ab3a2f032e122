/** What the plots of a machine draw: the past from the service, and what came since. */
import { useEffect, useRef, useState } from "preact/hooks";
import { LONGEST_S, type Range, type Shown } from "../../charts/range";
import { type Signals, Trace } from "../../charts/trace";
import { query } from "../../net/client";
import { useSession } from "../../session";
import type { History, Taker } from "./history";
import { t } from "../../texts";

const GOOD = ["fresh", "held", "out_of_range"];
/** Moments that are asked for: rows as they are for what is short enough, else about the pixels of a plot. */
const moments = (span: number): number => (span <= 30 ? 2000 : 900);
/** ms that a range has to stand still before it is asked for. */
const SETTLED_MS = 250;

export interface LiveSignals {
  /** What is drawn now; another one once the service has answered. */
  trace(): Trace;
  /** The range that is shown now. */
  range(): Range;
  /** Nothing is older, and nothing newer, than this. */
  bounds(): Range;
  error: string | null;
}

/**
 * `names`: of the channels that are drawn; `changed` is called when there is something new to draw. `renewed` counts
 * how often the connection began anew: then what was missed is asked for.
 */
export function useSignals(
  machine: string,
  history: History,
  names: string[],
  shown: Shown,
  renewed: string,
  changed: () => void,
): LiveSignals {
  const session = useSession();
  const held = useRef(new Trace(names));
  const pending = useRef<Parameters<Taker>[0][]>([]);
  const clock = useRef<number | null>(null);
  const now = useRef(shown);
  now.current = shown;
  const [error, setError] = useState<string | null>(null);
  const wanted = names.join("\n");
  const span = shown.kind === "live" ? shown.span : shown.to - shown.from;
  const end = shown.kind === "live" ? null : shown.to;

  useEffect(() => {
    const taker: Taker = (frames) => {
      const last = frames.samples[frames.samples.length - 1];
      if (last !== undefined) clock.current = ahead(clock.current, last.utc);
      pending.current.push(frames);
      if (pending.current.length > 600) pending.current.shift(); // a minute: the service remembers it as well
      if (now.current.kind === "fixed") return;
      drain(held.current, pending.current);
      held.current.trim(now.current.span * 1.1 + 1);
      changed();
    };
    history.takers.add(taker);
    return () => void history.takers.delete(taker);
  }, [history]);

  useEffect(() => {
    let gone = false;
    const read = async (): Promise<void> => {
      const asked = { seconds: Math.min(LONGEST_S, span * 1.02 + 0.1), end, moments: moments(span) };
      const channels = wanted.split("\n").map((name) => `&channel=${encodeURIComponent(name)}`);
      const path = `/machines/${encodeURIComponent(machine)}/signals${query(asked)}${channels.join("")}`;
      const outcome = await session.client.get<Signals>(path);
      if (gone) return;
      setError(outcome.kind === "done" ? null : t("live.pastCouldNotRead", { text: outcome.text }));
      if (outcome.kind !== "done" || outcome.value.time.length === 0) return;
      const trace = Trace.of(outcome.value);
      if (end === null) drain(trace, pending.current);
      held.current = trace;
      changed();
    };
    const timer = setTimeout(() => void read(), end === null ? 0 : SETTLED_MS);
    return () => {
      gone = true;
      clearTimeout(timer);
    };
  }, [machine, wanted, span, end, renewed, session]);

  const newest = (): number => {
    const last = held.current.end ?? Date.now() / 1000;
    if (clock.current === null) return last;
    // Not further than the next message may be away: what does not come is not drawn as if it had.
    return Math.max(last, Math.min(performance.now() / 1000 + clock.current, last + held.current.moment + 0.5));
  };
  return {
    trace: () => held.current,
    range: () => {
      const { current } = now;
      if (current.kind === "fixed") return [current.from, current.to];
      const to = newest();
      return [to - current.span, to];
    },
    bounds: () => [newest() - LONGEST_S, newest()],
    error,
  };
}

/** Give rows that are waiting to a trace; those that it has already it drops. */
function drain(trace: Trace, pending: Parameters<Taker>[0][]): void {
  for (const frames of pending.splice(0)) {
    const quality = new Map(frames.channels.map((name, index) => [name, frames.quality[index] ?? "missing"]));
    for (const sample of frames.samples)
      trace.append(sample.utc, frames.channels, sample.values, (name) => GOOD.includes(quality.get(name) ?? "missing"));
  }
}

/** Machine's clock less this device's, s: so that time goes on evenly though messages come ten times a second. */
function ahead(before: number | null, utc: number): number {
  const now = utc - performance.now() / 1000;
  if (before === null || Math.abs(now - before) > 1) return now;
  return before + (now > before ? 0.5 : 0.02) * (now - before);
}
