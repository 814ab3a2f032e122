/** What the page says. A text is a key of the tables, one table per language; `t` gives it in the language shown. */
import { setupI18n } from "@lingui/core";
import type { en } from "./en";
import { language } from "./language";
import { simple } from "./simple";
import { type Key, table } from "./table";

export type { Key } from "./table";

/** The names in `{name}` and `{name, plural, ...}` of a text; the branches of a plural hold a space or `#`. */
type Named<Inside extends string> = Inside extends `${infer Name},${string}`
  ? Name
  : Inside extends `${string}${" " | "#"}${string}`
    ? never
    : Inside;
export type Names<Text extends string> = Text extends `${string}{${infer Inside}}${infer Rest}`
  ? Named<Inside> | Names<Rest>
  : never;
/** The keys of texts without values. */
export type PlainKey = { [K in Key]: [Names<(typeof en)[K]>] extends [never] ? K : never }[Key];
type Values<K extends Key> = Record<Names<(typeof en)[K]>, string | number>;

const i18n = setupI18n();

/** The text of a key with its values, all of which have to be given. Numbers are formatted by who calls (`ui/format`). */
export function t<K extends Key>(
  key: K,
  ...values: [Names<(typeof en)[K]>] extends [never] ? [] : [Values<K>]
): string {
  const given: Record<string, string | number> | undefined = values[0];
  const text = table[key];
  const plain = typeof text === "string" ? simple(text, given) : null;
  if (plain !== null) return plain;
  if (i18n.locale !== language) i18n.loadAndActivate({ locale: language, messages: table });
  return i18n._(key, given);
}
