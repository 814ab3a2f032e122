// @vitest-environment happy-dom
import { setupI18n } from "@lingui/core";
import { compileMessage } from "@lingui/message-utils/compileMessage";
import { parse, type Token } from "@messageformat/parser";
import { afterEach, describe, expect, it, vi } from "vitest";
import { de } from "./de";
import { en } from "./en";
import { preferred } from "./language";
import { isSimple, simple } from "./simple";

const entries = Object.entries(en);

/** What is the same in German: names, units, loan words. */
const SAME = new Set(
  "Live|Bus|Signal|PGN {pgn}|Alarm|Pause|Problem|Parameter|{seconds} min|▶ Live|{mass} kg|Version|Version {one}|Code|{value} mm|Sensor|{size} kB|{size} MB|{size} GB|in {zone}|{title} ({place}{sizes})".split(
    "|",
  ),
);

/** Names of the values of a text, with what plurals and their branches hold. */
function names(tokens: Token[]): string[] {
  return tokens.flatMap((token) => {
    if (token.type === "content" || token.type === "octothorpe") return [];
    const inner = "cases" in token ? token.cases.flatMap((one) => names(one.tokens)) : [];
    return [`${token.type} ${token.arg}`, ...inner];
  });
}
const valuesOf = (text: string): string[] => [...new Set(names(parse(text)))].sort();

describe("the tables of the two languages", () => {
  it("have the same keys in the same order", () => {
    expect(Object.keys(de)).toEqual(Object.keys(en));
  });

  it("put the same values into each text", () => {
    const off = entries.filter(([key, text]) => `${valuesOf(text)}` !== `${valuesOf(de[key as keyof typeof en])}`);
    expect(off.map(([key]) => key)).toEqual([]);
  });

  it("begin and end alike where texts are put together", () => {
    const edges = (text: string): boolean[] => [/^\s/.test(text), /\s$/.test(text)];
    const off = entries.filter(
      ([key, text]) => !/^,/.test(text) && `${edges(text)}` !== `${edges(de[key as keyof typeof en])}`,
    );
    expect(off.map(([key]) => key)).toEqual([]);
  });

  it("do not leave English in the German one", () => {
    const off = entries.filter(([key, text]) => de[key as keyof typeof en] === text && !SAME.has(text));
    expect(off).toEqual([]);
    const words = /\b(the|and|is|of|not|this|with|that|are|it)\b/;
    const mixed = Object.entries(de).filter(([, text]) => words.test(text.replace(/\{[^}]*\}/g, "")));
    expect(mixed).toEqual([]);
    const straight = Object.entries(de).filter(([, text]) => /["”]|fuer|ueber|koenn|muess/.test(text));
    expect(straight).toEqual([]);
  });
});

it.each([
  ["en", en],
  ["de", de],
] as const)("says in '%s' without a parser what a parser says", (name, table) => {
  const i18n = setupI18n({ locale: name, messages: { [name]: table } });
  i18n.setMessagesCompiler(compileMessage);
  let without = 0;
  for (const [key, text] of Object.entries(table)) {
    const values = Object.fromEntries(valuesOf(text).map((one, number) => [one.split(" ")[1], `$& ${number}`]));
    const said = simple(text, values);
    if (said === null) continue;
    without += 1;
    expect(said).toBe(i18n._(key, values));
  }
  expect(without).toBeGreaterThan(0.8 * entries.length);
});

it("takes the first language of the browser that there is a table for", () => {
  expect([["de-AT", "en"], ["fr", "de"], ["fr-CH", "it"], [], ["EN-us"]].map(preferred)).toEqual([
    "de",
    "de",
    "en",
    "en",
    "en",
  ]);
});

vi.setConfig({ testTimeout: 60_000 }); // modules are read anew

describe("a device that keeps German", () => {
  afterEach(() => {
    localStorage.removeItem("hilfit.language");
    vi.resetModules();
  });
  const german = async () => {
    localStorage.setItem("hilfit.language", "de");
    vi.resetModules();
    return {
      format: await import("../ui/format"),
      texts: await import("."),
      report: await import("./report"),
      chart: await import("../charts/time_chart"),
    };
  };

  it("writes numbers and times as Germans do", async () => {
    const { format, chart } = await german();
    const { number, fixed, percent, withStd, ticks, count, time, inZone, duration } = format;
    expect([number(-0.01234), fixed(-0.001, 2), percent(0.0725, 1), withStd(7.128, 0.42)]).toEqual([
      "−0,01234",
      "0,00",
      "7,2\u202f%",
      "7,13 ± 0,42",
    ]);
    expect([...ticks([1234.5, 2000]), count(1234567), number(1.5e-7), duration(200)]).toEqual([
      "1234,5",
      "2000,0",
      "1\u202f234\u202f567",
      "1,500\u202f×\u202f10⁻⁷",
      "3 min 20 s",
    ]);
    expect(time("2026-03-02T09:14:05Z")).toMatch(/^0\d\.03\.2026, \d\d:\d\d:05 UTC/);
    expect(inZone("2026-03-02T02:30:00Z", "Europe/Berlin")).toBe("Mo 02.03.2026, 03:30");
    expect(format.stamp(new Date(2026, 2, 5, 9, 4))).toBe("2026-03-05 09:04"); // a name: alike in all languages
    expect([format.dayMonth(new Date(2026, 2, 5)), format.monthYear(new Date(2026, 2, 5))]).toEqual([
      "05.03.",
      "03.2026",
    ]);
    expect(chart.clock(0.25, 2)).toMatch(/:00,25$/);
  });

  it("says texts with values and plurals in German", async () => {
    const { t } = (await german()).texts;
    expect(t("common.reading")).toBe("Wird gelesen …");
    expect([1, 3].map((count) => t("fleet.warning", { count }))).toEqual(["1 Warnung", "3 Warnungen"]);
    expect(t("machines.savedAsVersion", { version: 7 })).toBe("Als Version 7 gespeichert.");
  });

  it("says what the service writes in German, by its code or as a fixed text, and leaves the rest as it is", async () => {
    const { said, tables } = (await german()).report;
    await tables;
    expect(said("friction that depends on the piston position")).toBe("Reibung, die vom Kolbenweg abhängt");
    const code = "fitting.gains_chi_square_chance";
    expect(said("gains 3.2 of chi-square", { code, values: { gain: 3.21 } })).toBe(
      "verbessert Chi-Quadrat um 3,2; das erklärt auch der Zufall oder was schon gefunden wurde",
    );
    expect(said("nobody knows this text 1.5")).toBe("nobody knows this text 1.5");
  });
});

it("says without a parser just what the build leaves unparsed, and has no quotes and no plurals there", () => {
  const parsed = /'|\{\w+,/;
  const texts = [...Object.values(en), ...Object.values(de)];
  expect(texts.filter((text) => (simple(text) === null) === isSimple(text))).toEqual([]);
  const off = texts.filter((text) => (simple(text) === null) !== parsed.test(text));
  expect(off).toEqual([]);
});
