// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { go } from "../../routes";
import { FakeService, done, refused, unknown } from "../fakes";
import RecordingsView from ".";

const recording = (id: string, role: string, given: object = {}) => ({
  id,
  machine: "arm",
  machine_version: 1,
  role,
  label: `${role} of Monday`,
  state: "sealed",
  origin: "recorded",
  format: "parquet",
  created: "2026-03-01T08:00:00Z",
  ended: "2026-03-01T08:01:00Z",
  bytes: 269526,
  sha256: "00",
  statistics: { rows: 3000, seconds: 60, missed_cycles: 0, quality: {} },
  error: null,
  ...given,
});
const ITEMS = [
  recording("rec-2", "validate"),
  recording("rec-1", "train"),
  recording("rec-0", "train", { state: "failed", label: "broken", error: "the disk was full" }),
];

beforeEach(() => go("#/recordings"));
afterEach(cleanup);

function service(role: "viewer" | "operator" | "engineer"): FakeService {
  const fake = new FakeService(role);
  fake.resources["/recordings?machine=arm&limit=200"] = { items: ITEMS, next: null };
  fake.resources["/recordings?machine=arm&limit=1"] = { items: ITEMS.slice(0, 1), next: null };
  fake.resources["/recordings?machine=arm&limit=1&state=recording"] = { items: [], next: null };
  fake.resources["/machines/arm"] = { name: "arm", acquisition: { state: "running" } };
  fake.resources["/recordings/rec-1/statistics"] = {
    rows: 3000,
    seconds: 60,
    rate_hz: 50,
    gaps: 0,
    channels: {
      "joint1.angle": { minimum: -0.5, maximum: 0.5, mean: 0, std: 0.2, missing: 0, quality: { fresh: 3000 } },
      "joint1.head_pressure": {
        minimum: 1,
        maximum: 2,
        mean: 1.5,
        std: 0.1,
        missing: 400,
        quality: { fresh: 2600, stale: 400 },
      },
    },
  };
  return fake;
}

describe("recordings", () => {
  it("are identified from once, in the roles that were chosen, under one key", async () => {
    const fake = service("engineer");
    fake.answers["POST /identifications"] = unknown("Unknown whether this was done");
    fake.show(<RecordingsView />);
    fireEvent.click(await screen.findByLabelText("Use train of Monday for an identification"));
    fireEvent.click(screen.getByLabelText("Use validate of Monday for an identification"));
    fireEvent.change(screen.getByLabelText("Use validate of Monday as"), { target: { value: "operation" } });
    fireEvent.click(screen.getByRole("button", { name: "Identify" }));
    await screen.findByText(/Unknown whether this was done/);
    fake.answers["POST /identifications"] = done({ job: "job-9" });
    fireEvent.click(screen.getByRole("button", { name: "Identify" }));
    await waitFor(() => expect(location.hash).toBe("#/jobs/job-9"));
    expect(fake.sent[0]?.json).toMatchObject({
      machine: "arm",
      recordings: [
        { id: "rec-2", role: "operation" },
        { id: "rec-1", role: "train" },
      ],
    });
    // Ordered again by a person after an answer that was lost: the key tells the service that it is the same order.
    expect(fake.sent[1]?.key).toBe(fake.sent[0]?.key);
  });

  it("that failed cannot be chosen and say why they failed", async () => {
    service("engineer").show(<RecordingsView />);
    await screen.findByText("the disk was full");
    expect(screen.getAllByRole("checkbox").length).toBe(2);
  });

  it("show their channels, and those that are not fresh", async () => {
    service("viewer").show(<RecordingsView />);
    fireEvent.click(await screen.findByRole("button", { name: "View train of Monday" }));
    await screen.findByText("400 stale");
    const panel = screen.getByRole("region", { name: "train of Monday" });
    for (const format of ["Parquet", "CSV", "MDF4", "MCAP"])
      expect(within(panel).getByRole("button", { name: `Download ${format}` })).toBeTruthy();
    expect(within(panel).queryByRole("button", { name: "Delete" })).toBeNull();
    expect(screen.queryAllByRole("checkbox")).toEqual([]);
  });

  it("are deleted after a question, and stay where the service says that they are in use", async () => {
    const fake = service("engineer");
    fake.answers["DELETE /recordings/rec-1"] = refused(409, "recording 'rec-1' was used by 'idn-1'");
    fake.show(<RecordingsView />);
    fireEvent.click(await screen.findByRole("button", { name: "View train of Monday" }));
    fireEvent.click(await screen.findByRole("button", { name: "Delete" }));
    expect(fake.sent).toEqual([]);
    fireEvent.click(screen.getByRole("button", { name: "Delete it" }));
    await screen.findByText(/was used by 'idn-1'/);
    expect(screen.getByRole("region", { name: "train of Monday" })).toBeTruthy();
  });

  it("cannot be uploaded by who only looks", async () => {
    service("viewer").show(<RecordingsView />);
    await screen.findByText(/an operator can upload recordings/);
    expect(screen.queryByLabelText("Files")).toBeNull();
  });

  it("of a wrong kind are refused before they are sent", async () => {
    service("operator").show(<RecordingsView />);
    const input = (await screen.findByLabelText("Files")) as HTMLInputElement;
    const file = new File(["x"], "a.xlsx");
    Object.defineProperty(input, "files", { value: [file] });
    fireEvent.change(input);
    await screen.findByText(/“a.xlsx” is none of .csv, .parquet, .txt/);
    expect(screen.getByRole("button", { name: "Upload" }).hasAttribute("disabled")).toBe(true);
  });
});
