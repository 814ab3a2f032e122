/** The verdict as the service wrote it, in the language shown; reports of earlier versions have it in English. */
import { language } from "../../texts/language";
import type { Report } from "./report";
import { verdictWords } from "./wording";

/** The verdict in a few sentences. */
export function sentence(report: Report): string {
  const { summary } = report;
  return summary?.languages?.[language]?.sentence ?? summary?.sentence ?? `${label(report)}.`;
}

/** The verdict in a few words. */
export function label(report: Report): string {
  const { summary } = report;
  const own = language === "en" ? summary : summary?.languages?.[language];
  return own?.label ?? verdictWords(report.loop.verdict)[1];
}
