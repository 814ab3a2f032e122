import { describe, expect, it } from "vitest";
import { EventParser, EventStream } from "../../src/net/event_stream";
import { FakeTimers, settle } from "./fakes";

/** A stream that a test feeds; it ends as a fetch does when it is aborted. */
class Feed {
  private control!: ReadableStreamDefaultController<Uint8Array>;
  readonly response: Response;
  readonly headers: Record<string, string>;

  constructor(init: RequestInit) {
    this.headers = init.headers as Record<string, string>;
    const body = new ReadableStream<Uint8Array>({ start: (control) => void (this.control = control) });
    this.response = new Response(body, { status: 200 });
    init.signal?.addEventListener("abort", () => this.control.error(new Error("aborted")));
  }
  say(text: string): void {
    this.control.enqueue(new TextEncoder().encode(text));
  }
  end(): void {
    this.control.close();
  }
}

function made(refuse?: number) {
  const timers = new FakeTimers();
  const feeds: Feed[] = [];
  const events: string[] = [];
  const states: string[] = [];
  const stream = new EventStream(
    "/events",
    () => ({ Authorization: "Bearer t" }),
    { event: (event) => events.push(event.data), state: (state) => states.push(state), finished: () => false },
    timers,
    25_000,
    (_input, init) => {
      if (refuse !== undefined) return Promise.resolve(new Response("{}", { status: refuse }));
      const feed = new Feed(init);
      feeds.push(feed);
      return Promise.resolve(feed.response);
    },
  );
  stream.start();
  return { timers, feeds, events, states, stream, last: () => feeds[feeds.length - 1] as Feed };
}

describe("the parser", () => {
  it("puts together what comes in pieces, whatever the line ends", () => {
    const parser = new EventParser();
    expect(parser.push("id: 4\r\nevent: progress\r\nda")).toEqual([]);
    expect(parser.push("ta: a\r\ndata: b\r\n\r\n: alive\n\ndata:c\n\n")).toEqual([
      { id: "4", data: "a\nb" },
      { id: null, data: "c" },
    ]);
  });
});

describe("the event stream", () => {
  it("passes events on", async () => {
    const { last, events, states } = made();
    await settle();
    last().say("data: 1\n\ndata: 2\n\n");
    await settle();
    expect(events).toEqual(["1", "2"]);
    expect(states).toEqual(["up"]);
  });

  it("comes back after the server ended it, and says where it was", async () => {
    const { last, feeds, timers, states } = made();
    await settle();
    last().say("id: 12\ndata: x\n\n");
    await settle();
    last().end();
    await settle();
    expect(states).toEqual(["up", "lost"]);
    timers.pass(1000);
    await settle();
    expect(feeds).toHaveLength(2);
    expect(last().headers["Last-Event-ID"]).toBe("12");
    expect(states).toEqual(["up", "lost", "up"]);
  });

  it("takes silence for a dead connection; a comment is a sign of life", async () => {
    const { last, timers, states, feeds } = made();
    await settle();
    timers.pass(24_000);
    last().say(": alive\n\n");
    await settle();
    timers.pass(24_000);
    expect(states).toEqual(["up"]);
    timers.pass(1_000);
    await settle();
    expect(states).toEqual(["up", "lost"]);
    timers.pass(1_000);
    await settle();
    expect(feeds).toHaveLength(2);
  });

  it("waits longer while what it brings is of no use, and not so once it is", async () => {
    const { timers, stream, last } = made();
    const pauses: (number | null)[] = [];
    for (let attempt = 0; attempt < 3; attempt += 1) {
      await settle();
      stream.fail();
      await settle();
      pauses.push(timers.next());
      timers.pass(timers.next() as number);
    }
    expect(pauses).toEqual([375, 750, 1500]);
    await settle();
    stream.settled();
    last().end();
    await settle();
    expect(timers.next()).toBe(375);
  });

  it("opens another at once when the device woke", async () => {
    const { stream, feeds, states } = made();
    await settle();
    stream.renew();
    await settle();
    expect(feeds).toHaveLength(2);
    expect(states).toEqual(["up", "up"]);
  });

  it.each([401, 403, 404])("does not ask again where it may not (%i)", async (status) => {
    const { states, timers } = made(status);
    await settle();
    expect(states).toEqual(["absent"]);
    expect(timers.next()).toBeNull();
  });

  it("asks again after an error of the service", async () => {
    const { states, timers } = made(503);
    await settle();
    expect(states).toEqual(["lost"]);
    expect(timers.next()).toBe(375);
  });
});
