/** Numbers, times and durations as a person reads them in the language shown; what is not known is a dash. */
import { type Language, language } from "../texts/language";

export const DASH = "–";

/** What is made when it is first needed: the browser's tables of a language take long on a slow tablet. */
function once<T>(make: () => T): () => T {
  let made: { value: T } | null = null;
  return () => (made ??= { value: make() }).value;
}

const decimalSign = once(
  () => new Intl.NumberFormat(language).formatToParts(0.5).find((part) => part.type === "decimal")?.value ?? ".",
);
/** Whose order of year, month and day: ISO 8601 in English, which has none that all its readers share. */
const DATES: Record<Language, string> = { en: "sv-SE", de: "de-DE" };

const MINUTES = {
  year: "numeric",
  month: "2-digit",
  day: "2-digit",
  hour: "2-digit",
  minute: "2-digit",
  hourCycle: "h23",
} as const;
const times = once(() => new Intl.DateTimeFormat(DATES[language], { ...MINUTES, second: "2-digit" }));
/** Where `times` has month and day, and where year and month. */
const PARTS: Record<Language, { day: [number, number]; month: [number, number] }> = {
  en: { day: [5, 10], month: [0, 7] },
  de: { day: [0, 6], month: [3, 10] },
};

/*
 * Numbers as `fitting/report/text.py` writes them, so that the page says what the report says; both are held to
 * `numbers.json`. Spaces within are thin and do not break.
 */
const THIN = "\u202f";
const SUPERSCRIPT = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** Digits as programs write them with the decimal sign of the language, a real minus and groups of three. */
export function spelt(digits: string): string {
  const [whole = "", rest] = digits.replace(/^-/, "").split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, THIN) : whole;
  const negative = digits.startsWith("-") && /[1-9]/.test(digits); // no minus before zero
  return (negative ? "−" : "") + grouped + (rest === undefined ? "" : decimalSign() + rest);
}

function known(value: number | null | undefined): value is number {
  return value !== null && value !== undefined && Number.isFinite(value);
}

/** The exponent of ten of the first digit. */
function exponentOf(value: number): number {
  return value === 0 ? 0 : Number(value.toExponential().split("e")[1]);
}

/** `× 10⁷`. */
function scientific(exponent: number): string {
  const digits = [...String(Math.abs(exponent))].map((digit) => SUPERSCRIPT[Number(digit)]).join("");
  return `×${THIN}10${exponent < 0 ? "⁻" : ""}${digits}`;
}

/** A number with so many significant digits; a power of ten beside it below 1e-4 and from 1e6 on. */
export function number(value: number | null | undefined, digits = 4): string {
  if (!known(value)) return DASH;
  if (value === 0) return "0";
  const text = value.toExponential(digits - 1);
  const exponent = Number(text.split("e")[1]);
  if (exponent >= -4 && exponent <= 5) return fixed(Number(text), digits - 1 - exponent);
  return `${spelt(text.split("e")[0] ?? "")}${THIN}${scientific(exponent)}`;
}

/** How many: a whole number, all its digits. */
export function count(value: number | null | undefined): string {
  return fixed(value, 0);
}

/** A number with fixed decimals, which does not jump while it changes; fewer than none: zeros before the point. */
export function fixed(value: number | null | undefined, decimals: number): string {
  if (!known(value)) return DASH;
  if (decimals >= 0) return spelt(value.toFixed(Math.min(100, decimals)));
  const places = exponentOf(value) + decimals;
  const last = Number(`1e${-decimals}`);
  if (places < 0) return spelt(Math.abs(value) >= last / 2 ? String(Math.sign(value) * last) : "0");
  return spelt(Number(value.toExponential(places)).toFixed(0));
}

/** Labels of an axis: no more decimals than its places need. */
export function ticks(places: number[]): string[] {
  const needed = places.map((place) => place.toFixed(12).replace(/0+$/, "").split(".")[1]?.length ?? 0);
  const decimals = Math.max(0, ...needed);
  return places.map((place) => fixed(place, decimals));
}

/** A value with its standard deviation: two digits of it, and the value to the same place. */
export function withStd(value: number | null | undefined, std: number | null | undefined): string {
  if (!known(value)) return DASH;
  if (!known(std) || std <= 0) return number(value, 4);
  const rounded = Number(std.toExponential(1));
  const decimals = 1 - exponentOf(rounded);
  const top = Math.max(exponentOf(value), exponentOf(rounded));
  if (top >= -4 && top <= 5) return `${fixed(value, decimals)} ± ${fixed(rounded, decimals)}`;
  const scale = Number(`1e${top}`);
  return `(${fixed(value / scale, decimals + top)} ± ${fixed(rounded / scale, decimals + top)})${THIN}${scientific(top)}`;
}

/** A part of one in percent with three digits: `3.12 %`, `0.0373 %`. */
export function share(part: number | null | undefined): string {
  return known(part) ? `${number(100 * part, 3)}${THIN}%` : DASH;
}

/** A change in percent with its sign: `−74 %`, `+5.3 %`. */
export function change(percents: number | null | undefined): string {
  if (!known(percents)) return DASH;
  const text = fixed(percents, Math.abs(percents) >= 10 ? 0 : 1);
  return `${percents > 0 && /[1-9]/.test(text) ? "+" : ""}${text}${THIN}%`;
}

/** The zone of this device at a moment, as its difference from UTC: `UTC+1`, `UTC−3:30`, `UTC`. */
export function zone(date: Date): string {
  const minutes = -date.getTimezoneOffset();
  if (minutes === 0) return "UTC";
  const size = Math.abs(minutes);
  const rest = size % 60 === 0 ? "" : `:${two(size % 60)}`;
  return `UTC${minutes < 0 ? "−" : "+"}${Math.floor(size / 60)}${rest}`;
}

/** A time of the service (ISO 8601) in the zone of this device, which it names. */
export function time(iso: string | null | undefined): string {
  if (!iso) return DASH;
  const date = new Date(iso);
  if (Number.isNaN(date.getTime())) return DASH;
  return `${times().format(date)} ${zone(date)}`;
}

/** A day and month. */
export function dayMonth(date: Date): string {
  return times()
    .format(date)
    .slice(...PARTS[language].day);
}

/** A month of a year. */
export function monthYear(date: Date): string {
  return times()
    .format(date)
    .slice(...PARTS[language].month);
}

/** A moment in a time zone with its day of the week: `Mon 2026-03-02 02:30`, `Mo 02.03.2026 02:30`. */
export function inZone(iso: string, zone: string): string {
  const date = new Date(iso);
  try {
    const weekday = new Intl.DateTimeFormat(language, { timeZone: zone, weekday: "short" }).format(date);
    return `${weekday} ${new Intl.DateTimeFormat(DATES[language], { ...MINUTES, timeZone: zone }).format(date)}`;
  } catch {
    return iso; // a zone that this browser does not know
  }
}

/** A moment as names of things have it that every language reads: `2026-03-02 09:14`. */
export function stamp(date: Date): string {
  return new Intl.DateTimeFormat(DATES.en, MINUTES).format(date);
}

/** Seconds as `12 s`, `3 min 20 s`, `2 h 5 min`, `3 d 4 h`. */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return DASH;
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole} s`;
  const pair = (large: number, first: string, small: number, second: string): string =>
    small === 0 ? `${large} ${first}` : `${large} ${first} ${small} ${second}`;
  if (whole < 3600) return pair(Math.floor(whole / 60), "min", whole % 60, "s");
  const minutes = Math.round(whole / 60);
  if (minutes < 1440) return pair(Math.floor(minutes / 60), "h", minutes % 60, "min");
  const hours = Math.round(whole / 3600);
  return pair(Math.floor(hours / 24), "d", hours % 24, "h");
}

/** A fraction of one as percent, of what moves while it is looked at. */
export function percent(fraction: number | null | undefined, decimals = 0): string {
  return known(fraction) ? `${fixed(100 * fraction, decimals)}${THIN}%` : DASH;
}

function two(value: number): string {
  return String(value).padStart(2, "0");
}
