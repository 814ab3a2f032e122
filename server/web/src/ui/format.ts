/** Numbers, times and durations as a person reads them; what is not known is a dash. */

export const DASH = "–";

/** A number with so many significant digits; never an exponent between 1e-4 and 1e6. */
export function number(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(Math.max(0, digits - 1)));
  const decimals = Math.max(0, Math.min(12, digits - 1 - Math.floor(Math.log10(size))));
  return minus(value.toFixed(decimals));
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
  return minus(Number(text) === 0 ? (0).toFixed(decimals) : text); // no minus before zero
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
  return `${minus(value.toFixed(kept))} ± ${std.toFixed(kept)}`;
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
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())} ${zone(date)}`;
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
  return `${minus((100 * fraction).toFixed(decimals))} %`;
}

function two(value: number): string {
  return String(value).padStart(2, "0");
}

function minus(text: string): string {
  return text.replace(/^-/, "−");
}
