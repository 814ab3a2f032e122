/**
 * Requests to the REST interface.
 *
 * Reading may be tried again; a command is sent exactly once. When the connection breaks before its answer, the outcome
 * is `unknown`: the caller shows that and reads the resource again, it never sends the command again by itself.
 */
import { BASE } from "../place";
import type { components } from "./api.gen";
import { t } from "../texts";
import { said, tables } from "../texts/report";

type Problem = components["schemas"]["Problem"];

export const API = `${BASE}api/v1`;

export interface Refusal {
  kind: "refused";
  status: number;
  text: string;
  problem: Problem | null;
}
export interface Unknown {
  kind: "unknown";
  text: string;
}
export interface Done<T> {
  kind: "done";
  value: T;
  etag: string | null;
  location: string | null;
}
export type Outcome<T> = Done<T> | Refusal | Unknown;

export type Fetch = (input: string, init: RequestInit) => Promise<Response>;

/** Seconds that an answer may take: a tablet at the edge of the network gets a late answer rather than none. */
const READ_S = 20;
const COMMAND_S = 60;

export interface Command {
  method: "POST" | "PUT" | "DELETE";
  path: string;
  json?: unknown;
  text?: string;
  file?: Blob;
  key?: string;
  etag?: string | null;
}

export class Client {
  constructor(
    private readonly token: () => string | null,
    private readonly rejected: () => void = () => undefined,
    private readonly fetcher: Fetch = (input, init) => fetch(input, init),
  ) {}

  headers(): Record<string, string> {
    const token = this.token();
    return token === null ? {} : { Authorization: `Bearer ${token}` };
  }

  get<T>(path: string): Promise<Outcome<T>> {
    return this.request<T>(path, { method: "GET", headers: this.headers(), cache: "no-store" }, READ_S);
  }

  getText(path: string): Promise<Outcome<string>> {
    const init: RequestInit = { method: "GET", headers: this.headers(), cache: "no-store" };
    return this.request<string>(path, init, READ_S, (answer) => answer.text());
  }

  getBlob(path: string): Promise<Outcome<Blob>> {
    const init: RequestInit = { method: "GET", headers: this.headers(), cache: "no-store" };
    return this.request<Blob>(path, init, COMMAND_S, (answer) => answer.blob());
  }

  /** Send a command, once. */
  send<T>(command: Command): Promise<Outcome<T>> {
    const headers = this.headers();
    let body: string | Blob | null = null;
    if (command.json !== undefined) {
      headers["Content-Type"] = "application/json";
      body = JSON.stringify(command.json);
    } else if (command.text !== undefined) {
      headers["Content-Type"] = "application/yaml";
      body = command.text;
    } else if (command.file !== undefined) {
      headers["Content-Type"] = "application/octet-stream";
      body = command.file;
    }
    if (command.key !== undefined) headers["Idempotency-Key"] = command.key;
    if (command.etag) headers["If-Match"] = command.etag;
    return this.request<T>(command.path, { method: command.method, headers, body, cache: "no-store" }, COMMAND_S);
  }

  private async request<T>(
    path: string,
    init: RequestInit,
    seconds: number,
    read: (answer: Response) => Promise<T> = readJson,
  ): Promise<Outcome<T>> {
    const abort = new AbortController();
    const timer = setTimeout(() => abort.abort(), seconds * 1000);
    try {
      const answer = await this.fetcher(API + path, { ...init, signal: abort.signal });
      if (!answer.ok) return await this.refused(answer);
      const value = await read(answer);
      return { kind: "done", value, etag: answer.headers.get("ETag"), location: answer.headers.get("Location") };
    } catch {
      const text = init.method === "GET" ? t("common.serviceDidNotAnswer") : t("common.unknownWhetherWasDone");
      return { kind: "unknown", text };
    } finally {
      clearTimeout(timer);
    }
  }

  private async refused(answer: Response): Promise<Refusal> {
    if (answer.status === 401) this.rejected();
    let problem: Problem | null = null;
    try {
      problem = (await answer.json()) as Problem;
    } catch {
      // A proxy between us and the service may answer with anything.
    }
    await tables;
    const text =
      typeof problem?.detail === "string"
        ? said(problem.detail, problem.message)
        : t("common.theServiceAnswered", { status: answer.status });
    return { kind: "refused", status: answer.status, text, problem };
  }
}

async function readJson<T>(answer: Response): Promise<T> {
  if (answer.status === 204) return undefined as T;
  return (await answer.json()) as T;
}

/** `?a=1&b=2` from what is given; empty values are left out. */
export function query(values: Record<string, string | number | null | undefined>): string {
  const pairs = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  if (pairs.length === 0) return "";
  return `?${pairs.map(([name, value]) => `${name}=${encodeURIComponent(String(value))}`).join("&")}`;
}
