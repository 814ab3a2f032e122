// @vitest-environment happy-dom
import { afterEach, expect, it, vi } from "vitest";
import { Client, type Outcome } from "../../src/net/client";
import { Connection } from "../../src/net/connection";
import { FakeTimers } from "./fakes";

const UNKNOWN: Outcome<never> = { kind: "unknown", text: "" };
const done = <T>(value: T): Outcome<T> => ({ kind: "done", value, etag: null, location: null });

/** A service that answers what it is told to, and opens its event stream when it is let. */
function service() {
  const asked: string[] = [];
  const state = { there: true, machines: ["arm"] };
  let open: () => void = () => undefined;
  vi.stubGlobal("fetch", (_path: string, { signal }: RequestInit) => {
    return new Promise<Response>((resolve, reject) => {
      signal?.addEventListener("abort", () => reject(new DOMException("", "AbortError")));
      open = () => resolve(new Response(new ReadableStream({ start: () => undefined })));
    });
  });
  const client = (token: () => string | null, rejected: () => void) => {
    const own = new Client(token, rejected);
    vi.spyOn(own, "get").mockImplementation((path: string) => {
      asked.push(path);
      if (!state.there) return Promise.resolve(UNKNOWN);
      const items = state.machines.map((name) => ({ name }));
      return Promise.resolve(done(path === "/access/me" ? { name: "tablet", role: "viewer" } : { items }) as never);
    });
    return own;
  };
  return { asked, state, connection: new Connection(new FakeTimers(), client), open: () => open() };
}
const settled = () => new Promise((resolve) => setTimeout(resolve, 20));

afterEach(() => {
  vi.unstubAllGlobals();
  localStorage.clear();
});

it("asks who it is while the event stream is still being opened, and is known once that is there", async () => {
  const { asked, connection, open } = service();
  connection.start();
  await settled();
  expect(asked).toEqual(["/access/me", "/machines?limit=500"]);
  expect(connection.access.value).toBe("unknown");
  open();
  await settled();
  expect([connection.access.value, connection.online.value, connection.principal.value?.name]).toEqual([
    "known",
    true,
    "tablet",
  ]);
  expect(asked.filter((path) => path === "/access/me")).toHaveLength(1);
  connection.stop();
});

it("finds a machine that was added before the stream was there, of which no event tells", async () => {
  const { state, connection, open } = service();
  connection.start();
  await settled();
  state.machines = ["arm", "crane"];
  open();
  await settled();
  expect(connection.machines.value.map((machine) => machine.name)).toEqual(["arm", "crane"]);
  connection.stop();
});

it("asks again where the service did not answer yet", async () => {
  const { state, connection, open } = service();
  state.there = false;
  connection.start();
  await settled();
  state.there = true;
  open();
  await settled();
  expect(connection.access.value).toBe("known");
  connection.stop();
});

it("takes nothing from a stream that was given up", async () => {
  const { connection, open } = service();
  connection.start();
  open();
  connection.stop();
  await settled();
  expect([connection.access.value, connection.online.value]).toEqual(["unknown", false]);
});
