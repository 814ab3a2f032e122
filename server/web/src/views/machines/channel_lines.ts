/** The line of a machine file that makes a channel of a signal, and where it goes; comments stay where they are. */

export interface NewChannel {
  name: string;
  quantity: string;
  joint: string | null;
  unit: string;
  source: Record<string, string | number>;
}

/** What a signal of a unit measures, most often: a first choice for whoever makes a channel of it. */
const MEASURES: [RegExp, string][] = [
  [/^(deg|°|rad)$/, "joint_position"],
  [/^(deg|°|rad)\/s$/, "joint_velocity"],
  [/^(m?bar|[hkM]?Pa|psi)$/, "head_pressure"],
  [/^[cm]?m$/, "piston_position"],
  [/^k?N ?m$/, "joint_effort"],
  [/^k?N$/, "cylinder_force"],
  [/^(°|deg ?)?C$/i, "oil_temperature"],
];

/** The quantity that is offered first for a unit, of those that a channel can have. */
export function likelyQuantity(unit: string, offered: string[]): string {
  const found = MEASURES.find(([pattern, quantity]) => pattern.test(unit.trim()) && offered.includes(quantity));
  return found?.[1] ?? offered[0] ?? "";
}

/** Words that YAML takes for something else than text. */
const NOT_TEXT = /^(y|n|yes|no|on|off|true|false|null)$/i;

function scalar(value: string | number, key: string): string {
  if (typeof value === "number")
    return key === "pgn" ? `0x${value.toString(16).toUpperCase().padStart(4, "0")}` : `${value}`;
  return /^[A-Za-z_][\w./^ *-]*$/.test(value) && !/\s$/.test(value) && !NOT_TEXT.test(value)
    ? value
    : JSON.stringify(value);
}

function mapping(pairs: [string, string][]): string {
  return `{${pairs.map(([key, value]) => `${key}: ${value}`).join(", ")}}`;
}

export function channelLine(channel: NewChannel): string {
  const source = mapping(Object.entries(channel.source).map(([key, value]) => [key, scalar(value, key)]));
  return `- ${mapping([
    ["name", scalar(channel.name, "name")],
    ["quantity", channel.quantity],
    ...(channel.joint === null ? [] : [["joint", scalar(channel.joint, "joint")] as [string, string]]),
    ["unit", scalar(channel.unit, "unit")],
    ["source", source],
  ])}`;
}

/** A name of a channel that the service takes, made of a signal's. */
export function channelName(message: string, signal: string): string {
  const made = `${message}.${signal}`.replace(/[^A-Za-z0-9_.-]/g, "_").toLowerCase();
  return /^[a-z_]/.test(made) ? made.slice(0, 80) : `_${made}`.slice(0, 80);
}

export interface Insertion {
  text: string;
  /** Number of the new line, the first is 1. */
  line: number;
}

/** A text with one more item at the end of its list `channels`; null if it has no such list in block style. */
export function inserted(text: string, item: string): Insertion | null {
  const lines = text.split("\n");
  const head = lines.findIndex((line) => /^channels:\s*(#.*)?$/.test(line));
  if (head < 0) return null;
  let last: number | null = null;
  let indent: string | null = null;
  for (let at = head + 1; at < lines.length; at++) {
    const line = (lines[at] as string).trimEnd();
    if (line === "" || /^\s*#/.test(line)) continue;
    const dash = /^(\s*)-(\s|$)/.exec(line);
    if (!/^\s/.test(line) && dash === null) break; // the next key
    if (indent === null) {
      if (dash === null) return null;
      indent = dash[1] ?? "";
    }
    last = at;
  }
  if (last === null || indent === null) return null;
  const end = (lines[last] as string).endsWith("\r") ? "\r" : "";
  const tail = lines.length - 1 === last ? "" : end;
  return {
    text: [...lines.slice(0, last + 1), indent + item + tail, ...lines.slice(last + 1)].join("\n"),
    line: last + 2,
  };
}
