/** Messages of the live stream, checked as far as the page relies on them. */

export interface ChannelValue {
  value: number | null;
  unit: string;
  quality: string;
  age_s: number | null;
}
export interface Snapshot {
  type: "snapshot";
  seq: number;
  acquisition?: string;
  time: number | null;
  channels: Record<string, ChannelValue>;
}
export interface Frames {
  type: "frames";
  seq: number;
  channels: string[];
  /** `t`: s of machine time; `utc`: s since 1970. */
  samples: { t: number; utc: number; values: (number | null)[] }[];
  quality: string[];
  age_s?: (number | null)[];
  acquisition?: undefined;
  /** Rows that were lost before these. */
  missed?: number;
}
export interface Heartbeat {
  type: "heartbeat";
  seq: number;
  acquisition?: string;
}
export type LiveMessage = Snapshot | Frames | Heartbeat;

/** The message, or null if it is none of ours. */
export function parseLive(text: string): LiveMessage | null {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    return null;
  }
  if (typeof value !== "object" || value === null) return null;
  const message = value as Partial<LiveMessage>;
  if (typeof message.seq !== "number") return null;
  if (message.type === "heartbeat") return message as Heartbeat;
  if (message.type === "snapshot" && typeof message.channels === "object" && message.channels !== null)
    return message as Snapshot;
  if (message.type === "frames" && Array.isArray(message.samples) && Array.isArray(message.channels))
    return message as Frames;
  return null;
}
