import { describe, expect, it } from "vitest";
import { asked, faultWords, grouped, leftOf, type Offer, targetWords } from "./faults";

const DEATH: Offer = {
  fault: "node_death",
  target: "node 31 on can",
  entry: { fault: "node_death", bus: "can", node: 31 },
};

describe("faults", () => {
  it("say what they are of in the language of the page, with the channels behind it", () => {
    expect(targetWords({ ...DEATH, target: "node 31 on can (joint1.head_pressure, …)" })).toBe(
      "node 31 on can (joint1.head_pressure, …)",
    );
    const unit = { fault: "drop", target: "unit 4 on modbus", entry: { fault: "drop", bus: "modbus", unit: 4 } };
    expect(targetWords(unit)).toBe("unit 4 on modbus");
    expect(targetWords({ fault: "nan", target: "oil", entry: { fault: "nan", channel: "oil" } })).toBe("oil");
    expect(targetWords({ fault: "bus_off", target: "can", entry: { fault: "bus_off", bus: "can" } })).toBe("can");
  });

  it("keep the order of the offers", () => {
    const other = { ...DEATH, target: "unit 4 on modbus" };
    const found = grouped([DEATH, { ...DEATH, fault: "drop" }, other]);
    expect([...found.keys()]).toEqual(["node_death", "drop"]);
    expect(found.get("node_death")).toEqual([DEATH, other]);
  });

  it("are ordered from now on for as long as somebody wrote", () => {
    expect(asked(DEATH, " 2,5 ", 600)).toEqual({ fault: "node_death", bus: "can", node: 31, at: 0, for: 2.5 });
  });

  it.each(["", "x", "0", "-1", "601", "Infinity"])("are not ordered for %j seconds", (text) => {
    expect(asked(DEATH, text, 600)).toBeNull();
  });

  it("say what lasts, where, and for how long", () => {
    expect(leftOf({ fault: "node_death", bus: "can", node: 31, left_s: 1.2 })).toBe(
      "A device falls silent (node 31 on can), 2 s more",
    );
    expect(leftOf({ fault: "nan", channel: "joint1.head_pressure", left_s: 3 })).toContain("(joint1.head_pressure)");
    expect(leftOf({ fault: "half_open", bus: "modbus", left_s: 3 })).toContain("(modbus)");
    expect(leftOf({ fault: "drop", bus: "modbus", unit: 4, left_s: 3 })).toContain("(unit 4 on modbus)");
  });

  it("keep the name of one that has no words yet", () => {
    expect(faultWords("rust")).toBe("rust");
  });
});
