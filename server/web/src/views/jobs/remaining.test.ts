// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { remaining } from ".";

const NOW = new Date("2026-03-01T08:00:00Z").getTime();
const job = (seconds: number | null, state: "running" | "queued" = "running") => ({
  id: "job-1",
  kind: "identification",
  label: "",
  subject: "idn-1",
  stages: [],
  state,
  stage: null,
  fraction: 0.5,
  text: "",
  text_message: null,
  error: null,
  error_message: null,
  cancel_requested: false,
  created: "",
  started: null,
  ended: null,
  expected_end: seconds === null ? null : new Date(NOW + 1000 * seconds).toISOString(),
});

describe("the time that a job has left", () => {
  it("is as exact as an estimate can be", () => {
    expect(remaining(job(43), NOW)).toBe("About 45 s left.");
    expect(remaining(job(203), NOW)).toBe("About 3 min 20 s left.");
    expect(remaining(job(2000), NOW)).toBe("About 33 min left.");
  });

  it("is not made up", () => {
    expect(remaining(job(null), NOW)).toBe("How long it will take is not known yet.");
    expect(remaining(job(-4), NOW)).toBe("It takes longer than usual.");
    expect(remaining(job(null, "queued"), NOW)).toBe("Begins when the jobs before it are over.");
  });
});
