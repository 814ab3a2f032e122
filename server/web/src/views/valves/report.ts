/** What the page reads of a report on valves (schema `hilfit/valve/1`). */

import type { Message } from "../../texts/message";
import { inLanguage } from "../../texts/report";

export interface Value {
  value: number;
  std: number | null;
  ci95: [number, number] | null;
}
export interface Direction {
  moves: boolean;
  edge_at_2_percent?: Value & { command: number; command_unit: string };
  /** Missing in reports of earlier versions. */
  compensated?: { value: number; too_small_by: Value } | null;
  law?: { id: string; title: string };
  speed_at_largest?: { value: number };
}
export interface Effect {
  id: string;
  title: string;
  probability: number;
  error_before: number;
  error_after: number;
  indistinguishable_from: string[];
  look_at?: string;
  experiment?: string;
}
export interface Axis {
  rows: { kept: number; all: number };
  handed_out: "model" | "before" | "static";
  delay: Value & { profile: [number, number][] };
  directions: { extend: Direction; retract: Direction };
  pump_limit: { value: number } | null;
  errors: Record<"before" | "after" | "handed_out" | "linear" | "arx" | "static", number | null> & {
    role: "train" | "validate";
  };
  effects: Effect[];
  /** Laws that no name says; missing in reports of earlier versions. */
  unexplained?: Effect[];
  checks: { code: string; text: string; cure: string }[];
  figures: {
    curve: { command: number[]; speed: number[]; std?: number[] };
    time: number[];
    measured: (number | null)[];
    predicted: (number | null)[];
  };
}
export interface ValveReport {
  axes: Record<string, Axis>;
  warnings: string[];
  /** What its sentences were made of; missing in reports of earlier versions. */
  messages?: Record<string, Message>;
}

export const WAYS = ["extend", "retract"] as const;
export type Way = (typeof WAYS)[number];

/** The report, null if it is none that this page can read. */
export function readValves(content: unknown): ValveReport | null {
  const found = content as (ValveReport & { schema?: string }) | null;
  return found?.schema === "hilfit/valve/1" ? inLanguage(found, found.messages) : null;
}
