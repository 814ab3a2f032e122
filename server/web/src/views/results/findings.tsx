/** What was found, what was tried, what moved, and what could not have been seen. */
import { Mark, Notice } from "../../ui/controls";
import { number, withStd } from "../../ui/format";
import { Empty, Panel, Table, type Row } from "../../ui/layout";
import { type CandidateRow, type ShiftRow, candidates, limitGroups, shifts } from "./model";
import type { Report } from "./report";
import { STATUSES, amount, capital, follows, place, title, unit } from "./wording";

export function Found({ report }: { report: Report }) {
  const { effects, unexplained } = report.loop;
  if (effects.length === 0 && unexplained.length === 0) return null;
  return (
    <Panel title="What was found">
      {effects.map((effect) => (
        <section key={`${effect.id} ${effect.joint ?? ""}`}>
          <h3>
            {capital(title(effect, report))}, {place(effect.joint)}
          </h3>
          {effect.equation && <p class="mono">{effect.equation}</p>}
          <Table
            caption={`Sizes of ${title(effect, report)}`}
            columns={[
              { name: "name", title: "Parameter" },
              { name: "value", title: "Value ± standard deviation", align: "right" },
              { name: "unit", title: "Unit" },
            ]}
            rows={Object.entries(effect.parameters).map(([name, one]) => ({
              key: name,
              name,
              value: <strong class="number-cell">{withStd(one.value, one.std)}</strong>,
              unit: unit(one.unit),
            }))}
          />
          {effect.indistinguishable_from.length > 0 && (
            <Notice kind="warning">
              These recordings cannot tell it from{" "}
              {effect.indistinguishable_from
                .map((other) => title(typeof other === "string" ? { id: other, joint: null } : other, report))
                .join(" or ")}
              .
            </Notice>
          )}
        </section>
      ))}
      {unexplained.map((law) => (
        <section key={follows(law)}>
          <h3>Unexplained: {follows(law)}</h3>
          <p>
            No effect of the catalogue fits. The law that was measured describes these recordings and is not a cause.
            {!law.added && " It does not hold on the validation motion, so it was not added to the model."}
          </p>
        </section>
      ))}
    </Panel>
  );
}

export function Candidates({ report }: { report: Report }) {
  const { kept, refused } = candidates(report);
  if (kept.length + refused.length === 0) return null;
  return (
    <Panel title="Candidate causes">
      {kept.length === 0 ? (
        <Empty>None of {refused.length} causes was accepted.</Empty>
      ) : (
        <CandidateTable rows={kept} caption="Causes that count, with reasons" />
      )}
      <p class="hint">
        Chi-square counts in units of the noise: it is how much of the squared error a cause takes away.
      </p>
      {refused.length > 0 && (
        <details>
          <summary>{refused.length} rejected, with reasons</summary>
          <CandidateTable rows={refused} caption="Rejected causes, with reasons" />
        </details>
      )}
    </Panel>
  );
}

function CandidateTable({ rows, caption }: { rows: CandidateRow[]; caption: string }) {
  return (
    <Table
      caption={caption}
      columns={[
        { name: "status", title: "" },
        { name: "title", title: "Cause" },
        { name: "joint", title: "Where" },
        { name: "reason", title: "Why" },
      ]}
      rows={rows.map((row) => ({
        key: `${row.title} ${row.joint ?? ""}`,
        status: <Mark kind={STATUSES[row.status][0]}>{STATUSES[row.status][1]}</Mark>,
        title: capital(row.title),
        joint: place(row.joint),
        reason: row.reason,
      }))}
    />
  );
}

const SHOWN = 8;

export function Moved({ report }: { report: Report }) {
  const rows = shifts(report);
  if (rows.length === 0) return null;
  const far = rows.filter((row) => row.far);
  const first = far.length > 0 ? far : rows.slice(0, SHOWN);
  const rest = rows.slice(first.length);
  return (
    <Panel title="What moved when it was added">
      <p class="hint">
        {far.length > 0
          ? "These moved by more than three standard deviations: they had been standing in for what was missing."
          : "Nothing moved by more than three standard deviations. The largest moves:"}
      </p>
      <ShiftTable rows={first} caption="Parameters that moved most" />
      {rest.length > 0 && (
        <details>
          <summary>{rest.length} others</summary>
          <ShiftTable rows={rest} caption="Other parameters before and after" />
        </details>
      )}
    </Panel>
  );
}

function ShiftTable({ rows, caption }: { rows: ShiftRow[]; caption: string }) {
  return (
    <Table
      caption={caption}
      columns={[
        { name: "name", title: "Parameter" },
        { name: "before", title: "Before", align: "right" },
        { name: "after", title: "After", align: "right" },
        { name: "unit", title: "Unit" },
        { name: "sigmas", title: "Moved by (standard deviations)", align: "right" },
      ]}
      rows={rows.map((row): Row => ({
        key: row.name,
        name: (
          <>
            {row.name} {row.meaning && <span class="hint">{row.meaning}</span>}
          </>
        ),
        before: number(row.before),
        after: number(row.after),
        unit: <span class="number-cell">{unit(row.unit)}</span>,
        sigmas: row.far ? <Mark kind="warning">{number(row.sigmas, 2)}</Mark> : number(row.sigmas, 2),
      }))}
    />
  );
}

export function Limits({ report }: { report: Report }) {
  const groups = limitGroups(report);
  if (groups.length === 0) return null;
  return (
    <Panel title="Detection limits">
      <p>
        Below these sizes “nothing found” says nothing: a cause that is smaller could be there and these recordings
        would not have shown it.
      </p>
      <details>
        <summary>{groups.length} causes, joint by joint</summary>
        <Table
          caption="Smallest size of each cause that would have been found"
          columns={[
            { name: "title", title: "Cause" },
            { name: "sizes", title: "Smallest size that would have been found" },
          ]}
          rows={groups.map((group) => ({
            key: group.title,
            title: capital(group.title),
            sizes: (
              <ul class="sizes">
                {group.limits.map((limit) => (
                  <li key={limit.joint ?? ""}>
                    {place(limit.joint)}:{" "}
                    <span class="number-cell">
                      {limit.smallest === null ? "not at any size" : amount(limit.smallest, limit.unit, 2)}
                    </span>
                  </li>
                ))}
              </ul>
            ),
          }))}
        />
      </details>
    </Panel>
  );
}
