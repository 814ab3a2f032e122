/** A clock that a test moves, and sockets and answers that it gives. */
import type { SocketLike } from "../../src/net/live_socket";
import type { Timers } from "../../src/net/timers";

export class FakeTimers implements Timers {
  private time = 0;
  private waiting: { at: number; work: () => void }[] = [];
  /** What `random` gives, 0 to 1. */
  chance = 0.5;

  now(): number {
    return this.time;
  }
  random(): number {
    return this.chance;
  }
  after(ms: number, work: () => void): () => void {
    const entry = { at: this.time + ms, work };
    this.waiting.push(entry);
    return () => {
      this.waiting = this.waiting.filter((other) => other !== entry);
    };
  }
  /** Let so many milliseconds pass. */
  pass(ms: number): void {
    const end = this.time + ms;
    for (;;) {
      const due = this.waiting.filter((entry) => entry.at <= end).sort((a, b) => a.at - b.at)[0];
      if (due === undefined) break;
      this.waiting = this.waiting.filter((other) => other !== due);
      this.time = due.at;
      due.work();
    }
    this.time = end;
  }
  /** Milliseconds until the next thing happens; null: nothing is planned. */
  next(): number | null {
    return this.waiting.length === 0 ? null : Math.min(...this.waiting.map((entry) => entry.at)) - this.time;
  }
}

export class FakeSocket implements SocketLike {
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  onerror: (() => void) | null = null;
  closed = false;
  readyState = 0;

  close(): void {
    this.closed = true;
    this.readyState = 3;
  }
  open(): void {
    this.readyState = 1;
    this.onopen?.();
  }
  say(message: unknown): void {
    this.readyState = 1;
    this.onmessage?.({ data: typeof message === "string" ? message : JSON.stringify(message) });
  }
}

/** Whatever was promised so far has happened. */
export async function settle(): Promise<void> {
  for (let turn = 0; turn < 20; turn += 1) await Promise.resolve();
}
