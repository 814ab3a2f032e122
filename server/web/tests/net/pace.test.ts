import { expect, it } from "vitest";
import { paced, SHORTEST_MS, sliced } from "../../src/views/live/pace";
import { FakeTimers } from "./fakes";

function made(cost: number) {
  const timers = new FakeTimers();
  const drawn: number[] = [];
  const clock = {
    now: () => timers.now(),
    after: (ms: number, work: () => void) => void timers.after(ms, work),
    drawn: (work: () => void) => void timers.after(cost, work),
  };
  return { timers, drawn, news: paced(() => drawn.push(timers.now()), clock) };
}

it("draws a backlog once, and what follows at a pace that can be read", () => {
  const { timers, drawn, news } = made(10);
  for (let message = 0; message < 100; message += 1) news();
  timers.pass(50);
  expect(drawn).toEqual([0]);
  for (let message = 0; message < 3.3 * (SHORTEST_MS / 10); message += 1) {
    news();
    timers.pass(10);
  }
  expect(drawn).toEqual([0, SHORTEST_MS, 2 * SHORTEST_MS, 3 * SHORTEST_MS]);
});

it("leaves a slow device most of its time", () => {
  const { timers, drawn, news } = made(300);
  for (let message = 0; message < 59; message += 1) {
    news();
    timers.pass(50);
  }
  expect(drawn).toEqual([0, 1000, 2000]);
});

/** Parts that each take `cost` ms to draw, on a screen with a frame each 16 ms. */
function parts(cost: number, count: number, shortest = 33, idle: number[] = []) {
  const timers = new FakeTimers();
  let busy = 0;
  const now = (): number => timers.now() + busy;
  const drawn: [number, number][] = [];
  const frame = (work: () => void): void => {
    const spent = busy;
    busy = 0;
    timers.after(Math.max(16, spent), work);
  };
  const clock = { now, after: (ms: number, work: () => void) => void timers.after(ms, work), drawn: frame };
  const pieces = Array.from({ length: count }, (_, number) => () => {
    if (idle.includes(number)) return false;
    drawn.push([number, timers.now()]);
    busy += cost;
    return true;
  });
  return {
    timers,
    drawn,
    news: sliced(
      () => [...pieces],
      clock,
      () => shortest,
    ),
  };
}

it("draws one part in each frame, each part once", () => {
  const { timers, drawn, news } = parts(1, 4);
  news();
  news();
  timers.pass(200);
  expect(drawn).toEqual([
    [0, 0],
    [1, 16],
    [2, 32],
    [3, 48],
  ]);
});

it("passes over a part that has nothing to draw in the same frame", () => {
  const { timers, drawn, news } = parts(1, 4, 33, [1, 2]);
  news();
  timers.pass(200);
  expect(drawn).toEqual([
    [0, 0],
    [3, 16],
  ]);
});

it("draws no part again before what moved can be seen", () => {
  const { timers, drawn, news } = parts(1, 2, 100);
  for (let frame = 0; frame < 20; frame += 1) {
    news();
    timers.pass(16);
  }
  expect(drawn.filter(([number]) => number === 0).map(([, time]) => time)).toEqual([0, 100, 200, 300]);
});

it("counts what a device needs to show a part, which is seen only in how late its next frame is", () => {
  const timers = new FakeTimers();
  const drawn: number[] = [];
  const clock = {
    now: () => timers.now(),
    after: (ms: number, work: () => void) => void timers.after(ms, work),
    drawn: (work: () => void) => void timers.after(1000 / 60 + 30, work), // drawn in no time, shown 30 ms late
  };
  const news = sliced(
    () => [() => drawn.push(timers.now())],
    clock,
    () => 33,
  );
  for (let frame = 0; frame < 40; frame += 1) {
    news();
    timers.pass(10);
  }
  expect(drawn.map(Math.round)).toEqual([0, 100, 200, 300]); // 30 of 100 ms
});

it("leaves a slow device most of its time between drawings of several parts, too", () => {
  const { timers, drawn, news } = parts(30, 4);
  for (let frame = 0; frame < 100; frame += 1) {
    news();
    timers.pass(16);
  }
  const first = drawn.filter(([number]) => number === 0).map(([, time]) => time);
  expect(first.length).toBeGreaterThan(2);
  for (let number = 1; number < first.length; number += 1)
    expect((first[number] as number) - (first[number - 1] as number)).toBeGreaterThanOrEqual(380); // 120 of 400 ms
});
