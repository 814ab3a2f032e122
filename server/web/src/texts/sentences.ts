/** Sentences that the service writes in English, found in a table and given in another language. */

/**
 * What an English sentence looks like, and the sentence in the other language with `$1`, `$2` for what stands in it: looked up as well, or
 * as it is with `$=1`.
 */
export type Sentence = readonly [RegExp, string];

/** A number with a point, by itself. */
const DECIMAL = /(?<![\w.])([+-]?\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w.])/g;
/** A name, or a file and its line, in front of what is said of it. */
const NAMED = /^([^\s:]+(?::\d+)?): (.+)$/;
/** Letters that a sentence with values needs to be known by itself; one with fewer is known inside of others only. */
const TELLING = 9;
/** What a key begins with that may stand behind any sentence. */
const BEHIND = /^[ ;]/;
/** What joins several to one. */
const JOINT = /^; \w+ \{\}$/;

/**
 * Fixed texts and sentences of a table whose keys have `{}` where a value stands, the more telling
 * before the others. What stands in quotes is a name, and stays.
 */
export function compiled(table: Record<string, string>): {
  fixed: Record<string, string>;
  sentences: Sentence[];
  inner: Sentence[];
  joints: [string, string][];
} {
  const fixed: Record<string, string> = {};
  const open: [string, string][] = [];
  for (const [english, other] of Object.entries(table)) {
    if (english.includes("{}") || BEHIND.test(english)) open.push([english, other]);
    else fixed[english] = other;
  }
  const letters = ([english]: [string, string]) => english.replaceAll("{}", "").length;
  open.sort((a, b) => letters(b) - letters(a));
  const within = (one: [string, string]) => letters(one) < TELLING;
  const sentence = ([english, other]: [string, string]): Sentence => {
    if (BEHIND.test(english)) {
      const [pattern, rest] = sentence([
        `{}${english}`,
        `$1${other.replace(/\$(\d)/g, (_all, at: string) => `$${Number(at) + 1}`)}`,
      ]);
      // As much as there is in front: the same words may stand within it.
      return [new RegExp(pattern.source.replace("(.*?)", "(.*)")), rest];
    }
    const parts = english.split("{}").map((part) => part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
    const names = parts.map((part, at) => at > 0 && part.startsWith("'") && parts[at - 1]?.endsWith("'"));
    return [
      new RegExp(`^${parts.join("(.*?)")}$`),
      other.replace(/\$(\d)/g, (_all, at: string) => (names[Number(at)] ? `$=${at}` : `$${at}`)),
    ];
  };
  return {
    fixed,
    sentences: open.filter((one) => !within(one)).map(sentence),
    inner: open.filter(within).map(sentence),
    joints: open
      .filter(([english]) => JOINT.test(english))
      .map(([english, other]) => [english.slice(0, -2), other.replace("$1", "")]),
  };
}

/**
 * A function that gives the other language's text; one that is in no table stays as the service wrote it.
 *
 * What stands in a sentence is looked up as well, also as a list (`; `) and behind a name (`joint2: `); decimal points of
 * its numbers become commas.
 *
 * @param inner sentences that are known only where they stand in others
 * @param joints what stands between sentences of a list, `; or `
 */
export function translated(
  fixed: Record<string, string>,
  sentences: readonly Sentence[],
  inner: readonly Sentence[] = [],
  joints: readonly (readonly [string, string])[] = [],
): (text: string) => string {
  const found = (text: string, among: readonly Sentence[]): string | undefined => {
    for (const [pattern, other] of among) {
      const values = pattern.exec(text);
      if (values !== null)
        return other.replace(/\$(=?)(\d)/g, (_all, kept: string, at: string) => {
          const value = values[Number(at)] ?? "";
          return kept === "" ? part(value) : value;
        });
    }
    return undefined;
  };
  /** A sentence, or what is put together of nothing but known ones. */
  const whole = (text: string): string | undefined => {
    const known = fixed[text] ?? list(text) ?? found(text, sentences);
    if (known !== undefined) return known;
    const named = NAMED.exec(text);
    const said = named === null ? undefined : whole(named[2] ?? "");
    if (said !== undefined) return `${named?.[1] ?? ""}: ${said}`;
    if (!text.includes("; ")) return undefined;
    const pieces = text.split("; ").map(whole);
    return pieces.includes(undefined) ? undefined : pieces.join("; ");
  };
  /** What consists of several, all of them known. */
  const list = (text: string): string | undefined => {
    for (const [joint, other] of joints) {
      const pieces = text.includes(joint) ? text.split(joint).map(whole) : [undefined];
      if (!pieces.includes(undefined)) return pieces.join(other);
    }
    return undefined;
  };
  const part = (text: string): string => {
    const known = fixed[text] ?? fixed[text.replace(/_/g, " ")] ?? whole(text) ?? found(text, inner);
    if (known !== undefined) return known;
    if (text.includes("; ")) return text.split("; ").map(part).join("; ");
    const named = NAMED.exec(text);
    if (named !== null) return `${named[1] ?? ""}: ${part(named[2] ?? "")}`;
    return text.replace(DECIMAL, "$1,$2");
  };
  return (text) => whole(text) ?? text;
}
