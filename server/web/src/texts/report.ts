/** What the service says in fixed English texts, in reports, alarms and jobs, in the language shown. */
import { type Language, language } from "./language";
import { REPORT_FIXED, REPORT_SENTENCES } from "./report_de";
import { translated } from "./sentences";
import { SERVICE_FIXED, SERVICE_SENTENCES } from "./service_de";

const SAID: Record<Language, (text: string) => string> = {
  en: (text) => text,
  de: translated({ ...REPORT_FIXED, ...SERVICE_FIXED }, [...SERVICE_SENTENCES, ...REPORT_SENTENCES]),
};

/** A title, a reason, an alarm, what a job does; one that is in no table stays as the service wrote it. */
export const said: (text: string) => string = SAID[language];
