import { describe, expect, it } from "vitest";
import { around, changes, faultOf, lineRange } from "./lines";

/** A generator of numbers below a bound, the same every time. */
function numbers(seed: number): (bound: number) => number {
  let state = seed;
  return (bound) => {
    state = (state * 1664525 + 1013904223) % 4294967296;
    return Math.floor((state / 4294967296) * bound);
  };
}

describe("changes", () => {
  it("lead from the one text to the other, whatever they are", () => {
    const next = numbers(7);
    for (let round = 0; round < 200; round++) {
      const text = (): string => Array.from({ length: next(12) }, () => "abcd"[next(4)]).join("\n");
      const [before, after] = [text(), text()];
      const found = changes(before, after);
      expect(
        found
          .filter((one) => one.kind !== "added")
          .map((one) => one.text)
          .join("\n"),
      ).toBe(before);
      expect(
        found
          .filter((one) => one.kind !== "removed")
          .map((one) => one.text)
          .join("\n"),
      ).toBe(after);
      for (const one of found)
        expect((one.kind === "removed" ? before : after).split("\n")[one.line - 1]).toBe(one.text);
    }
  });

  it("are as few as possible", () => {
    const changed = changes("a\nb\nc\nd", "a\nx\nc\nd").filter((one) => one.kind !== "same");
    expect(changed.map((one) => [one.kind, one.text])).toEqual([
      ["removed", "b"],
      ["added", "x"],
    ]);
  });

  it("are shown with what is around them, and nothing where nothing changed", () => {
    const long = Array.from({ length: 50 }, (_, at) => `line ${at}`);
    const other = long.map((line, at) => (at === 25 ? "other" : line));
    const shown = around(changes(long.join("\n"), other.join("\n")));
    expect(shown[0]).toBeNull();
    expect(shown[shown.length - 1]).toBeNull();
    expect(shown.filter((one) => one !== null).length).toBe(6);
    expect(around(changes("a\nb", "a\nb"))).toEqual([]);
  });
});

describe("a refusal of the service", () => {
  it("names a line", () => {
    expect(faultOf("machine.yaml:8: joints[0].dh.a: should be a number")).toEqual({
      line: 8,
      text: "joints[0].dh.a: should be a number",
    });
    expect(faultOf("machine.yaml: is not text in UTF-8")).toEqual({ line: null, text: "is not text in UTF-8" });
    expect(faultOf("there is no machine 'arm' for you")).toEqual({
      line: null,
      text: "there is no machine 'arm' for you",
    });
  });

  it("leads to that line, or the last where the file is shorter", () => {
    const text = "one\ntwo\nthree";
    const line = (at: number): string => text.slice(...lineRange(text, at));
    expect([line(1), line(2), line(3), line(9), line(0)]).toEqual(["one", "two", "three", "three", "one"]);
  });
});
