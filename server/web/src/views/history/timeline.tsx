/** Lanes over time, drawn as SVG; the list below says the same in words. */
import { count, fixed, zone } from "../../ui/format";
import { useWidth } from "../../ui/width";
import { dates, type Drawn, errors, type HistoryEvent, KINDS, lane, LANES } from "./events";
import { t } from "../../texts";

const LANE = 46;
const ERROR = 84;
const NAME = 150;
const NARROW = 600;
const AXIS = 26;
/** A letter's width, px: labels are cut to the room that they have. */
const LETTER = 7.4;

interface TimelineProps {
  events: HistoryEvent[];
  /** ms since 1970. */
  from: number;
  to: number;
}

export function Timeline({ events, from, to }: TimelineProps) {
  const [place, width] = useWidth<HTMLDivElement>(900);
  // A narrow screen has the names above the lanes.
  const left = width < NARROW ? 0 : NAME;
  const x = (time: number): number => left + ((width - left - 8) * (time - from)) / (to - from);
  const lanes = KINDS.map((kind) => ({ kind, drawn: lane(kind, events, to) }));
  const steps = errors(events);
  const top = (index: number): number => index * LANE;
  const bottom = top(lanes.length) + ERROR;
  const labels = dates(from, to, Math.max(2, Math.floor((width - left) / 90)));
  return (
    <div ref={place} class="timeline">
      <svg width={width} height={bottom + AXIS} role="img" aria-label={inWords(lanes, steps)}>
        {labels.map((one) => (
          <g key={one.at}>
            <line class="grid" x1={x(one.at)} x2={x(one.at)} y1={0} y2={bottom} />
            <text class="date" x={x(one.at)} y={bottom + 18} text-anchor="middle">
              {one.text}
            </text>
          </g>
        ))}
        {lanes.map(({ kind, drawn }, index) => (
          <g key={kind} transform={`translate(0 ${top(index)})`}>
            <line class="grid" x1={0} x2={width} y1={LANE} y2={LANE} />
            <text class="name" x={4} y={left === 0 ? 13 : 28}>
              {LANES[kind]}
            </text>
            <Lane drawn={drawn} x={(time) => Math.max(left, x(time))} low={left === 0} end={width} />
          </g>
        ))}
        <g transform={`translate(0 ${top(lanes.length)})`}>
          <line class="grid" x1={0} x2={width} y1={ERROR} y2={ERROR} />
          <text class="name" x={4} y={left === 0 ? 13 : 28}>
            {t("history.error")}
          </text>
          <text class="date" x={4} y={left === 0 ? 28 : 46}>
            {t("history.timesTheNoise")}
          </text>
          <Errors steps={steps} x={x} left={left} end={width} />
        </g>
      </svg>
      <p class="hint">{t("history.timesZoneDeviceBar", { zone: zone(new Date(to)) })}</p>
    </div>
  );
}

interface LaneProps {
  drawn: Drawn[];
  x: (time: number) => number;
  low: boolean;
  end: number;
}

function Lane({ drawn, x, low, end }: LaneProps) {
  const middle = low ? 30 : 23;
  return (
    <>
      {drawn.map((one, index) => {
        const from = x(one.from);
        const until = one.to === null ? from : x(one.to);
        const next = drawn[index + 1];
        const room = Math.min(end, next === undefined ? end : x(next.from)) - from - 12;
        const letters = Math.floor(room / LETTER);
        const label =
          one.label.length <= letters ? one.label : letters > 6 ? `${one.label.slice(0, letters - 1)}…` : "";
        const mark =
          one.to === null ? (
            <circle class={one.tone} cx={from} cy={middle} r={6} />
          ) : (
            <rect class={one.tone} x={from} y={middle - 7} width={Math.max(4, until - from)} height={14} rx={3} />
          );
        return (
          <g key={index}>
            <title>{one.text}</title>
            {mark}
            {label !== "" && (
              <text
                class="mark-label"
                x={from + (one.to === null ? 10 : 2)}
                y={one.to === null ? middle + 5 : middle + 20}
              >
                {label}
              </text>
            )}
          </g>
        );
      })}
    </>
  );
}

interface ErrorsProps {
  steps: [number, number][];
  x: (time: number) => number;
  left: number;
  end: number;
}

/** The error that each identification reached, on an axis from zero. */
function Errors({ steps, x, left, end }: ErrorsProps) {
  if (steps.length === 0)
    return (
      <text class="date" x={left + 8} y={ERROR / 2 + 12}>
        {t("history.noIdentificationTime")}
      </text>
    );
  const most = Math.max(1.2, ...steps.map(([, error]) => error)) * 1.1;
  const y = (error: number): number => ERROR - 6 - ((ERROR - 36) * error) / most;
  const path = steps.map(([time, error], index) => `${index === 0 ? "M" : "L"}${x(time)} ${y(error)}`).join("");
  return (
    <>
      <line class="noise" x1={left} x2={end} y1={y(1)} y2={y(1)} />
      <text class="date" x={left + 4} y={y(1) + 16}>
        {t("history.1TheNoise")}
      </text>
      <path class="error-line" d={path} />
      {steps.map(([time, error]) => (
        <g key={time}>
          <circle class="error-point" cx={x(time)} cy={y(error)} r={4} />
          <text class="date" x={x(time)} y={y(error) - 8} text-anchor="middle">
            {fixed(error, 2)}
          </text>
        </g>
      ))}
    </>
  );
}

function inWords(lanes: { kind: HistoryEvent["kind"]; drawn: Drawn[] }[], steps: [number, number][]): string {
  const counts = lanes.map(({ kind, drawn }) => `${LANES[kind]}: ${count(drawn.length)}`);
  const last = steps[steps.length - 1];
  return `${counts.join(", ")}${last === undefined ? "" : t("history.errorLastTimesNoise", { last: fixed(last[1], 2) })}`;
}
