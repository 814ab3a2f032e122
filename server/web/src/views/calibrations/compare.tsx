/** Two calibrations of one machine: how far each parameter is apart, and the errors. */
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { Mark, Notice } from "../../ui/controls";
import { number, time, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { FLAG_SIGMAS } from "../results/model";
import { change, parameterName, unit } from "../results/wording";
import { type Calibration, STATES } from "./rules";

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
      <h1 class="title">Two calibrations {value !== null && <span class="hint">{value.a.machine}</span>}</h1>
      {comparison.error !== null && <Notice kind="bad">{comparison.error}</Notice>}
      {value === null && comparison.loading && <p role="status">Reading …</p>}
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
        <a href="#/calibrations">All calibrations</a>
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
        Proposed by {calibration.proposed_by} {time(calibration.created)}.{" "}
        <a href={`#/results/${calibration.identification}`}>View the result</a>
      </p>
    </Panel>
  );
}

function Errors({ comparison }: { comparison: Comparison }) {
  return (
    <Panel title="Error of each joint">
      <p class="hint">
        Each on its own validation motion: recordings differ, so a small difference says little. A lower one is better.
      </p>
      <Table
        caption="Error of each joint in A and B"
        columns={[
          { name: "joint", title: "Joint" },
          { name: "a", title: "A", align: "right" },
          { name: "b", title: "B", align: "right" },
          { name: "unit", title: "Unit" },
          { name: "change", title: "B against A", align: "right" },
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
    <Panel title="Parameters, those that moved most first">
      <p>
        {far === 0
          ? "No parameter differs by more than three standard deviations."
          : `${far === 1 ? "One parameter differs" : `${far} parameters differ`} by more than three standard deviations.`}
      </p>
      <Table
        caption="Parameters in A and B"
        columns={[
          { name: "name", title: "Parameter" },
          { name: "a", title: "A", align: "right" },
          { name: "b", title: "B", align: "right" },
          { name: "unit", title: "Unit" },
          { name: "sigmas", title: "Apart (standard deviations)", align: "right" },
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
