/** Errors of each joint before and after, in numbers and as bars in units of the noise. */
import { Mark } from "../../ui/controls";
import { number, percent } from "../../ui/format";
import { Panel, Table, type Column } from "../../ui/layout";
import { type JointRow, added, judgedOn, jointRows, overall } from "./model";
import type { Report } from "./report";
import { change, unit } from "./wording";

const NOISE: Record<string, string> = {
  repeat: "The noise was measured: one motion was recorded twice, and what differs between the two is noise.",
  estimated:
    "The noise is an estimate from what the model leaves over, because no motion was recorded twice. Record the " +
    "training motion once more to have it measured.",
};

export function JointErrors({ report }: { report: Report }) {
  const rows = jointRows(report);
  const both = added(report);
  const motion = judgedOn(report) === "validate" ? "the validation motion, which was not fitted" : "the fitted motion";
  const sized = rows.some((row) => row.rms !== null);
  const columns: Column[] = [
    { name: "joint", title: "Joint" },
    ...(both ? [{ name: "before", title: "Before", align: "right" } as const] : []),
    { name: "after", title: both ? "After" : "Error", align: "right" },
    { name: "unit", title: "Unit" },
    { name: "noise", title: "Noise", align: "right" },
    ...(both ? [{ name: "change", title: "Change", align: "right" } as const] : []),
    ...(sized
      ? ([
          { name: "rms", title: "RMS", align: "right" },
          { name: "mean", title: "Mean", align: "right" },
          { name: "relative", title: "Of effort", align: "right" },
        ] as const)
      : []),
    { name: "overNoise", title: "Error / noise", align: "right" },
    { name: "bar", title: "Compared with noise" },
  ];
  return (
    <Panel title="Error of each joint">
      <p class="hint">
        Standard deviation of measured minus predicted effort on {motion}. At 1 × noise nothing is left to explain.
        {sized && " RMS and mean see a constant offset too."}
      </p>
      <Table
        caption="Errors joint by joint"
        columns={columns}
        rows={rows.map((row) => ({
          key: row.joint,
          joint: row.named ? (
            <>
              <strong>{row.joint}</strong> <span class="hint">{both ? "changed here" : "blamed"}</span>
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
          relative: <span class="number-cell">{percent(row.relative, 1)}</span>,
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
            before
          </li>
        )}
        <li>
          <svg viewBox="0 0 28 16">
            <rect class="after" x="0" y="2" width="28" height="12" />
          </svg>
          {both ? "after" : "error"}
        </li>
        <li>
          <svg viewBox="0 0 28 16">
            <line class="floor" x1="14" x2="14" y1="0" y2="16" />
          </svg>
          noise of this joint
        </li>
      </ul>
      <OfEffort report={report} />
      {report.noise_floor_method !== null && <p class="hint">{NOISE[report.noise_floor_method]}</p>}
    </Panel>
  );
}

const OF: Record<string, string> = {
  stacked: "the norm of all errors over that of all measured efforts",
  joints: "the root mean square of the joints’ relative errors, because N and N m do not add up",
};

/** The relative error of all joints. */
function OfEffort({ report }: { report: Report }) {
  const { relative, relativeBefore } = overall(report);
  if (relative === null) return null;
  const before = relativeBefore === null ? "" : ` (before: ${percent(relativeBefore, 1)})`;
  return (
    <p class="hint">
      All joints together: <strong>{percent(relative, 1)}</strong> of the measured effort{before}, as{" "}
      {OF[report.overall.relative?.of ?? ""] ?? "the report says"}.
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
    `${row.joint}: ${both ? `before ${number(row.before, 3)}, after ` : ""}${number(row.after, 3)} ${unit(row.unit)}, ` +
    `noise ${number(row.noise, 3)}`;
  return (
    <svg class="error-bar" viewBox={`0 0 ${WIDTH} 36`} preserveAspectRatio="none" role="img" aria-label={words}>
      {both && <rect class="before" x={1} y={3} width={Math.max(1, before * WIDTH - 2)} height={12} />}
      <rect class="after" x={0} y={both ? 19 : 10} width={Math.max(1, after * WIDTH)} height={14} />
      <line class="floor" x1={noise * WIDTH} x2={noise * WIDTH} y1={0} y2={36} />
    </svg>
  );
}
