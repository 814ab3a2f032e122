// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { pairingCode, pairingFingerprint } from "./routes";

describe("the address that pairs", () => {
  const digest = "0a".repeat(32);

  it("holds a code of ten digits, and the fingerprint where there is one", () => {
    expect(pairingCode("#pair=0123456789")).toBe("0123456789");
    expect(pairingFingerprint("#pair=0123456789")).toBeNull();
    expect(pairingCode(`#pair=0123456789&sha256=${digest}`)).toBe("0123456789");
    expect(pairingFingerprint(`#pair=0123456789&sha256=${digest}`)).toBe(Array(32).fill("0A").join(":"));
  });

  it("is nothing else", () => {
    for (const other of ["#pair=012345", "#pair=01234567890", "#pair=0123456789&sha256=0a", "#/live", ""]) {
      expect(pairingCode(other)).toBeNull();
    }
  });
});
