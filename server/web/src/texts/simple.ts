/** Texts that need no parser: as they are, or with values put where their names are. Most are, and a parser takes its time. */

const SIMPLE = /^(?:[^{}']|\{\w+\})*$/;
const NAMED = /\{(\w+)\}/g;

/** Whether a text needs no parser. */
export function isSimple(text: string): boolean {
  return SIMPLE.test(text);
}

/** A text with its values, or null: it has plurals or quotes, which a parser has to look at. */
export function simple(text: string, values: Record<string, string | number> = {}): string | null {
  if (!isSimple(text)) return null;
  return text.includes("{") ? text.replace(NAMED, (_whole, name: string) => String(values[name] ?? "")) : text;
}
