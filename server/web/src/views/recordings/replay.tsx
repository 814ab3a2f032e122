/** A recording over time: zoom, replay, a second one beside it, what was not measured, and a part of it to keep. */
import { useCallback, useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { type Hands, rangeHands } from "../../charts/gestures";
import type { ChartMark } from "../../charts/overlays";
import type { Range } from "../../charts/range";
import { DASHES, secondLabels, TimeChart } from "../../charts/time_chart";
import { RangeButtons } from "../../charts/toolbar";
import { type Signals, Trace, type Value } from "../../charts/trace";
import { CommandNotice, useCommand } from "../../command";
import { query } from "../../net/client";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Notice, type SelectEvent } from "../../ui/controls";
import { fixed } from "../../ui/format";
import { chosen } from "../live/choice";
import { type Group, groups, type MachineContent } from "../live/groups";
import { joined, played } from "./replay_trace";
import { t } from "../../texts";

type Recording = components["schemas"]["RecordingResource"];
type Remarks = components["schemas"]["RecordingRemarks"];

const MOMENTS = 1500;
const SPEEDS = [1, 4, 16];
/** ms between two steps of a replay; s of the recording that it shows at once. */
const STEP_MS = 100;
const REPLAY_S = 20;

interface ReplayProps {
  recording: Recording;
  others: Recording[];
  remarks: Remarks | null;
}

export function Replay({ recording, others, remarks }: ReplayProps) {
  const machine = encodeURIComponent(recording.machine);
  const path = `/machines/${machine}?version=${recording.machine_version}`;
  const detail = useResource<components["schemas"]["MachineDetail"]>(path, []);
  const content = detail.value?.machine as unknown as MachineContent | undefined;
  const [beside, setBeside] = useState("");
  const [range, setRange] = useState<Range | null>(null);
  const first = useRecorded(recording.id, range);
  const second = useRecorded(beside === "" ? null : beside, range);
  const end = useRef(0);
  if (range === null && first.signals !== null) end.current = first.signals.end;
  const bounds: Range = [0, Math.max(end.current, 0.1)];
  const now: Range = range ?? bounds;
  const playing = usePlaying(now, bounds[1], setRange);
  const hands = rangeHands(now, bounds, setRange);
  const marks = useMemo(() => eventMarks(remarks), [remarks]);
  if (first.error !== null) return <Notice kind="bad">{first.error}</Notice>;
  if (detail.error !== null) return <Notice kind="bad">{detail.error}</Notice>;
  if (content === undefined || first.trace === null) return <p role="status">{t("recordings.readingTheSignals")}</p>;
  const present = new Set(first.trace.names);
  const absent = groups(content)
    .flatMap((group) => group.lines)
    .filter((line) => line.sources.some((name) => !present.has(name)));
  const drawn = chosen(
    groups(content),
    absent.map((line) => line.name),
  );
  return (
    <>
      <div class="chart-toolbar" role="toolbar" aria-label={t("common.whatPlotsShow")}>
        <RangeButtons range={() => now} bounds={() => bounds} onRange={hands.show} />
        <Button disabled={range === null} onClick={() => setRange(null)}>
          {t("common.showAll2")}
        </Button>
        {playing.speed === 0 ? (
          SPEEDS.map((speed) => (
            <Button
              key={speed}
              label={t("recordings.replayTimesAsFast", { speed })}
              onClick={() => playing.play(speed)}
            >
              ▶ {speed} ×
            </Button>
          ))
        ) : (
          <Button onClick={() => playing.play(0)}>{t("recordings.stopTheReplay")}</Button>
        )}
      </div>
      <Field label={t("recordings.besideIt")}>
        <select value={beside} onChange={(event: SelectEvent) => setBeside(event.currentTarget.value)}>
          <option value="">{t("recordings.noOtherRecording")}</option>
          {others.map((one) => (
            <option key={one.id} value={one.id}>
              {one.label || one.id}
            </option>
          ))}
        </select>
      </Field>
      {second.error !== null && <Notice kind="warning">{second.error}</Notice>}
      {second.trace !== null && <p class="hint">{t("recordings.thickRecordingThinOther")}</p>}
      <div class="strips">
        {drawn.map((group) => (
          <RecordedStrip
            key={`${group.title} ${second.trace === null}`}
            group={group}
            first={first.trace as Trace}
            second={second.trace}
            range={now}
            marks={marks}
            hands={hands}
          />
        ))}
      </div>
      {range !== null && playing.speed === 0 && <KeepPart recording={recording} range={now} />}
    </>
  );
}

/** The signals of a recording, of the range that is shown once it stands still. */
function useRecorded(id: string | null, range: Range | null) {
  const asked = useSettled(range, 300);
  const place = query({ start: asked?.[0], end: asked?.[1], moments: MOMENTS });
  const found = useResource<Signals>(id === null ? null : `/recordings/${encodeURIComponent(id)}/signals${place}`, []);
  const last = useRef<{ id: string; signals: Signals; trace: Trace } | null>(null);
  if (found.value !== null && id !== null && found.value !== last.current?.signals)
    last.current = { id, signals: found.value, trace: Trace.of(found.value) };
  const known = last.current?.id === id ? last.current : null;
  return { signals: found.value, trace: known?.trace ?? null, error: found.error };
}

function useSettled<T>(value: T, ms: number): T {
  const [settled, setSettled] = useState(value);
  const key = JSON.stringify(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), ms);
    return () => clearTimeout(timer);
  }, [key]);
  return settled;
}

function usePlaying(now: Range, end: number, setRange: (range: Range) => void) {
  const [speed, setSpeed] = useState(0);
  const at = useRef(now);
  at.current = now;
  useEffect(() => {
    if (speed === 0) return undefined;
    const timer = setInterval(() => {
      const next = played(at.current, (speed * STEP_MS) / 1000, end);
      if (next[1] >= end) setSpeed(0);
      setRange(next);
    }, STEP_MS);
    return () => clearInterval(timer);
  }, [speed, end]);
  const play = (wanted: number): void => {
    const [from, to] = at.current;
    if (wanted > 0 && to >= end) setRange([0, Math.min(REPLAY_S, end)]);
    else if (wanted > 0 && to - from > REPLAY_S) setRange([from, from + REPLAY_S]);
    setSpeed(wanted);
  };
  return { speed, play };
}

interface RecordedStripProps {
  group: Group;
  first: Trace;
  second: Trace | null;
  range: Range;
  marks: ChartMark[];
  hands: Hands;
}

function RecordedStrip({ group, first, second, range, marks, hands }: RecordedStripProps) {
  const [at, setAt] = useState<number | null>(null);
  const draw = useRef<(() => void) | null>(null);
  const drawn = useMemo(() => joined(group, first, second), [group, first, second]);
  const series = useMemo(() => {
    const own = group.lines.map(({ name, label, decimals }) => ({ name, label, decimals }));
    return second === null ? own : [...own, ...own.map((one) => ({ ...one, name: `${one.name}|`, thin: true }))];
  }, [group, second === null]);
  const doubtful = group.lines.flatMap((line) => line.sources.flatMap((name) => first.doubtful.get(name) ?? []));
  const register = useCallback((one: (() => void) | null) => void (draw.current = one), []);
  useEffect(() => draw.current?.(), [drawn, range[0], range[1], marks]);
  const time = at === null ? undefined : drawn.t[at];
  return (
    <section class="strip" aria-label={group.title}>
      <h3>
        {group.title} <span class="unit">{group.unit}</span>
        {time !== undefined && <span class="at">{t("recordings.atS", { time: fixed(time, 2) })}</span>}
      </h3>
      <TimeChart
        title={group.title}
        series={series}
        height={170}
        timeLabels={secondLabels}
        read={() => ({ ...drawn, range })}
        overlays={() => ({ marks, thresholds: group.lines.flatMap((line) => line.limits), doubtful })}
        hands={hands}
        onCursor={setAt}
        register={register}
      />
      <ul class="line-names">
        {group.lines.map((line, index) => (
          <li key={line.name}>
            <svg class={`sample series-${(index % 6) + 1}`} viewBox="0 0 28 8" aria-hidden="true">
              <line x1="0" y1="4" x2="28" y2="4" stroke-dasharray={(DASHES[index % 6] as number[]).join(" ")} />
            </svg>
            {line.label}
            {at !== null && <strong>{values(drawn.columns, index, group.lines.length, at, line.decimals)}</strong>}
          </li>
        ))}
      </ul>
    </section>
  );
}

/** The value at the cursor, and that of the other recording. */
function values(columns: Value[][], index: number, lines: number, at: number, decimals: number): string {
  const own = fixed(columns[index]?.[at] ?? null, decimals);
  const other = columns[lines + index];
  return other === undefined ? own : `${own} | ${fixed(other[at] ?? null, decimals)}`;
}

function eventMarks(remarks: Remarks | null): ChartMark[] {
  return (remarks?.events ?? []).flatMap((event) =>
    event.time === null
      ? []
      : [
          {
            kind: "event" as const,
            from: event.time,
            to: event.seconds === null ? 1e9 : event.time + event.seconds,
            text: `${event.device}: ${event.text}`,
          },
        ],
  );
}

/** Keep what is shown as a recording of its own. */
function KeepPart({ recording, range: [from, to] }: { recording: Recording; range: Range }) {
  const session = useSession();
  const command = useCommand();
  if (!session.may("operate")) return null;
  return (
    <>
      <CommandNotice of={command} />
      <Button
        busy={command.busy}
        disabled={!session.online.value}
        onClick={() =>
          void command.run<Recording>(
            { method: "POST", path: `/recordings/${recording.id}/cut`, json: { start: from, end: to } },
            (made) =>
              command.say({ kind: "good", text: t("recordings.storedAsWholeRecording", { label: made.label }) }),
          )
        }
      >
        {t("recordings.storeSSAs", { from: fixed(from, 1), to: fixed(to, 1) })}
      </Button>
    </>
  );
}
