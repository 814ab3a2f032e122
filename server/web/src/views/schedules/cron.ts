/** Cron expressions for people: presets that make one, and words for one. */
import { t } from "../../texts";

export type Every = "day" | "week" | "month" | "own";

export interface Plan {
  every: Every;
  /** 0 to 23 and 0 to 59. */
  hour: number;
  minute: number;
  /** 0 is Sunday, as cron has it. */
  weekday: number;
  /** 1 to 28: every month has it. */
  day: number;
  /** The expression itself, where no preset fits. */
  own: string;
}

export const WEEKDAYS = [
  t("schedules.sunday"),
  t("schedules.monday"),
  t("schedules.tuesday"),
  t("schedules.wednesday"),
  t("schedules.thursday"),
  t("schedules.friday"),
  t("schedules.saturday"),
];
export const NEW_PLAN: Plan = { every: "week", hour: 2, minute: 30, weekday: 1, day: 1, own: "" };

/** The five fields: minute, hour, day of the month, month, day of the week. */
export function cronOf(plan: Plan): string {
  const at = `${plan.minute} ${plan.hour}`;
  if (plan.every === "day") return `${at} * * *`;
  if (plan.every === "week") return `${at} * * ${plan.weekday}`;
  if (plan.every === "month") return `${at} ${plan.day} * *`;
  return plan.own.trim();
}

/** The preset that makes an expression; its own where none does. */
export function planOf(cron: string): Plan {
  const own: Plan = { ...NEW_PLAN, every: "own", own: cron.trim() };
  const fields = cron.trim().split(/\s+/);
  if (fields.length !== 5) return own;
  const [minute, hour, day, month, weekday] = fields as [string, string, string, string, string];
  const whole = (text: string, low: number, high: number): number | null => {
    if (!/^[0-9]{1,2}$/.test(text)) return null;
    const value = Number(text);
    return value >= low && value <= high ? value : null;
  };
  const at = { minute: whole(minute, 0, 59), hour: whole(hour, 0, 23) };
  if (at.minute === null || at.hour === null || month !== "*") return own;
  const plan = { ...NEW_PLAN, own: cron.trim(), hour: at.hour, minute: at.minute };
  if (day === "*" && weekday === "*") return { ...plan, every: "day" };
  const weekdayNumber = whole(weekday, 0, 7);
  if (day === "*" && weekdayNumber !== null) return { ...plan, every: "week", weekday: weekdayNumber % 7 };
  const dayNumber = whole(day, 1, 28);
  if (weekday === "*" && dayNumber !== null) return { ...plan, every: "month", day: dayNumber };
  return own;
}

/** An expression in words; one that no preset makes is shown as it is. */
export function cronWords(cron: string): string {
  const plan = planOf(cron);
  const at = `${two(plan.hour)}:${two(plan.minute)}`;
  if (plan.every === "day") return t("schedules.everyDayAt", { at });
  if (plan.every === "week") return t("schedules.everyAt", { weekday: WEEKDAYS[plan.weekday] ?? "", at });
  if (plan.every === "month") return t("schedules.dayEveryMonthAt", { day: plan.day, at });
  return t("schedules.byTheExpression", { own: plan.own });
}

export function two(value: number): string {
  return String(value).padStart(2, "0");
}

/** Time zones that this browser knows, UTC first; `held` is in it whatever the browser knows. */
export function timeZones(held: string): string[] {
  const intl = Intl as typeof Intl & { supportedValuesOf?: (key: "timeZone") => string[] };
  let known: string[];
  try {
    known = intl.supportedValuesOf?.("timeZone") ?? [];
  } catch {
    known = [];
  }
  return [...new Set(["UTC", held, ...known].filter(Boolean))];
}

/** The zone of this device, or UTC. */
export function ownZone(): string {
  try {
    return Intl.DateTimeFormat().resolvedOptions().timeZone || "UTC";
  } catch {
    return "UTC";
  }
}
