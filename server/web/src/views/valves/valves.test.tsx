// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { afterEach, describe, expect, it, vi } from "vitest";
import { FakeService, done } from "../fakes";
import { IdentifyPanel } from "../recordings/identify_panel";
import { compensation, curve } from "./drawn";
import { AXIS, EXTEND, REPORT } from "./fixture";
import { ValveList } from "./list";
import { type Axis, type Direction, readValves } from "./report";
import { ValvePage } from "./result";

// A canvas is not there; what is drawn is tested as values, and in a browser.
vi.mock("../../ui/plot", () => ({ Plot: ({ title }: { title: string }) => <figure>{title}</figure> }));
afterEach(cleanup);

const VALVE = {
  id: "vlv-1",
  job: "job-1",
  machine: "arm",
  label: "Day 1",
  created: "2026-03-02T09:14:05Z",
  axes: { boom: { error: 0.031, speeds: { extend: 0.21 }, edges: {}, effects: [] } },
};

function service(role: "viewer" | "engineer" = "engineer"): FakeService {
  const fake = new FakeService(role);
  fake.resources["/valves/vlv-1"] = VALVE;
  fake.resources["/valves/vlv-1/valve.json"] = REPORT;
  fake.resources["/valves?machine=arm&limit=100"] = { items: [VALVE], next: null };
  fake.resources["/jobs?limit=500"] = { items: [], next: null };
  return fake;
}

describe("a report on valves", () => {
  it("says edges, the controller's dead band, delay and error in sentences", async () => {
    service().show(<ValvePage id="vlv-1" />);
    const panel = await screen.findByRole("region", { name: "The valve of boom" });
    for (const text of [
      /Extending: begins at 0\.0560 ± 0\.0010 of full command \(sent: 10\.20 mA\); 0\.210 m\/s/,
      /Extending: the dead band that your controller compensates \(0\.0410\) is 0\.015 too small\./,
      /Retracting: never seen to move/,
      /answers 0\.1600 ± 0\.0020 s late/,
      /at most 60\.0 l\/min/,
      /motion that no fit has seen: 3\.10\u202f% of the speed/,
      /commands that extend beyond 40 % of full were never recorded: record higher levels/,
      /“a leak past the piston” cannot be told from port_leak here/,
    ])
      expect(panel.textContent).toMatch(text);
    const row = within(panel).getByRole("row", { name: /a leak past the piston/ });
    expect(row.textContent).toContain("97\u202f%");
    expect(screen.getByText("boom: speed over command")).toBeTruthy();
    expect(screen.getByText("boom: speed on the motion that no fit has seen")).toBeTruthy();
    expect(screen.getByText("stick: does not move")).toBeTruthy();
  });

  it("shows a law that no name says among what the model lacked", async () => {
    const [effect] = AXIS.effects;
    const law = { ...effect, id: "piston_position", title: "a gain that follows piston_position", look_at: undefined };
    const axis = { ...AXIS, effects: [], unexplained: [{ ...law, indistinguishable_from: [] }] };
    const fake = service();
    fake.resources["/valves/vlv-1/valve.json"] = { ...REPORT, axes: { boom: axis } };
    fake.show(<ValvePage id="vlv-1" />);
    const panel = await screen.findByRole("region", { name: "The valve of boom" });
    const row = within(panel).getByRole("row", { name: /a gain that follows piston_position/ });
    expect(row.textContent).toContain("97\u202f%");
  });

  it("is taken to the controller in each format, where a valve moved its axis", async () => {
    service("viewer").show(<ValvePage id="vlv-1" />);
    const panel = await screen.findByRole("region", { name: "For your controller" });
    const titles = within(panel)
      .getAllByRole("button")
      .map((one) => one.textContent);
    expect(titles).toEqual(["Structured Text", "C", "Python", "CSV", "FMU", "Report as data (JSON)"]);
    cleanup();
    const fake = service();
    fake.resources["/valves/vlv-1"] = { ...VALVE, axes: { boom: { ...VALVE.axes.boom, speeds: {} } } };
    fake.show(<ValvePage id="vlv-1" />);
    await screen.findByRole("region", { name: "For your controller" });
    expect(screen.queryByRole("button", { name: /Structured Text/ })).toBeNull();
  });

  it("is proposed as a calibration, which live motion is compared with", async () => {
    const fake = service();
    fake.resources["/calibrations?machine=arm&limit=500"] = { items: [], next: null };
    fake.answers["POST /calibrations"] = done({});
    fake.show(<ValvePage id="vlv-1" />);
    fireEvent.click(await screen.findByRole("button", { name: "Propose as calibration" }));
    await waitFor(() => expect(fake.sent.map((one) => one.json)).toEqual([{ valves: "vlv-1", label: "Day 1" }]));
  });

  it("is none of another schema", () => {
    expect(readValves(REPORT)).not.toBeNull();
    expect(readValves({ ...REPORT, schema: "hilfit/report/1" })).toBeNull();
    expect(readValves(null)).toBeNull();
  });

  it("is listed with its error by axis", async () => {
    service().show(<ValveList />);
    const row = await screen.findByRole("row", { name: /Day 1/ });
    expect(row.textContent).toContain("boom 3.10\u202f%");
    expect(screen.getByRole("link", { name: "Day 1" }).getAttribute("href")).toBe("#/valves/vlv-1");
    expect(screen.getByRole("link", { name: "Choose recordings" }).getAttribute("href")).toBe("#/recordings");
  });
});

describe("what is drawn", () => {
  const axis = AXIS as unknown as Axis;

  it("is the curve with its 95 % band, and the edge as a point on it", () => {
    const { x, series } = curve(axis);
    expect(x).toEqual([-0.2, 0, 0.056, 0.1, 0.2]);
    const [line, edges] = series;
    expect(line?.values[2]).toBeCloseTo(0.028, 12);
    const [low, high] = line?.band ?? [[], []];
    expect(low[4]).toBeCloseTo(0.21 - 1.96 * 0.02, 5);
    expect(high[4]).toBeCloseTo(0.21 + 1.96 * 0.02, 5);
    expect(edges?.values).toEqual([null, null, line?.values[2], null, null]);
  });

  it("has no band in a report of a version that knew none", () => {
    const { std: _none, ...plain } = AXIS.figures.curve;
    const [line] = curve({ ...axis, figures: { ...axis.figures, curve: plain } }).series;
    expect(line?.band).toBeUndefined();
  });

  it("calls a dead band wrong only where its interval leaves zero out", () => {
    const by = (value: number, std: number | null): Direction =>
      ({
        ...EXTEND,
        compensated: {
          value: 0.04,
          too_small_by: { value, std, ci95: std === null ? null : [value - 2 * std, value + 2 * std] },
        },
      }) as Direction;
    expect(compensation(by(0.015, 0.001))).toBe("small");
    expect(compensation(by(-0.015, 0.001))).toBe("large");
    expect(compensation(by(0.001, 0.001))).toBe("right");
    expect(compensation({ moves: true, compensated: null })).toBeNull();
    expect(compensation({ moves: true })).toBeNull();
  });
});

describe("an order", () => {
  const recordings = [{ id: "rec-1", label: "cycle", role: "operation", state: "sealed" }] as never;
  const panel = (valves: boolean, role: "operation" | "validate") => (
    <IdentifyPanel
      machine="arm"
      recordings={recordings}
      selection={{ "rec-1": role }}
      valves={valves}
      onRole={() => undefined}
      onClear={() => undefined}
    />
  );

  it("goes to the valves with the recordings that are chosen, under a key of its own", async () => {
    const fake = service();
    fake.answers["POST /valves"] = done({ job: "job-2" });
    fake.show(panel(true, "operation"));
    fireEvent.click(screen.getByRole("button", { name: "Identify valves" }));
    await waitFor(() => expect(fake.sent.length).toBe(1));
    const [sent] = fake.sent;
    expect([sent?.path, sent?.json]).toEqual([
      "/valves",
      { machine: "arm", label: "", recordings: [{ id: "rec-1", role: "operation" }] },
    ]);
    expect(sent?.key).toBeTruthy();
  });

  it("needs something to fit, and a machine whose commands are recorded", () => {
    const fake = service();
    fake.show(panel(true, "validate"));
    expect((screen.getByRole("button", { name: "Identify valves" }) as HTMLButtonElement).disabled).toBe(true);
    cleanup();
    fake.show(panel(false, "operation"));
    expect(screen.queryByRole("button", { name: "Identify valves" })).toBeNull();
  });
});
