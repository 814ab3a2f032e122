/** Parameters of drives and rigid body, and the recordings that they come from. */
import { Mark } from "../../ui/controls";
import { count, number, withStd } from "../../ui/format";
import { Panel, Table, type Row } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";
import type { Report, Value } from "./report";
import { PARAMETERS, unit } from "./wording";
import { t } from "../../texts";

/** A relative standard deviation above this says that the recordings hardly tell the parameter. */
const FLAG = 0.3;
/** Below this share of its information from the recordings a parameter is from the prior. */
const MOSTLY_PRIOR = 0.5;

const COLUMNS = [
  { name: "value", title: t("common.valueStandardDeviation"), align: "right" },
  { name: "unit", title: t("common.unit") },
  { name: "flag", title: "" },
] as const;

export function Parameters({ report }: { report: Report }) {
  const drives = Object.entries(report.cylinders).flatMap(([joint, cylinder]) =>
    Object.entries(cylinder.parameters).map(([name, value]): Row => ({
      key: `${joint}.${name}`,
      name: (
        <>
          {joint}.{name} <span class="hint">{PARAMETERS[name] ?? ""}</span>
        </>
      ),
      ...cells(value),
    })),
  );
  const body = report.rigid_body.parameters.map((one): Row => ({
    key: one.expression,
    name: <span class="mono expression">{one.expression}</span>,
    ...cells(one),
  }));
  return (
    <Panel title={t("results.parameters")}>
      <details>
        <summary>{t("results.ofTheDrives", { count: drives.length })}</summary>
        <Table
          caption={t("results.parametersDrives")}
          columns={[{ name: "name", title: t("common.parameter") }, ...COLUMNS]}
          rows={drives}
        />
      </details>
      <details>
        <summary>{t("results.rigidBody", { count: body.length })}</summary>
        <p class="hint">
          {t("results.standardParametersOnlyThese", {
            standardParameters: report.reduction.standard_parameters,
            conditionNumber: number(report.rigid_body.condition_number, 3),
          })}
        </p>
        <Table
          caption={t("results.baseParametersRigidBody")}
          columns={[{ name: "name", title: t("results.baseParameter") }, ...COLUMNS]}
          rows={body}
        />
      </details>
    </Panel>
  );
}

function cells(one: Value): Row {
  const hardly = one.value !== null && one.std !== null && one.std > FLAG * Math.abs(one.value);
  const assumed = one.told_by_data != null && one.told_by_data < MOSTLY_PRIOR;
  return {
    value: <span class="number-cell">{withStd(one.value, one.std)}</span>,
    unit: <span class="number-cell">{unit(one.unit)}</span>,
    flag: assumed ? (
      <span class="hint">{t("results.fromThePrior")}</span>
    ) : hardly ? (
      <Mark kind="warning">{t("results.hardlyKnown")}</Mark>
    ) : (
      ""
    ),
  };
}

export function DataUsed({ report }: { report: Report }) {
  return (
    <Panel title={t("results.recordingsWereUsed")}>
      <Table
        caption={t("results.filesWithTheirCheck")}
        columns={[
          { name: "role", title: t("results.recording") },
          { name: "file", title: t("results.file") },
          { name: "samples", title: t("common.rows"), align: "right" },
          { name: "sha", title: "SHA-256" },
        ]}
        rows={report.data.map((one) => ({
          key: one.sha256,
          role: ROLE_WORDS[one.role as Role] ?? one.role,
          file: <span class="file-name">{one.file.split("/").pop()}</span>,
          samples: count(one.samples),
          sha: (
            <span class="mono" title={one.sha256}>
              {one.sha256.slice(0, 12)}…
            </span>
          ),
        }))}
      />
      {report.bandwidth_hz !== null && (
        <p class="hint">{t("results.bandwidthHzAllErrors", { bandwidthHz: number(report.bandwidth_hz, 2) })}</p>
      )}
    </Panel>
  );
}
