/**
 * What the service says in English - reports, alarms, jobs, refusals, findings - in the language shown.
 *
 * Its tables are large and nothing of the first view needs them: they come by themselves once the page is there, and
 * what was drawn before is drawn again.
 */
import { signal } from "@preact/signals";
import { type Language, language } from "./language";
import type { Message } from "./message";

type Said = (text: string, message?: Message | null) => string;
const LOADERS: Record<Language, (() => Promise<Said>) | null> = {
  en: null,
  de: async () => (await import("./said_de")).german,
};

/** What words all of it; another once the tables have come. */
export const table = signal<Said>((text) => text);
const load = LOADERS[language];

/** The tables have come, or there are none for them; what was not fetched stays in English. */
export const tables: Promise<void> =
  load === null
    ? Promise.resolve()
    : load().then(
        (found) => {
          table.value = found;
        },
        () => undefined,
      );

/** A title, a reason, an alarm, what a job does, by the message that came with it; what has no text here stays as it came. */
export const said: Said = (text, message) => table.value(text, message);

/** Content with its sentences in the language shown, by the messages that came with it. */
export function inLanguage<T>(content: T, messages: Record<string, Message> = {}): T {
  if (typeof content === "string") return (content in messages ? said(content, messages[content]) : content) as T;
  if (Array.isArray(content)) return content.map((one: unknown) => inLanguage(one, messages)) as T;
  if (typeof content !== "object" || content === null) return content;
  const worded = ([key, one]: [string, unknown]) => [inLanguage(key, messages), inLanguage(one, messages)];
  return Object.fromEntries(Object.entries(content).map(worded)) as T;
}
