/** What the page says. A text is a key of the tables, one table per language; `t` gives it in the language shown. */
import { setupI18n } from "@lingui/core";
import { compileMessage } from "@lingui/message-utils/compileMessage";
import { de } from "./de";
import { en } from "./en";
import { language } from "./language";
import { simple } from "./simple";

/** The key of a text; one that is in no table does not compile. */
export type Key = keyof typeof en;

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

const tables = { en, de };
const i18n = setupI18n({ locale: language, messages: tables });
const compiled = new Map<string, ReturnType<typeof compileMessage>>();
i18n.setMessagesCompiler((text) => {
  const found = compiled.get(text) ?? compileMessage(text);
  compiled.set(text, found);
  return found;
});

/** The text of a key with its values, all of which have to be given. Numbers are formatted by who calls (`ui/format`). */
export function t<K extends Key>(
  key: K,
  ...values: [Names<(typeof en)[K]>] extends [never] ? [] : [Values<K>]
): string {
  const given: Record<string, string | number> | undefined = values[0];
  return simple(tables[language][key], given) ?? i18n._(key, given);
}
