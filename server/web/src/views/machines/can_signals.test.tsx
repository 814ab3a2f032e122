// @vitest-environment happy-dom
import { cleanup, fireEvent, screen, within } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { FakeService, done, refused } from "../fakes";
import { channelLine, channelName, inserted } from "./channel_lines";
import MachinesView from ".";

type Signal = components["schemas"]["CanSignal"];
type List = components["schemas"]["CanSignalList"];

beforeEach(() => localStorage.clear());
afterEach(cleanup);

const FILE = `name: arm # the crane in hall 2
channels:
# angles first
- {name: boom.angle, unit: deg}   # new sensor
- name: boom.head
  unit: bar

# buses below
buses:
- {name: plain, type: can_signals}
`;
const signal = (given: Partial<Signal> = {}): Signal => ({
  bus: "plain",
  file: "mobile.dbc",
  message: "Boom",
  signal: "Angle",
  frame_id: 0x123,
  extended: false,
  pgn: null,
  message_bytes: 8,
  start_bit: 7,
  bits: 16,
  byte_order: "big",
  signed: true,
  is_float: false,
  factor: 0.01,
  offset: 0,
  unit: "deg",
  minimum: -180,
  maximum: 180,
  selects: false,
  multiplexer: null,
  multiplexer_values: [],
  cycle_ms: null,
  channels: ["boom.angle"],
  source: { bus: "plain", message: "Boom", signal: "Angle" },
  refusal: null,
  ...given,
});
const OIL = signal({
  message: "Temperatures",
  signal: "OilTemperature",
  frame_id: 0x18feeefe,
  extended: true,
  pgn: 0xfeee,
  byte_order: "little",
  factor: 0.03125,
  offset: -273,
  unit: "degC",
  channels: [],
  source: { bus: "plain", pgn: 0xfeee, signal: "OilTemperature" },
});
const TANK = signal({
  signal: "Tank",
  multiplexer: "Page",
  multiplexer_values: [1],
  channels: [],
  source: null,
  refusal: "message 'Boom' has 20 bytes",
});
const list = (items: Signal[], found = items.length): List => ({
  machine: "arm",
  version: 1,
  buses: [
    {
      name: "plain",
      files: [
        { name: "mobile.dbc", sha256: "abc", messages: 2, signals: 3, error: null },
        { name: "gone.dbc", sha256: null, messages: 0, signals: 0, error: "bus 'plain': gone.dbc: no such file" },
      ],
      problems: ["tank: there is no signal 'Tonk'"],
      messages: {},
      left_out: 0,
    },
  ],
  found,
  items,
  quantities: [
    { name: "joint_position", of_a_joint: true },
    { name: "oil_temperature", of_a_joint: false },
  ],
});
const PATH = "/can-signals?machine=arm&bus=plain";

function service(role: "viewer" | "engineer"): FakeService {
  const fake = new FakeService(role);
  fake.resources["/machines/arm"] = {
    name: "arm",
    version: 1,
    current: 1,
    created: "2026-03-01T08:00:00Z",
    acquire: false,
    versions: [1],
    machine: {
      joints: [{ name: "boom" }],
      buses: [
        { name: "plain", type: "can_signals" },
        { name: "can", type: "canopen" },
      ],
    },
    acquisition: { state: "off" },
    sha256: "",
  };
  fake.resources["/machines/arm/file?version=1"] = FILE;
  fake.resources[PATH] = list([signal(), OIL, TANK], 240);
  go("#/machines/arm");
  return fake;
}

const table = async (): Promise<HTMLElement[]> =>
  within(await screen.findByRole("table", { name: "Signals of plain" })).getAllByRole("row");

describe("CAN signals", () => {
  it("shows what files describe, and which channel uses what", async () => {
    service("viewer").show(<MachinesView />);
    const [, angle, oil, tank] = await table();
    for (const words of ["Angle", "Boom", "0x123", "7, 16 bit, big-endian", "0.01 · raw deg", "boom.angle"])
      expect(angle?.textContent).toContain(words);
    for (const words of ["0x18FEEEFE, PGN 0xFEEE", "little-endian", "0.03125 · raw − 273 degC"])
      expect(oil?.textContent).toContain(words);
    for (const words of ["where Page = 1", "message 'Boom' has 20 bytes"]) expect(tank?.textContent).toContain(words);
    expect(screen.getAllByRole("heading", { name: /CAN signals/ }).length).toBe(1); // of two buses
    screen.getByText("3 of 240 are shown; search for fewer.");
    screen.getByText("tank: there is no signal 'Tonk'");
    screen.getByText("bus 'plain': gone.dbc: no such file");
    screen.getByRole("button", { name: /Download mobile.dbc/ });
    expect(screen.queryByRole("button", { name: /Download gone.dbc/ })).toBeNull();
    expect(screen.queryByLabelText("Replace mobile.dbc")).toBeNull();
  });

  it("searches on the service", async () => {
    const fake = service("viewer");
    fake.resources[`${PATH}&search=oil%20deg`] = list([OIL]);
    fake.show(<MachinesView />);
    expect((await table()).length).toBe(4);
    fireEvent.input(screen.getByLabelText("Search signals of plain"), { target: { value: " oil deg " } });
    await screen.findByText((_, element) => element?.tagName === "TBODY" && element.children.length === 1);
    expect((await table())[1]?.textContent).toContain("OilTemperature");
  });

  it("puts a channel into the text of the editor, which stays as it was written", async () => {
    service("engineer").show(<MachinesView />);
    await screen.findByLabelText("Machine file of arm");
    fireEvent.click(await screen.findByRole("button", { name: "Make a channel of OilTemperature" }));
    fireEvent.change(screen.getByLabelText("Quantity"), { target: { value: "oil_temperature" } });
    fireEvent.input(screen.getByLabelText("Name of the channel"), { target: { value: "oil" } });
    fireEvent.click(screen.getByRole("button", { name: "Insert into the machine file" }));
    await screen.findByText("Line 7 of the machine file is new, and not saved yet.");
    const line =
      "- {name: oil, quantity: oil_temperature, unit: degC, source: {bus: plain, pgn: 0xFEEE, signal: OilTemperature}}";
    const area = screen.getByLabelText("Machine file of arm") as HTMLTextAreaElement;
    expect(area.value).toBe(FILE.replace("  unit: bar\n", `  unit: bar\n${line}\n`));
    screen.getByText("Not saved yet. This device keeps what you typed.");
  });

  it("replaces a file against the one that was read, once somebody said yes", async () => {
    const fake = service("engineer");
    const path = "/can-signals/upload?machine=arm&name=mobile.dbc";
    fake.answers[`POST ${path}`] = refused(422, "boom.angle: there is no signal 'Angle'");
    fake.show(<MachinesView />);
    const file = new File(["VERSION"], "new.dbc");
    const choose = async () => {
      fireEvent.change(await screen.findByLabelText("Replace mobile.dbc"), { target: { files: [file] } });
      const dialog = await screen.findByText("Replace mobile.dbc?");
      expect(dialog).toBeTruthy();
    };
    await choose();
    expect(fake.sent).toEqual([]);
    fireEvent.click(screen.getByRole("button", { name: "Replace" }));
    await screen.findByText("boom.angle: there is no signal 'Angle'");
    expect(fake.sent).toEqual([{ method: "POST", path, file, etag: '"abc"' }]);
    fake.answers[`POST ${path}`] = done({ name: "mobile.dbc", sha256: "def" });
    await choose();
    fireEvent.click(screen.getByRole("button", { name: "Replace" }));
    await screen.findByText("mobile.dbc is replaced.");
  });
});

describe("a line of a machine file", () => {
  it("quotes what YAML would take for something else", () => {
    const source = { bus: "plain", signal: "No" };
    expect(channelLine({ name: "a", quantity: "q", joint: "on", unit: "%", source })).toBe(
      '- {name: a, quantity: q, joint: "on", unit: "%", source: {bus: plain, signal: "No"}}',
    );
  });

  it("has a name that the service takes", () => {
    expect(channelName("Boom 1", "Öl")).toBe("boom_1._l");
    expect(channelName("1st", "X")).toBe("_1st.x");
  });

  it("goes where the list ends, as deep as its items", () => {
    expect(inserted("channels:\n  - a\n  # last\njoints: []\n", "- b")).toEqual({
      text: "channels:\n  - a\n  - b\n  # last\njoints: []\n",
      line: 3,
    });
    expect(inserted("channels:\r\n- a\r\n", "- b")).toEqual({ text: "channels:\r\n- a\r\n- b\r\n", line: 3 });
    expect(inserted("channels:\n- a", "- b")).toEqual({ text: "channels:\n- a\n- b", line: 3 });
    for (const text of ["name: a\n", "channels: [a]\n", "channels:\njoints:\n- a\n", "channels:\n  a: 1\n"])
      expect(inserted(text, "- b")).toBeNull();
  });
});
