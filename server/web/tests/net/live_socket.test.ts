import { describe, expect, it } from "vitest";
import { CONNECT_MS, LiveSocket, SILENCE_MS } from "../../src/net/live_socket";
import { FakeSocket, FakeTimers } from "./fakes";

const snapshot = (seq: number) => ({ type: "snapshot", seq, time: 1, channels: {} });
const frames = (seq: number) => ({ type: "frames", seq, channels: [], samples: [], quality: [] });

function made() {
  const timers = new FakeTimers();
  const sockets: FakeSocket[] = [];
  const states: string[] = [];
  const reasons: string[] = [];
  const messages: number[] = [];
  const live = new LiveSocket(
    () => {
      const socket = new FakeSocket();
      sockets.push(socket);
      return socket;
    },
    {
      message: (message) => messages.push(message.seq),
      state: (state, reason) => (states.push(state), reasons.push(reason)),
    },
    timers,
  );
  live.start();
  return { timers, sockets, states, reasons, messages, live, last: () => sockets[sockets.length - 1] as FakeSocket };
}

describe("the live socket", () => {
  it("is live with the snapshot, and passes on what follows it without a hole", () => {
    const { last, states, messages } = made();
    last().open();
    last().say(snapshot(7));
    last().say(frames(8));
    last().say({ type: "heartbeat", seq: 9 });
    expect(states).toEqual(["connecting", "live"]);
    expect(messages).toEqual([7, 8, 9]);
  });

  it("connects again after a hole, and drops what the old socket still says", () => {
    const { last, sockets, timers, messages, reasons } = made();
    last().say(snapshot(7));
    const old = last();
    old.say(frames(9));
    expect(reasons).toContain("messages 8 to 8 are missing");
    expect(old.closed).toBe(true);
    timers.pass(1000);
    expect(sockets).toHaveLength(2);
    old.say(frames(10));
    last().say(snapshot(20));
    expect(messages).toEqual([7, 20]);
  });

  it("waits for a snapshot before it takes frames", () => {
    const { last, messages, sockets } = made();
    last().say(frames(3));
    expect(messages).toEqual([]);
    expect(sockets).toHaveLength(1);
  });

  it("gives up a socket that says it is open and says nothing more", () => {
    const { last, timers, states, sockets } = made();
    last().open();
    last().say(snapshot(1));
    timers.pass(SILENCE_MS - 1);
    expect(states[states.length - 1]).toBe("live");
    timers.pass(1);
    expect(states[states.length - 1]).toBe("lost");
    timers.pass(1000);
    expect(sockets).toHaveLength(2);
  });

  it("gives up a socket that never opens", () => {
    const { timers, states } = made();
    timers.pass(CONNECT_MS);
    expect(states).toEqual(["connecting", "lost"]);
  });

  it("waits longer after each failure, spread between half and whole, never beyond eight seconds", () => {
    const { last, timers } = made();
    const pauses: number[] = [];
    for (let attempt = 0; attempt < 7; attempt += 1) {
      timers.chance = attempt % 2;
      last().onclose?.({ code: 1006, reason: "" });
      pauses.push(timers.next() as number);
      timers.pass(pauses[attempt] as number);
    }
    expect(pauses).toEqual([250, 1000, 1000, 4000, 4000, 8000, 4000]);
  });

  it("begins with short pauses again once it was live", () => {
    const { last, timers } = made();
    for (let attempt = 0; attempt < 4; attempt += 1) {
      last().onclose?.({ code: 1006, reason: "" });
      timers.pass(8000);
    }
    last().say(snapshot(1));
    timers.chance = 1;
    last().onclose?.({ code: 1001, reason: "" });
    expect(timers.next()).toBe(500);
  });

  it("connects at once when the device woke, and is not disturbed by the dead socket's end", () => {
    const { live, last, sockets, states } = made();
    last().say(snapshot(1));
    const dead = last();
    live.renew("slept");
    expect(sockets).toHaveLength(2);
    dead.onclose?.({ code: 1006, reason: "" });
    expect(states).toEqual(["connecting", "live", "lost", "connecting"]);
  });

  it("lets a connection that is being made go on when the device woke", () => {
    const { live, sockets } = made();
    live.renew("slept");
    expect(sockets).toHaveLength(1);
  });

  it("closes a socket that it gave up while it connected once that is open", () => {
    const { live, last } = made();
    live.stop();
    expect(last().closed).toBe(false);
    last().open();
    expect(last().closed).toBe(true);
  });

  it("treats what it cannot read as a lost connection", () => {
    const { last, states } = made();
    last().say(snapshot(1));
    last().say("{");
    expect(states[states.length - 1]).toBe("lost");
  });

  it("does nothing any more once it was stopped", () => {
    const { live, sockets, timers, states } = made();
    live.stop();
    timers.pass(60_000);
    expect(sockets).toHaveLength(1);
    expect(states[states.length - 1]).toBe("stopped");
  });
});
