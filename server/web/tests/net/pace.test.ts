import { expect, it } from "vitest";
import { paced, SHORTEST_MS } from "../../src/views/live/pace";
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
  for (let message = 0; message < 50; message += 1) {
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
