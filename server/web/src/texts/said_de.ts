/** German for all that the service says. */
import daq from "../../../../daq/texts/de.json";
import fitting from "../../../../fitting/texts/de.json";
import server from "../../../texts/de.json";
import { FINDINGS } from "./findings_de";
import { MACHINE_FILE } from "./machine_file_de";
import { type Message, wording } from "./message";
import { REFUSALS, VALUES } from "./refusals_de";
import { REPORT } from "./report_de.gen";
import { compiled, translated } from "./sentences";
import { SERVICE_FIXED, SERVICE_SENTENCES } from "./service_de";
import { VALVE } from "./valve_de";

const open = compiled({ ...REPORT, ...MACHINE_FILE, ...FINDINGS, ...REFUSALS, ...VALVE });

const found = translated(
  { ...VALUES, ...open.fixed, ...SERVICE_FIXED },
  [...SERVICE_SENTENCES, ...open.sentences],
  open.inner,
  open.joints,
);
const packages = { daq, server, fitting };
const worded = wording(packages, ",");
const words: Record<string, string> = Object.assign({}, ...Object.values(packages).map((one) => one.words));

/** A message by its code; a fixed text as a word; what comes without, or of another version, by its sentence. */
export function german(text: string, message?: Message | null): string {
  return (message ? worded(message) : null) ?? words[text] ?? found(text);
}
