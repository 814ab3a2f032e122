/** Lines of a text: which one a refusal means, and what two texts have that the other has not. */

/** The line and the key that a refusal of the service names: `machine.yaml:8: joints[0].dh.a: ...`. */
export interface Fault {
  line: number | null;
  text: string;
}

export function faultOf(detail: string): Fault {
  const match = /^machine\.yaml(?::(\d+))?:\s*(.*)$/s.exec(detail);
  if (match === null) return { line: null, text: detail };
  return { line: match[1] === undefined ? null : Number(match[1]), text: match[2] ?? detail };
}

/** Where a line (the first is 1) begins and ends in a text. */
export function lineRange(text: string, line: number): [number, number] {
  const lines = text.split("\n");
  const at = Math.min(Math.max(1, line), lines.length) - 1;
  const start = lines.slice(0, at).reduce((sum, one) => sum + one.length + 1, 0);
  return [start, start + (lines[at]?.length ?? 0)];
}

export interface Change {
  kind: "same" | "removed" | "added";
  text: string;
  /** Line number in the text that has it: the old one's where it was removed, else the new one's. */
  line: number;
}

/** Most lines of a side that are compared line by line: the table of the comparison grows with the square. */
const MOST = 3000;

/** What makes `after` of `before`, line by line (longest common subsequence). */
export function changes(before: string, after: string): Change[] {
  const a = before.split("\n");
  const b = after.split("\n");
  let head = 0;
  while (head < a.length && head < b.length && a[head] === b[head]) head += 1;
  let tail = 0;
  while (tail < a.length - head && tail < b.length - head && a[a.length - 1 - tail] === b[b.length - 1 - tail])
    tail += 1;
  const same = (from: number, to: number): Change[] =>
    b.slice(from, to).map((text, at) => ({ kind: "same", text, line: from + at + 1 }));
  const middle = between(a.slice(head, a.length - tail), b.slice(head, b.length - tail), head);
  return [...same(0, head), ...middle, ...same(b.length - tail, b.length)];
}

function between(a: string[], b: string[], offset: number): Change[] {
  const removed = (at: number): Change => ({ kind: "removed", text: a[at] as string, line: offset + at + 1 });
  const added = (at: number): Change => ({ kind: "added", text: b[at] as string, line: offset + at + 1 });
  if (a.length > MOST || b.length > MOST) return [...a.map((_, at) => removed(at)), ...b.map((_, at) => added(at))];
  const width = b.length + 1;
  const common = new Uint16Array((a.length + 1) * width);
  const length = (i: number, j: number): number => common[i * width + j] as number;
  for (let i = a.length - 1; i >= 0; i--)
    for (let j = b.length - 1; j >= 0; j--)
      common[i * width + j] = a[i] === b[j] ? length(i + 1, j + 1) + 1 : Math.max(length(i + 1, j), length(i, j + 1));
  const found: Change[] = [];
  let i = 0;
  let j = 0;
  while (i < a.length || j < b.length) {
    if (i < a.length && j < b.length && a[i] === b[j]) {
      found.push({ kind: "same", text: b[j] as string, line: offset + j + 1 });
      i += 1;
      j += 1;
    } else if (j >= b.length || (i < a.length && length(i + 1, j) >= length(i, j + 1))) found.push(removed(i++));
    else found.push(added(j++));
  }
  return found;
}

/** Changes with some lines around each; null stands for what is left out between them. */
export function around(all: Change[], context = 2): (Change | null)[] {
  const near = all.map((_, at) =>
    all.slice(Math.max(0, at - context), at + context + 1).some((one) => one.kind !== "same"),
  );
  const shown: (Change | null)[] = [];
  all.forEach((one, at) => {
    if (near[at]) shown.push(one);
    else if (shown[shown.length - 1] !== null) shown.push(null);
  });
  return shown.some((one) => one !== null) ? shown : [];
}
