// @vitest-environment happy-dom
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { go } from "../../routes";
import { FakeService } from "../fakes";
import ServiceView from ".";
import { asCsv, detail } from "./audit_log";
import { joined, type Line, said } from "./log_console";

afterEach(cleanup);
beforeEach(() => go("#/service/audit"));

const entry = (number: number, given: object = {}) => ({
  number,
  time: "2026-03-01T08:00:00Z",
  principal: "Kim (prn-1)",
  action: "calibrations.approve",
  subject: "cal-1",
  detail: { state: "approved" },
  hash: "ab",
  ...given,
});
const line = (number: number, given: object = {}): Line => ({
  number,
  time: "2026-03-01T08:00:00Z",
  level: "info",
  logger: "server.x",
  event: `event_${number}`,
  detail: {},
  ...given,
});

describe("the audit log", () => {
  it("shows who did what, page by page, and narrows it", async () => {
    const fake = new FakeService("admin");
    fake.resources["/audit?limit=100"] = { items: [entry(9)], next: 9 };
    fake.resources["/audit?limit=100&cursor=9"] = { items: [entry(3, { action: "machines.upload" })], next: null };
    fake.resources["/audit?limit=100&action=machines"] = { items: [], next: null };
    fake.show(<ServiceView />);
    await screen.findByText("calibrations.approve");
    fireEvent.click(screen.getByRole("button", { name: "Older" }));
    await screen.findByText("machines.upload");
    fireEvent.click(screen.getByRole("button", { name: "Newer" }));
    await screen.findByText("calibrations.approve");
    fireEvent.change(screen.getByLabelText("What was done"), { target: { value: "machines" } });
    await screen.findByText("There is no such entry.");
  });

  it("says whether it is as it was written", async () => {
    const fake = new FakeService("admin");
    fake.resources["/audit?limit=100"] = { items: [], next: null };
    fake.resources["/audit/verification"] = { intact: false, first_broken: 4, entries: 3, last_hash: "cd" };
    fake.show(<ServiceView />);
    fireEvent.click(await screen.findByRole("button", { name: "Verify the chain of hashes" }));
    await screen.findByText(/Entry 4 is not as it was written/);
  });

  it("is not asked for by who may not read it", async () => {
    const fake = new FakeService("engineer");
    fake.show(<ServiceView />);
    await screen.findByText(/for admins of all machines/);
    cleanup();
    new FakeService("admin", { machines: ["arm"] }).show(<ServiceView />);
    await screen.findByText(/for admins of all machines/);
  });

  it("is a table for a spreadsheet, which runs nothing of it", async () => {
    const text = await asCsv([entry(1, { subject: '=cmd|"x"' })]).text();
    expect(text.split("\r\n")[1]).toBe(
      '"1","2026-03-01T08:00:00Z","Kim (prn-1)","calibrations.approve","\'=cmd|""x""","state: approved","ab"',
    );
    expect(detail(entry(1, { detail: { n: 2, list: [1] } }))).toBe("n: 2, list: [1]");
  });
});

describe("the log console", () => {
  it("goes on where it was, forgets the oldest, and begins anew with the service", () => {
    const known = [line(1), line(2)];
    expect(joined(known, { items: [line(2), line(3)], newest: 3 }, 2).map((one) => one.number)).toEqual([1, 2, 3]);
    expect(joined(known, { items: [line(3)], newest: 3 }, 2, 2).map((one) => one.number)).toEqual([2, 3]);
    expect(joined(known, { items: [line(1)], newest: 1 }, 2)).toEqual([]);
  });

  it("shows what the service says", async () => {
    go("#/service/log");
    const fake = new FakeService("admin");
    const failed = line(7, { level: "error", event: "monitor_failed", detail: { machine: "arm" } });
    fake.resources["/logs?level=info&limit=500"] = { items: [line(6), failed], newest: 7 };
    fake.resources["/logs?level=error&limit=500"] = { items: [failed], newest: 7 };
    fake.show(<ServiceView />);
    await screen.findByText("event_6");
    expect(said(failed)).toBe("machine=arm (server.x)");
    fireEvent.change(screen.getByLabelText("Show"), { target: { value: "error" } });
    await screen.findByText("monitor_failed");
    expect(screen.getAllByRole("listitem").length).toBeGreaterThan(0);
  });
});
