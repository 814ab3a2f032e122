// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { go } from "../../routes";
import { FakeService, done, refused } from "../fakes";
import CalibrationsView from ".";
import { sorted } from "./compare";

const LIST = "/calibrations?machine=arm&limit=200";
const calibration = (given: object) => ({
  id: "cal-1",
  machine: "arm",
  identification: "idn-1",
  valves: null,
  label: "Spring",
  state: "proposed",
  proposed_by: "Tablet",
  proposed_by_id: "prn-tablet",
  approved_by: null,
  created: "2026-03-01T08:00:00Z",
  activated: null,
  verdict: "effect_added",
  overall: { change_percent: -33 },
  errors: {},
  parameters: [],
  note: "",
  history: [],
  ...given,
});
const IN_USE = calibration({ id: "cal-2", label: "Winter", state: "active", activated: "2026-01-02T08:00:00Z" });
const OLD = calibration({ id: "cal-3", label: "Autumn", state: "retired", activated: "2025-10-02T08:00:00Z" });

beforeEach(() => go("#/calibrations"));
afterEach(cleanup);

function service(role: "viewer" | "engineer", ...items: object[]): FakeService {
  const fake = new FakeService(role);
  fake.resources[LIST] = { items, next: null };
  return fake;
}

describe("calibrations", () => {
  it("are approved with a note, after a question, once", async () => {
    const fake = service("engineer", calibration({}));
    fake.answers["POST /calibrations/cal-1/approve"] = done({});
    fake.show(<CalibrationsView />);
    fireEvent.click(await screen.findByRole("button", { name: "Approve Spring" }));
    expect(fake.sent).toEqual([]);
    fireEvent.input(screen.getByLabelText("Note (optional)"), { target: { value: "looked at it" } });
    fireEvent.click(screen.getByRole("button", { name: "Approve it" }));
    await waitFor(() => expect(fake.sent.length).toBe(1));
    expect(fake.sent[0]).toMatchObject({ path: "/calibrations/cal-1/approve", json: { note: "looked at it" } });
  });

  it("are not approved by who proposed them, and it says why", async () => {
    service("engineer", calibration({ proposed_by_id: "prn-me" })).show(<CalibrationsView />);
    await screen.findByText(/another engineer has to approve/);
    expect(screen.queryByRole("button", { name: /^Approve/ })).toBeNull();
    expect(screen.getByRole("button", { name: "Reject Spring" })).toBeTruthy();
  });

  it("show a refusal of the service", async () => {
    const fake = service("engineer", calibration({ state: "approved" }));
    fake.answers["POST /calibrations/cal-1/activate"] = refused(409, "calibration 'cal-1' is rejected");
    fake.show(<CalibrationsView />);
    fireEvent.click(await screen.findByRole("button", { name: "Use Spring" }));
    fireEvent.click(screen.getByRole("button", { name: "Use it from now on" }));
    await screen.findByText(/is rejected/);
  });

  it("offer a viewer nothing to press but to look, to compare and to take along", async () => {
    service("viewer", calibration({}), IN_USE, OLD).show(<CalibrationsView />);
    await screen.findByText("Winter");
    const names = screen.getAllByRole("button").map((button) => button.textContent);
    for (const name of names) expect(name).toMatch(/Compare|Model|Report/);
    expect(screen.getByText(/An engineer can roll back/)).toBeTruthy();
  });

  it("are rolled back after a question that names where to", async () => {
    const fake = service("engineer", IN_USE, OLD);
    fake.answers["POST /machines/arm/calibrations/rollback"] = done(calibration({ label: "Autumn" }));
    fake.show(<CalibrationsView />);
    fireEvent.click(await screen.findByRole("button", { name: "Roll back" }));
    const dialog = screen.getByRole("dialog");
    expect(dialog.textContent).toContain("Autumn");
    fireEvent.click(within(dialog).getByRole("button", { name: "No, go back" }));
    expect(fake.sent).toEqual([]);
    fireEvent.click(screen.getByRole("button", { name: "Roll back" }));
    fireEvent.click(within(screen.getByRole("dialog")).getByRole("button", { name: "Roll back" }));
    await screen.findByText("“Autumn” is in use again.");
    expect(fake.sent.length).toBe(1);
  });

  it("of valves are in use beside that of the mechanics, and rolled back by themselves", async () => {
    const own = { identification: null, valves: "vlv-1" };
    const now = calibration({
      ...own,
      id: "cal-5",
      label: "Valves of spring",
      state: "active",
      activated: "2026-02-02",
    });
    const before = calibration({
      ...own,
      id: "cal-4",
      label: "Valves of old",
      state: "retired",
      activated: "2025-12-02",
    });
    const fake = service("engineer", now, IN_USE, before, OLD);
    fake.answers["POST /machines/arm/calibrations/rollback?of=valves"] = done(before);
    fake.show(<CalibrationsView />);
    await screen.findByText("Valves in use");
    const links = screen.getAllByText("View the result").map((link) => link.getAttribute("href"));
    expect(links.slice(0, 2)).toEqual(["#/results/idn-1", "#/valves/vlv-1"]);
    fireEvent.click(screen.getAllByRole("button", { name: "Roll back" })[1] as HTMLElement);
    const dialog = screen.getByRole("dialog");
    expect(dialog.textContent).toContain("Valves of old");
    fireEvent.click(within(dialog).getByRole("button", { name: "Roll back" }));
    await waitFor(() =>
      expect(fake.sent.map((one) => one.path)).toEqual(["/machines/arm/calibrations/rollback?of=valves"]),
    );
  });

  it("are taken out of use where none was before", async () => {
    const fake = service("engineer", IN_USE);
    fake.answers["POST /calibrations/cal-2/deactivate"] = done(calibration({ state: "retired" }));
    fake.show(<CalibrationsView />);
    fireEvent.click(await screen.findByRole("button", { name: "Take it out of use" }));
    const dialog = screen.getByRole("dialog");
    expect(dialog.textContent).toContain("monitor rests");
    fireEvent.click(within(dialog).getByRole("button", { name: "Take it out of use" }));
    await waitFor(() => expect(fake.sent.map((one) => one.path)).toEqual(["/calibrations/cal-2/deactivate"]));
  });

  it("appear when the service says that there are new ones", async () => {
    const fake = service("viewer");
    fake.show(<CalibrationsView />);
    await screen.findByText(/No calibration is in use/);
    fake.resources[LIST] = { items: [IN_USE], next: null };
    fake.moved("calibrations");
    await screen.findByText("Winter");
  });

  it("cannot be changed while the service is away", async () => {
    const fake = service("engineer", calibration({}));
    fake.show(<CalibrationsView />);
    await screen.findByRole("button", { name: "Approve Spring" });
    fake.online.value = false;
    await waitFor(() =>
      expect(screen.getByRole("button", { name: "Approve Spring" }).hasAttribute("disabled")).toBe(true),
    );
  });
});

describe("a comparison", () => {
  const shift = (name: string, sigmas: number | null) => ({
    name,
    unit: "N",
    a: 1,
    a_std: 0.1,
    b: 2,
    b_std: 0.1,
    sigmas,
  });

  it("shows what moved most first, and what only one has last", () => {
    const shifts = [shift("small", 0.5), shift("alone", null), shift("large", -7)];
    expect(sorted(shifts).map((one) => one.name)).toEqual(["large", "small", "alone"]);
  });

  it("is read from its address", async () => {
    const fake = service("viewer");
    fake.resources["/calibrations/compare?a=cal-3&b=cal-2"] = {
      a: OLD,
      b: IN_USE,
      parameters: [shift("joint1.f_c", -7)],
      errors: { joint1: { unit: "N m", a: 2, b: 1 } },
    };
    go("#/calibrations/compare/cal-3/cal-2");
    fake.show(<CalibrationsView />);
    await screen.findByText("A: Autumn");
    expect(screen.getByText("−50 %")).toBeTruthy();
    expect(screen.getByText(/One parameter differs by more than three/)).toBeTruthy();
  });
});
