/** All plots of a machine that is measured now, on one line of time. */
import { useSignalEffect } from "@preact/signals";
import { useCallback, useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { Hands } from "../../charts/gestures";
import type { ChartMark } from "../../charts/overlays";
import { type Range, type Shown, zoomed, within } from "../../charts/range";
import { clock } from "../../charts/time_chart";
import { LiveToolbar } from "../../charts/toolbar";
import { remember, remembered } from "../../storage";
import { Button, Notice } from "../../ui/controls";
import { zone } from "../../ui/format";
import { ChannelChoice, chosen, Thresholds, useChoice } from "./choice";
import { Diagnostics } from "./diagnostics";
import type { Group } from "./groups";
import { useMarks } from "./marks";
import { type Part, realClock, sliced } from "./pace";
import { Strip } from "./strip";
import { useSignals } from "./use_signals";
import type { Live } from "./use_live";
import { XyPanel } from "./xy_panel";
import { t } from "../../texts";

/** ms between two drawings of what moves: not more often than it is seen, and often enough that it does not jump. */
const OFTENEST_MS = 50;
const RAREST_MS = 200;
/** CSS px that a plot's lines have on a tablet. */
const PIXELS = 320;
const KEY = "hilfit.window";

export default function Plots({ machine, groups, live }: { machine: string; groups: Group[]; live: Live }) {
  const [span, setSpan] = useState(() => Number(remembered(KEY)) || 30);
  const [shown, setShown] = useState<Shown>({ kind: "live", span });
  const [choice, setChoice] = useChoice(machine);
  const [open, setOpen] = useState<"channels" | "thresholds" | "xy" | null>(null);
  const drawn = useMemo(() => chosen(groups, choice.hidden), [groups, choice.hidden.join("\n")]);
  const names = useMemo(
    () => [...new Set(drawn.flatMap((group) => group.lines.flatMap((line) => line.sources)))],
    [drawn],
  );
  const marks = useMarks(machine);
  const draws = useRef(new Map<string, Part>());
  const writes = useRef(new Map<string, Part>());
  const unwritten = useRef(false);
  const drawings = useRef(0);
  const period = Math.min(RAREST_MS, Math.max(OFTENEST_MS, (1000 * lengthOf(shown)) / PIXELS));
  const latestPeriod = useRef(period);
  latestPeriod.current = period;
  const draw = useMemo(
    () =>
      sliced(
        () => {
          drawings.current += 1;
          const numbers = unwritten.current ? [...writes.current.values()] : [];
          unwritten.current = false;
          return [...draws.current.values(), ...numbers];
        },
        realClock,
        () => latestPeriod.current,
      ),
    [],
  );
  useSignalEffect(() => {
    void live.ticks.value;
    unwritten.current = true;
    draw();
  });
  const signals = useSignals(machine, live.history, names, shown, live.link, draw);
  const register = useCallback((name: string, one: Part | null) => put(draws.current, name, one), []);
  const registerNumbers = useCallback((name: string, one: Part | null) => put(writes.current, name, one), []);
  useMoving(shown.kind === "live" && shown.span <= 120, period, draw);
  useEffect(draw, [shown, drawn, choice, marks.length]);

  const show = (next: Shown): void => {
    if (next.kind === "live") {
      setSpan(next.span);
      remember(KEY, String(next.span));
    }
    setShown(next);
  };
  const fixed = ([from, to]: Range): void => show({ kind: "fixed", from, to });
  const hands: Hands = {
    range: signals.range,
    show: (range) => fixed(within(range, signals.bounds())),
    zoom: (factor, centre) => fixed(zoomed(signals.range(), factor, centre, signals.bounds())),
    back: () => show({ kind: "live", span }),
  };
  const toggle = (part: typeof open) => () => setOpen(open === part ? null : part);
  return (
    <>
      <LiveToolbar shown={shown} range={signals.range} bounds={signals.bounds} onShown={show} span={span}>
        <Button onClick={toggle("channels")}>{t("common.channels")}</Button>
        <Button onClick={toggle("thresholds")}>{t("live.thresholds")}</Button>
        <Button onClick={toggle("xy")}>{t("live.xOverY")}</Button>
      </LiveToolbar>
      {shown.kind === "fixed" && (
        <p class="paused" role="status">
          {t("live.heldWithoutCursorNumbers", {
            from: clock(shown.from, 1),
            to: clock(shown.to, 1),
            zone: zone(new Date(1000 * shown.to)),
          })}
        </p>
      )}
      {signals.error !== null && <Notice kind="warning">{signals.error}</Notice>}
      {open === "channels" && <ChannelChoice groups={groups} choice={choice} onChoice={setChoice} />}
      {open === "thresholds" && <Thresholds groups={groups} choice={choice} onChoice={setChoice} />}
      {open === "xy" && <XyPanel groups={drawn} trace={signals.trace} range={signals.range} register={register} />}
      <div class="strips">
        {drawn.map((group) => (
          <Strip
            key={group.title}
            group={group}
            history={live.history}
            silence={live.silence}
            trace={signals.trace}
            range={signals.range}
            marks={marks}
            thresholds={choice.thresholds[group.key] ?? []}
            hands={hands}
            register={register}
            registerNumbers={registerNumbers}
          />
        ))}
      </div>
      <Marks marks={marks} onShow={fixed} />
      <Diagnostics draws={() => drawings.current} missed={() => live.history.missed} />
    </>
  );
}

function put(parts: Map<string, Part>, name: string, one: Part | null): void {
  if (one === null) parts.delete(name);
  else parts.set(name, one);
}

/** Seconds that are shown. */
function lengthOf(shown: Shown): number {
  return shown.kind === "live" ? shown.span : shown.to - shown.from;
}

/** Call `draw` each `period` ms, about the time in which lines move by a pixel, while `moves`. */
function useMoving(moves: boolean, period: number, draw: () => void): void {
  useEffect(() => {
    if (!moves) return undefined;
    const timer = setInterval(draw, period);
    return () => clearInterval(timer);
  }, [moves, period, draw]);
}

const WORDS = { alarm: t("live.alarm"), event: t("live.event"), recording: t("live.recording") } as const;

/** The marks in words; a touch shows what happened around one. */
function Marks({ marks, onShow }: { marks: ChartMark[]; onShow: (range: Range) => void }) {
  const recent = marks.filter((mark) => mark.from > Date.now() / 1000 - 8 * 3600).slice(0, 12);
  if (recent.length === 0) return null;
  return (
    <details class="motion">
      <summary>{t("live.marksPlotsLastEight", { count: recent.length })}</summary>
      <ul class="mark-list">
        {recent.map((mark) => (
          <li key={`${mark.kind}${mark.from}${mark.text}`}>
            <Button
              label={t("live.show", { text: mark.text })}
              onClick={() => onShow([mark.from - 15, mark.from + 15])}
            >
              {clock(mark.from, 1)}
            </Button>{" "}
            {WORDS[mark.kind]}: {mark.text}
          </li>
        ))}
      </ul>
    </details>
  );
}
