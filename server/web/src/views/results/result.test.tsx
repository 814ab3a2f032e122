// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { afterEach, describe, expect, it, vi } from "vitest";
import { FakeService, done, unknown } from "../fakes";
import content from "./report.fixture.json";
import { ResultPage } from "./result";

// A canvas is not there; what is drawn is tested as values, and in a browser.
vi.mock("../../ui/plot", () => ({ Plot: ({ title }: { title: string }) => <figure>{title}</figure> }));
afterEach(cleanup);

const IDENTIFICATION = {
  id: "idn-1",
  job: "job-1",
  machine: "arm",
  machine_version: 1,
  label: "Spring",
  created: "2026-03-02T09:14:05Z",
  options: {},
  recordings: [],
  verdict: "effect_added",
  overall: content.overall,
};
const LIST = "/calibrations?machine=arm&limit=500";

function service(role: "viewer" | "operator" | "engineer"): FakeService {
  const fake = new FakeService(role);
  fake.resources["/identifications/idn-1"] = IDENTIFICATION;
  fake.resources["/identifications/idn-1/report.json"] = content;
  fake.resources[LIST] = { items: [], next: null };
  return fake;
}

describe("a result", () => {
  it("says the verdict in one sentence and shows every part", async () => {
    service("engineer").show(<ResultPage id="idn-1" />);
    await screen.findByText(/^The model lacked friction that depends on the piston position/);
    for (const name of ["Error of each joint", "What was found", "Candidate causes", "What moved when it was added"])
      expect(screen.getByRole("region", { name })).toBeTruthy();
    const errors = screen.getByRole("region", { name: "Error of each joint" });
    expect(errors.textContent).toContain("joint2");
    expect(errors.textContent).toContain("0.640\u202f% of the measured effort (before: 1.56\u202f%)");
    // On the first screen, and in the table.
    expect(screen.getAllByRole("img", { name: /^joint2: before 5\.30, after 1\.86/ }).length).toBe(2);
    for (const question of ["What was missing?", "How sure is that?", "How much better is it?", "What to do?"])
      expect(screen.getByRole("heading", { name: question })).toBeTruthy();
    expect(screen.getByText(/What is left at joint2/)).toBeTruthy();
    expect(screen.getByText("Training motion, once more")).toBeTruthy();
  });

  it("that was only fitted does not claim that nothing is missing", async () => {
    const fake = service("viewer");
    const loop = { ...content.loop, verdict: "nothing_missing", looked: false, effects: [] };
    fake.resources["/identifications/idn-1/report.json"] = { ...content, loop };
    fake.show(<ResultPage id="idn-1" />);
    await screen.findByText(/nobody looked for what it may lack\. The error is .* times the measurement noise/);
    expect(screen.queryByText(/Nothing is missing/)).toBeNull();
  });

  it("is proposed as a calibration once, under its name", async () => {
    const fake = service("operator");
    fake.answers["POST /calibrations"] = done({ id: "cal-1" });
    fake.show(<ResultPage id="idn-1" />);
    const button = await screen.findByRole("button", { name: "Propose as calibration" });
    fireEvent.click(button);
    fireEvent.click(button);
    await waitFor(() => expect(fake.sent.length).toBe(1));
    expect(fake.sent[0]?.json).toEqual({ identification: "idn-1", label: "Spring" });
  });

  it("does not say that it was proposed when the answer was lost", async () => {
    const fake = service("operator");
    fake.answers["POST /calibrations"] = unknown("Unknown whether this was done");
    fake.show(<ResultPage id="idn-1" />);
    fireEvent.click(await screen.findByRole("button", { name: "Propose as calibration" }));
    await screen.findByText(/Unknown whether this was done/);
    expect(fake.sent.length).toBe(1);
  });

  it("is only looked at by a viewer, who is told who can do more", async () => {
    service("viewer").show(<ResultPage id="idn-1" />);
    await screen.findByText(/an operator can propose this result/);
    expect(screen.queryByRole("button", { name: "Propose as calibration" })).toBeNull();
    expect(screen.getByRole("button", { name: /Report to read/ })).toBeTruthy();
  });

  it("has the model as a file once it is proposed", async () => {
    const fake = service("operator");
    fake.resources[LIST] = { items: [{ id: "cal-1", identification: "idn-1", state: "proposed" }], next: null };
    fake.show(<ResultPage id="idn-1" />);
    expect(await screen.findByRole("button", { name: "Download Model (JSON)" })).toBeTruthy();
    expect(screen.getByText(/waits for somebody to approve/)).toBeTruthy();
  });

  it("that is not done shows its job", async () => {
    const fake = service("operator");
    fake.resources["/identifications/idn-1"] = { ...IDENTIFICATION, verdict: null, overall: null };
    fake.resources["/jobs/job-1"] = {
      id: "job-1",
      kind: "identification",
      label: "Spring",
      subject: "idn-1",
      stages: ["check"],
      stage: "check",
      state: "running",
      fraction: 0.25,
      text: "checking",
      error: null,
      cancel_requested: false,
      created: "2026-03-02T09:14:05Z",
      started: "2026-03-02T09:14:05Z",
      ended: null,
    };
    fake.show(<ResultPage id="idn-1" />);
    expect(await screen.findByText(/25.% checking/)).toBeTruthy();
    expect(screen.queryByText(/^The model lacked/)).toBeNull();
  });

  it("whose report is of another version can still be taken along", async () => {
    const fake = service("viewer");
    fake.resources["/identifications/idn-1/report.json"] = { schema: "hilfit/report/9" };
    fake.show(<ResultPage id="idn-1" />);
    await screen.findByText(/cannot read the report/);
    expect(screen.getByRole("button", { name: /Report as data/ })).toBeTruthy();
  });

  it("leads to the next experiment", async () => {
    const fake = service("engineer");
    const next = {
      kind: "slow_reversals",
      motion: "reversals of joint2",
      why: "position_dependent_friction and stribeck differ by 1.2",
      separates: ["position_dependent_friction", "stribeck"],
      motion_file: "next-experiment.csv",
    };
    fake.resources["/identifications/idn-1/report.json"] = {
      ...content,
      loop: { ...content.loop, verdict: "ambiguous", next_experiment: next },
    };
    fake.show(<ResultPage id="idn-1" />);
    const panel = await screen.findByRole("region", { name: "Next experiment" });
    expect(panel.textContent).toContain("Reversals of joint2");
    expect(panel.textContent).toContain("Friction that depends on the piston position and");
    expect(within(panel).getByRole("button", { name: "Download this motion (CSV)" })).toBeTruthy();
  });

  it("that no motion helps says what else does, and offers none", async () => {
    const fake = service("engineer");
    const otherwise = ["the same stroke with two loads", "change the back-pressure at constant load"];
    const next = { kind: null, motion: otherwise.join("; or "), why: "no motion tells them apart", otherwise };
    const loop = { ...content.loop, verdict: "ambiguous", next_experiment: next };
    fake.resources["/identifications/idn-1/report.json"] = { ...content, loop };
    fake.show(<ResultPage id="idn-1" />);
    const panel = await screen.findByRole("region", { name: "Next experiment" });
    expect(
      within(panel)
        .getAllByRole("listitem")
        .map((one) => one.textContent),
    ).toEqual(["The same stroke with two loads", "Change the back-pressure at constant load"]);
    expect(within(panel).queryByRole("button")).toBeNull();
    expect(within(panel).queryByRole("group")).toBeNull(); // nothing is said twice
  });

  it("of a machine that is not looked at turns to that machine", async () => {
    const fake = service("viewer");
    fake.resources["/identifications/idn-1"] = { ...IDENTIFICATION, machine: "other" };
    fake.show(<ResultPage id="idn-1" />);
    await waitFor(() => expect(fake.session.machine.value).toBe("other"));
  });
});
