/** The language of the page: what the browser prefers, until somebody chooses; kept on this device. */
import { remember, remembered } from "../storage";

/** Each language by its own name, as the switch shows it. */
export const LANGUAGES = { en: "English", de: "Deutsch" } as const;
export type Language = keyof typeof LANGUAGES;

const KEY = "hilfit.language";
const known = (name: string | null | undefined): name is Language => name != null && name in LANGUAGES;

/** The first of the browser's languages that there is a table for, `de-AT` as `de`; English where there is none. */
export function preferred(languages: readonly string[]): Language {
  const bases = languages.map((tag) => tag.toLowerCase().split("-")[0]);
  return bases.find(known) ?? "en";
}

const stored = remembered(KEY);

/** The language that is shown; it does not change while the page is open. */
export const language: Language = known(stored) ? stored : preferred(globalThis.navigator?.languages ?? []);

/**
 * Keep another language on this device and load the page anew in it: so no text that was made before stays behind.
 * What was typed and not saved, the guide and recordings that run are kept over that, as over any reload.
 */
export function chooseLanguage(name: Language): void {
  remember(KEY, name);
  location.reload();
}
