/**
 * Server-sent events by `fetch`: `EventSource` cannot send the token's header, and does not notice a dead connection.
 */
import { API, type Fetch } from "./client";
import { pause } from "./backoff";
import type { Timers } from "./timers";

export interface ServerEvent {
  id: string | null;
  data: string;
}

/** Splits what comes into events (HTML standard, section 9.2.6); comments only show that the connection lives. */
export class EventParser {
  private rest = "";

  push(text: string): ServerEvent[] {
    this.rest += text;
    const blocks = this.rest.split(/\r?\n\r?\n/);
    this.rest = blocks.pop() ?? "";
    return blocks.map(parseBlock).filter((event): event is ServerEvent => event !== null);
  }
}

function parseBlock(block: string): ServerEvent | null {
  let id: string | null = null;
  const data: string[] = [];
  for (const line of block.split(/\r?\n/)) {
    const colon = line.indexOf(":");
    if (colon <= 0) continue;
    const value = line.slice(colon + 1).replace(/^ /, "");
    const field = line.slice(0, colon);
    if (field === "data") data.push(value);
    else if (field === "id") id = value;
  }
  return data.length === 0 ? null : { id, data: data.join("\n") };
}

export interface StreamHandlers {
  event(event: ServerEvent): void;
  /** What the stream answered with when it is not there at all (a status), or that it is up or lost. */
  state(state: "up" | "lost" | "absent"): void;
  /** True when the stream has told everything and must not be opened again. */
  finished(): boolean;
}

/** Time that connecting may take. */
const CONNECT_MS = 10_000;

export class EventStream {
  private abort: AbortController | null = null;
  private cancel: () => void = () => undefined;
  private attempt = 0;
  private running = false;
  private lastId: string | null = null;

  constructor(
    private readonly path: string,
    private readonly headers: () => Record<string, string>,
    private readonly handlers: StreamHandlers,
    private readonly timers: Timers,
    private readonly silenceMs = 25000,
    private readonly fetcher: Fetch = (input, init) => fetch(input, init),
  ) {}

  start(): void {
    if (this.running) return;
    this.running = true;
    void this.follow();
  }

  stop(): void {
    this.running = false;
    this.cancel();
    this.abort?.abort();
  }

  /** Open it anew now. */
  renew(): void {
    if (!this.running) return;
    this.attempt = 0;
    this.cancel();
    this.abort?.abort();
    void this.follow();
  }

  /** It serves its purpose: should it be lost, the first attempt comes soon. */
  settled(): void {
    this.attempt = 0;
  }

  /** What came with it cannot be used: let go of it, and try again after a pause. */
  fail(): void {
    this.abort?.abort();
  }

  private async follow(): Promise<void> {
    const abort = new AbortController();
    this.abort = abort;
    this.watch(abort, CONNECT_MS);
    try {
      const headers: Record<string, string> = { ...this.headers(), Accept: "text/event-stream" };
      if (this.lastId !== null) headers["Last-Event-ID"] = this.lastId;
      const answer = await this.fetcher(API + this.path, { headers, signal: abort.signal, cache: "no-store" });
      if (this.abort !== abort || abort.signal.aborted) return; // another one has taken over, or nobody wants it
      if (answer.status === 404 || answer.status === 401 || answer.status === 403 || answer.body === null) {
        this.cancel();
        this.handlers.state("absent");
        this.running = false;
        return;
      }
      if (!answer.ok) throw new Error(String(answer.status));
      this.watch(abort, this.silenceMs);
      this.handlers.state("up");
      await this.read(answer.body, abort);
    } catch {
      // Lost; what follows is the same as for an end.
    }
    if (this.abort !== abort || !this.running) return; // another one has taken over
    this.cancel();
    if (this.handlers.finished()) {
      this.running = false;
      return;
    }
    this.handlers.state("lost");
    this.cancel = this.timers.after(
      pause(this.attempt, () => this.timers.random()),
      () => void this.follow(),
    );
    this.attempt += 1;
  }

  private async read(body: ReadableStream<Uint8Array>, abort: AbortController): Promise<void> {
    const reader = body.getReader();
    const decoder = new TextDecoder();
    const parser = new EventParser();
    while (!abort.signal.aborted) {
      const { done, value } = await reader.read();
      if (done) return;
      this.watch(abort, this.silenceMs);
      for (const event of parser.push(decoder.decode(value, { stream: true }))) {
        if (event.id !== null) this.lastId = event.id;
        this.handlers.event(event);
      }
    }
  }

  private watch(abort: AbortController, ms: number): void {
    this.cancel();
    this.cancel = this.timers.after(ms, () => abort.abort());
  }
}
