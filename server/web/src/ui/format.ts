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

/** Digits as programs write them with the decimal sign of the language and a real minus. */
export function spelt(digits: string): string {
  return minus(digits.replace(".", decimalSign()));
}

/** A number with so many significant digits; never an exponent between 1e-4 and 1e6. */
export function number(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return spelt(value.toExponential(Math.max(0, digits - 1)));
  const decimals = Math.max(0, Math.min(12, digits - 1 - Math.floor(Math.log10(size))));
  return spelt(value.toFixed(decimals));
}

/** How many: a whole number, all its digits in groups of three. */
export function count(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  return minus(thousands(String(Math.round(value))));
}

const thousands = (whole: string): string => whole.replace(/\B(?=(\d{3})+(?!\d))/g, "\u202f");

/** A number with fixed decimals, which does not jump while it changes. */
export function fixed(value: number | null | undefined, decimals: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = value.toFixed(decimals);
  return spelt(Number(text) === 0 ? (0).toFixed(decimals) : text); // no minus before zero
}

/** Labels of an axis: no more decimals than its places need, thousands apart, a real minus. */
export function ticks(places: number[]): string[] {
  const needed = places.map((place) => place.toFixed(12).replace(/0+$/, "").split(".")[1]?.length ?? 0);
  const decimals = Math.max(0, ...needed);
  return places.map((place) => fixed(place, decimals).replace(/\d+/, (whole) => thousands(whole)));
}

/** A value with its standard deviation, as many digits as the deviation makes sense of (two of it). */
export function withStd(value: number | null | undefined, std: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (std === null || std === undefined || !Number.isFinite(std) || std <= 0) return number(value);
  const decimals = 1 - Math.floor(Math.log10(std));
  if (decimals > 12 || Math.abs(value) >= 1e6) return `${number(value)} ± ${number(std, 2)}`;
  const kept = Math.max(0, decimals);
  return `${spelt(value.toFixed(kept))} ± ${spelt(std.toFixed(kept))}`;
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

/** A fraction of one as percent. */
export function percent(fraction: number | null | undefined, decimals = 0): string {
  if (fraction === null || fraction === undefined || !Number.isFinite(fraction)) return DASH;
  return `${spelt((100 * fraction).toFixed(decimals))} %`;
}

function two(value: number): string {
  return String(value).padStart(2, "0");
}

function minus(text: string): string {
  return text.replace(/^-/, "−");
}
