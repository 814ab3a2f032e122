/** Errors of each joint before and after, in numbers and as bars in units of the noise. */
import { Mark } from "../../ui/controls";
import { change, number, share } from "../../ui/format";
import { Panel, Table, type Column } from "../../ui/layout";
import { type JointRow, added, judgedOn, jointRows, overall } from "./model";
import type { Report } from "./report";
import { unit } from "./wording";
import { t } from "../../texts";

const NOISE: Record<string, string> = {
  repeat: t("results.noiseWasMeasuredOne"),
  estimated: t("results.noiseEstimateFromWhat"),
};

export function JointErrors({ report }: { report: Report }) {
  const rows = jointRows(report);
  const both = added(report);
  const motion = judgedOn(report) === "validate" ? t("results.validationMotionWhichWas") : t("results.theFittedMotion");
  const sized = rows.some((row) => row.rms !== null);
  const columns: Column[] = [
    { name: "joint", title: t("common.joint") },
    ...(both ? [{ name: "before", title: t("results.before2"), align: "right" } as const] : []),
    { name: "after", title: both ? t("results.after2") : t("results.error"), align: "right" },
    { name: "unit", title: t("common.unit") },
    { name: "noise", title: t("common.noise"), align: "right" },
    ...(both ? [{ name: "change", title: t("results.change"), align: "right" } as const] : []),
    ...(sized
      ? ([
          { name: "rms", title: "RMS", align: "right" },
          { name: "mean", title: t("common.mean"), align: "right" },
          { name: "relative", title: t("results.ofEffort"), align: "right" },
        ] as const)
      : []),
    { name: "overNoise", title: t("results.errorNoise"), align: "right" },
    { name: "bar", title: t("results.comparedWithNoise") },
  ];
  return (
    <Panel title={t("common.errorEachJoint")}>
      <p class="hint">
        {t("results.standardDeviationMeasuredMinus", { motion, offset: sized ? t("results.rmsMeanSeeConstant") : "" })}
      </p>
      <Table
        caption={t("results.errorsJointJoint")}
        columns={columns}
        rows={rows.map((row) => ({
          key: row.joint,
          joint: row.named ? (
            <>
              <strong>{row.joint}</strong> <span class="hint">{both ? t("results.changedHere") : "blamed"}</span>
            </>
          ) : (
            row.joint
          ),
          before: number(row.before, 3),
          after: <strong>{number(row.after, 3)}</strong>,
          unit: <span class="number-cell">{unit(row.unit)}</span>,
          noise: number(row.noise, 3),
          change: <span class="number-cell">{change(row.change)}</span>,
          rms: number(row.rms, 3),
          mean: row.offset ? <Mark kind="warning">{number(row.mean, 3)}</Mark> : number(row.mean, 3),
          relative: <span class="number-cell">{share(row.relative)}</span>,
          overNoise: row.overNoise === null ? number(null) : <OverNoise value={row.overNoise} />,
          bar: <ErrorBar row={row} both={both} />,
        }))}
      />
      <ul class="key" aria-hidden="true">
        {both && (
          <li>
            <svg viewBox="0 0 28 16">
              <rect class="before" x="1" y="3" width="26" height="10" />
            </svg>
            {t("results.before3")}
          </li>
        )}
        <li>
          <svg viewBox="0 0 28 16">
            <rect class="after" x="0" y="2" width="28" height="12" />
          </svg>
          {both ? t("results.afterShort") : t("results.errorShort")}
        </li>
        <li>
          <svg viewBox="0 0 28 16">
            <line class="floor" x1="14" x2="14" y1="0" y2="16" />
          </svg>
          {t("results.noiseJoint")}
        </li>
      </ul>
      <OfEffort report={report} />
      {report.noise_floor_method !== null && <p class="hint">{NOISE[report.noise_floor_method]}</p>}
    </Panel>
  );
}

const OF: Record<string, string> = {
  stacked: t("results.normAllErrorsOver"),
  joints: t("results.rootMeanSquareJoints"),
};

/** The relative error of all joints. */
function OfEffort({ report }: { report: Report }) {
  const { relative, relativeBefore } = overall(report);
  if (relative === null) return null;
  const before = relativeBefore === null ? "" : t("results.before4", { relativeBefore: share(relativeBefore) });
  return (
    <p class="hint">
      {t("results.allJointsTogether")} <strong>{share(relative)}</strong>{" "}
      {t("results.measuredEffortAs", {
        before,
        of: OF[report.overall.relative?.of ?? ""] ?? t("results.theReportSays"),
      })}
    </p>
  );
}

/** How many times the noise; what is far above it is marked. */
function OverNoise({ value }: { value: number }) {
  const text = <span class="number-cell">{number(value, 3)} ×</span>;
  return value > 1.5 ? <Mark kind="warning">{text}</Mark> : text;
}

const WIDTH = 200;

/** Error before and after of one joint, and its noise, in units of the noise. */
export function ErrorBar({ row, both }: { row: JointRow; both: boolean }) {
  if (row.bar === null) return null;
  const { before, after, noise } = row.bar;
  const words =
    `${row.joint}: ${both ? t("results.beforeAfter", { before: number(row.before, 3) }) : ""}${number(row.after, 3)} ${unit(row.unit)}, ` +
    t("results.noise", { noise: number(row.noise, 3) });
  return (
    <svg class="error-bar" viewBox={`0 0 ${WIDTH} 36`} preserveAspectRatio="none" role="img" aria-label={words}>
      {both && <rect class="before" x={1} y={3} width={Math.max(1, before * WIDTH - 2)} height={12} />}
      <rect class="after" x={0} y={both ? 19 : 10} width={Math.max(1, after * WIDTH)} height={14} />
      <line class="floor" x1={noise * WIDTH} x2={noise * WIDTH} y1={0} y2={36} />
    </svg>
  );
}
