/** Which channels are drawn together, and the cylinder forces that follow from pressures. */
import type { Trace, Value } from "../../charts/trace";
import type { Reading } from "./history";
import { type PlainKey, t } from "../../texts";

export interface Spec {
  name: string;
  quantity: string;
  joint?: string | undefined;
  unit: string;
  range?: [number, number] | null;
}
export interface Cylinder {
  bore: number;
  rod: number;
}
export interface MachineContent {
  channels: Spec[];
  joints: { name: string; cylinder?: (Cylinder & { vented?: string | null }) | null }[];
}
/** A line of a strip: a channel, or the force that two pressures amount to. */
export interface Line {
  name: string;
  label: string;
  unit: string;
  decimals: number;
  sources: string[];
  /** Ends of what the machine file says that the channel can measure. */
  limits: { value: number; label: string }[];
  /** Per source whether the line falls when it rises. */
  falls: boolean[];
  value(values: (number | null)[]): number | null;
}
export interface Group {
  /** The key of its title, and its unit where two have it: what is kept of it on a device holds in every language. */
  key: string;
  title: string;
  unit: string;
  lines: Line[];
}

const TITLES: [PlainKey, string[]][] = [
  ["common.jointPositions", ["joint_position", "motor_position", "base_roll", "base_pitch"]],
  ["live.velocities", ["joint_velocity", "motor_velocity"]],
  ["live.pistonPositions", ["piston_position"]],
  ["live.pressuresHeadSide", ["head_pressure"]],
  ["live.pressuresRodSide", ["rod_pressure"]],
  ["live.pressuresAtPorts", ["head_port_pressure", "rod_port_pressure"]],
  ["live.supply", ["supply_pressure", "tank_pressure"]],
  ["live.commands", ["command"]],
  ["live.spools", ["spool_position"]],
  ["live.forcesTorquesMeasured", ["cylinder_force", "external_force", "joint_effort", "motor_effort"]],
  ["live.temperatures", ["oil_temperature"]],
];
const FORCES = "live.cylinderForcesFromPressures";
const DECIMALS: Record<string, number> = {
  rad: 3,
  "rad/s": 3,
  deg: 2,
  mm: 1,
  m: 4,
  bar: 1,
  MPa: 2,
  Pa: 0,
  kN: 2,
  N: 0,
  "N m": 1,
};
/** Pascal of one, for the units of pressure that a machine file is likely to use. */
const PASCAL: Record<string, number> = { Pa: 1, kPa: 1e3, MPa: 1e6, bar: 1e5, mbar: 1e2, psi: 6894.757 };

/** Channels by what they measure, in the order of the machine file; then the forces. */
export function groups(machine: MachineContent): Group[] {
  const found: Group[] = [];
  for (const [text, quantities] of TITLES) {
    const specs = machine.channels.filter((spec) => quantities.includes(spec.quantity));
    for (const unit of new Set(specs.map((spec) => spec.unit))) {
      const lines = specs.filter((spec) => spec.unit === unit).map(line);
      const suffix = lines.length === specs.length ? "" : ` (${unit})`;
      found.push({ key: text + suffix, title: t(text) + suffix, unit, lines });
    }
  }
  const forces = machine.joints.map((joint) => force(machine, joint)).filter((one): one is Line => one !== null);
  if (forces.length > 0) found.push({ key: FORCES, title: t(FORCES), unit: "kN", lines: forces });
  return found;
}

function line(spec: Spec): Line {
  const { name, unit, joint, range } = spec;
  return {
    name,
    label: joint ?? name,
    unit,
    decimals: DECIMALS[unit] ?? 2,
    sources: [name],
    limits: range ? range.map((value) => ({ value, label: t("live.endOfRange", { joint: joint ?? name }) })) : [],
    falls: [false],
    value: (values) => values[0] ?? null,
  };
}

/** Head pressure times piston area less rod pressure times annulus: positive pushes the rod out. A vented side is 0. */
function force(machine: MachineContent, joint: MachineContent["joints"][number]): Line | null {
  const cylinder = joint.cylinder;
  if (!cylinder) return null;
  const piston = (Math.PI / 4) * cylinder.bore ** 2;
  const annulus = (Math.PI / 4) * (cylinder.bore ** 2 - cylinder.rod ** 2);
  const sides: [string, number][] = [
    ["head", piston],
    ["rod", -annulus],
  ];
  const terms: { name: string; kilonewton: number }[] = [];
  for (const [side, area] of sides) {
    if (cylinder.vented === side) continue;
    const spec = machine.channels.find((one) => one.joint === joint.name && one.quantity === `${side}_pressure`);
    const pascal = spec === undefined ? undefined : PASCAL[spec.unit];
    if (spec === undefined || pascal === undefined) return null;
    terms.push({ name: spec.name, kilonewton: (area * pascal) / 1000 });
  }
  return {
    name: `${joint.name}.force`,
    label: joint.name,
    unit: "kN",
    decimals: 2,
    sources: terms.map((term) => term.name),
    limits: [],
    falls: terms.map((term) => term.kilonewton < 0),
    value: (values) => {
      let sum = 0;
      for (let index = 0; index < terms.length; index += 1) {
        const value = values[index];
        if (value === null || value === undefined) return null;
        sum += (terms[index] as { kilonewton: number }).kilonewton * value;
      }
      return sum;
    },
  };
}

const WORSE = [
  "fresh",
  "held",
  "late",
  "out_of_range",
  "stale",
  "frozen",
  "emergency",
  "invalid",
  "bus_error",
  "missing",
];

/** The reading of a line now: of what it is made of, the worst quality and the oldest age. */
export function reading(one: Line, readings: ReadonlyMap<string, Reading>): Reading {
  const parts = one.sources.map((name) => readings.get(name));
  const worst = parts.reduce<string>((quality, part) => {
    const other = part?.quality ?? "missing";
    return WORSE.indexOf(other) > WORSE.indexOf(quality) ? other : quality;
  }, "fresh");
  const ages = parts.map((part) => part?.age ?? null).filter((age): age is number => age !== null);
  return {
    name: one.name,
    unit: one.unit,
    value: one.value(parts.map((part) => part?.value ?? null)),
    quality: worst,
    age: ages.length === 0 ? null : Math.max(...ages),
  };
}

/**
 * The line over time. Where entries are the smallest and largest values of moments, the ends of a line of several
 * channels are what these allow: they may be further apart than what happened.
 */
export function column(one: Line, trace: Trace): Value[] {
  const sources = one.sources.map((name) => trace.columns.get(name));
  const rows = trace.t.length;
  if (sources.length === 1) return sources[0] ?? new Array<null>(rows).fill(null);
  const found: Value[] = new Array(rows);
  const values: Value[] = new Array(sources.length).fill(null);
  for (let row = 0; row < rows; row += 1) {
    const other = row % 2 === 0 ? row + 1 : row - 1;
    for (let index = 0; index < sources.length; index += 1)
      values[index] = sources[index]?.[trace.moment > 0 && one.falls[index] ? other : row] ?? null;
    found[row] = one.value(values);
  }
  return found;
}
