import { describe, expect, it } from "vitest";
import { inZone } from "../../ui/format";
import { NEW_PLAN, type Plan, cronOf, cronWords, planOf, timeZones } from "./cron";

describe("presets", () => {
  it("make an expression that leads back to them", () => {
    const plans: Partial<Plan>[] = [
      { every: "day", hour: 0, minute: 5 },
      { every: "week", weekday: 6, hour: 23, minute: 59 },
      { every: "month", day: 28, hour: 4, minute: 0 },
    ];
    for (const given of plans) {
      const plan = { ...NEW_PLAN, ...given };
      const { every, hour, minute, weekday, day } = planOf(cronOf(plan));
      expect({ every, hour, minute }).toEqual({ every: plan.every, hour: plan.hour, minute: plan.minute });
      if (every === "week") expect(weekday).toBe(plan.weekday);
      if (every === "month") expect(day).toBe(plan.day);
    }
  });

  it("leave any other expression as it is", () => {
    for (const cron of ["*/10 2 * * 1", "0 2 31 * *", "0 2 1 1 *", "0 2 1 * 1", "0 25 * * *", "@daily", ""]) {
      expect(planOf(cron).every).toBe("own");
      expect(cronOf(planOf(cron))).toBe(cron);
    }
  });

  it("take both names of Sunday", () => {
    expect(planOf("0 2 * * 7").weekday).toBe(0);
    expect(cronWords("0 2 * * 7")).toBe("Every Sunday at 02:00");
  });

  it("are said in words", () => {
    expect(cronWords("30 2 * * 1")).toBe("Every Monday at 02:30");
    expect(cronWords("0 14 * * *")).toBe("Every day at 14:00");
    expect(cronWords("0 4 1 * *")).toBe("On day 1 of every month at 04:00");
    expect(cronWords("*/10 2 * * 1")).toContain("*/10 2 * * 1");
  });
});

describe("time zones", () => {
  it("have UTC and the one that is held, once each", () => {
    const zones = timeZones("Mars/Olympus");
    expect(zones[0]).toBe("UTC");
    expect(zones).toContain("Mars/Olympus");
    expect(new Set(zones).size).toBe(zones.length);
  });

  it("show a moment on their own clock", () => {
    expect(inZone("2026-03-30T00:30:00Z", "Europe/Vienna")).toBe("Mon 2026-03-30 02:30");
    expect(inZone("2026-01-05T01:30:00Z", "Europe/Vienna")).toBe("Mon 2026-01-05 02:30");
    expect(inZone("2026-01-05T01:30:00Z", "Mars/Olympus")).toBe("2026-01-05T01:30:00Z");
  });
});
