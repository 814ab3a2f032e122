import { describe, expect, it } from "vitest";
import { likelyQuantity } from "./channel_lines";

const OFFERED = [
  "joint_position",
  "head_pressure",
  "rod_pressure",
  "piston_position",
  "joint_effort",
  "oil_temperature",
];

describe("the quantity that is offered first", () => {
  it("is one that has the signal's unit", () => {
    const pairs = { deg: "joint_position", bar: "head_pressure", MPa: "head_pressure", mm: "piston_position" };
    for (const [unit, quantity] of Object.entries({ ...pairs, "N m": "joint_effort", "°C": "oil_temperature" })) {
      expect(likelyQuantity(unit, OFFERED), unit).toBe(quantity);
    }
  });

  it("is the first where the unit says nothing, or the machine has none of that kind", () => {
    expect(likelyQuantity("rpm", OFFERED)).toBe("joint_position");
    expect(likelyQuantity("kN", OFFERED)).toBe("joint_position");
    expect(likelyQuantity("bar", [])).toBe("");
  });
});
