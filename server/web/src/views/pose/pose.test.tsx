// @vitest-environment happy-dom
import { cleanup, screen } from "@testing-library/preact";
import { afterEach, describe, expect, it } from "vitest";
import { FakeService } from "../fakes";
import { Drawing, grid } from ".";
import { type Arm, dot, type Joint, pose, type Vector } from "./kinematics";
import cases from "./poses.fixture.json";
import { between, positions } from "./positions";
import { projected, reach, upwards, view } from "./projection";

afterEach(cleanup);

const close = (found: Vector, wanted: (number | undefined)[]): void =>
  found.forEach((one, index) => expect(one).toBeCloseTo(wanted[index] as number, 12));

describe("the pose of an arm", () => {
  it.each(cases.map((one) => [one.arm.joints.length, one.arm.convention, one] as const))(
    "of %i joints, %s convention, is that of the identification",
    (_joints, _convention, { arm, q, frames }) => {
      const found = pose(arm as unknown as Arm, q);
      expect(found.frames.length).toBe(frames.length);
      found.frames.forEach((frame, index) => {
        const wanted = frames[index] as number[][];
        const column = (at: number): (number | undefined)[] => [0, 1, 2].map((row) => wanted[row]?.[at]);
        close(frame.x, column(0));
        close(frame.y, column(1));
        close(frame.z, column(2));
        close(frame.origin, column(3));
      });
      found.links.forEach((link, index) => {
        close(link[0] as Vector, found.frames[index]?.origin ?? []);
        close(link[2] as Vector, found.frames[index + 1]?.origin ?? []);
      });
    },
  );

  it("never leaves its reach", () => {
    for (const { arm, frames } of cases) {
      const size = reach(arm as unknown as Arm);
      for (const frame of frames) expect(Math.hypot(...frame.slice(0, 3).map((row) => row[3] ?? 0))).toBeLessThan(size);
    }
  });
});

const folding = cases[0]?.arm as unknown as Arm;

describe("how it is looked at", () => {
  it("from the side shows the plane in which it moves, gravity downwards", () => {
    const seen = view(folding, 0, 0);
    close(upwards(folding), [0, 1, 0]);
    expect(Math.abs(seen.towards[2])).toBeCloseTo(1, 12); // its axes are those of z
    expect(projected([0, 1, 0], seen)[1]).toBeCloseTo(1, 12);
    expect(projected([0, 1, 0], seen)[0]).toBeCloseTo(0, 12);
  });

  it("keeps lengths in the plane of the drawing, whatever the direction", () => {
    for (const [azimuth, elevation] of [
      [0.3, 0.2],
      [2, -1],
      [-1, Math.PI / 2],
    ] as const) {
      const { right, up, towards } = view(folding, azimuth, elevation);
      for (const one of [right, up, towards]) expect(Math.hypot(...one)).toBeCloseTo(1, 12);
      expect(dot(right, up)).toBeCloseTo(0, 12);
      expect(dot(right, towards)).toBeCloseTo(0, 12);
      expect(dot(up, towards)).toBeCloseTo(0, 12);
    }
  });

  it("has a grid of round numbers", () => {
    expect(grid(4)).toBeCloseTo(1);
    expect(grid(3.5)).toBeCloseTo(0.5);
    expect(grid(0.09)).toBeCloseTo(0.02);
  });
});

describe("joint positions", () => {
  const joint = (name: string): Joint => ({
    name,
    type: "revolute",
    dh: { a: 1, alpha: 0, d: 0, theta: 0 },
    limits: { position: [-1, 1] },
  });
  const channel = (name: string, unit: string) => ({
    name: `${name}.angle`,
    quantity: "joint_position",
    joint: name,
    unit,
  });
  const reading = (name: string, unit: string, quality = "fresh") => ({
    name: `${name}.angle`,
    unit,
    value: 90,
    quality,
    age: 0,
  });

  it("are in rad, and none where nothing is measured now", () => {
    const joints = ["a", "b", "c", "d"].map(joint);
    const channels = [channel("a", "deg"), channel("b", "deg"), channel("c", "turns")];
    const readings = new Map(
      [reading("a", "deg"), reading("b", "deg", "stale"), reading("c", "turns")].map((one) => [one.name, one]),
    );
    const found = positions(joints, channels, readings, 0);
    expect(found.map((one) => one.q)).toEqual([Math.PI / 2, null, null, null]);
    expect(found[2]?.quality.text).toContain("turns");
    expect(found[3]?.quality.text).toBe("no channel measures it");
    expect(positions(joints, channels, readings, 3)[0]?.q).toBeNull();
  });

  it("are shown within their limits", () => {
    expect(between(joint("a"), 0.5)).toBeCloseTo(0.75);
    expect(between(joint("a"), 1.5)).toBeGreaterThan(1);
  });

  it("that are not measured are drawn otherwise, and said", () => {
    const found = folding.joints.map((_, index) => ({
      q: index === 1 ? null : 0.1,
      reading: null,
      quality: { kind: "good" as const, text: "fresh" },
    }));
    const { container } = new FakeService("viewer").show(<Drawing arm={folding} found={found} />);
    expect(container.querySelectorAll(".link").length).toBe(6);
    expect(container.querySelectorAll(".link.unknown").length).toBe(1);
    expect(screen.getByRole("img").getAttribute("aria-label")).toContain("joint2 not measured");
  });
});
