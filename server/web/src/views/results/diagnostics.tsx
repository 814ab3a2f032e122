/** What is left of each joint: over time with zoom, over its own past and the speed, over frequency. */
import { useCallback, useEffect, useMemo, useRef, useState } from "preact/hooks";
import { type Hands, rangeHands } from "../../charts/gestures";
import type { Range } from "../../charts/range";
import { secondLabels, TimeChart } from "../../charts/time_chart";
import { RangeButtons } from "../../charts/toolbar";
import { Button } from "../../ui/controls";
import { number } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { Plot } from "../../ui/plot";
import { added } from "./model";
import type { Diagnostics as Joint, Report } from "./report";
import { unit } from "./wording";
import { t } from "../../texts";

export function Diagnostics({ report }: { report: Report }) {
  const joints = report.figures.diagnostics;
  const both = added(report);
  const ends = joints.flatMap((one) => [one.time[0] ?? 0, one.time[one.time.length - 1] ?? 0]);
  const bounds: Range = [Math.min(0, ...ends), Math.max(1, ...ends)];
  const [range, setRange] = useState<Range | null>(null);
  const now = range ?? bounds;
  const hands = rangeHands(now, bounds, setRange);
  if (joints.length === 0) return null;
  return (
    <Panel title={t("results.whatLeftJointJoint")}>
      <p class="hint">{t("results.measuredMinusPredictedEffort")}</p>
      <div class="chart-toolbar" role="toolbar" aria-label={t("common.whatPlotsShow")}>
        <RangeButtons range={() => now} bounds={() => bounds} onRange={hands.show} />
        <Button disabled={range === null} onClick={() => setRange(null)}>
          {t("common.showAll2")}
        </Button>
      </div>
      <div class="strips">
        {joints.map((joint) => (
          <Course key={joint.joint} joint={joint} both={both} range={now} hands={hands} />
        ))}
      </div>
      <Table
        caption={t("results.fitEachJoint")}
        columns={[
          { name: "joint", title: t("common.joint") },
          ...(both ? [{ name: "before", title: t("results.fitBefore"), align: "right" as const }] : []),
          { name: "after", title: both ? t("results.fitAfter") : t("results.fit"), align: "right" },
        ]}
        rows={joints.map((joint) => ({
          key: joint.joint,
          joint: joint.joint,
          before: `${number(joint.fit_before, 4)} %`,
          after: `${number(joint.fit_after, 4)} %`,
        }))}
      />
      <p class="hint">{t("results.100LessNormError")}</p>
      {joints.map((joint) => (
        <details key={joint.joint} class="motion">
          <summary>{t("results.correlationsAndSpectrum", { joint: joint.joint })}</summary>
          <Correlations joint={joint} both={both} />
        </details>
      ))}
    </Panel>
  );
}

function Course({ joint, both, range, hands }: { joint: Joint; both: boolean; range: Range; hands: Hands }) {
  const draw = useRef<(() => void) | null>(null);
  const register = useCallback((one: (() => void) | null) => void (draw.current = one), []);
  const series = useMemo(() => {
    const after = { name: "after", label: t("results.afterShort"), decimals: 2 };
    return both ? [after, { name: "before", label: t("results.before3"), decimals: 2, thin: true }] : [after];
  }, [both]);
  useEffect(() => draw.current?.(), [range[0], range[1]]);
  return (
    <section class="strip" aria-label={t("results.errorOverTime", { joint: joint.joint })}>
      <h3>
        {joint.joint} <span class="unit">{unit(joint.unit)}</span>
      </h3>
      <TimeChart
        title={joint.joint}
        series={series}
        height={150}
        timeLabels={secondLabels}
        read={() => ({ t: joint.time, columns: both ? [joint.after, joint.before] : [joint.after], range })}
        overlays={() => ({ marks: [], thresholds: [], doubtful: [] })}
        hands={hands}
        onCursor={() => undefined}
        register={register}
      />
    </section>
  );
}

function Correlations({ joint, both }: { joint: Joint; both: boolean }) {
  const bound = joint.bound ?? 0;
  const white = (places: number[]) => ({
    label: t("results.whiteNoise99"),
    values: places.map(() => 0),
    band: [places.map(() => -bound), places.map(() => bound)] as [number[], number[]],
  });
  const decibels = (values: (number | null)[]) =>
    values.map((value) => (value !== null && value > 0 ? 10 * Math.log10(value) : null));
  return (
    <>
      <Plot
        title={t("results.correlationWithItsOwn")}
        unit=""
        x={{ label: t("results.lagS"), values: joint.lag }}
        series={[{ label: t("results.whatIsLeft"), values: joint.auto }, white(joint.lag)]}
        height={220}
      />
      <Plot
        title={t("results.correlationWithSpeed")}
        unit=""
        x={{ label: t("results.lagS"), values: joint.cross_lag }}
        series={[{ label: t("results.whatIsLeft"), values: joint.cross }, white(joint.cross_lag)]}
        height={220}
      />
      <Plot
        title={t("common.spectrum")}
        unit={t("common.db1Hz", { unit: unit(joint.unit) })}
        x={{ label: t("common.frequencyHz"), values: joint.frequency }}
        series={[
          { label: t("results.afterShort"), values: decibels(joint.density_after) },
          ...(both ? [{ label: t("results.before3"), values: decibels(joint.density_before) }] : []),
        ]}
        height={220}
      />
      <p class="hint">{t("results.modelLacksNothingStays")}</p>
    </>
  );
}
