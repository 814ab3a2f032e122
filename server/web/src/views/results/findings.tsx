/** What was found, what was tried, what moved, and what could not have been seen. */
import { Mark, Notice } from "../../ui/controls";
import { number, withStd } from "../../ui/format";
import { Empty, Panel, Table, type Row } from "../../ui/layout";
import { type CandidateRow, type ShiftRow, candidates, limitGroups, shifts } from "./model";
import type { Report } from "./report";
import { STATUSES, amount, capital, follows, place, title, unit } from "./wording";
import { t } from "../../texts";
import { said } from "../../texts/report";

export function Found({ report }: { report: Report }) {
  const { effects, unexplained } = report.loop;
  if (effects.length === 0 && unexplained.length === 0) return null;
  return (
    <Panel title={t("results.whatWasFound")}>
      {effects.map((effect) => (
        <section key={`${effect.id} ${effect.joint ?? ""}`}>
          <h3>
            {capital(title(effect, report))}, {place(effect.joint)}
          </h3>
          {effect.equation && <p class="mono">{said(effect.equation)}</p>}
          <Table
            caption={t("results.sizesOf", { effect: title(effect, report) })}
            columns={[
              { name: "name", title: t("common.parameter") },
              { name: "value", title: t("common.valueStandardDeviation"), align: "right" },
              { name: "unit", title: t("common.unit") },
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
              {t("results.theseRecordingsCannotTell", {
                others: effect.indistinguishable_from
                  .map((other) => title(typeof other === "string" ? { id: other, joint: null } : other, report))
                  .join(t("results.or")),
              })}
            </Notice>
          )}
        </section>
      ))}
      {unexplained.map((law) => (
        <section key={follows(law)}>
          <h3>{t("results.unexplained", { law: follows(law) })}</h3>
          <p>
            {t("results.noEffectCatalogueFits", { notAdded: !law.added ? t("results.doesNotHoldValidation") : "" })}
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
    <Panel title={t("results.candidateCauses")}>
      {kept.length === 0 ? (
        <Empty>{t("results.noneCausesWasAccepted", { count: refused.length })}</Empty>
      ) : (
        <CandidateTable rows={kept} caption={t("results.causesCountWithReasons")} />
      )}
      <p class="hint">{t("results.chiSquareCountsUnits")}</p>
      {refused.length > 0 && (
        <details>
          <summary>{t("results.rejectedWithReasons", { count: refused.length })}</summary>
          <CandidateTable rows={refused} caption={t("results.rejectedCausesWithReasons")} />
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
        { name: "title", title: t("results.cause") },
        { name: "joint", title: t("results.where") },
        { name: "reason", title: t("common.why") },
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
    <Panel title={t("results.whatMovedWhenWas")}>
      <p class="hint">{far.length > 0 ? t("results.theseMovedMoreThan") : t("results.nothingMovedMoreThan")}</p>
      <ShiftTable rows={first} caption={t("results.parametersMovedMost")} />
      {rest.length > 0 && (
        <details>
          <summary>{t("results.others", { count: rest.length })}</summary>
          <ShiftTable rows={rest} caption={t("results.otherParametersBeforeAfter")} />
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
        { name: "name", title: t("common.parameter") },
        { name: "before", title: t("results.before2"), align: "right" },
        { name: "after", title: t("results.after2"), align: "right" },
        { name: "unit", title: t("common.unit") },
        { name: "sigmas", title: t("results.movedStandardDeviations"), align: "right" },
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
    <Panel title={t("results.detectionLimits")}>
      <p>{t("results.belowTheseSizesNothing")}</p>
      <details>
        <summary>{t("results.causesJointJoint", { count: groups.length })}</summary>
        <Table
          caption={t("results.smallestSizeEachCause")}
          columns={[
            { name: "title", title: t("results.cause") },
            { name: "sizes", title: t("results.smallestSizeWouldHave") },
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
                      {limit.smallest === null ? t("results.notAtAnySize") : amount(limit.smallest, limit.unit, 2)}
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
