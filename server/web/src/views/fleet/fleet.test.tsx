// @vitest-environment happy-dom
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { afterEach, describe, expect, it } from "vitest";
import { FakeService } from "../fakes";
import FleetView, { share } from ".";

afterEach(cleanup);

const joint = (cusum: number) => ({
  joint: "joint2",
  residual: 12.345,
  unit: "N m",
  cusum,
  statistic: "direction",
  threshold: 10,
  false_alarms_per_year: 0.1,
  learnt: 1,
  moved: [],
});
const machine = (name: string, given: object = {}) => ({
  name,
  version: 3,
  acquisition: "running",
  monitor: "watching" as const,
  reason: null,
  joint: joint(6),
  calibration: { id: "cal-1", label: "Spring", activated: "2026-03-01T08:00:00Z", error: 1.08 },
  alarms: { critical: 1, warning: 0, info: 0, waiting: 2 },
  ...given,
});

describe("the fleet", () => {
  it("shows each machine's residual against its limit, its calibration and its alarms", async () => {
    const fake = new FakeService("viewer");
    const quiet = { critical: 0, warning: 0, info: 0, waiting: 0 };
    fake.resources["/fleet"] = {
      items: [
        machine("crane"),
        machine("digger", {
          monitor: "off",
          reason: "the machine is not acquired at the moment",
          joint: null,
          calibration: null,
          alarms: quiet,
        }),
      ],
    };
    fake.show(<FleetView />);
    await screen.findByText("crane");
    const [, first, second] = screen.getAllByRole("row");
    expect(first?.textContent).toContain("60\u202f% joint2, 12.3 N m");
    expect(first?.textContent).toContain("Spring");
    expect(first?.textContent).toContain("1.08 times the noise");
    expect(first?.textContent).toContain("1 critical");
    expect(first?.querySelector("meter")?.className).toBe("warning");
    expect(second?.textContent).toContain("not acquired at the moment");
    expect(second?.textContent).toContain("none");
  });

  it("leads to a machine, which is then looked at", async () => {
    const fake = new FakeService("viewer");
    fake.resources["/fleet"] = { items: [machine("crane")] };
    fake.show(<FleetView />);
    fireEvent.click(await screen.findByRole("button", { name: "History of crane" }));
    expect(fake.session.machine.value).toBe("crane");
    expect(location.hash).toBe("#/history");
  });

  it("has no share where nothing is watched", () => {
    expect(share(machine("a"))).toBeCloseTo(0.6);
    expect(share(machine("a", { joint: null }))).toBeNull();
  });
});
