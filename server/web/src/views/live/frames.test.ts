import { describe, expect, it } from "vitest";
import { FrameCounter } from "./frames";

/** Frames at a rate, with those left out whose numbers are in `without`. */
function counted(rate: number, seconds: number, without: (number: number) => boolean): FrameCounter {
  const counter = new FrameCounter();
  for (let number = 0; number < rate * seconds; number += 1)
    if (!without(number)) counter.frame((1000 * number) / rate + (number % 3) * 0.4); // a screen is not quite regular
  return counter;
}

describe("frames that were dropped", () => {
  it("are none on a device that keeps up, whatever its rate", () => {
    for (const rate of [60, 90, 120]) expect(counted(rate, 5, () => false).smoothness(5000).dropped).toBe(0);
  });

  it("are counted each", () => {
    const counter = counted(60, 5, (number) => [50, 100, 101, 102].includes(number));
    const { dropped, frames, longest, seconds } = counter.smoothness(5000);
    expect(dropped).toBe(4);
    expect(frames).toBe(300 - 4 - 1);
    expect(longest).toBeCloseTo(4000 / 60, 0);
    expect(seconds).toBeCloseTo(5, 1);
  });

  it("are every second one at half the rate: the usual pace is no excuse", () => {
    const { dropped, frames } = counted(30, 5, () => false).smoothness(5000);
    expect(dropped).toBe(frames);
  });

  it("are of the last ten seconds", () => {
    const counter = counted(60, 30, (number) => number < 600 && number % 2 === 1);
    expect(counter.smoothness(30_000).dropped).toBe(0);
    expect(counter.smoothness(30_000).seconds).toBeCloseTo(10, 0);
  });
});
