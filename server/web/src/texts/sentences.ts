/** Sentences that the service writes in English, found in a table and given in another language. */

/** What an English sentence looks like, and the sentence in the other language with `$1`, `$2` for what stands in it. */
export type Sentence = readonly [RegExp, string];

/** A number with a point, by itself. */
const DECIMAL = /(?<![\w.])([+-]?\d+)\.(\d+)(?![\w.])/g;

/**
 * A function that gives the other language's text; one that is in no table stays as the service wrote it.
 *
 * What stands in a sentence is looked up as well, also as a list (`; `) and behind a name (`joint2: `); decimal points of
 * its numbers become commas.
 */
export function translated(fixed: Record<string, string>, sentences: readonly Sentence[]): (text: string) => string {
  const whole = (text: string): string | undefined => {
    if (fixed[text] !== undefined) return fixed[text];
    for (const [pattern, other] of sentences) {
      const found = pattern.exec(text);
      if (found !== null) return other.replace(/\$(\d)/g, (_all, at: string) => part(found[Number(at)] ?? ""));
    }
    return undefined;
  };
  const part = (text: string): string => {
    const known = fixed[text] ?? fixed[text.replace(/_/g, " ")] ?? whole(text);
    if (known !== undefined) return known;
    if (text.includes("; ")) return text.split("; ").map(part).join("; ");
    const named = /^([\w.]+): (.+)$/.exec(text);
    if (named !== null) return `${named[1] ?? ""}: ${part(named[2] ?? "")}`;
    return text.replace(DECIMAL, "$1,$2");
  };
  return (text) => whole(text) ?? text;
}
