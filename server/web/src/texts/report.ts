/**
 * What the service says in English - reports, alarms, jobs, refusals, findings - in the language shown.
 *
 * Its tables are large and nothing of the first view needs them: they come by themselves once the page is there, and
 * what was drawn before is drawn again.
 */
import { signal } from "@preact/signals";
import { type Language, language } from "./language";

type Said = (text: string) => string;
const LOADERS: Record<Language, (() => Promise<Said>) | null> = {
  en: null,
  de: async () => (await import("./said_de")).german,
};

const table = signal<Said>((text) => text);
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

/** A title, a reason, an alarm, what a job does; one that is in no table stays as the service wrote it. */
export const said: Said = (text) => table.value(text);
