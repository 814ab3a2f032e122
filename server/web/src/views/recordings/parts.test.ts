// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { bytes } from ".";
import { quality, seconds } from "./quality";
import { advice, toggled } from "./selection";
import { refusal, upload } from "./upload";

type Recording = Parameters<typeof quality>[0];
const recording = (statistics: Record<string, unknown>, given: Partial<Recording> = {}): Recording => ({
  id: "rec-1",
  machine: "arm",
  machine_version: 1,
  role: "train",
  label: "a",
  state: "sealed",
  origin: "uploaded",
  format: "parquet",
  created: "2026-03-01T08:00:00Z",
  ended: "2026-03-01T08:01:00Z",
  bytes: 1,
  sha256: null,
  statistics,
  error: null,
  error_message: null,
  ...given,
});

describe("quality", () => {
  it("of an upload comes from its rows and gaps", () => {
    expect(quality(recording({ rows: 2000, missing_rows: 0, segments: 1 }))).toEqual({ kind: "good", text: "No gaps" });
    const holes = quality(recording({ rows: 2000, missing_rows: 20, segments: 3 }));
    expect(holes).toEqual({ kind: "warning", text: "20 rows without all values, 2 gaps" });
    expect(quality(recording({ rows: 2000, missing_rows: 200, segments: 2 })).kind).toBe("bad");
    expect(quality(recording({ rows: 0 }))).toEqual({ kind: "bad", text: "Empty" });
  });

  it("of what was recorded here comes from what acquisition missed", () => {
    const good = { rows: 1000, seconds: 20, missed_cycles: 0, quality: {} };
    expect(quality(recording(good)).kind).toBe("good");
    const stale = { ...good, missed_cycles: 3, quality: { "joint1.angle": { stale: 4 } } };
    expect(quality(recording(stale)).text).toBe("3 moments missed, 1 channel with values not fresh");
  });

  it("of a failed one is what failed", () => {
    expect(quality(recording({}, { state: "failed", error: "the disk is full" }))).toEqual({
      kind: "bad",
      text: "the disk is full",
    });
  });

  it("knows the length where it is told, or from start and end", () => {
    expect(seconds(recording({ seconds: 40 }))).toBe(40);
    expect(seconds(recording({ rows: 100, rate_hz: 50 }))).toBe(2);
    expect(seconds(recording({}))).toBe(60);
    expect(seconds(recording({}, { ended: null }))).toBeNull();
  });
});

describe("a choice", () => {
  it("has each recording in the role that it was made in, until it is taken out", () => {
    const chosen = toggled({}, { id: "a", role: "train" });
    expect(chosen).toEqual({ a: "train" });
    expect(toggled(chosen, { id: "a", role: "train" })).toEqual({});
  });

  it("cannot be ordered without a motion to fit, and says what it will lack", () => {
    expect(advice([]).wrong).not.toBeNull();
    expect(advice(["unloaded", "validate"]).wrong).toContain("training motion");
    expect(advice(["operation"]).wrong).toBeNull();
    expect(advice(["train"]).wrong).toContain("validation motion");
    expect(advice(["train", "validate"]).weak.length).toBe(2);
    expect(advice(["unloaded", "train", "repeat", "validate"])).toEqual({ wrong: null, weak: [] });
  });
});

it("writes sizes as people read them", () => {
  expect([bytes(12), bytes(269526), bytes(68_000_000), bytes(3.2e9)]).toEqual(["12 B", "270 kB", "68.0 MB", "3.20 GB"]);
});

describe("an upload", () => {
  class FakeRequest {
    upload: { onprogress: ((event: object) => void) | null } = { onprogress: null };
    onload: (() => void) | null = null;
    onerror: (() => void) | null = null;
    onabort: (() => void) | null = null;
    status = 0;
    responseText = "";
    sent = 0;
    headers: Record<string, string> = {};
    url = "";
    open(_method: string, url: string): void {
      this.url = url;
    }
    setRequestHeader(name: string, value: string): void {
      this.headers[name] = value;
    }
    send(): void {
      this.sent += 1;
    }
    abort(): void {
      this.onabort?.();
    }
  }
  const start = () => {
    const request = new FakeRequest();
    const told: number[] = [];
    const order = {
      file: { name: "a b.csv" } as File,
      machine: "arm",
      role: "train",
      headers: { Authorization: "Bearer t" },
    };
    const sent = upload(order, (fraction) => told.push(fraction), request as unknown as XMLHttpRequest);
    return { request, told, ...sent };
  };

  it("is refused before a byte is sent where the service would refuse it", () => {
    expect(refusal({ name: "a.CSV", size: 1 })).toBeNull();
    expect(refusal({ name: "a.xlsx", size: 1 })).toContain(".parquet");
    expect(refusal({ name: "a.mf4", size: 0 })).toContain("is empty; export");
    expect(refusal({ name: `${"x".repeat(196)}.csv`, size: 1 })).toBeNull();
    expect(refusal({ name: `${"x".repeat(197)}.csv`, size: 1 })).toContain("more than 200 characters");
  });

  it("is sent once, with who sends it, and tells how far it is", async () => {
    const { request, told, outcome } = start();
    expect(request.url).toBe("/api/v1/recordings/upload?machine=arm&role=train&name=a%20b.csv");
    expect(request.headers.Authorization).toBe("Bearer t");
    request.upload.onprogress?.({ lengthComputable: true, loaded: 1, total: 4 });
    request.upload.onprogress?.({ lengthComputable: false, loaded: 2, total: 0 });
    expect(told).toEqual([0.25]);
    request.status = 201;
    request.responseText = '{"id":"rec-1"}';
    request.onload?.();
    expect(await outcome).toMatchObject({ kind: "done", value: { id: "rec-1" } });
    expect(request.sent).toBe(1);
  });

  it("shows what the service says of a file that it refuses", async () => {
    const { request, outcome } = start();
    request.status = 422;
    request.responseText = '{"detail":"a b.csv: no channel joint1.angle; name it"}';
    request.onload?.();
    expect(await outcome).toMatchObject({ kind: "refused", text: "a b.csv: no channel joint1.angle; name it" });
  });

  it("whose answer is no document is refused with its status", async () => {
    const { request, outcome } = start();
    request.status = 502;
    request.responseText = "<html>";
    request.onload?.();
    expect(await outcome).toMatchObject({ kind: "refused", status: 502 });
  });

  it("that breaks is unknown, never sent again; one that is broken off is not", async () => {
    const broken = start();
    broken.request.onerror?.();
    expect((await broken.outcome).kind).toBe("unknown");
    expect(broken.request.sent).toBe(1);
    const stopped = start();
    stopped.abort();
    expect(await stopped.outcome).toMatchObject({ kind: "refused", status: 0 });
  });
});
