import { expect, it } from "vitest";
import { change, fixed, number, share, ticks, time, withStd, zone } from "./format";
import table from "./numbers.json";

it("writes numbers as the report does", () => {
  const functions = { number, fixed, withStd, share, change } as unknown as Record<string, (...a: unknown[]) => string>;
  const said = (table as [string, unknown[], string][]).map(([name, values]) => functions[name]?.(...values));
  expect(said).toEqual(table.map((row) => row[2]));
});

it("labels an axis alike: decimals that are needed, groups of three, a real minus", () => {
  expect(ticks([-200, 0, 200])).toEqual(["−200", "0", "200"]);
  expect(ticks([0.1, 0.15, 0.2])).toEqual(["0.10", "0.15", "0.20"]);
  expect(ticks([8000, 10000])).toEqual(["8000", "10\u202f000"]);
  expect(ticks([0.30000000000000004, 0.6])).toEqual(["0.3", "0.6"]);
  expect(ticks([1234.5, 2000])).toEqual(["1234.5", "2000.0"]);
  expect(ticks([1e-7, 2e-7])).toEqual(["0.0000001", "0.0000002"]);
});

it("names the zone of every time", () => {
  const at = (offset: number): Date => Object.assign(new Date(0), { getTimezoneOffset: () => offset });
  expect([at(0), at(-60), at(210), at(-345)].map(zone)).toEqual(["UTC", "UTC+1", "UTC−3:30", "UTC+5:45"]);
  expect(time("2026-03-02T09:14:05Z")).toMatch(/^2026-03-0\d \d\d:\d\d:05 UTC/);
});
