/** A report on two valves as the service gives it, small enough to read. */
const value = (at: number, std: number | null = 0.001) => ({
  value: at,
  std,
  ci95: std === null ? null : ([at - 2 * std, at + 2 * std] as [number, number]),
});

export const EXTEND = {
  moves: true,
  edge_at_2_percent: { ...value(0.056), command: 10.2, command_unit: "mA" },
  compensated: { value: 0.041, too_small_by: value(0.015) },
  law: { id: "meter_in", title: "an orifice that feeds the cylinder" },
  speed_at_largest: { value: 0.21 },
};
export const AXIS = {
  rows: { kept: 380, all: 400 },
  handed_out: "model",
  delay: {
    ...value(0.16, 0.002),
    profile: [
      [0, 0.4],
      [0.15, 0.03],
      [0.3, 0.2],
    ],
  },
  directions: { extend: EXTEND, retract: { moves: false } },
  pump_limit: { value: 1e-3 },
  errors: { role: "validate", before: 0.05, after: 0.031, handed_out: 0.031, linear: 0.6, arx: 0.2, static: 0.1 },
  effects: [
    {
      id: "piston_leak",
      title: "a leak past the piston",
      probability: 0.97,
      error_before: 0.05,
      error_after: 0.031,
      indistinguishable_from: ["port_leak"],
      look_at: "the piston's seal",
      experiment: "rest with the valve closed at a loaded pose: the head's pressure falls and the rod's rises",
    },
  ],
  checks: [
    {
      code: "unvisited",
      text: "commands that extend beyond 40 % of full were never recorded",
      cure: "record higher levels; the inverse is clipped there",
    },
  ],
  figures: {
    curve: { command: [-0.2, 0, 0.1, 0.2], speed: [0, 0, 0.05, 0.21], std: [0, 0, 0.01, 0.02] },
    time: [0, 0.1, 0.2],
    measured: [0, null, 0.05],
    predicted: [0, 0.02, 0.05],
  },
};
export const REPORT = { schema: "hilfit/valve/1", axes: { boom: AXIS }, warnings: ["stick: does not move"] };
