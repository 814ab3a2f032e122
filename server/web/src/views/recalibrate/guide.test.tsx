// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import report from "../results/report.fixture.json";
import { done, FakeService } from "../fakes";
import RecalibrateView from ".";
import {
  closingLabel,
  closingsOf,
  currentStep,
  newGuide,
  recordingLabel,
  recordingsOf,
  storedGuide,
  storeGuide,
} from "./progress";

const PARTS = /piston|cylinder|\brods?\b/i;

beforeEach(() => storeGuide("arm", null));
afterEach(cleanup);

function service(cylinder: object | null): FakeService {
  const fake = new FakeService("engineer");
  fake.resources["/machines/arm"] = { machine: { channels: [], joints: [{ name: "joint1", cylinder }] } };
  fake.resources["/recordings?machine=arm&limit=200"] = { items: [], next: null };
  return fake;
}

describe("a guided recalibration", () => {
  it("of a machine without cylinders speaks of none, and has no step for them", async () => {
    const { container } = service(null).show(<RecalibrateView />);
    await screen.findByText(/^A training motion is recorded twice/);
    expect(container.textContent).not.toMatch(PARTS);
    fireEvent.click(screen.getByRole("button", { name: "Begin" }));
    await screen.findByRole("list", { name: "Steps" });
    expect(screen.getAllByRole("listitem").map((item) => item.textContent?.replace(/^[i–]/, ""))).toEqual([
      "Check the sensors",
      "Record the training motion",
      "Record it once more",
      "Record another motion",
      "Identify",
    ]);
    expect(container.textContent).not.toMatch(PARTS);
  });

  it("of a machine with cylinders begins with them", async () => {
    service({ bore: 0.08, rod: 0.045 }).show(<RecalibrateView />);
    await screen.findByText(/each cylinder is moved alone/);
    fireEvent.click(screen.getByRole("button", { name: "Begin" }));
    await screen.findByText("Unpin the rods");
  });
});

const recording = (role: string, label: string, state = "sealed", created = new Date().toISOString()) => ({
  id: `rec-${label}`,
  machine: "arm",
  role,
  label,
  state,
  created,
  statistics: { rows: 100 },
});
const READY = { checked: true, stayOn: true };

/** A guide with its three recordings, whose identification is done. */
function identified(next: object | null) {
  const guide = { ...newGuide("Recalibration", "key"), ...READY };
  storeGuide("arm", guide);
  const fake = service(null);
  const items = (["train", "repeat", "validate"] as const).map((role) => recording(role, recordingLabel(guide, role)));
  fake.resources["/recordings?machine=arm&limit=200"] = { items, next: null };
  fake.resources["/recordings?machine=arm&state=recording&limit=1"] = { items: [], next: null };
  fake.resources["/identifications?machine=arm&limit=100"] = {
    items: [{ id: "idn-1", job: "job-1", label: "Recalibration" }],
    next: null,
  };
  fake.resources["/jobs/job-1"] = { ...JOB, state: "done" };
  fake.resources["/identifications/idn-1/report.json"] = { ...report, loop: { ...report.loop, next_experiment: next } };
  return fake;
}
const JOB = {
  id: "job-1",
  kind: "identification",
  label: "Recalibration",
  subject: "idn-1",
  stages: [],
  stage: null,
  fraction: 1,
  text: "Done",
  error: null,
  cancel_requested: false,
  created: "2026-03-01T08:00:00Z",
  started: null,
  ended: null,
};
const NEXT = {
  motion: "move joint2 slowly from end to end",
  why: "friction shows most there",
  separates: [],
  joint: "joint2",
  kind: "slow_sweep",
  motion_file: "next-experiment.csv",
  rods: "pinned",
  otherwise: [],
};

describe("an identification that left several causes", () => {
  it("is followed by the motion that it designed, and by another one with its recording", async () => {
    const fake = identified(NEXT);
    fake.show(<RecalibrateView />);
    fireEvent.click(await screen.findByRole("button", { name: "Record this motion next" }));
    await screen.findByRole("heading", { name: /Record the motion that tells the causes apart/ });
    expect(screen.getByText("Move joint2 slowly from end to end")).toBeTruthy();
    fake.answers["POST /recordings"] = done({});
    fireEvent.click(screen.getByRole("button", { name: "Start recording" }));
    const guide = storedGuide("arm");
    if (guide === null) throw new Error("the guide is gone");
    const label = closingLabel(guide, 0);
    await waitFor(() => expect(fake.sent[0]?.json).toMatchObject({ role: "train", label }));
    const before = fake.resources["/recordings?machine=arm&limit=200"] as { items: object[] };
    fake.resources["/recordings?machine=arm&limit=200"] = {
      items: [recording("train", label), ...before.items],
      next: null,
    };
    fake.answers["POST /identifications"] = done({});
    fake.moved("recordings");
    fireEvent.click(await screen.findByRole("button", { name: "Identify" }));
    await waitFor(() => expect(fake.sent.length).toBe(2));
    const order = fake.sent[1];
    expect(order?.json).toMatchObject({ label: "Recalibration, attempt 2" });
    expect((order?.json as { recordings: { id: string }[] }).recordings.map((one) => one.id)).toContain(`rec-${label}`);
    expect((order?.json as { recordings: object[] }).recordings.length).toBe(4);
    expect(order?.key).not.toBe("key");
  });

  it("asks for nothing where no motion was designed", async () => {
    for (const next of [null, { ...NEXT, kind: null }, { ...NEXT, motion_file: null }]) {
      identified(next).show(<RecalibrateView />);
      await screen.findByRole("button", { name: "Finish this guide" });
      expect(screen.queryByRole("button", { name: "Record this motion next" })).toBeNull();
      cleanup();
    }
  });

  it("keeps the recordings of roles and of such motions apart", () => {
    const closings = [{ identification: "idn-1", rods: "unpinned" as const, text: "" }];
    const guide = { ...newGuide("Guide", "key"), ...READY, closings };
    const items = [
      ...(["train", "repeat", "validate"] as const).map((role) => recording(role, recordingLabel(guide, role))),
    ] as never[];
    expect(currentStep(guide, recordingsOf(guide, items), closingsOf(guide, items))).toBe("closing");
    const more = [recording("unloaded", closingLabel(guide, 0)), ...items] as never[];
    expect(recordingsOf(guide, more).unloaded).toBeUndefined();
    expect(currentStep(guide, recordingsOf(guide, more), closingsOf(guide, more))).toBe("identify");
  });
});

describe("a recording of a guide", () => {
  /** The arm swings until `ago` seconds ago; the recording began a minute ago. */
  function recorded(ago: number): FakeService {
    const guide = { ...newGuide("Recalibration", "key"), ...READY };
    storeGuide("arm", guide);
    const fake = service(null);
    const now = Date.now() / 1000;
    const joints = [{ name: "joint1", cylinder: null, limits: { position: [-1, 1], velocity: 1 } }];
    const angle = { name: "joint1.angle", quantity: "joint_position", joint: "joint1", unit: "rad" };
    fake.resources["/machines/arm"] = { machine: { channels: [angle], joints } };
    const begun = recording(
      "train",
      recordingLabel(guide, "train"),
      "recording",
      new Date(1000 * (now - 60)).toISOString(),
    );
    fake.resources["/recordings?machine=arm&limit=200"] = { items: [begun], next: null };
    fake.resources["/recordings?machine=arm&state=recording&limit=1"] = { items: [begun], next: null };
    const time = Array.from({ length: 600 }, (_, row) => now - 60 + row / 10);
    const low = time.map((t) => (t > now - ago ? 0 : Math.sin(t)));
    const channels = { "joint1.angle": { unit: "rad", low, high: null, doubtful: [] } };
    const path = "/machines/arm/signals?seconds=240&moments=1500&channel=joint1.angle";
    fake.resources[path] = { start: now - 60, end: now, moment_s: 0, first_utc: null, time, channels };
    fake.answers[`POST /recordings/${begun.id}/stop`] = done({});
    return fake;
  }

  it("ends by itself once the arm is parked, also where the page was not there when that came about", async () => {
    const fake = recorded(20);
    fake.show(<RecalibrateView />);
    await waitFor(() =>
      expect(fake.sent.map((one) => one.path)).toEqual(["/recordings/rec-Recalibration, train/stop"]),
    );
    await screen.findByText(/Parked for 20 s/);
  });

  it("goes on while the arm moves, and says what was covered", async () => {
    const fake = recorded(0);
    fake.show(<RecalibrateView />);
    await screen.findByText("The arm moves");
    expect(screen.getByText("100 % of its range")).toBeTruthy();
    expect(fake.sent).toEqual([]);
  });
});
