import { execFileSync } from "node:child_process";
import { expect, it } from "vitest";
import daq from "../../../../daq/texts/de.json";
import fitting from "../../../../fitting/texts/de.json";
import simBackends from "../../../../sim_backends/texts/de.json";
import server from "../../../texts/de.json";
import { formatted, type Message, wording } from "./message";

/** What Python says of sample values for every message. */
const cases = JSON.parse(
  execFileSync("python3", ["tests/server/platform/message_cases.py"], {
    cwd: "../..",
    encoding: "utf8",
    maxBuffer: 2 ** 26,
  }),
) as { messages: (Message & { text: string })[]; numbers: [number, string, string][] };
const worded = wording({ daq, fitting, server, sim_backends: simBackends }, ",");

it("words every message as Python does", () => {
  expect(cases.messages.length).toBeGreaterThan(700);
  const off = cases.messages.filter((one) => worded(one) !== one.text);
  expect(off.map((one) => [one.code, worded(one), one.text])).toEqual([]);
});

it("formats numbers as Python does", () => {
  const off = cases.numbers.filter(([value, format, text]) => formatted(value, format) !== text);
  expect(off.map(([value, format, text]) => [value, format, formatted(value, format), text])).toEqual([]);
});

it("gives nothing for what has no text here, inside of others too", () => {
  const unknown = { code: "plugin.broke", values: {} };
  expect(worded(unknown)).toBeNull();
  expect(worded({ code: "daq.named", values: { name: "a", what: unknown } })).toBeNull();
  expect(worded({ code: "daq.named", values: { name: "a" } })).toBeNull();
});
