/**
 * Who this device is, which machine it looks at, and whether the service is there.
 *
 * One event stream tells whether the service is there and which resources moved. After sleep, or when the service came
 * back, `renewals` moves: everything that is shown is read again then.
 */
import { type ReadonlySignal, type Signal, batch, signal } from "@preact/signals";
import { remember, remembered } from "../storage";
import type { components } from "./api.gen";
import { Client, type Outcome } from "./client";
import { EventStream, type ServerEvent } from "./event_stream";
import { type Timers, realTimers } from "./timers";

export type Principal = components["schemas"]["PrincipalResource"];
export type MachineSummary = components["schemas"]["MachineSummary"];
export type Scope = "read" | "operate" | "engineer" | "admin";
/** `unknown` until the service answered once; `stranger` where it wants this device to be paired. */
export type Access = "unknown" | "known" | "stranger";

const TOKEN = "hilfit.token";
const MACHINE = "hilfit.machine";
const ROLES = ["viewer", "operator", "engineer", "admin"];
const NEEDED: Record<Scope, number> = { read: 0, operate: 1, engineer: 2, admin: 3 };

export interface Session {
  client: Client;
  principal: Signal<Principal | null>;
  machine: Signal<string | null>;
  machines: Signal<MachineSummary[]>;
  /** Whether the service is there now; while it is not, what is shown is stale. */
  online: Signal<boolean>;
  access: ReadonlySignal<Access>;
  revisions: ReadonlySignal<Record<string, number>>;
  renewals: ReadonlySignal<number>;
  token(): string | null;
  may(scope: Scope): boolean;
  choose(machine: string): void;
  /** This device was paired. */
  paired(token: string): void;
  /** Forget who this device is. */
  forget(): void;
}

export class Connection implements Session {
  readonly principal = signal<Principal | null>(null);
  readonly machine = signal<string | null>(remembered(MACHINE));
  readonly machines = signal<MachineSummary[]>([]);
  readonly online = signal(false);
  readonly access = signal<Access>("unknown");
  readonly revisions = signal<Record<string, number>>({});
  readonly renewals = signal(0);
  readonly client: Client;
  private events: EventStream | null = null;
  /** What was asked while the stream was being opened. */
  private asked: Promise<[Outcome<Principal>, boolean]> | null = null;

  constructor(
    private readonly timers: Timers = realTimers,
    client?: (token: () => string | null, rejected: () => void) => Client,
  ) {
    const token = (): string | null => this.token();
    const rejected = (): void => this.rejected();
    this.client = client === undefined ? new Client(token, rejected) : client(token, rejected);
  }

  start(): void {
    this.events?.stop();
    this.events = new EventStream(
      "/events",
      () => this.client.headers(),
      {
        event: (event) => this.moved(event),
        state: (state) => {
          if (state === "up") void this.arrived();
          else this.online.value = false;
          if (state === "absent") this.rejected();
        },
        finished: () => false,
      },
      this.timers,
    );
    this.events.start();
    this.asked = this.ask();
  }

  stop(): void {
    this.events?.stop();
    this.events = null;
    this.asked = null;
  }

  /** Connections cannot be trusted any more: the device slept, or its network changed. */
  woke(): void {
    this.events?.renew();
  }

  token(): string | null {
    return remembered(TOKEN);
  }

  may(scope: Scope): boolean {
    const role = this.principal.value?.role;
    return role !== undefined && ROLES.indexOf(role) >= NEEDED[scope];
  }

  choose(machine: string): void {
    this.machine.value = machine;
    remember(MACHINE, machine);
  }

  paired(token: string): void {
    remember(TOKEN, token);
    this.access.value = "unknown";
    this.start();
  }

  forget(): void {
    remember(TOKEN, null);
    this.rejected();
  }

  private rejected(): void {
    this.access.value = "stranger";
    this.principal.value = null;
    this.online.value = false;
    this.stop();
  }

  /** Who are we for the service, and which machines are there? */
  private ask(): Promise<[Outcome<Principal>, boolean]> {
    return Promise.all([this.client.get<Principal>("/access/me"), this.readMachines()]);
  }

  /** The service is there. */
  private async arrived(): Promise<void> {
    const { asked, events } = this;
    this.asked = null;
    let [me, read] = await (asked ?? this.ask());
    if (asked !== null) {
      if (me.kind === "unknown" || !read)
        [me, read] = await this.ask(); // the service was only just coming up
      else void this.readMachines(); // one that was added before the stream was there has no event
    }
    if (this.events !== events) return; // stopped or started anew meanwhile
    if (me.kind === "refused" && me.status === 401) return; // `rejected` has said so
    if (me.kind !== "done" || !read) {
      this.events?.fail(); // gone again, or too much at once: the stream tries until it is there
      return;
    }
    this.events?.settled();
    batch(() => {
      this.principal.value = me.value;
      this.access.value = "known";
      this.online.value = true;
      this.renewals.value += 1;
    });
  }

  private async readMachines(): Promise<boolean> {
    const found = await this.client.get<components["schemas"]["MachineList"]>("/machines?limit=500");
    if (found.kind !== "done") return false;
    this.machines.value = found.value.items;
    const names = found.value.items.map((machine) => machine.name);
    if (this.machine.value === null || !names.includes(this.machine.value)) this.machine.value = names[0] ?? null;
    return true;
  }

  private moved(event: ServerEvent): void {
    let content: { resource?: unknown; revision?: unknown };
    try {
      content = JSON.parse(event.data) as typeof content;
    } catch {
      return;
    }
    const { resource, revision } = content;
    if (typeof resource !== "string" || typeof revision !== "number") return;
    const before = this.revisions.value[resource];
    if (before === revision) return;
    this.revisions.value = { ...this.revisions.value, [resource]: revision };
    if (resource === "machines" && before !== undefined) void this.readMachines();
  }
}
