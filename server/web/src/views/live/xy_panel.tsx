/** One line of the plots over another. */
import { useState } from "preact/hooks";
import type { Trace } from "../../charts/trace";
import { XyChart } from "../../charts/xy_chart";
import type { Range } from "../../charts/range";
import { Field, type SelectEvent } from "../../ui/controls";
import { column, type Group, type Line } from "./groups";
import { t } from "../../texts";

interface XyPanelProps {
  groups: Group[];
  trace: () => Trace;
  range: () => Range;
  register: (name: string, draw: (() => void) | null) => void;
}

interface Choosable {
  key: string;
  words: string;
  line: Line;
}

export function XyPanel({ groups, trace, range, register }: XyPanelProps) {
  const lines: Choosable[] = groups.flatMap((group) =>
    group.lines.map((line) => ({
      key: line.name,
      words: `${group.title}: ${line.label} (${line.unit})`,
      line,
    })),
  );
  const [xName, setX] = useState(lines[0]?.key ?? "");
  const [yName, setY] = useState(lines[1]?.key ?? "");
  const x = lines.find((one) => one.key === xName) ?? lines[0];
  const y = lines.find((one) => one.key === yName) ?? lines[1] ?? lines[0];
  if (x === undefined || y === undefined) return null;
  const choice = (label: string, now: Choosable, set: (name: string) => void) => (
    <Field label={label}>
      <select value={now.key} onChange={(event: SelectEvent) => set(event.currentTarget.value)}>
        {lines.map((one) => (
          <option key={one.key} value={one.key}>
            {one.words}
          </option>
        ))}
      </select>
    </Field>
  );
  return (
    <section class="xy" aria-label={t("live.oneSignalOverAnother")}>
      <div class="record-form">
        {choice(t("live.across"), x, setX)}
        {choice(t("live.up"), y, setY)}
      </div>
      <XyChart
        xLabel={x.words}
        yLabel={y.words}
        read={() => {
          const now = trace();
          const [from, to] = range();
          const inside = (values: (number | null)[]) =>
            values.map((value, row) => {
              const time = now.t[row] as number;
              return time < from || time > to ? null : value;
            });
          return { x: inside(column(x.line, now)), y: column(y.line, now) };
        }}
        register={(draw) => register("xy", draw)}
      />
    </section>
  );
}
