// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { go } from "../../routes";
import { FakeService, done, refused } from "../fakes";
import SchedulesView from ".";

const LIST = "/schedules?machine=arm&limit=200";
const SCHEDULE = {
  id: "sch-1",
  machine: "arm",
  label: "Weekly",
  cron: "30 2 * * 1",
  timezone: "UTC",
  enabled: true,
  motion: "operation",
  duration_s: 300,
  excitations: [],
  deadline_s: 3600,
  options: { estimator: "gls" },
  activate: "never",
  created: "2026-03-01T08:00:00Z",
  next: "2026-03-09T02:30:00Z",
  last: null,
};

beforeEach(() => go("#/schedules"));
afterEach(cleanup);

function service(role: "viewer" | "operator" | "engineer", ...items: object[]): FakeService {
  const fake = new FakeService(role);
  fake.resources[LIST] = { items, next: null };
  fake.resources["/schedules/sch-1"] = SCHEDULE;
  fake.etags["/schedules/sch-1"] = '"4"';
  fake.resources["/excitations?machine=arm&limit=100"] = { items: [], next: null };
  return fake;
}

describe("schedules", () => {
  it("say in words when they run and what they do", async () => {
    service("viewer", SCHEDULE).show(<SchedulesView />);
    await screen.findByText("Every Monday at 02:30");
    expect(screen.getByText(/Next: Mon 2026-03-09 02:30/)).toBeTruthy();
    expect(screen.getByText(/normal work is recorded for 5 min; a new calibration is proposed/)).toBeTruthy();
    expect(screen.queryByRole("button", { name: /Run now|Switch|Change|Delete|New/ })).toBeNull();
  });

  it("are run by an operator after a question, which leads to the job", async () => {
    const fake = service("operator", SCHEDULE);
    fake.answers["POST /schedules/sch-1/run"] = done({ id: "job-7" });
    fake.show(<SchedulesView />);
    fireEvent.click(await screen.findByRole("button", { name: "Run now" }));
    fireEvent.click(screen.getByRole("button", { name: "Run it now" }));
    await waitFor(() => expect(location.hash).toBe("#/jobs/job-7"));
    expect(fake.sent.length).toBe(1);
    expect(screen.queryByRole("button", { name: "Delete" })).toBeNull();
  });

  it("are switched off with all that they were, by the ETag that was read", async () => {
    const fake = service("engineer", SCHEDULE);
    fake.answers["PUT /schedules/sch-1"] = refused(412, "schedule 'sch-1' was changed; read it again");
    fake.show(<SchedulesView />);
    const button = await screen.findByRole("button", { name: "Switch off" });
    await waitFor(() => expect(button.hasAttribute("disabled")).toBe(false));
    fireEvent.click(button);
    await screen.findByText(/was changed; read it again/);
    const { id: _id, created: _created, next: _next, last: _last, ...wish } = SCHEDULE;
    expect(fake.sent).toEqual([
      { method: "PUT", path: "/schedules/sch-1", etag: '"4"', json: { ...wish, enabled: false } },
    ]);
  });

  it("are made from presets, with the next times as the service counts them", async () => {
    const fake = service("engineer");
    fake.answers["POST /schedules"] = done({});
    fake.show(<SchedulesView />);
    fireEvent.click(await screen.findByRole("button", { name: "New schedule" }));
    fireEvent.change(screen.getByLabelText("Time zone"), { target: { value: "UTC" } });
    fireEvent.change(screen.getByLabelText("How often"), { target: { value: "day" } });
    const upcoming = "/schedules/upcoming?cron=15%204%20*%20*%20*&timezone=UTC";
    fake.resources[upcoming] = { slots: ["2026-03-02T04:15:00Z", "2026-03-03T04:15:00Z"] };
    fireEvent.input(screen.getByLabelText("Time of day"), { target: { value: "04:15" } });
    await screen.findByText("Tue 2026-03-03 04:15");
    fireEvent.input(screen.getByLabelText("For how many minutes"), { target: { value: "10" } });
    fireEvent.click(screen.getByRole("button", { name: "Create schedule" }));
    await waitFor(() => expect(fake.sent.length).toBe(1));
    expect(fake.sent[0]?.json).toMatchObject({
      machine: "arm",
      cron: "15 4 * * *",
      timezone: "UTC",
      motion: "operation",
      duration_s: 600,
      activate: "never",
      excitations: [],
    });
  });

  it("show what is wrong with an expression, in the words of the service", async () => {
    const fake = service("engineer");
    fake.show(<SchedulesView />);
    fireEvent.click(await screen.findByRole("button", { name: "New schedule" }));
    fireEvent.change(screen.getByLabelText("How often"), { target: { value: "own" } });
    fireEvent.input(screen.getByLabelText("Cron expression"), { target: { value: "often" } });
    await screen.findByText(/there is nothing at \/schedules\/upcoming\?cron=often/);
    // Said once, beside the expression: it is not sent to hear it again.
    expect(screen.getByRole("button", { name: "Create schedule" }).hasAttribute("disabled")).toBe(true);
    fireEvent.input(screen.getByLabelText("Cron expression"), { target: { value: "" } });
    await screen.findByText("Write an expression to see its next times.");
    expect(screen.getByRole("button", { name: "Create schedule" }).hasAttribute("disabled")).toBe(true);
  });

  it("are not made with a duration that no service takes", async () => {
    service("engineer").show(<SchedulesView />);
    fireEvent.click(await screen.findByRole("button", { name: "New schedule" }));
    fireEvent.input(screen.getByLabelText("For how many minutes"), { target: { value: "0.1" } });
    await screen.findByText(/Between half a minute/);
    expect(screen.getByRole("button", { name: "Create schedule" }).hasAttribute("disabled")).toBe(true);
  });
});
