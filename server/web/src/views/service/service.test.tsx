// @vitest-environment happy-dom
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { go } from "../../routes";
import { done, FakeService } from "../fakes";
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

describe("webhooks", () => {
  const webhook = {
    id: "whk-1",
    label: "shop",
    url: "https://erp.example/hilfit",
    events: ["alarm"],
    created: "2026-03-01T08:00:00Z",
    created_by: "Kim",
  };
  const delivery = (state: string, given: object = {}) => ({
    id: `dlv-${state}`,
    message: "msg-1",
    type: "alarm",
    state,
    tries: 9,
    error: null,
    created: "2026-03-01T08:00:00Z",
    ended: null,
    ...given,
  });

  it("shows what became of each message, sends a test, and removes one after asking", async () => {
    go("#/service/webhooks");
    const fake = new FakeService("admin");
    const given = delivery("given_up", { error: "the receiver answered 500" });
    fake.resources["/webhooks?limit=100"] = { items: [webhook], next: null };
    fake.resources["/webhooks/whk-1/deliveries?limit=50"] = { items: [given, delivery("delivered")], next: null };
    fake.resources["/webhooks/whk-1/deliveries?limit=50&state=given_up"] = { items: [given], next: null };
    fake.answers["POST /webhooks/whk-1/test"] = done(delivery("pending"));
    fake.answers["DELETE /webhooks/whk-1"] = done(null);
    fake.show(<ServiceView />);
    await screen.findByText("the receiver answered 500");
    expect(screen.getAllByText("delivered").length).toBe(2); // of the table and of what it is narrowed by
    fireEvent.change(screen.getByLabelText("State"), { target: { value: "given_up" } });
    await screen.findByText("the receiver answered 500");
    fireEvent.click(screen.getByRole("button", { name: "Send a test message" }));
    await vi.waitFor(() => expect(fake.sent.map((own) => own.path)).toEqual(["/webhooks/whk-1/test"]));
    fireEvent.click(screen.getByRole("button", { name: "Remove" }));
    expect(fake.sent.length).toBe(1);
    fireEvent.click(screen.getAllByRole("button", { name: "Remove" }).at(-1) as HTMLElement);
    await vi.waitFor(() => expect(fake.sent[1]).toMatchObject({ method: "DELETE", path: "/webhooks/whk-1" }));
  });

  it("shows the secret of a new one", async () => {
    go("#/service/webhooks");
    const fake = new FakeService("admin");
    fake.resources["/webhooks?limit=100"] = { items: [], next: null };
    fake.answers["POST /webhooks"] = done({ ...webhook, secret: "whsec_x" });
    fake.show(<ServiceView />);
    await screen.findByText("Nothing is told to other systems by webhooks.");
    fireEvent.input(screen.getByLabelText("Address"), { target: { value: "https://erp.example/hilfit" } });
    fireEvent.click(screen.getByRole("button", { name: "Add a webhook" }));
    await screen.findByText("whsec_x");
    expect(fake.sent[0]).toMatchObject({ json: { url: "https://erp.example/hilfit", label: "" } });
  });
});
