// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor } from "@testing-library/preact";
import { afterEach, describe, expect, it } from "vitest";
import { FakeService } from "../fakes";
import HistoryView from ".";
import { dates, errors, type HistoryEvent, lane, sentence } from "./events";

afterEach(cleanup);

const event = (given: Partial<HistoryEvent>): HistoryEvent => ({
  time: "2026-03-01T08:00:00Z",
  until: null,
  kind: "calibration",
  what: "activated",
  text: "Spring",
  subject: "cal-1",
  by: "Kim",
  severity: null,
  effects: [],
  error: null,
  ...given,
});
const ms = (iso: string): number => new Date(iso).getTime();
const NOW = ms("2026-06-01T00:00:00Z");
const EFFECT = { id: "stribeck", joint: "joint2", title: "Stribeck friction" };

describe("a time line", () => {
  it("shows a calibration for as long as it was in use", () => {
    const steps = [
      event({ time: "2026-05-02T00:00:00Z", subject: "cal-2", text: "Summer" }),
      event({ time: "2026-05-02T00:00:00Z", what: "retired" }),
      event({ time: "2026-04-20T00:00:00Z", what: "proposed", subject: "cal-2" }),
      event({}),
    ];
    expect(lane("calibration", steps, NOW).map((one) => [one.label, one.from, one.to])).toEqual([
      ["Spring", ms("2026-03-01T08:00:00Z"), ms("2026-05-02T00:00:00Z")],
      ["", ms("2026-04-20T00:00:00Z"), null],
      ["Summer", ms("2026-05-02T00:00:00Z"), NOW],
    ]);
  });

  it("shows an alarm that holds until now, and one that went until then", () => {
    const alarm = { kind: "alarm", what: "overload", severity: "critical" } as const;
    const gone = event({ ...alarm, until: "2026-03-01T08:05:00Z" });
    expect(lane("alarm", [event(alarm), gone], NOW).map((one) => [one.to, one.tone])).toEqual([
      [ms("2026-03-01T08:05:00Z"), "bad"],
      [NOW, "bad"],
    ]);
  });

  it("says what was found, and how large the error is", () => {
    const found = event({ kind: "identification", what: "effect_added", effects: [EFFECT], error: 1.08 });
    expect(sentence(found)).toBe("Effect found and added: Stribeck friction at joint2, error 1.08 times the noise");
    expect(lane("identification", [found], NOW)[0]?.label).toBe("Stribeck friction");
    expect(errors([found, event({})])).toEqual([[ms(found.time), 1.08]]);
  });

  it("has few dates, whatever its length, and all of them within", () => {
    for (const days of [7, 30, 90, 365, 1826]) {
      const from = NOW - days * 86_400_000;
      const found = dates(from, NOW, 8);
      expect(found.length).toBeGreaterThan(1);
      expect(found.length).toBeLessThanOrEqual(9);
      for (const one of found) (expect(one.at).toBeGreaterThan(from), expect(one.at).toBeLessThanOrEqual(NOW));
    }
  });
});

describe("the history of a machine", () => {
  it("is narrowed by kind, and read anew for another length", async () => {
    const fake = new FakeService("viewer");
    const drift = event({ kind: "drift", what: "residual_drift", text: "joint2", severity: "warning", subject: "a" });
    const items = [drift, event({})];
    fake.resources["/machines/arm/history?days=90"] = {
      machine: "arm",
      since: "2026-03-01T00:00:00Z",
      complete: true,
      items,
    };
    fake.resources["/machines/arm/history?days=365"] = {
      machine: "arm",
      since: "2025-06-01T00:00:00Z",
      complete: false,
      items: [],
    };
    fake.show(<HistoryView />);
    await screen.findByText("What happened (2)");
    expect(screen.getByRole("cell", { name: /Calibration “Spring” came into use by Kim/ })).toBeTruthy();
    fireEvent.click(screen.getByRole("checkbox", { name: /Calibration in use/ }));
    await screen.findByText("What happened (1)");
    expect(screen.queryByRole("cell", { name: /Calibration “Spring” came into use by Kim/ })).toBeNull();
    fireEvent.change(screen.getByLabelText("Of the last"), { target: { value: "365" } });
    await screen.findByText(/what is missing is the oldest/);
    await waitFor(() => expect(screen.getByText("What happened (0)")).toBeTruthy());
  });
});
