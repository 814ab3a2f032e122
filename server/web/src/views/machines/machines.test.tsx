// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { go } from "../../routes";
import { FakeService, done, refused } from "../fakes";
import MachinesView from ".";

const FIRST = "name: arm\nrate_hz: 50\n";
const MINE = "name: arm\nrate_hz: 100\n";
const THEIRS = "name: arm\nrate_hz: 50\n# theirs\n";

beforeEach(() => localStorage.clear());
afterEach(cleanup);

function service(role: "viewer" | "engineer"): FakeService {
  const fake = new FakeService(role);
  version(fake, 1, FIRST);
  go("#/machines/arm");
  return fake;
}

function version(fake: FakeService, current: number, text: string): void {
  const versions = Array.from({ length: current }, (_, at) => current - at);
  const created = "2026-03-01T08:00:00Z";
  fake.resources["/machines/arm"] = {
    name: "arm",
    version: current,
    current,
    created,
    acquire: false,
    versions,
    machine: {},
    acquisition: { state: "off" },
    sha256: "",
  };
  fake.resources[`/machines/arm/file?version=${current}`] = text;
}

const editor = async (): Promise<HTMLTextAreaElement> =>
  (await screen.findByLabelText("Machine file of arm")) as HTMLTextAreaElement;
const type = (area: HTMLTextAreaElement, value: string) => fireEvent.input(area, { target: { value } });

describe("the editor", () => {
  it("saves a new version against the one that was read", async () => {
    const fake = service("engineer");
    fake.answers["POST /machines"] = done({ name: "arm", version: 2 });
    fake.show(<MachinesView />);
    const area = await editor();
    expect(area.value).toBe(FIRST);
    expect(screen.getByRole("button", { name: "Save as version 2" }).hasAttribute("disabled")).toBe(true);
    type(area, MINE);
    version(fake, 2, MINE);
    fireEvent.click(screen.getByRole("button", { name: "Save as version 2" }));
    await screen.findByText("Saved as version 2.");
    expect(fake.sent).toEqual([{ method: "POST", path: "/machines", text: MINE, etag: '"1"' }]);
    expect((await editor()).value).toBe(MINE);
    await waitFor(() => expect(screen.getByText(/From version|Version 1/)).toBeTruthy());
    expect(screen.queryByText(/Not saved yet/)).toBeNull();
  });

  it("marks the line that the service refuses, and keeps what was typed", async () => {
    const fake = service("engineer");
    fake.answers["POST /machines/check"] = refused(422, "machine.yaml:2: rate_hz: should be a number; write it in Hz");
    fake.show(<MachinesView />);
    const area = await editor();
    type(area, "name: arm\nrate_hz: often\n");
    fireEvent.click(screen.getByRole("button", { name: "Check" }));
    await screen.findByText("Line 2:");
    expect(screen.getByText(/rate_hz: should be a number/)).toBeTruthy();
    expect(area.getAttribute("aria-invalid")).toBe("true");
    await waitFor(() => expect(area.value.slice(area.selectionStart, area.selectionEnd)).toBe("rate_hz: often"));
    expect(fake.sent.map((one) => one.path)).toEqual(["/machines/check"]);
  });

  it("keeps what was typed over a reload of the page", async () => {
    const fake = service("engineer");
    const shown = fake.show(<MachinesView />);
    type(await editor(), MINE);
    shown.unmount();
    fake.show(<MachinesView />);
    expect((await editor()).value).toBe(MINE);
    expect(screen.getByText(/Not saved yet/)).toBeTruthy();
  });

  it("shows both where somebody else was faster, and loses neither", async () => {
    const fake = service("engineer");
    fake.answers["POST /machines"] = refused(412, "machine 'arm' has version 2 by now, not 1");
    fake.show(<MachinesView />);
    const area = await editor();
    type(area, MINE);
    version(fake, 2, THEIRS);
    fireEvent.click(screen.getByRole("button", { name: "Save as version 2" }));
    await screen.findByText(/Somebody saved version 2 while you were changing version 1/);
    expect(area.value).toBe(MINE);
    const between = screen.getByRole("region", { name: "Version 2 against yours" });
    expect(between.textContent).toContain("# theirs");
    expect(between.textContent).toContain("rate_hz: 100");
    fake.answers["POST /machines"] = done({ name: "arm", version: 3 });
    fireEvent.click(screen.getByRole("button", { name: "Save mine over version 2" }));
    await screen.findByText("Saved as version 3.");
    expect(fake.sent.map((one) => one.etag)).toEqual(['"1"', '"2"']);
  });

  it("follows the service while nothing was typed", async () => {
    const fake = service("engineer");
    fake.show(<MachinesView />);
    await editor();
    version(fake, 2, THEIRS);
    fake.moved("machines");
    await waitFor(async () => expect((await editor()).value).toBe(THEIRS));
    expect(screen.queryByText(/Somebody saved/)).toBeNull();
  });

  it("asks before it drops what was typed", async () => {
    service("engineer").show(<MachinesView />);
    const area = await editor();
    type(area, MINE);
    fireEvent.click(screen.getByRole("button", { name: "Discard changes" }));
    fireEvent.click(within(screen.getByRole("dialog")).getByRole("button", { name: "No, go back" }));
    expect(area.value).toBe(MINE);
    fireEvent.click(screen.getByRole("button", { name: "Discard changes" }));
    fireEvent.click(screen.getByRole("button", { name: "Drop them" }));
    await waitFor(() => expect(area.value).toBe(FIRST));
    expect(localStorage.length).toBe(0);
  });

  it("is only read by a viewer", async () => {
    service("viewer").show(<MachinesView />);
    const area = await editor();
    expect(area.readOnly).toBe(true);
    expect(screen.queryByRole("button", { name: /Save|Check|Drop/ })).toBeNull();
    expect(screen.getByText(/an engineer can change it/)).toBeTruthy();
  });
});

describe("machines", () => {
  const list = (fake: FakeService, acquire: boolean): void => {
    const one = { name: "arm", version: 1, current: 1, sha256: "", created: "2026-03-01T08:00:00Z", acquire };
    fake.resources["/machines?limit=500"] = { items: [one], next: null };
    fake.resources["/status"] = { acquisition: { arm: { state: "running" } }, jobs: {}, revisions: {} };
    go("#/machines");
  };

  it("stop being acquired after a question only", async () => {
    const fake = new FakeService("engineer");
    list(fake, true);
    fake.answers["PUT /machines/arm/acquisition"] = done({});
    fake.show(<MachinesView />);
    fireEvent.click(await screen.findByRole("button", { name: "Stop acquiring arm" }));
    expect(fake.sent).toEqual([]);
    fireEvent.click(within(screen.getByRole("dialog")).getByRole("button", { name: "Stop acquiring" }));
    await waitFor(() => expect(fake.sent.map((one) => one.json)).toEqual([{ enabled: false }]));
  });

  it("are made from a file, never over one that is there", async () => {
    const fake = new FakeService("engineer");
    go("#/machines?new=1");
    fake.answers["POST /machines"] = refused(412, "machine 'arm' has version 3 by now, not 0");
    fake.show(<MachinesView />);
    const area = screen.getByRole("textbox", { name: "Machine file" });
    fireEvent.input(area, { target: { value: FIRST } });
    fireEvent.click(screen.getByRole("button", { name: "Make the machine" }));
    await screen.findByText(/There is a machine of this name already/);
    expect(fake.sent[0]?.etag).toBe('"0"');
    fake.answers["POST /machines"] = done({ name: "arm", version: 1 });
    fireEvent.click(screen.getByRole("button", { name: "Make the machine" }));
    await waitFor(() => expect(location.hash).toBe("#/machines/arm"));
  });
});
