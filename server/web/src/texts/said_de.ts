/** German for all that the service says. */
import daq from "../../../../daq/texts/de.json";
import fitting from "../../../../fitting/texts/de.json";
import simBackends from "../../../../sim_backends/texts/de.json";
import server from "../../../texts/de.json";
import { type Message, wording } from "./message";

const packages = { daq, server, fitting, sim_backends: simBackends };
const worded = wording(packages, ",");
const words: Record<string, string> = Object.assign({}, ...Object.values(packages).map((one) => one.words));

/** A message by its code, or as its own distribution words it; a fixed text as a word. Anything else stays. */
export function german(text: string, message?: Message | null): string {
  return message?.worded?.de ?? (message ? worded(message) : null) ?? words[text] ?? text;
}
