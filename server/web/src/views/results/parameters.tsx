/** Parameters of drives and rigid body, and the recordings that they come from. */
import { Mark } from "../../ui/controls";
import { count, number, withStd } from "../../ui/format";
import { Panel, Table, type Row } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";
import type { Report, Value } from "./report";
import { PARAMETERS, unit } from "./wording";

/** A relative standard deviation above this says that the recordings hardly tell the parameter. */
const FLAG = 0.3;

const COLUMNS = [
  { name: "value", title: "Value ± standard deviation", align: "right" },
  { name: "unit", title: "Unit" },
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
    <Panel title="Parameters">
      <details>
        <summary>{drives.length} of the drives</summary>
        <Table
          caption="Parameters of the drives"
          columns={[{ name: "name", title: "Parameter" }, ...COLUMNS]}
          rows={drives}
        />
      </details>
      <details>
        <summary>{body.length} of the rigid body</summary>
        <p class="hint">
          Of {report.reduction.standard_parameters} standard parameters only these combinations act on the joints.
          Condition number {number(report.rigid_body.condition_number, 3)}.
        </p>
        <Table
          caption="Base parameters of the rigid body"
          columns={[{ name: "name", title: "Base parameter" }, ...COLUMNS]}
          rows={body}
        />
      </details>
    </Panel>
  );
}

function cells(one: Value): Row {
  const hardly = one.value !== null && one.std !== null && one.std > FLAG * Math.abs(one.value);
  return {
    value: <span class="number-cell">{withStd(one.value, one.std)}</span>,
    unit: <span class="number-cell">{unit(one.unit)}</span>,
    flag: hardly ? <Mark kind="warning">hardly known</Mark> : "",
  };
}

export function DataUsed({ report }: { report: Report }) {
  return (
    <Panel title="Recordings that were used">
      <Table
        caption="Files with their check sums"
        columns={[
          { name: "role", title: "Recording" },
          { name: "file", title: "File" },
          { name: "samples", title: "Rows", align: "right" },
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
        <p class="hint">Bandwidth {number(report.bandwidth_hz, 2)} Hz: all errors are of signals filtered alike.</p>
      )}
    </Panel>
  );
}
