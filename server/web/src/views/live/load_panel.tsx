/** What the model says of the load: the mass at the tip, and how near each joint is to an overload. */
import { useRef } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { Mark, Notice } from "../../ui/controls";
import { number, percent, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { t } from "../../texts";

type Monitor = components["schemas"]["MonitorResource"];

/** How many looks the lines go back: five minutes at two seconds each. */
const KEPT = 150;
const WIDTH = 280;
const HEIGHT = 48;

/** The points of a line over the looks, oldest left; what is not known is a gap. `top` is the value at the upper edge. */
export function trend(values: (number | null)[], bottom: number, top: number): string {
  const step = WIDTH / Math.max(1, values.length - 1);
  const y = (value: number): number => HEIGHT * (1 - (value - bottom) / (top - bottom || 1));
  let drawn = "";
  values.forEach((value, index) => {
    const before = index > 0 ? values[index - 1] : null;
    if (value === null) return;
    drawn += `${before === null || before === undefined ? "M" : "L"}${(index * step).toFixed(1)} ${y(value).toFixed(1)}`;
  });
  return drawn;
}

function Trend({ values, title }: { values: (number | null)[]; title: string }) {
  const known = values.filter((value) => value !== null);
  if (known.length < 2) return null;
  const [low, high] = [Math.min(0, ...known), Math.max(...known)];
  return (
    <figure class="trend">
      <svg role="img" aria-label={title} viewBox={`0 0 ${WIDTH} ${HEIGHT}`} width="100%" height={HEIGHT}>
        <path d={trend(values, low, high)} fill="none" stroke="currentColor" stroke-width="1.5" />
      </svg>
      <figcaption class="hint">
        {t("live.bottomKgTop", { title, low: number(low, 3), high: number(high, 3) })}
      </figcaption>
    </figure>
  );
}

/** The last values that `read` gave, one more with each new answer of the monitor. */
function useKept(monitor: Monitor | null, read: (monitor: Monitor) => number | null): (number | null)[] {
  const kept = useRef<(number | null)[]>([]);
  const last = useRef<Monitor | null>(null);
  if (monitor !== null && monitor !== last.current) {
    last.current = monitor;
    kept.current = [...kept.current, read(monitor)].slice(-KEPT);
  }
  return kept.current;
}

export function LoadPanel({ monitor }: { monitor: Monitor | null }) {
  const masses = useKept(monitor, (now) => now.payload?.mass ?? null);
  if (monitor === null || monitor.state === "off") return null;
  const { payload, overload, overload_joints: near, overload_delay_s: delay } = monitor;
  const watched = delay !== null && delay !== undefined;
  const [kind, words] = overload
    ? (["bad", t("live.overloadAt", { joint: overload.joint })] as const)
    : watched
      ? (["good", t("live.noOverload")] as const)
      : (["off", t("live.overloadsNotWatched")] as const);
  return (
    <Panel title={t("live.load")} actions={<Mark kind={kind}>{words}</Mark>}>
      <p class="payload">
        {t("live.massAtTip")}{" "}
        <strong>
          {payload ? t("live.kg", { mass: withStd(payload.mass, payload.std) }) : t("live.notKnownTooLittle")}
        </strong>
      </p>
      <Trend values={masses} title={t("live.massAtTipOver")} />
      <p class="hint">{t("live.beyondLoadCalibrationsRecordings")}</p>
      {overload && (
        <Notice kind="bad">
          {t("live.measuredMinusPredictedEffort", {
            residual: number(overload.residual, 3),
            unit: overload.unit,
            joint: overload.joint,
          })}
        </Notice>
      )}
      {!watched && <p class="hint">{t("live.calibrationsRecordingsWereToo")}</p>}
      {(near ?? []).length > 0 && (
        <Table
          caption={t("live.nearestOverloadWithinLast")}
          columns={[
            { name: "joint", title: t("common.joint") },
            { name: "residual", title: t("live.measuredPredicted"), align: "right" },
            { name: "share", title: t("live.shareOverloadThreshold"), align: "right" },
          ]}
          rows={(near ?? []).map((joint) => ({
            key: joint.joint,
            joint: joint.joint,
            residual: `${number(joint.residual, 3)} ${joint.unit}`,
            share: percent(joint.share),
          }))}
        />
      )}
    </Panel>
  );
}
