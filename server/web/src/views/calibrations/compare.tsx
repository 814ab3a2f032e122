/** Two calibrations of one machine: how far each parameter is apart, and the errors. */
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { Mark, Notice } from "../../ui/controls";
import { change, number, time, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { FLAG_SIGMAS } from "../results/model";
import { parameterName, unit } from "../results/wording";
import { type Calibration, STATES, sourceOf } from "./rules";
import { t } from "../../texts";

type Comparison = components["schemas"]["ComparisonResource"];
type Shift = components["schemas"]["ShiftResource"];

/** Parameters that moved most first; those that only one of them has come last. */
export function sorted(shifts: Shift[]): Shift[] {
  const size = (shift: Shift): number => (shift.sigmas === null ? -1 : Math.abs(shift.sigmas));
  return [...shifts].sort((one, other) => size(other) - size(one));
}

export function Compare({ a, b }: { a: string; b: string }) {
  const path = `/calibrations/compare?a=${encodeURIComponent(a)}&b=${encodeURIComponent(b)}`;
  const comparison = useResource<Comparison>(path, "calibrations");
  const { value } = comparison;
  return (
    <div class={comparison.stale ? "stale" : ""}>
      <h1 class="title">
        {t("calibrations.twoCalibrations")} {value !== null && <span class="hint">{value.a.machine}</span>}
      </h1>
      {comparison.error !== null && <Notice kind="bad">{comparison.error}</Notice>}
      {value === null && comparison.loading && <p role="status">{t("common.reading")}</p>}
      {value !== null && (
        <>
          <div class="columns">
            <Side title="A" calibration={value.a} />
            <Side title="B" calibration={value.b} />
          </div>
          <Errors comparison={value} />
          <Shifts comparison={value} />
        </>
      )}
      <p>
        <a href="#/calibrations">{t("calibrations.allCalibrations")}</a>
      </p>
    </div>
  );
}

function Side({ title, calibration }: { title: string; calibration: Calibration }) {
  const [kind, words] = STATES[calibration.state];
  return (
    <Panel title={`${title}: ${calibration.label || calibration.id}`}>
      <p>
        <Mark kind={kind}>{words}</Mark>
      </p>
      <p class="hint">
        {t("calibrations.proposedBy2", { proposedBy: calibration.proposed_by, created: time(calibration.created) })}{" "}
        <a href={sourceOf(calibration)}>{t("common.viewTheResult")}</a>
      </p>
    </Panel>
  );
}

function Errors({ comparison }: { comparison: Comparison }) {
  return (
    <Panel title={t("common.errorEachJoint")}>
      <p class="hint">{t("calibrations.eachItsOwnValidation")}</p>
      <Table
        caption={t("calibrations.errorEachJointB")}
        columns={[
          { name: "joint", title: t("common.joint") },
          { name: "a", title: "A", align: "right" },
          { name: "b", title: "B", align: "right" },
          { name: "unit", title: t("common.unit") },
          { name: "change", title: t("calibrations.bAgainstA"), align: "right" },
        ]}
        rows={Object.entries(comparison.errors).map(([joint, { a, b, unit: units }]) => ({
          key: joint,
          joint,
          a: number(a, 3),
          b: number(b, 3),
          unit: unit(units),
          change: a === null || b === null || a === 0 ? number(null) : change((100 * (b - a)) / a),
        }))}
      />
    </Panel>
  );
}

function Shifts({ comparison }: { comparison: Comparison }) {
  const far = comparison.parameters.filter((one) => one.sigmas !== null && Math.abs(one.sigmas) > FLAG_SIGMAS).length;
  return (
    <Panel title={t("calibrations.parametersThoseMovedMost")}>
      <p>
        {far === 0 ? t("calibrations.noParameterDiffersMore") : t("calibrations.moreThanThreeStandard", { count: far })}
      </p>
      <Table
        caption={t("calibrations.parametersB")}
        columns={[
          { name: "name", title: t("common.parameter") },
          { name: "a", title: "A", align: "right" },
          { name: "b", title: "B", align: "right" },
          { name: "unit", title: t("common.unit") },
          { name: "sigmas", title: t("calibrations.apartStandardDeviations"), align: "right" },
        ]}
        rows={sorted(comparison.parameters).map((one) => ({
          key: one.name,
          name: parameterName(one.name),
          a: <span class="number-cell">{withStd(one.a, one.a_std)}</span>,
          b: <span class="number-cell">{withStd(one.b, one.b_std)}</span>,
          unit: <span class="number-cell">{unit(one.unit)}</span>,
          sigmas:
            one.sigmas !== null && Math.abs(one.sigmas) > FLAG_SIGMAS ? (
              <Mark kind="warning">{number(one.sigmas, 2)}</Mark>
            ) : (
              number(one.sigmas, 2)
            ),
        }))}
      />
    </Panel>
  );
}
