// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, within } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { FakeService } from "../fakes";
import BusCheckView, { driftOf, identityOf } from ".";

type Check = components["schemas"]["BusCheck"];
type Channel = components["schemas"]["CheckedChannel"];

afterEach(cleanup);
beforeEach(() => go("#/bus-check/crane"));

const channel = (name: string, given: Partial<Channel> = {}): Channel => ({
  name,
  unit: "bar",
  bus: "can",
  device: "node 31",
  value: 101.25,
  raw: 4711,
  noise: 0.0153,
  step: 0.01,
  drift: 0.012,
  drift_std: 0.034,
  moved: false,
  age_ms: 0,
  jitter_ms: 0.4,
  share: 1,
  others: {},
  ...given,
});
const check = (given: Partial<Check> = {}): Check => ({
  machine: "crane",
  utc: "2026-03-01 08:00 UTC",
  seconds: 20,
  rate_hz: 50,
  cycles: 5000,
  skipped: 0,
  worst_late_ms: 3.21,
  devices: [
    {
      bus: "can",
      device: "node 31",
      state: "running",
      detail: "",
      identity: { device: "HF-P40", "serial number": "0x00000042", firmware: "1.2" },
      mapping: "TPDO1 0x19F: 0x6130:1/32",
      latency_ms: 1.234,
      jitter_ms: 0.5,
    },
    {
      bus: "modbus",
      device: "unit 4",
      state: "silent",
      detail: "does not answer",
      identity: {},
      mapping: "",
      latency_ms: null,
      jitter_ms: null,
    },
  ],
  channels: [channel("boom.head"), channel("boom.angle", { moved: true, drift: null, drift_std: null, share: 0.5 })],
  delays: [],
  findings: ["modbus unit 4: does not answer"],
  notes: [],
  messages: {},
  ...given,
});
const PATH = "/machines/crane/bus-check?depressurised=false";

describe("the bus check", () => {
  it("shows what devices say they are, how soon they answer, and what channels do at rest", async () => {
    const fake = new FakeService("viewer");
    fake.resources[PATH] = check();
    fake.show(<BusCheckView />);
    await screen.findByText("modbus unit 4: does not answer");
    const [devices, channels] = screen.getAllByRole("table") as [HTMLElement, HTMLElement];
    const [, node, unit] = within(devices).getAllByRole("row");
    for (const word of ["HF-P40, serial number 0x00000042, firmware 1.2", "TPDO1 0x19F", "1.23", "0.50", "running"])
      expect(node?.textContent).toContain(word);
    expect(unit?.textContent).toContain("silent");
    const [, head, angle] = within(channels).getAllByRole("row");
    for (const word of ["101.3 bar", "4711", "0.015", "0.012 ± 0.034", "100.0\u202f%"])
      expect(head?.textContent).toContain(word);
    for (const word of ["moves", "50.0\u202f%"]) expect(angle?.textContent).toContain(word);
  });

  it("says that there is nothing to look at, and asks for zeros where there is no pressure", async () => {
    const fake = new FakeService("viewer");
    fake.resources[PATH] = check({ findings: [] });
    fake.resources["/machines/crane/bus-check?depressurised=true"] = check({
      findings: ["boom.head: shows 3.2 bar without pressure"],
    });
    fake.show(<BusCheckView />);
    await screen.findByText("Nothing to look at.");
    fireEvent.click(screen.getByRole("checkbox"));
    await screen.findByText("boom.head: shows 3.2 bar without pressure");
  });

  it("shows by how much buses are behind each other, and which joints say so", async () => {
    const fake = new FakeService("viewer");
    fake.resources[PATH] = check({
      channels: [channel("boom.angle"), channel("boom.head", { bus: "modbus", device: "unit 4" })],
      delays: [
        {
          bus: "modbus",
          reference: "can",
          delay_ms: 12.34,
          std_ms: 1.2,
          told_by: [
            { joint: "boom", kind: "effort", delay_ms: 12.9, std_ms: 1.5 },
            { joint: "stick", kind: "position", delay_ms: -0.5, std_ms: 2 },
          ],
        },
      ],
    });
    fake.show(<BusCheckView />);
    const table = (await screen.findAllByRole("table")).at(-1) as HTMLElement;
    const [, row] = within(table).getAllByRole("row");
    for (const word of ["modbus", "can", "12.3 ± 1.2", "boom (effort) 12.9 ± 1.5; stick (position) −0.5 ± 2.0"])
      expect(row?.textContent).toContain(word);
  });

  it("says what it takes to tell delays, where there are two buses", async () => {
    const fake = new FakeService("viewer");
    fake.resources[PATH] = check({
      channels: [channel("boom.angle"), channel("boom.head", { bus: "modbus", device: "unit 4" })],
    });
    fake.show(<BusCheckView />);
    await screen.findByText(/motion of 15 s or more/);
  });

  it("has words where a device says nothing and a channel has no value", () => {
    const silent = check().devices[1];
    expect(silent !== undefined && identityOf(silent)).toBe("–");
    expect(driftOf(channel("a", { drift: null, drift_std: null }))).toBe("–");
  });
});
