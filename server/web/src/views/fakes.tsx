/** A service that answers from a table, for tests of views. */
import { type Signal, signal } from "@preact/signals";
import { configure, render } from "@testing-library/preact";
import type { ComponentChildren } from "preact";
import { vi } from "vitest";
import type { Client, Command, Outcome } from "../net/client";
import type { Principal, Scope, Session } from "../net/connection";
import { SessionContext } from "../session";

// A busy computer draws slowly; a test that passes does not wait for it.
configure({ asyncUtilTimeout: 15_000 });
vi.setConfig({ testTimeout: 60_000 });

const NEEDED: Record<Scope, string[]> = {
  read: ["viewer", "operator", "engineer", "admin"],
  operate: ["operator", "engineer", "admin"],
  engineer: ["engineer", "admin"],
  admin: ["admin"],
};

export type Answer = Outcome<unknown>;
export const done = (value: unknown, etag: string | null = null): Answer => ({
  kind: "done",
  value,
  etag,
  location: null,
});
export const refused = (status: number, text: string): Answer => ({ kind: "refused", status, text, problem: null });
export const unknown = (text: string): Answer => ({ kind: "unknown", text });

export class FakeService {
  /** Answers to GET, by path. */
  readonly resources: Record<string, unknown> = {};
  readonly etags: Record<string, string> = {};
  /** Answers to commands, by method and path; what is not there is refused. */
  readonly answers: Record<string, Answer> = {};
  readonly sent: Command[] = [];
  readonly revisions: Signal<Record<string, number>> = signal({});
  readonly online = signal(true);
  readonly session: Session;

  constructor(role: Principal["role"], principal: Partial<Principal> = {}) {
    const who: Principal = {
      id: "prn-me",
      name: "Me",
      kind: "device",
      machines: null,
      role,
      approves_own: false,
      ...principal,
    };
    const machine = signal<string | null>("arm");
    this.session = {
      client: this.client(),
      principal: signal<Principal | null>(who),
      machine,
      machines: signal([]),
      online: this.online,
      access: signal("known"),
      revisions: this.revisions,
      renewals: signal(0),
      token: () => null,
      may: (scope) => NEEDED[scope].includes(role),
      choose: (name) => {
        machine.value = name;
      },
      paired: () => undefined,
      forget: () => undefined,
    };
  }

  /** The event stream says that resources moved. */
  moved(...names: string[]): void {
    const next = { ...this.revisions.value };
    for (const name of names) next[name] = (next[name] ?? 0) + 1;
    this.revisions.value = next;
  }

  show(children: ComponentChildren) {
    return render(<SessionContext.Provider value={this.session}>{children}</SessionContext.Provider>);
  }

  private client(): Client {
    const read = (path: string): Promise<Answer> =>
      Promise.resolve(
        path in this.resources
          ? done(this.resources[path], this.etags[path] ?? null)
          : refused(404, `there is nothing at ${path}`),
      );
    const send = (command: Command): Promise<Answer> => {
      this.sent.push(command);
      return Promise.resolve(this.answers[`${command.method} ${command.path}`] ?? refused(409, "not now"));
    };
    return { get: read, getText: read, getBlob: read, send, headers: () => ({}) } as unknown as Client;
  }
}
