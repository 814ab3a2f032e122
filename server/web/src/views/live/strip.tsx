/** One drawing with the numbers below it; the numbers name the lines. */
import { type ReadonlySignal, useComputed, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { Hands } from "../../charts/gestures";
import type { ChartMark } from "../../charts/overlays";
import type { Range } from "../../charts/range";
import { clock, clockLabels, DASHES, TimeChart } from "../../charts/time_chart";
import type { Trace } from "../../charts/trace";
import { Mark, type MarkKind } from "../../ui/controls";
import { fixed, number, zone } from "../../ui/format";
import { whileSeen } from "../../ui/seen";
import { type Group, column, type Line, reading } from "./groups";
import type { History } from "./history";
import type { Part } from "./pace";
import { mark, measured, SILENT_S } from "./quality";
import { silenceOf } from "./use_live";
import { t } from "../../texts";

const HEIGHT = 150;
/** ms after which numbers that are out of sight are written again: who hears a page reads there, too. */
const UNSEEN_MS = 2000;

export interface StripProps {
  group: Group;
  history: History;
  silence: number;
  trace: () => Trace;
  range: () => Range;
  marks: ChartMark[];
  /** Thresholds that a person set, in the unit of the group. */
  thresholds: number[];
  hands: Hands;
  register: (name: string, draw: (() => void) | null) => void;
  /** Is given what writes the numbers as they are now; false from it: it was not necessary. */
  registerNumbers: (name: string, write: Part | null) => void;
}

export function Strip(props: StripProps) {
  const { group, history, silence, thresholds, registerNumbers } = props;
  const ticks = useSignal(0);
  const place = useRef<HTMLElement>(null);
  useEffect(() => {
    let [seen, written] = [true, 0];
    const write = (): boolean => {
      const now = performance.now();
      if (!seen && now - written < UNSEEN_MS) return false;
      written = now;
      ticks.value += 1;
      return true;
    };
    registerNumbers(group.title, write);
    const forget = whileSeen(place.current as HTMLElement, (now) => {
      seen = now;
      write();
    });
    return () => {
      forget();
      registerNumbers(group.title, null);
    };
  }, [group.title]);
  const [at, setAt] = useState<number | null>(null);
  const columns = useRef<(number | null)[][]>([]);
  const times = useRef<number[]>([]);
  const series = useMemo(() => group.lines.map(({ name, label, decimals }) => ({ name, label, decimals })), [group]);
  const limits = [
    ...group.lines.flatMap((line) => line.limits),
    ...thresholds.map((value) => ({ value, label: t("live.threshold", { value: number(value) }) })),
  ];
  const time = at === null ? undefined : times.current[at];
  const old = silence >= SILENT_S;
  return (
    <section ref={place} class={old ? "strip stale" : "strip"} aria-label={group.title}>
      <h3>
        {group.title} <span class="unit">{group.unit}</span>
        {time !== undefined && (
          <span class="at">{t("live.at", { time: clock(time, 2), zone: zone(new Date(1000 * time)) })}</span>
        )}
      </h3>
      <TimeChart
        title={group.title}
        series={series}
        height={HEIGHT}
        timeLabels={clockLabels}
        zone={zone(new Date())}
        read={() => {
          const trace = props.trace();
          times.current = trace.t;
          columns.current = group.lines.map((line) => column(line, trace));
          return { t: trace.t, columns: columns.current, range: props.range() };
        }}
        overlays={() => ({ marks: props.marks, thresholds: limits, doubtful: doubtful(group, props.trace()) })}
        hands={props.hands}
        onCursor={setAt}
        register={(draw) => props.register(group.title, draw)}
      />
      <ul class="numbers">
        {group.lines.map((line, index) => (
          <Number
            key={line.name}
            line={line}
            index={index}
            history={history}
            ticks={ticks}
            then={time === undefined ? undefined : (columns.current[index]?.[at as number] ?? null)}
          />
        ))}
      </ul>
    </section>
  );
}

/** When any channel of a group was not measured. */
function doubtful(group: Group, trace: Trace): Range[] {
  return group.lines.flatMap((line) => line.sources.flatMap((name) => trace.doubtful.get(name) ?? []));
}

interface NumberProps {
  line: Line;
  index: number;
  history: History;
  ticks: ReadonlySignal<number>;
  /** What the line was where the cursor is; undefined: show what it is now. */
  then: number | null | undefined;
}

function Number({ line, index, history, ticks, then }: NumberProps) {
  // A value that moves writes its text; only another quality makes anything else.
  const value = useComputed(() => {
    void ticks.value;
    return fixed(reading(line, history.readings).value, line.decimals);
  });
  const said = useComputed(() => {
    void ticks.value;
    const now = reading(line, history.readings);
    const silence = silenceOf(history);
    const { kind, text } = mark(now, silence);
    return [measured(now, silence) ? "measured" : "", kind, text].join("\n");
  });
  const [isMeasured, kind, text] = said.value.split("\n") as [string, MarkKind, string];
  const good = then !== undefined || isMeasured !== "";
  return (
    <li class={good ? "number" : "number not-measured"}>
      <span class="name">
        <svg class={`sample series-${(index % 6) + 1}`} viewBox="0 0 28 8" aria-hidden="true">
          <line x1="0" y1="4" x2="28" y2="4" stroke-dasharray={(DASHES[index % 6] as number[]).join(" ")} />
        </svg>
        {line.label}
        {then === undefined && kind === "good" && (
          <Mark kind="good">
            <span class="for-reader">{text}</span>
          </Mark>
        )}
      </span>
      <span class="value">
        {then === undefined ? value : fixed(then, line.decimals)} <span class="unit">{line.unit}</span>
      </span>
      {then === undefined && kind !== "good" && <Mark kind={kind}>{text}</Mark>}
    </li>
  );
}
