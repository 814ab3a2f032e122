/**
 * The live stream of one machine: connects, watches the heartbeat, connects again.
 *
 * A tablet that slept finds its socket OPEN and dead. So silence longer than `SILENCE_MS` ends a connection, and waking
 * ends it at once. A new connection begins with a snapshot; a hole in the sequence numbers asks for one by connecting
 * again. Nothing is ever sent.
 */
import { pause } from "./backoff";
import { type LiveMessage, parseLive } from "./live_messages";
import type { Timers } from "./timers";

/** The server says something each two seconds at least. */
export const SILENCE_MS = 5000;
/** Time that connecting may take. */
export const CONNECT_MS = 8000;
/** `WebSocket.CONNECTING` */
const CONNECTING = 0;

export interface SocketLike {
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
  onerror: (() => void) | null;
  readonly readyState: number;
  close(): void;
}

export type LinkState = "connecting" | "live" | "lost" | "stopped";

export interface LiveHandlers {
  message(message: LiveMessage): void;
  state(state: LinkState, reason: string): void;
}

export class LiveSocket {
  private socket: SocketLike | null = null;
  private cancel: () => void = () => undefined;
  private attempt = 0;
  private seq: number | null = null;
  private running = false;

  constructor(
    private readonly open: () => SocketLike,
    private readonly handlers: LiveHandlers,
    private readonly timers: Timers,
  ) {}

  start(): void {
    if (this.running) return;
    this.running = true;
    this.connect();
  }

  stop(): void {
    this.running = false;
    this.drop();
    this.handlers.state("stopped", "");
  }

  /** Connect anew now: after sleep, or when the network came back. What is connecting already goes on. */
  renew(reason: string): void {
    if (!this.running || this.socket?.readyState === CONNECTING) return;
    this.drop();
    this.handlers.state("lost", reason);
    this.attempt = 0;
    this.connect();
  }

  private connect(): void {
    this.drop();
    this.seq = null;
    this.handlers.state("connecting", "");
    let socket: SocketLike;
    try {
      socket = this.open();
    } catch {
      this.lost("the browser refused the connection");
      return;
    }
    this.socket = socket;
    socket.onopen = () => {
      if (this.socket === socket) this.watch(SILENCE_MS, "connected, but nothing came");
    };
    socket.onmessage = (event) => {
      if (this.socket === socket) this.take(event.data);
    };
    socket.onclose = (event) => {
      if (this.socket === socket) this.lost(event.reason || String(event.code));
    };
    socket.onerror = null; // a close follows
    this.watch(CONNECT_MS, "no answer");
  }

  private take(data: unknown): void {
    const message = typeof data === "string" ? parseLive(data) : null;
    if (message === null) {
      this.lost("a message that cannot be read");
      return;
    }
    if (message.type !== "snapshot" && this.seq === null) return; // nothing to add it to yet
    if (message.type !== "snapshot" && message.seq !== (this.seq as number) + 1) {
      this.lost(`messages ${(this.seq as number) + 1} to ${message.seq - 1} are missing`);
      return;
    }
    this.seq = message.seq;
    this.watch(SILENCE_MS, `nothing came for ${SILENCE_MS / 1000} s`);
    if (message.type === "snapshot") {
      this.attempt = 0;
      this.handlers.state("live", "");
    }
    this.handlers.message(message);
  }

  private watch(ms: number, reason: string): void {
    this.cancel();
    this.cancel = this.timers.after(ms, () => this.lost(reason));
  }

  private lost(reason: string): void {
    this.drop();
    if (!this.running) return;
    this.handlers.state("lost", reason);
    const ms = pause(this.attempt, () => this.timers.random());
    this.attempt += 1;
    this.cancel = this.timers.after(ms, () => this.connect());
  }

  /** Let go of the socket whatever state it claims to be in. */
  private drop(): void {
    this.cancel();
    this.cancel = () => undefined;
    const socket = this.socket;
    this.socket = null;
    if (socket === null) return;
    socket.onopen = socket.onmessage = socket.onclose = socket.onerror = null;
    if (socket.readyState === CONNECTING) {
      socket.onopen = () => socket.close(); // closed before, it would complain
      return;
    }
    try {
      socket.close();
    } catch {
      // It was never open.
    }
  }
}
