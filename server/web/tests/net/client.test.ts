import { describe, expect, it, vi } from "vitest";
import { Client, query, type Fetch } from "../../src/net/client";

const answer = (status: number, body: unknown, headers: Record<string, string> = {}) =>
  new Response(status === 204 ? null : JSON.stringify(body), { status, headers });

function made(fetcher: Fetch, token: string | null = null) {
  const calls: [string, RequestInit][] = [];
  const rejected = vi.fn();
  const client = new Client(
    () => token,
    rejected,
    (input, init) => {
      calls.push([input, init]);
      return fetcher(input, init);
    },
  );
  return { client, calls, rejected };
}

describe("commands", () => {
  it("are sent once, and what came of it is unknown when the connection breaks", async () => {
    const { client, calls } = made(() => Promise.reject(new TypeError("Failed to fetch")));
    const outcome = await client.send({ method: "POST", path: "/recordings", json: { machine: "lever" } });
    expect(outcome.kind).toBe("unknown");
    expect(calls).toHaveLength(1);
  });

  it("are not sent again when the answer breaks off in the middle", async () => {
    const broken = { ok: true, status: 200, headers: new Headers(), json: () => Promise.reject(new Error("cut")) };
    const { client, calls } = made(() => Promise.resolve(broken as unknown as Response));
    expect((await client.send({ method: "POST", path: "/x" })).kind).toBe("unknown");
    expect(calls).toHaveLength(1);
  });

  it("are not sent again when nothing comes for a minute", async () => {
    vi.useFakeTimers();
    try {
      const { client, calls } = made(
        (_input, init) =>
          new Promise((_done, fail) => init.signal?.addEventListener("abort", () => fail(new Error("aborted")))),
      );
      const outcome = client.send({ method: "POST", path: "/x" });
      await vi.advanceTimersByTimeAsync(60_000);
      expect((await outcome).kind).toBe("unknown");
      expect(calls).toHaveLength(1);
    } finally {
      vi.useRealTimers();
    }
  });

  it("carry token, content type, idempotency key and version", async () => {
    const { client, calls } = made(
      () => Promise.resolve(answer(201, { id: "x" }, { Location: "/j", ETag: '"2"' })),
      "t",
    );
    const outcome = await client.send({ method: "PUT", path: "/y", json: { a: 1 }, key: "k", etag: '"1"' });
    expect(outcome).toEqual({ kind: "done", value: { id: "x" }, etag: '"2"', location: "/j" });
    const [path, init] = calls[0] as [string, RequestInit];
    expect(path).toBe("/api/v1/y");
    expect(init.body).toBe('{"a":1}');
    expect(init.headers).toEqual({
      Authorization: "Bearer t",
      "Content-Type": "application/json",
      "Idempotency-Key": "k",
      "If-Match": '"1"',
    });
  });
});

describe("answers", () => {
  it("that refuse say what the problem document says", async () => {
    const { client } = made(() => Promise.resolve(answer(409, { detail: "it is being recorded" })));
    const outcome = await client.get("/x");
    expect(outcome).toMatchObject({ kind: "refused", status: 409, text: "it is being recorded" });
  });

  it("of something between that refuses are told by their number", async () => {
    const { client } = made(() => Promise.resolve(new Response("<html>", { status: 502 })));
    expect(await client.get("/x")).toMatchObject({ kind: "refused", text: "The service answered 502." });
  });

  it("of 401 say that this device is not known any more", async () => {
    const { client, rejected } = made(() => Promise.resolve(answer(401, { detail: "pair" })));
    await client.get("/x");
    expect(rejected).toHaveBeenCalledTimes(1);
  });

  it("without content are done", async () => {
    const { client } = made(() => Promise.resolve(answer(204, null)));
    expect(await client.send({ method: "DELETE", path: "/x" })).toMatchObject({ kind: "done", value: undefined });
  });
});

it("builds a query of what is given", () => {
  expect(query({ machine: "a b", state: null, limit: 5, label: "" })).toBe("?machine=a%20b&limit=5");
  expect(query({})).toBe("");
});
