/**
 * How far a recorded motion is, from what the service remembers of the machine since the recording began.
 *
 * Nothing is gathered on the device: a page that slept, was reloaded or opened elsewhere sees the same.
 */
import type { components } from "../../net/api.gen";

type Signals = components["schemas"]["Signals"];

export interface WatchedMachine {
  joints: {
    name: string;
    limits: { position: [number, number]; velocity: number };
    cylinder?: { stroke?: number | null } | null;
  }[];
}
interface Channel {
  name: string;
  quantity: string;
  joint?: string | undefined;
  unit: string;
}

/** SI unit of one, and what is a motion and no noise, per unit of position. */
const UNITS: Record<string, { si: number; moves: number }> = {
  rad: { si: 1, moves: 0.01 },
  mrad: { si: 1e-3, moves: 10 },
  deg: { si: Math.PI / 180, moves: 0.5 },
  m: { si: 1, moves: 0.003 },
  cm: { si: 1e-2, moves: 0.3 },
  mm: { si: 1e-3, moves: 3 },
};
/** s over which speeds are taken: shorter ones are noise. */
const SPEED_S = 0.4;

/** Channels that tell of motion: the free cylinders', or the joints'. */
export function watchedChannels(channels: Channel[], unloaded: boolean): Channel[] {
  const wanted = unloaded ? "piston_position" : "joint_position";
  const found = channels.filter((one) => one.quantity === wanted && one.unit in UNITS);
  return found.length > 0 ? found : channels.filter((one) => one.quantity === "joint_position" && one.unit in UNITS);
}

export interface Coverage {
  joint: string;
  /** Shares of what the machine file allows; null where it does not say. */
  range: number | null;
  speed: number | null;
}
export interface Progress {
  /** Whether anything moved since the recording began. */
  moved: boolean;
  /** s since which nothing moves; 0 while something does. */
  rest: number;
  coverage: Coverage[];
}

/** What was moved since `since` (s since 1970), of channels in `signals`; null where nothing was measured since. */
export function progress(
  signals: Signals,
  channels: Channel[],
  machine: WatchedMachine,
  since: number,
): Progress | null {
  const first = signals.time.findIndex((time) => time >= since);
  if (first < 0) return null;
  const times = signals.time.slice(first);
  const end = times[times.length - 1] as number;
  let moved = false;
  let rest = Infinity;
  const coverage: Coverage[] = [];
  for (const channel of channels) {
    const trace = signals.channels[channel.name];
    const unit = UNITS[channel.unit];
    if (trace === undefined || unit === undefined) continue;
    const low = trace.low.slice(first);
    const high = (trace.high ?? trace.low).slice(first);
    const spread = extent(low, high);
    if (spread === null) continue;
    const [least, most] = spread;
    if (most - least > 2 * unit.moves) moved = true;
    rest = Math.min(rest, end - lastMotion(times, low, high, unit.moves));
    coverage.push(covered(channel, machine, (most - least) * unit.si, fastest(times, low, high) * unit.si));
  }
  return coverage.length === 0 ? null : { moved, rest: Number.isFinite(rest) ? Math.max(0, rest) : 0, coverage };
}

function extent(low: (number | null)[], high: (number | null)[]): [number, number] | null {
  let [least, most] = [Infinity, -Infinity];
  for (let row = 0; row < low.length; row += 1) {
    least = Math.min(least, low[row] ?? Infinity);
    most = Math.max(most, high[row] ?? -Infinity);
  }
  return least <= most ? [least, most] : null;
}

/** The last time at which a channel was further than `moves` from where it is at the end; the first if it never was. */
function lastMotion(times: number[], low: (number | null)[], high: (number | null)[], moves: number): number {
  let last: number | null = null;
  for (let row = times.length - 1; row >= 0; row -= 1) {
    const [below, above] = [low[row] ?? null, high[row] ?? null];
    if (below === null || above === null) continue;
    last ??= (below + above) / 2;
    if (above - last > moves || last - below > moves) return times[row] as number;
  }
  return times[0] as number;
}

function fastest(times: number[], low: (number | null)[], high: (number | null)[]): number {
  let most = 0;
  let before = 0;
  for (let row = 0; row < times.length; row += 1) {
    while ((times[row] as number) - (times[before + 1] ?? Infinity) >= SPEED_S) before += 1;
    const seconds = (times[row] as number) - (times[before] as number);
    const [here, there] = [middle(low[row], high[row]), middle(low[before], high[before])];
    if (seconds >= SPEED_S && seconds < 5 * SPEED_S && here !== null && there !== null)
      most = Math.max(most, Math.abs(here - there) / seconds);
  }
  return most;
}

const middle = (low: number | null | undefined, high: number | null | undefined): number | null =>
  low == null || high == null ? null : (low + high) / 2;

function covered(channel: Channel, machine: WatchedMachine, range: number, speed: number): Coverage {
  const joint = machine.joints.find((one) => one.name === channel.joint);
  const name = channel.joint ?? channel.name;
  if (joint === undefined) return { joint: name, range: null, speed: null };
  if (channel.quantity === "piston_position") {
    const stroke = joint.cylinder?.stroke;
    return { joint: name, range: stroke ? range / stroke : null, speed: null };
  }
  const [least, most] = joint.limits.position;
  const whole = most - least;
  return {
    joint: name,
    range: whole > 0 && Number.isFinite(whole) ? range / whole : null,
    speed: joint.limits.velocity > 0 ? speed / joint.limits.velocity : null,
  };
}
