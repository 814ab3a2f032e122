/** What a report says in fixed English texts, in the language shown. */
import { type Language, language } from "./language";
import { reportText } from "./report_de";

const SAID: Record<Language, (text: string) => string> = { en: (text) => text, de: reportText };

/** A title, a reason, an experiment of a report; one that is in no table stays as the service wrote it. */
export const said: (text: string) => string = SAID[language];
