/** German for all that the service says. */
import daq from "../../../../daq/texts/de.json";
import fitting from "../../../../fitting/texts/de.json";
import server from "../../../texts/de.json";
import { type Message, wording } from "./message";
import { REPORT } from "./report_de.gen";
import { compiled, translated } from "./sentences";

const packages = { daq, server, fitting };
const worded = wording(packages, ",");
const words: Record<string, string> = Object.assign({}, ...Object.values(packages).map((one) => one.words));
const open = compiled(REPORT);
const found = translated({ ...words, ...open.fixed }, open.sentences, open.inner, open.joints);

/** A message by its code; a fixed text as a word; a sentence of a report that comes without one by the report's table. */
export function german(text: string, message?: Message | null): string {
  return (message ? worded(message) : null) ?? words[text] ?? found(text);
}
