// @vitest-environment happy-dom
import { cleanup, screen, within } from "@testing-library/preact";
import { afterEach, describe, expect, it } from "vitest";
import { FakeService } from "../fakes";
import { trend } from "./load_panel";
import { MonitorPanel } from "./monitor_panel";

afterEach(cleanup);

const near = (joint: string, share: number) => ({ joint, residual: 812.4, unit: "N m", share });
const watching = (given: object) => ({
  state: "watching",
  joints: [],
  payload: { mass: 12.345, std: 0.21 },
  overload: null,
  overload_delay_s: 0.08,
  overload_joints: [near("boom", 0.37), near("stick", 0.05)],
  ...given,
});

function show(state: object): void {
  const fake = new FakeService("viewer");
  fake.resources["/machines/arm/monitor"] = state;
  fake.show(<MonitorPanel machine="arm" />);
}

describe("the load", () => {
  it("is the mass at the tip with its deviation, and the share of each joint's threshold", async () => {
    show(watching({}));
    await screen.findByText("12.35 ± 0.21 kg");
    const table = screen.getByRole("table", { name: /Nearest to an overload/ });
    expect(within(table).getByText("37 %")).toBeTruthy();
    expect(within(table).getAllByText(/812 N m/)).toHaveLength(2);
    screen.getByText("No overload");
  });

  it("says where an overload is", async () => {
    const overload = { on: true, time: 3, joint: "boom", residual: 812.4, unit: "N m", score: 9, threshold: 6 };
    show(watching({ overload }));
    await screen.findByText("Overload at boom");
    screen.getByText(/was 812 N m at boom/);
  });

  it("says what is not known, and nothing while nobody watches", async () => {
    show(watching({ payload: null, overload_delay_s: null, overload_joints: [] }));
    await screen.findByText(/too little moves/);
    screen.getByText("Overloads are not watched");
    cleanup();
    show({ state: "off", joints: [], reason: "no calibration is active" });
    await screen.findByText("no calibration is active");
    expect(screen.queryByText("Load")).toBeNull();
  });
});

describe("valves", () => {
  const axis = (joint: string, given: object) => ({
    joint,
    residual: 0.0012,
    unit: "m/s",
    cusum: 3,
    threshold: 18,
    learnt: 1,
    moved: [],
    ...given,
  });

  it("are not shown where none are followed", async () => {
    show(watching({ valves: { state: "off", calibration: null, joints: [], reason: "no calibration" } }));
    await screen.findByText("Residual monitor");
    expect(screen.queryByRole("region", { name: "Valves" })).toBeNull();
  });

  it("say which number has moved by how much", async () => {
    const moved = [{ name: "edge.extend", value: -0.0208, std: 0.0005, unit: "of full command" }];
    const joints = [axis("boom", { cusum: 36, moved }), axis("jib", {})];
    show(watching({ valves: { state: "drift", calibration: "cal-2", joints, reason: null } }));
    const panel = await screen.findByRole("region", { name: "Valves" });
    within(panel).getByText("A valve is not as it was identified");
    const row = within(panel).getByRole("row", { name: /boom/ });
    expect(row.textContent).toContain("Extending: edge by −0.02080 ± 0.00050 of full command");
    expect(within(panel).getByRole("row", { name: /jib/ }).textContent).not.toContain("edge");
  });
});

describe("a trend", () => {
  it("begins anew after a gap and goes from the left to the right edge", () => {
    expect(trend([0, 1, null, 1], 0, 1)).toBe("M0.0 48.0L93.3 0.0M280.0 0.0");
  });
});
