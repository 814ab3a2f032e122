import { expect, it } from "vitest";
import { ASLEEP_MS, SleepWatch } from "../../src/net/wake";

it("tells sleep from a tick that was late", () => {
  const watch = new SleepWatch(0);
  expect(watch.tick(1000)).toBe(0);
  expect(watch.tick(1000 + ASLEEP_MS)).toBe(0);
  expect(watch.tick(100_000)).toBe(100_000 - 1000 - ASLEEP_MS);
  expect(watch.tick(101_000)).toBe(0);
});
