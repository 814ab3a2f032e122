/**
 * Messages of the service: a code and values, worded with the texts that Python words them with (`daq/messages.py`).
 *
 * Placeholders are those of `str.format`: `{value:.3g}`; a list is joined with its format; `{name!s}` is no word of the
 * language.
 */

export interface Message {
  code: string;
  values: Record<string, unknown>;
  /** By language, where its text is one of another distribution. */
  worded?: Record<string, string>;
}
/** Texts of a package: messages by key, and words by the English one. */
export interface Texts {
  messages: Record<string, string>;
  words: Record<string, string>;
}
/** A piece of a template: text, or what stands for a value. */
type Piece = string | { name: string; asItIs: boolean; format: string };

/** The package whose words all know. */
const COMMON = "daq";
/** A number with a point, by itself: no version, no part of a name. */
const DECIMAL = /(?<![\w.])([+-]?\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w.])/g;
const PLACEHOLDER = /\{\{|\}\}|\{(\w+)(!s)?(?::([^}]*))?\}/g;

/** A function that words a message, and gives null where a text or a value is missing. */
export function wording(packages: Record<string, Texts>, decimal: string): (message: Message) => string | null {
  const worded = ({ code, values }: Message): string => {
    const at = code.indexOf(".");
    const owner = code.slice(0, at);
    const text = packages[owner]?.messages[code.slice(at + 1)];
    if (text === undefined) throw new Error(code);
    const said = (piece: Piece): string => {
      if (typeof piece === "string") return piece;
      if (!(piece.name in values)) throw new Error(`${code}: ${piece.name}`);
      return one(values[piece.name], piece, owner);
    };
    return pieces(text).map(said).join("");
  };
  const one = (value: unknown, { asItIs, format }: { asItIs: boolean; format: string }, owner: string): string => {
    if (Array.isArray(value)) {
      return value.map((each) => one(each, { asItIs, format: "" }, owner)).join(format === "" ? ", " : format);
    }
    if (isMessage(value)) return worded(value);
    if (typeof value === "number") {
      const number = formatted(value, asItIs ? "" : format);
      return asItIs ? number : number.replace(".", decimal);
    }
    if (typeof value === "string") return asItIs ? value : word(packages, owner, decimal, value);
    return value === null ? "None" : value === true ? "True" : "False";
  };
  return (message) => {
    try {
      return worded(message);
    } catch {
      return null;
    }
  };
}

/** A word in the language, of a package or of all; another text stays, but for the sign in its numbers. */
export function word(packages: Record<string, Texts>, owner: string, decimal: string, text: string): string {
  for (const name of [owner, COMMON]) {
    const known = packages[name]?.words;
    const found = known?.[text] ?? known?.[text.replaceAll("_", " ")];
    if (found !== undefined) return found;
  }
  return text.replace(DECIMAL, `$1${decimal}$2`);
}

function isMessage(value: unknown): value is Message {
  return typeof value === "object" && value !== null && "code" in value && "values" in value;
}

function pieces(text: string): Piece[] {
  const found: Piece[] = [];
  let end = 0;
  for (const match of text.matchAll(PLACEHOLDER)) {
    const [whole, name, kept, format] = match;
    found.push(text.slice(end, match.index));
    found.push(name === undefined ? whole.charAt(0) : { name, asItIs: kept !== undefined, format: format ?? "" });
    end = match.index + whole.length;
  }
  found.push(text.slice(end));
  return found;
}

/** A number as Python's `format` writes it. */
export function formatted(value: number, format: string): string {
  const sign = value < 0 || Object.is(value, -0) ? "-" : format.startsWith("+") ? "+" : "";
  const size = Math.abs(value);
  const kind = format.at(-1) ?? "";
  const digits = format.includes(".") ? Number.parseInt(format.slice(format.indexOf(".") + 1), 10) : 6;
  if (kind === "f") return sign + fixed(size, digits);
  if (kind === "%") return `${sign}${fixed(100 * size, digits)}%`;
  if (kind === "g") return sign + general(size, Math.max(1, digits));
  if (kind === ",") return sign + plain(size).replace(/\B(?=(\d{3})+$)/g, ",");
  return sign + plain(size);
}

/** More digits than a double has behind a tie: `5` and nothing else behind the last digit that is kept. */
const BEYOND = 50;

/** Digits that are cut off, where half goes to the even neighbour. */
function evenly(long: string, kept: string, count: number): string {
  const tail = long.slice(count);
  const tie = tail.startsWith("5") && Number(tail.slice(1)) === 0;
  return tie && Number(long.charAt(count - 1)) % 2 === 0 ? long.slice(0, count) : kept;
}

function fixed(size: number, digits: number): string {
  if (size >= 1e21) return `${BigInt(size)}${digits > 0 ? `.${"0".repeat(digits)}` : ""}`;
  const kept = size.toFixed(digits);
  const long = size.toFixed(Math.min(100, digits + BEYOND));
  if (digits > 0) return evenly(long, kept, long.indexOf(".") + 1 + digits);
  const [whole = "", rest = ""] = long.split(".");
  return evenly(whole + rest, kept, whole.length);
}

function general(size: number, digits: number): string {
  const [kept = "", power = ""] = size.toExponential(digits - 1).split("e");
  const [long = ""] = size.toExponential(Math.min(100, digits - 1 + BEYOND)).split("e");
  const mantissa = evenly(long.replace(".", ""), kept.replace(".", ""), digits);
  const exponent = Number(power);
  if (exponent < -4 || exponent >= digits) {
    return `${trimmed(`${mantissa.slice(0, 1)}.${mantissa.slice(1)}`)}e${two(exponent)}`;
  }
  const zeros = "0".repeat(Math.max(0, -exponent));
  const all = zeros + mantissa;
  const point = Math.max(1, exponent + 1);
  return trimmed(`${all.slice(0, point)}.${all.slice(point)}`);
}

/** As `str` writes it: the shortest text that is this number. */
function plain(size: number): string {
  if (size === 0 || (size >= 1e-4 && size < 1e16)) return String(size);
  const [mantissa = "", power = ""] = size.toExponential().split("e");
  return `${mantissa}e${two(Number(power))}`;
}

function trimmed(number: string): string {
  return number.includes(".") ? number.replace(/\.?0*$/, "") : number;
}

function two(exponent: number): string {
  return `${exponent < 0 ? "-" : "+"}${String(Math.abs(exponent)).padStart(2, "0")}`;
}
